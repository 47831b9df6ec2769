//! The range of a block under the prior: a randomized range finder weighted by the covariance of lightings.
//!
//! The best `U` of given rank for `‖(A − U Uᵀ A) K^½‖` are the left singular vectors of `A K^½`. They are computed from
//! a sketch `A · (draws of K)`, improved by power iterations `A K Aᵀ` (Halko, Martinsson, Tropp 2011, Algorithm 4.4,
//! with `K` in the middle), and an eigenproblem of the sketch's size.

use faer::{Mat, MatRef, unzip, zip};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::dense::{
    eigen, gram, orthonormal, product, product_f64, product_in_f64, subtract_product, to_f32, to_f64, to_vec,
};
use crate::light::LightingPrior;
use crate::matrix::SparseEntry;
use crate::simd::dispatch;

/// Factors of a block over an orthonormal `left`, in falling order of gain after the exact all-on component.
pub(super) struct Range {
    /// `U`, rows × rank, column-major, orthonormal.
    pub(super) left: Vec<f32>,
    /// `Uᵀ A`, rank × columns, row-major.
    pub(super) right: Vec<f32>,
    /// `uᵀ A K Aᵀ u` of each component.
    pub(super) gains: Vec<f64>,
    /// Energy outside the range, under `K`.
    pub(super) tail: f64,
}

/// Selects lightings (columns × any) by the energies of their images.
pub(super) type Wanted<'a> = dyn Fn(MatRef<'_, f32>, &[f64]) -> Vec<bool> + 'a;

/// The prior in the form that products use.
pub(super) struct PriorWeights {
    prior: LightingPrior,
    /// Lightings of the sketch: all-on, then random draws; all-on alone if there are no more columns than draws.
    sketch: Mat<f32>,
}

impl PriorWeights {
    pub(super) fn new(prior: LightingPrior, sketch_columns: usize, seed: u64) -> Self {
        let n = prior.columns();
        let mut sketch = vec![1.0f32; n];
        // With as many lightings as columns, the columns themselves lose nothing.
        let draws = if sketch_columns >= n { 0 } else { sketch_columns - 1 };
        sketch.extend(prior.draws(draws, seed));
        let sketch = MatRef::from_column_major_slice(&sketch, n, sketch.len() / n).to_owned();
        Self { prior, sketch }
    }

    pub(super) fn prior(&self) -> &LightingPrior {
        &self.prior
    }

    /// `F`, columns × width.
    fn factor(&self) -> MatRef<'_, f32> {
        MatRef::from_column_major_slice(self.prior.factor(), self.prior.columns(), self.prior.width())
    }

    /// Whether the sketch would be no smaller than the columns.
    pub(super) fn holds_all_columns(&self) -> bool {
        self.sketch.ncols() == 1
    }

    /// `K bᵀ` for `b` (k × columns).
    pub(super) fn weigh(&self, b: MatRef<'_, f32>) -> Mat<f32> {
        let mut weighed = product(self.factor(), product(self.factor().transpose(), b.transpose()).as_ref());
        for k in 0..b.nrows() {
            for j in 0..b.ncols() {
                weighed[(j, k)] += self.prior.independent()[j] * b[(k, j)];
            }
        }
        weighed
    }

    /// The lightings, columns × (1 + width of the range), that show the range of a block best, estimated from a sketch
    /// of its rows (`few`). All-on comes first, then those of the strongest directions beside it, filtered by `wanted`.
    fn lightings_that_show(&self, few: MatRef<'_, f32>, power_iterations: usize, wanted: &Wanted<'_>) -> Mat<f32> {
        let mut y = product(few, self.sketch.as_ref());
        let all_on = orthonormal(y.as_ref().subcols(0, 1));
        let (mut lightings, mut energies) = (Mat::zeros(self.sketch.nrows(), 0), Vec::new());
        for _ in 0..=power_iterations {
            let q = orthonormal_beside(all_on.as_ref(), &mut y);
            if q.ncols() == 0 {
                break;
            }
            // Rotated to the axes of `Qᵀ A K Aᵀ Q` and scaled to equal energy; otherwise weak directions would be lost
            // in rounding.
            let through = product(q.transpose(), few);
            let (values, vectors) = eigen(self.gram(through.as_ref()).as_ref());
            let strong = values.iter().take_while(|&&v| v > 1e-14 * values[0] && v > 0.0).count();
            let level = Mat::from_fn(vectors.nrows(), strong, |i, k| (vectors[(i, k)] / values[k].sqrt()) as f32);
            lightings = self.weigh(product(level.transpose(), through.as_ref()).as_ref());
            y = product(few, lightings.as_ref());
            energies = values[..strong].to_vec();
        }
        let wanted = wanted(lightings.as_ref(), &energies);
        let kept: Vec<usize> = (0..lightings.ncols()).filter(|&k| wanted[k]).collect();
        Mat::from_fn(lightings.nrows(), 1 + kept.len(), |j, k| if k == 0 { 1.0 } else { lightings[(j, kept[k - 1])] })
    }

    /// Mean energy of `rest` (rows × columns) under the sketch's draws.
    fn seen_of(&self, rest: MatRef<'_, f32>) -> f64 {
        let draws = self.sketch.as_ref().subcols(1, self.sketch.ncols() - 1);
        if draws.ncols() == 0 {
            return 0.0;
        }
        let norm = f64::from(product(rest, draws).norm_l2());
        norm * norm / draws.ncols() as f64
    }

    /// `b K bᵀ` for `b` (k × columns), in f64.
    pub(super) fn gram(&self, b: MatRef<'_, f32>) -> Mat<f64> {
        let through = to_f64(product(b, self.factor()).as_ref());
        let b = to_f64(b);
        let scaled = Mat::from_fn(b.nrows(), b.ncols(), |k, j| b[(k, j)] * f64::from(self.prior.independent()[j]));
        product_f64(through.as_ref(), through.transpose()) + product_f64(scaled.as_ref(), b.transpose())
    }
}

