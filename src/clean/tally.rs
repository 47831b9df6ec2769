//! Which mixtures of the clusters' images tell pixels apart best, learnt from all blocks in any order.

use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, Side};

use super::Window;
use super::constants::GUIDES;
use super::rows::Rows;

/// Sums are kept in units of this, as integers, so that they do not depend on the order of blocks.
const UNIT: f64 = 1.0 / (1u64 << 30) as f64;

/// Second moments of the clusters' images over pixels, each pixel scaled to the same brightness, between the two halves of
/// the samples: the noise of one half does not show in the other.
#[derive(Clone, Debug)]
pub struct Tally {
    clusters: usize,
    direct: Moments,
    indirect: Moments,
}

#[derive(Clone, Debug)]
struct Moments {
    /// Clusters × clusters.
    products: Vec<i64>,
    sums: Vec<i64>,
}

/// Mixtures of the clusters' images by which pixels are compared: clusters × guides, guide by guide.
#[derive(Clone, Debug)]
pub struct Guides {
    pub(super) direct: Vec<f32>,
    pub(super) indirect: Vec<f32>,
}

impl Tally {
    /// Of nothing yet.
    pub fn new(clusters: usize) -> Self {
        let moments = Moments { products: vec![0; clusters * clusters], sums: vec![0; clusters] };
        Self { clusters, direct: moments.clone(), indirect: moments }
    }

    /// Adds the pixels of a window.
    pub fn add(&mut self, window: &Window) {
        self.direct.add(&window.direct, self.clusters);
        self.indirect.add(&window.indirect, self.clusters);
    }

    /// Adds what another has seen.
    ///
    /// # Panics
    /// If that is of another number of clusters.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.clusters, other.clusters);
        for (into, from) in [(&mut self.direct, &other.direct), (&mut self.indirect, &other.indirect)] {
            into.products.iter_mut().zip(&from.products).for_each(|(a, b)| *a += b);
            into.sums.iter_mut().zip(&from.sums).for_each(|(a, b)| *a += b);
        }
    }

    /// The guides that follow.
    pub fn guides(&self) -> Guides {
        Guides { direct: self.direct.guides(self.clusters), indirect: self.indirect.guides(self.clusters) }
    }
}

impl Moments {
    fn add(&mut self, light: &Rows, clusters: usize) {
        let width = light.width();
        let mut products = vec![0.0f64; clusters * clusters];
        let mut sums = vec![0.0f64; clusters];
        let mut rows = vec![0.0f32; 2 * clusters * width];
        for y in 0..light.height() {
            rows.fill(0.0);
            for plane in 0..light.planes() {
                let row = &mut rows[plane / 3 * width..][..width];
                row.iter_mut().zip(light.row(plane, y)).for_each(|(sum, v)| *sum += v);
            }
            for x in 0..width {
                let at = |half: usize, cluster: usize| f64::from(rows[(half * clusters + cluster) * width + x]);
                let total: f64 = (0..clusters).map(|c| at(0, c) + at(1, c)).sum();
                if total <= 0.0 {
                    continue;
                }
                let scale = 1.0 / total;
                for i in 0..clusters {
                    let (a, b) = (at(0, i) * scale, at(1, i) * scale);
                    sums[i] += a + b;
                    for j in 0..=i {
                        products[i * clusters + j] += scale * (a * at(1, j) + b * at(0, j));
                    }
                }
            }
        }
        let whole = |value: f64| (value / UNIT).round() as i64;
        self.products.iter_mut().zip(products).for_each(|(sum, v)| *sum += whole(v));
        self.sums.iter_mut().zip(sums).for_each(|(sum, v)| *sum += whole(v));
    }

    /// Principal components of the images, each image scaled to the same mean.
    fn guides(&self, clusters: usize) -> Vec<f32> {
        let scale: Vec<f64> =
            self.sums.iter().map(|&sum| if sum > 0 { 1.0 / (sum as f64 * UNIT) } else { 0.0 }).collect();
        let moment = |i: usize, j: usize| {
            let product = self.products[i.max(j) * clusters + i.min(j)] as f64 * UNIT;
            product * scale[i] * scale[j]
        };
        let moments = Mat::from_fn(clusters, clusters, moment);
        let Ok(eigen) = SelfAdjointEigen::new(moments.as_ref(), Side::Lower) else { return scale_of(&scale) };
        let guides = GUIDES.min(clusters);
        let component = |guide: usize| {
            let vector = eigen.U().col(clusters - 1 - guide);
            // One scale for all: the first cluster's share of the light.
            (0..clusters).map(|c| (vector[c] * scale[c] * clusters as f64) as f32).collect::<Vec<_>>()
        };
        (0..guides).flat_map(component).collect()
    }
}

fn scale_of(scale: &[f64]) -> Vec<f32> {
    scale.iter().map(|&s| s as f32).collect()
}
