//! Kernel Nyström (Wang, Dong, Tong, Lin, Guo 2009, *Kernel Nyström Method for Light Transport*), for comparison only.
//!
//! A monotone map `f` is applied to every entry, so that `f(A)` has a lower rank than `A`. The Nyström reconstruction
//! is computed there and mapped back: `A ≈ f⁻¹(f(C) f(W)⁺ f(R))`, here with `f(x) = sign(x) |x|^γ`. Rows and columns
//! are those of Algorithm 4, so that only the map differs.
//!
//! The method is meant for a camera that sees only these rows and columns, but a compressor has the whole block. So `γ`
//! is the one of several with the least error, and results are clamped to the block's range of values, since the
//! inverse map extrapolates without bound. The image is no product of thin factors any more: every entry must be
//! computed before it can be summed.

use faer::{Mat, MatRef};

use super::svd::to_f64;
use ltm::compress::{CompressSettings, Method, cur};
use ltm::matrix::{Block, BlockView, FactoredBlock};

/// Exponents that are tried; 1 is plain Nyström.
const EXPONENTS: [f64; 6] = [1.0, 0.7, 0.5, 0.35, 0.25, 0.15];
/// Singular values of `f(W)` below this fraction of the largest are dropped, as in the product's own core.
const TRUNCATION: f64 = 1e-2;

/// `f(A)` as factors, and the way back.
pub(super) struct Mapped {
    pub(super) factors: FactoredBlock,
    pub(super) back: Back,
}

/// `f⁻¹`.
#[derive(Clone, Copy)]
pub(super) struct Back {
    exponent: f64,
    /// The least and the largest entry of the block.
    bounds: [f32; 2],
}

impl Back {
    /// In a file: a byte for the exponent, and the bounds.
    pub(super) const BYTES: u64 = 9;

    fn of(self, mapped: f64) -> f64 {
        map(mapped, 1.0 / self.exponent).clamp(self.bounds[0].into(), self.bounds[1].into())
    }
}

/// Decomposes a block with `rank` columns and twice as many rows.
pub(super) fn decompose(block: BlockView<'_>, rank: usize, seed: u64) -> Mapped {
    let settings = CompressSettings { rank, ..CompressSettings::of_method(Method::Algorithm4) };
    let chosen = cur(block, &settings, seed).2;
    let a = to_f64(block);
    let bounds = bounds(block.entries());
    let tried = EXPONENTS.into_iter().map(|exponent| {
        let back = Back { exponent, bounds };
        let factors = factors(a.as_ref(), &chosen.rows, &chosen.columns, exponent);
        let error = squared_error(&reconstruct(&factors, back), block.entries());
        (error, Mapped { factors, back })
    });
    tried.min_by(|a, b| a.0.total_cmp(&b.0)).expect("an exponent").1
}

/// `f(C)` and `f(W)⁺ f(R)`.
fn factors(a: MatRef<'_, f64>, rows: &[usize], columns: &[usize], exponent: f64) -> FactoredBlock {
    let c = Mat::from_fn(a.nrows(), columns.len(), |i, k| map(a[(i, columns[k])], exponent));
    let right = core_times_rows(a, rows, columns, exponent);
    let column_major = |m: MatRef<'_, f64>| -> Vec<f32> {
        (0..m.ncols()).flat_map(|j| (0..m.nrows()).map(move |i| m[(i, j)] as f32)).collect()
    };
    FactoredBlock {
        rows: a.nrows(),
        columns: a.ncols(),
        left: column_major(c.as_ref()),
        right: column_major(right.transpose()),
        ..Default::default()
    }
}

/// `f⁻¹(L R)`, entry by entry.
pub(super) fn reconstruct(factors: &FactoredBlock, back: Back) -> Block {
    let mut block = factors.expand();
    block.entries_mut().iter_mut().for_each(|v| *v = back.of(f64::from(*v)) as f32);
    block
}

/// The least and the largest entry; of none: zeros.
fn bounds(entries: &[f32]) -> [f32; 2] {
    let both = entries.iter().map(|&value| [value; 2]);
    both.reduce(|all, value| [all[0].min(value[0]), all[1].max(value[1])]).unwrap_or_default()
}

/// Infinite where it is no number.
fn squared_error(block: &Block, entries: &[f32]) -> f64 {
    let squares = block.entries().iter().zip(entries).map(|(&a, &b)| f64::from(a - b).powi(2));
    let error: f64 = squares.sum();
    if error.is_finite() { error } else { f64::INFINITY }
}

fn map(value: f64, exponent: f64) -> f64 {
    value.abs().powf(exponent).copysign(value)
}

/// `f(W)⁺ f(R)`: columns chosen × all columns.
fn core_times_rows(a: MatRef<'_, f64>, rows: &[usize], columns: &[usize], exponent: f64) -> Mat<f64> {
    let w = Mat::from_fn(rows.len(), columns.len(), |r, k| map(a[(rows[r], columns[k])], exponent));
    let r = Mat::from_fn(rows.len(), a.ncols(), |r, j| map(a[(rows[r], j)], exponent));
    let Ok(solved) = w.thin_svd() else { return Mat::zeros(columns.len(), a.ncols()) };
    let sigma = solved.S().column_vector();
    let least = if sigma.nrows() > 0 { sigma[0] * TRUNCATION } else { 0.0 };
    let mut x = solved.U().transpose() * r;
    for j in 0..x.ncols() {
        for k in 0..x.nrows() {
            x[(k, j)] = if sigma[k] > least { x[(k, j)] / sigma[k] } else { 0.0 };
        }
    }
    solved.V() * x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubed rank-1 matrix plus a constant is of rank 4 as it is and of rank 2 after a cube root.
    #[test]
    fn a_block_that_is_low_rank_after_a_root_is_found_to_be() {
        let (m, n) = (60, 40);
        let value = |i: usize, j: usize| (1.0 + (i as f32 * 0.31).sin().abs() * (j as f32 * 0.17).cos().abs()).powi(4);
        let entries: Vec<f32> = (0..m * n).map(|e| value(e % m, e / m)).collect();
        let block = BlockView::new(m, n, &entries);
        let mapped = decompose(block, 2, 1);
        let again = reconstruct(&mapped.factors, mapped.back);
        let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            entries.iter().zip(again.entries()).map(|(&a, &b)| f(f64::from(a), f64::from(b))).sum()
        };
        let error = (sum(&|a, b| (a - b).powi(2)) / sum(&|a, _| a * a)).sqrt();
        assert_eq!(mapped.back.exponent, 0.25);
        // Exact but for f32 and the truncation of the core, which two well separated components do not meet.
        assert!(error < 1e-3, "{error}");
    }

    #[test]
    fn nothing_comes_back_beyond_what_the_block_has() {
        let back = Back { exponent: 0.25, bounds: bounds(&[1.0, 0.0, 3.0]) };
        assert_eq!([-2.0, 1.0, 1e9].map(|mapped| back.of(mapped)), [0.0, 1.0, 3.0]);
        assert_eq!(bounds(&[]), [0.0, 0.0]);
    }
}
