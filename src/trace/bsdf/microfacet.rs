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

    /// `D G₂`, for both directions on either side.
    pub(super) fn facets(self, wo: Vec3, wi: Vec3, half: Vec3) -> f32 {
        self.normals(half) / (1.0 + self.lambda(wo) + self.lambda(wi))
    }

    /// `D G₂ / (4 cos θo)`: reflection times `cos θi`, without the Fresnel term.
    pub(super) fn reflection(self, wo: Vec3, wi: Vec3, half: Vec3) -> f32 {
        self.facets(wo, wi, half) / (4.0 * wo.z)
    }

    /// Density of visible normals over the cosine between them and `wo`: `G₁(wo) D(h) / cos θo`.
    pub(super) fn visible(self, wo: Vec3, half: Vec3) -> f32 {
        self.normals(half) / ((1.0 + self.lambda(wo)) * wo.z)
    }

    /// Density of directions mirrored at visible normals: `G₁(wo) D(h) / (4 cos θo)`.
    pub(super) fn reflection_pdf(self, wo: Vec3, half: Vec3) -> f32 {
        self.normals(half) / ((1.0 + self.lambda(wo)) * 4.0 * wo.z)
    }

    /// `G₂ / G₁(wo)`: what is kept of light that leaves by a visible normal.
    pub(super) fn kept(self, wo: Vec3, wi: Vec3) -> f32 {
        let seen = 1.0 + self.lambda(wo);
        seen / (seen + self.lambda(wi))
    }

    /// A visible normal (Heitz 2018, *Sampling the GGX distribution of visible normals*).
    pub(super) fn sample_normal(self, wo: Vec3, pair: Vec2) -> Vec3 {
        self.normal_at(wo, concentric_disc(pair))
    }

    /// The mean of two functions over visible normals, by a midpoint rule that is fine at the rim of the disc, where the
    /// steepest normals are. The normals of one half mirror those of the other.
    pub(super) fn mean_of(self, wo: Vec3, rings: u32, turns: u32, each: impl Fn(Vec3) -> [f32; 2]) -> [f32; 2] {
        let mut sums = [0.0f64; 2];
        for i in 0..rings * turns {
            // 1 − r² is t², whose density is 2t.
            let t = ((i % rings) as f32 + 0.5) / rings as f32;
            let (sin, cos) = (((i / rings) as f32 + 0.5) / turns as f32 * PI - 0.5 * PI).sin_cos();
            let values = each(self.normal_at(wo, (1.0 - t * t).sqrt() * Vec2::new(cos, sin)));
            (0..2).for_each(|k| sums[k] += f64::from(2.0 * t * values[k]));
        }
        sums.map(|sum| (sum / f64::from(rings * turns)) as f32)
    }

    /// The visible normal of a point on the unit disc.
    fn normal_at(self, wo: Vec3, disc: Vec2) -> Vec3 {
        let stretched = Vec3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z).normalize();
        let length2 = stretched.x * stretched.x + stretched.y * stretched.y;
        let t1 = if length2 > 0.0 { Vec3::new(-stretched.y, stretched.x, 0.0) / length2.sqrt() } else { Vec3::X };
        let t2 = stretched.cross(t1);
        let s = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - s) * (1.0 - disc.x * disc.x).max(0.0).sqrt() + s * disc.y;
        let z = (1.0 - disc.x * disc.x - y * y).max(0.0).sqrt();
        let normal = disc.x * t1 + y * t2 + z * stretched;
        Vec3::new(self.alpha * normal.x, self.alpha * normal.y, normal.z.max(1e-6)).normalize()
    }

    /// Mirrors `wo` at a sampled visible normal. The result may point below the surface; such light is lost.
    pub(super) fn sample_reflection(self, wo: Vec3, pair: Vec2) -> Vec3 {
        let half = self.sample_normal(wo, pair);
        2.0 * wo.dot(half) * half - wo
    }
}
