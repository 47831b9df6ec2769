//! Planes of the image, one row of blocks at a time, for writing an EXR row by row.

use crate::error::{Error, Result};
use crate::matrix::{BlockId, MatrixShape};
use crate::resources::{MemoryNeed, Progress};

/// Planes of the image for one row of blocks.
pub(super) struct BlockRow<F> {
    shape: MatrixShape,
    planes: usize,
    /// Returns the planes of a block, one after the other; `None` for a missing block, which becomes black.
    read: F,
    row_of_blocks: Option<u32>,
    /// Planes × side of a block × width.
    values: Vec<f32>,
}

impl<F> MemoryNeed for BlockRow<F> {
    fn fixed_bytes(&self) -> u64 {
        self.planes as u64 * u64::from(self.shape.width()) * u64::from(self.shape.block_side()) * 4
    }
}

impl<F: FnMut(BlockId) -> Result<Option<Vec<f32>>>> BlockRow<F> {
    /// A strip without any blocks yet.
    pub(super) fn new(shape: MatrixShape, planes: usize, read: F) -> Self {
        Self { shape, planes, read, row_of_blocks: None, values: Vec::new() }
    }

    /// Copies row `y` of the image of a plane.
    ///
    /// # Errors
    /// Those of `read`; [`Error::Interrupted`] when the watch says so.
    pub(super) fn copy_row(&mut self, plane: usize, y: usize, row: &mut [f32], watch: &dyn Progress) -> Result<()> {
        let (side, width) = (self.shape.block_side() as usize, self.shape.width() as usize);
        self.hold((y / side) as u32, watch)?;
        row.copy_from_slice(&self.values[(plane * side + y % side) * width..][..width]);
        Ok(())
    }

    fn hold(&mut self, row_of_blocks: u32, watch: &dyn Progress) -> Result<()> {
        if self.row_of_blocks == Some(row_of_blocks) {
            return Ok(());
        }
        if watch.interrupted() {
            return Err(Error::interrupted("nothing was written"));
        }
        let (side, width) = (self.shape.block_side() as usize, self.shape.width() as usize);
        self.values.clear();
        self.values.resize(self.planes * side * width, 0.0);
        let across = self.shape.blocks_across();
        for id in (row_of_blocks * across..(row_of_blocks + 1) * across).map(BlockId) {
            let Some(values) = (self.read)(id)? else { continue };
            let rect = self.shape.rect(id);
            for (plane, values) in values.chunks_exact(rect.pixels()).enumerate() {
                for (y, row) in values.chunks_exact(rect.width as usize).enumerate() {
                    self.values[(plane * side + y) * width + rect.x as usize..][..row.len()].copy_from_slice(row);
                }
            }
        }
        self.row_of_blocks = Some(row_of_blocks);
        watch.advance(1, 0, "px");
        Ok(())
    }
}
