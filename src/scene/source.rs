//! What geometry files say, before it is resolved into a scene.

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;

use super::mtl::{MaterialShape, MtlMaterial};
use super::names::NameList;
use super::{Mesh, Texture};

/// Source of an image's bytes.
#[derive(Clone, Debug)]
pub(super) enum ImageSource {
    /// In a file beside the glTF file: its folder and its name there.
    File(PathBuf, String),
    /// In the glTF file: a name for messages, and the bytes.
    Embedded(PathBuf, Arc<[u8]>),
    /// In the vertices of a mesh: the texture that they make.
    Colours(Arc<Texture>),
}

/// An image that a material names.
pub(super) type SourceImage = Option<ImageSource>;

/// Alpha mode of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    /// Nothing.
    Opaque,
    /// Where the texture's alpha times this is below one half, the surface is not there.
    Cut(f32),
    /// This share of the light, times the texture's alpha, meets the surface; the rest passes straight.
    Blend(f32),
}

/// A material of the metallic-roughness kind, with the extensions that are read.
#[derive(Clone, Debug)]
pub(super) struct GltfMaterial {
    pub(super) base: Vec3,
    pub(super) base_image: SourceImage,
    pub(super) alpha: Alpha,
    pub(super) metallic: f32,
    pub(super) roughness: f32,
    /// Blue multiplies `metallic`, green `roughness`.
    pub(super) metallic_roughness_image: SourceImage,
    pub(super) normal_image: SourceImage,
    /// Factor on what of its normals lies along the surface.
    pub(super) normal_scale: f32,
    pub(super) ior: f32,
    /// Colour and strength of the reflection at normal incidence, over that of `ior`.
    pub(super) specular: Vec3,
    /// A clear coat over all: its strength and its roughness.
    pub(super) clear_coat: [f32; 2],
    /// Colour and roughness of a sheen.
    pub(super) sheen: (Vec3, f32),
    pub(super) transmission: f32,
    /// Red multiplies `transmission`.
    pub(super) transmission_image: SourceImage,
    /// Colour that light has after this distance within the body.
    pub(super) attenuation: (Vec3, f32),
    /// Share of what is diffuse that leaves on the other side; alpha of the image multiplies it.
    pub(super) translucency: f32,
    pub(super) translucency_image: SourceImage,
    pub(super) translucent: Vec3,
    pub(super) translucent_image: SourceImage,
    /// Whether it bounds a body, which refracts; otherwise it is a sheet.
    pub(super) is_body: bool,
    pub(super) emission: Vec3,
    pub(super) emission_image: SourceImage,
    pub(super) two_sided: bool,
}

/// All geometry of a scene before its materials and lights are made.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    pub(super) mesh: Mesh,
    /// Difference between each vertex's position and its f32 rounding.
    pub(super) residuals: Vec<Vec3>,
    /// The materials that [`MaterialId`](super::MaterialId)s refer to.
    pub(super) materials: Vec<SourceMaterial>,
    /// Object names.
    pub(super) objects: NameList,
    /// Index into `objects` for every triangle.
    pub(super) object_of: Vec<u32>,
}

/// A material as its file describes it.
#[derive(Debug)]
pub(super) struct SourceMaterial {
    pub(super) name: String,
    pub(super) description: Description,
}

/// A material of a source file.
#[derive(Debug)]
pub(super) enum Description {
    /// An MTL file, with the folder of its textures and the shape of what has it.
    Mtl(Box<MtlMaterial>, PathBuf, MaterialShape),
    /// A glTF file.
    Gltf(Box<GltfMaterial>),
}
