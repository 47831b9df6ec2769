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
mod shapes;
mod source;
mod survey;
mod textures;
mod validate;

pub use built_in::{BUILT_IN_NAMES, BuiltIn, built_in, built_in_named};
pub use camera::{Camera, PixelFilter, Projection};
pub use content::content_hash;
pub use emitter::{AreaEmitter, AreaLayout, Emitter, EnvironmentEmitter, IesProfile, PointEmitter, SpotCone};
pub use furnished_room::furnished_room;
pub use lens::Lens;
pub use load::{LoadOptions, load, load_with};
pub use loaded::{LoadedScene, RenderSettings};
pub use material::{
    FloatTexture, Material, Paint, Placing, PrincipledSurface, Relief, Surface, Texels, Texture, TextureId,
};
pub(crate) use mesh::bounds;
pub use mesh::{MaterialId, Mesh, Triangle, Vertex};
pub use origin::{in_file, stated_origin};
pub use survey::{SceneSurvey, survey};
pub use validate::validate;

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
    /// The camera.
    pub camera: Camera,
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
