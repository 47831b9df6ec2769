//! The noise model of a block: how much of it is noise of its samples.
//!
//! A component `u`, `R = uᵀ A`, is affected by the noise `N` of `A` twice. Its right factor is `uᵀ (S + N)`. That
//! noise, projected on `u`, is small, since `u` is one direction of very many. Its left factor is made from the block
//! itself: `u = A w` with the lighting `w = K Rᵀ / g`, where `A K Aᵀ u = g u`. So of its gain `g` the part `‖N w‖² g`
//! is no signal: the range finder fits noise. A component improves the image only if its signal is above this noise.

use faer::{Mat, MatRef};

use super::dense::{product, product_f64, solve_least_squares, subtract_product, to_f32, to_f64};
use super::range::PriorWeights;
use crate::matrix::{BlockNoise, SparseEntry};

/// Outliers are noise unless the sum of their squares over a row exceeds this many times the row's noise. The ratio is
/// 1 for a path that one of the two half-sample estimates lacks. For a light that many samples see, it is half the
/// number of samples.
const SEEN_OVER_NOISE: f64 = 1.3;
/// The same for a pixel and its eight neighbours. With few samples, some meet in a texel by chance, but not in all
/// pixels around.
const SEEN_AROUND_OVER_NOISE: f64 = 2.0;
/// With few samples, the two half-sample estimates may hit different texels of one light and seem uncorrelated. Then
/// the pixel is tested under the probe lightings: its entries are kept if their energy exceeds this many times that of
/// the noise.
const SHOWN_OVER_NOISE: f64 = 2.0;
/// The same for a pixel and its neighbours, since a single entry agrees by chance under wide lightings. Tuned: decision
/// 33.
const SHOWN_AROUND_OVER_NOISE: f64 = 12.0;

/// `‖N w‖²` for any lighting `w`, from the noise of single columns and, by the probes, the noise that they share.
pub(super) struct NoiseModel<'a> {
    noise: &'a BlockNoise,
    probes: &'a [f32],
    /// Squared norm of the noise of each row and of each column.
    rows: Vec<f64>,
    columns: Vec<f64>,
    /// Weight of `(Σ wⱼ σⱼ)²`, the noise shared by all columns; negative where columns compete for samples.
    shared: f64,
}

impl<'a> NoiseModel<'a> {
    /// The model of a block of (rows, columns) under `probes` (columns × probes, column-major, the first all-on).
    /// `None` if the noise is of another block.
    pub(super) fn new(
        noise: &'a BlockNoise,
        probes: &'a [f32],
        (row_count, column_count): (usize, usize),
    ) -> Option<Self> {
        let fits = noise.row_variance.len() == row_count
            && noise.column_variance.len() == column_count
            && noise.probes.len() == row_count * (probes.len() / column_count)
            && noise.probes.len() > row_count;
        let norms = |variances: &[f32], of: usize| variances.iter().map(|&v| f64::from(v) * of as f64).collect();
        fits.then(|| Self {
            noise,
            probes,
            rows: norms(&noise.row_variance, column_count),
            columns: norms(&noise.column_variance, row_count),
            shared: 0.0,
        })
    }

    /// Classifies the outliers of a block of `size` (width, height): those that the samples agree on, and noise. Noise
    /// is taken out of the model, and the shared noise is fitted to the rest of the probes' noise. Outliers of neither
    /// class stay in the block. At few samples each stands out in its row, but together they are all the light there
    /// is.
    pub(super) fn split(
        &mut self,
        entries: Vec<SparseEntry>,
        size: (usize, usize),
    ) -> (Vec<SparseEntry>, Vec<SparseEntry>) {
        let square = |e: &SparseEntry| f64::from(e.value).powi(2);
        let mut seen = vec![0.0f64; self.rows.len()];
        entries.iter().for_each(|e| seen[e.row as usize] += square(e));
        let pixels = size.0 * size.1;
        let pairs = seen.iter().zip(&self.rows).map(|(&seen, &noise)| [seen, noise]);
        let around = around(&of_pixels(pairs, pixels), size);
        let agrees = |e: &SparseEntry| {
            let ([seen_around, noise_around], i) = (around[e.row as usize % pixels], e.row as usize);
            seen[i] > SEEN_OVER_NOISE * self.rows[i] && seen_around > SEEN_AROUND_OVER_NOISE * noise_around
        };
        // A row is a firefly only if its noise is above that of half of the rows.
        let usual = self.usual(0.5);
        let alone: Vec<SparseEntry> = entries.iter().copied().filter(|e| square(e) > usual).collect();
        let in_view = self.in_view(&alone, size);
        let (mut agreed, mut stray) = (Vec::new(), Vec::new());
        for entry in entries {
            if agrees(&entry) || (square(&entry) > usual && in_view[entry.row as usize % pixels]) {
                agreed.push(entry);
            } else if square(&entry) > usual {
                stray.push(entry);
            }
        }
        // A firefly that one of the two estimates lacks is as large in their half difference as in their mean. It is
        // stored separately, and must not count as noise of all others; part of it may be signal.
        for entry in &stray {
            for (norms, at) in [(&mut self.rows, entry.row as usize), (&mut self.columns, entry.column.index())] {
                norms[at] = (norms[at] - square(entry)).max(0.02 * norms[at]);
            }
        }
        let (mut fit, mut norm) = (0.0, 0.0);
        let probes = self.probes.chunks_exact(self.columns.len());
        for (lighting, seen) in probes.zip(self.noise.probes.chunks_exact(self.rows.len())) {
            let strays: f64 = stray.iter().map(|e| square(e) * f64::from(lighting[e.column.index()]).powi(2)).sum();
            let energy: f64 = seen.iter().map(|&v| f64::from(v).powi(2)).sum();
            let (own, sum) = self.parts(lighting);
            fit += ((energy - strays).max(0.0) - own) * sum * sum;
            norm += sum.powi(4);
        }
        if norm > 0.0 && fit.is_finite() {
            self.shared = fit / norm;
        }
        (agreed, stray)
    }

