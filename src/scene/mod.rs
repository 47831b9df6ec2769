//! What is lit: geometry, materials, camera and emitters, loaded from a scene file or built in.
//!
//! A [`Scene`] is plain data, checked once; tracing reads it and never asks a file again.
//!
//! # Example
//!
//! ```
//! use ltm::scene::BuiltIn;
//!
//! let room = BuiltIn { width: 32, height: 24, texels: 4 }.named("diffuse")?;
//! assert!(room.scene.basis.column_count() >= 16);
//! // Of a file: `ltm::load_scene("room.toml")?`, or `ltm::scene::load_with` with options.
//! # Ok::<(), ltm::Error>(())
//! ```

mod assembly;
mod built_in;
mod camera;
mod camera_entry;
mod content;
mod cube_map;
mod emitter;
mod file;
mod folders;
mod furnished_room;
mod gltf;
mod import;
mod lens;
mod lights;
mod lines;
mod load;
mod loaded;
mod material;
mod memory;
mod mesh;
mod mtl;
mod names;
mod obj;
mod origin;
mod photometry;
mod polygon;
mod rectangle;
mod resolve_materials;
mod sensors;
mod shapes;
mod smoothing;
mod source;
mod sun_places;
mod survey;
mod textures;
mod validate;

pub use built_in::{BUILT_IN_NAMES, BuiltIn, built_in, built_in_named};
pub use camera::{Camera, PixelFilter, Projection};
pub use content::content_hash;
pub use emitter::{
    AreaEmitter, AreaLayout, Emitter, EnvironmentEmitter, IesProfile, PointEmitter, SpotCone, SunPlaces,
};
pub use furnished_room::furnished_room;
pub use lens::Lens;
pub use load::{LoadOptions, grid_names, is_scene_file, load, load_with};
pub use loaded::{LoadedScene, NamedCamera, RenderSettings};
pub use material::{
    FloatTexture, Material, Paint, Placing, PrincipledSurface, Relief, Surface, Texels, Texture, TextureId,
};
pub(crate) use mesh::bounds;
pub use mesh::{MaterialId, Mesh, Triangle, Vertex};
pub use origin::{in_file, stated_origin};
pub use sensors::{IRRADIANCE, Sensor, Sensors, shows_irradiance};
pub use survey::{SceneSurvey, survey};
pub use validate::validate;

use std::sync::Arc;

use glam::DVec3;

use crate::light::LightBasis;

/// Everything that decides the entries of `T`, apart from the samples.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, for people.
    pub name: String,
    /// Where the zero of everything here lies in the file's coordinates: zero, but for scenes that stand far away for their size.
    pub origin: DVec3,
    /// All geometry, in world space.
    pub mesh: Mesh,
    /// Materials, indexed by [`MaterialId`].
    pub materials: Vec<Material>,
    /// Textures, indexed by [`TextureId`].
    pub textures: Vec<Texture>,
    /// The camera. Of a view by sensors only its size counts, which is theirs.
    pub camera: Camera,
    /// What stands for the camera's pixels: irradiance is asked for there.
    pub sensors: Option<Arc<Sensors>>,
    /// Whether a pixel shows the irradiance of the surface that it sees first, and not its radiance; nothing where it sees none.
    pub shows_irradiance: bool,
    /// One emitter for each light of the basis, in the same order.
    pub emitters: Vec<Emitter>,
    /// Lights that the camera does not see, by their numbers, ascending: its rays pass them as if they were not there. Mirrors show them,
    /// and they light as others do.
    pub unseen_lights: Vec<u32>,
    /// Which column is which light. Places count from the origin.
    pub basis: LightBasis,
    /// Metres per scene unit, 0 where unknown.
    pub metres_per_unit: f32,
}

impl Scene {
    /// Whether what pixels show beside light is traced with them: one sample of a pixel has no halves, and sensors see no surface.
    pub fn has_planes(&self, samples_per_pixel: u32) -> bool {
        samples_per_pixel > 1 && self.sensors.is_none()
    }
}
