//! The leading part of a block's singular value decomposition.

use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, MatRef, Side};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use ltm::matrix::BlockView;

/// Columns of the sketch beyond the rank, and power iterations: with both, the singular values of light transport blocks
/// come out to a few parts in a thousand.
const OVERSAMPLING: usize = 16;
const POWER_ITERATIONS: usize = 3;

/// `A ≈ U diag(σ) Vᵀ`, singular values falling.
pub(super) struct Leading {
    /// rows × rank.
    pub(super) u: Mat<f64>,
    pub(super) sigma: Vec<f64>,
    /// columns × rank.
    pub(super) v: Mat<f64>,
}

pub(super) fn to_f64(block: BlockView<'_>) -> Mat<f64> {
    let m = block.rows();
    Mat::from_fn(m, block.columns(), |i, j| f64::from(block.entries()[j * m + i]))
}

/// The first `rank` singular triples, by a randomized range finder with power iterations in f64 (Halko, Martinsson,
/// Tropp 2011, Algorithms 4.4 and 5.1).
pub(super) fn leading(a: MatRef<'_, f64>, rank: usize, seed: u64) -> Leading {
    let (m, n) = a.shape();
    let rank = rank.min(m).min(n);
    let width = (rank + OVERSAMPLING).min(m).min(n);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    // Uniform numbers of mean zero serve as well as normal ones in a sketch this wide.
    let sketch = Mat::from_fn(n, width, |_, _| random.random::<f64>() - 0.5);
    let mut q = orthonormal((a * sketch).as_ref());
    for _ in 0..POWER_ITERATIONS {
        let z = orthonormal((a.transpose() * &q).as_ref());
        q = orthonormal((a * z).as_ref());
    }
    let b = q.transpose() * a;
    let (squares, turn) = eigen((&b * b.transpose()).as_ref());
    let sigma: Vec<f64> = squares[..rank].iter().map(|s| s.max(0.0).sqrt()).collect();
    let turn = turn.as_ref().subcols(0, rank);
    let along = b.transpose() * turn;
    let v = Mat::from_fn(n, rank, |j, k| if sigma[k] > 0.0 { along[(j, k)] / sigma[k] } else { 0.0 });
    Leading { u: q * turn, sigma, v }
}

/// The orthonormal `U` of which `‖(A − U Uᵀ A) S‖` is least, by what each of its columns brings: `U` and `σ` are those of `A S`, and
/// `V = Aᵀ U / σ`, so that `U diag(σ) Vᵀ = U Uᵀ A`.
pub(super) fn leading_weighted(a: MatRef<'_, f64>, s: MatRef<'_, f64>, rank: usize, seed: u64) -> Leading {
    let Leading { u, sigma, .. } = leading((a * s).as_ref(), rank, seed);
    let along = a.transpose() * &u;
    let v = Mat::from_fn(a.ncols(), sigma.len(), |j, k| if sigma[k] > 0.0 { along[(j, k)] / sigma[k] } else { 0.0 });
    Leading { u, sigma, v }
}

fn orthonormal(y: MatRef<'_, f64>) -> Mat<f64> {
    y.qr().compute_thin_Q()
}

/// Eigenvalues of a symmetric matrix, largest first, with their vectors as columns; zeros where it has entries that are not
/// finite.
pub(super) fn eigen(a: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let n = a.nrows();
    match SelfAdjointEigen::new(a, Side::Lower) {
        Ok(solved) => {
            let (values, vectors) = (solved.S().column_vector(), solved.U());
            let falling = (0..n).rev().map(|k| values[k]).collect();
            (falling, Mat::from_fn(n, n, |i, k| vectors[(i, n - 1 - k)]))
        }
        Err(_) => (vec![0.0; n], Mat::identity(n, n)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_weighs_nothing_draws_no_component() {
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let a = Mat::from_fn(40, 6, |_, _| random.random::<f64>() - 0.5);
        // The last four columns weigh nothing: rank 2 holds all that counts, and its product is the projected block.
        let s = Mat::from_fn(6, 6, |i, j| if i == j && i < 2 { 1.0 } else { 0.0 });
        let part = leading_weighted(a.as_ref(), s.as_ref(), 2, 1);
        let scaled = Mat::from_fn(40, 2, |i, k| part.u[(i, k)] * part.sigma[k]);
        let held = scaled * part.v.transpose();
        assert!((&a - &held).subcols(0, 2).norm_l2() < 1e-9);
        let projected = &part.u * (part.u.transpose() * &a);
        assert!((held - projected).norm_l2() < 1e-9);
    }

    #[test]
    fn the_leading_part_is_the_best_of_its_rank() {
        // Singular values 2^-k by construction: U and V from orthonormalised noise.
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut noise = |m, n| orthonormal(Mat::from_fn(m, n, |_, _| random.random::<f64>() - 0.5).as_ref());
        let (u, v) = (noise(90, 30), noise(60, 30));
        let scaled = Mat::from_fn(90, 30, |i, k| u[(i, k)] * 0.5f64.powi(k as i32));
        let a = scaled * v.transpose();
        let part = leading(a.as_ref(), 6, 1);
        for (k, s) in part.sigma.iter().enumerate() {
            assert!((s / 0.5f64.powi(k as i32) - 1.0).abs() < 1e-6, "{k}: {s}");
        }
        let weighted = Mat::from_fn(90, 6, |i, k| part.u[(i, k)] * part.sigma[k]);
        let error = (a - weighted * part.v.transpose()).norm_l2();
        // Σ over k ≥ 6 of 4^-k is 4^-6 · 4/3.
        assert!((error - (0.25f64.powi(6) * 4.0 / 3.0).sqrt()).abs() < 1e-6, "{error}");
    }
}
