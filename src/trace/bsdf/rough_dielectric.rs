//! Rough dielectric boundaries.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::fresnel::dielectric_reflectance;
use super::glass_energy::GlassRow;
use super::microfacet::Ggx;
use super::{Lobes, Scattered, cosine_hemisphere};

/// A GGX boundary that reflects and refracts at every facet (Walter et al. 2007, *Microfacet models for refraction
/// through rough surfaces*, §5), with the light that meets several facets.
#[derive(Clone, Copy, Debug)]
pub struct RoughDielectric {
    /// Index of refraction on the far side over that on the viewer's.
    ior: f32,
    transmittance: Vec3,
    alpha: f32,
    row: &'static GlassRow,
    /// Whether the viewer is on the side of the greater index.
    inside: bool,
}

impl RoughDielectric {
    pub(super) const LOBES: Lobes = Lobes::GLOSSY_REFLECTION.and(Lobes::GLOSSY_TRANSMISSION);

    /// A boundary of an index on the far side over that on the viewer's, whose transmitted light has a colour.
    #[inline(always)]
    pub fn new(ior: f32, transmittance: Vec3, alpha: f32) -> Self {
        Self { ior, transmittance, alpha, row: GlassRow::of(ior, alpha), inside: ior < 1.0 }
    }

    /// `f cos θi` and the density of [`Self::sample`].
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (ggx, compression) = (Ggx { alpha: self.alpha }, self.ior * self.ior);
        let lost = self.row.lost(self.inside, wo.z);
        let share = self.row.transmitted(self.inside, self.ior);
        let (mut value, mut pdf) = (Vec3::ZERO, 0.0);
        if wi.z > 0.0 {
            let half = (wo + wi).normalize();
            let reflectance = dielectric_reflectance(wo.dot(half), self.ior).0;
            value = Vec3::splat(reflectance * ggx.reflection(wo, wi, half));
            pdf = reflectance * ggx.reflection_pdf(wo, half);
        } else if let Some(half) = self.refracting(wo, wi) {
            let (o, i) = (wo.dot(half), wi.dot(half).abs());
            let passed = 1.0 - dielectric_reflectance(o, self.ior).0;
            // The Jacobian of refraction; the facet that turns `wo` into `wi` has the density of visible normals.
            let root = wi.dot(half) + o / self.ior;
            let jacobian = i / (root * root);
            value = self.transmittance * (passed * ggx.facets(wo, wi, half) * o / wo.z * jacobian / compression);
            pdf = passed * ggx.visible(wo, half) * o * jacobian;
        }
        // By several facets: to both sides.
        let cosine = FRAC_1_PI * wi.z.abs();
        let (part, to) = if wi.z > 0.0 { (1.0 - share, self.inside) } else { (share, !self.inside) };
        let several = part * lost * self.row.lost(to, wi.z.abs()) / self.row.mean_lost(to) * cosine;
        value += if wi.z > 0.0 { Vec3::splat(several) } else { self.transmittance * (several / compression) };
        (value, (1.0 - lost) * pdf + lost * part * cosine)
    }

    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let lost = self.row.lost(self.inside, wo.z);
        let wi = if choice < lost {
            let share = self.row.transmitted(self.inside, self.ior);
            let wi = cosine_hemisphere(pair);
            if choice < lost * share { Vec3::new(wi.x, wi.y, -wi.z) } else { wi }
        } else {
            let half = Ggx { alpha: self.alpha }.sample_normal(wo, pair);
            let o = wo.dot(half);
            let (reflectance, cos_inside) = dielectric_reflectance(o, self.ior);
            let reflects = (choice - lost) / (1.0 - lost) < reflectance;
            let wi = if reflects { 2.0 * o * half - wo } else { (o / self.ior - cos_inside) * half - wo / self.ior };
            if (wi.z > 0.0) != reflects || wi.z == 0.0 {
                return None;
            }
            wi.normalize()
        };
        let eta_scale = if wi.z > 0.0 { 1.0 } else { self.ior * self.ior };
        Scattered::drawn(wi, self.eval(wo, wi)).map(|drawn| Scattered { eta_scale, ..drawn })
    }

    /// The facet that refracts `wo` into `wi`, if there is one.
    fn refracting(&self, wo: Vec3, wi: Vec3) -> Option<Vec3> {
        let half = (wo + wi * self.ior).try_normalize()?;
        let half = if half.z < 0.0 { -half } else { half };
        (wo.dot(half) > 0.0 && wi.dot(half) < 0.0).then_some(half)
    }
}
