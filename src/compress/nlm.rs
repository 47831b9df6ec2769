//! Non-local means over the pixels of a block: pixels that are lit alike share their samples.
//!
//! At few samples most of a component is the noise of its pixels. Before the range is computed, pixels whose rows agree
//! under every probe lighting, relative to the noise, are averaged. This is non-local means (Buades, Coll, Morel 2005)
//! with rows of the matrix instead of patches, so that an edge under any lighting stays one. The window size is chosen
//! for each component and pixel: the one with the least estimated risk ‖W u − u‖² + 2 Σ σᵢ² Wᵢᵢ (Stein 1981; Mallows'
//! C_p for a linear smoother). The noise `σᵢ` of a component is known from the two half-sample estimates, so that at
//! many samples nothing is averaged.
//!
//! Noise that is left gives a block a tone of its own, and seams between blocks remain: decision 27.

use faer::{ColRef, Mat, MatRef};

use crate::matrix::CHANNELS;
use crate::simd::dispatch;

/// Radius of the largest window in pixels. Risks are summed over a window of the same size.
const RADIUS: usize = 3;

/// Pixels of that window, the centre included.
pub(super) const WINDOW_PIXELS: u64 = (2 * RADIUS as u64 + 1).pow(2);

/// The weights between pixels of a block that are lit alike.
pub(super) struct SimilarPixels {
    width: usize,
    height: usize,
    /// For each growing window its offsets across and down, the centre first, with the weight of every pixel's
    /// neighbour there.
    rings: Vec<Vec<(isize, isize, Vec<f32>)>>,
    /// For each window and pixel one over the sum of its weights. This is the weight of the pixel itself, and the share
    /// of independent noise that is left.
    own: Vec<Vec<f32>>,
    left: Vec<Vec<f32>>,
}

/// A smoothed component.
pub(super) struct Smoothed {
    /// One value for each row.
    pub(super) image: Vec<f32>,
    /// Squared norm of the noise that is left in it.
    pub(super) noise: f64,
}

