//! The inputs of the denoiser, taken from each block while it is in memory: the planes of its clusters, its features,
//! the emission seen, means of tiles of all columns, and the residual of its clusters. The rest of the block is never
//! needed again.

use std::collections::HashSet;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Mutex;

use rayon::prelude::*;

use super::{Denoiser, DenoiserRows, GuideStatistics, TILE, tile_means};
use crate::block_records::{GATHERED_PARTS, Records, stop_if_interrupted};
use crate::compress::{ClusterMap, ClusterResidual, CompressSettings, Compressor, CompressorPlan};
use crate::error::{Error, Hint, Result};
use crate::light::{Clusters, Job};
use crate::matrix::{
    Block, BlockId, BlockPlanes, CHANNELS, FEATURE_PLANES, MatrixShape, PixelRect, SeenEmission, TracedBlock,
    decode_unsigned, encode_unsigned,
};
use crate::resources::{JobStage, Progress, Threads};

/// The parts of a block's inputs, each a record of its own, since they are needed at different times: planes by the filter; tiles by
/// the fit of columns; what a block is spread with; and the sum of the tiles' light, from whose mean over the picture errors of tiles are
/// weighed.
const PLANES: u32 = 0;
const TILES: u32 = 1;
const SPREADING: u32 = 2;
const LIGHT: u32 = GATHERED_PARTS - 1;

/// The denoiser's inputs from one block.
struct BlockInputs {
    planes: BlockPlanes,
    /// Means of tiles of all columns without emission, columns × channels × tiles; empty if every column is a cluster.
    tiles: Vec<f32>,
    /// The residual that tells the columns of a cluster apart; empty if every column is a cluster.
    contrasts: Vec<u8>,
}

/// Writes and reads the per-block inputs of the denoiser.
pub(crate) struct DenoiseInputs {
    /// Path that the records belong to, for messages.
    pub(crate) path: PathBuf,
    pub(crate) shape: MatrixShape,
    pub(crate) clusters: usize,
    pub(crate) records: Records,
    /// Computes the residual of clusters; `None` if every column is a cluster.
    compressor: Option<Compressor>,
}

/// Largest number of components of the residual of clusters, and least ratio to the noise of each. Tuned: decision 21.
const CONTRAST_RANK: usize = 64;
const CONTRAST_OVER_NOISE: f64 = 2.0;

impl DenoiseInputs {
    /// For the blocks of a job; `path` is what the records are beside.
    ///
    /// # Errors
    /// Those of [`Compressor::new`].
    pub(crate) fn new(job: &Job, path: PathBuf, records: Records) -> Result<Self> {
        let clusters = Clusters::of_basis(&job.basis).count();
        let compressor =
            (clusters < job.shape.columns()).then(|| Compressor::new(&job.basis, job.shape, contrast_settings()));
        Ok(Self { path, shape: job.shape, clusters, records, compressor: compressor.transpose()? })
    }

    /// Upper bound of the bytes that one thread takes to gather a block, beside the block itself.
    pub(crate) fn takes_bytes(job: &Job) -> u64 {
        // Planes, tiles and residual, as values and as bytes; before them the compressor that computes the residual.
        let looking = match Self::contrast_bytes(job) {
            0 => 0,
            bytes => CompressorPlan::needs_bytes_for(job.shape, &contrast_settings()) + 2 * bytes,
        };
        2 * Self::record_bytes(job) + looking
    }

    /// Upper bound of the bytes that one thread takes to make a block from its record and its denoised images, beside
    /// the block itself.
    pub(crate) fn spreads_bytes(job: &Job) -> u64 {
        let (rows, columns) = (job.shape.max_block_rows() as u64, job.shape.columns() as u64);
        let clusters = Clusters::of_basis(&job.basis).count() as u64;
        // The images as bytes and as floats.
        let images = 2 * 4 * rows * clusters;
        match Self::contrast_bytes(job) {
            0 => Self::record_bytes(job) + images,
            bytes => {
                let rank = CONTRAST_RANK as u64 + 1;
                // Both factors of the product, their energies in f64, and the sums that keep entries positive.
                let sides = 4 * (rows * (2 * clusters + rank) + columns * (clusters + 2 * rank));
                Self::record_bytes(job) + bytes + images + sides + 24 * columns * rank + 8 * rows * clusters
            }
        }
    }

