//! Columns divided by their scales.

use ltm::container::ContainerReader;
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, TracedBlock};
use ltm::store::StoreReader;

/// A block of a matrix and of its container, columns divided by their scales: what errors are stated of.
pub(super) fn divided(matrix: &StoreReader, container: &ContainerReader, id: BlockId) -> (TracedBlock, FactoredBlock) {
    let scales = container.job().basis.column_scales();
    assert_eq!(scales, matrix.job().basis.column_scales());
    let mut block = TracedBlock::default();
    matrix.read_block(id, &mut block).unwrap();
    block.divide_columns(scales);
    let mut packed = container.read_block(id).unwrap();
    packed.scale_columns(&scales.iter().map(|scale| scale.recip()).collect::<Vec<_>>());
    (block, packed)
}
