//! A scene that is ready to trace, with the settings that it asks for and its identity.

use super::content::content_hash;
use super::{Camera, Scene};
use crate::error::{Error, Result, Warnings};
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
    /// The cameras of a glTF file; none of another file, whose only one the scene has.
    pub cameras: Vec<NamedCamera>,
    /// What was mended or looks wrong, one line each, for people.
    pub warnings: Warnings,
    /// [`content_hash`] of the scene with these settings.
    pub content: [u8; 32],
}

/// A camera of a glTF file.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    /// The name of its node.
    pub name: String,
    /// The camera's own name, which may differ.
    pub own_name: Option<String>,
    /// The camera.
    pub camera: Camera,
}

/// Where the camera of that name stands among cameras by the names of their nodes and their own; the node's counts first.
pub(super) fn position_of_camera(place: &str, names: &[(&str, Option<&str>)], name: &str) -> Result<usize> {
    let by_node = names.iter().position(|(node, _)| *node == name);
    by_node.or_else(|| names.iter().position(|(_, own)| *own == Some(name))).ok_or_else(|| {
        let hint = match names.is_empty() {
            true => "it has none; leave the name out".into(),
            false => format!("it has {}", listed(names.iter().map(|(node, _)| *node))),
        };
        Error::input(place, format!("has no camera '{name}'"), hint)
    })
}

/// Some names, for people.
pub(super) fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.take(20).map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ")
}

/// Render settings of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// Paths per pixel.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Side of a block in pixels.
    pub block_side: u32,
    /// Longest path in segments: 1 sees only lights, 2 direct light. By default Russian roulette ends paths long before (decision 61).
    pub max_depth: u32,
}

impl RenderSettings {
    /// Most samples per pixel: what the sample sequence distinguishes with light samples to spare.
    pub const MAX_SAMPLES_PER_PIXEL: u32 = 1 << 24;
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { samples_per_pixel: 64, seed: 0, block_side: 32, max_depth: 256 }
    }
}

impl LoadedScene {
    /// A loaded scene with its content hash, lit by its lights' emission.
    pub fn new(scene: Scene, settings: RenderSettings, warnings: Warnings) -> Self {
        let content = content_hash(&scene, settings.max_depth);
        let lighting = Lighting::of_scene(&scene.basis);
        Self { scene, settings, lighting, cameras: Vec::new(), warnings, content }
    }

    /// Whether what pixels show beside light is traced with them: one sample of a pixel has no halves, and sensors see no surface.
    pub fn has_planes(&self) -> bool {
        self.scene.has_planes(self.settings.samples_per_pixel)
    }

    /// The camera of that name: of a node, else a camera's own. `place` names the file in the error.
    ///
    /// # Errors
    /// No camera has it; the hint lists them.
    pub fn camera_named(&self, place: &str, name: &str) -> Result<&Camera> {
        let names: Vec<_> = self.cameras.iter().map(|camera| (&*camera.name, camera.own_name.as_deref())).collect();
        Ok(&self.cameras[position_of_camera(place, &names, name)?].camera)
    }

    /// The same scene with pixels that show the irradiance of what they see, and not its radiance.
    #[must_use]
    pub fn showing_irradiance(mut self) -> Self {
        self.scene.shows_irradiance = self.scene.sensors.is_none();
        self.content = content_hash(&self.scene, self.settings.max_depth);
        self
    }

    /// The same scene in an image of so many pixels, by all its cameras. Of sensors there are as many as the scene file says.
    #[must_use]
    pub fn sized(mut self, width: u32, height: u32) -> Self {
        if self.scene.sensors.is_some() {
            return self;
        }
        for camera in
            std::iter::once(&mut self.scene.camera).chain(self.cameras.iter_mut().map(|named| &mut named.camera))
        {
            (camera.width, camera.height) = (width, height);
        }
        self.content = content_hash(&self.scene, self.settings.max_depth);
        self
    }
}
