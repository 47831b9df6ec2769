//! Relighting a matrix whose factors do not fit into memory, with the same bits as if they did.
//!
//! The budget is spent on stored chunks first: they are smaller than the factors that they hold and spare the disk. What is
//! left holds factors, which spares the decoding.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

use rayon::prelude::*;

use super::compact::CompactBlock;
use super::cpu::{check_columns, check_size, relight_block};
use super::lighting::LightingCoefficients;
use super::pager::{Detail, Pager, plan};
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, ColumnTransform, FactorSource, MatrixShape};

/// Memory that a chunk takes beside its bytes: its entries in the maps of pages, chunks and uses.
const CHUNK_OVERHEAD_BYTES: u64 = 192;

/// What was read of a source, and what became of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reads {
    /// Layers of blocks.
    pub chunks: u64,
    /// Their bytes in the source.
    pub bytes: u64,
    /// Blocks that were decoded, each time counted.
    pub decodes: u64,
}

/// Relights from a source that is read as it is needed; the blocks used last stay within a budget.
///
/// Beside the budget, each thread that reads holds one block while it is decoded.
pub struct PagedRelighter<'a> {
    source: BlockReader<'a>,
    shape: MatrixShape,
    /// Made when it is first needed, since that may read.
    transform: OnceLock<Arc<ColumnTransform>>,
    state: Mutex<State>,
}

/// The source of factors, borrowed or shared.
enum BlockReader<'a> {
    Borrowed(&'a dyn FactorSource),
    Shared(Arc<dyn FactorSource>),
}

impl<'a> Deref for BlockReader<'a> {
    type Target = dyn FactorSource + 'a;

    fn deref(&self) -> &Self::Target {
        match self {
            Self::Borrowed(source) => *source,
            Self::Shared(source) => &**source,
        }
    }
}

struct State {
    /// Stored layers of blocks.
    stored: Pager<(BlockId, u32)>,
    chunks: HashMap<(BlockId, u32), Arc<Vec<u8>>>,
    /// Blocks of factors.
    pager: Pager<BlockId>,
    held: HashMap<BlockId, Arc<HeldBlock>>,
    damage: BTreeMap<BlockId, String>,
    reads: Reads,
}

/// A block in memory.
pub(super) struct HeldBlock {
    /// `None` if nothing of it could be read.
    pub(super) block: Option<Arc<CompactBlock>>,
    pub(super) detail: Detail,
}

impl HeldBlock {
    fn bytes(&self) -> u64 {
        let block = self.block.as_ref().map_or(0, |block| size_of::<CompactBlock>() + block.bytes());
        (size_of::<Self>() + block) as u64
    }
}

/// A block that was asked for, and whether it stays in memory.
struct Fetched {
    held: Arc<HeldBlock>,
    is_kept: bool,
}

/// The stored layers of a block.
struct Chunks {
    chunks: Vec<Arc<Vec<u8>>>,
    /// The damage that ended the layers early.
    damage: Option<Error>,
    /// Whether all of them stay in memory.
    is_kept: bool,
}

impl<'a> PagedRelighter<'a> {
    /// A relighter that holds at most `budget_bytes` of chunks and factors. Reads nothing yet.
    pub fn new(source: &'a dyn FactorSource, budget_bytes: u64) -> Self {
        Self::over(BlockReader::Borrowed(source), budget_bytes)
    }

