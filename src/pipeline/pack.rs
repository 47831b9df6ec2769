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
use crate::compress::{Candidate, CompressSettings, Compressor, Method, Target};
use crate::container::{BlockReport, ContainerOptions, ContainerReport, ContainerWriter, WrittenBlock};
use crate::error::{Error, Result};
use crate::light::Job;
use crate::matrix::{Block, BlockId, BlockNoise, BlockSource, FactoredBlock, TracedBlock};

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
/// An interrupted pack of the same matrix with the same settings is continued: every block is analysed again, since one
/// slope holds for all, but what is encoded is kept.
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
    let container = ContainerOptions { report: report_of(&options.compress), ..options.container.clone() };
    let writer = ContainerWriter::create(path, job, container)?;
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
        if let Some(written) = writer.written(id) {
            watch.advance(1, 0, "B");
            return Ok(written);
        }
        let candidate = candidate(&spill, place)?;
        let factored = candidate.cut(&cut);
        source.read_block(id, block)?;
        let encoded = writer.encode(id, &factored)?;
        let report = measure(block, &writer.decode(id, &encoded)?);
        writer.write_encoded(id, &encoded, &report)?;
        watch.advance(1, block_bytes(block), "B");
        Ok(WrittenBlock { rank: factored.rank(), sparse_entries: factored.sparse.len(), report })
    };
    let stored = on_threads(threads, || -> Result<Vec<WrittenBlock>> {
        blocks.par_iter().zip(&places).map_init(TracedBlock::default, store).collect()
    });
    watch.end();
    let stored = stored??;
    let summary = writer.finish()?;
    let sum = |part: fn(&WrittenBlock) -> f64| stored.iter().map(part).sum::<f64>();
    Ok(PackReport {
        seconds: begun.elapsed().as_secs_f64(),
        raw_bytes: job.shape.raw_bytes(),
        packed_bytes: summary.file_bytes,
        mean_rank: sum(|s| s.rank as f64) / stored.len() as f64,
        sparse_entries: stored.iter().map(|s| s.sparse_entries as u64).sum(),
        relative_l2: (sum(|s| s.report.squared_error) / sum(|s| s.report.squared_norm).max(f64::MIN_POSITIVE)).sqrt(),
        peak_memory_bytes: memory.stop(),
    })
}

/// The error of stored factors against the block that they stand for.
fn measure(block: &TracedBlock, stored: &FactoredBlock) -> BlockReport {
    let expanded = stored.expand();
    let (mut squared_error, mut squared_norm) = (0.0, 0.0);
    for (a, b) in block.block.entries().iter().zip(expanded.entries()) {
        squared_error += f64::from(a - b).powi(2);
        squared_norm += f64::from(*a).powi(2);
    }
    let noise_variance = block.noise.as_ref().map_or(f64::NAN, BlockNoise::mean_variance);
    let (stored, packed) = (all_on(&block.block), all_on(&expanded));
    let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    let difference = squares(&mut stored.iter().zip(&packed).map(|(a, b)| a - b));
    let uniform_error = if difference == 0.0 { 0.0 } else { (difference / squares(&mut stored.into_iter())).sqrt() };
    BlockReport { squared_error, squared_norm, noise_variance, uniform_error }
}

/// The rows' sums: the block's pixels with all lights on.
fn all_on(block: &Block) -> Vec<f64> {
    let mut sums = vec![0.0; block.rows()];
    for column in block.entries().chunks_exact(block.rows()) {
        sums.iter_mut().zip(column).for_each(|(sum, &v)| *sum += f64::from(v));
    }
    sums
}

/// What the container says of how it was made.
fn report_of(settings: &CompressSettings) -> ContainerReport {
    let target = match settings.target {
        _ if settings.method != Method::Auto && settings.fixed_rank => format!("rank {}", settings.rank),
        Target::PsnrDb(db) => format!("{db} dB PSNR of relit images"),
        Target::RelativeL2(error) => format!("relative L2 {error} of relit images"),
        Target::Bytes(bytes) => format!("{bytes} bytes of factors"),
        Target::Slope(slope) => format!("slope {slope}"),
    };
    let provenance = [
        ("squared error, squared norm", "measured against the stored matrix, after quantisation"),
        ("uniform error", "measured with weight 1 on every column, after quantisation"),
        ("noise variance", "from the two half-sample estimates of the source; NaN where it has none"),
    ];
    ContainerReport {
        program: format!("ltm {}", env!("CARGO_PKG_VERSION")),
        method: settings.method.to_string(),
        target,
        prior: format!("{:?}", settings.prior).to_lowercase(),
        settings: format!("{settings:?}"),
        provenance: provenance.map(|(figure, origin)| (figure.to_owned(), origin.to_owned())).to_vec(),
    }
}

fn block_bytes(block: &TracedBlock) -> u64 {
    size_of_val(block.block.entries()) as u64
}

fn stop_if_interrupted(path: &Path, watch: &dyn Watch) -> Result<()> {
    if watch.interrupted() {
        return Err(Error::Interrupted(format!("{} was not written; the same command continues", path.display())));
    }
    Ok(())
}

/// A candidate read back from the spill file.
fn candidate(spill: &Spill, place: &Place) -> Result<Candidate> {
    let bytes = spill.read(place)?;
    Candidate::from_bytes(&bytes).map_err(|problem| spill.damaged(&problem))
}
