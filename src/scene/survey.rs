//! What a scene holds, for people who look before they render.

use std::path::Path;

use super::load::{self, LoadOptions, Unchecked};
use super::{Material, Scene, Surface};
use crate::error::{Result, Warnings};

/// A scene file or a glTF file, looked into. Unlike a scene that is loaded, it may have no light.
#[derive(Clone, Debug)]
pub struct SceneSurvey {
    /// The scene.
    pub scene: Scene,
    /// The cameras of a glTF file by their nodes' names, the one that is used first by default; none for a scene file.
    pub cameras: Vec<String>,
    /// Number of triangles of each material.
    pub triangles: Vec<usize>,
    /// What is mended, left out or looks wrong, one line each.
    pub warnings: Warnings,
    /// Why it cannot be rendered, where it cannot.
    pub refused: Option<String>,
}

/// Looks into a scene file or a glTF file.
///
/// # Errors
/// Those of [`load_with`](super::load_with), but that a scene without light is described.
pub fn survey(path: &Path, options: &LoadOptions) -> Result<SceneSurvey> {
    let Unchecked { scene, cameras, mut warnings, .. } = load::put_together(path, options)?;
    let refused = match load::check_whole(path, &scene) {
        Ok(more) => {
            warnings.extend(more);
            None
        }
        Err(error) => Some(error.to_string()),
    };
    let mut triangles = vec![0; scene.materials.len()];
    scene.mesh.triangles.iter().for_each(|t| triangles[t.material.0 as usize] += 1);
    let cameras = cameras.into_iter().map(|camera| camera.name).collect();
    Ok(SceneSurvey { scene, cameras, triangles, warnings, refused })
}

impl SceneSurvey {
    /// The materials with the number of their triangles.
    pub fn materials(&self) -> impl Iterator<Item = (&Material, usize)> {
        self.scene.materials.iter().zip(self.triangles.iter().copied())
    }
}

impl Surface {
    /// Its name in scene files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Lambert { .. } => "lambert",
            Self::Mirror { .. } => "mirror",
            Self::RoughConductor { .. } => "rough_conductor",
            Self::Dielectric { .. } => "dielectric",
            Self::ThinDielectric { .. } => "thin_dielectric",
            Self::Coated { .. } => "coated",
            Self::Principled(_) => "principled",
            Self::Black => "black",
        }
    }
}
