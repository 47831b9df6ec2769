//! A matrix from images that other programs rendered, one for each light.

use std::path::Path;

use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::image::{LightImage, LightImages, LinearImage, read_light_array, read_light_files, read_light_layers};
use crate::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance};
use crate::matrix::{BlockId, BlockSource, MatrixShape, TracedBlock};

/// Name of the light that holds what the image under all lights has beyond the sum of the lights.
const REST: &str = "Rest";
/// Relative L2 difference between the sum of lights and the image under all lights that 16-bit files show.
const SUM_TOLERANCE: f64 = 2e-3;

/// Images of lights as a matrix: each light is a column. All images are held in memory.
#[derive(Clone, Debug)]
pub struct ImportedMatrix {
    job: Job,
    images: Vec<LinearImage>,
    /// What looks wrong or was added, one line each, for people.
    pub warnings: Vec<String>,
    /// Relative L2 difference between the sum of lights and the image under all lights, where there is one.
    pub sum_difference: Option<f64>,
}

/// Reads images of lights: a file name with `{light}` (a file for each light), an NPY or NPZ file, or an OpenEXR file with
/// light groups, whose layers `layers` may name with `{light}`. Errors: those of the readers in `image`.
pub fn read_lights(path: &Path, layers: Option<&str>) -> Result<LightImages> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        _ if path.to_string_lossy().contains("{light}") => read_light_files(path),
        Some("npy" | "npz") => read_light_array(path),
        _ => read_light_layers(path, layers),
    }
}

impl ImportedMatrix {
    /// Makes a matrix of images, in blocks of `block_side` pixels. `source` is their name, for the provenance.
    ///
    /// The sum of lights is held against the image under all lights, where there is one; what is missing becomes a light of
    /// its own, called `Rest`.
    ///
    /// Errors: values that are not finite, naming the light; sizes beyond what a matrix can have.
    pub fn new(found: LightImages, source: &str, block_side: u32) -> Result<Self> {
        let LightImages { mut lights, sum, matches } = found;
        let mut warnings = warnings(&lights);
        if matches.iter().any(|m| m.layer.to_lowercase().contains("denois")) {
            warnings.push("the file has denoising passes: denoised light groups no longer add up".into());
        }
        let mut sum_difference = None;
        if let Some(sum) = sum {
            let rest = rest(&lights, &sum);
            let norm = |image: &LinearImage| image.values().iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
            let difference = (norm(&rest) / norm(&sum).max(f64::MIN_POSITIVE)).sqrt();
            sum_difference = Some(difference);
            if difference > SUM_TOLERANCE && !lights.iter().any(|light| light.name == REST) {
                let share = 100.0 * difference;
                warnings.push(format!(
                    "the lights lack {share:.2} % of the image under all lights; added as light '{REST}'"
                ));
                lights.push(LightImage { name: REST.into(), image: rest });
            }
        }
        let mut basis = LightBasis::new();
        let mut content = Sha256::new();
        for light in &lights {
            if let Some(at) = light.image.values().iter().position(|v| !v.is_finite()) {
                let (x, y) = (at / 3 % light.image.width as usize, at / 3 / light.image.width as usize);
                let problem = format!("the image of light '{}' is not finite at pixel {x}, {y}", light.name);
                return Err(Error::input(source, problem, "render it again, or replace the pixel"));
            }
            light.image.values().iter().for_each(|v| content.update(v.to_le_bytes()));
            basis.push(Light {
                name: light.name.clone(),
                kind: LightKind::Image,
                unit: LightUnit::Multiple,
                emission: [1.0; 3],
                first_column: 0,
                places: vec![[0.0; 3]],
                extents: vec![0.0],
            })?;
        }
        let Some(first) = lights.first() else {
            return Err(Error::input(source, "there are no lights", "give at least one image"));
        };
        let shape = MatrixShape::new(first.image.width, first.image.height, lights.len() as u32, block_side)?;
        let provenance = Provenance {
            source: source.to_owned(),
            content: content.finalize().into(),
            program: format!("ltm {}, imported images", env!("CARGO_PKG_VERSION")),
            ..Provenance::default()
        };
        let images = lights.into_iter().map(|light| light.image).collect();
        Ok(Self { job: Job { shape, basis, provenance }, images, warnings, sum_difference })
    }

    /// What the matrix is.
    pub fn job(&self) -> &Job {
        &self.job
    }
}

impl BlockSource for ImportedMatrix {
    fn shape(&self) -> MatrixShape {
        self.job.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let rect = self.job.shape.rect(id);
        let pixels = rect.pixels();
        target.block.reset(rect.rows(), self.images.len());
        target.noise = None;
        for (image, column) in self.images.iter().zip(target.block.entries_mut().chunks_exact_mut(rect.rows())) {
            for y in 0..rect.height as usize {
                let start = (rect.y as usize + y) * image.width as usize + rect.x as usize;
                for (x, pixel) in image.pixels[start..start + rect.width as usize].iter().enumerate() {
                    let place = y * rect.width as usize + x;
                    (0..3).for_each(|c| column[c * pixels + place] = pixel[c]);
                }
            }
        }
        Ok(())
    }
}

/// The image under all lights without the lights.
fn rest(lights: &[LightImage], sum: &LinearImage) -> LinearImage {
    let mut rest = sum.clone();
    for light in lights {
        for (rest, pixel) in rest.pixels.iter_mut().zip(&light.image.pixels) {
            (0..3).for_each(|c| rest[c] -= pixel[c]);
        }
    }
    rest
}

/// What looks wrong with images: many pixels at exactly the largest value, values below zero.
fn warnings(lights: &[LightImage]) -> Vec<String> {
    let mut warnings = Vec::new();
    for light in lights {
        let values = light.image.values();
        let most = values.iter().copied().fold(0.0f32, f32::max);
        let clamped = values.iter().filter(|&&v| v == most).count();
        if most > 0.0 && clamped > values.len() / 500 + 3 {
            warnings.push(format!(
                "light '{}' looks clamped: {clamped} values are exactly {most}; render without clamping",
                light.name
            ));
        }
        let negative = values.iter().filter(|&&v| v < 0.0).count();
        if negative > 0 {
            warnings.push(format!("light '{}' has {negative} values below zero, as denoising leaves them", light.name));
        }
    }
    warnings
}
