//! k-means over the columns of a dense matrix, and the members nearest to its centres.

use faer::{Mat, MatRef};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use crate::compress::dense::product;

/// Indices of the points (columns of `points`, dimension × count) that stand nearest to the centres of `k` clusters,
/// rising and without duplicates; fewer than `k` where points coincide.
///
/// Seeding is k-means++ (Arthur and Vassilvitskii 2007), the iteration Lloyd's. A centre is not a point (the paper,
/// §3.2, needs rows and columns of the matrix), so the nearest member stands for it.
pub(in crate::compress) fn nearest_to_centres(
    points: MatRef<'_, f32>,
    k: usize,
    iterations: usize,
    random: &mut Pcg64Mcg,
) -> Vec<usize> {
    let count = points.ncols();
    if k >= count {
        return (0..count).collect();
    }
    let clusters = Centres::new(points, k, iterations, random);
    let nearest = clusters.nearest(points);
    let mut chosen: Vec<usize> = nearest.into_iter().map(|(_, j)| j).filter(|&j| j != usize::MAX).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Centres of clusters, with how many points each has seen.
pub(in crate::compress) struct Centres {
    /// Dimension × clusters.
    centres: Mat<f32>,
    seen: Vec<f64>,
}

/// What some points add to each cluster: their sums (dimension × clusters) and numbers.
pub(in crate::compress) struct CentreSums {
    sums: Mat<f64>,
    counts: Vec<f64>,
}

impl Centres {
    /// k-means++ and Lloyd's iteration over `points`; fewer than `k` clusters where points coincide.
    pub(in crate::compress) fn new(
        points: MatRef<'_, f32>,
        k: usize,
        iterations: usize,
        random: &mut Pcg64Mcg,
    ) -> Self {
        let mut centres = seed(points, &squared_norms(points), k, random);
        let mut owners = Vec::new();
        for iteration in 0..=iterations {
            owners = assign(points, &centres).0;
            if iteration < iterations {
                centres = means(points, &owners, &centres);
            }
        }
        let mut seen = vec![0.0; centres.ncols()];
        owners.into_iter().for_each(|owner| seen[owner] += 1.0);
        Self { centres, seen }
    }

    /// Number of clusters.
    pub(in crate::compress) fn count(&self) -> usize {
        self.seen.len()
    }

    /// For each cluster, the squared distance and index of its member nearest to the centre; infinite where none of
    /// `points` is a member.
    pub(in crate::compress) fn nearest(&self, points: MatRef<'_, f32>) -> Vec<(f32, usize)> {
        let (owners, distances) = assign(points, &self.centres);
        let mut nearest = vec![(f32::INFINITY, usize::MAX); self.count()];
        for (j, (owner, distance)) in owners.into_iter().zip(distances).enumerate() {
            let best = &mut nearest[owner];
            if distance < best.0 {
                *best = (distance, j);
            }
        }
        nearest
    }

    /// What `points` add to the clusters they belong to.
    pub(in crate::compress) fn sums(&self, points: MatRef<'_, f32>) -> CentreSums {
        let (mut sums, mut counts) = (Mat::zeros(points.nrows(), self.count()), vec![0.0; self.count()]);
        for (j, owner) in assign(points, &self.centres).0.into_iter().enumerate() {
            counts[owner] += 1.0;
            for i in 0..points.nrows() {
                sums[(i, owner)] += f64::from(points[(i, j)]);
            }
        }
        CentreSums { sums, counts }
    }

    /// Moves each centre to the mean of all points it has seen, those of a mini-batch now among them (Sculley 2010).
    pub(in crate::compress) fn follow<'a>(&mut self, batch: impl Iterator<Item = &'a CentreSums> + Clone) {
        for c in 0..self.count() {
            let more: f64 = batch.clone().map(|part| part.counts[c]).sum();
            if more == 0.0 {
                continue;
            }
            let before = self.seen[c];
            self.seen[c] += more;
            for i in 0..self.centres.nrows() {
                let added: f64 = batch.clone().map(|part| part.sums[(i, c)]).sum();
                self.centres[(i, c)] = ((f64::from(self.centres[(i, c)]) * before + added) / self.seen[c]) as f32;
            }
        }
    }
}

