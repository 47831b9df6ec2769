//! The reflection of rough conductors and coats, with all scattering between microfacets.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::energy::AlbedoRow;
use super::fresnel::schlick;
use super::microfacet::Ggx;

/// Below this a microfacet surface is a mirror: its highlight is narrower than f32 can integrate.
const MIN_ALPHA: f32 = 1e-3;

/// GGX reflection with Schlick's Fresnel term.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gloss {
    /// Reflectance at normal incidence.
    specular: Vec3,
    /// Reflectance at grazing incidence: 1, but of what is no metal less below 2 % at normal incidence, which no dielectric has, and 0 at 0.
    edge: f32,
    alpha: f32,
    row: &'static AlbedoRow,
    /// Share that is reflected of light that meets several facets (Kulla and Conty 2017): `F̄² Ē / (1 − F̄ (1 − Ē))`.
    several: Vec3,
}

/// What one direction says of a lobe.
#[derive(Clone, Copy, Debug)]
pub(super) struct GlossAt {
    /// Albedo by one facet.
    pub(super) single: Vec3,
    /// Share of the light that meets further facets, `1 − E`.
    pub(super) lost: f32,
    /// Albedo by any number of facets.
    pub(super) whole: Vec3,
}

impl Gloss {
    /// The gloss of a dielectric.
    #[inline(always)]
    pub(super) fn new(specular: Vec3, alpha: f32) -> Self {
        Self::with_edge(specular, (50.0 * specular.max_element()).min(1.0), alpha)
    }

    /// The gloss of a metal, which reflects all of what is grazing, even a black one (glTF 2.0, appendix B.3.3).
    #[inline(always)]
    pub(super) fn of_metal(specular: Vec3, alpha: f32) -> Self {
        Self::with_edge(specular, 1.0, alpha)
    }

    #[inline(always)]
    fn with_edge(specular: Vec3, edge: f32, alpha: f32) -> Self {
        let alpha = alpha.max(MIN_ALPHA);
        let row = AlbedoRow::of(alpha);
        let (a, b) = row.mean();
        let mean = a + b;
        // The cosine-weighted mean of Schlick's term: `∫ 2μ (F₀ + (F₁ − F₀)(1 − μ)⁵) dμ = F₀ + (F₁ − F₀)/21`.
        let fresnel = specular + (Vec3::splat(edge) - specular) / 21.0;
        let several = fresnel * fresnel * mean / (Vec3::ONE - fresnel * (1.0 - mean));
        Self { specular, edge, alpha, row, several }
    }

    /// The linear mix with a share of another of the same roughness.
    #[inline(always)]
    pub(super) fn mixed(&self, other: &Self, share: f32) -> Self {
        let (specular, several) = (self.specular.lerp(other.specular, share), self.several.lerp(other.several, share));
        Self { specular, several, edge: self.edge + (other.edge - self.edge) * share, ..*self }
    }

    /// The albedos at a direction's cosine.
    #[inline(always)]
    pub(super) fn at(&self, cosine: f32) -> GlossAt {
        let (a, b) = self.row.at(cosine);
        let (single, lost) = (self.specular * a + self.edge * b, 1.0 - a - b);
        GlossAt { single, lost, whole: single + self.several * lost }
    }

    /// The cosine-weighted mean of [`GlossAt::whole`].
    #[inline(always)]
    pub(super) fn mean(&self) -> Vec3 {
        let (a, b) = self.row.mean();
        self.specular * a + self.edge * b + self.several * (1.0 - a - b)
    }

    /// `f cos θi` of one facet, and the density of [`Self::sample`].
    #[inline(always)]
    pub(super) fn single(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (ggx, half) = (Ggx { alpha: self.alpha }, (wo + wi).normalize());
        (schlick(self.specular, self.edge, wi.dot(half)) * ggx.reflection(wo, wi, half), ggx.reflection_pdf(wo, half))
    }

    /// `f cos θi` of several facets.
    #[inline(always)]
    pub(super) fn several(&self, o: &GlossAt, i: &GlossAt, cosine: f32) -> Vec3 {
        let (a, b) = self.row.mean();
        self.several * (o.lost * i.lost / (1.0 - a - b).max(1e-7) * FRAC_1_PI * cosine)
    }

    /// Mirrors `wo` at a visible facet.
    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, pair: Vec2) -> Vec3 {
        Ggx { alpha: self.alpha }.sample_reflection(wo, pair)
    }
}
