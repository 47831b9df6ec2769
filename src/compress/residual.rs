//! The error of stored blocks, measured after the block itself is gone.
//!
//! While a block is in memory, the residual of its candidate is measured: `E = A − (U R + S)`. Later, for the stored `P
//! = L' R' + S'`,
//!
//! ```text
//! ‖A − P‖² = ‖E‖² + 2 ⟨E, X⟩ + ‖X‖²,   X = (U R − L' R') + (S − S')
//! ```
//!
//! `‖E‖²` is `‖A − S‖² − 2 ‖R‖² + ‖U R‖²` if `R = Uᵀ (A − S)`, otherwise it is summed entry by entry. `‖X‖²` comes from
//! the Gram matrices of the factors, and `⟨E, S − S'⟩` from the values of `E` at the sparse entries. `⟨E, U R⟩ = 0`
//! because `E` is orthogonal to the components. Only `⟨E, (L' − U) R'⟩` is neglected: the rounding of `L` is
//! independent of `E`, so its mean is 0 and its standard deviation at most `1 / √rows` of the whole (Cauchy–Schwarz,
//! with independent rounding errors in each row).
//!
//! So a matrix that never existed as a whole has the same report as a stored one, and packing reads a stored matrix
//! once. All of this holds for each column by itself as well, which gives the error under one light alone.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::{BlockSums, ColumnErrors};
use crate::matrix::{BlockNoise, BlockReport, FactoredBlock, SparseEntry, TracedBlock};
use crate::simd::dispatch;

/// Columns multiplied at a time: with 3,072 rows they fit a second-level cache.
const STRIP: usize = 64;

/// Bytes of an encoded residual before its lists.
const HEAD_BYTES: usize = 32;

/// Norms of a candidate's residual `E = A − (U R + S)`, and the other statistics of the block that a report needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residual {
    squared_norm: f64,
    squared_error: f64,
    noise_variance: f64,
    /// For each column: `‖E‖²`, `‖A‖²`, and the squared norm of its noise (NaN if unknown).
    column_error: Vec<f32>,
    column_norm: Vec<f32>,
    column_noise: Vec<f32>,
    /// The block's image with all lights on: one value for each row.
    all_on: Vec<f32>,
    /// `E` at the candidate's sparse entries, in their order.
    at_sparse: Vec<f32>,
}

impl Residual {
    /// Upper bound of the bytes of an encoded residual.
    pub fn max_bytes(rows: u64, columns: u64, sparse: u64) -> u64 {
        HEAD_BYTES as u64 + 4 * (rows + 3 * columns + sparse)
    }

    /// Measures `block` against its whole candidate. Entries that are not finite count as 0, as they do in the
    /// candidate, or nearly. `projected` says that the components' `R` is `Uᵀ (A − S)`, to rounding. `sums` are those
    /// of the block, if known already.
    pub fn measure(block: &TracedBlock, whole: &FactoredBlock, projected: bool, sums: Option<BlockSums>) -> Self {
        let (m, n) = (whole.rows, whole.columns);
        let noise = block.noise.as_ref().map(|noise| &noise.column_variance).filter(|noise| noise.len() == n);
        let mut residual = Self {
            noise_variance: block.noise.as_ref().map_or(f64::NAN, BlockNoise::mean_variance),
            column_noise: noise
                .map_or(vec![f32::NAN; n], |noise| noise.iter().map(|variance| variance * m as f32).collect()),
            ..Self::default()
        };
        let sums = sums.unwrap_or_else(|| {
            let mut all_on = vec![0.0; m];
            let columns = block.block.entries().chunks_exact(m.max(1));
            let column_norms = columns.map(|entries| column_sums(entries, &mut all_on)).collect();
            BlockSums { all_on, column_norms }
        });
        residual.all_on = sums.all_on;
        let mut sparse = whole.sparse.iter().peekable();
        let (mut rest_norms, mut rest) = (Vec::with_capacity(n), vec![0.0; m]);
        for (column, entries) in block.block.entries().chunks_exact(m.max(1)).enumerate() {
            let norm = sums.column_norms[column];
            if sparse.peek().is_none_or(|entry| entry.column.index() != column) {
                residual.column_norm.push(norm as f32);
                residual.squared_norm += norm;
                rest_norms.push(norm);
                continue;
            }
            rest.copy_from_slice(entries);
            let mut taken = 0.0;
            while let Some(entry) = sparse.next_if(|entry| entry.column.index() == column) {
                let row = entry.row as usize;
                let value = finite(entries[row]);
                taken += f64::from(value).powi(2) - f64::from(value - entry.value).powi(2);
                rest[row] = value - entry.value;
                residual.at_sparse.push(rest[row] - component_entry(whole, row, column));
            }
            let norm = squared_norm(&rest);
            residual.column_norm.push((norm + taken) as f32);
            residual.squared_norm += norm + taken;
            rest_norms.push(norm);
        }
        // This saves one product over the difference itself. In f32, sums over the equal rows of a lamp in view have
        // rounding errors of up to 4e-6 of the squared norm. If the error is not far above that, it is summed entry by
        // entry.
        let by_norms: Vec<f64> =
            rest_norms.iter().zip(components_beyond(whole)).map(|(rest, own)| rest + own).collect();
        let well_told = projected && by_norms.iter().sum::<f64>() > 1e-3 * rest_norms.iter().sum::<f64>();
        let errors = if well_told { by_norms } else { squared_difference(block, whole) };
        residual.squared_error = errors.iter().sum();
        residual.column_error = errors.iter().map(|&error| error as f32).collect();
        residual
    }

