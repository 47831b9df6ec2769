//! A container against the matrix that it was made from, entry by entry.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, FactorSource, PixelRect, TracedBlock};
use crate::resources::Progress;

/// Difference of a block from its source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockComparison {
    /// The block.
    pub id: BlockId,
    /// The block's pixels.
    pub rect: PixelRect,
    /// `Σ (packed − source)²` over its entries.
    pub squared_error: f64,
    /// `Σ source²` over its entries.
    pub squared_norm: f64,
    /// The entry with the largest difference.
    pub worst: WorstEntry,
}

/// One entry in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorstEntry {
    /// Pixel across, in the image.
    pub x: u32,
    /// Pixel down, in the image.
    pub y: u32,
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// The column.
    pub column: ColumnIndex,
    /// The entry in the source.
    pub source: f32,
    /// The entry in the container.
    pub packed: f32,
}

impl BlockComparison {
    /// `‖packed − source‖ / ‖source‖` (Frobenius).
    pub fn relative_l2(&self) -> f64 {
        relative(self.squared_error, self.squared_norm)
    }
}

impl WorstEntry {
    /// `|packed − source|`.
    pub fn difference(&self) -> f32 {
        (self.packed - self.source).abs()
    }
}

/// `‖packed − source‖ / ‖source‖` over all blocks.
pub fn total_relative_l2(blocks: &[BlockComparison]) -> f64 {
    let sum = |part: fn(&BlockComparison) -> f64| blocks.iter().map(part).sum();
    relative(sum(|b| b.squared_error), sum(|b| b.squared_norm))
}

fn relative(squared_error: f64, squared_norm: f64) -> f64 {
    if squared_error == 0.0 { 0.0 } else { (squared_error / squared_norm).sqrt() }
}

/// Reads every block from both and compares them, in index order.
///
/// # Errors
/// Different shapes; those of reading.
pub fn compare_matrices(
    source: &dyn BlockSource,
    packed: &dyn FactorSource,
    watch: &dyn Progress,
) -> Result<Vec<BlockComparison>> {
    if source.shape() != packed.shape() {
        let hint = "give the matrix that the container was made from";
        return Err(Error::input("the container", "has another shape than the matrix", hint));
    }
    let blocks: Vec<BlockId> = source.shape().blocks().collect();
    watch.begin("comparing", blocks.len() as u64, "blocks");
    let compare = |block: &mut TracedBlock, &id: &BlockId| {
        if watch.interrupted() {
            return Err(Error::interrupted("the comparison is not complete"));
        }
        source.read_block(id, block)?;
        let expanded = packed.read_layers(id, 0..packed.layer_count(id))?.expand();
        watch.advance(1, size_of_val(block.block.entries()) as u64, "B");
        let rect = source.shape().rect(id);
        Ok(compare_block(id, rect, block.block.entries(), expanded.entries()))
    };
    let compared = blocks.par_iter().map_init(TracedBlock::default, compare).collect();
    watch.end();
    compared
}

fn compare_block(id: BlockId, rect: PixelRect, source: &[f32], packed: &[f32]) -> BlockComparison {
    let (mut squared_error, mut squared_norm, mut largest, mut at) = (0.0, 0.0, -1.0f32, 0);
    for (i, (&a, &b)) in source.iter().zip(packed).enumerate() {
        let difference = (a - b).abs();
        if difference > largest {
            (largest, at) = (difference, i);
        }
        squared_error += f64::from(a - b).powi(2);
        squared_norm += f64::from(a).powi(2);
    }
    let (column, row) = (at / rect.rows(), at % rect.rows());
    let pixel = (row % rect.pixels()) as u32;
    let worst = WorstEntry {
        x: rect.x + pixel % rect.width,
        y: rect.y + pixel / rect.width,
        channel: (row / rect.pixels()).min(CHANNELS - 1),
        column: ColumnIndex(column as u32),
        source: source[at],
        packed: packed[at],
    };
    BlockComparison { id, rect, squared_error, squared_norm, worst }
}