/// Finds the weighted range of `a` (rows × columns), at most `rank` wide, that contains the all-on image exactly. The
/// entries of `stray`, in any order, are to be added to `a`. They count in the all-on image and in `Uᵀ A`, but do not
/// shape the range.
///
/// The lightings that show the range best come from a sketch of the rows. So the block itself is multiplied only twice:
/// by those lightings, and by the basis of their images. Lightings are filtered by `wanted`, which gets the energies of
/// their images. The block is multiplied by `seen_under` (columns × any) as well; these images, without `stray`, are
/// returned too.
pub(super) fn find_range(
    a: MatRef<'_, f32>,
    stray: &[SparseEntry],
    weights: &PriorWeights,
    rank: usize,
    power_iterations: usize,
    seen_under: MatRef<'_, f32>,
    wanted: &Wanted<'_>,
) -> (Range, Mat<f32>) {
    let sketch = RowSketch::new(a.nrows());
    let few = sketch.rows_of(a);
    let lightings = weights.lightings_that_show(few.as_ref(), power_iterations, wanted);
    let mut y = product(a, beside(lightings.as_ref(), seen_under).as_ref());
    let seen = y.subcols(lightings.ncols(), seen_under.ncols()).to_owned();
    y.truncate(y.nrows(), lightings.ncols());
    stray.iter().for_each(|e| y[(e.row as usize, 0)] += e.value);
    let all_on = orthonormal(y.as_ref().subcols(0, 1));
    let mut others = y.subcols(1, y.ncols() - 1).to_owned();
    let q = orthonormal_beside(all_on.as_ref(), &mut others);
    let basis = beside(all_on.as_ref(), q.as_ref());
    let mut through = product(basis.transpose(), a);
    // Outliers are not to be represented by the range.
    let mut missed = few;
    subtract_product(&mut missed, sketch.rows_of(basis.as_ref()).as_ref(), through.as_ref());
    add_seen_of(&mut through, basis.as_ref(), stray);
    let mut range = components(all_on.as_ref(), q.as_ref(), through.as_ref(), weights, rank);
    range.tail += weights.seen_of(missed.as_ref());
    (range, seen)
}

/// The range of given images, the first of them all-on, with at most as many components as images. The entries of
/// `stray` count in `Uᵀ A`. The tail is left at 0.
pub(super) fn range_of(
    mut images: Mat<f32>,
    a: MatRef<'_, f32>,
    stray: &[SparseEntry],
    weights: &PriorWeights,
) -> Range {
    let rank = images.ncols();
    let all_on = orthonormal(images.as_ref().subcols(0, rank.min(1)));
    let q = orthonormal_beside(all_on.as_ref(), &mut images);
    let basis = beside(all_on.as_ref(), q.as_ref());
    let mut through = product(basis.transpose(), a);
    add_seen_of(&mut through, basis.as_ref(), stray);
    components(all_on.as_ref(), q.as_ref(), through.as_ref(), weights, rank)
}