    /// The report of a stored block. `whole` is the candidate, `stored` is what a reader will decode.
    pub fn report(&self, whole: &FactoredBlock, stored: &FactoredBlock) -> (BlockReport, ColumnErrors) {
        let (m, n) = (whole.rows, whole.columns);
        let (k, l) = (whole.rank(), stored.rank());
        let left = Mat::from_fn(m, k + l, |i, j| {
            f64::from(if j < k { whole.left[j * m + i] } else { stored.left[(j - k) * m + i] })
        });
        let right = Mat::from_fn(k + l, n, |j, c| {
            if j < k { f64::from(whole.right[j * n + c]) } else { -f64::from(stored.right[(j - k) * n + c]) }
        });
        let difference_at =
            |row: usize, column: usize| (0..k + l).map(|j| left[(row, j)] * right[(j, column)]).sum::<f64>();
        let mut left_gram = Mat::<f64>::zeros(k + l, k + l);
        matmul(left_gram.as_mut(), Accum::Replace, left.transpose(), left.as_ref(), 1.0, Par::Seq);
        let mut turned = Mat::<f64>::zeros(k + l, n);
        matmul(turned.as_mut(), Accum::Replace, left_gram.as_ref(), right.as_ref(), 1.0, Par::Seq);
        // The terms of each column's error beside `‖E‖²`.
        let mut beside: Vec<f64> =
            (0..n).map(|c| (0..k + l).map(|j| right[(j, c)] * turned[(j, c)]).sum::<f64>().max(0.0)).collect();
        let mut rest = stored.sparse.iter().peekable();
        let mut add = |entry: &SparseEntry, missing: f64, lack: f64| {
            let around = lack + difference_at(entry.row as usize, entry.column.index());
            beside[entry.column.index()] += missing * (missing + 2.0 * around);
        };
        for (entry, &lack) in whole.sparse.iter().zip(&self.at_sparse) {
            while let Some(alone) = rest.next_if(|other| key(other) < key(entry)) {
                add(alone, -f64::from(alone.value), 0.0);
            }
            let kept = rest.next_if(|other| key(other) == key(entry)).map_or(0.0, |other| f64::from(other.value));
            add(entry, f64::from(entry.value) - kept, f64::from(lack));
        }
        rest.for_each(|alone| add(alone, -f64::from(alone.value), 0.0));
        let (all_on_error, all_on_norm) = self.all_on_error(stored);
        let report = BlockReport {
            squared_error: (self.squared_error + beside.iter().sum::<f64>()).max(0.0),
            squared_norm: self.squared_norm,
            noise_variance: self.noise_variance,
            uniform_error: if all_on_error == 0.0 { 0.0 } else { (all_on_error / all_on_norm).sqrt() },
        };
        let columns = ColumnErrors {
            error: self
                .column_error
                .iter()
                .zip(&beside)
                .map(|(&lacking, beside)| f64::from(lacking) + beside)
                .collect(),
            norm: self.column_norm.iter().map(|&v| f64::from(v)).collect(),
            noise: self.column_noise.iter().map(|&v| f64::from(v)).collect(),
            all_on: (all_on_error, all_on_norm),
        };
        (report, columns)
    }

    /// Squared error of the block's image with all lights on, and the squared norm of that image.
    fn all_on_error(&self, stored: &FactoredBlock) -> (f64, f64) {
        let mut image: Vec<f64> = self.all_on.iter().map(|&v| f64::from(v)).collect();
        let norm: f64 = image.iter().map(|v| v * v).sum();
        for k in 0..stored.rank() {
            let sum: f64 = stored.right_component(k).iter().map(|&v| f64::from(v)).sum();
            image.iter_mut().zip(stored.left_component(k)).for_each(|(v, &l)| *v -= f64::from(l) * sum);
        }
        stored.sparse.iter().for_each(|e| image[e.row as usize] -= f64::from(e.value));
        (image.iter().map(|v| v * v).sum(), norm)
    }

    /// Appends it to a spilled candidate, in the machine's byte order.
    pub fn append_to(&self, bytes: &mut Vec<u8>) {
        for value in [self.squared_norm, self.squared_error, self.noise_variance] {
            bytes.extend(value.to_le_bytes());
        }
        for count in [self.all_on.len(), self.column_norm.len()] {
            bytes.extend((count as u32).to_le_bytes());
        }
        for list in [&self.all_on, &self.column_error, &self.column_norm, &self.column_noise, &self.at_sparse] {
            bytes.extend_from_slice(bytemuck::cast_slice(list));
        }
    }

