//! Intel's Open Image Denoise (Áfra 2019–) as a rival: it denoises each relit image by itself.
//!
//! A Python that has the package `pyoidn`, named by `LTM_OIDN` or else the `python3` on the path, runs it with the
//! script beside this file.

use std::fs;
use std::path::Path;

use serde_json::json;

use super::python::Python;
use super::raw_image::{read_f32, write_f32};
use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::LinearImage;
use ltm::matrix::{BlockSource, Feature};
use ltm::store::StoreReader;

const SCRIPT: &str = include_str!("denoise_with_oidn.py");

/// What the denoiser is told of the surfaces: albedo, and unit normals in world space.
pub(super) struct Surfaces {
    albedo: LinearImage,
    normal: LinearImage,
}

impl Surfaces {
    /// Those of a matrix. None where its file does not tell.
    pub(super) fn of(matrix: &StoreReader) -> Result<Option<Self>> {
        let shape = matrix.shape();
        let black = LinearImage::black(shape.width(), shape.height());
        let mut surfaces = Self { albedo: black.clone(), normal: black };
        for id in shape.blocks() {
            let Some(planes) = matrix.read_planes(id, None)? else { return Ok(None) };
            let rect = shape.rect(id);
            let pixels = planes.pixels();
            for (image, feature) in [(&mut surfaces.albedo, Feature::Albedo), (&mut surfaces.normal, Feature::Normal)] {
                let values = planes.feature(feature);
                for pixel in 0..pixels {
                    let (x, y) = (rect.x + pixel as u32 % rect.width, rect.y + pixel as u32 / rect.width);
                    let at = (y * shape.width() + x) as usize;
                    image.pixels[at] = [0, 1, 2].map(|channel| values[channel * pixels + pixel]);
                }
            }
        }
        Ok(Some(surfaces))
    }
}

/// What runs it.
pub(super) const OIDN: Python = Python { package: "pyoidn", variable: "LTM_OIDN" };

/// Cleans each image; `folder` takes what is exchanged.
///
/// Errors: files that cannot be written; a script that fails, with its last line.
pub(super) fn denoise(images: &[LinearImage], surfaces: &Surfaces, folder: &Path) -> Result<Vec<LinearImage>> {
    Ok(denoise_timed(images, surfaces, folder)?.images)
}

/// What a denoiser made.
pub(super) struct TimedImages {
    pub(super) images: Vec<LinearImage>,
    /// Seconds that one image took, without Python and files; of several, without the first.
    pub(super) secs: f64,
    /// Likewise, of CPU time.
    pub(super) cpu_secs: f64,
}

/// [`denoise`], and the time that it took.
pub(super) fn denoise_timed(images: &[LinearImage], surfaces: &Surfaces, folder: &Path) -> Result<TimedImages> {
    fs::create_dir_all(folder).map_err(Error::io(folder, "create the folder"))?;
    let (width, height) = (surfaces.albedo.width, surfaces.albedo.height);
    let described = json!({ "width": width, "height": height, "images": images.len() });
    write_file(&folder.join("description.json"), true, described.to_string().as_bytes())?;
    let write = |name: &str, image: &LinearImage| write_f32(&folder.join(format!("{name}.f32")), image);
    write("albedo", &surfaces.albedo)?;
    write("normal", &surfaces.normal)?;
    for (which, image) in images.iter().enumerate() {
        write(&format!("color-{which}"), image)?;
    }
    let printed = OIDN.run(SCRIPT, folder, &[])?;
    let mut numbers = printed.lines().last().unwrap_or_default().split_whitespace().map(str::parse);
    let mut seconds = || numbers.next().and_then(std::result::Result::ok).unwrap_or(f64::NAN);
    let (secs, cpu_secs) = (seconds(), seconds());
    let read = |which: usize| read_f32(&folder.join(format!("clean-{which}.f32")), width, height);
    Ok(TimedImages { images: (0..images.len()).map(read).collect::<Result<_>>()?, secs, cpu_secs })
}
