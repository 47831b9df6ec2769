//! A scene that is ready to trace, with the settings that it asks for and its identity.

use sha2::{Digest, Sha256};

use super::Scene;
use crate::light::Lighting;

/// A scene that has been read and checked.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// How it asks to be rendered; programs may override each of these.
    pub settings: RenderSettings,
    /// The light that the scene file gives: every light's emission, and an environment's map texel by texel.
    pub lighting: Lighting,
    /// What was mended or looks wrong, one line each, for people.
    pub warnings: Vec<String>,
    /// [`content_hash`] of the scene with these settings.
    pub content: [u8; 32],
}

/// How a scene asks to be rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// Paths per pixel.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Side of a block in pixels.
    pub block_side: u32,
    /// Longest path in segments: 1 sees only lights, 2 direct light.
    pub max_depth: u32,
}

impl RenderSettings {
    /// Most samples per pixel: what the sample sequence distinguishes with light samples to spare.
    pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 24;
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { samples_per_pixel: 64, seed: 0, block_side: 32, max_depth: 12 }
    }
}

impl LoadedScene {
    /// A loaded scene with its content hash, lit by its lights' emission.
    pub fn new(scene: Scene, settings: RenderSettings, warnings: Vec<String>) -> Self {
        let content = content_hash(&scene, settings.max_depth);
        let lighting = Lighting::of_scene(&scene.basis);
        Self { scene, settings, lighting, warnings, content }
    }

    /// The same scene in an image of so many pixels.
    #[must_use]
    pub fn sized(mut self, width: u32, height: u32) -> Self {
        (self.scene.camera.width, self.scene.camera.height) = (width, height);
        self.content = content_hash(&self.scene, self.settings.max_depth);
        self
    }
}

/// SHA-256 over everything that decides the entries of `T` apart from the samples: geometry, materials, textures,
/// camera, emitters, path depth. Names do not count.
///
/// Small records are hashed by their `Debug` text: it holds every field, also ones that are added later, and prints
/// floats so that different values differ.
pub fn content_hash(scene: &Scene, max_depth: u32) -> [u8; 32] {
    let mut hash = Sha256::new();
    let mut part = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    part(b"ltm scene 1");
    let Scene { name: _, origin: _, mesh, materials, textures, camera, emitters, basis: _, metres_per_unit: _ } = scene;
    part(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.position).collect::<Vec<_>>()));
    part(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.normal).collect::<Vec<_>>()));
    part(bytemuck::cast_slice(&mesh.vertices.iter().map(|v| v.uv).collect::<Vec<_>>()));
    let triangles: Vec<[u32; 5]> = mesh
        .triangles
        .iter()
        .map(|t| [t.vertices[0], t.vertices[1], t.vertices[2], t.material.0, t.emitter.map_or(u32::MAX, |e| e)])
        .collect();
    part(bytemuck::cast_slice(&triangles));
    for material in materials {
        part(format!("{:?} {:?}", material.surface, material.cutout).as_bytes());
        // Only where it says something, so that scenes without keep the identity that they had.
        if material.opacity < 1.0 {
            part(format!("opacity {:?}", material.opacity).as_bytes());
        }
    }
    for texture in textures {
        part(format!("{} × {}", texture.width, texture.height).as_bytes());
        part(bytemuck::cast_slice(&texture.texels));
    }
    part(format!("{camera:?} {emitters:?} depth {max_depth}").as_bytes());
    hash.finalize().into()
}