fn squared_norms(points: MatRef<'_, f32>) -> Vec<f32> {
    (0..points.ncols()).map(|j| points.col(j).squared_norm_l2()).collect()
}

fn seed(points: MatRef<'_, f32>, norms: &[f32], k: usize, random: &mut Pcg64Mcg) -> Mat<f32> {
    let count = points.ncols();
    let mut chosen = vec![random.random_range(0..count)];
    let mut distances = vec![f32::INFINITY; count];
    while chosen.len() < k {
        let last = *chosen.last().expect("one is chosen");
        let dots = product(points.transpose(), points.subcols(last, 1));
        for j in 0..count {
            let d = (norms[j] + norms[last] - 2.0 * dots[(j, 0)]).max(0.0);
            distances[j] = distances[j].min(d);
        }
        distances[last] = 0.0;
        let total: f64 = distances.iter().map(|&d| f64::from(d)).sum();
        if total <= 0.0 {
            break;
        }
        let mut at = random.random::<f64>() * total;
        let next = distances.iter().position(|&d| {
            at -= f64::from(d);
            d > 0.0 && at <= 0.0
        });
        let fallback = || distances.iter().rposition(|&d| d > 0.0).expect("the total is not 0");
        chosen.push(next.unwrap_or_else(fallback));
    }
    Mat::from_fn(points.nrows(), chosen.len(), |i, c| points[(i, chosen[c])])
}

/// The cluster that each point belongs to, and its squared distance to the centre.
fn assign(points: MatRef<'_, f32>, centres: &Mat<f32>) -> (Vec<usize>, Vec<f32>) {
    let (norms, centre_norms) = (squared_norms(points), squared_norms(centres.as_ref()));
    let dots = product(centres.transpose(), points);
    let mut to_centre = vec![0.0f32; centre_norms.len()];
    let nearest = |j: usize| {
        // First the minimum, then the first index that has it: without a dependency from centre to centre.
        for ((d, norm), dot) in to_centre.iter_mut().zip(&centre_norms).zip(dots.col_as_slice(j)) {
            *d = norm - 2.0 * dot;
        }
        let least = smallest(&to_centre);
        let owner = to_centre.iter().position(|&d| d == least).unwrap_or(0);
        (owner, (norms[j] + least).max(0.0))
    };
    (0..points.ncols()).map(nearest).unzip()
}

/// The smallest of some values; infinite if all are NaN.
fn smallest(values: &[f32]) -> f32 {
    let mut lanes = [f32::INFINITY; 16];
    let (whole, rest) = values.as_chunks::<16>();
    for values in whole {
        lanes.iter_mut().zip(values).for_each(|(lane, &v)| *lane = if v < *lane { v } else { *lane });
    }
    rest.iter().chain(&lanes).fold(f32::INFINITY, |least, &v| if v < least { v } else { least })
}

fn means(points: MatRef<'_, f32>, owners: &[usize], old: &Mat<f32>) -> Mat<f32> {
    let mut sums = Mat::<f32>::zeros(old.nrows(), old.ncols());
    let mut counts = vec![0usize; old.ncols()];
    for (j, &owner) in owners.iter().enumerate() {
        counts[owner] += 1;
        let mut sum = sums.col_mut(owner);
        sum += points.col(j);
    }
    for (c, &count) in counts.iter().enumerate() {
        for i in 0..old.nrows() {
            sums[(i, c)] = if count > 0 { sums[(i, c)] / count as f32 } else { old[(i, c)] };
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn separated_clusters_each_give_one_member() {
        let points = Mat::from_fn(2, 30, |i, j| (j % 3) as f32 * 10.0 * (1.0 + i as f32) + (j / 3) as f32 * 0.01);
        let chosen = nearest_to_centres(points.as_ref(), 3, 10, &mut Pcg64Mcg::seed_from_u64(1));
        let mut clusters: Vec<_> = chosen.iter().map(|j| j % 3).collect();
        clusters.sort_unstable();
        assert_eq!(clusters, [0, 1, 2]);
    }

    #[test]
    fn equal_points_give_one_member() {
        let points = Mat::from_fn(4, 9, |_, _| 2.0);
        assert_eq!(nearest_to_centres(points.as_ref(), 3, 5, &mut Pcg64Mcg::seed_from_u64(1)).len(), 1);
    }
}