/// `through += Uᵀ E` with the few entries of `E`.
fn add_seen_of(through: &mut Mat<f32>, basis: MatRef<'_, f32>, few: &[SparseEntry]) {
    for entry in few {
        let place = through.col_mut(entry.column.index());
        zip!(place, basis.row(entry.row as usize).transpose()).for_each(|unzip!(sum, u)| *sum += u * entry.value);
    }
}

/// The components of the range of `all_on` and `q`, which are orthonormal together, with `through = [all_on q]ᵀ A`. The
/// all-on direction stays, the others are rotated to the axes of the weighted energy. The tail is the energy beyond
/// `rank`.
fn components(
    all_on: MatRef<'_, f32>,
    q: MatRef<'_, f32>,
    through: MatRef<'_, f32>,
    weights: &PriorWeights,
    rank: usize,
) -> Range {
    let first = all_on.ncols();
    let (fixed, turned) = through.split_at_row(first);
    let (values, vectors) = eigen(weights.gram(turned).as_ref());
    let largest = values.first().copied().unwrap_or(0.0);
    let kept = values.iter().take_while(|&&v| v > 1e-14 * largest && v > 0.0).count();
    let kept = kept.min(rank.saturating_sub(first));
    let turn = to_f32(vectors.as_ref().subcols(0, kept));
    let mut left = to_vec(all_on);
    left.extend(to_vec(product(q, turn.as_ref()).as_ref()));
    let mut right = to_vec(fixed.transpose());
    right.extend(to_vec(product(turned.transpose(), turn.as_ref()).as_ref()));
    let fixed_gain = weights.gram(fixed);
    let gains: Vec<f64> = (0..first).map(|k| fixed_gain[(k, k)]).chain(values[..kept].iter().copied()).collect();
    debug_assert_eq!(left.len(), q.nrows() * gains.len());
    Range { left, right, gains, tail: values[kept..].iter().sum() }
}

/// A sketch of a block's rows: each of its rows is a sum of distant rows with random signs, so that squared norms keep
/// their mean (the sparse embedding of Clarkson and Woodruff 2013, with the same number of rows in every sum).
struct RowSketch {
    /// 1 or −1 for each row; empty if there are too few rows to sketch.
    signs: Vec<f32>,
}

/// Rows of a sketch: several times the widest range that is computed from it.
pub(super) const SKETCH_ROWS: usize = 256;

impl RowSketch {
    fn new(rows: usize) -> Self {
        if rows <= 2 * SKETCH_ROWS {
            return Self { signs: Vec::new() };
        }
        let mut random = Pcg64Mcg::seed_from_u64(0x726f_7773);
        Self { signs: (0..rows).map(|_| if random.random::<bool>() { 1.0 } else { -1.0 }).collect() }
    }

    /// The sketch of `a` (rows × columns): at most twice `SKETCH_ROWS` rows, as many columns.
    fn rows_of(&self, a: MatRef<'_, f32>) -> Mat<f32> {
        if self.signs.is_empty() {
            return a.to_owned();
        }
        let mut few = Mat::zeros(SKETCH_ROWS, a.ncols());
        dispatch(
            #[inline(always)]
            || {
                for j in 0..a.ncols() {
                    let column = a.col(j).try_as_col_major().expect("blocks stand column by column").as_slice();
                    let sums = few.col_as_slice_mut(j);
                    for (part, signs) in column.chunks(SKETCH_ROWS).zip(self.signs.chunks(SKETCH_ROWS)) {
                        for ((sum, value), sign) in sums.iter_mut().zip(part).zip(signs) {
                            *sum += value * sign;
                        }
                    }
                }
            },
        );
        few
    }
}

