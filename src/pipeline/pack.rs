//! `.ltm` → `.ltc`: two passes over the blocks, one to learn what each offers, one to keep what one slope allows.
//!
//! The first pass analyses blocks in parallel and spills each candidate to a temporary file, so that memory does not
//! grow with the matrix; the second cuts every candidate at the common slope, encodes it, and measures the error of
//! what was really stored against the source block.

use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;

use super::budget::{Need, on_threads};
use super::render::PROGRAM_BYTES;
use super::spill::{Place, Spill};
use super::{PeakMemory, Watch, human_bytes};
use crate::compress::{Candidate, CompressSettings, Compressor};
use crate::container::{BlockReport, ContainerOptions, ContainerWriter};
use crate::error::{Error, Result};
use crate::light::Job;
use crate::matrix::{BlockId, BlockSource, FactoredBlock, TracedBlock};

/// Choices of a pack.
#[derive(Clone, Debug, Default)]
pub struct PackOptions {
    /// How blocks are compressed.
    pub compress: CompressSettings,
    /// How factors are written.
    pub container: ContainerOptions,
    /// Anonymous memory to stay within; none: what the system has.
    pub memory_bytes: Option<u64>,
}

/// What a pack did.
#[derive(Clone, Copy, Debug, Default)]
pub struct PackReport {
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Bytes of the matrix in f32.
    pub raw_bytes: u64,
    /// Bytes of the container.
    pub packed_bytes: u64,
    /// Mean rank over blocks.
    pub mean_rank: f64,
    /// Entries kept outside the low-rank part.
    pub sparse_entries: u64,
    /// `‖T − T'‖_F / ‖T‖_F` of the stored container against the source, measured.
    pub relative_l2: f64,
    /// Peak resident anonymous memory, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// Compresses `source`, the matrix of `job`, into a container at `path`.
///
/// Errors: those of reading, compressing and writing; [`Error::Interrupted`] when the watch says so, with nothing left
/// under the final name.
pub fn pack(
    source: &dyn BlockSource,
    job: &Job,
    path: &Path,
    options: &PackOptions,
    watch: &dyn Watch,
) -> Result<PackReport> {
    let begun = Instant::now();
    let memory = PeakMemory::start();
    let writer = ContainerWriter::create(path, job, options.container.clone())?;
    let compressor = Compressor::new(&job.basis, job.shape, options.compress.clone())?;
    let spill = Spill::create(path)?;

    // Beside the analysis of a block: the block itself, its factors multiplied out, and what reading and encoding take.
    let block_bytes_f32 = job.shape.max_block_rows() as u64 * job.shape.columns() as u64 * 4;
    let need = Need {
        fixed_bytes: PROGRAM_BYTES + 4096 * u64::from(job.shape.block_count()),
        per_thread_bytes: compressor.needs_bytes() + 2 * block_bytes_f32,
    };
    let threads = need.threads_within("packing", options.memory_bytes)?;
    watch.note(&format!(
        "{}: packing with {threads} threads, needs {} of memory",
        path.display(),
        human_bytes(need.bytes(threads))
    ));

    let blocks: Vec<BlockId> = job.shape.blocks().collect();
    watch.begin("analysing", blocks.len() as u64, "blocks");
    let analyse = |block: &mut TracedBlock, &id: &BlockId| {
        stop_if_interrupted(path, watch)?;
        source.read_block(id, block)?;
        let candidate = compressor.analyse(id, block.block.view(), block.noise.as_ref());
        let place = spill.append(&candidate.to_bytes())?;
        watch.advance(1, block_bytes(block), "B");
        Ok((candidate.summary().clone(), place))
    };
    let analysed = on_threads(threads, || -> Result<Vec<_>> {
        blocks.par_iter().map_init(TracedBlock::default, analyse).collect()
    });
    watch.end();
    let (summaries, places): (Vec<_>, Vec<_>) = analysed??.into_iter().unzip();
    let cut = compressor.choose(summaries.iter());

    watch.begin("packing", blocks.len() as u64, "blocks");
    let store = |block: &mut TracedBlock, (&id, place): (&BlockId, &Place)| {
        stop_if_interrupted(path, watch)?;
        let candidate = candidate(&spill, place)?;
        let factored = candidate.cut(&cut);
        source.read_block(id, block)?;
        let encoded = writer.encode(id, &factored)?;
        let report = measure(block, &writer.decode(id, &encoded)?);
        writer.write_encoded(id, &encoded, &report)?;
        watch.advance(1, block_bytes(block), "B");
        Ok(Stored { rank: factored.rank(), sparse: factored.sparse.len(), report })
    };
    let stored = on_threads(threads, || -> Result<Vec<Stored>> {
        blocks.par_iter().zip(&places).map_init(TracedBlock::default, store).collect()
    });
    watch.end();
    let stored = stored??;
    let summary = writer.finish()?;
    let sum = |part: fn(&Stored) -> f64| stored.iter().map(part).sum::<f64>();
    Ok(PackReport {
        seconds: begun.elapsed().as_secs_f64(),
        raw_bytes: job.shape.raw_bytes(),
        packed_bytes: summary.file_bytes,
        mean_rank: sum(|s| s.rank as f64) / stored.len() as f64,
        sparse_entries: stored.iter().map(|s| s.sparse as u64).sum(),
        relative_l2: (sum(|s| s.report.squared_error) / sum(|s| s.report.squared_norm).max(f64::MIN_POSITIVE)).sqrt(),
        peak_memory_bytes: memory.stop(),
    })
}

struct Stored {
    rank: usize,
    sparse: usize,
    report: BlockReport,
}

/// The error of stored factors against the block that they stand for.
fn measure(block: &TracedBlock, stored: &FactoredBlock) -> BlockReport {
    let expanded = stored.expand();
    let (mut squared_error, mut squared_norm) = (0.0, 0.0);
    for (a, b) in block.block.entries().iter().zip(expanded.entries()) {
        squared_error += f64::from(a - b).powi(2);
        squared_norm += f64::from(*a).powi(2);
    }
    let noise_variance = block.noise.as_ref().map_or(0.0, crate::matrix::BlockNoise::mean_variance);
    BlockReport { squared_error, squared_norm, noise_variance, ..Default::default() }
}

fn block_bytes(block: &TracedBlock) -> u64 {
    size_of_val(block.block.entries()) as u64
}

fn stop_if_interrupted(path: &Path, watch: &dyn Watch) -> Result<()> {
    if watch.interrupted() {
        return Err(Error::Interrupted(format!("{} was not written", path.display())));
    }
    Ok(())
}

/// A candidate read back from the spill file.
fn candidate(spill: &Spill, place: &Place) -> Result<Candidate> {
    let bytes = spill.read(place)?;
    Candidate::from_bytes(&bytes).map_err(|problem| spill.damaged(&problem))
}
