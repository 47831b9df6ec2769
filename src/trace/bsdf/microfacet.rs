//! GGX microfacets (Walter et al. 2007) with height-correlated masking and sampling of visible normals.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::concentric_disc;

/// An isotropic GGX surface.
#[derive(Clone, Copy)]
pub(super) struct Ggx {
    /// Roughness, the square of the perceptual one.
    pub(super) alpha: f32,
}

impl Ggx {
    /// Density of microfacet normals `D(h)`.
    fn normals(self, half: Vec3) -> f32 {
        let a2 = self.alpha * self.alpha;
        // 1 + (α² − 1) cos², written so that it does not cancel near the peak.
        let d = (half.x * half.x + half.y * half.y) + a2 * half.z * half.z;
        a2 / (PI * d * d)
    }

    /// Smith's Λ(w).
    fn lambda(self, w: Vec3) -> f32 {
        let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }

    /// `D G₂ / (4 cos θo)`: reflection times `cos θi`, without the Fresnel term.
    pub(super) fn reflection(self, wo: Vec3, wi: Vec3, half: Vec3) -> f32 {
        let masking = 1.0 / (1.0 + self.lambda(wo) + self.lambda(wi));
        self.normals(half) * masking / (4.0 * wo.z)
    }

    /// Density of [`Self::sample_reflection`]: `G₁(wo) D(h) / (4 cos θo)`.
    pub(super) fn reflection_pdf(self, wo: Vec3, half: Vec3) -> f32 {
        self.normals(half) / ((1.0 + self.lambda(wo)) * 4.0 * wo.z)
    }

    /// Mirrors `wo` at a sampled visible normal (Heitz 2018, *Sampling the GGX distribution of visible normals*). The
    /// result may point below the surface; such light is lost.
    pub(super) fn sample_reflection(self, wo: Vec3, pair: Vec2) -> Vec3 {
        let stretched = Vec3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z).normalize();
        let length2 = stretched.x * stretched.x + stretched.y * stretched.y;
        let t1 = if length2 > 0.0 { Vec3::new(-stretched.y, stretched.x, 0.0) / length2.sqrt() } else { Vec3::X };
        let t2 = stretched.cross(t1);
        let disc = concentric_disc(pair);
        let s = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - s) * (1.0 - disc.x * disc.x).max(0.0).sqrt() + s * disc.y;
        let z = (1.0 - disc.x * disc.x - y * y).max(0.0).sqrt();
        let normal = disc.x * t1 + y * t2 + z * stretched;
        let half = Vec3::new(self.alpha * normal.x, self.alpha * normal.y, normal.z.max(1e-6)).normalize();
        2.0 * wo.dot(half) * half - wo
    }
}
