//! What emits: one emitter for each light of the basis. Emission is 1 in the light's unit; colours and powers are the
//! lighting's business.

use glam::{Mat3, Vec3};

use crate::light::EnvironmentMapping;

use super::Paint;

/// How the columns of an area emitter lie on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AreaLayout {
    /// One column for the whole.
    Whole,
    /// A rectangle `origin + u · edge_u + v · edge_v`, `u, v ∈ [0, 1)`, cut into `across × down` texels. Its front is
    /// the side that `normal` points to.
    Texels {
        /// Corner with texel (0, 0).
        origin: Vec3,
        /// Side along u.
        edge_u: Vec3,
        /// Side along v, perpendicular to `edge_u`.
        edge_v: Vec3,
        /// Unit normal of the emitting side.
        normal: Vec3,
        /// Texels along u.
        across: u32,
        /// Texels along v.
        down: u32,
    },
}

/// Surfaces that emit diffusely.
#[derive(Clone, Debug, PartialEq)]
pub struct AreaEmitter {
    /// Indices of its triangles in the mesh.
    pub triangles: Vec<u32>,
    /// Layout of its columns on the surface.
    pub layout: AreaLayout,
    /// Whether the back emits as well.
    pub two_sided: bool,
    /// Pattern that multiplies the emission, where the source gives one (`map_Ke`).
    pub pattern: Option<Paint>,
}

/// Point-like emitters, one column each.
#[derive(Clone, Debug, PartialEq)]
pub enum PointEmitter {
    /// Equal intensity in all directions.
    Point {
        /// Position.
        position: Vec3,
    },
    /// Full intensity inside the inner cone, none outside the outer one, smooth between.
    Spot {
        /// Position.
        position: Vec3,
        /// Unit axis.
        direction: Vec3,
        /// Half angle of the inner cone.
        inner_radians: f32,
        /// Half angle of the outer cone.
        outer_radians: f32,
    },
    /// A ball as bright as a point or a spot from afar, which rays do not hit: its shadows are soft.
    Ball {
        /// Centre.
        position: Vec3,
        /// Radius, above 0.
        radius: f32,
        /// The cone of a spot; none for light to all sides.
        cone: Option<SpotCone>,
    },
    /// A disc of directions; irradiance 1 on a plane facing it.
    Sun {
        /// Unit vector towards the sun.
        towards: Vec3,
        /// Half angle of its disc; 0 for parallel light.
        angular_radius_radians: f32,
    },
    /// A photometric luminaire.
    Ies {
        /// Position.
        position: Vec3,
        /// Columns: the luminaire's own x, y, z axes in world space; its nadir is −z.
        world_from_luminaire: Mat3,
        /// Relative intensity over directions.
        profile: IesProfile,
    },
}

/// The cone of a spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotCone {
    /// Unit axis.
    pub direction: Vec3,
    /// Half angle of the inner cone, within which all of the intensity is.
    pub inner_radians: f32,
    /// Half angle of the outer cone, beyond which there is no light.
    pub outer_radians: f32,
}

/// Intensity of a type C photometric web, relative to 1 in the unit of its light.
#[derive(Clone, Debug, PartialEq)]
pub struct IesProfile {
    /// Vertical angles from nadir, increasing.
    pub vertical_radians: Vec<f32>,
    /// Horizontal angles, increasing.
    pub horizontal_radians: Vec<f32>,
    /// Relative intensity, `horizontal × vertical`, vertical angle fastest.
    pub intensity: Vec<f32>,
}

/// Light from infinitely far in every direction; radiance 1 over each column's texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentEmitter {
    /// Layout of its columns on the sphere.
    pub mapping: EnvironmentMapping,
    /// Rotation from the environment's own axes to the world's.
    pub world_from_environment: Mat3,
    /// Whether light that other surfaces reflect has columns of its own, behind those of the texels.
    pub is_split: bool,
}

/// Places of the sun, of one column each, in which it gives irradiance 1 on a plane facing it. The columns have the light that comes
/// straight from there.
#[derive(Clone, Debug, PartialEq)]
pub struct SunPlaces {
    /// Unit vectors towards the sun.
    pub towards: Vec<Vec3>,
    /// Half angle of its disc; 0 for parallel light.
    pub angular_radius_radians: f32,
}

/// One emitter: what is behind one light of the basis.
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// Surfaces.
    Area(AreaEmitter),
    /// A point-like light.
    Point(PointEmitter),
    /// The surroundings.
    Environment(EnvironmentEmitter),
    /// Places of the sun.
    Suns(SunPlaces),
}

impl AreaLayout {
    /// Column of the emitter at a point on its rectangle, counted from the emitter's first.
    pub fn column_at(&self, point: Vec3) -> u32 {
        match *self {
            Self::Whole => 0,
            Self::Texels { origin, edge_u, edge_v, across, down, .. } => {
                let offset = point - origin;
                let along = |edge: Vec3, count: u32| {
                    let t = offset.dot(edge) / edge.length_squared();
                    ((t * count as f32) as i64).clamp(0, i64::from(count) - 1) as u32
                };
                along(edge_v, down) * across + along(edge_u, across)
            }
        }
    }

    /// Texels (across, down).
    pub fn texels(&self) -> (u32, u32) {
        match *self {
            Self::Whole => (1, 1),
            Self::Texels { across, down, .. } => (across, down),
        }
    }
}
