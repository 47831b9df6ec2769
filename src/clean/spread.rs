//! From the images of clusters to those of all columns.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::light::{Clusters, LightingPrior};

/// `M = (Sᵀ K S)⁻¹ Sᵀ K`, clusters × columns, row-major; where every column is a cluster, the identity.
///
/// With the covariance `K` of lightings and the 0/1 matrix `S`, columns × clusters, the image of a lighting `ℓ` that the
/// images `T S` of the clusters tell best is `T S M ℓ`, in the mean over lightings.
pub fn spread(prior: &LightingPrior, clusters: &Clusters) -> Vec<f32> {
    let (k, n) = (clusters.count(), prior.columns());
    if k == n {
        return (0..k * n).map(|i| if i / n == i % n { 1.0 } else { 0.0 }).collect();
    }
    // Sᵀ F and Sᵀ K = (Sᵀ F) Fᵀ + Sᵀ diag d.
    let width = prior.width();
    let factor = |column: usize, j: usize| f64::from(prior.factor()[j * n + column]);
    let mut summed = Mat::<f64>::zeros(k, width);
    for (column, &cluster) in clusters.of_column().iter().enumerate() {
        (0..width).for_each(|j| summed[(usize::from(cluster), j)] += factor(column, j));
    }
    let covariance = |cluster: usize, column: usize| {
        let own = usize::from(clusters.of_column()[column]) == cluster;
        let shared: f64 = (0..width).map(|j| summed[(cluster, j)] * factor(column, j)).sum();
        shared + if own { f64::from(prior.independent()[column]) } else { 0.0 }
    };
    let towards = Mat::from_fn(k, n, covariance);
    let mut between = Mat::<f64>::zeros(k, k);
    for (column, &cluster) in clusters.of_column().iter().enumerate() {
        (0..k).for_each(|i| between[(i, usize::from(cluster))] += towards[(i, column)]);
    }
    let solved = match between.llt(Side::Lower) {
        Ok(solver) => solver.solve(&towards),
        Err(_) => between.partial_piv_lu().solve(&towards),
    };
    (0..k).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| solved[(i, j)] as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{Light, LightBasis, LightKind};

    #[test]
    fn sums_of_whole_clusters_are_spread_without_loss() {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 12, down: 12 })).unwrap();
        let clusters = Clusters::of_basis(&basis);
        let spread = spread(&LightingPrior::of_basis(&basis), &clusters);
        let columns = basis.column_count();
        for (row, weights) in spread.chunks_exact(columns).enumerate() {
            let mut sums = vec![0.0f64; clusters.count()];
            for (column, weight) in weights.iter().enumerate() {
                sums[usize::from(clusters.of_column()[column])] += f64::from(*weight);
            }
            for (cluster, sum) in sums.iter().enumerate() {
                assert!((sum - f64::from(u8::from(cluster == row))).abs() < 1e-4, "{row} of {cluster}: {sum}");
            }
        }
    }
}
