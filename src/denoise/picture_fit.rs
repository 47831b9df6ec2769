//! What follows from the whole denoised picture: how columns share their cluster's image, the share of each light, the errors. It is
//! summed window by window, anywhere, and put together in the order of the windows and of the blocks, so that it has the same bits
//! on any number of machines.

use std::ops::Range;

use super::windows::PictureWindows;
use super::{ColumnUpsampler, ErrorSums};
use crate::light::{Clusters, DenoiseErrors, DenoisedLight, Job, LightBasis, LightGroups};
use crate::matrix::MatrixShape;

/// Sums over a denoised block.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct DenoisedBlockSums {
    /// For each cluster the sum of its tiles.
    pub(super) light: Vec<f64>,
    /// For each group of lights, and at last for all, the sum of the roots of its tiles.
    pub(super) roots: Vec<f64>,
    /// For each group of lights; none where images were denoised elsewhere.
    pub(super) errors: Vec<ErrorSums>,
}

/// Sums over a window of the denoised picture.
#[derive(Clone, Debug)]
pub(crate) struct WindowSums {
    /// Of each block, in the order of the window.
    pub(super) blocks: Vec<DenoisedBlockSums>,
    /// Of the tiles; `None` where every column is a cluster.
    pub(super) tiles: Option<ColumnUpsampler>,
}

/// What the denoised picture says of all blocks.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PictureFit {
    /// `R`: clusters × columns, row-major.
    pub(crate) map: Vec<f32>,
    /// Brightness of each light's picture over that of all columns on: the square of the mean root of light, see
    /// [`LightingPrior::of_lights_alone`](crate::light::LightingPrior::of_lights_alone).
    pub(crate) brightness: Vec<f64>,
    /// The errors of denoising, of all images of lights together and of each light; `None` if the images came from elsewhere.
    pub(crate) errors: Option<(DenoiseErrors, Vec<DenoisedLight>)>,
}

/// Puts the sums of windows together.
pub(crate) struct PictureSums {
    shape: MatrixShape,
    partition: Clusters,
    groups: LightGroups,
    windows: PictureWindows,
    /// By block.
    blocks: Vec<Option<DenoisedBlockSums>>,
    tiles: Option<ColumnUpsampler>,
}

impl PictureSums {
    /// Nothing yet.
    pub(crate) fn new(job: &Job) -> Self {
        let partition = Clusters::of_basis(&job.basis);
        let (clusters, columns) = (partition.count(), job.shape.columns());
        Self {
            shape: job.shape,
            groups: LightGroups::of_basis(&job.basis, &partition),
            windows: PictureWindows::of(job.shape),
            blocks: vec![None; job.shape.block_count() as usize],
            tiles: (clusters < columns).then(|| ColumnUpsampler::new(clusters, columns)),
            partition,
        }
    }

    /// Adds a window, of which `sums` are, in the order of the windows. `places` are those of its blocks.
    pub(crate) fn add(&mut self, places: &Range<u32>, sums: WindowSums) {
        for (id, sums) in self.windows.blocks(places).iter().zip(sums.blocks) {
            self.blocks[id.index()] = Some(sums);
        }
        if let (Some(whole), Some(part)) = (&mut self.tiles, &sums.tiles) {
            whole.merge(part);
        }
    }

    /// Decodes what [`WindowSums::to_bytes`] wrote of a window of so many blocks; `None` if these are other bytes.
    #[cfg(feature = "scene")]
    pub(crate) fn window_of(&self, blocks: usize, mut bytes: &[u8]) -> Option<WindowSums> {
        let (clusters, groups, columns) = (self.partition.count(), self.groups.count(), self.shape.columns());
        let mut sums = Vec::with_capacity(blocks.min(bytes.len()));
        for _ in 0..blocks {
            let (light, rest) = bytes.split_at_checked(size_of::<f64>() * clusters)?;
            let (roots, rest) = rest.split_at_checked(size_of::<f64>() * (groups + 1))?;
            let (errors, rest) = rest.split_at_checked(size_of::<ErrorSums>() * groups)?;
            let [light, roots] = [light, roots]
                .map(|values| values.chunks_exact(size_of::<f64>()).map(bytemuck::pod_read_unaligned).collect());
            let errors = errors.chunks_exact(size_of::<ErrorSums>()).map(bytemuck::pod_read_unaligned).collect();
            sums.push(DenoisedBlockSums { light, roots, errors });
            bytes = rest;
        }
        let tiles = match clusters < columns {
            true => Some(ColumnUpsampler::from_values(clusters, columns, bytes)?),
            false if bytes.is_empty() => None,
            false => return None,
        };
        Some(WindowSums { blocks: sums, tiles })
    }

