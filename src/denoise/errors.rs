//! Error estimates of denoising from the two halves of the samples: noise removed, noise left, and bias added.

use super::image_rows::{ImageRows, Region};

/// Number of planes that [`add_squares`] fills.
pub(super) const PLANES: usize = 4;

/// Sums over pixels, channels and clusters of squares, from which [`DenoiseErrors`](crate::light::DenoiseErrors) follow.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ErrorSums {
    /// Squared light of the denoised images.
    pub light: f64,
    /// Squared noise of the input images.
    pub noise_before: f64,
    /// Squared noise of the denoised images.
    pub noise_after: f64,
    /// Squared difference between denoised and input images.
    pub changed: f64,
    /// Squared noise of that difference.
    pub noise_of_change: f64,
}

impl ErrorSums {
    /// Adds the sums of another part of the image.
    pub fn add(&mut self, part: &Self) {
        self.light += part.light;
        self.noise_before += part.noise_before;
        self.noise_after += part.noise_after;
        self.changed += part.changed;
        self.noise_of_change += part.noise_of_change;
    }

    /// The sums over a region of the denoised images and of the squares from [`add_squares`].
    pub(super) fn of(images: &ImageRows, squares: &ImageRows, region: &Region) -> Self {
        let sum = |rows: &ImageRows, plane: usize, of: fn(f64) -> f64| -> f64 {
            region.y.clone().flat_map(|y| &rows.row(plane, y)[region.x.clone()]).map(|&v| of(f64::from(v))).sum()
        };
        let [noise_before, noise_after, changed, noise_of_change] =
            [0, 1, 2, 3].map(|plane| sum(squares, plane, |v| v));
        let light = (0..images.planes()).map(|plane| sum(images, plane, |v| v * v)).sum();
        Self { light, noise_before, noise_after, changed, noise_of_change }
    }
}

/// Adds the terms of [`ErrorSums`] of each pixel, summed over all images, to the planes of `squares`. `r` is the input
/// and `s` the denoised image, each in two halves. The squared noise of a mean of two halves is the square of half
/// their difference. Direct and indirect light are taken as independent.
pub(super) fn add_squares(
    raw: &ImageRows,
    denoised: &ImageRows,
    scale: impl Fn(usize, usize) -> Vec<f32> + Sync,
    region: &Region,
    squares: &mut ImageRows,
) {
    let planes = raw.planes() / 2;
    let width = raw.width();
    squares.fill_whole_rows(&region.y, |y, sums| {
        for plane in 0..planes {
            let [raw_a, raw_b, a, b] = [
                raw.row(plane, y),
                raw.row(planes + plane, y),
                denoised.row(plane, y),
                denoised.row(planes + plane, y),
            ]
            .map(|row| &row[region.x.clone()]);
            let scale = &scale(plane, y)[region.x.clone()];
            for (square, sums) in sums.chunks_exact_mut(width).enumerate() {
                for (x, sum) in sums[region.x.clone()].iter_mut().enumerate() {
                    let (was, is) = (raw_a[x] - raw_b[x], a[x] - b[x]);
                    let term = match square {
                        0 => was,
                        1 => is,
                        2 => raw_a[x] + raw_b[x] - a[x] - b[x],
                        _ => was - is,
                    };
                    let term = 0.5 * scale[x] * term;
                    *sum += term * term;
                }
            }
        }
    });
}
