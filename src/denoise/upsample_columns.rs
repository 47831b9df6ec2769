//! Fits the map from cluster images to the columns of all lights, from the samples themselves.

use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, Side};

use super::constants::{MIN_AGREEMENT, WHOLE_AGREEMENT};
use crate::light::Clusters;

/// Side, in pixels, of the tiles whose means are compared. The noise of a tile mean is an eighth of a pixel's.
pub const TILE: usize = 8;

/// Means of tiles of [`TILE`] × [`TILE`] pixels of planes of `width` × `height` pixels, plane by plane. Tiles are
/// ordered row by row; those at the right and lower border may be smaller.
pub fn tile_means(planes: &[f32], (width, height): (usize, usize)) -> Vec<f32> {
    let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let mut means = Vec::with_capacity(planes.len() / (width * height) * across * down);
    for plane in planes.chunks_exact(width * height) {
        for rows in plane.chunks(TILE * width) {
            let rows_here = rows.len() / width;
            for left in (0..width).step_by(TILE) {
                let columns = TILE.min(width - left);
                // By columns of the tile: sums along a row would wait for one another.
                let mut sums = [0.0f32; TILE];
                for row in rows.chunks_exact(width) {
                    sums.iter_mut().zip(&row[left..left + columns]).for_each(|(sum, value)| *sum += value);
                }
                means.push(sums.iter().sum::<f32>() / (rows_here * columns) as f32);
            }
        }
    }
    means
}

/// Sums over tiles for the map `R`, clusters × columns, of `T ≈ D R`. `D` are the denoised cluster images. Two halves
/// of the tiles are summed separately: what only one of them shows is noise.
#[derive(Clone, Debug)]
pub struct ColumnUpsampler {
    clusters: usize,
    columns: usize,
    halves: [ClusterSums; 2],
    /// Sums of the columns of `W^½ T`.
    light: Vec<f64>,
}

#[derive(Clone, Debug)]
struct ClusterSums {
    /// `Dᵀ W D`, clusters × clusters.
    gram: Vec<f64>,
    /// `Dᵀ W T`, clusters × columns, row-major.
    cross: Vec<f64>,
}

impl ColumnUpsampler {
    /// No tiles yet.
    pub fn new(clusters: usize, columns: usize) -> Self {
        let sums = ClusterSums { gram: vec![0.0; clusters * clusters], cross: vec![0.0; clusters * columns] };
        Self { clusters, columns, halves: [sums.clone(), sums], light: vec![0.0; columns] }
    }

    /// Bytes that a fit takes.
    pub fn needs_bytes(clusters: u64, columns: u64) -> u64 {
        // The sums of both halves, their steps along each direction, the map and its change.
        clusters * columns * (2 * 8 + 2 * 8 + 2 * 8 + 4)
    }

    /// Adds one row to half 0 or 1: one tile and channel of every cluster image and of every column, with the weight of
    /// its squared error.
    pub fn add(&mut self, half: usize, images: &[f32], columns: &[f32], weight: f64) {
        let ClusterSums { gram, cross } = &mut self.halves[half];
        for (i, &image) in images.iter().enumerate() {
            let weighted = weight * f64::from(image);
            for (sum, other) in gram[i * self.clusters..].iter_mut().zip(images) {
                *sum += weighted * f64::from(*other);
            }
            for (sum, value) in cross[i * self.columns..][..self.columns].iter_mut().zip(columns) {
                *sum += weighted * f64::from(*value);
            }
        }
        let root = weight.sqrt();
        self.light.iter_mut().zip(columns).for_each(|(light, value)| *light += root * f64::from(*value));
    }

