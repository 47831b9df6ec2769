//! The shape of `T` and its cutting into blocks.

use super::BlockId;
use crate::error::{Error, Result};

/// Colour channels of a pixel: linear Rec. 709 red, green, blue.
pub const CHANNELS: usize = 3;

/// Shape of a light transport matrix and of the grid of blocks that it is cut into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MatrixShape {
    width: u32,
    height: u32,
    columns: u32,
    block_side: u32,
}

/// The pixels of a block, in image coordinates (origin at the top left).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// Leftmost pixel.
    pub x: u32,
    /// Topmost pixel.
    pub y: u32,
    /// Width in pixels, at least 1.
    pub width: u32,
    /// Height in pixels, at least 1.
    pub height: u32,
}

impl PixelRect {
    /// Number of pixels.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Number of rows of the block: pixels × channels.
    pub fn rows(self) -> usize {
        self.pixels() * CHANNELS
    }
}

impl MatrixShape {
    /// Largest image side, in pixels.
    pub const MAX_IMAGE_SIDE: u32 = 65_536;
    /// Largest number of columns.
    pub const MAX_COLUMNS: u32 = 1 << 24;
    /// Largest side of a block, in pixels.
    pub const MAX_BLOCK_SIDE: u32 = 256;
    /// Side of a block where none is asked for, in pixels.
    pub const DEFAULT_BLOCK_SIDE: u32 = 32;

    /// A matrix over a `width` × `height` image with `columns` basis lights, in blocks of `block_side` pixels.
    ///
    /// # Errors
    /// A size of zero or beyond the stated maxima.
    pub fn new(width: u32, height: u32, columns: u32, block_side: u32) -> Result<Self> {
        let within = |name: &str, value: u32, max: u32| {
            if (1..=max).contains(&value) {
                Ok(())
            } else {
                Err(Error::input(name, format!("{value} is not between 1 and {max}"), ""))
            }
        };
        within("image width", width, Self::MAX_IMAGE_SIDE)?;
        within("image height", height, Self::MAX_IMAGE_SIDE)?;
        within("number of columns", columns, Self::MAX_COLUMNS)?;
        within("block side", block_side, Self::MAX_BLOCK_SIDE)?;
        let blocks = u64::from(width.div_ceil(block_side)) * u64::from(height.div_ceil(block_side));
        if blocks > u64::from(u32::MAX) {
            return Err(Error::input("block side", format!("{block_side} makes {blocks} blocks"), "make it larger"));
        }
        Ok(Self { width, height, columns, block_side })
    }

    /// Image width in pixels.
    pub fn width(self) -> u32 {
        self.width
    }

    /// Image height in pixels.
    pub fn height(self) -> u32 {
        self.height
    }

    /// Columns of `T`: basis lights.
    pub fn columns(self) -> usize {
        self.columns as usize
    }

    /// Rows of `T`: pixels × channels.
    pub fn rows(self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * CHANNELS as u64
    }

    /// Bytes of `T` in f32.
    pub fn raw_bytes(self) -> u64 {
        self.rows() * u64::from(self.columns) * 4
    }

    /// Side of a full block in pixels.
    pub fn block_side(self) -> u32 {
        self.block_side
    }

    /// Blocks from left to right.
    pub fn blocks_across(self) -> u32 {
        self.width.div_ceil(self.block_side)
    }

    /// Blocks from top to bottom.
    pub fn blocks_down(self) -> u32 {
        self.height.div_ceil(self.block_side)
    }

    /// Number of blocks.
    pub fn block_count(self) -> u32 {
        self.blocks_across() * self.blocks_down()
    }

    /// All blocks in index order.
    pub fn blocks(self) -> impl ExactSizeIterator<Item = BlockId> + Clone {
        (0..self.block_count()).map(BlockId)
    }

    /// The pixels of a block.
    ///
    /// # Panics
    /// If `id` is not below [`Self::block_count`].
    pub fn rect(self, id: BlockId) -> PixelRect {
        assert!(id.0 < self.block_count(), "{id} of {}", self.block_count());
        let x = (id.0 % self.blocks_across()) * self.block_side;
        let y = (id.0 / self.blocks_across()) * self.block_side;
        PixelRect { x, y, width: self.block_side.min(self.width - x), height: self.block_side.min(self.height - y) }
    }

    /// The block of a pixel, and the pixel's index in it; `None` beside the image.
    pub fn block_at(self, x: u32, y: u32) -> Option<(BlockId, usize)> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let id = BlockId(y / self.block_side * self.blocks_across() + x / self.block_side);
        let rect = self.rect(id);
        Some((id, ((y - rect.y) * rect.width + x - rect.x) as usize))
    }

    /// Bytes of the largest block's entries.
    pub fn max_block_bytes(self) -> u64 {
        size_of::<f32>() as u64 * self.max_block_rows() as u64 * self.columns() as u64
    }

    /// Rows of the largest block.
    pub fn max_block_rows(self) -> usize {
        self.rect(BlockId(0)).rows()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_tile_the_image_exactly_once() {
        for (width, height, side) in [(1, 1, 32), (32, 32, 32), (33, 31, 32), (100, 70, 16), (7, 300, 256)] {
            let shape = MatrixShape::new(width, height, 5, side).unwrap();
            let mut seen = vec![0; (width * height) as usize];
            for id in shape.blocks() {
                let rect = shape.rect(id);
                for y in rect.y..rect.y + rect.height {
                    for x in rect.x..rect.x + rect.width {
                        let inside = (y - rect.y) * rect.width + x - rect.x;
                        assert_eq!(shape.block_at(x, y), Some((id, inside as usize)));
                        seen[(y * width + x) as usize] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{width}×{height} by {side}");
            assert_eq!((shape.block_at(width, 0), shape.block_at(0, height)), (None, None));
            assert_eq!(shape.blocks().map(|id| shape.rect(id).rows() as u64).sum::<u64>(), shape.rows());
        }
    }

    #[test]
    fn absurd_sizes_are_refused() {
        assert!(MatrixShape::new(0, 1, 1, 1).is_err());
        assert!(MatrixShape::new(1, 1, 0, 1).is_err());
        assert!(MatrixShape::new(1, 1, 1, 0).is_err());
        assert!(MatrixShape::new(1 << 20, 1, 1, 1).is_err());
        assert!(MatrixShape::new(1 << 16, 1 << 16, 1, 1).is_err());
    }
}
