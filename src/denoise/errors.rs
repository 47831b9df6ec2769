//! What cleaning does to images, estimated from the two halves of their samples: the noise that goes, that which stays, and the
//! bias that comes.

use super::image_rows::{ImageRows, Region};

/// Planes that [`add_squares`] fills.
pub(super) const PLANES: usize = 4;

/// Sums over pixels, channels and clusters of squares, from which [`CleaningErrors`](crate::light::CleaningErrors) follow.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ErrorSums {
    /// Of the cleaned images.
    pub light: f64,
    /// The noise of the images before.
    pub noise_before: f64,
    /// The noise of the cleaned images.
    pub noise_after: f64,
    /// What was changed.
    pub changed: f64,
    /// The noise of what was changed.
    pub noise_of_change: f64,
}

impl ErrorSums {
    /// Adds a part of the image.
    pub fn add(&mut self, part: &Self) {
        self.light += part.light;
        self.noise_before += part.noise_before;
        self.noise_after += part.noise_after;
        self.changed += part.changed;
        self.noise_of_change += part.noise_of_change;
    }

    /// Of a region of images and of the squares that [`add_squares`] has summed for them.
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

/// Adds to the planes of `squares`, pixel by pixel over all images, what [`ErrorSums`] are made of: with `r` what was there and
/// `s` what it became, of each two halves. The noise of a mean of two halves is half their difference, squared. Light that falls
/// straight from emitters and other light are taken as independent.
pub(super) fn add_squares(
    raw: &ImageRows,
    cleaned: &ImageRows,
    scale: impl Fn(usize, usize) -> Vec<f32> + Sync,
    region: &Region,
    squares: &mut ImageRows,
) {
    let planes = raw.planes() / 2;
    let width = raw.width();
    squares.fill_whole_rows(&region.y, |y, sums| {
        for plane in 0..planes {
            let [raw_a, raw_b, a, b] =
                [raw.row(plane, y), raw.row(planes + plane, y), cleaned.row(plane, y), cleaned.row(planes + plane, y)]
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