    /// For each pixel of a block of `size`: whether the samples agree on the energy of `entries` under the probes.
    fn in_view(&self, entries: &[SparseEntry], size: (usize, usize)) -> Vec<bool> {
        let (rows, pixels) = (self.rows.len(), size.0 * size.1);
        let mut own = vec![[0.0f64; 2]; pixels];
        let mut image = vec![0.0f32; rows];
        let probes = if entries.is_empty() { &[] } else { self.probes };
        for (lighting, noise) in probes.chunks_exact(self.columns.len()).zip(self.noise.probes.chunks_exact(rows)) {
            image.fill(0.0);
            entries.iter().for_each(|e| image[e.row as usize] += e.value * lighting[e.column.index()]);
            let pairs = image.iter().zip(noise).map(|(&v, &n)| [f64::from(v).powi(2), f64::from(n).powi(2)]);
            own.iter_mut().zip(of_pixels(pairs, pixels)).for_each(|(sum, of)| (0..2).for_each(|k| sum[k] += of[k]));
        }
        let agree = |(own, around): (&[f64; 2], [f64; 2])| {
            own[0] > SHOWN_OVER_NOISE * own[1] && around[0] > SHOWN_AROUND_OVER_NOISE * around[1]
        };
        own.iter().zip(around(&own, size)).map(agree).collect()
    }

    /// Energy of the noise under the prior.
    pub(super) fn energy(&self) -> f32 {
        let rows = self.rows.len();
        let probes = &self.noise.probes[rows..];
        let sum: f64 = probes.iter().map(|&v| f64::from(v).powi(2)).sum();
        (sum / (probes.len() / rows) as f64) as f32
    }

    /// `‖N w‖²` of independent columns, and `Σ wⱼ σⱼ` with `σⱼ` the norm of a column's noise.
    fn parts(&self, lighting: &[f32]) -> (f64, f64) {
        lighting.iter().zip(&self.columns).fold((0.0, 0.0), |(own, sum), (&w, &v)| {
            let w = f64::from(w);
            (own + w * w * v, sum + w * v.sqrt())
        })
    }

    /// The quantile `share` of the noise of rows.
    fn usual(&self, share: f64) -> f64 {
        let mut rows = self.rows.clone();
        let at = ((rows.len() - 1) as f64 * share) as usize;
        *rows.select_nth_unstable_by(at, f64::total_cmp).1
    }

    /// 75th percentile of the noise of rows over its mean, at most 1. It is small if few rows have nearly all of the
    /// noise, which then says nothing of the others.
    pub(super) fn quartile_ratio(&self) -> f32 {
        let mean = self.rows.iter().sum::<f64>() / self.rows.len() as f64;
        let usual = self.usual(0.75);
        if mean > 0.0 { (usual / mean).min(1.0) as f32 } else { 1.0 }
    }

