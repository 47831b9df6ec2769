//! The scales of the columns of a matrix that comes without: one pass over its blocks.

use rayon::prelude::*;

use crate::error::Result;
use crate::light::LightBasis;
use crate::matrix::{BlockId, BlockSource, TracedBlock};
use crate::resources::Progress;

/// Blocks whose sums are held at once.
const AT_ONCE: usize = 64;

/// The scales of the columns of a matrix, see [`LightBasis::column_scales`]: mean size of the entries, one value for all columns of a
/// light, 1 for a light that has none. None where noise or light of clusters comes with the blocks, which are of columns as they are.
/// Runs on the current thread pool; the same for any number of threads.
///
/// # Errors
/// Those of reading.
pub(super) fn measure(source: &dyn BlockSource, basis: &LightBasis, watch: &dyn Progress) -> Result<Option<Vec<f32>>> {
    let shape = source.shape();
    let blocks: Vec<_> = shape.blocks().collect();
    let mut first = TracedBlock::default();
    source.read_block(blocks[0], &mut first)?;
    if first.noise.is_some() || first.planes.is_some() {
        return Ok(None);
    }
    watch.begin("measuring lights", blocks.len() as u64, "blocks");
    let sum = |traced: &mut TracedBlock, &id: &BlockId| -> Result<Vec<f32>> {
        source.read_block(id, traced)?;
        let columns = traced.block.entries().chunks_exact(shape.rect(id).rows());
        Ok(columns.map(|entries| sizes(entries) as f32).collect())
    };
    let mut total = vec![0.0f64; shape.columns()];
    let mut add_up = || -> Result<()> {
        for blocks in blocks.chunks(AT_ONCE) {
            let sums: Result<Vec<Vec<f32>>> = blocks.par_iter().map_init(TracedBlock::default, sum).collect();
            sums?.iter().for_each(|sums| total.iter_mut().zip(sums).for_each(|(total, &sum)| *total += f64::from(sum)));
        }
        Ok(())
    };
    let done = add_up();
    watch.end();
    done?;
    Ok(Some(of_sums(&total, shape.rows(), basis)))
}

/// The scales of columns whose sizes of entries sum up to these, over so many rows.
pub(super) fn of_sums(sums: &[f64], rows: u64, basis: &LightBasis) -> Vec<f32> {
    let scale_of = |columns: &[f64]| {
        let mean = (columns.iter().sum::<f64>() / (columns.len() as f64 * rows as f64)) as f32;
        std::iter::repeat_n(if mean.is_normal() { mean } else { 1.0 }, columns.len())
    };
    let lights = basis.lights().iter().map(|light| light.columns());
    lights.flat_map(|columns| scale_of(&sums[columns.start as usize..columns.end as usize])).collect()
}

/// Sum of the sizes of the values that can be computed with.
pub(super) fn sizes(values: &[f32]) -> f64 {
    const USABLE: f32 = 1e15;
    let size = |value: &f32| if value.abs() < USABLE { f64::from(value.abs()) } else { 0.0 };
    values.iter().map(size).sum()
}
