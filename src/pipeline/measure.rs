//! The error of what a container stores, measured without the block at hand.
//!
//! While a block is in memory, what its candidate *lacks* of it is measured: `E = A − (U R + S)`. Later the block is
//! gone, and of the stored `P = L' R' + S'` follows
//!
//! ```text
//! ‖A − P‖² = ‖E‖² + 2 ⟨E, X⟩ + ‖X‖²,   X = (U R − L' R') + (S − S')
//! ```
//!
//! `‖X‖²` comes from the Gram matrices of the factors, `⟨E, S − S'⟩` from the values of `E` at the single entries, and
//! `⟨E, U R⟩ = 0` because `E` is orthogonal to the components. Only `⟨E, (L' − U) R'⟩` is left out: the rounding of `L`
//! does not know `E`, so its mean is 0 and its standard deviation at most `1 / √rows` of the whole (Cauchy–Schwarz, with
//! rounding errors independent from row to row). So a matrix that never was in one place has the same report as one that
//! was stored, and packing reads a stored matrix once.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use crate::container::BlockReport;
use crate::matrix::{BlockNoise, FactoredBlock, TracedBlock};

/// Columns that are multiplied out at a time: with 3,072 rows they fit a second-level cache.
const STRIP: usize = 64;

/// What a candidate lacks of its block, and what else a report needs of the block.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lacking {
    squared_norm: f64,
    squared_error: f64,
    noise_variance: f64,
    /// The block with all lights on: one value a row.
    all_on: Vec<f32>,
    /// `E` at the candidate's single entries, in their order.
    at_sparse: Vec<f32>,
}

impl Lacking {
    /// Bytes that one takes in a spill file at most, with so many rows and single entries.
    pub(super) fn max_bytes(rows: u64, sparse: u64) -> u64 {
        28 + 4 * (rows + sparse)
    }

    /// Measures `block` against all that its candidate holds. Entries that are not finite count as 0, as they do in
    /// the candidate or nearly so.
    pub(super) fn measure(block: &TracedBlock, whole: &FactoredBlock) -> Self {
        let (m, n, rank) = (whole.rows, whole.columns, whole.rank());
        let mut lacking = Self {
            noise_variance: block.noise.as_ref().map_or(f64::NAN, BlockNoise::mean_variance),
            all_on: vec![0.0; m],
            ..Self::default()
        };
        let left = MatRef::from_column_major_slice(&whole.left, m, rank);
        let right = MatRef::from_row_major_slice(&whole.right, rank, n);
        let mut strip = vec![0.0f32; m * STRIP.min(n)];
        let mut sparse = whole.sparse.iter().peekable();
        for first in (0..n).step_by(STRIP) {
            let count = STRIP.min(n - first);
            let strip = &mut strip[..m * count];
            let target = MatMut::from_column_major_slice_mut(strip, m, count);
            matmul(target, Accum::Replace, left, right.subcols(first, count), 1.0, Par::Seq);
            for (i, held) in strip.chunks_exact_mut(m).enumerate() {
                let entries = &block.block.entries()[(first + i) * m..][..m];
                while let Some(entry) = sparse.next_if(|entry| entry.column.index() == first + i) {
                    let row = entry.row as usize;
                    held[row] += entry.value;
                    lacking.at_sparse.push(finite(entries[row]) - held[row]);
                }
                let (norm, error) = column_sums(entries, held, &mut lacking.all_on);
                lacking.squared_norm += norm;
                lacking.squared_error += error;
            }
        }
        lacking
    }