    /// Decodes what [`append_to`](Self::append_to) wrote.
    ///
    /// # Panics
    /// Never: the slices have the lengths asked for.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (fixed, rest) = bytes.split_at_checked(HEAD_BYTES)?;
        let scalar = |i: usize| f64::from_le_bytes(fixed[8 * i..][..8].try_into().expect("8 bytes"));
        let count = |at: usize| u32::from_le_bytes(fixed[at..at + 4].try_into().expect("4 bytes")) as usize;
        let floats: Vec<f32> = rest.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        let mut floats = floats.as_slice();
        let mut take = |count: usize| -> Option<Vec<f32>> {
            let (taken, left) = floats.split_at_checked(count)?;
            floats = left;
            Some(taken.to_vec())
        };
        let (rows, columns) = (count(24), count(28));
        let (all_on, column_error) = (take(rows)?, take(columns)?);
        let (column_norm, column_noise) = (take(columns)?, take(columns)?);
        Some(Self {
            squared_norm: scalar(0),
            squared_error: scalar(1),
            noise_variance: scalar(2),
            column_error,
            column_norm,
            column_noise,
            all_on,
            at_sparse: floats.to_vec(),
        })
    }
}

fn key(entry: &SparseEntry) -> (crate::matrix::ColumnIndex, u32) {
    (entry.column, entry.row)
}

#[inline(always)]
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// `(U R)ᵢⱼ`.
fn component_entry(whole: &FactoredBlock, row: usize, column: usize) -> f32 {
    (0..whole.rank()).map(|k| whole.left_component(k)[row] * whole.right_component(k)[column]).sum()
}

/// `‖U r‖² − 2 ‖r‖²` of each column `r` of `R`, by the Gram matrix of `U`: `−‖r‖²` but for the rounding of `U`.
fn components_beyond(whole: &FactoredBlock) -> Vec<f64> {
    let (m, n, rank) = (whole.rows, whole.columns, whole.rank());
    let left = Mat::from_fn(m, rank, |i, k| f64::from(whole.left[k * m + i]));
    let right = Mat::from_fn(rank, n, |k, j| f64::from(whole.right[k * n + j]));
    let (mut gram, mut turned) = (Mat::<f64>::zeros(rank, rank), Mat::<f64>::zeros(rank, n));
    matmul(gram.as_mut(), Accum::Replace, left.transpose(), left.as_ref(), 1.0, Par::Seq);
    matmul(turned.as_mut(), Accum::Replace, gram.as_ref(), right.as_ref(), 1.0, Par::Seq);
    (0..n).map(|j| (0..rank).map(|k| right[(k, j)] * (turned[(k, j)] - 2.0 * right[(k, j)])).sum()).collect()
}

/// `‖A − (U R + S)‖²` of each column, entry by entry.
fn squared_difference(block: &TracedBlock, whole: &FactoredBlock) -> Vec<f64> {
    let (m, n, rank) = (whole.rows, whole.columns, whole.rank());
    let left = MatRef::from_column_major_slice(&whole.left, m, rank);
    let right = MatRef::from_row_major_slice(&whole.right, rank, n);
    let mut strip = vec![0.0f32; m * STRIP.min(n)];
    let mut sparse = whole.sparse.iter().peekable();
    let mut errors = Vec::with_capacity(n);
    for first in (0..n).step_by(STRIP) {
        let count = STRIP.min(n - first);
        let strip = &mut strip[..m * count];
        let target = MatMut::from_column_major_slice_mut(strip, m, count);
        matmul(target, Accum::Replace, left, right.subcols(first, count), 1.0, Par::Seq);
        for (i, held) in strip.chunks_exact_mut(m).enumerate() {
            while let Some(entry) = sparse.next_if(|entry| entry.column.index() == first + i) {
                held[entry.row as usize] += entry.value;
            }
            for (held, &entry) in held.iter_mut().zip(&block.block.entries()[(first + i) * m..][..m]) {
                *held = if entry.is_finite() { entry - *held } else { 0.0 };
            }
            errors.push(squared_norm(held));
        }
    }
    errors
}

/// Number of running sums of squares. It is the same on every machine, so that the order of additions and the bits are.
const LANES: usize = 16;

/// The sum of the squares of the finite values.
fn squared_norm(values: &[f32]) -> f64 {
    let mut sums = [0.0f64; LANES];
    dispatch(
        #[inline(always)]
        || {
            let square = |value: f32| f64::from(finite(value)) * f64::from(finite(value));
            // Fixed-size arrays keep the sums in registers.
            let (arrays, rest) = values.as_chunks::<LANES>();
            for values in arrays {
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += square(*value));
            }
            sums.iter_mut().zip(rest).for_each(|(sum, value)| *sum += square(*value));
        },
    );
    sums.iter().sum()
}

/// [`squared_norm`] of a column, which is added to `all_on`.
fn column_sums(entries: &[f32], all_on: &mut [f32]) -> f64 {
    dispatch(
        #[inline(always)]
        || {
            for (sum, &entry) in all_on.iter_mut().zip(entries) {
                *sum += finite(entry);
            }
        },
    );
    squared_norm(entries)
}
