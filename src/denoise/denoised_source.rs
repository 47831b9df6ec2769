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

use std::collections::HashSet;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::denoise_inputs::{DenoiseInputs, floats, tile_values};
use super::external_images::ExternalImages;
use super::picture_fit::{DenoisedBlockSums, PictureFit, PictureSums, WindowSums, identity};
use super::windows::{PictureWindows, windows_of};
use super::{
    ColumnUpsampler, DenoisedRegion, DenoisedRows, Denoiser, ErrorSums, FilterRadii, GuideStatistics, Guides,
    ImageOrigin, Pool, Region, tile_means,
};
use crate::block_records::{DENOISED, GATHERED, GATHERED_PARTS, Records, ShardSet, open_spill, stop_if_interrupted};
use crate::compress::{ClusterMap, CompressorPlan};
use crate::error::{Error, Result};
use crate::files::with_suffix;
use crate::light::{Clusters, Job, LightGroups, LightKind};
use crate::matrix::{BlockId, BlockPlanes, BlockSource, CHANNELS, FEATURE_PLANES, MatrixShape, PixelRect, TracedBlock};
use crate::resources::{Held, JobStage, PerThread, Progress, ResourceEstimate, Threads};

/// Memory limit for the rows of a window that are held at once: narrower windows read more halo for the same pixels. A window of one
/// block is filtered in any case.
const WINDOW_BYTES: u64 = 1536 << 20;

/// One over the largest share of the memory of a job that its windows take; its blocks and threads have the rest.
const WINDOW_PART: u64 = 2;

/// Number of blocks decoded in parallel.
const BLOCKS_AT_HAND: u64 = 4;

/// A job whose images are denoised.
#[derive(Clone, Copy)]
pub(crate) struct DenoisedJob<'a> {
    pub(crate) job: &'a Job,
    /// Anonymous memory in bytes that it may take: where that is little, windows are narrower, with the same result.
    pub(crate) budget_bytes: u64,
}

impl DenoisedJob<'_> {
    /// Largest number of blocks across a window.
    fn window_blocks(self) -> u32 {
        let (shape, clusters) = (self.job.shape, Clusters::of_basis(&self.job.basis).count());
        let most = (self.budget_bytes / WINDOW_PART).min(WINDOW_BYTES);
        let fits = |&blocks: &u32| window_bytes(shape, blocks, clusters) <= most;
        (1..=shape.blocks_across()).rev().find(fits).unwrap_or(1)
    }
}

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
    /// Denoised images, by the place of their block in `picture`.
    images: Records,
    picture: PictureWindows,
    guides: Guides,
}

impl DenoisedSource {
    /// Resources for packing a denoised matrix, for each thread beside the current block. First blocks are made, which takes
    /// `source`, and gathered; then windows are filtered; then blocks are spread and compressed (`compressing_bytes` more).
    pub(crate) fn need(of: DenoisedJob<'_>, source: ResourceEstimate, compressing_bytes: u64) -> ResourceEstimate {
        let job = of.job;
        let stages = Self::need_of_windows(job, source, of.window_blocks());
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
            job.shape.blocks().map(|id| 2 * tile_values(job.shape, job.shape.rect(id), clusters) as u64).sum();
        let contrasts = u64::from(job.shape.block_count()) * DenoiseInputs::contrast_bytes(job);
        BlockPlanes::fixed_bytes(pixels, clusters) + pixels * (4 * CHANNELS as u64 * clusters + 64) + tiles + contrasts
    }

