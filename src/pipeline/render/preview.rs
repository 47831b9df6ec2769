//! A first image, seconds after the start, of what a long render will be.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::error::{Error, Result};
use crate::image::{LinearImage, write_png};
use crate::light::Lighting;
use crate::matrix::MatrixShape;
use crate::resources::Progress;
use crate::scene::{LoadedScene, Scene};
use crate::trace::{TraceSettings, Tracer};

/// Most pixels of a preview: enough to tell what is lit and from where.
const MAX_PIXELS: u64 = 256 * 192;

/// Samples per pixel of the first image.
const FIRST_SAMPLES: u32 = 4;

/// Most samples per pixel, where the scene does not ask for fewer.
const MAX_SAMPLES: u32 = 256;

/// Time for the second, better image, which is left out where it would take longer.
const PATIENCE_SECS: f64 = 3.0;

/// Result of a preview.
#[derive(Clone, Debug)]
pub struct PreviewReport {
    /// The image: PNG, exposed like those of `ltm demo`.
    pub path: PathBuf,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Paths per pixel.
    pub samples_per_pixel: u32,
    /// Wall-clock seconds until the first image was written.
    pub first_secs: f64,
    /// Wall-clock seconds altogether.
    pub seconds: f64,
}

/// Writes a small, noisy image of a scene under its own lighting (all lights at 1 if it has none) to `path`: first with
/// four samples per pixel, then with as many as a few seconds allow.
///
/// # Errors
/// Those of the tracer, and of writing the image; [`Error::Interrupted`] when the watch says so.
pub fn preview(loaded: &LoadedScene, path: &Path, watch: &dyn Progress) -> Result<PreviewReport> {
    let begun = Instant::now();
    let scene = reduced(&loaded.scene);
    let (width, height) = (scene.camera.width, scene.camera.height);
    let columns = u32::try_from(scene.basis.column_count()).unwrap_or(u32::MAX);
    let shape = MatrixShape::new(width, height, columns, 1)?;
    let lighting = match loaded.lighting.weights().iter().all(|weight| *weight == [0.0; 3]) {
        true => Lighting::uniform(columns as usize, [1.0; 3])?,
        false => loaded.lighting.clone(),
    };
    let settings = |samples_per_pixel| TraceSettings {
        samples_per_pixel,
        seed: loaded.settings.seed,
        max_depth: loaded.settings.max_depth,
    };
    let tracer = Tracer::new(scene, shape, settings(FIRST_SAMPLES))?;
    let traced = Instant::now();
    let image = |tracer: &Tracer| -> Result<LinearImage> {
        let pixels = tracer.trace_image(lighting.weights(), || watch.interrupted());
        let pixels = pixels.ok_or_else(|| Error::interrupted("no preview was written"))?;
        Ok(LinearImage { width, height, pixels })
    };
    write_png(path, &image(&tracer)?, 0.9)?;
    let (first_secs, pass_secs) = (begun.elapsed().as_secs_f64(), traced.elapsed().as_secs_f64());
    let affordable = f64::from(FIRST_SAMPLES) * PATIENCE_SECS / pass_secs.max(1e-6);
    let most = MAX_SAMPLES.min(loaded.settings.samples_per_pixel.max(1));
    let samples = 1 << (affordable.clamp(1.0, f64::from(most)) as u32).ilog2();
    let mut samples_per_pixel = FIRST_SAMPLES;
    if samples > FIRST_SAMPLES && !watch.interrupted() {
        write_png(path, &image(&tracer.with_settings(settings(samples))?)?, 0.9)?;
        samples_per_pixel = samples;
    }
    let seconds = begun.elapsed().as_secs_f64();
    Ok(PreviewReport { path: path.to_owned(), width, height, samples_per_pixel, first_secs, seconds })
}

/// The scene seen by a camera of fewer pixels and the same shape.
fn reduced(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let camera = &mut scene.camera;
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    if pixels > MAX_PIXELS {
        let factor = (MAX_PIXELS as f64 / pixels as f64).sqrt();
        let scaled = |side: u32| ((f64::from(side) * factor) as u32).max(1);
        (camera.width, camera.height) = (scaled(camera.width), scaled(camera.height));
    }
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resources::NoProgress;
    use crate::scene::BuiltIn;

    #[test]
    fn a_preview_is_small_lit_and_of_the_same_shape() {
        let loaded = BuiltIn { width: 1600, height: 1200, texels: 4 }.named("diffuse").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let report = preview(&loaded, &path, &NoProgress).unwrap();
        assert_eq!((report.width, report.height), (256, 192));
        let image = image::open(&path).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (256, 192));
        // The room fills the view; exposed so that a twentieth of it is at 0.9 or above.
        let lit = image.pixels().filter(|p| p.0.iter().any(|&v| v > 32)).count();
        assert!(lit > 256 * 192 / 2, "{lit}");
    }

    struct Stopped;

    impl Progress for Stopped {
        fn begin(&self, _: &str, _: u64, _: &str) {}
        fn advance(&self, _: u64, _: u64, _: &str) {}
        fn end(&self) {}
        fn note(&self, _: &str) {}
        fn interrupted(&self) -> bool {
            true
        }
    }

    #[test]
    fn a_preview_can_be_stopped() {
        let loaded = BuiltIn { width: 64, height: 48, texels: 4 }.named("diffuse").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        assert!(matches!(preview(&loaded, &path, &Stopped), Err(Error::Interrupted { .. })));
        assert!(!path.exists());
    }
}
