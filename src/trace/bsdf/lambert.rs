//! Lambertian reflection.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::{Lobes, Scattered, cosine_hemisphere};

/// Reflects the same radiance in all directions.
#[derive(Clone, Copy, Debug)]
pub struct Lambert {
    /// Albedo.
    pub reflectance: Vec3,
}

impl Lambert {
    pub(super) const LOBES: Lobes = Lobes::DIFFUSE_REFLECTION;

    #[inline(always)]
    pub(super) fn eval(&self, wi: Vec3) -> (Vec3, f32) {
        (self.reflectance * (FRAC_1_PI * wi.z), FRAC_1_PI * wi.z)
    }

    #[inline(always)]
    pub(super) fn sample(&self, pair: Vec2) -> Option<Scattered> {
        let wi = cosine_hemisphere(pair);
        Scattered::drawn(wi, self.eval(wi))
    }
}