    /// The noise of the block under the probes, rows × probes.
    pub(super) fn under_probes(&self) -> MatRef<'_, f32> {
        let rows = self.rows.len();
        MatRef::from_column_major_slice(&self.noise.probes, rows, self.noise.probes.len() / rows)
    }

    /// The variance of the noise of each row of the images `A w` under `lightings` (columns × images). The part of `w`
    /// that the probes span uses their noise; the rest counts as independent columns.
    pub(super) fn of_images(&self, lightings: MatRef<'_, f32>) -> Vec<Vec<f64>> {
        let (spanned, beside) = self.spanned(lightings);
        let seen = product(self.under_probes(), spanned.as_ref());
        let total: f64 = self.rows.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let variances = |k: usize| {
            let own = self.own_of(beside.as_ref(), k);
            (0..self.rows.len()).map(|i| f64::from(seen[(i, k)]).powi(2) + own * self.rows[i] / total).collect()
        };
        (0..lightings.ncols()).map(variances).collect()
    }

    /// Squared norm of the noise of each of the images `A w`, as in [`of_images`](Self::of_images), without that of
    /// `stray` entries, which are taken out of `A`.
    pub(super) fn energies_of_images(&self, lightings: MatRef<'_, f32>, stray: &[SparseEntry]) -> Vec<f64> {
        let (spanned, beside) = self.spanned(lightings);
        let seen = product(self.under_probes(), spanned.as_ref());
        let columns = self.columns.len();
        let energy = |k: usize| {
            // The same in the images of the probes as in their noise, since one of the two estimates lacks it.
            let of_stray = |entry: &SparseEntry| {
                let probes = self.probes[entry.column.index()..].iter().step_by(columns);
                let weight: f32 = probes.zip(spanned.col(k).iter()).map(|(probe, share)| probe * share).sum();
                f64::from(entry.value * weight).powi(2)
            };
            let seen = f64::from(seen.col(k).squared_norm_l2()) - stray.iter().map(of_stray).sum::<f64>();
            seen.max(0.0) + self.own_of(beside.as_ref(), k)
        };
        (0..lightings.ncols()).map(energy).collect()
    }

    /// Lightings as mixtures of the probes, and the part that these do not span.
    fn spanned(&self, lightings: MatRef<'_, f32>) -> (Mat<f32>, Mat<f32>) {
        let columns = self.columns.len();
        let probes = MatRef::from_column_major_slice(self.probes, columns, self.probes.len() / columns);
        let spanned = {
            let (probes, lightings) = (to_f64(probes), to_f64(lightings));
            let gram = product_f64(probes.transpose(), probes.as_ref());
            let right = product_f64(probes.transpose(), lightings.as_ref());
            to_f32(solve_least_squares(gram.as_ref(), right.as_ref(), 1e-6).as_ref())
        };
        let mut beside = lightings.to_owned();
        subtract_product(&mut beside, probes, spanned.as_ref());
        (spanned, beside)
    }

    /// `‖N w‖²` of independent columns, for one of several lightings.
    fn own_of(&self, lightings: MatRef<'_, f32>, which: usize) -> f64 {
        self.parts(&lightings.col(which).iter().copied().collect::<Vec<f32>>()).0
    }

    /// The part of each gain that is noise the left factor was fitted to.
    pub(super) fn fitted(&self, weights: &PriorWeights, right: &[f32], gains: &[f64]) -> Vec<f32> {
        let columns = self.columns.len();
        let right = MatRef::from_row_major_slice(right, gains.len(), columns);
        let lightings = weights.weigh(right);
        let fitted = |(k, &gain): (usize, &f64)| {
            if gain <= 0.0 {
                return 0.0;
            }
            let lighting: Vec<f32> = (0..columns).map(|j| lightings[(j, k)]).collect();
            let (own, sum) = self.parts(&lighting);
            // Columns that compete for samples make each other's sum less noisy, but never exact.
            let energy = (own + self.shared * sum * sum).max(0.05 * own) / gain;
            if energy.is_finite() { energy.min(gain) as f32 } else { 0.0 }
        };
        gains.iter().enumerate().map(fitted).collect()
    }

    /// Noise projected on each component: the mean of `(uᵀ N ω)²` over the probes.
    pub(super) fn fallen(&self, left: &[f32], rank: usize) -> Vec<f32> {
        let rows = self.rows.len();
        let probes = &self.noise.probes[rows..];
        let count = probes.len() / rows;
        let probes = MatRef::from_column_major_slice(probes, rows, count);
        let seen = product(MatRef::from_column_major_slice(left, rows, rank).transpose(), probes);
        let mean = |k: usize| seen.row(k).squared_norm_l2() / count as f32;
        (0..rank).map(mean).map(|v| if v.is_finite() { v } else { 0.0 }).collect()
    }
}

/// For each pixel the sum over channels of the signal and of its noise; zeros without signal.
fn of_pixels(of_rows: impl Iterator<Item = [f64; 2]>, pixels: usize) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0f64; 2]; pixels];
    for (i, [seen, noise]) in of_rows.enumerate().filter(|(_, [seen, _])| *seen > 0.0) {
        sums[i % pixels][0] += seen;
        sums[i % pixels][1] += noise;
    }
    sums
}

/// Sums over each pixel and its eight neighbours.
fn around(own: &[[f64; 2]], (width, height): (usize, usize)) -> Vec<[f64; 2]> {
    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let sum = |p: usize| {
        let pixels = near(p / width, height).flat_map(|y| near(p % width, width).map(move |x| y * width + x));
        pixels.fold([0.0; 2], |sum, q| [sum[0] + own[q][0], sum[1] + own[q][1]])
    };
    (0..own.len()).map(sum).collect()
}
