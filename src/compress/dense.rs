//! Dense linear algebra on one thread: f32 for block-sized data, f64 for small matrices.
//!
//! faer 0.24's f32 `qr()` and `thin_svd()` drop columns whose residual is below about `ε · 16 · (rows − j)` of the
//! norm, which is 0.6 % at 3,072 rows. So nothing here is factorised in f32. Gram matrices are summed in f64, their
//! eigenvectors computed in f64, twice; small matrices use the f64 SVD.

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::matmul::matmul;
use faer::linalg::{evd, svd};
use faer::{Accum, ColMut, Mat, MatMut, MatRef, Par, unzip, zip};

/// Squared singular values below this fraction of the largest are rounding of the f32 input.
const RANK_CUT: f64 = 1e-13;

/// `a b` in f32.
pub(super) fn product(a: MatRef<'_, f32>, b: MatRef<'_, f32>) -> Mat<f32> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    write_product(c.as_mut(), a, b);
    c
}

/// `c = a b` in f32.
pub(super) fn write_product(c: MatMut<'_, f32>, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    matmul(c, Accum::Replace, a, b, 1.0, Par::Seq);
}

/// `a b` in f64.
pub(super) fn product_f64(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    matmul(c.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    c
}

/// `c −= a b` in f32.
pub(super) fn subtract_product(c: &mut Mat<f32>, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    matmul(c.as_mut(), Accum::Add, a, b, -1.0, Par::Seq);
}

/// Rows converted to f64 at a time: they stay in the cache and need no allocation.
const STRIP_ROWS: usize = 256;

fn strips(a: MatRef<'_, f32>) -> impl Iterator<Item = (usize, Mat<f64>)> {
    let rows = a.nrows();
    (0..rows).step_by(STRIP_ROWS).map(move |first| (first, to_f64(a.subrows(first, STRIP_ROWS.min(rows - first)))))
}

/// `aᵀ a`, summed in f64.
pub(super) fn gram(a: MatRef<'_, f32>) -> Mat<f64> {
    let mut gram = Mat::zeros(a.ncols(), a.ncols());
    for (_, strip) in strips(a) {
        matmul(gram.as_mut(), Accum::Add, strip.transpose(), strip.as_ref(), 1.0, Par::Seq);
    }
    gram
}

/// `a b`, summed in f64.
pub(super) fn product_in_f64(a: MatRef<'_, f32>, b: MatRef<'_, f64>) -> Mat<f32> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    for (first, strip) in strips(a) {
        let part = product_f64(strip.as_ref(), b);
        zip!(c.as_mut().subrows_mut(first, part.nrows()), part.as_ref()).for_each(|unzip!(c, p)| *c = *p as f32);
    }
    c
}

pub(super) fn to_f64(a: MatRef<'_, f32>) -> Mat<f64> {
    let mut wide = Mat::zeros(a.nrows(), a.ncols());
    zip!(wide.as_mut(), a).for_each(|unzip!(wide, a)| *wide = f64::from(*a));
    wide
}

pub(super) fn to_f32(a: MatRef<'_, f64>) -> Mat<f32> {
    let mut narrow = Mat::zeros(a.nrows(), a.ncols());
    zip!(narrow.as_mut(), a).for_each(|unzip!(narrow, a)| *narrow = *a as f32);
    narrow
}

/// Contiguous column-major entries of a matrix.
pub(super) fn to_vec(a: MatRef<'_, f32>) -> Vec<f32> {
    let mut entries = vec![0.0; a.nrows() * a.ncols()];
    MatMut::from_column_major_slice_mut(&mut entries, a.nrows(), a.ncols()).copy_from(a);
    entries
}