/// [`find_range`] for blocks of few columns, without a sketch. With the eigenvectors `V Λ Vᵀ` of `AᵀA`, `A = Q B` where
/// `Q = A V Λ^−½` is orthonormal. `B = Λ^½ Vᵀ` is small, so that all further work is done on `B`.
pub(super) fn exact_range(a: MatRef<'_, f32>, stray: &[SparseEntry], weights: &PriorWeights, rank: usize) -> Range {
    let n = a.ncols();
    let mut whole = to_f64(a);
    stray.iter().for_each(|e| whole[(e.row as usize, e.column.index())] += f64::from(e.value));
    let (values, v) = eigen(product_f64(whole.transpose(), whole.as_ref()).as_ref());
    // Smaller eigenvalues are rounding of the f32 entries.
    let rank_of_all = values.iter().take_while(|&&x| x > 1e-13 * values[0] && x > 0.0).count();
    let b = Mat::from_fn(rank_of_all, n, |k, j| v[(j, k)] * values[k].sqrt());
    let lit = Mat::from_fn(rank_of_all, 1, |k, _| (0..n).map(|j| b[(k, j)]).sum::<f64>());
    let mut energy = weights.gram(to_f32(b.as_ref()).as_ref());
    let length = lit.norm_l2();
    let mut turn = Mat::<f64>::zeros(rank_of_all, 0);
    let mut gains = Vec::new();
    if length > 0.0 {
        // All-on stays first, the rest follows.
        let first = Mat::from_fn(rank_of_all, 1, |k, _| lit[(k, 0)] / length);
        let through = product_f64(energy.as_ref(), first.as_ref());
        let gain = product_f64(first.transpose(), through.as_ref())[(0, 0)];
        gains.push(gain);
        energy = Mat::from_fn(rank_of_all, rank_of_all, |i, j| {
            let (x, y) = (first[(i, 0)], first[(j, 0)]);
            energy[(i, j)] - x * through[(j, 0)] - through[(i, 0)] * y + gain * x * y
        });
        turn = first;
    }
    let (rest, vectors) = eigen(energy.as_ref());
    let largest = rest.first().copied().unwrap_or(0.0);
    let room = rank.min(rank_of_all) - gains.len().min(rank).min(rank_of_all);
    let kept = rest.iter().take_while(|&&g| g > 1e-14 * largest && g > 0.0).count().min(room);
    gains.extend(&rest[..kept]);
    let first = turn.ncols();
    let turn =
        Mat::from_fn(rank_of_all, first + kept, |i, k| if k < first { turn[(i, k)] } else { vectors[(i, k - first)] });
    let mix = Mat::from_fn(n, turn.ncols(), |j, k| {
        (0..rank_of_all).map(|i| v[(j, i)] * turn[(i, k)] / values[i].sqrt()).sum::<f64>()
    });
    let left = to_f32(product_f64(whole.as_ref(), mix.as_ref()).as_ref());
    let right = to_f32(product_f64(b.transpose(), turn.as_ref()).as_ref());
    Range {
        left: to_vec(left.as_ref()),
        right: to_vec(right.as_ref()),
        gains,
        tail: rest[kept..].iter().sum::<f64>().max(0.0),
    }
}

/// Orthonormal basis of the part of `y` that is orthogonal to the orthonormal `fixed`.
fn orthonormal_beside(fixed: MatRef<'_, f32>, y: &mut Mat<f32>) -> Mat<f32> {
    let scale = y.norm_l2();
    let part = product(fixed.transpose(), y.as_ref());
    subtract_product(y, fixed, part.as_ref());
    if y.norm_l2() <= 3e-7 * scale {
        return Mat::zeros(y.nrows(), 0);
    }
    let mut q = orthonormal(y.as_ref());
    let part = product(fixed.transpose(), q.as_ref());
    subtract_product(&mut q, fixed, part.as_ref());
    // The square of the removed part is what unit length lacks: here less than f32 resolves.
    if part.norm_l2() < 1e-4 {
        return q;
    }
    // Directions that were only rounding of the first subtraction lie in `fixed` again and have little length left.
    // Normalising them would count the same direction twice.
    let (values, vectors) = eigen(gram(q.as_ref()).as_ref());
    let rank = values.iter().take_while(|&&v| v > 0.25).count();
    let scaled = Mat::from_fn(vectors.nrows(), rank, |i, j| vectors[(i, j)] / values[j].sqrt());
    product_in_f64(q.as_ref(), scaled.as_ref())
}

/// Two matrices of as many rows, side by side.
fn beside(a: MatRef<'_, f32>, b: MatRef<'_, f32>) -> Mat<f32> {
    let mut both = Mat::zeros(a.nrows(), a.ncols() + b.ncols());
    both.subcols_mut(0, a.ncols()).copy_from(a);
    both.subcols_mut(a.ncols(), b.ncols()).copy_from(b);
    both
}
