//! Where encoded blocks wait until the container is assembled: `NAME.part` beside the final file, from which a killed pack continues.

use std::path::Path;
use std::sync::{Mutex, MutexGuard};

use super::format::{BLOCK_RECORD_BYTES, BlockRecord, u32_at};
use crate::error::Result;
use crate::files::{ContinuationFile, with_suffix};
use crate::matrix::BlockId;

const MARK: [u8; 8] = *b"LTCpart2";

/// One block in the file: its record, the bytes of each layer as 32-bit numbers, and the layers.
#[derive(Clone, Debug)]
pub(super) struct Spilled {
    pub(super) record: BlockRecord,
    layers: Vec<SpilledLayer>,
}

#[derive(Clone, Copy, Debug)]
struct SpilledLayer {
    /// Offset from the start of the block's bytes.
    offset: u64,
    bytes: u32,
    /// CRC-32 of the layer as it was written.
    crc: u32,
}

/// The file, locked for this process while it is open.
#[derive(Debug)]
pub(super) struct Spill {
    file: ContinuationFile,
    blocks: Mutex<Vec<Option<Spilled>>>,
}

impl Spill {
    /// Opens the file for a container at `path`, continuing an earlier one that was begun with the same `fingerprint`.
    ///
    /// # Errors
    /// Those of [`ContinuationFile::open`].
    pub(super) fn open(path: &Path, fingerprint: [u8; 32], block_count: u32, overwrite: bool) -> Result<Self> {
        let file = ContinuationFile::open(&with_suffix(path, ".part"), MARK, fingerprint, block_count, overwrite)?;
        let mut blocks = vec![None; block_count as usize];
        for (key, block) in blocks.iter_mut().enumerate().filter(|(key, _)| file.has(*key as u32)) {
            *block = Spilled::decode(&file.read(key as u32)?);
        }
        Ok(Self { file, blocks: Mutex::new(blocks) })
    }

    /// Removes what a pack left that was killed after the container had got its name.
    pub(super) fn remove_leftover(path: &Path, block_count: u32) {
        ContinuationFile::remove_leftover(&with_suffix(path, ".part"), MARK, block_count, path);
    }

    /// Appends a block. A block that is written again replaces the earlier one.
    pub(super) fn append(&self, id: BlockId, record: BlockRecord, layers: &[Vec<u8>]) -> Result<()> {
        let spilled = Spilled::new(record, layers);
        let head = spilled.head();
        let parts: Vec<&[u8]> = std::iter::once(head.as_slice()).chain(layers.iter().map(Vec::as_slice)).collect();
        self.file.append(id.0, &parts)?;
        self.blocks()[id.index()] = Some(spilled);
        Ok(())
    }

    /// The blocks, in order.
    pub(super) fn blocks(&self) -> MutexGuard<'_, Vec<Option<Spilled>>> {
        // Nothing is done under the lock that could leave it half done.
        self.blocks.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Reads a layer back, which must be as it was written.
    pub(super) fn read(&self, id: BlockId, block: &Spilled, layer: usize) -> Result<Vec<u8>> {
        let SpilledLayer { offset, bytes, crc } = block.layers[layer];
        self.file.read_part(id.0, offset, bytes as usize, crc)
    }

    /// Removes the file.
    pub(super) fn remove(self) -> Result<()> {
        self.file.remove()
    }
}

impl Spilled {
    fn new(record: BlockRecord, layers: &[Vec<u8>]) -> Self {
        let mut offset = (BLOCK_RECORD_BYTES + 4 * layers.len()) as u64;
        let place = |layer: &Vec<u8>| {
            let here = SpilledLayer { offset, bytes: layer.len() as u32, crc: crc32fast::hash(layer) };
            offset += layer.len() as u64;
            here
        };
        Self { record, layers: layers.iter().map(place).collect() }
    }

    /// The bytes before the layers.
    fn head(&self) -> Vec<u8> {
        let lengths = self.layers.iter().flat_map(|layer| layer.bytes.to_le_bytes());
        self.record.encode().into_iter().chain(lengths).collect()
    }

    /// Reads a block's bytes; `None` where they are not those of a block.
    fn decode(bytes: &[u8]) -> Option<Self> {
        let (record, rest) = bytes.split_at_checked(BLOCK_RECORD_BYTES)?;
        let record = BlockRecord::decode(record)?;
        let (lengths, mut rest) = rest.split_at_checked(4 * usize::from(record.layers))?;
        let mut layers = Vec::new();
        for length in lengths.chunks_exact(4) {
            let (layer, after) = rest.split_at_checked(u32_at(length, 0) as usize)?;
            layers.push(layer.to_vec());
            rest = after;
        }
        rest.is_empty().then(|| Self::new(record, &layers))
    }
}