    /// What follows, with all windows there.
    pub(crate) fn fit(&self, basis: &LightBasis) -> PictureFit {
        let columns = self.shape.columns();
        let map = match &self.tiles {
            Some(tiles) => tiles.fit(&self.partition),
            None => identity(self.partition.count(), columns),
        };
        PictureFit { brightness: self.brightness(basis, &map), errors: self.errors(), map }
    }

    /// Displays show about a root of radiance, so that of a light which is bright in one corner the rest of its picture counts
    /// (decision 73). Lights of one group share its brightness by their means.
    fn brightness(&self, basis: &LightBasis, map: &[f32]) -> Vec<f64> {
        let (groups, of_light) = (self.groups.count(), self.groups.of_light());
        let mut roots = vec![0.0f64; groups + 1];
        for block in self.blocks.iter().flatten() {
            roots.iter_mut().zip(&block.roots).for_each(|(sum, root)| *sum += root);
        }
        let means = self.shares(basis, map);
        let mut of_group = vec![0.0f64; groups];
        of_light.iter().zip(&means).for_each(|(&group, mean)| of_group[usize::from(group)] += mean);
        let all = roots[groups].max(f64::MIN_POSITIVE);
        let brightness = of_light.iter().map(|&group| usize::from(group)).zip(means).map(|(group, mean)| {
            let of_its_group = mean / of_group[group].max(f64::MIN_POSITIVE);
            (roots[group] / all).powi(2) * of_its_group
        });
        brightness.collect()
    }

    /// Share of each light in the mean of the picture with all columns on.
    fn shares(&self, basis: &LightBasis, map: &[f32]) -> Vec<f64> {
        let mut clusters = vec![0.0f64; self.partition.count()];
        for block in self.blocks.iter().flatten() {
            clusters.iter_mut().zip(&block.light).for_each(|(sum, light)| *sum += light);
        }
        let columns = self.shape.columns();
        let of_column = |column: u32| -> f64 {
            let shares = map[column as usize..].iter().step_by(columns);
            clusters.iter().zip(shares).map(|(light, &share)| light * f64::from(share)).sum()
        };
        let all = clusters.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        basis.lights().iter().map(|light| light.columns().map(of_column).sum::<f64>().max(0.0) / all).collect()
    }

    fn errors(&self) -> Option<(DenoiseErrors, Vec<DenoisedLight>)> {
        let mut groups = vec![ErrorSums::default(); self.groups.count()];
        for block in self.blocks.iter().flatten() {
            if block.errors.is_empty() {
                return None;
            }
            groups.iter_mut().zip(&block.errors).for_each(|(sums, part)| sums.add(part));
        }
        let mut all = ErrorSums::default();
        groups.iter().for_each(|sums| all.add(sums));
        let of_light = |&group: &u16| {
            let sums = &groups[usize::from(group)];
            let kept = if sums.light_before > 0.0 { sums.light_after / sums.light_before } else { 1.0 };
            DenoisedLight { errors: sums.errors(), light_kept: kept as f32 }
        };
        Some((all.errors(), self.groups.of_light().iter().map(of_light).collect()))
    }
}

impl WindowSums {
    /// Encodes the sums, in the machine's byte order, for a program of this version: of each block the light of its clusters, the roots of
    /// its groups and their errors; then those of the tiles.
    #[cfg(feature = "scene")]
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for block in &self.blocks {
            bytes.extend_from_slice(bytemuck::cast_slice(&block.light));
            bytes.extend_from_slice(bytemuck::cast_slice(&block.roots));
            bytes.extend_from_slice(bytemuck::cast_slice(&block.errors));
        }
        if let Some(tiles) = &self.tiles {
            tiles.parts().for_each(|part| bytes.extend_from_slice(bytemuck::cast_slice(part)));
        }
        bytes
    }
}

/// Ones where cluster and column have the same index.
pub(super) fn identity(clusters: usize, columns: usize) -> Vec<f32> {
    (0..clusters * columns).map(|i| if i / columns == i % columns { 1.0 } else { 0.0 }).collect()
}
