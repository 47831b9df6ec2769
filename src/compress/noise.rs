//! How much of what a block shows is the noise of its samples.
//!
//! A component `u`, `R = uᵀ A` meets the noise `N` of `A` twice. Its right side is `uᵀ (S + N)`: the noise that falls on
//! `u`, small, because `u` is one direction of very many. Its left side is itself made from the block: `u = A w` with
//! the lighting `w = K Rᵀ / g` that calls it up (`A K Aᵀ u = g u`), so that of its gain `g` the part `‖N w‖² g` was never
//! there: the range finder fits the noise that it sees. A component brings the image nearer to the truth only where its
//! signal is above this noise.

use faer::MatRef;

use super::dense::product;
use super::range::Weights;
use crate::matrix::{BlockNoise, SparseEntry};

/// Entries that stand out are noise if the squares of those of a row do not sum to more than this many times the row's
/// noise. A path that one of two half-sample estimates lacks has a ratio of 1; a light that many samples see, of half
/// the number of samples.
const SEEN_OVER_NOISE: f64 = 1.3;

/// `‖N w‖²` for any lighting `w`, from the noise of single columns and what the probes show of noise that they share.
pub(super) struct NoiseModel<'a> {
    noise: &'a BlockNoise,
    rows: usize,
    probe_count: usize,
    /// Weight of `(Σ wⱼ σⱼ)²`, noise that all columns share; negative where columns take samples from each other.
    shared: f64,
}

impl<'a> NoiseModel<'a> {
    /// Fits the shared part to the probes (columns × probes, column-major, the first all-on). None if the noise is not
    /// of this block.
    pub(super) fn new(noise: &'a BlockNoise, probes: &[f32], (rows, columns): (usize, usize)) -> Option<Self> {
        let probe_count = probes.len() / columns;
        let fits = noise.row_variance.len() == rows
            && noise.column_variance.len() == columns
            && noise.probes.len() == rows * probe_count
            && probe_count > 1;
        if !fits {
            return None;
        }
        let mut model = Self { noise, rows, probe_count, shared: 0.0 };
        let (mut fit, mut norm) = (0.0, 0.0);
        for (lighting, seen) in probes.chunks_exact(columns).zip(noise.probes.chunks_exact(rows)) {
            let energy: f64 = seen.iter().map(|&v| f64::from(v).powi(2)).sum();
            let (own, sum) = model.parts(lighting);
            fit += (energy - own) * sum * sum;
            norm += sum.powi(4);
        }
        if norm > 0.0 && fit.is_finite() {
            model.shared = fit / norm;
        }
        Some(model)
    }

    /// `‖N w‖²` of independent columns, and `Σ wⱼ σⱼ` with `σⱼ` the norm of a column's noise.
    fn parts(&self, lighting: &[f32]) -> (f64, f64) {
        let rows = self.rows as f64;
        lighting.iter().zip(&self.noise.column_variance).fold((0.0, 0.0), |(own, sum), (&w, &v)| {
            let (w, v) = (f64::from(w), rows * f64::from(v));
            (own + w * w * v, sum + w * v.sqrt())
        })
    }

    /// Of each gain, what the left side was fitted to.
    pub(super) fn fitted(&self, weights: &Weights, right: &[f32], gains: &[f64]) -> Vec<f32> {
        let columns = self.noise.column_variance.len();
        let right = MatRef::from_row_major_slice(right, gains.len(), columns);
        let lightings = weights.weigh(right);
        let fitted = |(k, &gain): (usize, &f64)| {
            if gain <= 0.0 {
                return 0.0;
            }
            let lighting: Vec<f32> = (0..columns).map(|j| lightings[(j, k)]).collect();
            let (own, sum) = self.parts(&lighting);
            // Columns that take samples from each other make each other's sum steadier, never exact.
            let energy = (own + self.shared * sum * sum).max(0.05 * own) / gain;
            if energy.is_finite() { energy.min(gain) as f32 } else { 0.0 }
        };
        gains.iter().enumerate().map(fitted).collect()
    }

    /// What falls on each component from outside: the mean of `(uᵀ N ω)²` over the probes.
    pub(super) fn fallen(&self, left: &[f32], rank: usize) -> Vec<f32> {
        let count = self.probe_count - 1;
        let probes = MatRef::from_column_major_slice(&self.noise.probes[self.rows..], self.rows, count);
        let seen = product(MatRef::from_column_major_slice(left, self.rows, rank).transpose(), probes);
        let mean = |k: usize| seen.row(k).squared_norm_l2() / count as f32;
        (0..rank).map(mean).map(|v| if v.is_finite() { v } else { 0.0 }).collect()
    }

    /// Splits entries that stand out into those that samples agree on and those that are noise.
    pub(super) fn split(&self, entries: Vec<SparseEntry>) -> (Vec<SparseEntry>, Vec<SparseEntry>) {
        let mut seen = vec![0.0f64; self.rows];
        entries.iter().for_each(|e| seen[e.row as usize] += f64::from(e.value).powi(2));
        let columns = self.noise.column_variance.len() as f64;
        entries.into_iter().partition(|entry| {
            let row = entry.row as usize;
            seen[row] > SEEN_OVER_NOISE * columns * f64::from(self.noise.row_variance[row])
        })
    }
}
