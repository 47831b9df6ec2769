//! A container whose reads are counted while they are made, and measured in passing.

use std::collections::HashSet;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::reach::{BlockSums, ReachSums, TexelReach};
use ltm::container::ContainerReader;
use ltm::error::{Error, Result};
use ltm::matrix::{BlockId, CHANNELS, CodedBlock, ColumnTransform, FactorSource, FactoredBlock, MatrixShape};

/// What was read of the container and what of it is held; it counts while others look.
#[derive(Debug, Default)]
pub struct Meter {
    /// Bytes of layers read, counted each time that they are.
    pub bytes_read: AtomicU64,
    /// Reads of a block, base layers and whole ones counted alike.
    pub blocks_read: AtomicU64,
    /// Bytes of factors in the memory of the CPU.
    pub resident_bytes: AtomicU64,
    /// Bytes of factors, and of the pictures made of them, in the memory of the device that relights.
    pub device_bytes: AtomicU64,
}

/// A container of which only the base layers may be shown.
pub(super) struct Metered<'a> {
    source: &'a ContainerReader,
    meter: &'a Meter,
    stop: &'a AtomicBool,
    base_only: AtomicBool,
    measured: Mutex<Measured>,
}

/// What lights bring, over the blocks that were read whole.
struct Measured {
    sums: ReachSums,
    blocks: HashSet<BlockId>,
}

impl<'a> Metered<'a> {
    /// Reads of it end with [`Error::Interrupted`] once `stop` is set.
    pub(super) fn new(source: &'a ContainerReader, meter: &'a Meter, stop: &'a AtomicBool) -> Self {
        let measured = Measured { sums: ReachSums::new(source.shape()), blocks: HashSet::new() };
        Self { source, meter, stop, base_only: AtomicBool::new(false), measured: Mutex::new(measured) }
    }

    /// Shows base layers alone from now on, or all.
    pub(super) fn set_base_only(&self, base_only: bool) {
        self.base_only.store(base_only, Ordering::Relaxed);
    }

    /// What lights bring over the blocks read whole so far, and the number of those.
    pub(super) fn reach(&self) -> (TexelReach, usize) {
        let measured = self.measured();
        let reach = measured.sums.reach(&self.source.column_transform(), self.source.column_scales());
        (reach, measured.blocks.len())
    }

    fn measured(&self) -> MutexGuard<'_, Measured> {
        // Sums without their block, after a panic, would only be a little too large.
        self.measured.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn check_stop(&self) -> Result<()> {
        match self.stop.load(Ordering::Relaxed) {
            true => Err(Error::interrupted("the window was closed")),
            false => Ok(()),
        }
    }

    /// A block without layers, also where the container does not hold it.
    pub(super) fn black(&self, id: BlockId) -> CodedBlock {
        let (rows, columns) = (self.shape().rect(id).pixels() * CHANNELS, self.shape().columns());
        CodedBlock { factors: FactoredBlock { rows, columns, ..Default::default() }, right: Vec::new() }
    }

    fn count(&self, id: BlockId, layers: Range<u32>) {
        self.meter.bytes_read.fetch_add(self.source.encoded_bytes(id, layers), Ordering::Relaxed);
    }

    /// Takes a block that is about to be shown into the sums, once, if it is whole.
    fn measure(&self, id: BlockId, layers: u32, block: &CodedBlock) {
        self.meter.blocks_read.fetch_add(1, Ordering::Relaxed);
        if layers == self.source.layer_count(id) && !self.measured().blocks.contains(&id) {
            let sums = BlockSums::of(block, self.shape().rect(id).pixels());
            let mut measured = self.measured();
            if measured.blocks.insert(id) {
                measured.sums.add(&sums);
            }
        }
    }
}

impl FactorSource for Metered<'_> {
    fn shape(&self) -> MatrixShape {
        self.source.shape()
    }

    fn column_scales(&self) -> &[f32] {
        self.source.column_scales()
    }

    fn layer_count(&self, id: BlockId) -> u32 {
        let most = if self.base_only.load(Ordering::Relaxed) { 1 } else { u32::MAX };
        self.source.layer_count(id).min(most)
    }

    fn encoded_bytes(&self, id: BlockId, layers: Range<u32>) -> u64 {
        self.source.encoded_bytes(id, layers)
    }

    /// Not measured: pictures are made of [`read_coded`](Self::read_coded).
    fn read_layers(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock> {
        self.check_stop()?;
        self.count(id, layers.clone());
        self.source.read_layers(id, layers)
    }

    fn stored_layer(&self, id: BlockId, layer: u32) -> Result<Vec<u8>> {
        self.check_stop()?;
        self.count(id, layer..layer + 1);
        self.source.stored_layer(id, layer)
    }

    fn decode_layers(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<FactoredBlock> {
        self.source.decode_layers(id, stored)
    }

    fn column_transform(&self) -> Arc<ColumnTransform> {
        self.source.column_transform()
    }

    fn read_coded(&self, id: BlockId, layers: u32) -> Result<CodedBlock> {
        self.check_stop()?;
        if layers == 0 {
            return Ok(self.black(id));
        }
        self.count(id, 0..layers);
        let block = self.source.read_coded(id, layers)?;
        self.measure(id, layers, &block);
        Ok(block)
    }

    fn decode_coded(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<CodedBlock> {
        if stored.is_empty() {
            return Ok(self.black(id));
        }
        let block = self.source.decode_coded(id, stored)?;
        self.measure(id, stored.len() as u32, &block);
        Ok(block)
    }
}
