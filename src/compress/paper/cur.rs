//! The paper's column and row selection (§3.2) and the CUR decompositions over it.

use std::collections::HashMap;

use faer::{Mat, MatRef};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::kmeans::nearest_to_centres;
use crate::compress::dense::{product, product_f64, solve_least_squares, to_f32, to_f64};
use crate::compress::{CompressSettings, Core, Method};
use crate::matrix::BlockView;

/// Rows and columns of a block, rising and without duplicates.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CurSelection {
    /// Chosen columns.
    pub columns: Vec<usize>,
    /// Chosen rows.
    pub rows: Vec<usize>,
}

/// Combined with the seed of the selections.
pub(in crate::compress) const SEED: u64 = 0x0063_7572;

/// The random part of a selection, and what k-means must find.
pub(in crate::compress) enum Plan {
    /// Algorithm 1: the sampled rows, and the number of columns to find by k-means over them.
    ByRows { rows: Vec<usize>, columns: usize },
    /// Algorithms 2 and 4: for each round its columns, and the number of rows to find by k-means over them.
    ByColumns { rounds: Vec<(Vec<usize>, usize)> },
    /// Algorithm 3: nothing is left to find.
    Both(CurSelection),
}

/// `count` distinct numbers of `0..of` at random, ascending; memory grows with `count` only.
pub(in crate::compress) fn at_random(of: usize, count: usize, random: &mut Pcg64Mcg) -> Vec<usize> {
    let count = count.min(of);
    // A sparse Fisher–Yates shuffle that stores only swapped positions.
    let mut swapped = HashMap::new();
    let mut drawn: Vec<usize> = (0..count)
        .map(|i| {
            let at = random.random_range(i..of);
            let here = swapped.get(&i).copied().unwrap_or(i);
            swapped.insert(at, here).unwrap_or(at)
        })
        .collect();
    drawn.sort_unstable();
    drawn
}

/// Draws what Algorithm 1, 2, 3 or 4 draws for a matrix of `m` rows and `n` columns.
pub(in crate::compress) fn plan(m: usize, n: usize, settings: &CompressSettings, random: &mut Pcg64Mcg) -> Plan {
    let k = settings.rank.min(n).min(m);
    let wanted_rows = match settings.core {
        Core::Textbook => k,
        Core::LeastSquares | Core::Projection => ((k as f64 * settings.rows_per_column).ceil() as usize).min(m),
    };
    match settings.method {
        Method::Algorithm1 => Plan::ByRows { rows: at_random(m, wanted_rows, random), columns: k },
        Method::Algorithm2 => Plan::ByColumns { rounds: vec![(at_random(n, k, random), wanted_rows)] },
        Method::Algorithm3 => {
            let columns = at_random(n, k, random);
            Plan::Both(CurSelection { columns, rows: at_random(m, wanted_rows, random) })
        }
        // Algorithm 4 and the proposed method.
        _ => {
            let rounds = settings.rounds.clamp(1, k.max(1));
            let each = settings.columns_per_round.unwrap_or(k.div_ceil(rounds));
            let mut order = at_random(n, n, random);
            // A random order, so that each round's columns are *other* columns.
            for i in (1..n).rev() {
                order.swap(i, random.random_range(0..=i));
            }
            let (mut planned, mut taken) = (Vec::new(), 0);
            for columns in order.chunks(each).take(rounds) {
                let columns = &columns[..columns.len().min(k - taken)];
                if columns.is_empty() {
                    break;
                }
                taken += columns.len();
                planned.push((columns.to_vec(), (wanted_rows * columns.len()).div_ceil(k)));
            }
            Plan::ByColumns { rounds: planned }
        }
    }
}

/// Chooses rows and columns of `a` (rows × columns) by Algorithm 1, 2, 3 or 4 of the paper.
pub(in crate::compress) fn select(
    a: MatRef<'_, f32>,
    settings: &CompressSettings,
    random: &mut Pcg64Mcg,
) -> CurSelection {
    let (m, n) = a.shape();
    match plan(m, n, settings, random) {
        Plan::ByRows { rows, columns } => {
            let points = Mat::from_fn(rows.len(), n, |r, j| a[(rows[r], j)]);
            CurSelection {
                columns: nearest_to_centres(points.as_ref(), columns, settings.kmeans_iterations, random),
                rows,
            }
        }
        Plan::Both(chosen) => chosen,
        Plan::ByColumns { rounds } => {
            let mut chosen = CurSelection::default();
            for (columns, count) in rounds {
                // Rows are the points: transposed, so that a point is contiguous.
                let points = Mat::from_fn(columns.len(), m, |c, i| a[(i, columns[c])]);
                let rows = nearest_to_centres(points.as_ref(), count, settings.kmeans_iterations, random);
                chosen.rows.extend(rows);
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
pub(in crate::compress) fn decompose(
    a: MatRef<'_, f32>,
    chosen: &CurSelection,
    core: Core,
    truncation: f64,
) -> (Mat<f32>, Mat<f32>) {
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
            let r = Mat::from_fn(rows.len(), n, |i, j| a[(rows[i], j)]);
            return (c, through_core(w.as_ref(), r.as_ref(), core, truncation));
        }
    };
    (c, to_f32(right.as_ref()))
}

/// `U R` of the crossing `W` (rows × k) and the chosen rows `R` (rows × columns).
pub(in crate::compress) fn through_core(
    w: MatRef<'_, f64>,
    r: MatRef<'_, f32>,
    core: Core,
    truncation: f64,
) -> Mat<f32> {
    if core == Core::Textbook {
        // The inverse is formed and multiplied in the precision of the data, as the formula reads.
        let unit = Mat::<f64>::identity(w.nrows(), w.nrows());
        let inverse = to_f32(solve_least_squares(w, unit.as_ref(), 0.0).as_ref());
        return product(inverse.as_ref(), r);
    }
    to_f32(solve_least_squares(w, to_f64(r).as_ref(), truncation).as_ref())
}

/// A block's CUR decomposition by one of the paper's algorithms exactly as it comes: `C` (rows × k, column-major),
/// `core · R` (k × columns, row-major) and the selection. For comparison; [`Compressor`](crate::compress::Compressor) goes on to
/// orthonormal factors.
pub fn cur(block: BlockView<'_>, settings: &CompressSettings, seed: u64) -> (Vec<f32>, Vec<f32>, CurSelection) {
    use rand::SeedableRng;
    let a = MatRef::from_column_major_slice(block.entries(), block.rows(), block.columns());
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let chosen = select(a, settings, &mut random);
    let (left, right) = decompose(a, &chosen, settings.core, settings.truncation);
    (crate::compress::dense::to_vec(left.as_ref()), crate::compress::dense::to_vec(right.transpose()), chosen)
}
