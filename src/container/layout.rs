//! How the values of a block's factors stand as little images: pixels on the left, texels of lights on the right.

use std::sync::Arc;

use crate::light::{Job, LightBasis};
use crate::matrix::{BlockId, PixelRect};

/// The texel layouts of a basis, as the codec sees them: a list of little images that together cover the columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightLayout {
    planes: Arc<[LightPlane]>,
    columns: usize,
}

/// A group of columns as a small image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightPlane {
    /// Texels across.
    pub across: usize,
    /// Texels down.
    pub down: usize,
    /// Whether neighbours belong to one light, so that a transform pays; otherwise these are neighbouring lights of one
    /// column each, joined into one row.
    pub is_image: bool,
}

/// The layout of one block: its pixels and the lights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockLayout {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// The lights.
    pub lights: LightLayout,
}

impl LightLayout {
    /// The layout of a basis.
    pub fn of(basis: &LightBasis) -> Self {
        let mut planes: Vec<LightPlane> = Vec::new();
        for light in basis.lights() {
            let (across, down) = light.layout();
            let is_image = (across, down) != (1, 1);
            match planes.last_mut() {
                Some(row) if !is_image && !row.is_image => row.across += 1,
                _ => planes.push(LightPlane { across: across as usize, down: down as usize, is_image }),
            }
        }
        Self { columns: basis.column_count(), planes: planes.into() }
    }

    /// The images, in column order.
    pub fn planes(&self) -> &[LightPlane] {
        &self.planes
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }
}

impl BlockLayout {
    /// The layout of a block of `job`. Panics if the job has no such block.
    pub fn of(job: &Job, id: BlockId) -> Self {
        Self::new(job.shape.rect(id), LightLayout::of(&job.basis))
    }

    /// A block of these pixels under these lights.
    pub fn new(rect: PixelRect, lights: LightLayout) -> Self {
        Self { width: rect.width as usize, height: rect.height as usize, lights }
    }

    /// Pixels of the block.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Rows of the block: pixels × channels.
    pub fn rows(&self) -> usize {
        self.pixels() * crate::matrix::CHANNELS
    }

    /// Columns of the block.
    pub fn columns(&self) -> usize {
        self.lights.columns()
    }
}
