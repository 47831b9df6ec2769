//! The direct product with a raw matrix: the reference that everything else is measured against.

use rayon::prelude::*;

use super::cpu::check_columns;
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, BlockSource, CHANNELS, TracedBlock};

/// The images `T ℓ` under several lightings, from one pass over the blocks of `T`; sums are kept in f64.
///
/// Holds at most one block for each thread, and the images twice.
///
/// # Errors
/// What the source reports, and a lighting with another number of columns than the matrix.
pub fn relight_raw(source: &dyn BlockSource, lightings: &[Lighting]) -> Result<Vec<LinearImage>> {
    let shape = source.shape();
    lightings.iter().try_for_each(|lighting| check_columns(shape, lighting))?;
    let relit: Vec<Vec<Vec<f32>>> = (0..shape.block_count())
        .into_par_iter()
        .map_init(TracedBlock::default, |traced, id| relit_rows(source, BlockId(id), lightings, traced))
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

/// The rows of a block under each lighting, channel-planar; `scratch` is reused.
pub(super) fn relit_rows(
    source: &dyn BlockSource,
    id: BlockId,
    lightings: &[Lighting],
    scratch: &mut TracedBlock,
) -> Result<Vec<Vec<f32>>> {
    let shape = source.shape();
    let mut sums = vec![vec![0.0f64; shape.rect(id).rows()]; lightings.len()];
    source.visit_columns(id, 0..shape.columns() as u32, scratch, &mut |column, entries| {
        for (sums, lighting) in sums.iter_mut().zip(lightings) {
            let weight = lighting.weights()[column.index()];
            pulp::Arch::new().dispatch(AddColumn { entries, weight, sums });
        }
    })?;
    Ok(sums.into_iter().map(|rows| rows.into_iter().map(|sum| sum as f32).collect()).collect())
}

/// Adds a column times its weight, compiled for the vectors that the machine has. Not a closure: what wraps one is compiled
/// without them.
struct AddColumn<'a> {
    entries: &'a [f32],
    weight: [f32; CHANNELS],
    sums: &'a mut [f64],
}

impl pulp::NullaryFnOnce for AddColumn<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let pixels = self.sums.len() / CHANNELS;
        let planes = self.sums.chunks_exact_mut(pixels).zip(self.entries.chunks_exact(pixels));
        for ((sums, entries), weight) in planes.zip(self.weight) {
            for (sum, entry) in sums.iter_mut().zip(entries) {
                *sum += f64::from(*entry) * f64::from(weight);
            }
        }
    }
}
