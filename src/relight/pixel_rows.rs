//! The rows of `T` of one pixel.

use crate::error::Result;
use crate::matrix::{CHANNELS, FactorSource};

/// What a weight 1 on each column brings to one pixel, per channel: three rows of `T`.
///
/// # Errors
/// What the source reports for the pixel's block.
///
/// # Panics
/// If there is no such pixel.
pub fn pixel_rows(source: &dyn FactorSource, [x, y]: [u32; 2]) -> Result<Vec<[f32; CHANNELS]>> {
    let shape = source.shape();
    let (id, inside) = shape.block_at(x, y).unwrap_or_else(|| panic!("pixel {x}, {y}"));
    let block = source.read_layers(id, 0..source.layer_count(id))?;
    let pixels = shape.rect(id).pixels();
    let mut rows = vec![[0.0; CHANNELS]; shape.columns()];
    for k in 0..block.rank() {
        let left = [0, 1, 2].map(|channel| block.left_component(k)[channel * pixels + inside]);
        for (row, right) in rows.iter_mut().zip(block.right_component(k)) {
            *row = [0, 1, 2].map(|channel| row[channel] + left[channel] * right);
        }
    }
    for entry in &block.sparse {
        let (channel, pixel) = (entry.row as usize / pixels, entry.row as usize % pixels);
        if pixel == inside {
            rows[entry.column.index()][channel] += entry.value;
        }
    }
    Ok(rows)
}
