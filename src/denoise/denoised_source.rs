//! Denoising of a matrix: blocks in, denoised blocks out.
//!
//! There are three steps, of which only the first has the blocks:
//!
//! 1. *Gathering*: the planes of each block, wherever it comes from, go to a file. They are the light of the clusters
//!    of columns in two halves, features, and emission seen by the camera.
//! 2. *Filtering*: window by window, with the halo that the filter reads, the images `D` of the clusters are denoised.
//!    Blocks play no part in it. Alternatively the images come from a file that another program denoised.
//! 3. *Spreading*, when a block is asked for: `T̂ = D R + C + E`, with the emission `E` unchanged (Nyström's
//!    approximation, with sums of columns as landmarks). `C` is the residual that tells the columns of a cluster apart,
//!    as far as it is above its noise ([`ClusterResidual`](crate::compress::ClusterResidual)): sharp shadows of single texels,
//!    small spots. In `R` each column starts from its cluster's image, scaled to its own share of the light. So a texel
//!    brighter than its neighbours keeps its light, and no weight is negative. `R` is then fitted to the samples of
//!    each column, by tiles over the whole image, as far as two halves of the tiles agree ([`ColumnUpsampler`]).
//!
//! Nothing depends on the lighting, so images of `T̂` add up as those of `T` do.

use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::denoise_inputs::{DenoiseInputs, floats, tile_values};
use super::external_images::ExternalImages;
use super::{
    ColumnUpsampler, DenoisedRegion, DenoisedRows, Denoiser, ErrorSums, FilterRadii, GuideStatistics, Guides,
    ImageOrigin, Pool, Region, tile_means,
};
use crate::block_records::{DENOISED, GATHERED, Records, ShardSet, open_spill, stop_if_interrupted};
use crate::compress::{ClusterMap, CompressorPlan};
use crate::error::{Error, Result};
use crate::files::{ContinuationFile, with_suffix};
use crate::light::{Clusters, DenoiseErrors, DenoisedLight, Job, Light, LightBasis, LightGroups, LightKind};
use crate::matrix::{BlockId, BlockPlanes, BlockSource, CHANNELS, FEATURE_PLANES, MatrixShape, PixelRect, TracedBlock};
use crate::resources::{Held, JobStage, PerThread, Progress, ResourceEstimate, Threads};

/// Memory limit for the rows of a window that are held at once. A window of one block is filtered in any case.
const WINDOW_BYTES: u64 = 512 << 20;

/// Number of blocks decoded in parallel.
const BLOCKS_AT_HAND: u64 = 4;

/// What is filtered one after the other.
struct Windows {
    /// The blocks of each.
    blocks: Vec<Vec<BlockId>>,
    /// Pixels around a window that its filter reads.
    halo: u32,
}

/// A matrix whose images are denoised, block by block.
pub(crate) struct DenoisedSource {
    shape: MatrixShape,
    clusters: usize,
    /// Windows of blocks, filtered one after the other, each from the top down.
    windows: Vec<Vec<BlockId>>,
    /// Radius, in pixels, that the filter reads around a window.
    halo: u32,
    /// `R`: clusters × columns, row-major; the identity until it is fitted.
    map: Vec<f32>,
    /// The cluster of each column.
    partition: Clusters,
    /// The lights that denoising tells apart.
    groups: LightGroups,
    origin: ImageOrigin,
    gathering: DenoiseInputs,
    images: ContinuationFile,
    tally: GuideStatistics,
}

impl DenoisedSource {
    /// Resources for packing a denoised matrix, for each thread beside the current block. First blocks are made, which takes
    /// `source`, and gathered; then windows are filtered; then blocks are spread and compressed (`compressing_bytes` more).
    pub(crate) fn need(job: &Job, source: ResourceEstimate, compressing_bytes: u64) -> ResourceEstimate {
        let windows = window_blocks(job.shape, Clusters::of_basis(&job.basis).count());
        let stages = Self::need_of_windows(job, source, windows);
        let disk_bytes = source.disk_bytes + Self::disk_bytes(job);
        ResourceEstimate {
            per_thread_bytes: stages.per_thread_bytes.max(compressing_bytes),
            disk_bytes,
            most_disk_bytes: disk_bytes,
            ..stages
        }
    }

