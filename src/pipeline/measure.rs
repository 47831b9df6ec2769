//! The error of what a container stores, measured without the block at hand.
//!
//! While a block is in memory, what its candidate *lacks* of it is measured: `E = A − (U R + S)`. Later the block is
//! gone, and of the stored `P = L' R' + S'` follows
//!
//! ```text
//! ‖A − P‖² = ‖E‖² + 2 ⟨E, X⟩ + ‖X‖²,   X = (U R − L' R') + (S − S')
//! ```
//!
//! `‖E‖²` is `‖A − S‖² − 2 ‖R‖² + ‖U R‖²` where `R = Uᵀ (A − S)`, else summed entry by entry. `‖X‖²` comes from the Gram matrices of the factors, `⟨E, S − S'⟩` from the values of `E` at the single entries, and
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
    /// the candidate or nearly so. `projected` says that the components' `R` is `Uᵀ (A − S)`, to rounding.
    pub(super) fn measure(block: &TracedBlock, whole: &FactoredBlock, projected: bool) -> Self {
        let m = whole.rows;
        let mut lacking = Self {
            noise_variance: block.noise.as_ref().map_or(f64::NAN, BlockNoise::mean_variance),
            all_on: vec![0.0; m],
            ..Self::default()
        };
        let mut sparse = whole.sparse.iter().peekable();
        let (mut rest_norm, mut rest) = (0.0, vec![0.0; m]);
        for (column, entries) in block.block.entries().chunks_exact(m.max(1)).enumerate() {
            let norm = column_sums(entries, &mut lacking.all_on);
            if sparse.peek().is_none_or(|entry| entry.column.index() != column) {
                lacking.squared_norm += norm;
                rest_norm += norm;
                continue;
            }
            rest.copy_from_slice(entries);
            let mut taken = 0.0;
            while let Some(entry) = sparse.next_if(|entry| entry.column.index() == column) {
                let row = entry.row as usize;
                let value = finite(entries[row]);
                taken += f64::from(value).powi(2) - f64::from(value - entry.value).powi(2);
                rest[row] = value - entry.value;
                lacking.at_sparse.push(rest[row] - component_entry(whole, row, column));
            }
            let norm = squared_norm(&rest);
            lacking.squared_norm += norm + taken;
            rest_norm += norm;
        }
        // A product less than the difference itself. Sums of f32 over the rows of a lamp in view, all alike, round off up
        // to 4e-6 of the squared norm: where the error is not far above that, it is summed.
        let (of_components, of_right) = components_norms(whole);
        let by_norms = rest_norm - 2.0 * of_right + of_components;
        let well_told = projected && by_norms > 1e-3 * rest_norm;
        lacking.squared_error = if well_told { by_norms } else { squared_difference(block, whole) };
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

    /// Appends it to a spilled candidate, in the machine's byte order.
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

#[inline(always)]
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

/// `(U R)ᵢⱼ`.
fn component_entry(whole: &FactoredBlock, row: usize, column: usize) -> f32 {
    (0..whole.rank()).map(|k| whole.left_component(k)[row] * whole.right_component(k)[column]).sum()
}

/// `‖U R‖²`, by the Gram matrices of the factors, and `‖R‖²`: the same but for the rounding of `U`.
fn components_norms(whole: &FactoredBlock) -> (f64, f64) {
    let (m, n, rank) = (whole.rows, whole.columns, whole.rank());
    let left = Mat::from_fn(m, rank, |i, k| f64::from(whole.left[k * m + i]));
    let right = Mat::from_fn(n, rank, |j, k| f64::from(whole.right[k * n + j]));
    let gram = |factor: MatRef<'_, f64>| {
        let mut gram = Mat::<f64>::zeros(rank, rank);
        matmul(gram.as_mut(), Accum::Replace, factor.transpose(), factor, 1.0, Par::Seq);
        gram
    };
    let (left, right) = (gram(left.as_ref()), gram(right.as_ref()));
    let both = (0..rank).flat_map(|j| (0..rank).map(move |i| (i, j))).map(|at| left[at] * right[at]).sum();
    (both, (0..rank).map(|k| right[(k, k)]).sum())
}

/// `‖A − (U R + S)‖²`, entry by entry.
fn squared_difference(block: &TracedBlock, whole: &FactoredBlock) -> f64 {
    let (m, n, rank) = (whole.rows, whole.columns, whole.rank());
    let left = MatRef::from_column_major_slice(&whole.left, m, rank);
    let right = MatRef::from_row_major_slice(&whole.right, rank, n);
    let mut strip = vec![0.0f32; m * STRIP.min(n)];
    let mut sparse = whole.sparse.iter().peekable();
    let mut error = 0.0;
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
            error += squared_norm(held);
        }
    }
    error
}

/// Running sums of squares: as many for every machine, so that the order of adding, and with it the bits, is the same.
const LANES: usize = 16;

/// The sum of the squares of the finite values.
fn squared_norm(values: &[f32]) -> f64 {
    let mut sums = [0.0f64; LANES];
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || {
            for values in values.chunks(LANES) {
                for (sum, &value) in sums.iter_mut().zip(values) {
                    let value = f64::from(finite(value));
                    *sum += value * value;
                }
            }
        },
    );
    sums.iter().sum()
}

/// [`squared_norm`] of a column, which is added to `all_on`.
fn column_sums(entries: &[f32], all_on: &mut [f32]) -> f64 {
    pulp::Arch::new().dispatch(
        #[inline(always)]
        || {
            for (sum, &entry) in all_on.iter_mut().zip(entries) {
                *sum += finite(entry);
            }
        },
    );
    squared_norm(entries)
}
