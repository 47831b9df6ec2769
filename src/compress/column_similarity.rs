//! Positions of lights estimated from the similarity of their images, for matrices without light positions, such as
//! arrays.
//!
//! Lights near each other make similar images. So coarse images of all lights, each cell and each light scaled to the
//! same mean, are embedded by their three strongest principal components. A panel of texels becomes a bent sheet, a sky
//! a sphere. The prior uses these as positions.

use faer::{Mat, MatRef};

use super::dense::{eigen, product_f64};
use crate::matrix::{BlockId, BlockView, CHANNELS, MatrixShape, PixelRect};

/// Largest number of cells of all coarse images together.
const MAX_CELLS: usize = 512;
/// Largest number of cells along a side of a block.
const MAX_CELLS_ACROSS: usize = 8;
/// Largest number of blocks that are read, spread evenly.
const MAX_BLOCKS: usize = 128;
/// Least number of columns for which positions are estimated: a block keeps nearly all of fewer anyway.
const MIN_COLUMNS: usize = 48;
/// Largest number of columns, since a coarse image of each is held.
const MAX_COLUMNS: usize = 1 << 15;
/// Dimensions of a position.
const DIMENSIONS: usize = 3;
/// Share of the columns at each end that is ignored in the extent.
const OUTER: f64 = 0.01;

/// Whether positions can be estimated for this number of columns.
pub(super) fn can_tell(columns: usize) -> bool {
    (MIN_COLUMNS..=MAX_COLUMNS).contains(&columns)
}

/// Bytes of the coarse images.
pub(super) fn needs_bytes(columns: usize) -> u64 {
    if can_tell(columns) { (MAX_CELLS * (columns * (4 + 8) + MAX_CELLS * 16)) as u64 } else { 0 }
}

/// Blocks that are read.
pub(super) fn looked_at(shape: MatrixShape) -> Vec<BlockId> {
    let apart = (shape.block_count() as usize).div_ceil(MAX_BLOCKS).max(1);
    shape.blocks().step_by(apart).collect()
}

/// Coarse images of all columns of a block, one of `blocks` that are read: cells × columns, row-major.
pub(super) fn coarse(block: BlockView<'_>, rect: PixelRect, blocks: usize) -> Vec<f32> {
    let across = (MAX_CELLS / blocks.max(1)).isqrt().clamp(1, MAX_CELLS_ACROSS);
    let (width, height) = (rect.width as usize, rect.height as usize);
    let columns = block.columns();
    let mut cells = vec![0.0; across * across * columns];
    for (column, entries) in block.entries().chunks_exact(block.rows()).enumerate() {
        for (row, values) in entries.chunks_exact(width).enumerate() {
            let down = (row % height) * across / height;
            for (x, &value) in values.iter().enumerate() {
                if value.is_finite() && value > 0.0 {
                    cells[(down * across + x * across / width) * columns + column] += value;
                }
            }
        }
    }
    debug_assert_eq!(block.rows(), CHANNELS * width * height);
    cells
}

/// Positions of columns from their coarse images (cells × columns, row-major), in a space of extent 1.
pub(super) fn places(cells: &[f32], columns: usize) -> Vec<[f64; 3]> {
    let lit: Vec<&[f32]> = cells.chunks_exact(columns).filter(|cell| cell.iter().any(|&v| v > 0.0)).collect();
    let mut of_cell: Vec<Vec<f64>> = lit.into_iter().map(|cell| to_mean_1(cell.iter().map(|&v| v.into()))).collect();
    // The distribution of a light's image counts, not its brightness.
    for column in 0..columns {
        let image = to_mean_1(of_cell.iter().map(|cell| cell[column]));
        // Square roots, so that neither a lamp in view nor a firefly dominates.
        of_cell.iter_mut().zip(image).for_each(|(cell, v)| cell[column] = v.sqrt());
    }
    for cell in &mut of_cell {
        let mean = cell.iter().sum::<f64>() / columns as f64;
        cell.iter_mut().for_each(|v| *v -= mean);
    }
    let images = Mat::from_fn(of_cell.len(), columns, |i, j| of_cell[i][j]);
    let (values, vectors) = eigen(product_f64(images.as_ref(), images.transpose()).as_ref());
    // The middle eigenvalue estimates the noise in each direction.
    let noise = values.get(values.len() / 2).copied().unwrap_or(0.0);
    let seen = values.iter().take(DIMENSIONS).filter(|&&value| value > 2.0 * noise).count();
    let along = product_f64(vectors.as_ref().subcols(0, seen).transpose(), images.as_ref());
    scaled(along.as_ref(), columns)
}

fn to_mean_1(values: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
    let (sum, count) = values.clone().fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    let scale = if sum > 0.0 { count / sum } else { 0.0 };
    values.map(|v| v * scale).collect()
}

/// Coordinates (dimensions × columns), such that the widest has an extent of 1.
fn scaled(along: MatRef<'_, f64>, columns: usize) -> Vec<[f64; 3]> {
    let outer = (OUTER * columns as f64) as usize;
    let extent = (0..along.nrows()).map(|k| {
        let mut values: Vec<f64> = (0..columns).map(|j| along[(k, j)]).collect();
        values.sort_by(f64::total_cmp);
        values[columns - 1 - outer] - values[outer]
    });
    let extent = extent.fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let at = |k: usize, j: usize| if k < along.nrows() { along[(k, j)] / extent } else { 0.0 };
    (0..columns).map(|j| [0, 1, 2].map(|k| at(k, j))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A panel of 12 × 8 texels whose images are soft spots on a wall of 6 × 6 cells, some darker than others.
    fn spots() -> (Vec<f32>, usize) {
        let (across, down) = (12, 8);
        let value = |cell: usize, column: usize| {
            let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
            let x = at(cell % 6, 6) - at(column % across, across);
            let y = at(cell / 6, 6) - at(column / across, down);
            (1.0 + (column % 5) as f32) * (0.1 + (-(x * x + y * y) / 0.2).exp())
        };
        ((0..36).flat_map(|cell| (0..across * down).map(move |column| value(cell, column))).collect(), across * down)
    }

    #[test]
    fn texels_of_a_panel_stand_as_their_images_say() {
        let (cells, columns) = spots();
        let places = places(&cells, columns);
        let apart = |a: usize, b: usize| (0..3).map(|k| (places[a][k] - places[b][k]).powi(2)).sum::<f64>().sqrt();
        let extent = (0..columns).map(|a| apart(0, a)).fold(0.0, f64::max);
        assert!((0.5..2.0).contains(&extent), "{extent}");
        let near = (0..columns).filter(|&a| {
            let nearest = (0..columns).filter(|&b| b != a).min_by(|&b, &c| apart(a, b).total_cmp(&apart(a, c)));
            let b = nearest.expect("there are others");
            (a % 12).abs_diff(b % 12) <= 1 && (a / 12).abs_diff(b / 12) <= 1
        });
        assert_eq!(near.count(), columns);
    }

    #[test]
    fn images_of_nothing_and_of_too_much_tell_no_places() {
        assert_eq!(places(&[0.0; 4 * 50], 50), [[0.0; 3]; 50]);
        let huge = [f32::INFINITY; 4 * 50];
        assert!(places(&huge, 50).iter().flatten().all(|v| v.is_finite()));
    }
}
