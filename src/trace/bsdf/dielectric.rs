//! Smooth dielectric boundaries, and thin sheets.

use glam::Vec3;

use super::fresnel::{dielectric_reflectance, thin_reflectance};
use super::{Lobes, Scattered};

/// A smooth boundary.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric {
    /// Index of refraction on the far side over that on the viewer's.
    pub ior: f32,
    /// Colour of transmitted light.
    pub transmittance: Vec3,
}

/// A thin sheet: light passes straight, and the reflections of both faces are one.
#[derive(Clone, Copy, Debug)]
pub struct ThinDielectric {
    /// Index of refraction of the sheet.
    pub ior: f32,
    /// Colour of transmitted light.
    pub transmittance: Vec3,
}

impl Dielectric {
    pub(super) const LOBES: Lobes = Lobes::SPECULAR_REFLECTION.and(Lobes::SPECULAR_TRANSMISSION);

    #[inline(always)]
    pub(super) fn reflectance(&self, cosine: f32) -> f32 {
        dielectric_reflectance(cosine, self.ior).0
    }

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, choice: f32) -> Scattered {
        let (reflectance, cos_inside) = dielectric_reflectance(wo.z, self.ior);
        let mirrored = Scattered::mirrored(wo);
        if choice < reflectance {
            return mirrored;
        }
        // Radiance is compressed by the square of the index it enters (Veach 1997, §5.2); what is traced
        // here is radiance flowing back from the far side to the near one.
        let wi = Vec3::new(-wo.x / self.ior, -wo.y / self.ior, -cos_inside);
        let compression = self.ior * self.ior;
        Scattered { wi, weight: self.transmittance / compression, eta_scale: compression, ..mirrored }
    }
}

impl ThinDielectric {
    pub(super) const LOBES: Lobes = Lobes::SPECULAR_REFLECTION.and(Lobes::STRAIGHT);

    #[inline(always)]
    pub(super) fn reflectance(&self, cosine: f32) -> f32 {
        thin_reflectance(cosine, self.ior)
    }

    #[inline(always)]
    pub(super) fn sample(&self, wo: Vec3, choice: f32) -> Scattered {
        let mirrored = Scattered::mirrored(wo);
        if choice < self.reflectance(wo.z) {
            return mirrored;
        }
        Scattered { wi: -wo, weight: self.transmittance, pass_through: true, ..mirrored }
    }
}
