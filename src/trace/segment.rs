//! Segments from a surface to a light, and how far their ends are kept off both.

use glam::Vec3;

use super::bvh::Ray;

/// A surface is absent where its cut-out map is below this.
pub(super) const CUT_OUT: f32 = 0.5;

/// A surface whose opacity comes from a map is absent where that is below this: less than half a step of eight bits.
pub(super) const CLEAR: f32 = 0.5 / 255.0;

/// Half the distance between 1 and the next f32: the largest relative rounding error.
pub(super) const ROUNDING: f32 = 0.5 * f32::EPSILON;

/// Offset of the light's end of a ray from its surface, as the world's of its origin, in units of the coordinates of both ends, since the BVH computes that end from
/// the start.
pub(super) const OFF_LIGHT: f32 = 16.0 * ROUNDING;

/// End of the segment from a surface to a light.
#[derive(Clone, Copy, Debug)]
pub(super) enum End {
    /// A point, offset from the light's own surface.
    At(Vec3),
    /// At infinity along this unit vector.
    Beyond(Vec3),
}

impl End {
    #[inline(always)]
    pub(super) fn ray_from(self, origin: Vec3) -> Ray {
        match self {
            Self::At(end) => Ray { origin, direction: end - origin, t_max: 1.0 },
            Self::Beyond(direction) => Ray { origin, direction, t_max: f32::INFINITY },
        }
    }
}
