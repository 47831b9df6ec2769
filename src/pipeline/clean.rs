//! The light groups of an OpenEXR file cleaned of their noise, in a file like it.

use std::path::Path;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::import::ImportedMatrix;
use super::row_spill::{RowPlace, RowSpill};
use crate::block_records::stop_if_interrupted;
use crate::denoise::{DENOISER_VERSION, DenoisedJob, DenoisedSource};
use crate::error::{Error, Hint, Result};
use crate::files::check_output;
use crate::image::LightSet;
use crate::light::Clusters;
use crate::matrix::{BlockId, BlockSource, CHANNELS, TracedBlock};
use crate::resources::{JobStage, MemoryNeed, PerThread, Progress, ResourceEstimate, Threads, budget_bytes};
use crate::store;

/// Choices of cleaning.
#[derive(Clone, Copy, Debug, Default)]
pub struct CleanOptions {
    /// Whether a file of the name is replaced.
    pub overwrite: bool,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
}

/// Writes the file of `set` again at `to`, with each light group denoised as packing denoises it, and the picture under all lights as
/// their sum: see [`LightSet::rewrite`]. `matrix` are the images of the set, with their noise. What the picture has beyond the groups
/// is denoised as a light of its own, and is in the sum.
///
/// # Errors
/// The noise is not known; too many lights to be denoised; those of [`LightSet::rewrite`]; not enough memory or disk;
/// [`Error::Interrupted`] when the watch says so.
pub fn clean_images(
    matrix: &ImportedMatrix,
    set: &LightSet,
    to: &Path,
    options: CleanOptions,
    watch: &dyn Progress,
) -> Result<()> {
    check_output(to, options.overwrite)?;
    set.check_rewrite(to)?;
    let (job, shape) = (matrix.job(), matrix.shape());
    if !matrix.is_denoised() {
        let problem = format!("{} lights are too many to be denoised: at most {} are", shape.columns(), Clusters::MAX);
        return Err(Error::input(to.display().to_string(), problem, Hint::FewerLights));
    }
    let size = (shape.width() as usize, shape.height() as usize);
    let reading = store::requirements(job, &store::StoreOptions { planes: true, ..Default::default() }).memory_bytes;
    let making = ResourceEstimate::of(&[&PerThread(reading)]);
    let of = DenoisedJob { job, budget_bytes: budget_bytes(options.memory_bytes) };
    let mut need = DenoisedSource::need(of, making, shape.max_block_bytes().max(set.thread_bytes()));
    let images = RowSpill::bytes(shape.columns(), size.0, size.1);
    need.disk_bytes += 2 * images;
    need.most_disk_bytes = need.disk_bytes;
    let threads = Threads::new(need.admit("cleaning", to, &[], options.memory_bytes, watch)?)?;
    let mut fingerprint = Sha256::new();
    fingerprint.update(job.hash().0);
    fingerprint.update(format!("cleaned images {DENOISER_VERSION}"));
    let scales = job.basis.column_scales();
    let mut denoised = DenoisedSource::begin(of, to, fingerprint.finalize().into(), options.overwrite, None)?;
    denoised.gather(&threads, JobStage { name: "reading", work_unit: "B" }, watch, |id, block| {
        matrix.read_block(id, block)?;
        block.divide_columns(scales);
        Ok(size_of_val(block.block.entries()) as u64)
    })?;
    // Each light is a cluster, so that there is nothing to fit.
    denoised.filter(&threads, watch)?;
    let rows = RowSpill::create(to, shape.columns(), size.0, size.1)?;
    let spread = |block: &mut TracedBlock, id: BlockId| -> Result<()> {
        stop_if_interrupted(to, watch)?;
        denoised.read_block(id, block)?;
        let rect = shape.rect(id);
        let (width, height) = (rect.width as usize, rect.height as usize);
        for (column, entries) in block.block.entries_mut().chunks_exact_mut(rect.rows()).enumerate() {
            let scale = scales.get(column).copied().unwrap_or(1.0);
            entries.iter_mut().for_each(|entry| *entry *= scale);
            for (row, piece) in entries.chunks_exact(width).enumerate() {
                let (channel, y) = (row / height, rect.y as usize + row % height);
                rows.write(RowPlace { image: column, channel, y, x: rect.x as usize }, piece)?;
            }
        }
        watch.advance(1, u64::from(rect.width * rect.height), "px");
        Ok(())
    };
    let blocks: Vec<BlockId> = shape.blocks().collect();
    watch.begin("spreading", blocks.len() as u64, "blocks");
    let spreading =
        threads.run(|| blocks.into_par_iter().try_for_each_init(TracedBlock::default, |block, id| spread(block, id)));
    watch.end();
    spreading?;
    watch.begin("writing", (CHANNELS * size.1 * (set.lights.len() + usize::from(set.has_sum))) as u64, "rows");
    let mut fetch = |image: usize, channel: usize, y: usize, row: &mut [f32]| {
        stop_if_interrupted(to, watch)?;
        if image >= shape.columns() {
            row.fill(0.0);
            return Ok(());
        }
        rows.read(RowPlace { image, channel, y, x: 0 }, row)
    };
    let mut wrote = || watch.advance(1, 0, "B");
    let written = threads.run(|| set.rewrite(to, options.overwrite, (&mut fetch, &mut wrote)));
    watch.end();
    written?;
    denoised.remove()
}
