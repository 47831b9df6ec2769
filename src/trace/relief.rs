//! Normals of textures: how a texture lies on a triangle, and the normal that it says.

use glam::{Vec2, Vec3};

/// Change of the place on a triangle with its texture coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slopes {
    along_u: Vec3,
    along_v: Vec3,
}

impl Slopes {
    /// Those of a triangle by two edges and the steps of its texture coordinates along them. `None` where the texture
    /// has no direction.
    pub(super) fn of([a, b]: [Vec3; 2], [s, t]: [Vec2; 2]) -> Option<Self> {
        let determinant = s.perp_dot(t);
        let slopes = Self { along_u: (a * t.y - b * s.y) / determinant, along_v: (b * s.x - a * t.x) / determinant };
        (slopes.along_u.is_finite() && slopes.along_v.is_finite()).then_some(slopes)
    }

    /// The normal of a map of normals in tangent space: red along u, green along v, each from −1 to 1 as 0 to 1. Tangents are
    /// those of the triangle, made perpendicular to the shading normal (as MikkTSpace has them where a mesh is not smoothed over
    /// its seams).
    pub(super) fn mapped(&self, normal: Vec3, texel: [f32; 4], scale: f32) -> Vec3 {
        let Some(tangent) = (self.along_u - normal * normal.dot(self.along_u)).try_normalize() else { return normal };
        let across = normal.cross(tangent);
        let across = if across.dot(self.along_v) < 0.0 { -across } else { across };
        let [x, y, z] = [0, 1, 2].map(|at| 2.0 * texel[at] - 1.0);
        (tangent * (x * scale) + across * (y * scale) + normal * z.max(0.0)).try_normalize().unwrap_or(normal)
    }

    /// The normal of a surface that is raised by a height of these slopes along u and v (Blinn 1978, *Simulation of wrinkled
    /// surfaces*). Heights are in units of the texture's width on the surface.
    pub(super) fn raised(&self, normal: Vec3, slope: Vec2) -> Vec3 {
        let volume = normal.dot(self.along_u.cross(self.along_v));
        if volume == 0.0 {
            return normal;
        }
        let gradient = (self.along_v.cross(normal) * slope.x + normal.cross(self.along_u) * slope.y) / volume;
        (normal - gradient * self.along_u.length()).try_normalize().unwrap_or(normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle in the plane z = 0 whose texture is twice as long along y.
    fn slopes() -> Slopes {
        Slopes::of([Vec3::X, Vec3::Y], [Vec2::X, Vec2::new(0.0, 0.5)]).unwrap()
    }

    #[test]
    fn a_map_of_normals_leans_along_its_channels() {
        let lean = |r: f32, g: f32, b: f32| slopes().mapped(Vec3::Z, [r, g, b, 1.0], 1.0);
        assert!((lean(0.5, 0.5, 1.0) - Vec3::Z).length() < 1e-6);
        let root = std::f32::consts::FRAC_1_SQRT_2;
        let half = 0.5 + 0.5 * root;
        assert!((lean(half, 0.5, half) - Vec3::new(root, 0.0, root)).length() < 1e-6);
        assert!((lean(0.5, half, half) - Vec3::new(0.0, root, root)).length() < 1e-6);
        // Without a scale nothing leans; on mirrored coordinates red leans the other way.
        assert!((slopes().mapped(Vec3::Z, [half, half, half, 1.0], 0.0) - Vec3::Z).length() < 1e-6);
        let mirrored = Slopes::of([Vec3::X, Vec3::Y], [-Vec2::X, Vec2::Y]).unwrap();
        assert!(mirrored.mapped(Vec3::Z, [half, 0.5, half, 1.0], 1.0).x < -0.7);
        assert!(Slopes::of([Vec3::X, Vec3::Y], [Vec2::ZERO; 2]).is_none());
    }

    #[test]
    fn heights_lean_against_their_slope() {
        // A rise of one for each width along u: 45 degrees.
        let root = std::f32::consts::FRAC_1_SQRT_2;
        assert!((slopes().raised(Vec3::Z, Vec2::X) - Vec3::new(-root, 0.0, root)).length() < 1e-6);
        // Along v the texture is twice as long: half the slope.
        let leaned = slopes().raised(Vec3::Z, Vec2::Y);
        assert!((leaned.y / leaned.z + 0.5).abs() < 1e-6 && leaned.x.abs() < 1e-6);
    }
}
