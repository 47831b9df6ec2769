//! The picture, or its preview: blocks with their layers, and the index that stands before each layer.

use crate::error::{Error, Result};
use crate::matrix::{BlockId, FactorSource, MatrixShape};

/// The codings of chunks that the page knows: their first byte.
const CODINGS: [u8; 3] = [3, 4, 5];

/// One layer of all blocks, as it will stand in the file.
#[derive(Clone, Debug)]
pub(super) struct LayerIndex {
    /// Size and checksum of each block's chunk.
    pub(super) index: Vec<u8>,
    /// Bytes of all chunks.
    pub(super) chunk_bytes: u64,
}

/// A picture of some size with the chunks of its blocks.
pub struct Level<'a> {
    source: &'a dyn FactorSource,
    layers: Vec<LayerIndex>,
    /// For each block: components of all its layers, and sparse entries.
    counts: Vec<(u32, u32)>,
}

impl<'a> Level<'a> {
    /// Looks at every chunk of a source once. `counts` tells of a block its components and sparse entries over all layers.
    ///
    /// # Errors
    /// Those of reading; a chunk of 2³² bytes or more, or of an early coding.
    pub fn new(source: &'a dyn FactorSource, counts: impl Fn(BlockId) -> (usize, usize)) -> Result<Self> {
        let shape = source.shape();
        let depth = shape.blocks().map(|id| source.layer_count(id)).max().unwrap_or(0);
        let empty = LayerIndex { index: Vec::new(), chunk_bytes: 0 };
        let mut layers = vec![empty; depth as usize];
        for (layer, index) in layers.iter_mut().enumerate() {
            for id in shape.blocks() {
                if layer as u32 >= source.layer_count(id) {
                    index.index.push(0);
                    continue;
                }
                let chunk = source.stored_layer(id, layer as u32)?;
                if chunk.first().is_some_and(|coding| !CODINGS.contains(coding)) {
                    let problem = format!("has a coding ({}) that the page does not read", chunk[0]);
                    return Err(Error::input(id.to_string(), problem, "unpack it and pack it again"));
                }
                let bytes = u32::try_from(chunk.len())
                    .map_err(|_| Error::input(id.to_string(), "has a chunk of more than 4 GiB", "pack it again"))?;
                push_number(&mut index.index, bytes);
                if bytes > 0 {
                    index.index.extend(crc32fast::hash(&chunk).to_le_bytes());
                }
                index.chunk_bytes += u64::from(bytes);
            }
        }
        let counts = shape.blocks().map(counts).map(|(rank, sparse)| (rank as u32, sparse as u32)).collect();
        Ok(Self { source, layers, counts })
    }

    /// Shape of its matrix.
    pub fn shape(&self) -> MatrixShape {
        self.source.shape()
    }

    /// Bytes of its indices and chunks.
    pub fn bytes(&self) -> u64 {
        self.layers.iter().map(|layer| layer.index.len() as u64 + layer.chunk_bytes).sum()
    }

    pub(super) fn layers(&self) -> &[LayerIndex] {
        &self.layers
    }

    pub(super) fn counts(&self) -> &[(u32, u32)] {
        &self.counts
    }

    /// Gives the chunks of a layer, block after block.
    pub(super) fn chunks(&self, layer: u32, take: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let has_layer = |id: &BlockId| layer < self.source.layer_count(*id);
        self.shape().blocks().filter(has_layer).try_for_each(|id| take(&self.source.stored_layer(id, layer)?))
    }
}

/// Seven bits a byte, lowest first; the highest bit says that more follow.
fn push_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_seven_bits_a_byte() {
        let mut bytes = Vec::new();
        [0, 127, 128, u32::MAX].into_iter().for_each(|number| push_number(&mut bytes, number));
        assert_eq!(bytes, [0, 0x7f, 0x80, 1, 0xff, 0xff, 0xff, 0xff, 0x0f]);
    }
}