impl SimilarPixels {
    /// Compares the pixels of a block of `width` × `height` by its images under the probes and by their noise, both
    /// rows × probes.
    pub(super) fn new(seen: MatRef<'_, f32>, noise: MatRef<'_, f32>, (width, height): (usize, usize)) -> Self {
        let pixels = width * height;
        let mut noise_of = vec![0.0f32; pixels];
        let mut planes = Vec::with_capacity(CHANNELS * seen.ncols());
        for probe in 0..seen.ncols() {
            for channel in 0..CHANNELS {
                let plane: Vec<f32> = (0..pixels).map(|i| seen[(channel * pixels + i, probe)]).collect();
                planes.push(plane);
                noise_of.iter_mut().enumerate().for_each(|(i, n)| *n += noise[(channel * pixels + i, probe)].powi(2));
            }
        }
        let mut rings: Vec<Vec<(isize, isize, Vec<f32>)>> = vec![Vec::new(); RADIUS + 1];
        let reach = RADIUS as isize;
        for (across, down) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))) {
            let mut weights = vec![0.0f32; pixels];
            dispatch(
                #[inline(always)]
                || {
                    for (at, from, count) in overlap((width, height), (across, down)) {
                        let weights = &mut weights[at..at + count];
                        for plane in &planes {
                            let pairs = plane[at..at + count].iter().zip(&plane[from..from + count]);
                            weights.iter_mut().zip(pairs).for_each(|(sum, (a, b))| *sum += (a - b) * (a - b));
                        }
                        let noises = noise_of[at..at + count].iter().zip(&noise_of[from..from + count]);
                        weights.iter_mut().zip(noises).for_each(|(weight, (a, b))| *weight = likeness(*weight, a + b));
                    }
                },
            );
            if (across, down) == (0, 0) {
                weights.fill(1.0);
            }
            rings[across.unsigned_abs().max(down.unsigned_abs())].push((across, down, weights));
        }
        let mut alike = Self { width, height, rings, own: Vec::new(), left: Vec::new() };
        let (mut sums, mut squares) = (vec![0.0f32; pixels], vec![0.0f32; pixels]);
        for ring in &alike.rings {
            for weights in ring.iter().map(|offset| &offset.2) {
                sums.iter_mut().zip(weights).for_each(|(sum, w)| *sum += w);
                squares.iter_mut().zip(weights).for_each(|(sum, w)| *sum += w * w);
            }
            alike.own.push(sums.iter().map(|sum| 1.0 / sum).collect());
            alike.left.push(sums.iter().zip(&squares).map(|(sum, square)| square / (sum * sum)).collect());
        }
        alike
    }

    /// Averages the pixels of `image`, one value for each row. `variance` is that of its noise.
    pub(super) fn smooth(&self, image: ColRef<'_, f32>, variance: &[f64]) -> Smoothed {
        let pixels = self.width * self.height;
        let image: Vec<f32> = image.iter().copied().collect();
        let noise_of: Vec<f64> = (0..pixels).map(|i| (0..CHANNELS).map(|c| variance[c * pixels + i]).sum()).collect();
        let mut sums = vec![0.0f32; image.len()];
        let mut best: Vec<(f64, usize)> = vec![(f64::INFINITY, 0); pixels];
        let mut candidates = Vec::with_capacity(self.rings.len());
        for (window, ring) in self.rings.iter().enumerate() {
            dispatch(
                #[inline(always)]
                || {
                    for (across, down, weights) in ring {
                        for (plane, sums) in image.chunks_exact(pixels).zip(sums.chunks_exact_mut(pixels)) {
                            for (at, from, count) in overlap((self.width, self.height), (*across, *down)) {
                                let sums = sums[at..at + count].iter_mut().zip(&weights[at..at + count]);
                                sums.zip(&plane[from..from + count]).for_each(|((sum, w), v)| *sum += w * v);
                            }
                        }
                    }
                },
            );
            let own = &self.own[window];
            let smooth: Vec<f32> =
                sums.chunks_exact(pixels).flat_map(|s| s.iter().zip(own).map(|(s, o)| s * o)).collect();
            let mut risk: Vec<f64> = noise_of.iter().zip(own).map(|(v, &o)| 2.0 * v * f64::from(o)).collect();
            for (s, u) in smooth.chunks_exact(pixels).zip(image.chunks_exact(pixels)) {
                risk.iter_mut().zip(s.iter().zip(u)).for_each(|(r, (s, u))| *r += f64::from(s - u).powi(2));
            }
            for (best, risk) in best.iter_mut().zip(self.around(&risk)) {
                if risk < best.0 {
                    *best = (risk, window);
                }
            }
            candidates.push(smooth);
        }
        let chosen = |row: usize| candidates[best[row % pixels].1][row];
        Smoothed {
            image: (0..image.len()).map(chosen).collect(),
            noise: (0..pixels).map(|i| noise_of[i] * f64::from(self.left[best[i].1][i])).sum(),
        }
    }

    /// Sums over a window around each pixel.
    fn around(&self, values: &[f64]) -> Vec<f64> {
        let (size, reach) = ((self.width, self.height), RADIUS as isize);
        let add = |sums: &mut [f64], values: &[f64], offset: (isize, isize)| {
            for (at, from, count) in overlap(size, offset) {
                sums[at..at + count].iter_mut().zip(&values[from..from + count]).for_each(|(sum, v)| *sum += v);
            }
        };
        let (mut rows, mut sums) = (vec![0.0; values.len()], vec![0.0; values.len()]);
        (-reach..=reach).for_each(|across| add(&mut rows, values, (across, 0)));
        (-reach..=reach).for_each(|down| add(&mut sums, &rows, (0, down)));
        sums
    }
}

/// The weight of a neighbour, from the squared difference of the rows over the noise `v + v` of both.
///
/// Its mean is `1 + s² / 2v` if the rows themselves differ by `s`. The mean of the two values has the error `s² / 4 + v
/// / 2`, and is better than either value while that ratio is below 2. From 2 to 3 the weight falls to 0.
fn likeness(difference: f32, noise: f32) -> f32 {
    if difference <= 2.0 * noise { 1.0 } else { (3.0 - difference / noise).max(0.0) }
}