    /// Upper bound of the bytes of a block's record, with as many sparse entries as are likely.
    fn record_bytes(job: &Job) -> u64 {
        let (planes, tiles) = Self::plane_and_tile_bytes(job);
        planes + tiles + Self::contrast_bytes(job)
    }

    /// Bytes of the planes of a block, and of its tiles, at most.
    pub(crate) fn plane_and_tile_bytes(job: &Job) -> (u64, u64) {
        let clusters = Clusters::of_basis(&job.basis).count() as u64;
        let side = job.shape.block_side();
        let tiles = tile_values(job.shape, PixelRect { x: 0, y: 0, width: side, height: side }, clusters);
        (BlockPlanes::fixed_bytes(u64::from(side).pow(2), clusters), 4 * tiles as u64)
    }

    /// Likely upper bound of the bytes of a block's residual.
    pub(crate) fn contrast_bytes(job: &Job) -> u64 {
        let columns = job.shape.columns() as u64;
        if Clusters::of_basis(&job.basis).count() as u64 == columns {
            return 0;
        }
        ClusterResidual::bytes(job.shape.max_block_rows() as u64, columns, CONTRAST_RANK as u64)
    }

    /// Gathers the denoiser's inputs of these blocks. `make` fills a block and returns the amount of work, in
    /// `work_unit`. Records that exist are read.
    ///
    /// # Errors
    /// A block without planes; those of `make` and of the disk; [`Error::Interrupted`] when the watch says so.
    pub(crate) fn gather(
        &self,
        blocks: &[BlockId],
        threads: &Threads,
        stage: JobStage<'_>,
        watch: &dyn Progress,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<GuideStatistics> {
        let total = Mutex::new(GuideStatistics::new(self.clusters));
        watch.begin(stage.name, blocks.len() as u64, "blocks");
        let gather = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
            let mut tally = GuideStatistics::new(self.clusters);
            let work = self.take(id, block, watch, &make, Some(&mut tally))?;
            total.lock().unwrap_or_else(|e| e.into_inner()).merge(&tally);
            watch.advance(1, work, stage.work_unit);
            Ok(())
        };
        let done = threads.run(|| -> Result<()> { blocks.par_iter().map_init(TracedBlock::default, gather).collect() });
        watch.end();
        done?;
        Ok(total.into_inner().unwrap_or_else(|e| e.into_inner()))
    }

    /// Gathers the inputs of one block, unless they exist, and adds them to a tally; returns the amount of work.
    ///
    /// # Errors
    /// Those of [`gather`](Self::gather).
    pub(crate) fn take(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        watch: &dyn Progress,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
        tally: Option<&mut GuideStatistics>,
    ) -> Result<u64> {
        stop_if_interrupted(&self.path, watch)?;
        let rect = self.shape.rect(id);
        if self.has(id) {
            if let Some(tally) = tally {
                let bytes = self.records.read(self.key(PLANES, id))?;
                add_to(tally, &self.planes(id, &bytes)?.decode(rect.pixels(), self.clusters));
            }
            return Ok(0);
        }
        let work = make(id, block)?;
        let mut planes = block.planes.take().ok_or_else(|| {
            let problem = "its samples were not kept apart, so it cannot be denoised";
            Error::input(id.to_string(), problem, Hint::PackWithoutDenoising)
        })?;
        super::pixel_albedo::adopt(&mut planes);
        super::outliers::spread(&mut planes, rect.width as usize);
        let tiles = self.tiles_of(block.block.entries(), rect, &planes.emission);
        let contrasts = self.contrasts_of(id, block, &planes.emission);
        let gathered = BlockInputs { planes, tiles, contrasts };
        let light = light_of(&gathered.tiles);
        // The last that is written says that all are there.
        for (part, bytes) in encode(&gathered).iter().map(Vec::as_slice).chain([&light.to_ne_bytes()[..]]).enumerate() {
            self.records.append(self.key(part as u32, id), &[bytes])?;
        }
        if let Some(tally) = tally {
            add_to(tally, &gathered.planes);
        }
        block.planes = Some(gathered.planes);
        Ok(work)
    }