/// Eigenvalues of a symmetric matrix, largest first, and its eigenvectors as columns. Zeros where it has entries that
/// are not finite.
pub(super) fn eigen(a: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let n = a.nrows();
    let (mut values, mut vectors) = (vec![0.0; n], Mat::zeros(n, n));
    if n == 0 {
        return (values, vectors); // faer's count of scratch underflows here
    }
    let need = evd::self_adjoint_evd_scratch::<f64>(n, evd::ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(need);
    let s = DiagMut::from_slice_mut(&mut values);
    let done =
        evd::self_adjoint_evd(a, s, Some(vectors.as_mut()), Par::Seq, MemStack::new(&mut memory), Default::default());
    if done.is_err() {
        return (vec![0.0; n], Mat::identity(n, n));
    }
    values.reverse();
    (values, Mat::from_fn(n, n, |i, j| vectors[(i, n - 1 - j)]))
}

/// Thin SVD in f64: `U`, singular values from the largest, `V`. Zeros where it does not converge.
pub(super) fn thin_svd(a: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>, Mat<f64>) {
    let (m, n) = a.shape();
    let size = m.min(n);
    let (mut u, mut s, mut v) = (Mat::zeros(m, size), vec![0.0; size], Mat::zeros(n, size));
    if size == 0 {
        return (u, s, v);
    }
    let thin = svd::ComputeSvdVectors::Thin;
    let mut memory = MemBuffer::new(svd::svd_scratch::<f64>(m, n, thin, thin, Par::Seq, Default::default()));
    let values = ColMut::from_slice_mut(&mut s).as_diagonal_mut();
    let stack = MemStack::new(&mut memory);
    let done = svd::svd(a, values, Some(u.as_mut()), Some(v.as_mut()), Par::Seq, stack, Default::default());
    if done.is_err() {
        s.fill(0.0);
    }
    (u, s, v)
}

/// `a⁺ b` by the SVD, without the singular values below `truncation` of the largest.
pub(super) fn solve_least_squares(a: MatRef<'_, f64>, b: MatRef<'_, f64>, truncation: f64) -> Mat<f64> {
    let (u, s, v) = thin_svd(a);
    let least = s.first().map_or(0.0, |s| s * truncation.max(1e-12)).max(f64::MIN_POSITIVE);
    let mut x = product_f64(u.transpose(), b);
    for j in 0..x.ncols() {
        for (i, &s) in s.iter().enumerate() {
            x[(i, j)] = if s >= least { x[(i, j)] / s } else { 0.0 };
        }
    }
    product_f64(v.as_ref(), x.as_ref())
}

/// An orthonormal basis of the range of `y` (rows × rank), largest directions first. Directions at the level of
/// rounding are left out.
pub(super) fn orthonormal(y: MatRef<'_, f32>) -> Mat<f32> {
    let mut q = None;
    for pass in 0..2 {
        let from = q.as_ref().map_or(y, |q: &Mat<f32>| q.as_ref());
        let (values, vectors) = eigen(gram(from).as_ref());
        let cut = values.first().copied().unwrap_or(0.0) * if pass == 0 { RANK_CUT } else { 0.25 };
        let rank = values.iter().take_while(|&&v| v > cut && v > 0.0).count();
        let scaled = Mat::from_fn(vectors.nrows(), rank, |i, j| vectors[(i, j)] / values[j].sqrt());
        q = Some(product_in_f64(from, scaled.as_ref()));
        // One pass loses orthogonality if `y` is badly conditioned; a second restores it. With a condition of 10⁴ in
        // the Gram matrix the loss in f64 is far below the precision of f32.
        if rank > 0 && values[rank - 1] > 1e-4 * values[0] {
            break;
        }
    }
    q.unwrap_or_else(|| Mat::zeros(y.nrows(), 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tall matrices whose columns decay to 1e-6, which faer's f32 QR cuts at 0.6 %.
    #[test]
    fn the_basis_of_a_tall_decaying_matrix_reproduces_it_to_rounding() {
        let (m, n) = (3072, 12);
        let y = Mat::from_fn(m, n, |i, j| {
            let t = i as f32 / m as f32;
            (0.3f32).powi(j as i32) * ((j as f32 + 1.0) * 9.0 * t).cos()
        });
        let q = orthonormal(y.as_ref());
        let mut rest = y.clone();
        subtract_product(&mut rest, q.as_ref(), product(q.transpose(), y.as_ref()).as_ref());
        let error = rest.norm_l2() / y.norm_l2();
        // f32 products over 3,072 rows round to about 1e-7.
        assert!(error < 1e-6, "{error}");
        let gram = product(q.transpose(), q.as_ref());
        assert!((&gram - Mat::<f32>::identity(n, n)).norm_max() < 1e-5);
    }

    #[test]
    fn eigenvalues_come_in_falling_order() {
        let a = Mat::from_fn(3, 3, |i, j| if i == j { [1.0, 5.0, 3.0][i] } else { 0.0 });
        let (values, vectors) = eigen(a.as_ref());
        assert_eq!(values.iter().map(|v| v.round() as i32).collect::<Vec<_>>(), [5, 3, 1]);
        assert!((vectors[(1, 0)].abs() - 1.0).abs() < 1e-12);
    }
}
