//! The paper's column and row selection (§3.2) and the CUR decompositions over it.

use faer::{Mat, MatRef};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::dense::{product, product_f64, solve_least_squares, to_f32, to_f64};
use super::kmeans::nearest_to_centres;
use super::{CompressSettings, Core, Method};
use crate::matrix::BlockView;

/// Rows and columns of a block, rising and without duplicates.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Chosen columns.
    pub columns: Vec<usize>,
    /// Chosen rows.
    pub rows: Vec<usize>,
}

/// `count` of `0..of` at random, rising.
fn at_random(of: usize, count: usize, random: &mut Pcg64Mcg) -> Vec<usize> {
    let count = count.min(of);
    let mut all: Vec<usize> = (0..of).collect();
    for i in 0..count {
        all.swap(i, random.random_range(i..of));
    }
    all.truncate(count);
    all.sort_unstable();
    all
}

/// Chooses rows and columns of `a` (rows × columns) by Algorithm 1, 2, 3 or 4 of the paper.
pub(super) fn select(a: MatRef<'_, f32>, settings: &CompressSettings, random: &mut Pcg64Mcg) -> Selection {
    let (m, n) = a.shape();
    let k = settings.rank.min(n).min(m);
    let wanted_rows = match settings.core {
        Core::Textbook => k,
        Core::LeastSquares | Core::Projection => ((k as f64 * settings.rows_per_column).ceil() as usize).min(m),
    };
    let columns_of = |columns: &[usize]| Mat::from_fn(m, columns.len(), |i, c| a[(i, columns[c])]);
    let rows_by_kmeans = |columns: &[usize], count: usize, random: &mut Pcg64Mcg| {
        // Rows are the points: transposed, so that a point is contiguous.
        let points = columns_of(columns).transpose().to_owned();
        nearest_to_centres(points.as_ref(), count, settings.kmeans_iterations, random)
    };
    match settings.method {
        Method::Algorithm1 => {
            let rows = at_random(m, wanted_rows, random);
            let points = Mat::from_fn(rows.len(), n, |r, j| a[(rows[r], j)]);
            Selection { columns: nearest_to_centres(points.as_ref(), k, settings.kmeans_iterations, random), rows }
        }
        Method::Algorithm2 => {
            let columns = at_random(n, k, random);
            Selection { rows: rows_by_kmeans(&columns, wanted_rows, random), columns }
        }
        Method::Algorithm3 => Selection { columns: at_random(n, k, random), rows: at_random(m, wanted_rows, random) },
        // Algorithm 4 and the proposed method.
        _ => {
            let rounds = settings.rounds.clamp(1, k.max(1));
            let each = if settings.columns == 0 { k.div_ceil(rounds) } else { settings.columns };
            let fresh = at_random(n, n, random);
            let mut order = fresh;
            // A random order, so that each round's columns are *other* columns.
            for i in (1..n).rev() {
                order.swap(i, random.random_range(0..=i));
            }
            let mut chosen = Selection::default();
            for columns in order.chunks(each).take(rounds) {
                let columns = &columns[..columns.len().min(k.saturating_sub(chosen.columns.len()))];
                if columns.is_empty() {
                    break;
                }
                let share = (wanted_rows * columns.len()).div_ceil(k);
                chosen.rows.extend(rows_by_kmeans(columns, share, random));
                chosen.columns.extend(columns);
            }
            chosen.columns.sort_unstable();
            chosen.rows.sort_unstable();
            chosen.rows.dedup();
            chosen
        }
    }
}

/// The CUR decomposition of `a` over a selection, as two factors: rows × k and k × columns.
pub(super) fn decompose(a: MatRef<'_, f32>, chosen: &Selection, core: Core, truncation: f64) -> (Mat<f32>, Mat<f32>) {
    let (m, n) = a.shape();
    let c = Mat::from_fn(m, chosen.columns.len(), |i, k| a[(i, chosen.columns[k])]);
    let right = match core {
        Core::Projection => {
            // C C⁺ A with the truncated range of C: with C = U S Vᵀ, C⁺ A = V S⁻¹ Uᵀ A.
            let gram = product_f64(to_f64(c.transpose()).as_ref(), to_f64(c.as_ref()).as_ref());
            let cross = to_f64(product(c.transpose(), a).as_ref());
            // A cut of 1e-6 of the squared singular values is 1e-3 of theirs; f32 products carry no more.
            solve_least_squares(gram.as_ref(), cross.as_ref(), truncation.powi(2).max(1e-6))
        }
        Core::LeastSquares | Core::Textbook => {
            let rows = &chosen.rows;
            let w = Mat::from_fn(rows.len(), chosen.columns.len(), |i, k| f64::from(a[(rows[i], chosen.columns[k])]));
            let r = Mat::from_fn(rows.len(), n, |i, j| f64::from(a[(rows[i], j)]));
            if core == Core::LeastSquares {
                solve_least_squares(w.as_ref(), r.as_ref(), truncation)
            } else {
                // The inverse is formed and multiplied in the precision of the data, as the formula reads.
                let unit = Mat::<f64>::identity(rows.len(), rows.len());
                let inverse = to_f32(solve_least_squares(w.as_ref(), unit.as_ref(), 0.0).as_ref());
                to_f64(product(inverse.as_ref(), to_f32(r.as_ref()).as_ref()).as_ref())
            }
        }
    };
    (c, to_f32(right.as_ref()))
}

/// A block's CUR decomposition by one of the paper's algorithms exactly as it comes: `C` (rows × k, column-major),
/// `core · R` (k × columns, row-major) and the selection. For comparison; [`Compressor`](super::Compressor) goes on to
/// orthonormal factors.
pub fn cur(block: BlockView<'_>, settings: &CompressSettings, seed: u64) -> (Vec<f32>, Vec<f32>, Selection) {
    use rand::SeedableRng;
    let a = MatRef::from_column_major_slice(block.entries(), block.rows(), block.columns());
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let chosen = select(a, settings, &mut random);
    let (left, right) = decompose(a, &chosen, settings.core, settings.truncation);
    (super::dense::to_vec(left.as_ref()), super::dense::to_vec(right.transpose()), chosen)
}