    /// Fills rows of a rectangle of the image with the gathered planes. The rows are those of whole blocks, as far as
    /// they lie in the rectangle; blocks are read a few at a time.
    ///
    /// # Errors
    /// Those of the disk.
    pub(crate) fn put(
        &self,
        whole: PixelRect,
        wanted: &Range<usize>,
        at_once: usize,
        denoising: &mut Denoiser<'_>,
    ) -> Result<()> {
        if wanted.is_empty() {
            return Ok(());
        }
        let side = self.shape.block_side();
        let blocks = |begin: u32, size: u32| begin / side..(begin + size).div_ceil(side);
        let part = PixelRect { y: whole.y + wanted.start as u32, height: wanted.len() as u32, ..whole };
        let rows: Vec<u32> = blocks(part.y, part.height).collect();
        let border = |row: &u32| ((row * side).saturating_sub(whole.y) as usize).max(wanted.start);
        let borders: Vec<usize> = rows.iter().map(border).collect();
        let columns = blocks(whole.x, whole.width);
        let strips = rows.iter().zip(denoising.strips(wanted, &borders));
        let mut parts: Vec<_> = strips.map(|(row, strip)| (*row, columns.clone(), strip)).collect();
        for few in parts.chunks_mut(at_once) {
            few.par_iter_mut().try_for_each(|(row, columns, strip)| {
                let mut bytes = Vec::new();
                for column in columns {
                    let id = BlockId(*row * self.shape.blocks_across() + column);
                    self.records.read_into(self.key(PLANES, id), &mut bytes)?;
                    self.planes(id, &bytes)?.put(self.shape.rect(id), part, self.clusters, strip);
                }
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Key of a part of a block's inputs.
    fn key(&self, part: u32, id: BlockId) -> u32 {
        part * self.shape.block_count() + id.0
    }

    /// Whether the inputs of a block are there.
    pub(crate) fn has(&self, id: BlockId) -> bool {
        self.records.has(self.key(LIGHT, id))
    }

    fn planes<'a>(&self, id: BlockId, bytes: &'a [u8]) -> Result<EncodedPlanes<'a>> {
        let parts = EncodedPlanes::of(bytes, self.shape.rect(id).pixels(), self.clusters);
        parts.ok_or_else(|| self.records.damaged(self.key(PLANES, id), "it is cut short"))
    }

    /// Means of tiles of all columns of a block, see [`BlockInputs::tiles`].
    ///
    /// # Errors
    /// They cannot be read.
    pub(crate) fn tiles(&self, id: BlockId) -> Result<Vec<f32>> {
        let bytes = self.records.read(self.key(TILES, id))?;
        let tiles: Vec<f32> =
            bytes.as_chunks::<2>().0.iter().map(|bytes| decode_unsigned(u16::from_ne_bytes(*bytes))).collect();
        match tiles.len() == tile_values(self.shape, self.shape.rect(id), self.clusters as u64) {
            true => Ok(tiles),
            false => Err(self.records.damaged(self.key(TILES, id), "it is cut short")),
        }
    }

    /// Sum of the tiles of all columns of a block.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn light(&self, id: BlockId) -> Result<f64> {
        let bytes = self.records.read(self.key(LIGHT, id))?;
        let light = bytes.first_chunk::<8>().map(|bytes| f64::from_ne_bytes(*bytes));
        light.ok_or_else(|| self.records.damaged(self.key(LIGHT, id), "it is cut short"))
    }

    /// What a block is spread with beside its images.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn spreading(&self, id: BlockId) -> Result<Spreading> {
        let bytes = self.records.read(self.key(SPREADING, id))?;
        Spreading::of(&bytes).ok_or_else(|| self.records.damaged(self.key(SPREADING, id), "it is cut short"))
    }

    /// Makes a block of the images of its clusters, see [`Compressor::spread`].
    pub(crate) fn spread(
        &self,
        id: BlockId,
        spreading: &Spreading,
        images: Vec<f32>,
        map: ClusterMap<'_>,
        block: &mut Block,
    ) -> Result<()> {
        let Some(compressor) = &self.compressor else {
            // Every column is a cluster.
            block.entries_mut().copy_from_slice(&images);
            return Ok(());
        };
        let contrasts = ClusterResidual::from_bytes(&spreading.contrasts);
        let contrasts = contrasts.ok_or_else(|| self.records.damaged(self.key(SPREADING, id), "it is cut short"))?;
        compressor.spread(images, &contrasts, map, block);
        Ok(())
    }

