//! The fastest way to the leading part of a block's SVD: a randomized range finder (Halko, Martinsson, Tropp 2011, Algorithms
//! 4.4 and 5.1) whose products with the block are in f32, and whose small Gram matrices are in f64.

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Accum, Mat, MatRef, Par, Side};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Columns of the sketch beyond the rank.
const OVERSAMPLING: usize = 8;

/// `L` and `R` of `A ≈ L R`, with so many power iterations.
pub(crate) fn leading(a: MatRef<'_, f32>, rank: usize, power: usize) -> (Mat<f32>, Mat<f32>) {
    let (m, n) = a.shape();
    let width = (rank + OVERSAMPLING).min(m).min(n);
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let sketch = Mat::from_fn(n, width, |_, _| random.random::<f32>() - 0.5);
    let mut basis = orthonormal(product(a, sketch.as_ref()).as_ref());
    for _ in 0..power {
        let along = orthonormal(product(a.transpose(), basis.as_ref()).as_ref());
        basis = orthonormal(product(a, along.as_ref()).as_ref());
    }
    let inside = product(basis.transpose(), a);
    let (_, vectors) = eigen(wide(inside.transpose()).as_ref());
    // The last ones are the largest.
    let (kept, first) = (rank.min(width), width - rank.min(width));
    let turn = Mat::from_fn(width, kept, |i, k| vectors[(i, first + k)] as f32);
    (product(basis.as_ref(), turn.as_ref()), product(turn.transpose(), inside.as_ref()))
}

fn product(a: MatRef<'_, f32>, b: MatRef<'_, f32>) -> Mat<f32> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    matmul(c.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    c
}

fn wide(a: MatRef<'_, f32>) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| f64::from(a[(i, j)]))
}

/// An orthonormal basis of the columns of `a`.
fn orthonormal(a: MatRef<'_, f32>) -> Mat<f32> {
    let (values, vectors) = eigen(wide(a).as_ref());
    let scaled = Mat::from_fn(a.ncols(), a.ncols(), |i, k| {
        let kept = values[k] > 1e-13 * values[a.ncols() - 1];
        if kept { (vectors[(i, k)] / values[k].sqrt()) as f32 } else { 0.0 }
    });
    product(a, scaled.as_ref())
}

/// Eigenvalues of `aᵀ a`, largest last, with their vectors as columns.
fn eigen(a: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let n = a.ncols();
    let mut gram = Mat::zeros(n, n);
    matmul(gram.as_mut(), Accum::Replace, a.transpose(), a, 1.0, Par::Seq);
    let solved = SelfAdjointEigen::new(gram.as_ref(), Side::Lower).expect("the block is finite");
    (solved.S().column_vector().iter().copied().collect(), solved.U().to_owned())
}
