//! Blocks as bytes, without a file.

use super::codec::CodecSettings;
use super::layers::{encode_layers, join_layers};
use super::layout::{BlockLayout, LightLayout};
use crate::error::{Error, Result};
use crate::light::Job;
use crate::matrix::{BlockId, FactoredBlock, MatrixShape};

/// A block as bytes, and what can be said of them.
#[derive(Clone, Debug, Default)]
pub struct EncodedBlock {
    pub(super) layers: Vec<Vec<u8>>,
    pub(super) rank: usize,
    pub(super) sparse_entries: usize,
}

/// Bytes of an encoded block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EncodedSize {
    /// Bytes of each layer, the base layer first.
    pub layer_bytes: Vec<usize>,
}

impl EncodedSize {
    /// Bytes of all layers.
    pub fn bytes(&self) -> usize {
        self.layer_bytes.iter().sum()
    }
}

impl EncodedBlock {
    /// The bytes of each layer, the base layer first.
    pub fn layers(&self) -> &[Vec<u8>] {
        &self.layers
    }

    /// Bytes of its layers.
    pub fn size(&self) -> EncodedSize {
        EncodedSize { layer_bytes: self.layers.iter().map(Vec::len).collect() }
    }
}

/// Encodes the blocks of a container, and decodes them again.
#[derive(Clone, Debug)]
pub struct BlockEncoder {
    shape: MatrixShape,
    lights: LightLayout,
    codec: CodecSettings,
}

impl BlockEncoder {
    /// For the blocks of a job.
    pub fn new(job: &Job, codec: CodecSettings) -> Self {
        Self { shape: job.shape, lights: LightLayout::of(&job.basis), codec }
    }

    /// Encodes factors whose columns are divided by their scales already.
    ///
    /// # Errors
    /// A block that is not of this job's shape or whose parts do not fit each other.
    pub fn encode_divided(&self, id: BlockId, block: &FactoredBlock) -> Result<EncodedBlock> {
        let layout = self.layout(id);
        if block.rows != layout.rows() || block.columns != layout.columns() || !block.is_consistent() {
            let problem = format!(
                "its factors of {} rows × rank {} × {} columns do not fit the job's {} × {}",
                block.rows,
                block.rank(),
                block.columns,
                layout.rows(),
                layout.columns()
            );
            return Err(Error::input(id.to_string(), problem, ""));
        }
        if block.rank() == 0 && block.sparse.is_empty() {
            return Ok(EncodedBlock::default());
        }
        let layers = encode_layers(&layout, block, &self.codec)
            .map_err(|problem| Error::input(id.to_string(), problem, "compress it again with finite values"))?;
        Ok(EncodedBlock { layers, rank: block.rank(), sparse_entries: block.sparse.len() })
    }

    /// What a reader will get of an encoded block, but for the scales of its columns.
    ///
    /// # Errors
    /// The bytes are not a block of this container.
    pub fn decode(&self, id: BlockId, block: &EncodedBlock) -> Result<FactoredBlock> {
        let layout = self.layout(id);
        let chunks = block.layers.iter().map(|layer| Ok(layer.as_slice()));
        join_layers(&layout, chunks, None).map_err(|problem: String| Error::input(id.to_string(), problem, ""))
    }

    fn layout(&self, id: BlockId) -> BlockLayout {
        BlockLayout::new(self.shape.rect(id), self.lights.clone())
    }
}