    /// Memory of denoising alone blocks that `source` makes, with windows at most `blocks` blocks wide.
    pub(crate) fn need_of_windows(job: &Job, source: ResourceEstimate, blocks: u32) -> ResourceEstimate {
        let clusters = Clusters::of_basis(&job.basis).count();
        // The map, and the compressor that computes residuals.
        let map = (size_of::<f32>() * job.shape.columns()) as u64 * (clusters as u64 + CompressorPlan::COLUMN_VALUES);
        let gathering = source.and(&[&Held(map), &PerThread(DenoiseInputs::takes_bytes(job))]);
        ResourceEstimate {
            per_thread_bytes: gathering.per_thread_bytes.max(DenoiseInputs::spreads_bytes(job)),
            alone_bytes: Self::windows_need_bytes(job, blocks),
            ..gathering
        }
    }

    /// Upper bound of the bytes of filtering and fitting, with windows at most `blocks` blocks wide.
    fn windows_need_bytes(job: &Job, blocks: u32) -> u64 {
        let clusters = Clusters::of_basis(&job.basis).count() as u64;
        let (planes, tiles) = DenoiseInputs::plane_and_tile_bytes(job);
        // The sums of the fit; planes and tiles of the current blocks.
        let fit = if tiles > 0 { ColumnUpsampler::needs_bytes(clusters, job.shape.columns() as u64) } else { 0 };
        window_bytes(job.shape, blocks, clusters as usize) + BLOCKS_AT_HAND * (planes + 3 * tiles) + fit
    }

    /// Bytes of disk for the gathered planes and the images.
    fn disk_bytes(job: &Job) -> u64 {
        let clusters = Clusters::of_basis(&job.basis).count() as u64;
        let pixels = job.shape.rows() / CHANNELS as u64;
        let tiles: u64 =
            job.shape.blocks().map(|id| 4 * tile_values(job.shape, job.shape.rect(id), clusters) as u64).sum();
        let contrasts = u64::from(job.shape.block_count()) * DenoiseInputs::contrast_bytes(job);
        BlockPlanes::fixed_bytes(pixels, clusters) + pixels * (4 * CHANNELS as u64 * clusters + 64) + tiles + contrasts
    }