/// The overlap of an image with itself moved by an offset: first pixel, its neighbour, and their number, row by row.
#[inline(always)]
fn overlap(
    (width, height): (usize, usize),
    (across, down): (isize, isize),
) -> impl Iterator<Item = (usize, usize, usize)> {
    let span = |by: isize, end: usize| (-by).max(0) as usize..(end as isize - by.max(0)).max(0) as usize;
    let (columns, rows) = (span(across, width), span(down, height));
    rows.filter(move |_| !columns.is_empty()).map(move |y| {
        let at = y * width + (-across).max(0) as usize;
        let from = (at as isize + down * width as isize + across) as usize;
        (at, from, width.saturating_sub(across.unsigned_abs()))
    })
}

impl Smoothed {
    pub(super) fn squared_norm(&self) -> f64 {
        self.image.iter().map(|&v| f64::from(v).powi(2)).sum()
    }
}

/// The smoothed images as scaled columns of a matrix.
pub(super) fn joined(images: &[(&Smoothed, f64)]) -> Mat<f32> {
    let rows = images.first().map_or(0, |(first, _)| first.image.len());
    Mat::from_fn(rows, images.len(), |i, k| images[k].0.image[i] * images[k].1 as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    const SIDE: usize = 16;
    const ROWS: usize = CHANNELS * SIDE * SIDE;

    /// Left half dark, right half bright, under eight probes of different strengths. The noise is uniform, of variance
    /// `noise²`.
    fn noisy(noise: f64) -> (Mat<f32>, Mat<f32>, Mat<f32>) {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut draw = || (random.random::<f64>() - 0.5) * 12f64.sqrt() * noise;
        let truth = Mat::from_fn(ROWS, 8, |i, k| if i % SIDE < SIDE / 2 { 1.0 } else { 2.0 + k as f32 });
        let seen = Mat::from_fn(ROWS, 8, |i, k| truth[(i, k)] + draw() as f32);
        (truth, seen, Mat::from_fn(ROWS, 8, |_, _| draw() as f32))
    }

    fn squared_error(a: &[f32], truth: &Mat<f32>) -> f64 {
        a.iter().enumerate().map(|(i, v)| f64::from(v - truth[(i, 3)]).powi(2)).sum()
    }

    #[test]
    fn what_is_alike_is_averaged_and_an_edge_stays() {
        let (truth, seen, noise) = noisy(0.5);
        let alike = SimilarPixels::new(seen.as_ref(), noise.as_ref(), (SIDE, SIDE));
        let smoothed = alike.smooth(seen.col(3), &[0.25; ROWS]);
        let error = squared_error(&smoothed.image, &truth);
        // Windows have 49 pixels, and a third of that at the border and the edge: on average 1/30 of the noise is left.
        // The estimate may miss the few neighbours that are not quite alike.
        let raw = 0.25 * ROWS as f64;
        assert!(error < raw / 15.0, "{error} of {raw}");
        assert!((0.5..2.0).contains(&(smoothed.noise / error)), "{} of {error}", smoothed.noise);
    }

    #[test]
    fn without_noise_nothing_is_changed() {
        let (_, seen, _) = noisy(0.5);
        let alike = SimilarPixels::new(seen.as_ref(), Mat::zeros(ROWS, 8).as_ref(), (SIDE, SIDE));
        let smoothed = alike.smooth(seen.col(3), &[0.0; ROWS]);
        assert!(smoothed.image.iter().zip(seen.col(3).iter()).all(|(a, b)| a == b));
        assert_eq!(smoothed.noise, 0.0);
    }

    #[test]
    fn a_component_of_little_noise_stays_where_the_draws_are_noisy() {
        let (truth, seen, noise) = noisy(0.5);
        let alike = SimilarPixels::new(seen.as_ref(), noise.as_ref(), (SIDE, SIDE));
        // A checkerboard that the probes do not show: averaging would remove it.
        let board = Mat::from_fn(ROWS, 1, |i, _| truth[(i, 3)] + ((i + i / SIDE) % 2) as f32);
        let smoothed = alike.smooth(board.col(0), &[1e-3; ROWS]);
        assert!(smoothed.image.iter().zip(board.col(0).iter()).all(|(a, b)| a == b));
    }
}
