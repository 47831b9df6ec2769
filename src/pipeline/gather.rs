//! What cleaning needs of each block, taken while the block is there: the planes of its clusters, its features, the emission
//! that it sees, and means of tiles of all columns. The rest of the block is never needed again.

use std::path::PathBuf;
use std::sync::Mutex;

use rayon::prelude::*;

use super::pack::stop_if_interrupted;
use super::records::Records;
use crate::clean::{self, Rows, Tally, Window};
use crate::error::{Error, Result};
use crate::host::{Threads, Watch};
use crate::matrix::{
    BlockId, BlockPlanes, CHANNELS, FEATURE_PLANES, MatrixShape, PixelRect, SeenEmission, TracedBlock, decode_unsigned,
    encode_unsigned,
};

/// A block of a window: where it stands and what was gathered of it.
pub(super) struct Gathered {
    rect: PixelRect,
    planes: BlockPlanes,
    /// Means of tiles of all columns without emission, columns × channels × tiles; empty where every column is a cluster.
    tiles: Vec<f32>,
}

/// Takes it, and gives it back block by block.
pub(super) struct Gathering {
    /// What its records are beside, for messages.
    pub(super) path: PathBuf,
    pub(super) shape: MatrixShape,
    pub(super) clusters: usize,
    pub(super) records: Records,
}

impl Gathering {
    /// Takes from each of these blocks what filtering needs of it. `make` puts a block into its target and says how much work that was,
    /// in `work_unit`. What is there already is read.
    ///
    /// # Errors
    /// A block without planes; those of `make` and of the disk; [`Error::Interrupted`] when the watch says so.
    pub(super) fn gather(
        &self,
        blocks: &[BlockId],
        threads: &Threads,
        (stage, work_unit): (&str, &str),
        watch: &dyn Watch,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<Tally> {
        let total = Mutex::new(Tally::new(self.clusters));
        watch.begin(stage, blocks.len() as u64, "blocks");
        let gather = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
            let mut tally = Tally::new(self.clusters);
            let work = self.take(id, block, watch, &make, Some(&mut tally))?;
            total.lock().unwrap_or_else(|e| e.into_inner()).merge(&tally);
            watch.advance(1, work, work_unit);
            Ok(())
        };
        let done = threads.run(|| -> Result<()> { blocks.par_iter().map_init(TracedBlock::default, gather).collect() });
        watch.end();
        done?;
        Ok(total.into_inner().unwrap_or_else(|e| e.into_inner()))
    }

    /// Takes from one block what filtering needs of it, unless it is there, and adds it to a tally; gives the work that it was.
    ///
    /// # Errors
    /// Those of [`gather`](Self::gather).
    pub(super) fn take(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        watch: &dyn Watch,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
        tally: Option<&mut Tally>,
    ) -> Result<u64> {
        stop_if_interrupted(&self.path, watch)?;
        let rect = self.shape.rect(id);
        if self.records.has(id.0) {
            if let Some(tally) = tally {
                tally.add(&self.window_of(&[self.read(id)?], rect));
            }
            return Ok(0);
        }
        let work = make(id, block)?;
        let planes = block.planes.take().ok_or_else(|| {
            let hint = "pack it as it is, with --denoise off";
            Error::input(id.to_string(), "its samples were not kept apart, so it cannot be cleaned", hint)
        })?;
        let tiles = self.tiles_of(block.block.entries(), rect, &planes.emission);
        let gathered = Gathered { rect, planes, tiles };
        self.records.append(id.0, &[&encode(&gathered)])?;
        if let Some(tally) = tally {
            tally.add(&self.window_of(std::slice::from_ref(&gathered), rect));
        }
        block.planes = Some(gathered.planes);
        Ok(work)
    }

    pub(super) fn empty_window(&self, whole: PixelRect) -> Window {
        let rows = |planes| Rows::zeros(whole.width as usize, whole.height as usize, planes);
        let light = 2 * CHANNELS * self.clusters;
        Window {
            direct: rows(light),
            indirect: rows(light),
            features: rows(FEATURE_PLANES),
            feature_variance: rows(FEATURE_PLANES),
        }
    }

    fn window_of(&self, blocks: &[Gathered], whole: PixelRect) -> Window {
        let mut window = self.empty_window(whole);
        blocks.iter().for_each(|block| self.put(block, whole, &mut window));
        window
    }

    /// Puts what lies in `whole` of a block into a window.
    pub(super) fn put(&self, block: &Gathered, whole: PixelRect, window: &mut Window) {
        let Gathered { rect, planes, .. } = block;
        let (left, top) = (rect.x.max(whole.x), rect.y.max(whole.y));
        let right = (rect.x + rect.width).min(whole.x + whole.width);
        let bottom = (rect.y + rect.height).min(whole.y + whole.height);
        let copy = |from: &[f32], target: &mut Rows, first: usize| {
            for (plane, from) in from.chunks_exact(rect.pixels()).enumerate() {
                for y in top..bottom {
                    let from = &from[((y - rect.y) * rect.width + left - rect.x) as usize..][..(right - left) as usize];
                    let row = target.row_mut(first + plane, (y - whole.y) as usize);
                    row[(left - whole.x) as usize..][..from.len()].copy_from_slice(from);
                }
            }
        };
        for half in 0..2 {
            copy(&planes.direct[half], &mut window.direct, half * CHANNELS * self.clusters);
            copy(&planes.indirect[half], &mut window.indirect, half * CHANNELS * self.clusters);
        }
        copy(&planes.features, &mut window.features, 0);
        copy(&planes.feature_variance, &mut window.feature_variance, 0);
    }

