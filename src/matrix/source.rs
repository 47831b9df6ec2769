//! The seams between the stages: who gives blocks, who takes them.

use std::ops::Range;
use std::sync::Arc;

use super::{
    Block, BlockId, BlockNoise, BlockPlanes, BlockView, CodedBlock, ColumnIndex, ColumnTransform, FactoredBlock,
    MatrixShape, TracedBlock,
};
use crate::error::{Error, Result};

/// Something that blocks of `T` can be read from: a stored matrix, a set of images, a tracer.
pub trait BlockSource: Sync {
    /// Shape of the matrix.
    fn shape(&self) -> MatrixShape;

    /// Tells sources of one job apart whose entries are not the same.
    ///
    /// # Errors
    /// What is stored cannot be read.
    fn variant(&self) -> Result<Vec<u8>> {
        Ok(b"f32".to_vec())
    }

    /// Reads or makes one block into `target`, whose allocations are reused.
    ///
    /// # Errors
    /// The block is missing or damaged; reading or making it fails.
    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()>;

    /// Gives one block to `work`: from where the source keeps it, if it keeps it whole and as it is, or read into
    /// `scratch`. Where this fails, what `work` has made of the block is void.
    ///
    /// # Errors
    /// As [`read_block`](Self::read_block); those of `work`.
    fn visit_block(
        &self,
        id: BlockId,
        scratch: &mut TracedBlock,
        work: &mut dyn FnMut(LentBlock<'_>) -> Result<()>,
    ) -> Result<()> {
        self.read_block(id, scratch)?;
        work(LentBlock::Scratch(scratch))
    }

    /// Gives the columns of a range to `work`, one after the other, each with its rows of the block; columns that are
    /// zero throughout may be left out. Where this fails, what `work` has made of them is void.
    ///
    /// # Errors
    /// As [`read_block`](Self::read_block).
    fn visit_columns(
        &self,
        id: BlockId,
        columns: Range<u32>,
        scratch: &mut TracedBlock,
        work: &mut dyn FnMut(ColumnIndex, &[f32]),
    ) -> Result<()> {
        self.read_block(id, scratch)?;
        columns.map(ColumnIndex).for_each(|column| work(column, scratch.block.view().column(column)));
        Ok(())
    }
}

/// A block that a source lends.
pub enum LentBlock<'a> {
    /// In the scratch block, which may be modified.
    Scratch(&'a mut TracedBlock),
    /// Borrowed from the source.
    Source {
        /// The entries.
        block: BlockView<'a>,
        /// The noise.
        noise: Option<&'a BlockNoise>,
        /// The planes of its samples.
        planes: Option<&'a BlockPlanes>,
        /// The scratch block, whose content is of no use: for a copy.
        spare: &'a mut Block,
    },
}

impl LentBlock<'_> {
    /// The entries.
    pub fn view(&self) -> BlockView<'_> {
        match self {
            Self::Scratch(traced) => traced.block.view(),
            Self::Source { block, .. } => *block,
        }
    }

    /// The noise.
    pub fn noise(&self) -> Option<&BlockNoise> {
        match self {
            Self::Scratch(traced) => traced.noise.as_ref(),
            Self::Source { noise, .. } => *noise,
        }
    }

    /// The planes of its samples.
    pub fn planes(&self) -> Option<&BlockPlanes> {
        match self {
            Self::Scratch(traced) => traced.planes.as_ref(),
            Self::Source { planes, .. } => *planes,
        }
    }
}

/// Something that takes blocks of `T`, in any order, from any thread.
pub trait BlockSink: Sync {
    /// Takes one block. When this returns, the block is committed.
    ///
    /// # Errors
    /// The block does not fit the matrix; the system refuses to write.
    fn write_block(&self, id: BlockId, block: &TracedBlock) -> Result<()>;
}

/// Something that blocks of factors can be read from.
///
/// A block's components are grouped into layers, the base layer first; any prefix of layers is a usable block.
pub trait FactorSource: Send + Sync {
    /// Shape of the matrix.
    fn shape(&self) -> MatrixShape;

    /// What columns were divided by before they were stored, one value each; empty where all are 1. Factors are read as those of a
    /// weight 1 on each column: who rounds them divides them first, or the column of the largest unit decides for all.
    fn column_scales(&self) -> &[f32] {
        &[]
    }

    /// Layers of a block; 0 for a block that holds nothing (all zero).
    fn layer_count(&self, id: BlockId) -> u32;

    /// Bytes that a range of layers takes in the source.
    fn encoded_bytes(&self, id: BlockId, layers: Range<u32>) -> u64;

    /// The factors of a range of layers alone: their components and sparse entries.
    ///
    /// # Errors
    /// The block is damaged or cannot be read.
    fn read_layers(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock>;

    /// One layer as it is stored, to be decoded by [`decode_layers`](Self::decode_layers) with those before it: so that
    /// a block can be read layer by layer and no layer twice. A source without stored bytes gives none, and reads when
    /// it decodes.
    ///
    /// # Errors
    /// The layer cannot be read.
    fn stored_layer(&self, _id: BlockId, _layer: u32) -> Result<Vec<u8>> {
        Ok(Vec::new())
    }

    /// The factors of the first layers of a block, from their stored bytes.
    ///
    /// # Errors
    /// The bytes are not those layers; for a source without stored bytes, as [`read_layers`](Self::read_layers).
    fn decode_layers(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<FactoredBlock> {
        self.read_layers(id, 0..stored.len() as u32)
    }

    /// The transform in whose coefficients [`read_coded`](Self::read_coded) and [`decode_coded`](Self::decode_coded) tell
    /// right sides. A source that has more than values overrides all three.
    fn column_transform(&self) -> Arc<ColumnTransform> {
        Arc::new(ColumnTransform::identity(self.shape().columns()))
    }

    /// The first layers of a block, their right sides as coefficients, of columns divided by their scales.
    ///
    /// # Errors
    /// As [`read_layers`](Self::read_layers); parts that do not fit each other.
    fn read_coded(&self, id: BlockId, layers: u32) -> Result<CodedBlock> {
        coded_values(self, id, self.read_layers(id, 0..layers)?)
    }

    /// As [`read_coded`](Self::read_coded), from their stored bytes.
    ///
    /// # Errors
    /// As [`decode_layers`](Self::decode_layers); parts that do not fit each other.
    fn decode_coded(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<CodedBlock> {
        coded_values(self, id, self.decode_layers(id, stored)?)
    }
}

/// Factors of values of a block, coded.
fn coded_values<S: FactorSource + ?Sized>(source: &S, id: BlockId, block: FactoredBlock) -> Result<CodedBlock> {
    let transform = source.column_transform();
    if !block.is_consistent() || block.rank() > 0 && block.columns != transform.columns() {
        return Err(Error::input(id.to_string(), "has factors that do not fit each other", "pack the matrix again"));
    }
    Ok(CodedBlock::of(block, source.column_scales(), &transform))
}
