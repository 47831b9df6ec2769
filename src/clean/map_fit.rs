//! From the images of clusters to those of all columns, as the samples themselves say.

use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, Side};

use crate::light::Clusters;

/// Side of the squares of pixels whose means are compared: in them the noise of a column is an eighth of a pixel's.
pub const TILE: usize = 8;
/// What a direction of the fit must explain to be believed, in multiples of what noise alone explains in the mean.
const BELIEVED: f64 = 12.0;

/// Means of tiles of [`TILE`] × [`TILE`] pixels of planes of `width` × `height` pixels, one after the other; tiles row by row,
/// those at the right and lower edge may be smaller.
pub fn tile_means(planes: &[f32], (width, height): (usize, usize)) -> Vec<f32> {
    let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let mut means = Vec::with_capacity(planes.len() / (width * height) * across * down);
    for plane in planes.chunks_exact(width * height) {
        for rows in plane.chunks(TILE * width) {
            let rows_here = rows.len() / width;
            for left in (0..width).step_by(TILE) {
                let columns = TILE.min(width - left);
                let sum: f32 = rows.chunks_exact(width).flat_map(|row| &row[left..left + columns]).sum();
                means.push(sum / (rows_here * columns) as f32);
            }
        }
    }
    means
}

/// Sums over tiles from which the map `R`, clusters × columns, of `T ≈ D R` follows: `D` are the cleaned images of the clusters.
#[derive(Clone, Debug)]
pub struct MapFit {
    clusters: usize,
    columns: usize,
    /// `Dᵀ W D`, clusters × clusters.
    gram: Vec<f64>,
    /// `Dᵀ W T`, clusters × columns, row-major.
    cross: Vec<f64>,
    /// Diagonal of `Tᵀ W T`.
    energy: Vec<f64>,
    /// Sums of the columns of `W^½ T`.
    light: Vec<f64>,
    rows: u64,
}

impl MapFit {
    /// Of nothing yet.
    pub fn new(clusters: usize, columns: usize) -> Self {
        Self {
            clusters,
            columns,
            gram: vec![0.0; clusters * clusters],
            cross: vec![0.0; clusters * columns],
            energy: vec![0.0; columns],
            light: vec![0.0; columns],
            rows: 0,
        }
    }

    /// Adds one row: a tile and channel of every cluster's image and of every column, with the weight of its squared error.
    pub fn add(&mut self, images: &[f32], columns: &[f32], weight: f64) {
        for (i, &image) in images.iter().enumerate() {
            let weighted = weight * f64::from(image);
            for (sum, other) in self.gram[i * self.clusters..].iter_mut().zip(images) {
                *sum += weighted * f64::from(*other);
            }
            for (sum, value) in self.cross[i * self.columns..][..self.columns].iter_mut().zip(columns) {
                *sum += weighted * f64::from(*value);
            }
        }
        for ((energy, light), value) in self.energy.iter_mut().zip(&mut self.light).zip(columns) {
            let value = f64::from(*value);
            *energy += weight * value * value;
            *light += weight.sqrt() * value;
        }
        self.rows += 1;
    }

    /// The map, clusters × columns, row-major: least squares, but that each column stays at `map` (`spread`) in the directions,
    /// eigenvectors of `Dᵀ W D`, in which it explains no more than noise would: shrunk by the positive part of
    /// James and Stein (1961), the noise from what the whole fit leaves. Columns of a cluster add up to the cluster.
    pub fn fit(&self, clusters: &Clusters, map: &[f32]) -> Vec<f32> {
        let (k, n) = (self.clusters, self.columns);
        let gram = Mat::from_fn(k, k, |i, j| self.gram[i * k + j]);
        let Ok(eigen) = SelfAdjointEigen::new(gram.as_ref(), Side::Lower) else { return map.to_vec() };
        let (values, vectors) = (eigen.S(), eigen.U());
        let largest = (0..k).map(|i| values[i]).fold(0.0, f64::max);
        let mut fitted: Vec<f64> = map.iter().map(|&v| f64::from(v)).collect();
        for column in 0..n {
            let prior: Vec<f64> = (0..k).map(|i| f64::from(map[i * n + column])).collect();
            let cross = |i: usize| self.cross[i * n + column];
            let modelled: Vec<f64> = (0..k).map(|i| (0..k).map(|j| self.gram[i * k + j] * prior[j]).sum()).collect();
            let mut left = self.energy[column] + (0..k).map(|i| prior[i] * (modelled[i] - 2.0 * cross(i))).sum::<f64>();
            let steps: Vec<f64> = (0..k)
                .map(|d| match values[d] > 1e-9 * largest {
                    true => (0..k).map(|i| vectors[(i, d)] * (cross(i) - modelled[i])).sum::<f64>() / values[d],
                    false => 0.0,
                })
                .collect();
            left -= (0..k).map(|d| values[d].max(0.0) * steps[d] * steps[d]).sum::<f64>();
            let noise = left.max(0.0) / (self.rows as f64 - k as f64).max(1.0);
            for (d, step) in steps.iter().enumerate() {
                let explained = values[d].max(0.0) * step * step;
                if explained > BELIEVED * noise && explained > 0.0 {
                    let step = step * (1.0 - BELIEVED * noise / explained);
                    (0..k).for_each(|i| fitted[i * n + column] += step * vectors[(i, d)]);
                }
            }
        }
        self.keep_sums(clusters, &mut fitted);
        fitted.into_iter().map(|v| v as f32).collect()
    }