    /// Adds the sums of other tiles.
    ///
    /// # Panics
    /// If the numbers of clusters or columns differ.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!((self.clusters, self.columns), (other.clusters, other.columns));
        for (into, from) in self.parts_mut().into_iter().zip(other.parts()) {
            into.iter_mut().zip(from).for_each(|(sum, part)| *sum += part);
        }
    }

    /// All sums, list by list.
    pub(super) fn parts(&self) -> impl Iterator<Item = &[f64]> {
        let [a, b] = &self.halves;
        [&a.gram, &a.cross, &b.gram, &b.cross, &self.light].into_iter().map(Vec::as_slice)
    }

    fn parts_mut(&mut self) -> [&mut Vec<f64>; 5] {
        let [a, b] = &mut self.halves;
        [&mut a.gram, &mut a.cross, &mut b.gram, &mut b.cross, &mut self.light]
    }

    /// Sums as [`parts`](Self::parts) gives them, in the machine's byte order; `None` if there are not as many.
    #[cfg(feature = "scene")]
    pub(super) fn from_values(clusters: usize, columns: usize, bytes: &[u8]) -> Option<Self> {
        let values = 2 * (clusters * clusters + clusters * columns) + columns;
        if bytes.len() != size_of::<f64>() * values {
            return None;
        }
        let mut values = bytes.chunks_exact(size_of::<f64>()).map(bytemuck::pod_read_unaligned);
        let mut sums = Self::new(clusters, columns);
        for part in sums.parts_mut() {
            part.iter_mut().zip(&mut values).for_each(|(sum, value)| *sum = value);
        }
        Some(sums)
    }

    /// The map, clusters × columns, row-major. It starts from the columns' shares of the light, and moves towards the
    /// least-squares solution along the eigenvectors of `Dᵀ W D`. The step along a direction is scaled by how well both
    /// halves of the tiles agree: 0 for a small correlation over all columns, 1 for a large one. The columns of a
    /// cluster still add up to the cluster.
    pub fn fit(&self, clusters: &Clusters) -> Vec<f32> {
        let (k, n) = (self.clusters, self.columns);
        let mut map = self.shares(clusters);
        let [a, b] = &self.halves;
        let gram = Mat::from_fn(k, k, |i, j| a.gram[i * k + j] + b.gram[i * k + j]);
        if let Ok(eigen) = SelfAdjointEigen::new(gram.as_ref(), Side::Lower) {
            let (values, vectors) = (eigen.S(), eigen.U());
            let least = 1e-9 * (0..k).map(|i| values[i]).fold(0.0, f64::max);
            let mut moved = map.clone();
            for direction in (0..k).filter(|&d| values[d] > least) {
                let vector: Vec<f64> = (0..k).map(|i| vectors[(i, direction)]).collect();
                let [from_a, from_b] = [a, b].map(|half| self.steps(half, &vector, values[direction], clusters, &map));
                let pairs = || from_a.iter().zip(&from_b);
                let agreed: f64 = pairs().map(|(x, y)| x * y).sum();
                let said: f64 = pairs().map(|(x, y)| 0.25 * (x + y) * (x + y)).sum();
                let agreement = if said > 0.0 { agreed / said } else { 0.0 };
                let trust = ((agreement - MIN_AGREEMENT) / (WHOLE_AGREEMENT - MIN_AGREEMENT)).clamp(0.0, 1.0);
                for (column, (x, y)) in pairs().enumerate() {
                    let step = trust * 0.5 * (x + y);
                    vector.iter().enumerate().for_each(|(i, v)| moved[i * n + column] += step * v);
                }
            }
            map = moved;
        }
        self.keep_sums(clusters, &mut map);
        map.into_iter().map(|v| v as f32).collect()
    }

    /// How far one half of the tiles wants each column moved along an eigenvector of `Dᵀ W D`, of which it has half.
    fn steps(&self, half: &ClusterSums, vector: &[f64], value: f64, clusters: &Clusters, map: &[f64]) -> Vec<f64> {
        let (k, n) = (self.clusters, self.columns);
        let step = |(column, &own): (usize, &u16)| {
            let own = usize::from(own);
            let left = |i: usize| half.cross[i * n + column] - half.gram[i * k + own] * map[own * n + column];
            2.0 / value * vector.iter().enumerate().map(|(i, v)| v * left(i)).sum::<f64>()
        };
        clusters.of_column().iter().enumerate().map(step).collect()
    }

    /// Each column as its cluster's image, scaled to its share of the light.
    fn shares(&self, clusters: &Clusters) -> Vec<f64> {
        let mut map = vec![0.0; self.clusters * self.columns];
        for (cluster, members) in members(clusters).iter().enumerate() {
            for (column, share) in self.shares_of(members) {
                map[cluster * self.columns + column] = share;
            }
        }
        map
    }

    /// Distributes what the columns of a cluster lack of their sum, by their shares of its light.
    fn keep_sums(&self, clusters: &Clusters, map: &mut [f64]) {
        let n = self.columns;
        for (cluster, members) in members(clusters).iter().enumerate() {
            let shares: Vec<_> = self.shares_of(members).collect();
            for (i, row) in map.chunks_exact_mut(n).enumerate() {
                let sum: f64 = members.iter().map(|&column| row[column]).sum();
                let lacking = f64::from(u8::from(i == cluster)) - sum;
                shares.iter().for_each(|&(column, share)| row[column] += share * lacking);
            }
        }
    }

    /// Each of these columns with its share of their light.
    fn shares_of(&self, members: &[usize]) -> impl Iterator<Item = (usize, f64)> {
        let light: f64 = members.iter().map(|&column| self.light[column].max(0.0)).sum();
        let even = 1.0 / members.len() as f64;
        members
            .iter()
            .map(move |&column| (column, if light > 0.0 { self.light[column].max(0.0) / light } else { even }))
    }
}

