//! The direct product with a raw matrix: the reference that everything else is measured against.

use rayon::prelude::*;

use super::cpu::check_columns;
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, BlockSource, BlockView, CHANNELS, ColumnIndex, TracedBlock};

/// The images `T ℓ` under several lightings, from one pass over the blocks of `T`; sums are kept in f64.
///
/// Holds one block for each thread, and the images twice. Errors: what the source reports, and a lighting with another number
/// of columns than the matrix.
pub fn relight_raw(source: &dyn BlockSource, lightings: &[Lighting]) -> Result<Vec<LinearImage>> {
    let shape = source.shape();
    lightings.iter().try_for_each(|lighting| check_columns(shape, lighting))?;
    let relit: Vec<Vec<Vec<f32>>> = (0..shape.block_count())
        .into_par_iter()
        .map_init(TracedBlock::default, |traced, id| {
            source.read_block(BlockId(id), traced)?;
            Ok(multiply(traced.block.view(), lightings))
        })
        .collect::<Result<_>>()?;
    let image_of = |l: usize| {
        let mut image = LinearImage::black(shape.width(), shape.height());
        for_each_tile(&mut image, shape, |mut tile| {
            tile.set(&relit[tile.id.index()][l]);
            Ok::<_, Error>(())
        })?;
        Ok(image)
    };
    (0..lightings.len()).map(image_of).collect()
}

/// For each lighting, the rows of the block under it.
fn multiply(block: BlockView, lightings: &[Lighting]) -> Vec<Vec<f32>> {
    let mut sums = vec![vec![0.0f64; block.rows()]; lightings.len()];
    pulp::Arch::new().dispatch(Multiply { block, lightings, sums: &mut sums });
    sums.into_iter().map(|rows| rows.into_iter().map(|sum| sum as f32).collect()).collect()
}

/// The products, compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without them.
struct Multiply<'a> {
    block: BlockView<'a>,
    lightings: &'a [Lighting],
    sums: &'a mut [Vec<f64>],
}

impl pulp::NullaryFnOnce for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let pixels = self.block.rows() / CHANNELS;
        for j in 0..self.block.columns() {
            let column = self.block.column(ColumnIndex(j as u32));
            for (sums, lighting) in self.sums.iter_mut().zip(self.lightings) {
                let planes = sums.chunks_exact_mut(pixels).zip(column.chunks_exact(pixels));
                for ((sums, entries), weight) in planes.zip(lighting.weights()[j]) {
                    for (sum, entry) in sums.iter_mut().zip(entries) {
                        *sum += f64::from(*entry) * f64::from(weight);
                    }
                }
            }
        }
    }
}
