//! Rough thin sheets.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::energy::AlbedoRow;
use super::fresnel::thin_reflectance;
use super::microfacet::Ggx;
use super::{Lobes, Scattered, cosine_hemisphere};

/// A thin sheet with rough faces: what it reflects is spread by GGX facets, and what it transmits as much about the
/// direction straight on, as the reflection turned over (the Khronos group, `KHR_materials_transmission`, "transmission BTDF").
#[derive(Clone, Copy, Debug)]
pub struct RoughSheet {
    ior: f32,
    transmittance: Vec3,
    alpha: f32,
    row: &'static AlbedoRow,
}

impl RoughSheet {
    pub(super) const LOBES: Lobes = Lobes::GLOSSY_REFLECTION.and(Lobes::GLOSSY_TRANSMISSION);

    /// A sheet of an index of refraction whose transmitted light has a colour.
    #[inline(always)]
    pub fn new(ior: f32, transmittance: Vec3, alpha: f32) -> Self {
        Self { ior, transmittance, alpha, row: AlbedoRow::of(alpha) }
    }

    /// `f cos θi` and the density of [`Self::sample`].
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let (ggx, turned) = (Ggx { alpha: self.alpha }, Vec3::new(wi.x, wi.y, wi.z.abs()));
        let half = (wo + turned).normalize();
        let reflectance = thin_reflectance(wo.dot(half).max(0.0), self.ior);
        let (a, b) = self.row.mean();
        let (lost, mean_lost) = (self.lost(wo.z), (1.0 - a - b).max(1e-7));
        let cosine = FRAC_1_PI * turned.z;
        let several = lost * self.lost(turned.z) / mean_lost * cosine;
        let mean = self.mean_reflectance();
        let (single, many, colour) = if wi.z > 0.0 {
            (reflectance, mean, Vec3::ONE)
        } else {
            (1.0 - reflectance, 1.0 - mean, self.transmittance)
        };
        let value = colour * (single * ggx.reflection(wo, turned, half) + many * several);
        (value, (1.0 - lost) * single * ggx.reflection_pdf(wo, half) + lost * many * cosine)
    }

    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let lost = self.lost(wo.z);
        let (wi, reflects) = if choice < lost {
            (cosine_hemisphere(pair), choice < lost * self.mean_reflectance())
        } else {
            let half = Ggx { alpha: self.alpha }.sample_normal(wo, pair);
            let o = wo.dot(half).max(0.0);
            (2.0 * o * half - wo, (choice - lost) / (1.0 - lost) < thin_reflectance(o, self.ior))
        };
        if wi.z <= 0.0 {
            return None;
        }
        let wi = if reflects { wi } else { Vec3::new(wi.x, wi.y, -wi.z) };
        Scattered::drawn(wi, self.eval(wo, wi))
    }

    /// Share of the light that meets further facets.
    #[inline(always)]
    fn lost(&self, cosine: f32) -> f32 {
        let (a, b) = self.row.at(cosine);
        1.0 - a - b
    }

    /// The cosine-weighted mean of what the sheet reflects, by Schlick's term.
    fn mean_reflectance(&self) -> f32 {
        let normal = thin_reflectance(1.0, self.ior);
        normal + (1.0 - normal) / 21.0
    }
}