    /// Opens the files beside `path`, and continues those of an interrupted run of the same fingerprint. `shards` has
    /// the records that were gathered elsewhere.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn begin(
        job: &Job,
        path: &Path,
        fingerprint: [u8; 32],
        overwrite: bool,
        shards: Option<ShardSet>,
    ) -> Result<Self> {
        let shape = job.shape;
        let open = |name| open_spill(&with_suffix(path, name), fingerprint, shape.block_count(), overwrite);
        let records = match shards {
            Some(shards) => Records::Shards(shards),
            None => Records::File(open(GATHERED)?),
        };
        let clusters = Clusters::of_basis(&job.basis);
        let windows = windows_of(shape, (window_blocks(shape, clusters.count()), shape.blocks_down()));
        Self::over(
            job,
            path,
            Windows { blocks: windows, halo: reach_in(shape).halo() as u32 },
            records,
            open(DENOISED)?,
        )
    }

    /// For windows of the image, each filtered as if the image ended at its border. The files are unlinked, so they
    /// vanish with the process.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn of_windows(job: &Job, windows: Vec<Vec<BlockId>>) -> Result<Self> {
        let folder =
            tempfile::tempdir().map_err(Error::io("the system's temporary files", "create a folder for them"))?;
        let (path, shape) = (folder.path().join("pilot"), job.shape);
        let open = |name| open_spill(&with_suffix(&path, name), job.hash().0, shape.block_count(), false);
        let (records, images) = (Records::File(open(GATHERED)?), open(DENOISED)?);
        // Without their names the files live as long as they are open.
        folder.close().map_err(Error::io(&path, "take the name of"))?;
        Self::over(job, &path, Windows { blocks: windows, halo: 0 }, records, images)
    }

    fn over(
        job: &Job,
        path: &Path,
        Windows { blocks: windows, halo }: Windows,
        records: Records,
        images: ContinuationFile,
    ) -> Result<Self> {
        let (shape, partition) = (job.shape, Clusters::of_basis(&job.basis));
        let clusters = partition.count();
        let gathering = DenoiseInputs::new(job, with_suffix(path, GATHERED), records)?;
        let (map, tally) = (identity(clusters, shape.columns()), GuideStatistics::new(clusters));
        let groups = LightGroups::of_basis(&job.basis, &partition);
        let is_imported = job.basis.lights().iter().any(|light| light.kind == LightKind::Image);
        let origin = if is_imported { ImageOrigin::Imported } else { ImageOrigin::Traced };
        Ok(Self { shape, clusters, windows, halo, map, partition, groups, origin, gathering, images, tally })
    }

    /// The blocks of all windows, ascending.
    fn blocks(&self) -> Vec<BlockId> {
        let mut blocks = self.windows.concat();
        blocks.sort_unstable();
        blocks
    }

    /// Removes the files that it worked with.
    pub(crate) fn remove(self) -> Result<()> {
        self.gathering.records.remove()?;
        self.images.remove()
    }

    /// Gathers the denoiser's inputs of each block, see [`Gathering::gather`]. Returns the number of blocks that an
    /// earlier run had gathered.
    ///
    /// # Errors
    /// Those of [`DenoiseInputs::gather`].
    pub(crate) fn gather(
        &mut self,
        threads: &Threads,
        stage: JobStage<'_>,
        watch: &dyn Progress,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<u64> {
        let blocks = self.blocks();
        let blocks_kept = blocks.iter().filter(|&&id| self.gathering.records.has(id.0)).count() as u64;
        self.tally = self.gathering.gather(&blocks, threads, stage, watch, make)?;
        Ok(blocks_kept)
    }

    /// Filters what was gathered, window by window.
    ///
    /// # Errors
    /// Those of the disk; [`crate::Error::Interrupted`] when the watch says so.
    pub(crate) fn filter(&self, threads: &Threads, watch: &dyn Progress) -> Result<()> {
        let guides = &self.tally.guides();
        watch.begin("denoising", self.blocks().len() as u64, "blocks");
        let done = threads.run(|| -> Result<()> {
            let pool = Pool::default();
            for blocks in &self.windows {
                if blocks.iter().all(|&id| self.images.has(id.0)) {
                    watch.advance(blocks.len() as u64, 0, "px");
                } else {
                    self.filter_window(blocks, guides, &pool, watch)?;
                }
            }
            Ok(())
        });
        watch.end();
        done
    }

    /// Takes images that were denoised elsewhere, instead of filtering.
    ///
    /// # Errors
    /// Those of reading the images and of the disk.
    pub(crate) fn take(&self, basis: &ExternalImages, watch: &dyn Progress) -> Result<()> {
        if self.shape.blocks().all(|id| self.images.has(id.0)) {
            return Ok(());
        }
        watch.begin("reading denoised images", u64::from(self.shape.block_count()), "blocks");
        let done = basis.read().and_then(|images| {
            for id in self.shape.blocks().filter(|id| !self.images.has(id.0)) {
                self.images.append(id.0, &[&images.bytes_of(self.shape.rect(id))])?;
                watch.advance(1, 0, "px");
            }
            Ok(())
        });
        watch.end();
        done
    }

    /// Filters the blocks of one window, from the top down.
    fn filter_window(&self, blocks: &[BlockId], guides: &Guides, pool: &Pool, watch: &dyn Progress) -> Result<()> {
        let rects = || blocks.iter().map(|&id| self.shape.rect(id));
        let across = rects().map(|r| r.x).min().unwrap_or(0)..rects().map(|r| r.x + r.width).max().unwrap_or(0);
        let down = rects().map(|r| r.y).min().unwrap_or(0)..rects().map(|r| r.y + r.height).max().unwrap_or(0);
        let halo = self.halo;
        let (left, top) = (across.start.saturating_sub(halo), down.start.saturating_sub(halo));
        let (right, bottom) = ((across.end + halo).min(self.shape.width()), (down.end + halo).min(self.shape.height()));
        let whole = PixelRect { x: left, y: top, width: right - left, height: bottom - top };
        let within = |range: Range<u32>, from: u32| (range.start - from) as usize..(range.end - from) as usize;
        let region = Region { x: within(across, left), y: within(down, top) };
        let part = DenoisedRegion {
            size: (whole.width as usize, whole.height as usize),
            block: self.shape.block_side() as usize,
            region,
            features: FEATURE_PLANES,
            groups: self.groups.of_cluster().to_vec(),
            origin: self.origin,
        };
        let mut denoising = Denoiser::new(part, reach_in(self.shape), guides, pool);
        while let Some(wanted) = denoising.wants() {
            stop_if_interrupted(&self.gathering.path, watch)?;
            self.gathering.put(whole, &wanted, BLOCKS_AT_HAND as usize, &mut denoising)?;
            let denoised = denoising.denoise(&wanted);
            let rows = denoised.rows();
            let is_done = |id: &&BlockId| rows.contains(&((self.shape.rect(**id).y - top) as usize));
            let done: Vec<&BlockId> = blocks.iter().filter(is_done).collect();
            for few in done.chunks(BLOCKS_AT_HAND as usize) {
                few.par_iter().try_for_each(|id| self.keep(**id, whole, &denoised))?;
            }
            watch.advance(done.len() as u64, 0, "px");
            denoised.keep_in(pool);
        }
        Ok(())
    }

    /// Stores the denoised images of a block, unless they are stored already. `whole` is the denoised part of the image.
    fn keep(&self, id: BlockId, whole: PixelRect, denoised: &DenoisedRows) -> Result<()> {
        if self.images.has(id.0) {
            return Ok(());
        }
        let (rect, images) = (self.shape.rect(id), &denoised.images);
        let (left, top) = ((rect.x - whole.x) as usize, (rect.y - whole.y) as usize);
        let part = Region { x: left..left + rect.width as usize, y: top..top + rect.height as usize };
        let mut bytes = Vec::with_capacity(4 * images.planes() * rect.pixels());
        for plane in 0..images.planes() {
            for y in part.y.clone() {
                bytes.extend_from_slice(bytemuck::cast_slice(&images.row(plane, y)[part.x.clone()]));
            }
        }
        let errors = denoised.errors(&part);
        self.images.append(id.0, &[&bytes, bytemuck::cast_slice(&errors)])
    }

    /// Fits the map from clusters to columns, where a cluster has several: after the images are denoised.
    ///
    /// # Errors
    /// Those of the disk; [`crate::Error::Interrupted`] when the watch says so.
    pub(crate) fn fit(&mut self, watch: &dyn Progress) -> Result<()> {
        if self.clusters == self.shape.columns() {
            return Ok(());
        }
        watch.begin("fitting columns", self.blocks().len() as u64, "blocks");
        let summed = self.sum_tiles(watch);
        watch.end();
        self.map = summed?.fit(&self.partition);
        Ok(())
    }

    /// The sums over all tiles from which [`ColumnUpsampler`] follows.
    fn sum_tiles(&self, watch: &dyn Progress) -> Result<ColumnUpsampler> {
        let columns = self.shape.columns();
        let mut fit = ColumnUpsampler::new(self.clusters, columns);
        // Errors count relatively in tiles brighter than the mean, and absolutely in darker ones.
        let mean = self.mean_light()?;
        let (mut of_images, mut of_columns) = (vec![0.0; self.clusters], vec![0.0; columns]);
        for id in self.blocks() {
            stop_if_interrupted(&self.gathering.path, watch)?;
            let images = self.image_tiles(id)?;
            let gathered = self.gathering.records.read(id.0)?;
            let tiles = floats(self.gathering.parts(id, &gathered)?.tiles);
            let each = images.len() / self.clusters;
            for row in 0..each {
                of_images.iter_mut().enumerate().for_each(|(i, v)| *v = images[i * each + row]);
                of_columns.iter_mut().enumerate().for_each(|(j, v)| *v = tiles[j * each + row]);
                let light: f64 = of_images.iter().map(|&v| f64::from(v)).sum();
                let scale = light.max(0.0) + mean;
                if scale > 0.0 && of_columns.iter().all(|v| v.is_finite()) {
                    fit.add(row % 2, &of_images, &of_columns, 1.0 / (scale * scale));
                }
            }
            watch.advance(1, 0, "px");
        }
        Ok(fit)
    }

    /// Means of tiles of the denoised images of a block, clusters × channels × tiles.
    fn image_tiles(&self, id: BlockId) -> Result<Vec<f32>> {
        let rect = self.shape.rect(id);
        Ok(tile_means(&self.images_of(id)?, (rect.width as usize, rect.height as usize)))
    }

    /// Mean over tiles and channels of the denoised image with all columns on.
    fn mean_light(&self) -> Result<f64> {
        let (mut sum, mut count) = (0.0, 0);
        for id in self.blocks() {
            let tiles = self.image_tiles(id)?;
            sum += tiles.iter().map(|&v| f64::from(v)).sum::<f64>();
            count += tiles.len() / self.clusters;
        }
        Ok(sum.max(0.0) / count.max(1) as f64)
    }

    /// Brightness of each light's denoised image over that of the image with all columns on: the cube of the mean cube root of light. Lightness is
    /// about a cube root (CIE 015:2018, §8.2.1), so that of a light which is bright in one corner the rest of its image counts. Decision 73.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn brightness_of_lights(&self, basis: &LightBasis) -> Result<Vec<f64>> {
        let columns = self.shape.columns();
        // What of each cluster's image is a light's: of one light, some clusters.
        let of_light = |light: &Light| -> Vec<(usize, f32)> {
            let own = light.columns().start as usize..light.columns().end as usize;
            let parts = self.map.chunks_exact(columns).map(|row| row[own.clone()].iter().sum::<f32>());
            parts.enumerate().filter(|(_, part)| *part != 0.0).collect()
        };
        let mut images: Vec<Vec<(usize, f32)>> = basis.lights().iter().map(of_light).collect();
        images.push((0..self.clusters).map(|cluster| (cluster, 1.0)).collect());
        let mut roots = vec![0.0f64; images.len()];
        let mut light = Vec::new();
        for id in self.blocks() {
            let tiles = self.image_tiles(id)?;
            let planes: Vec<&[f32]> = tiles.chunks_exact(tiles.len() / self.clusters).collect();
            for (sum, parts) in roots.iter_mut().zip(&images) {
                light.clear();
                light.resize(planes[0].len() / CHANNELS, 0.0f32);
                for &(cluster, part) in parts {
                    for channel in planes[cluster].chunks_exact(light.len()) {
                        light.iter_mut().zip(channel).for_each(|(sum, value)| *sum += part * value);
                    }
                }
                *sum += light.iter().map(|&value| f64::from(value.max(0.0)).cbrt()).sum::<f64>();
            }
        }
        let all = roots.pop().unwrap_or(0.0).max(f64::MIN_POSITIVE);
        Ok(roots.iter().map(|root| (root / all).powi(3)).collect())
    }

    /// The errors of denoising over the whole image, of all images of lights together and of each light; `None` if the images came from a file.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn errors(&self) -> Result<Option<(DenoiseErrors, Vec<DenoisedLight>)>> {
        let mut groups = vec![ErrorSums::default(); self.groups.count()];
        for id in self.shape.blocks() {
            let Some(parts) = self.image_bytes(id)?.1 else { return Ok(None) };
            groups.iter_mut().zip(&parts).for_each(|(sums, part)| sums.add(part));
        }
        let mut all = ErrorSums::default();
        groups.iter().for_each(|sums| all.add(sums));
        let of_light = |&group: &u16| {
            let sums = &groups[usize::from(group)];
            let kept = if sums.light_before > 0.0 { sums.light_after / sums.light_before } else { 1.0 };
            DenoisedLight { errors: sums.errors(), light_kept: kept as f32 }
        };
        Ok(Some((all.errors(), self.groups.of_light().iter().map(of_light).collect())))
    }

    /// The stored bytes of a block's denoised images, and the error sums if they were denoised here.
    fn image_bytes(&self, id: BlockId) -> Result<(Vec<u8>, Option<Vec<ErrorSums>>)> {
        let mut bytes = self.images.read(id.0)?;
        let images = 4 * self.shape.rect(id).rows() * self.clusters;
        let of_errors = size_of::<ErrorSums>() * self.groups.count();
        let Some(rest) = bytes.get(images..).filter(|rest| rest.is_empty() || rest.len() == of_errors) else {
            return Err(self.images.damaged(id.0, "it is cut short"));
        };
        let errors = (!rest.is_empty())
            .then(|| rest.chunks_exact(size_of::<ErrorSums>()).map(bytemuck::pod_read_unaligned).collect());
        bytes.truncate(images);
        Ok((bytes, errors))
    }

    /// The denoised images of a block, clusters × channels × pixels.
    fn images_of(&self, id: BlockId) -> Result<Vec<f32>> {
        Ok(self.image_bytes(id)?.0.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect())
    }
}

