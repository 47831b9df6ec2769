//! Orthonormal frames around a normal.

use glam::Vec3;

/// A right-handed frame whose z axis is a given unit vector.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShadingFrame {
    x: Vec3,
    y: Vec3,
    pub(super) z: Vec3,
}

impl ShadingFrame {
    /// Duff et al. 2017, *Building an orthonormal basis, revisited*.
    #[inline(always)]
    pub(super) fn around(z: Vec3) -> Self {
        let sign = 1.0f32.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        Self {
            x: Vec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
            y: Vec3::new(b, sign + z.y * z.y * a, -z.y),
            z,
        }
    }

    #[inline(always)]
    pub(super) fn to_world(self, local: Vec3) -> Vec3 {
        self.x * local.x + self.y * local.y + self.z * local.z
    }

    #[inline(always)]
    pub(super) fn to_local(self, world: Vec3) -> Vec3 {
        Vec3::new(world.dot(self.x), world.dot(self.y), world.dot(self.z))
    }
}