    /// See [`BlockInputs::contrasts`].
    fn contrasts_of(&self, id: BlockId, block: &mut TracedBlock, emission: &[SeenEmission]) -> Vec<u8> {
        let Some(compressor) = &self.compressor else { return Vec::new() };
        let (candidate, _) = compressor.analyse_in_place(id, &mut block.block, block.noise.as_ref(), emission);
        let pixels = self.shape.rect(id).pixels() as u32;
        let seen: HashSet<(u32, u32)> = emission.iter().map(|seen| (seen.column, seen.pixel)).collect();
        compressor.contrasts(&candidate, |entry| seen.contains(&(entry.column.0, entry.row % pixels))).to_bytes()
    }

    /// See [`BlockInputs::tiles`].
    fn tiles_of(&self, entries: &[f32], rect: PixelRect, emission: &[SeenEmission]) -> Vec<f32> {
        if tile_values(self.shape, rect, self.clusters as u64) == 0 {
            return Vec::new();
        }
        let (width, height) = (rect.width as usize, rect.height as usize);
        let mut tiles = tile_means(entries, (width, height));
        let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
        for seen in emission {
            let (x, y) = (seen.pixel as usize % width / TILE, seen.pixel as usize / width / TILE);
            let within = |at: usize, size: usize| TILE.min(size - at * TILE);
            let share = 1.0 / (within(x, width) * within(y, height)) as f32;
            for (channel, value) in seen.value.iter().enumerate() {
                tiles[((seen.column as usize * CHANNELS + channel) * down + y) * across + x] -= share * value;
            }
        }
        tiles
    }
}

fn contrast_settings() -> CompressSettings {
    CompressSettings { rank: CONTRAST_RANK, noise_factor: Some(CONTRAST_OVER_NOISE), ..Default::default() }
}

/// Values that a block has in [`BlockInputs::tiles`].
pub(crate) fn tile_values(shape: MatrixShape, rect: PixelRect, clusters: u64) -> usize {
    if clusters == shape.columns() as u64 {
        return 0;
    }
    let tiles = |side: u32| (side as usize).div_ceil(TILE);
    CHANNELS * shape.columns() * tiles(rect.width) * tiles(rect.height)
}

/// What stands for a tile that is no number, and is none when it is decoded.
const NO_NUMBER: u16 = u16::MAX;

/// Encodes the parts of a block's inputs but the last: light and variances as tracing rounds them, the means of tiles in the same way,
/// which are as many bytes as all else together where there are many columns, and the rest unchanged.
fn encode(BlockInputs { planes, tiles, contrasts }: &BlockInputs) -> [Vec<u8>; LIGHT as usize] {
    let light = || planes.direct.iter().chain(&planes.indirect).chain([&planes.feature_variance]);
    let halves = 2 * light().map(Vec::len).sum::<usize>();
    let mut of_planes = Vec::with_capacity(halves + 4 * planes.features.len());
    of_planes.resize(halves, 0);
    for (bytes, value) in of_planes.chunks_exact_mut(2).zip(light().flatten()) {
        bytes.copy_from_slice(&encode_unsigned(*value).to_ne_bytes());
    }
    of_planes.extend_from_slice(bytemuck::cast_slice(&planes.features));
    let emission: &[u8] = bytemuck::cast_slice(&planes.emission);
    let spreading = [&(emission.len() as u64).to_ne_bytes()[..], emission, contrasts].concat();
    let rounded = |tile: &f32| if tile.is_finite() { encode_unsigned(*tile) } else { NO_NUMBER };
    let of_tiles = tiles.iter().flat_map(|tile| rounded(tile).to_ne_bytes()).collect();
    [of_planes, of_tiles, spreading]
}

/// Sum of the light of tiles, without those that are no number.
fn light_of(tiles: &[f32]) -> f64 {
    tiles.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v)).sum()
}