impl BlockSource for DenoisedSource {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// Makes the denoised block; of its planes only the emission is filled.
    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let rows = self.shape.rect(id).rows();
        let columns = self.shape.columns();
        if (target.block.rows(), target.block.columns()) != (rows, columns) {
            target.block.reset(rows, columns);
        }
        let gathered = self.gathering.records.read(id.0)?;
        let parts = self.gathering.parts(id, &gathered)?;
        let images = self.images_of(id)?;
        let map = ClusterMap { clusters: &self.partition, shares: &self.map };
        self.gathering.spread(id, &parts, images, map, &mut target.block)?;
        let emission = parts.emission();
        let pixels = rows / CHANNELS;
        for seen in &emission {
            for (channel, value) in seen.value.iter().enumerate() {
                let row = channel * pixels + seen.pixel as usize;
                target.block.entries_mut()[seen.column as usize * rows + row] += value;
            }
        }
        target.noise = None;
        target.planes = Some(BlockPlanes { emission, ..Default::default() });
        Ok(())
    }
}

/// Ones where cluster and column have the same index.
fn identity(clusters: usize, columns: usize) -> Vec<f32> {
    (0..clusters * columns).map(|i| if i / columns == i % columns { 1.0 } else { 0.0 }).collect()
}

/// Largest number of blocks across a window.
fn window_blocks(shape: MatrixShape, clusters: usize) -> u32 {
    let fits = |&blocks: &u32| window_bytes(shape, blocks, clusters) <= WINDOW_BYTES;
    (1..=shape.blocks_across()).rev().find(fits).unwrap_or(1)
}