    pub(super) fn read(&self, id: BlockId) -> Result<Gathered> {
        let bytes = self.records.read(id.0)?;
        Ok(self.parts(id, &bytes)?.decode(self.shape.rect(id), self.clusters))
    }

    /// The parts of what was gathered of a block.
    pub(super) fn parts<'a>(&self, id: BlockId, bytes: &'a [u8]) -> Result<Parts<'a>> {
        let rect = self.shape.rect(id);
        let tiles = tile_values(self.shape, rect, self.clusters as u64);
        let parts = Parts::of(bytes, rect.pixels(), self.clusters, tiles);
        parts.ok_or_else(|| self.records.damaged(id.0, "it is cut short"))
    }

    /// See [`Gathered::tiles`].
    fn tiles_of(&self, entries: &[f32], rect: PixelRect, emission: &[SeenEmission]) -> Vec<f32> {
        if tile_values(self.shape, rect, self.clusters as u64) == 0 {
            return Vec::new();
        }
        let (width, height) = (rect.width as usize, rect.height as usize);
        let mut tiles = clean::tile_means(entries, (width, height));
        let (across, down) = (width.div_ceil(clean::TILE), height.div_ceil(clean::TILE));
        for seen in emission {
            let (x, y) = (seen.pixel as usize % width / clean::TILE, seen.pixel as usize / width / clean::TILE);
            let within = |at: usize, size: usize| clean::TILE.min(size - at * clean::TILE);
            let share = 1.0 / (within(x, width) * within(y, height)) as f32;
            for (channel, value) in seen.value.iter().enumerate() {
                tiles[((seen.column as usize * CHANNELS + channel) * down + y) * across + x] -= share * value;
            }
        }
        tiles
    }
}

/// Values that a block has in [`Gathered::tiles`].
pub(super) fn tile_values(shape: MatrixShape, rect: PixelRect, clusters: u64) -> usize {
    if clusters == shape.columns() as u64 {
        return 0;
    }
    let tiles = |side: u32| (side as usize).div_ceil(clean::TILE);
    CHANNELS * shape.columns() * tiles(rect.width) * tiles(rect.height)
}

/// What was gathered of a block for the file: light and variances as tracing rounds them, the rest as it is.
fn encode(Gathered { planes, tiles, .. }: &Gathered) -> Vec<u8> {
    let mut bytes = Vec::new();
    let light = planes.direct.iter().chain(&planes.indirect);
    for value in light.chain([&planes.feature_variance]).flatten() {
        bytes.extend(encode_unsigned(*value).to_ne_bytes());
    }
    bytes.extend_from_slice(bytemuck::cast_slice(&planes.features));
    bytes.extend_from_slice(bytemuck::cast_slice(tiles));
    bytes.extend_from_slice(bytemuck::cast_slice(&planes.emission));
    bytes
}

/// What was gathered of a block, as the file has it ([`encode`]).
pub(super) struct Parts<'a> {
    halves: &'a [u8],
    features: &'a [u8],
    pub(super) tiles: &'a [u8],
    emission: &'a [u8],
}

impl<'a> Parts<'a> {
    /// None if there is too little of it.
    fn of(bytes: &'a [u8], pixels: usize, clusters: usize, tiles: usize) -> Option<Self> {
        let light = pixels * CHANNELS * clusters;
        let (halves, rest) = bytes.split_at_checked(2 * (4 * light + FEATURE_PLANES * pixels))?;
        let (features, rest) = rest.split_at_checked(4 * FEATURE_PLANES * pixels)?;
        let (tiles, emission) = rest.split_at_checked(4 * tiles)?;
        Some(Self { halves, features, tiles, emission })
    }

    pub(super) fn emission(&self) -> Vec<SeenEmission> {
        self.emission.chunks_exact(size_of::<SeenEmission>()).map(bytemuck::pod_read_unaligned).collect()
    }

    fn decode(&self, rect: PixelRect, clusters: usize) -> Gathered {
        let light = rect.pixels() * CHANNELS * clusters;
        let mut values = self.halves.chunks_exact(2).map(|b| decode_unsigned(u16::from_ne_bytes([b[0], b[1]])));
        let mut take = |count: usize| values.by_ref().take(count).collect::<Vec<f32>>();
        let planes = BlockPlanes {
            direct: [take(light), take(light)],
            indirect: [take(light), take(light)],
            feature_variance: take(FEATURE_PLANES * rect.pixels()),
            features: floats(self.features),
            emission: self.emission(),
        };
        Gathered { rect, planes, tiles: floats(self.tiles) }
    }
}

pub(super) fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
}
