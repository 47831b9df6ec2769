//! Images from blocks: what a factored or plain block shows under lightings, in f64, without a container's rounding.

use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, BlockView, CHANNELS, ColumnIndex, FactoredBlock, MatrixShape};

/// Rows under lightings, for each block: block, lighting, row.
pub(super) type Relit = Vec<Vec<Vec<f64>>>;

/// For each lighting, the rows of `L R ℓ + S ℓ` (channel-planar).
pub(super) fn relit_factors(block: &FactoredBlock, lightings: &[Lighting]) -> Vec<Vec<f64>> {
    let relit = |lighting: &Lighting| {
        block.relight(lighting.weights().iter().enumerate().map(|(j, &weight)| (ColumnIndex(j as u32), weight)))
    };
    lightings.iter().map(relit).collect()
}

/// For each lighting, the rows of `A ℓ` (channel-planar).
pub(super) fn relit_block(block: BlockView<'_>, lightings: &[Lighting]) -> Vec<Vec<f64>> {
    let pixels = block.rows() / CHANNELS;
    let mut relit = vec![vec![0.0f64; block.rows()]; lightings.len()];
    for (j, column) in block.entries().chunks_exact(block.rows()).enumerate() {
        for (rows, lighting) in relit.iter_mut().zip(lightings) {
            let planes = rows.chunks_exact_mut(pixels).zip(column.chunks_exact(pixels));
            for ((rows, entries), weight) in planes.zip(lighting.weights()[j]) {
                if weight != 0.0 {
                    rows.iter_mut().zip(entries).for_each(|(r, e)| *r += f64::from(*e) * f64::from(weight));
                }
            }
        }
    }
    relit
}

/// Puts the rows of all blocks (block, lighting, row) together to one image for each lighting.
pub(super) fn assemble(shape: MatrixShape, lightings: usize, blocks: &[Vec<Vec<f64>>]) -> Vec<LinearImage> {
    let mut images = vec![LinearImage::black(shape.width(), shape.height()); lightings];
    for (id, relit) in blocks.iter().enumerate() {
        let rect = shape.rect(BlockId(id as u32));
        for (image, rows) in images.iter_mut().zip(relit) {
            for p in 0..rect.pixels() {
                let (x, y) = (rect.x + p as u32 % rect.width, rect.y + p as u32 / rect.width);
                let pixel = [0, 1, 2].map(|ch| rows[ch * rect.pixels() + p] as f32);
                image.pixels[(y * shape.width() + x) as usize] = pixel;
            }
        }
    }
    images
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::matrix::SparseEntry;

    #[test]
    fn factors_and_their_product_show_the_same() {
        let factored = FactoredBlock {
            rows: 6,
            columns: 3,
            left: (0..12).map(|i| i as f32 * 0.5 - 2.0).collect(),
            right: vec![1.0, -2.0, 0.5, 3.0, 0.25, 1.0],
            sparse: vec![SparseEntry { column: ColumnIndex(2), row: 5, value: 7.0 }],
            ..Default::default()
        };
        let lightings = [Lighting::new(vec![[1.0, 0.5, 2.0], [0.0; 3], [0.25, 1.0, 3.0]]).unwrap()];
        let (a, b) = (relit_factors(&factored, &lightings), relit_block(factored.expand().view(), &lightings));
        a[0].iter().zip(&b[0]).for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
        let images = assemble(MatrixShape::new(2, 1, 3, 2).unwrap(), 1, std::slice::from_ref(&a));
        assert_eq!(images[0].pixels[1], [1, 3, 5].map(|row: usize| a[0][row] as f32));
    }
}
