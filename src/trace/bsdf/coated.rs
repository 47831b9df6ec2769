//! A Lambertian base under a rough coat; without a base, a rough conductor.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::gloss::{Gloss, GlossAt};
use super::{Lobes, Scattered, cosine_hemisphere};

/// A Lambertian base under a GGX coat, coupled as Kelemen and Szirmay-Kalos (2001): the base receives what the coat
/// does not reflect, `ρ (1 − E(θi)) (1 − E(θo)) / (π (1 − Ē))` with `E` the directional albedo of the coat and `Ē` its
/// cosine-weighted mean. Reciprocal, and of albedo one where ρ is one, whatever the roughness.
///
/// What is partly metal has both: the linear mix of a metal and a dielectric, of which Schlick's term is linear in the
/// reflectance at normal incidence (glTF 2.0, appendix B.3).
#[derive(Clone, Copy, Debug)]
pub struct Coated {
    reflectance: Vec3,
    gloss: Gloss,
}

/// Bounds of the probability with which the coat is sampled, so that every highlight and every base is.
const CHANCES: (f32, f32) = (0.1, 0.9);

impl Coated {
    pub(super) const LOBES: Lobes = Lobes::DIFFUSE_REFLECTION.and(Lobes::GLOSSY_REFLECTION);

    /// A base of an albedo under a coat that reflects `specular` at normal incidence.
    #[inline(always)]
    pub fn new(reflectance: Vec3, specular: Vec3, alpha: f32) -> Self {
        Self { reflectance, gloss: Gloss::new(specular, alpha) }
    }

    /// The base's light: a factor on `cos θi / π` of a base of albedo 1.
    #[inline(always)]
    pub(super) fn passed(&self, o: &GlossAt, i: &GlossAt) -> Vec3 {
        let kept = (Vec3::ONE - self.gloss.mean()).max(Vec3::splat(1e-6));
        (Vec3::ONE - o.whole) * (Vec3::ONE - i.whole) / kept
    }

    #[inline(always)]
    pub(super) fn at(&self, cosine: f32) -> GlossAt {
        self.gloss.at(cosine)
    }

    /// `f cos θi` and the density of [`Self::sample`].
    #[inline(always)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (single, diffuse, pdf) = self.parts(wo, wi);
        (single + diffuse, pdf)
    }

    /// The same, of one facet of the coat apart from all else.
    #[inline(always)]
    pub(super) fn parts(&self, wo: Vec3, wi: Vec3) -> (Vec3, Vec3, f32) {
        let (o, i) = (self.gloss.at(wo.z), self.gloss.at(wi.z));
        let (coat, visible) = self.gloss.single(wo, wi);
        let base = self.reflectance * self.passed(&o, &i) * (FRAC_1_PI * wi.z);
        let chance = self.chance(&o);
        let pdf = chance * visible + (1.0 - chance) * FRAC_1_PI * wi.z;
        (coat, self.gloss.several(&o, &i, wi.z) + base, pdf)
    }

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let of_coat = choice < self.chance(&self.gloss.at(wo.z));
        let wi = if of_coat { self.gloss.sample(wo, pair) } else { cosine_hemisphere(pair) };
        if wi.z > 0.0 { Scattered::drawn(wi, self.eval(wo, wi)) } else { None }
    }

    #[inline(always)]
    pub(super) fn albedo(&self, cosine: f32) -> Vec3 {
        let o = self.gloss.at(cosine);
        o.whole + self.reflectance * (Vec3::ONE - o.whole)
    }

    /// Probability to sample a facet's reflection: its share of the reflected light.
    #[inline(always)]
    fn chance(&self, o: &GlossAt) -> f32 {
        let coat = o.single.element_sum();
        let all = (o.whole + self.reflectance * (Vec3::ONE - o.whole)).element_sum();
        // Without a base, what meets several facets alone is drawn by the cosine, and may be as little as it is.
        let most = if self.reflectance == Vec3::ZERO { 1.0 } else { CHANCES.1 };
        (coat / all.max(1e-6)).clamp(CHANCES.0, most)
    }
}