    /// The report of what is stored of the block: `whole` is what the candidate held, `stored` what a reader will get.
    pub(super) fn report(&self, whole: &FactoredBlock, stored: &FactoredBlock) -> BlockReport {
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
        let mut right_gram = left_gram.clone();
        matmul(left_gram.as_mut(), Accum::Replace, left.transpose(), left.as_ref(), 1.0, Par::Seq);
        matmul(right_gram.as_mut(), Accum::Replace, right.as_ref(), right.transpose(), 1.0, Par::Seq);
        let smooth: f64 =
            (0..k + l).flat_map(|j| (0..k + l).map(move |i| (i, j))).map(|at| left_gram[at] * right_gram[at]).sum();
        let mut squared_error = self.squared_error + smooth.max(0.0);
        let mut rest = stored.sparse.iter().peekable();
        let mut kept_of = |column, row| {
            let before = |e: &&_| -> bool { key(e) < (column, row) };
            let mut alone = 0.0;
            while let Some(entry) = rest.next_if(before) {
                let value = -f64::from(entry.value);
                alone += value * (value + 2.0 * difference_at(entry.row as usize, entry.column.index()));
            }
            (rest.next_if(|e| key(e) == (column, row)).map_or(0.0, |e| f64::from(e.value)), alone)
        };
        for (entry, &lack) in whole.sparse.iter().zip(&self.at_sparse) {
            let (kept, alone) = kept_of(entry.column, entry.row);
            let missing = f64::from(entry.value) - kept;
            let around = f64::from(lack) + difference_at(entry.row as usize, entry.column.index());
            squared_error += alone + missing * (missing + 2.0 * around);
        }
        squared_error += kept_of(crate::matrix::ColumnIndex(u32::MAX), u32::MAX).1;
        BlockReport {
            squared_error: squared_error.max(0.0),
            squared_norm: self.squared_norm,
            noise_variance: self.noise_variance,
            uniform_error: self.all_on_error(stored),
        }
    }

    /// Relative L2 error of the block's image with all lights on.
    fn all_on_error(&self, stored: &FactoredBlock) -> f64 {
        let mut image: Vec<f64> = self.all_on.iter().map(|&v| f64::from(v)).collect();
        let norm: f64 = image.iter().map(|v| v * v).sum();
        for k in 0..stored.rank() {
            let sum: f64 = stored.right_component(k).iter().map(|&v| f64::from(v)).sum();
            image.iter_mut().zip(stored.left_component(k)).for_each(|(v, &l)| *v -= f64::from(l) * sum);
        }
        stored.sparse.iter().for_each(|e| image[e.row as usize] -= f64::from(e.value));
        let error: f64 = image.iter().map(|v| v * v).sum();
        if error == 0.0 { 0.0 } else { (error / norm).sqrt() }
    }

    /// Appends it to a spilled candidate, little-endian.
    pub(super) fn append_to(&self, bytes: &mut Vec<u8>) {
        for value in [self.squared_norm, self.squared_error, self.noise_variance] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend((self.all_on.len() as u32).to_le_bytes());
        bytes.extend_from_slice(bytemuck::cast_slice(&self.all_on));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.at_sparse));
    }

    /// Reads what [`append_to`](Self::append_to) wrote.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (fixed, rest) = bytes.split_at_checked(28)?;
        let scalar = |i: usize| f64::from_le_bytes(fixed[8 * i..][..8].try_into().expect("8 bytes"));
        let rows = u32::from_le_bytes(fixed[24..].try_into().expect("4 bytes")) as usize;
        let floats: Vec<f32> = rest.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        let (all_on, at_sparse) = floats.split_at_checked(rows)?;
        Some(Self {
            squared_norm: scalar(0),
            squared_error: scalar(1),
            noise_variance: scalar(2),
            all_on: all_on.to_vec(),
            at_sparse: at_sparse.to_vec(),
        })
    }
}

fn key(entry: &crate::matrix::SparseEntry) -> (crate::matrix::ColumnIndex, u32) {
    (entry.column, entry.row)
}

fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// Squares of a column and of its difference from what is held, and the column added to `all_on`. Sixteen running sums
/// each, so that the order of adding, and with it the bits, is the same on every machine.
fn column_sums(entries: &[f32], held: &[f32], all_on: &mut [f32]) -> (f64, f64) {
    const LANES: usize = 16;
    let (mut norms, mut errors) = ([0.0f32; LANES], [0.0f32; LANES]);
    let parts = entries.chunks(LANES).zip(held.chunks(LANES)).zip(all_on.chunks_mut(LANES));
    for ((entries, held), all_on) in parts {
        for (lane, ((&entry, &held), sum)) in entries.iter().zip(held).zip(all_on).enumerate() {
            let usable = entry.is_finite();
            let (entry, error) = if usable { (entry, entry - held) } else { (0.0, 0.0) };
            norms[lane] += entry * entry;
            errors[lane] += error * error;
            *sum += entry;
        }
    }
    (norms.iter().map(|&v| f64::from(v)).sum(), errors.iter().map(|&v| f64::from(v)).sum())
}
