//! Real errors of denoised images of each light alone, to hold stated ones against.

use ltm::error::Result;
use ltm::image::LinearImage;
use ltm::light::LightBasis;
use ltm::matrix::{BlockSource, TracedBlock};
use ltm::store::StoreReader;

/// For each light the pixels of a reference that show it, where images hold more than what was denoised.
pub(super) struct SeenEmitters(Vec<Vec<bool>>);

impl SeenEmitters {
    pub(super) fn of(reference: &StoreReader) -> Result<Self> {
        let (shape, basis) = (reference.shape(), &reference.job().basis);
        let mut seen = vec![vec![false; shape.width() as usize * shape.height() as usize]; basis.lights().len()];
        let of_column = light_of_columns(basis);
        let mut traced = TracedBlock::default();
        for id in shape.blocks() {
            reference.read_block(id, &mut traced)?;
            let rect = shape.rect(id);
            for emission in traced.planes.iter().flat_map(|planes| &planes.emission) {
                let (x, y) = (emission.pixel % rect.width + rect.x, emission.pixel / rect.width + rect.y);
                seen[of_column[emission.column as usize]][(y * shape.width() + x) as usize] = true;
            }
        }
        Ok(Self(seen))
    }
}

fn light_of_columns(basis: &LightBasis) -> Vec<usize> {
    let lights = basis.lights().iter().enumerate();
    lights.flat_map(|(index, light)| light.columns().map(move |_| index)).collect()
}

/// Images of one light alone.
pub(super) struct Alone<'a> {
    /// Its place in the basis.
    pub(super) light: usize,
    pub(super) ours: &'a LinearImage,
    pub(super) raw: &'a LinearImage,
    pub(super) reference: &'a LinearImage,
    /// Samples per pixel of `raw` and `reference`.
    pub(super) samples: [f64; 2],
}

/// How far the image of a light is off.
pub(super) struct Compared {
    /// Relative L2 from the reference, without the noise that the reference has itself.
    pub(super) error: f64,
    /// The sum of our image over that of the reference.
    pub(super) light: f64,
}

impl Alone<'_> {
    /// Compares, over all pixels that do not show the light itself.
    pub(super) fn compare(&self, seen: &SeenEmitters) -> Compared {
        let seen = &seen.0[self.light];
        let sum = |of: &dyn Fn(usize) -> f64| -> f64 {
            (0..self.reference.values().len()).filter(|at| !seen[at / 3]).map(of).sum()
        };
        let value = |image: &LinearImage, at: usize| f64::from(image.values()[at]);
        let from = |image: &LinearImage| sum(&|at| (value(image, at) - value(self.reference, at)).powi(2));
        let [own, converged] = self.samples;
        let of_reference = from(self.raw) * own / (own + converged);
        let norm = sum(&|at| value(self.reference, at).powi(2));
        let light = |image: &LinearImage| sum(&|at| value(image, at));
        Compared {
            error: ((from(self.ours) - of_reference).max(0.0) / norm).sqrt(),
            light: light(self.ours) / light(self.reference),
        }
    }
}