    /// As [`new`](Self::new), over a source that others may hold too, so that the relighter depends on no one's life.
    pub fn sharing(source: Arc<dyn FactorSource>, budget_bytes: u64) -> PagedRelighter<'static> {
        PagedRelighter::over(BlockReader::Shared(source), budget_bytes)
    }

    fn over(source: BlockReader<'a>, budget_bytes: u64) -> Self {
        let shape = source.shape();
        let stored_bytes = |id: BlockId| {
            let layers = source.layer_count(id);
            source.encoded_bytes(id, 0..layers) + u64::from(layers) * CHUNK_OVERHEAD_BYTES
        };
        let stored_budget = shape.blocks().map(stored_bytes).sum::<u64>().min(budget_bytes);
        let state = State {
            stored: Pager::new(stored_budget),
            chunks: HashMap::new(),
            pager: Pager::new(budget_bytes - stored_budget),
            held: HashMap::new(),
            damage: BTreeMap::new(),
            reads: Reads::default(),
        };
        Self { source, shape, transform: OnceLock::new(), state: Mutex::new(state) }
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// What columns of the blocks are divided by; empty where all are 1.
    #[cfg(feature = "gpu")]
    pub(super) fn column_scales(&self) -> &[f32] {
        self.source.column_scales()
    }

    /// The transform in whose coefficients right sides are held.
    pub(super) fn column_transform(&self) -> &Arc<ColumnTransform> {
        self.transform.get_or_init(|| self.source.column_transform())
    }

    /// The image under `lighting`: every block with all its layers.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix, what the source reports other than damage, and
    /// factors that do not fit the shape or are not finite.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        let all: Vec<BlockId> = self.shape.blocks().collect();
        self.relight_view(lighting, &all, Detail::Whole, &mut image)?;
        Ok(image)
    }

    /// Computes the pixels of the blocks in view; these stay in memory as far as the budget allows. With
    /// [`Detail::Base`], blocks that are in memory show all they have, and of the others only base layers are read: a
    /// first image before one with [`Detail::Whole`].
    ///
    /// # Errors
    /// As [`relight`](Self::relight), and an image of another size than the matrix.
    pub fn relight_view(
        &self,
        lighting: &Lighting,
        view: &[BlockId],
        detail: Detail,
        image: &mut LinearImage,
    ) -> Result<()> {
        check_columns(self.shape, lighting)?;
        check_size(self.shape, image)?;
        let seen: HashSet<BlockId> = view.iter().copied().collect();
        self.set_view(view);
        let lighting = LightingCoefficients::new(lighting, self.source.column_scales(), self.column_transform());
        for_each_tile(image, self.shape, |mut tile| {
            if seen.contains(&tile.id) {
                let held = self.fetch(tile.id, detail)?;
                relight_block(held.block.as_deref(), &lighting, &mut tile);
            }
            Ok(())
        })
    }

    /// Says which blocks are seen from now on: they and their chunks are not evicted.
    pub(super) fn set_view(&self, view: &[BlockId]) {
        let layers = view.iter().flat_map(|&id| (0..self.source.layer_count(id)).map(move |layer| (id, layer)));
        let mut state = self.lock();
        state.stored.set_view(layers);
        state.pager.set_view(view.iter().copied());
    }

    /// Decodes first what the view lacks, then nearby blocks, base layers before the rest, until the budget is full.
    /// Then reads as many of the remaining chunks as there is room for. Evicts nothing that is in view.
    ///
    /// # Errors
    /// As [`relight`](Self::relight).
    pub fn prefetch(&self, view: &[BlockId], nearby: &[BlockId]) -> Result<()> {
        // What lies nearby must not drive out what else lies there, but gives way to what will be seen.
        self.set_view(&[view, nearby].concat());
        let read = self.fill(view, nearby);
        self.set_view(view);
        read
    }

    fn fill(&self, view: &[BlockId], nearby: &[BlockId]) -> Result<()> {
        let steps = {
            let state = self.lock();
            plan(view, nearby, |id| state.pager.detail(id))
        };
        // In the order of the plan, in batches that keep all threads busy.
        let mut batches = steps.chunks(2 * rayon::current_num_threads());
        for batch in batches.by_ref() {
            let fetched: Vec<Fetched> =
                batch.par_iter().map(|&(id, detail)| self.fetch_kept(id, detail)).collect::<Result<_>>()?;
            if fetched.iter().any(|fetched| !fetched.is_kept) {
                break;
            }
        }
        for &(id, detail) in batches.flatten() {
            if !self.chunks(id, detail)?.is_kept {
                break;
            }
        }
        Ok(())
    }

    /// The block in at least this detail, from memory or from the source.
    pub(super) fn fetch(&self, id: BlockId, wanted: Detail) -> Result<Arc<HeldBlock>> {
        self.fetch_kept(id, wanted).map(|fetched| fetched.held)
    }

    /// The block, if it is in memory in at least this detail.
    pub(super) fn at_hand(&self, id: BlockId, wanted: Detail) -> Option<Arc<HeldBlock>> {
        let mut state = self.lock();
        state.pager.touch(id)?;
        state.held.get(&id).filter(|held| held.detail >= wanted).cloned()
    }

    fn fetch_kept(&self, id: BlockId, wanted: Detail) -> Result<Fetched> {
        if let Some(held) = self.at_hand(id, wanted) {
            return Ok(Fetched { held, is_kept: true });
        }
        let held = Arc::new(self.read(id, wanted)?);
        let mut state = self.lock();
        let admission = state.pager.admit(id, held.detail, held.bytes());
        for evicted in admission.evicted {
            state.held.remove(&evicted);
        }
        // Another thread may have read the same block: the pager keeps what has more detail.
        if admission.kept && state.held.get(&id).is_none_or(|other| other.detail < held.detail) {
            state.held.insert(id, Arc::clone(&held));
        }
        Ok(Fetched { held, is_kept: admission.kept })
    }

    /// Reads and decodes a block. A damaged layer ends it where it stands.
    fn read(&self, id: BlockId, wanted: Detail) -> Result<HeldBlock> {
        let all = self.source.layer_count(id) as usize;
        let Chunks { chunks, mut damage, .. } = self.chunks(id, wanted)?;
        let mut chunks: Vec<Vec<u8>> = chunks.iter().map(|chunk| chunk.to_vec()).collect();
        let is_whole = chunks.len() == all;
        let block = loop {
            if chunks.is_empty() && all > 0 {
                break None;
            }
            self.lock().reads.decodes += 1;
            match self.source.decode_coded(id, &chunks) {
                Ok(block) => break Some(block),
                Err(error @ Error::Damaged { .. }) => damage = damage.or(Some(error)),
                Err(other) => return Err(other),
            }
            if chunks.pop().is_none() {
                break None;
            }
        };
        let compact = |block| CompactBlock::new(self.shape, id, block, self.column_transform()).map(Arc::new);
        let block = block.map(compact).transpose()?;
        // Of a damaged block there is no more than this.
        let detail = if is_whole || damage.is_some() { Detail::Whole } else { Detail::Base };
        if let Some(error) = damage {
            self.lock().damage.entry(id).or_insert_with(|| error.to_string());
        }
        Ok(HeldBlock { block, detail })
    }

    /// The stored layers of a block, from memory or from the source, up to the first that is damaged.
    fn chunks(&self, id: BlockId, wanted: Detail) -> Result<Chunks> {
        let all = self.source.layer_count(id);
        let count = if wanted == Detail::Base { all.min(1) } else { all };
        let mut found = Chunks { chunks: Vec::with_capacity(count as usize), damage: None, is_kept: true };
        for layer in 0..count {
            let key = (id, layer);
            let at_hand = {
                let mut state = self.lock();
                state.stored.touch(key).and_then(|_| state.chunks.get(&key).cloned())
            };
            if let Some(chunk) = at_hand {
                found.chunks.push(chunk);
                continue;
            }
            let chunk = match self.source.stored_layer(id, layer) {
                Ok(bytes) => Arc::new(bytes),
                Err(error @ Error::Damaged { .. }) => {
                    found.damage = Some(error);
                    break;
                }
                Err(other) => return Err(other),
            };
            let mut state = self.lock();
            state.reads.chunks += 1;
            state.reads.bytes += self.source.encoded_bytes(id, layer..layer + 1);
            let admission = state.stored.admit(key, Detail::Whole, chunk.len() as u64 + CHUNK_OVERHEAD_BYTES);
            for evicted in admission.evicted {
                state.chunks.remove(&evicted);
            }
            if admission.kept {
                state.chunks.insert(key, Arc::clone(&chunk));
            }
            found.is_kept &= admission.kept;
            found.chunks.push(chunk);
        }
        Ok(found)
    }

    /// One line for each block found so far that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> Vec<String> {
        self.lock().damage.values().cloned().collect()
    }

    /// Bytes of chunks and factors in memory.
    pub fn resident_bytes(&self) -> u64 {
        let state = self.lock();
        state.stored.used_bytes() + state.pager.used_bytes()
    }

    /// Counts of the reads so far.
    pub fn reads(&self) -> Reads {
        self.lock().reads
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // What happens under the lock leaves it in order at every step that could panic.
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}