fn add_to(tally: &mut GuideStatistics, planes: &BlockPlanes) {
    tally.add(planes.direct.each_ref().map(Vec::as_slice), planes.indirect.each_ref().map(Vec::as_slice));
}

/// The planes of a block, as encoded in the file ([`encode`]).
struct EncodedPlanes<'a> {
    halves: &'a [u8],
    features: &'a [u8],
}

/// What a block is spread with beside its images.
pub(crate) struct Spreading {
    /// The emitters in view.
    pub(crate) emission: Vec<SeenEmission>,
    contrasts: Vec<u8>,
}

impl Spreading {
    /// `None` if the bytes are too few.
    fn of(bytes: &[u8]) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let (emission, contrasts) = rest.split_at_checked(u64::from_ne_bytes(*length) as usize)?;
        let emission = emission.chunks_exact(size_of::<SeenEmission>()).map(bytemuck::pod_read_unaligned).collect();
        Some(Self { emission, contrasts: contrasts.to_vec() })
    }
}

impl<'a> EncodedPlanes<'a> {
    /// `None` if the bytes are too few.
    fn of(bytes: &'a [u8], pixels: usize, clusters: usize) -> Option<Self> {
        let light = pixels * CHANNELS * clusters;
        let (halves, features) = bytes.split_at_checked(2 * (4 * light + FEATURE_PLANES * pixels))?;
        (features.len() == 4 * FEATURE_PLANES * pixels).then_some(Self { halves, features })
    }

    /// Copies the part inside `whole` into the rows of a window.
    fn put(&self, rect: PixelRect, whole: PixelRect, clusters: usize, strip: &mut DenoiserRows<'_>) {
        let light = 2 * CHANNELS * clusters;
        let plane = 2 * rect.pixels();
        let (direct, rest) = self.halves.split_at(light * plane);
        let (indirect, variance) = rest.split_at(light * plane);
        let of_half = |bytes: [u8; 2]| decode_unsigned(u16::from_ne_bytes(bytes));
        let placed = Placed { rect, whole };
        place(direct, placed, strip.direct, light, of_half);
        place(indirect, placed, strip.indirect, light, of_half);
        place(variance, placed, strip.feature_variance, FEATURE_PLANES, of_half);
        place(self.features, placed, strip.features, FEATURE_PLANES, f32::from_ne_bytes);
    }

    /// The light of the planes, without features and emission.
    fn decode(&self, pixels: usize, clusters: usize) -> BlockPlanes {
        let light = pixels * CHANNELS * clusters;
        let mut values = self.halves.chunks_exact(2).map(|b| decode_unsigned(u16::from_ne_bytes([b[0], b[1]])));
        let mut take = |count: usize| values.by_ref().take(count).collect::<Vec<f32>>();
        BlockPlanes {
            direct: [take(light), take(light)],
            indirect: [take(light), take(light)],
            ..BlockPlanes::default()
        }
    }
}

/// A block in a window of the image.
#[derive(Clone, Copy)]
struct Placed {
    /// The block.
    rect: PixelRect,
    /// The window.
    whole: PixelRect,
}

/// Puts the planes of a block, one after the other, into the rows of a window that it stands in: those of all planes row by row.
fn place<const BYTES: usize>(
    from: &[u8],
    Placed { rect, whole }: Placed,
    strip: &mut [f32],
    planes: usize,
    value: impl Fn([u8; BYTES]) -> f32,
) {
    let (from, _) = from.as_chunks::<BYTES>();
    let width = whole.width as usize;
    let left = rect.x.max(whole.x);
    let right = (rect.x + rect.width).min(whole.x + whole.width);
    let first_row = rect.y.max(whole.y) - rect.y;
    for (plane, from) in from.chunks_exact(rect.pixels()).enumerate() {
        let rows = from.chunks_exact(rect.width as usize).skip(first_row as usize);
        for (from, target) in rows.zip(strip.chunks_exact_mut(planes * width)) {
            let from = &from[(left - rect.x) as usize..(right - rect.x) as usize];
            let target = &mut target[plane * width + (left - whole.x) as usize..][..from.len()];
            target.iter_mut().zip(from).for_each(|(target, bytes)| *target = value(*bytes));
        }
    }
}

pub(crate) fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
}
