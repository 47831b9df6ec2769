//! Diffuse transmission: paper, leaves, lamp shades, curtains.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::coated::Coated;
use super::{Lobes, Scattered, cosine_hemisphere};

/// A thin sheet of a base that scatters to both sides, under a coat on each: what the base transmits leaves on the other side
/// with the same radiance in all directions (the Khronos group, `KHR_materials_diffuse_transmission`).
#[derive(Clone, Copy, Debug)]
pub struct Translucent {
    front: Coated,
    /// Albedo of what leaves on the other side.
    transmittance: Vec3,
}

/// Bounds of the probability of the other side.
const CHANCES: (f32, f32) = (0.1, 0.9);

impl Translucent {
    pub(super) const LOBES: Lobes =
        Lobes::DIFFUSE_REFLECTION.and(Lobes::GLOSSY_REFLECTION).and(Lobes::DIFFUSE_TRANSMISSION);

    /// A base that reflects and transmits, under coats that reflect `specular` at normal incidence.
    #[inline(always)]
    pub fn new(reflectance: Vec3, transmittance: Vec3, specular: Vec3, alpha: f32) -> Self {
        Self::of(Coated::new(reflectance, specular, alpha), transmittance)
    }

    #[inline(always)]
    pub(super) fn of(front: Coated, transmittance: Vec3) -> Self {
        Self { front, transmittance }
    }

    /// `f cos θi` and the density of [`Self::sample`].
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let chance = self.chance(wo.z);
        if wi.z > 0.0 {
            let (value, pdf) = self.front.eval(wo, wi);
            return (value, (1.0 - chance) * pdf);
        }
        let cosine = FRAC_1_PI * wi.z.abs();
        let passed = self.front.passed([wo.z, wi.z.abs()]);
        (self.transmittance * passed * cosine, chance * cosine)
    }

    pub(super) fn sample(&self, wo: Vec3, pair: Vec2, choice: f32) -> Option<Scattered> {
        let chance = self.chance(wo.z);
        let wi = if choice < chance {
            let wi = cosine_hemisphere(pair);
            Vec3::new(wi.x, wi.y, -wi.z)
        } else {
            self.front.sample(wo, pair, (choice - chance) / (1.0 - chance))?.wi
        };
        Scattered::drawn(wi, self.eval(wo, wi))
    }

    pub(super) fn albedo(&self, cosine: f32) -> Vec3 {
        self.front.albedo(cosine) + self.transmittance * self.front.entered(cosine)
    }

    /// Probability of the other side: its share of the light.
    fn chance(&self, cosine: f32) -> f32 {
        let there = self.transmittance * self.front.entered(cosine);
        let all = there + self.front.albedo(cosine);
        (there.element_sum() / all.element_sum().max(1e-6)).clamp(CHANCES.0, CHANCES.1)
    }
}