/// The columns of each cluster.
fn members(clusters: &Clusters) -> Vec<Vec<usize>> {
    let mut members = vec![Vec::new(); clusters.count()];
    for (column, &own) in clusters.of_column().iter().enumerate() {
        members[usize::from(own)].push(column);
    }
    members
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::light::{Light, LightBasis, LightKind};

    #[test]
    fn tiles_are_means_and_may_be_smaller_at_the_edge() {
        let (width, height) = (TILE + 2, TILE + 1);
        let plane: Vec<f32> = (0..width * height).map(|i| if i % width < TILE { 1.0 } else { 3.0 }).collect();
        let means = tile_means(&[plane.clone(), plane.iter().map(|v| 2.0 * v).collect()].concat(), (width, height));
        assert_eq!(means, [1.0, 3.0, 1.0, 3.0, 2.0, 6.0, 2.0, 6.0]);
    }

    /// The clusters of a panel.
    fn panel() -> Clusters {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 12, down: 12 })).unwrap();
        Clusters::of_basis(&basis)
    }

    /// The fit to tiles whose cluster images lie between 0.2 and 1.2. `column` computes each column from these; `noise`
    /// is the σ added to it.
    fn fitted(clusters: &Clusters, tiles: usize, noise: f32, column: impl Fn(usize, &[f32]) -> f32) -> Vec<f32> {
        let (k, n) = (clusters.count(), clusters.of_column().len());
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut fit = ColumnUpsampler::new(k, n);
        for tile in 0..tiles {
            let images: Vec<f32> = (0..k).map(|_| 0.2 + random.random::<f32>()).collect();
            let columns: Vec<f32> =
                (0..n).map(|j| column(j, &images) * (1.0 + noise * (random.random::<f32>() - 0.5))).collect();
            fit.add(tile % 2, &images, &columns, 1.0);
        }
        fit.fit(clusters)
    }

    fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
    }

    /// Noisy columns of one cluster that differ much in brightness: each keeps its own light.
    #[test]
    fn a_dark_and_a_bright_column_of_one_cluster_keep_their_light() {
        let clusters = panel();
        let n = clusters.of_column().len();
        let own = |j: usize| usize::from(clusters.of_column()[j]);
        let brightness = |j: usize| [0.2, 1.8][j % 2];
        let whole = |cluster: usize| -> f32 { (0..n).filter(|&j| own(j) == cluster).map(brightness).sum() };
        let fitted = fitted(&clusters, 400, 0.5, |j, images| images[own(j)] * brightness(j) / whole(own(j)));
        for cluster in 0..clusters.count() {
            let sum: f32 = (0..n).filter(|&j| own(j) == cluster).map(|j| fitted[cluster * n + j]).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
        for j in 0..n {
            let (found, right) = (fitted[own(j) * n + j], brightness(j) / whole(own(j)));
            assert!((found - right).abs() < 0.15 * right + 0.003, "column {j}: {found}, not {right}");
        }
    }

    /// Columns that are mixtures of their cluster and the next one.
    #[test]
    fn what_both_halves_of_the_tiles_say_is_taken() {
        let clusters = panel();
        let (k, n) = (clusters.count(), clusters.of_column().len());
        let mut right = vec![0.0; k * n];
        for (cluster, members) in members(&clusters).iter().enumerate() {
            for (at, &j) in members.iter().enumerate() {
                right[cluster * n + j] = 1.0 / members.len() as f32;
                // Every other member mixes in the next cluster, the one after it subtracts it.
                let lean = if at + 1 == members.len() && at % 2 == 0 { 0.0 } else { [0.05, -0.05][at % 2] };
                right[(cluster + 1) % k * n + j] += lean;
            }
        }
        let column = |j: usize, images: &[f32]| (0..k).map(|i| images[i] * right[i * n + j]).sum::<f32>();
        let begun = fitted(&clusters, 2, 0.0, |j, images| images[usize::from(clusters.of_column()[j])]);
        let fitted = fitted(&clusters, 2000, 0.5, column);
        let (before, after) = (squared_distance(&begun, &right), squared_distance(&fitted, &right));
        assert!(after < 0.1 * before, "{after} of {before}");
    }

    #[test]
    fn of_noise_alone_nothing_is_believed() {
        let clusters = panel();
        let n = clusters.of_column().len();
        let own = |j: usize| usize::from(clusters.of_column()[j]);
        let share = |j: usize| 1.0 / members(&clusters)[own(j)].len() as f32;
        let fitted = fitted(&clusters, 300, 2.0, |j, images| images[own(j)] * share(j));
        let elsewhere: f32 = (0..fitted.len()).filter(|&at| at / n != own(at % n)).map(|at| fitted[at].powi(2)).sum();
        let size: f32 = (0..n).map(|j| share(j).powi(2)).sum();
        assert!(elsewhere < 1e-3 * size, "{elsewhere} of {size}");
    }
}
