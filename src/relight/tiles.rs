//! An image cut into the pixel rows of its blocks, so that blocks are finished in parallel without locks.

use rayon::prelude::*;

use crate::image::LinearImage;
use crate::matrix::{BlockId, CHANNELS, MatrixShape};

/// The pixels of one block inside an image: one slice for each pixel row.
pub(crate) struct ImageTile<'a> {
    pub id: BlockId,
    rows: Vec<&'a mut [[f32; CHANNELS]]>,
}

impl ImageTile<'_> {
    /// Sets the pixels from those of the block, row by row; there may be more than it has.
    #[cfg(feature = "gpu")]
    pub(crate) fn copy(&mut self, mut pixels: &[[f32; CHANNELS]]) {
        for row in &mut self.rows {
            let (these, rest) = pixels.split_at(row.len());
            row.copy_from_slice(these);
            pixels = rest;
        }
    }

    /// Sets the pixels from the rows of the block, channel-planar.
    #[inline(always)]
    pub(crate) fn set(&mut self, planes: &[f32]) {
        let pixels = planes.len() / CHANNELS;
        let (red, rest) = planes.split_at(pixels);
        let (green, blue) = rest.split_at(pixels);
        let mut start = 0;
        for row in &mut self.rows {
            let range = start..start + row.len();
            let channels = red[range.clone()].iter().zip(&green[range.clone()]).zip(&blue[range]);
            for (pixel, ((&red, &green), &blue)) in row.iter_mut().zip(channels) {
                *pixel = [red, green, blue];
            }
            start += row.len();
        }
    }

    /// Paints the block with stripes that no relit image shows: nothing of it could be read.
    pub(crate) fn mark_as_hole(&mut self) {
        for (y, row) in self.rows.iter_mut().enumerate() {
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = if (x + y) % 8 < 4 { [1.0, 0.0, 1.0] } else { [0.0; CHANNELS] };
            }
        }
    }

    /// Sets the block black.
    pub(crate) fn clear(&mut self) {
        self.rows.iter_mut().for_each(|row| row.fill([0.0; CHANNELS]));
    }
}

/// Runs `work` on every block of the image, on all threads. Panics if the image has another size than `shape`.
pub(crate) fn for_each_tile<E: Send>(
    image: &mut LinearImage,
    shape: MatrixShape,
    work: impl Fn(ImageTile) -> Result<(), E> + Sync,
) -> Result<(), E> {
    assert_eq!((image.width, image.height), (shape.width(), shape.height()));
    let (width, side) = (shape.width() as usize, shape.block_side() as usize);
    let bands = image.pixels.par_chunks_mut(width * side).enumerate();
    bands.try_for_each(|(down, band)| {
        let across = shape.blocks_across();
        let ids = (0..across).map(|x| BlockId(down as u32 * across + x));
        let mut tiles: Vec<ImageTile> = ids.map(|id| ImageTile { id, rows: Vec::with_capacity(side) }).collect();
        for row in band.chunks_mut(width) {
            for (tile, part) in tiles.iter_mut().zip(row.chunks_mut(side)) {
                tile.rows.push(part);
            }
        }
        tiles.into_par_iter().try_for_each(&work)
    })
}