    /// Opens the files beside `path`, and continues those of an interrupted run of the same fingerprint. `shards` has
    /// the records that were gathered elsewhere.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn begin(
        of: DenoisedJob<'_>,
        path: &Path,
        fingerprint: [u8; 32],
        overwrite: bool,
        shards: Option<ShardSet>,
    ) -> Result<Self> {
        let (job, shape) = (of.job, of.job.shape);
        let blocks = shape.block_count();
        let open = |name, keys| open_spill(&with_suffix(path, name), fingerprint, keys, overwrite);
        let records = match shards {
            Some(shards) => Records::Shards(shards),
            None => Records::File(open(GATHERED, GATHERED_PARTS * blocks)?),
        };
        let windows = windows_of(shape, (of.window_blocks(), shape.blocks_down()));
        Self::over(
            job,
            path,
            Windows { blocks: windows, halo: reach_in(shape).halo() as u32 },
            records,
            Records::File(open(DENOISED, blocks)?),
        )
    }

    /// For one window of the picture, whose inputs and those around it `records` has, and which is denoised into `images`. `path` is
    /// what both lie beside.
    ///
    /// # Errors
    /// Those of the compressor.
    #[cfg(feature = "scene")]
    pub(crate) fn of_window(
        job: &Job,
        path: &Path,
        places: &Range<u32>,
        [records, images]: [Records; 2],
        guides: Guides,
    ) -> Result<Self> {
        let window = PictureWindows::of(job.shape).blocks(places).to_vec();
        let windows = Windows { blocks: vec![window], halo: reach_in(job.shape).halo() as u32 };
        Ok(Self { guides, ..Self::over(job, path, windows, records, images)? })
    }

    /// For blocks whose inputs are in `records` and whose denoised images are in `images`, with what the picture says of all of them.
    ///
    /// # Errors
    /// Those of the compressor.
    #[cfg(feature = "scene")]
    pub(crate) fn of_images(job: &Job, path: &Path, [records, images]: [Records; 2], map: Vec<f32>) -> Result<Self> {
        let windows = Windows { blocks: Vec::new(), halo: 0 };
        Ok(Self { map, ..Self::over(job, path, windows, records, images)? })
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
        let blocks = shape.block_count();
        let open = |name, keys| open_spill(&with_suffix(&path, name), job.hash().0, keys, false).map(Records::File);
        let (records, images) = (open(GATHERED, GATHERED_PARTS * blocks)?, open(DENOISED, blocks)?);
        // Without their names the files live as long as they are open.
        folder.close().map_err(Error::io(&path, "take the name of"))?;
        Self::over(job, &path, Windows { blocks: windows, halo: 0 }, records, images)
    }

    fn over(
        job: &Job,
        path: &Path,
        Windows { blocks: windows, halo }: Windows,
        records: Records,
        images: Records,
    ) -> Result<Self> {
        let (shape, partition) = (job.shape, Clusters::of_basis(&job.basis));
        let clusters = partition.count();
        let gathering = DenoiseInputs::new(job, with_suffix(path, GATHERED), records)?;
        let (map, guides) = (identity(clusters, shape.columns()), GuideStatistics::new(clusters).guides());
        let groups = LightGroups::of_basis(&job.basis, &partition);
        let is_imported = job.basis.lights().iter().any(|light| light.kind == LightKind::Image);
        let origin = if is_imported { ImageOrigin::Imported } else { ImageOrigin::Traced };
        let picture = PictureWindows::of(shape);
        Ok(Self { shape, clusters, windows, halo, map, partition, groups, origin, gathering, images, picture, guides })
    }

    /// The blocks of all windows, ascending.
    fn blocks(&self) -> Vec<BlockId> {
        let mut blocks = self.windows.concat();
        blocks.sort_unstable();
        blocks
    }

    /// The denoised images that were made.
    #[cfg(feature = "scene")]
    pub(crate) fn into_images(self) -> Records {
        self.images
    }

    /// Removes the files that it worked with.
    pub(crate) fn remove(self) -> Result<()> {
        self.gathering.records.remove()?;
        self.images.remove()
    }

    /// Gathers the denoiser's inputs of each block, see [`DenoiseInputs::gather`]. Returns the number of blocks that an
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
        let blocks_kept = blocks.iter().filter(|&&id| self.gathering.has(id)).count() as u64;
        self.guides = self.gathering.gather(&blocks, threads, stage, watch, make)?.guides();
        Ok(blocks_kept)
    }

    /// Filters what was gathered, window by window.
    ///
    /// # Errors
    /// Those of the disk; [`crate::Error::Interrupted`] when the watch says so.
    pub(crate) fn filter(&self, threads: &Threads, watch: &dyn Progress) -> Result<()> {
        watch.begin("denoising", self.blocks().len() as u64, "blocks");
        let done = threads.run(|| -> Result<()> {
            let pool = Pool::default();
            for blocks in &self.windows {
                if blocks.iter().all(|&id| self.has_images(id)) {
                    watch.advance(blocks.len() as u64, 0, "px");
                } else {
                    self.filter_window(blocks, &pool, watch)?;
                }
            }
            Ok(())
        });
        watch.end();
        done
    }

    fn has_images(&self, id: BlockId) -> bool {
        self.images.has(self.picture.place(id))
    }

    /// Takes images that were denoised elsewhere, instead of filtering.
    ///
    /// # Errors
    /// Those of reading the images and of the disk.
    pub(crate) fn take(&self, basis: &ExternalImages, watch: &dyn Progress) -> Result<()> {
        if self.shape.blocks().all(|id| self.has_images(id)) {
            return Ok(());
        }
        watch.begin("reading denoised images", u64::from(self.shape.block_count()), "blocks");
        let done = basis.read().and_then(|images| {
            for id in self.shape.blocks().filter(|&id| !self.has_images(id)) {
                self.images.append(self.picture.place(id), &[&images.bytes_of(self.shape.rect(id))])?;
                watch.advance(1, 0, "px");
            }
            Ok(())
        });
        watch.end();
        done
    }

    /// Filters the blocks of one window, from the top down.
    fn filter_window(&self, blocks: &[BlockId], pool: &Pool, watch: &dyn Progress) -> Result<()> {
        let (whole, region) = with_halo(self.shape, blocks, self.halo);
        let top = whole.y;
        let part = DenoisedRegion {
            size: (whole.width as usize, whole.height as usize),
            block: self.shape.block_side() as usize,
            region,
            features: FEATURE_PLANES,
            groups: self.groups.of_cluster().to_vec(),
            origin: self.origin,
        };
        let mut denoising = Denoiser::new(part, reach_in(self.shape), &self.guides, pool);
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
        if self.has_images(id) {
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
        self.images.append(self.picture.place(id), &[&bytes, bytemuck::cast_slice(&errors)])
    }

    /// What the denoised picture says of all blocks, with the map from clusters to columns, which blocks are spread with from here on.
    /// After the images are denoised.
    ///
    /// # Errors
    /// Those of the disk; [`crate::Error::Interrupted`] when the watch says so.
    pub(crate) fn fit(&mut self, job: &Job, watch: &dyn Progress) -> Result<PictureFit> {
        let fits = self.clusters < self.shape.columns();
        if fits {
            watch.begin("fitting columns", self.blocks().len() as u64, "blocks");
        }
        let fit = self.sum_windows(job, fits, watch).map(|sums| sums.fit(&job.basis));
        if fits {
            watch.end();
        }
        let fit = fit?;
        self.map.clone_from(&fit.map);
        Ok(fit)
    }

    fn sum_windows(&self, job: &Job, says: bool, watch: &dyn Progress) -> Result<PictureSums> {
        let mean = self.mean_light()?;
        let mut whole = PictureSums::new(job);
        let wanted: HashSet<BlockId> = self.blocks().into_iter().collect();
        for places in self.picture.ranges() {
            let blocks = self.picture.blocks(&places).iter().copied().filter(|id| wanted.contains(id));
            let advance = || {
                if says {
                    watch.advance(1, 0, "px")
                }
            };
            let sums = self
                .window_sums(blocks, mean, || stop_if_interrupted(&self.gathering.path, watch).map(|()| advance()))?;
            whole.add(&places, sums);
        }
        Ok(whole)
    }

    /// Sums over the denoised blocks of a window. `mean` is that of [`mean_light`](Self::mean_light) over the whole picture; `go_on` is
    /// asked before each block.
    ///
    /// # Errors
    /// Those of the disk and of `go_on`.
    pub(crate) fn window_sums(
        &self,
        blocks: impl Iterator<Item = BlockId>,
        mean: f64,
        mut go_on: impl FnMut() -> Result<()>,
    ) -> Result<WindowSums> {
        let columns = self.shape.columns();
        let mut tiles = (self.clusters < columns).then(|| ColumnUpsampler::new(self.clusters, columns));
        let mut sums = Vec::new();
        for id in blocks {
            go_on()?;
            let (bytes, errors) = self.image_bytes(id)?;
            let rect = self.shape.rect(id);
            let images = tile_means(&floats(&bytes), (rect.width as usize, rect.height as usize));
            let of_cluster = images.chunks_exact(images.len() / self.clusters);
            let light = of_cluster.map(|image| image.iter().map(|&v| f64::from(v)).sum()).collect();
            let roots = self.roots_of_light(&images);
            sums.push(DenoisedBlockSums { light, roots, errors: errors.unwrap_or_default() });
            if let Some(tiles) = &mut tiles {
                self.add_tiles(tiles, &images, &self.gathering.tiles(id)?, mean);
            }
        }
        Ok(WindowSums { blocks: sums, tiles })
    }

    /// For each group of lights, and at last for all, the sum of the roots of the light of a block's tiles.
    fn roots_of_light(&self, images: &[f32]) -> Vec<f64> {
        let groups = self.groups.count();
        let of_image = images.len() / self.clusters;
        let tiles = of_image / CHANNELS;
        let mut light = vec![0.0f32; (groups + 1) * tiles];
        for (image, &group) in images.chunks_exact(of_image).zip(self.groups.of_cluster()) {
            for channel in image.chunks_exact(tiles) {
                for sums in [usize::from(group), groups] {
                    light[sums * tiles..][..tiles].iter_mut().zip(channel).for_each(|(sum, value)| *sum += value);
                }
            }
        }
        let root = |&value: &f32| f64::from(value.max(0.0)).sqrt();
        light.chunks_exact(tiles).map(|light| light.iter().map(root).sum()).collect()
    }

    /// Adds the tiles of a block to the fit: of its cluster images and of all columns.
    fn add_tiles(&self, fit: &mut ColumnUpsampler, images: &[f32], columns: &[f32], mean: f64) {
        let (mut of_images, mut of_columns) = (vec![0.0; self.clusters], vec![0.0; self.shape.columns()]);
        let each = images.len() / self.clusters;
        for row in 0..each {
            of_images.iter_mut().enumerate().for_each(|(i, v)| *v = images[i * each + row]);
            of_columns.iter_mut().enumerate().for_each(|(j, v)| *v = columns[j * each + row]);
            let light: f64 = of_images.iter().map(|&v| f64::from(v)).sum();
            // Errors count relatively in tiles brighter than the mean, and absolutely in darker ones.
            let scale = light.max(0.0) + mean;
            if scale > 0.0 && of_columns.iter().all(|v| v.is_finite()) {
                fit.add(row % 2, &of_images, &of_columns, 1.0 / (scale * scale));
            }
        }
    }

    /// Mean over tiles and channels of the image of the samples with all columns on.
    fn mean_light(&self) -> Result<f64> {
        if self.clusters == self.shape.columns() {
            return Ok(0.0);
        }
        let blocks = self.blocks();
        let lights = blocks.iter().map(|&id| self.gathering.light(id)).collect::<Result<Vec<_>>>()?;
        Ok(mean_of(self.shape, self.clusters, blocks.into_iter().zip(lights)))
    }

    /// The stored bytes of a block's denoised images, and the error sums if they were denoised here.
    fn image_bytes(&self, id: BlockId) -> Result<(Vec<u8>, Option<Vec<ErrorSums>>)> {
        let place = self.picture.place(id);
        let mut bytes = self.images.read(place)?;
        let images = 4 * self.shape.rect(id).rows() * self.clusters;
        let of_errors = size_of::<ErrorSums>() * self.groups.count();
        let Some(rest) = bytes.get(images..).filter(|rest| rest.is_empty() || rest.len() == of_errors) else {
            return Err(self.images.damaged(place, "it is cut short"));
        };
        let errors = (!rest.is_empty())
            .then(|| rest.chunks_exact(size_of::<ErrorSums>()).map(bytemuck::pod_read_unaligned).collect());
        bytes.truncate(images);
        Ok((bytes, errors))
    }

    /// The denoised images of a block, clusters × channels × pixels.
    fn images_of(&self, id: BlockId) -> Result<Vec<f32>> {
        Ok(floats(&self.image_bytes(id)?.0))
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
        let spreading = self.gathering.spreading(id)?;
        let images = self.images_of(id)?;
        let map = ClusterMap { clusters: &self.partition, shares: &self.map };
        self.gathering.spread(id, &spreading, images, map, &mut target.block)?;
        let emission = spreading.emission;
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

/// The mean over tiles and channels, from the sum of each block's tiles, in order.
pub(crate) fn mean_of(shape: MatrixShape, clusters: usize, lights: impl Iterator<Item = (BlockId, f64)>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (id, light) in lights {
        sum += light;
        count += tile_values(shape, shape.rect(id), clusters as u64) / shape.columns();
    }
    sum.max(0.0) / count.max(1) as f64
}

/// The part of the image that filtering some blocks reads, and where in it the blocks lie.
fn with_halo(shape: MatrixShape, blocks: &[BlockId], halo: u32) -> (PixelRect, Region) {
    let rects = || blocks.iter().map(|&id| shape.rect(id));
    let across = rects().map(|r| r.x).min().unwrap_or(0)..rects().map(|r| r.x + r.width).max().unwrap_or(0);
    let down = rects().map(|r| r.y).min().unwrap_or(0)..rects().map(|r| r.y + r.height).max().unwrap_or(0);
    // Steps end at borders of blocks, counted from the top.
    let top = down.start.saturating_sub(halo) / shape.block_side() * shape.block_side();
    let left = across.start.saturating_sub(halo);
    let (right, bottom) = ((across.end + halo).min(shape.width()), (down.end + halo).min(shape.height()));
    let whole = PixelRect { x: left, y: top, width: right - left, height: bottom - top };
    let within = |range: Range<u32>, from: u32| (range.start - from) as usize..(range.end - from) as usize;
    (whole, Region { x: within(across, left), y: within(down, top) })
}

/// The blocks whose planes denoising a window of the picture reads, ascending.
#[cfg(feature = "scene")]
pub(crate) fn blocks_read(shape: MatrixShape, places: &Range<u32>) -> Vec<BlockId> {
    let (whole, _) = with_halo(shape, PictureWindows::of(shape).blocks(places), reach_in(shape).halo() as u32);
    let side = shape.block_side();
    let blocks = |begin: u32, size: u32| begin / side..(begin + size).div_ceil(side);
    let across = blocks(whole.x, whole.width);
    blocks(whole.y, whole.height)
        .flat_map(|row| across.clone().map(move |column| BlockId(row * shape.blocks_across() + column)))
        .collect()
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