    /// What the columns of a cluster lack of their sum is given to them by their share of its light.
    fn keep_sums(&self, clusters: &Clusters, map: &mut [f64]) {
        let (k, n) = (self.clusters, self.columns);
        let members = |cluster: usize| {
            let of = move |&(_, own): &(usize, &u16)| usize::from(*own) == cluster;
            clusters.of_column().iter().enumerate().filter(of).map(|(column, _)| column)
        };
        for cluster in 0..k {
            let light: f64 = members(cluster).map(|column| self.light[column].max(0.0)).sum();
            let count = members(cluster).count() as f64;
            for i in 0..k {
                let sum: f64 = members(cluster).map(|column| map[i * n + column]).sum();
                let lacking = f64::from(u8::from(i == cluster)) - sum;
                for column in members(cluster) {
                    let share = if light > 0.0 { self.light[column].max(0.0) / light } else { 1.0 / count };
                    map[i * n + column] += share * lacking;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::spread;
    use super::*;
    use crate::light::{Light, LightBasis, LightKind, LightingPrior};

    #[test]
    fn tiles_are_means_and_may_be_smaller_at_the_edge() {
        let (width, height) = (TILE + 2, TILE + 1);
        let plane: Vec<f32> = (0..width * height).map(|i| if i % width < TILE { 1.0 } else { 3.0 }).collect();
        let means = tile_means(&[plane.clone(), plane.iter().map(|v| 2.0 * v).collect()].concat(), (width, height));
        assert_eq!(means, [1.0, 3.0, 1.0, 3.0, 2.0, 6.0, 2.0, 6.0]);
    }

    /// Columns of one cluster that differ in brightness by much, with noise: each keeps its own light.
    #[test]
    fn a_dark_and_a_bright_column_of_one_cluster_keep_their_light() {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 12, down: 12 })).unwrap();
        let clusters = Clusters::of_basis(&basis);
        let (k, n) = (clusters.count(), basis.column_count());
        let map = spread(&LightingPrior::of_basis(&basis), &clusters);
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let brightness: Vec<f32> = (0..n).map(|j| if j % 2 == 0 { 0.2 } else { 1.8 }).collect();
        let mut fit = MapFit::new(k, n);
        for _ in 0..400 {
            let shapes: Vec<f32> = (0..k).map(|_| 0.2 + random.random::<f32>()).collect();
            let column = |j: usize| brightness[j] * shapes[usize::from(clusters.of_column()[j])];
            let mut images = vec![0.0; k];
            (0..n).for_each(|j| images[usize::from(clusters.of_column()[j])] += column(j));
            let columns: Vec<f32> = (0..n).map(|j| column(j) * (0.75 + 0.5 * random.random::<f32>())).collect();
            fit.add(&images, &columns, 1.0);
        }
        let fitted = fit.fit(&clusters, &map);
        for cluster in 0..k {
            let members: Vec<usize> = (0..n).filter(|&j| usize::from(clusters.of_column()[j]) == cluster).collect();
            let whole: f32 = members.iter().map(|&j| brightness[j]).sum();
            let sum: f32 = members.iter().map(|&j| fitted[cluster * n + j]).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
            for &j in &members {
                let (found, right) = (fitted[cluster * n + j], brightness[j] / whole);
                assert!((found - right).abs() < 0.15 * right + 0.003, "column {j}: {found}, not {right}");
            }
        }
    }

    #[test]
    fn of_noise_alone_nothing_is_believed() {
        let mut basis = LightBasis::new();
        basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 12, down: 12 })).unwrap();
        let clusters = Clusters::of_basis(&basis);
        let (k, n) = (clusters.count(), basis.column_count());
        let map = spread(&LightingPrior::of_basis(&basis), &clusters);
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let mut fit = MapFit::new(k, n);
        for _ in 0..300 {
            let images: Vec<f32> = (0..k).map(|_| random.random::<f32>()).collect();
            let mean = |j: usize| (0..k).map(|i| images[i] * map[i * n + j]).sum::<f32>();
            let columns: Vec<f32> = (0..n).map(|j| mean(j) + 0.2 * (random.random::<f32>() - 0.5)).collect();
            fit.add(&images, &columns, 1.0);
        }
        let fitted = fit.fit(&clusters, &map);
        let moved: f32 = fitted.iter().zip(&map).map(|(a, b)| (a - b).powi(2)).sum();
        let noise = 0.04 / 12.0 / 300.0 * 12.0 * (k * n) as f32;
        assert!(moved < 0.5 * noise, "{moved}, where all of the noise would move {noise}");
    }
}