/// The windows of an image, at most so many blocks wide and high.
pub(crate) fn windows_of(shape: MatrixShape, (most_across, most_down): (u32, u32)) -> Vec<Vec<BlockId>> {
    let (across, down) = (shape.blocks_across(), shape.blocks_down());
    let window = |rows: Range<u32>, columns: Range<u32>| -> Vec<BlockId> {
        rows.flat_map(|y| columns.clone().map(move |x| BlockId(y * across + x))).collect()
    };
    let in_row = |rows: Range<u32>| equal_parts(across, most_across).map(move |columns| window(rows.clone(), columns));
    equal_parts(down, most_down).flat_map(in_row).collect()
}

/// The fewest parts of nearly equal length that have at most `most` each.
fn equal_parts(length: u32, most: u32) -> impl Iterator<Item = Range<u32>> {
    let count = length.div_ceil(most.max(1));
    let border = move |part: u32| (u64::from(part) * u64::from(length) / u64::from(count)) as u32;
    (0..count).map(move |part| border(part)..border(part + 1))
}

/// Bytes of a window this many blocks wide.
fn window_bytes(shape: MatrixShape, blocks: u32, clusters: usize) -> u64 {
    let (reach, side) = (reach_in(shape), shape.block_side());
    let across = (u64::from(blocks) * u64::from(side) + 2 * reach.halo() as u64).min(u64::from(shape.width()));
    let bytes = across * Denoiser::bytes_across(reach, clusters, FEATURE_PLANES, side as usize);
    // Buffers of other sizes in the pool, and blocks being decoded.
    bytes + bytes / 10
}

fn reach_in(shape: MatrixShape) -> FilterRadii {
    FilterRadii::of_image(shape.width(), shape.height())
}
