//! Relighting a matrix whose factors do not fit into memory, with the same bits as if they did.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard};

use rayon::prelude::*;

use super::compact::CompactBlock;
use super::cpu::{check_columns, relight_block};
use super::pager::{Detail, Pager};
use super::project::PlanarLighting;
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, FactorSource, MatrixShape};

/// What was read of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reads {
    /// Layers of blocks.
    pub chunks: u64,
    /// Their bytes in the source.
    pub bytes: u64,
}

/// Relights from a source that is read as it is needed; the blocks used last stay within a budget.
///
/// Beside the budget, each thread that reads holds one block while it is decoded.
pub struct PagedRelighter<'a> {
    source: &'a dyn FactorSource,
    shape: MatrixShape,
    state: Mutex<State>,
}

struct State {
    pager: Pager<BlockId>,
    held: HashMap<BlockId, Arc<Held>>,
    damage: BTreeMap<BlockId, String>,
    reads: Reads,
}

/// A block in memory.
pub(super) struct Held {
    /// None where nothing of it could be read.
    pub(super) block: Option<CompactBlock>,
    detail: Detail,
    /// The stored bytes of its base layer, which its other layers are decoded with; none once it is whole.
    base: Vec<u8>,
}

impl Held {
    fn bytes(&self) -> u64 {
        (size_of::<Self>() + self.base.len() + self.block.as_ref().map_or(0, CompactBlock::bytes)) as u64
    }
}

impl<'a> PagedRelighter<'a> {
    /// A relighter that holds at most `budget_bytes` of factors. Reads nothing yet.
    pub fn new(source: &'a dyn FactorSource, budget_bytes: u64) -> Self {
        let state = State {
            pager: Pager::new(budget_bytes),
            held: HashMap::new(),
            damage: BTreeMap::new(),
            reads: Reads::default(),
        };
        Self { source, shape: source.shape(), state: Mutex::new(state) }
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// The image under `lighting`: every block with all its layers.
    ///
    /// Errors: a lighting with another number of columns than the matrix, what the source reports other than damage, and
    /// factors that do not fit the shape or are not finite.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        let all: Vec<BlockId> = self.shape.blocks().collect();
        self.relight_view(lighting, &all, Detail::Whole, &mut image)?;
        Ok(image)
    }

    /// Sets the pixels of the blocks in view; those blocks stay in memory as far as the budget goes. With
    /// [`Detail::Base`], blocks of which more is at hand show it, and of the others only base layers are read: a first
    /// picture, to be followed by one with [`Detail::Whole`].
    ///
    /// Errors: as [`relight`](Self::relight), and an image of another size than the matrix.
    pub fn relight_view(
        &self,
        lighting: &Lighting,
        view: &[BlockId],
        detail: Detail,
        image: &mut LinearImage,
    ) -> Result<()> {
        check_columns(self.shape, lighting)?;
        if (image.width, image.height) != (self.shape.width(), self.shape.height()) {
            let problem = format!("is {} × {} pixels, not the matrix's size", image.width, image.height);
            return Err(Error::input("target image", problem, ""));
        }
        let view: HashSet<BlockId> = view.iter().copied().collect();
        self.lock().pager.set_view(view.iter().copied());
        let lighting = PlanarLighting::new(lighting);
        for_each_tile(image, self.shape, |mut tile| {
            if view.contains(&tile.id) {
                let held = self.fetch(tile.id, detail)?;
                relight_block(held.block.as_ref(), &lighting, &mut tile);
            }
            Ok(())
        })
    }

    /// Reads what the view lacks and then what lies nearby, until the budget is full; evicts nothing that is in view.
    ///
    /// Errors: as [`relight`](Self::relight).
    pub fn prefetch(&self, view: &[BlockId], nearby: &[BlockId]) -> Result<()> {
        let plan = {
            let mut state = self.lock();
            state.pager.set_view(view.iter().copied());
            state.pager.plan(view, nearby)
        };
        // Step by step in the order of the plan, in batches that keep all threads busy.
        for batch in plan.chunks(2 * rayon::current_num_threads()) {
            let full = {
                let state = self.lock();
                state.pager.used_bytes() >= state.pager.budget_bytes()
            };
            if full {
                break;
            }
            batch.par_iter().try_for_each(|&(id, detail)| self.fetch(id, detail).map(drop))?;
        }
        Ok(())
    }

    /// The block in at least this detail, from memory or from the source.
    pub(super) fn fetch(&self, id: BlockId, wanted: Detail) -> Result<Arc<Held>> {
        let before = {
            let mut state = self.lock();
            state.pager.touch(id).and_then(|_| state.held.get(&id).cloned())
        };
        if let Some(held) = before.as_ref().filter(|held| held.detail >= wanted) {
            return Ok(Arc::clone(held));
        }
        let base = before.map(|held| held.base.clone());
        let held = Arc::new(self.read(id, wanted, base)?);
        let mut state = self.lock();
        let admission = state.pager.admit(id, held.detail, held.bytes());
        for evicted in admission.evicted {
            state.held.remove(&evicted);
        }
        // Another thread may have read the same block: the pager keeps what has more detail.
        if admission.kept && state.held.get(&id).is_none_or(|other| other.detail < held.detail) {
            state.held.insert(id, Arc::clone(&held));
        }
        Ok(held)
    }

    /// Reads the layers that are missing. A damaged layer ends the block where it stands.
    fn read(&self, id: BlockId, wanted: Detail, base: Option<Vec<u8>>) -> Result<Held> {
        let all = self.source.layer_count(id) as usize;
        let count = if wanted == Detail::Base { all.min(1) } else { all };
        let mut chunks: Vec<Vec<u8>> = base.into_iter().collect();
        let mut damaged = false;
        let mut note = |error: Error| {
            damaged = true;
            self.lock().damage.entry(id).or_insert_with(|| error.to_string());
        };
        while chunks.len() < count {
            let layer = chunks.len() as u32;
            match self.source.stored_layer(id, layer) {
                Ok(bytes) => chunks.push(bytes),
                Err(error @ Error::Damaged { .. }) => {
                    note(error);
                    break;
                }
                Err(other) => return Err(other),
            }
            let mut state = self.lock();
            state.reads.chunks += 1;
            state.reads.bytes += self.source.encoded_bytes(id, layer..layer + 1);
        }
        let block = loop {
            if chunks.is_empty() && all > 0 {
                break None;
            }
            match self.source.decode_layers(id, &chunks) {
                Ok(block) => break Some(block),
                Err(error @ Error::Damaged { .. }) => note(error),
                Err(other) => return Err(other),
            }
            if chunks.pop().is_none() {
                break None;
            }
        };
        let block = block.map(|block| CompactBlock::new(self.shape, id, &block)).transpose()?;
        let whole = damaged || chunks.len() == all;
        let base = if whole { Vec::new() } else { chunks.into_iter().next().unwrap_or_default() };
        Ok(Held { block, detail: if whole { Detail::Whole } else { Detail::Base }, base })
    }

    /// One line for each block found so far that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> Vec<String> {
        self.lock().damage.values().cloned().collect()
    }

    /// Bytes of factors in memory.
    pub fn resident_bytes(&self) -> u64 {
        self.lock().pager.used_bytes()
    }

    /// What was read so far.
    pub fn reads(&self) -> Reads {
        self.lock().reads
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // What happens under the lock leaves it in order at every step that could panic.
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}
