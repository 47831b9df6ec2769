//! Making files, silently: [`pipeline`] has the same with progress, and more.

use std::path::Path;

use crate::error::Result;
use crate::light::DescribedSource;
use crate::pipeline::{self, PackOptions, PackReport};
use crate::resources::NoProgress;
#[cfg(feature = "scene")]
use crate::scene::{LoadOptions, LoadedScene};

/// Compresses a matrix into a container (`.ltc`) at `path`: one in memory ([`MemoryMatrix`](crate::MemoryMatrix)), or a stored one
/// ([`StoreReader`](crate::store::StoreReader)). Continues where an interrupted run over the same matrix stopped.
///
/// ```
/// use ltm::{LinearImage, MemoryMatrix, PackOptions};
///
/// let image = |light: f32| LinearImage { width: 8, height: 8, pixels: vec![[light; 3]; 64] };
/// let matrix = MemoryMatrix::from_images([("desk", image(0.5)), ("ceiling", image(0.25))])?;
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("room.ltc");
/// let report = ltm::pack(&matrix, &path, &PackOptions::default())?;
/// assert!(report.relative_l2 < 0.01);
/// # Ok::<(), ltm::Error>(())
/// ```
///
/// # Errors
/// Those of [`pipeline::pack`].
pub fn pack(matrix: &dyn DescribedSource, path: impl AsRef<Path>, options: &PackOptions) -> Result<PackReport> {
    pipeline::pack(matrix, matrix.job(), path.as_ref(), options, &NoProgress)
}

/// Reads a scene file (`.toml`, `.gltf`, `.glb`) and everything that it names.
///
/// # Errors
/// Those of [`scene::load_with`](crate::scene::load_with).
#[cfg(feature = "scene")]
pub fn load_scene(path: impl AsRef<Path>) -> Result<LoadedScene> {
    pipeline::load_scene(path.as_ref(), LoadOptions::default())
}

/// Renders a scene straight into a container (`.ltc`) at `path`. Continues where an interrupted run stopped.
///
/// ```
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("room.ltc");
/// // Or `ltm::load_scene("room.toml")?`.
/// let mut scene = ltm::scene::BuiltIn { width: 16, height: 12, texels: 2 }.named("diffuse")?;
/// scene.settings.samples_per_pixel = 4;
/// ltm::render(scene, &path, &ltm::PackOptions { denoise: true, ..Default::default() })?;
/// let matrix = ltm::open(&path)?;
/// assert_eq!((matrix.shape().width(), matrix.shape().height()), (16, 12));
/// # Ok::<(), ltm::Error>(())
/// ```
///
/// # Errors
/// Those of [`pipeline::render_packed`].
#[cfg(feature = "scene")]
pub fn render(scene: LoadedScene, path: impl AsRef<Path>, options: &PackOptions) -> Result<PackReport> {
    pipeline::render_packed(scene, path.as_ref(), options, &NoProgress).map(|(_, packed)| packed)
}
