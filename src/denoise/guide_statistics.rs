//! Second moments of the cluster images, and the guides that follow from them. Blocks may be added in any order.

use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, Side};

use super::constants::GUIDES;

/// Colour channels of each image.
const CHANNELS: usize = 3;

/// Fixed-point unit of the sums. Integers make them independent of the order of blocks.
const UNIT: f64 = 1.0 / (1u64 << 30) as f64;

/// Second moments of the cluster images over pixels, with each pixel scaled to the same brightness. Products are taken
/// between the two halves of the samples, so that noise does not bias them.
#[derive(Clone, Debug)]
pub struct GuideStatistics {
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
#[derive(Clone, Debug, PartialEq)]
pub struct Guides {
    clusters: usize,
    pub(super) direct: Vec<f32>,
    pub(super) indirect: Vec<f32>,
}

impl Guides {
    /// The mixtures of direct light, and those of indirect light.
    #[cfg(feature = "scene")]
    pub(crate) fn parts(&self) -> [&[f32]; 2] {
        [&self.direct, &self.indirect]
    }

    /// Those of [`parts`](Self::parts); `None` where they are not mixtures of so many clusters.
    #[cfg(feature = "scene")]
    pub(crate) fn of_parts(clusters: usize, [direct, indirect]: [Vec<f32>; 2]) -> Option<Self> {
        let fits = |part: &Vec<f32>| {
            !part.is_empty() && part.len().is_multiple_of(clusters) && part.len() / clusters <= GUIDES
        };
        (clusters > 0 && fits(&direct) && fits(&indirect)).then_some(Self { clusters, direct, indirect })
    }

    pub(super) fn clusters(&self) -> usize {
        self.clusters
    }
}

impl GuideStatistics {
    /// No pixels yet.
    pub fn new(clusters: usize) -> Self {
        let moments = Moments { products: vec![0; clusters * clusters], sums: vec![0; clusters] };
        Self { clusters, direct: moments.clone(), indirect: moments }
    }

    /// Adds pixels: two halves of direct and of indirect light, each ordered by cluster, then channel, then pixel.
    pub fn add(&mut self, direct: [&[f32]; 2], indirect: [&[f32]; 2]) {
        self.direct.add(direct, self.clusters);
        self.indirect.add(indirect, self.clusters);
    }

    /// Adds the sums of another tally.
    ///
    /// # Panics
    /// If the numbers of clusters differ.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.clusters, other.clusters);
        for (into, from) in [(&mut self.direct, &other.direct), (&mut self.indirect, &other.indirect)] {
            into.products.iter_mut().zip(&from.products).for_each(|(a, b)| *a += b);
            into.sums.iter_mut().zip(&from.sums).for_each(|(a, b)| *a += b);
        }
    }

    /// All sums, in the machine's byte order.
    #[cfg(feature = "scene")]
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let parts = [&self.direct.products, &self.direct.sums, &self.indirect.products, &self.indirect.sums];
        parts.iter().flat_map(|part| bytemuck::cast_slice::<i64, u8>(part).iter().copied()).collect()
    }

    /// Sums as [`to_bytes`](Self::to_bytes) gives them, and the bytes after them; `None` if there are too few.
    #[cfg(feature = "scene")]
    pub(crate) fn from_bytes(clusters: usize, mut bytes: &[u8]) -> Option<(Self, &[u8])> {
        let mut tally = Self::new(clusters);
        let Self { direct, indirect, .. } = &mut tally;
        for part in [&mut direct.products, &mut direct.sums, &mut indirect.products, &mut indirect.sums] {
            let (values, rest) = bytes.split_at_checked(size_of::<i64>() * part.len())?;
            let values = values.chunks_exact(size_of::<i64>()).map(bytemuck::pod_read_unaligned);
            part.iter_mut().zip(values).for_each(|(sum, value)| *sum = value);
            bytes = rest;
        }
        Some((tally, bytes))
    }

    /// The guides of the pixels added so far.
    pub fn guides(&self) -> Guides {
        let [direct, indirect] = [&self.direct, &self.indirect].map(|moments| moments.guides(self.clusters));
        Guides { clusters: self.clusters, direct, indirect }
    }
}

impl Moments {
    fn add(&mut self, halves: [&[f32]; 2], clusters: usize) {
        let pixels = halves[0].len() / (CHANNELS * clusters);
        let mut products = vec![0.0f64; clusters * clusters];
        let mut sums = vec![0.0f64; clusters];
        // For each pixel, summed over channels: all clusters in one half, then in the other.
        let mut light = vec![0.0f64; 2 * clusters * pixels];
        for (half, images) in halves.iter().enumerate() {
            for (cluster, channels) in images.chunks_exact((CHANNELS * pixels).max(1)).enumerate() {
                let targets = light[half * clusters + cluster..].iter_mut().step_by(2 * clusters);
                for (pixel, target) in targets.enumerate() {
                    *target = (0..CHANNELS).map(|channel| f64::from(channels[channel * pixels + pixel])).sum();
                }
            }
        }
        for light in light.chunks_exact_mut(2 * clusters) {
            let total: f64 = light.iter().sum();
            if total <= 0.0 {
                continue;
            }
            light.iter_mut().for_each(|v| *v /= total);
            let (a, b) = light.split_at(clusters);
            sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a + b);
            for (i, products) in products.chunks_exact_mut(clusters).enumerate() {
                let others = a[..=i].iter().zip(&b[..=i]);
                products.iter_mut().zip(others).for_each(|(sum, (a_j, b_j))| *sum += a[i] * b_j + b[i] * a_j);
            }
        }
        let whole = |value: f64| (value / UNIT).round() as i64;
        self.products.iter_mut().zip(products).for_each(|(sum, v)| *sum += whole(v));
        self.sums.iter_mut().zip(sums).for_each(|(sum, v)| *sum += whole(v));
    }

    /// Principal components of the images, with each image scaled to the same mean.
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
            // One common scale: the first cluster's share of the light.
            (0..clusters).map(|c| (vector[c] * scale[c] * clusters as f64) as f32).collect::<Vec<_>>()
        };
        (0..guides).flat_map(component).collect()
    }
}

fn scale_of(scale: &[f64]) -> Vec<f32> {
    scale.iter().map(|&s| s as f32).collect()
}
