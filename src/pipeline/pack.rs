//! Blocks → `.ltc`: one pass over the blocks to learn what each offers, one over what was learnt to keep what one slope
//! allows.
//!
//! The first pass analyses blocks in parallel, wherever they come from: read from a store ([`pack`]), or traced on the
//! spot ([`render_packed`](super::render_packed)), so that the matrix never exists as a whole. Each candidate goes to a
//! spill file with what it lacks of its block, so that memory does not grow with the matrix. The second pass cuts every
//! candidate at the common slope, encodes it, and states the error of what was really stored ([`Residual`]). It does not
//! need the blocks again, so both ways give the same bytes. Choosing rows and columns for the whole matrix
//! ([`Scope::Global`](crate::compress::Scope::Global)) takes passes of its own before these, over a stored matrix only.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::analysis::{Analysed, FirstPass, PackStage};
use super::basis::Basis;
use super::clean::Cleaned;
use super::column_scales;
use super::exposed::Promise;
use super::pack_report::{PackReport, ReplacedEntries, Shortfall};
use super::records::Records;
use super::shard::ShardSet;
use super::spill::{check_container_output, files_of_pack, open_spill, spill_path};
use crate::clean::CLEANER_VERSION;
use crate::compress::{
    AUTOMATIC_DB, AUTOMATIC_MOST_DB, COMPRESSOR_VERSION, Candidate, CandidateSummary, CompressSettings, CompressorPlan,
    Cut, LightErrorSums, Method, Residual, Target, cut_of_size,
};
use crate::container::codec::fineness;
use crate::container::{ContainerOptions, ContainerReport, ContainerWriter, LightLayout, WrittenBlock};
use crate::error::{Error, Result};
use crate::host::{Need, PROGRAM_BYTES, Threads};
use crate::host::{PeakMemory, Watch};
use crate::light::{CleaningErrors, Job, StatedErrors};
use crate::matrix::{BlockId, BlockSource, FactoredBlock, MatrixShape, TracedBlock};
use crate::store;

/// Blocks that are encoded for each guess at a slope that makes a file of a given size, spread evenly; all of a small image.
const SAMPLE_BLOCKS: usize = 48;

/// What [`Target::Automatic`] is for cleaned images: there is no noise that would hide more. Of several lights each alone counts as
/// much as all together ([`LightingPrior::of_lights_alone`](crate::light::LightingPrior::of_lights_alone)).
///
/// Chosen on `conference-24` (1024 × 768 pixels, 32 samples): at 66 dB the faintest lamps alone show the borders of blocks and lose
/// shadows on the floor, at 72 dB they do not.
const CLEANED_DB: f64 = 72.0;

/// Components of a block of cleaned images at most, unless another number is chosen: those of the clusters and of what tells the
/// columns of each apart.
const CLEANED_RANK: usize = 64;

/// Choices of a pack.
#[derive(Clone, Debug, Default)]
pub struct PackOptions {
    /// How blocks are compressed.
    pub compress: CompressSettings,
    /// How factors are written; the report is made here.
    pub container: ContainerOptions,
    /// Whether images are cleaned before they are compressed: by [`Method::Auto`], where the samples were kept apart and
    /// their noise is heeded ([`CompressSettings::noise_factor`]). The container then holds the cleaned matrix, and what is
    /// said of its errors is against that.
    pub denoise: bool,
    /// Cleaned images to take in place of one's own: an EXR as [`write_basis`](super::write_basis) writes it, same layers, same size.
    pub basis: Option<PathBuf>,
    /// What the container is held to, which is measured and kept where images are cleaned; the blocks are the same.
    pub promise: Option<Arc<Promise>>,
    /// Whether to write a container, too, in which a light alone is hardly what it is: see [`LightLoss::is_severe`](crate::light::LightLoss::is_severe).
    pub allow_lost_lights: bool,
    /// Anonymous memory to stay within; none: what the system has.
    pub memory_bytes: Option<u64>,
}

impl PackOptions {
    /// What tells a pack of a job by these, as [`for_source`](Self::for_source) has them, from every other.
    pub(super) fn fingerprint(&self, job: &Job, variant: &[u8], basis: Option<&Basis>) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(job.hash().0);
        hash.update(variant);
        hash.update(format!(" compressor {COMPRESSOR_VERSION} {}", self.compress.identity()));
        if self.denoise {
            hash.update(format!("cleaner {CLEANER_VERSION}"));
        }
        if let Some(basis) = basis {
            hash.update(basis.hash);
        }
        if job.basis.is_unplaced() {
            hash.update("lights alike by their images, 1");
        }
        hash.finalize().into()
    }

    /// These, for blocks that come with planes or without.
    pub(super) fn for_source(&self, has_planes: bool) -> Self {
        let mut options = self.clone();
        let compress = &mut options.compress;
        options.denoise &= has_planes && compress.method == Method::Auto && compress.noise_factor.is_some();
        if options.denoise && compress.rank == CompressSettings::default().rank {
            compress.rank = CLEANED_RANK;
        }
        if options.denoise && compress.target == Target::Automatic {
            compress.target = Target::PsnrDb(CLEANED_DB);
        }
        options
    }
}

/// Compresses `source`, the matrix of `job`, into a container at `path`. Continues where an interrupted run over the same
/// entries with the same settings stopped.
///
/// # Errors
/// Those of reading, compressing and writing; [`Error::Interrupted`] when the watch says so, with every analysed
/// block kept and nothing under the final name.
pub fn pack(
    source: &dyn BlockSource,
    job: &Job,
    path: &Path,
    options: &PackOptions,
    watch: &dyn Watch,
) -> Result<PackReport> {
    let reading = store::requirements(job, &store::StoreOptions { planes: true, ..Default::default() }).memory_bytes;
    // Before anything is said of memory and disk.
    check_container_output(path, options.container.overwrite)?;
    let has_planes = options.denoise && {
        let block_bytes = (job.shape.max_block_rows() * job.shape.columns() * size_of::<f32>()) as u64;
        let need = Need { fixed_bytes: PROGRAM_BYTES, per_thread_bytes: reading + block_bytes, ..Need::default() };
        need.threads_within("packing", options.memory_bytes)?;
        let mut first = TracedBlock::default();
        source.read_block(BlockId(0), &mut first)?;
        first.planes.is_some()
    };
    let need = Need { per_thread_bytes: reading, ..Need::default() };
    let variant = source.variant()?;
    let of_blocks = PackSource { variant: &variant, need, has_planes };
    let (mut packing, plan) = Packing::begin(job, of_blocks, path, options, watch)?;
    packing.measure_column_scales(source, watch)?;
    let plan = packing.ask_images(plan, source, watch)?;
    let first_pass = packing.choose_globally(plan, source, watch)?;
    packing.run(first_pass, PackStage { name: "reading", work_unit: "B" }, watch, |id, block| {
        source.read_block(id, block)?;
        Ok(size_of_val(block.block.entries()) as u64)
    })
}

/// Where the blocks of a pack come from.
pub(super) struct PackSource<'a> {
    /// What tells them from other blocks of the same job: [`BlockSource::variant`].
    pub(super) variant: &'a [u8],
    /// What making them takes.
    pub(super) need: Need,
    /// Whether they come with planes.
    pub(super) has_planes: bool,
}

/// A pack that has been admitted and whose files are open.
pub(super) struct Packing {
    begun: Instant,
    memory: PeakMemory,
    path: PathBuf,
    job: Job,
    analysed: Analysed,
    writer: ContainerWriter,
    /// Of the job, its entries, and the settings.
    fingerprint: [u8; 32],
    denoise: bool,
    cleaning: Option<CleaningErrors>,
    promise: Option<Arc<Promise>>,
    basis: Option<Basis>,
    overwrite: bool,
    allow_lost_lights: bool,
    threads: Threads,
}

impl Packing {
    /// Refuses what cannot be done and opens the files.
    pub(super) fn begin(
        job: &Job,
        source: PackSource<'_>,
        path: &Path,
        options: &PackOptions,
        watch: &dyn Watch,
    ) -> Result<(Self, CompressorPlan)> {
        let (begun, memory) = (Instant::now(), PeakMemory::start());
        let options = &options.for_source(source.has_planes);
        let container = ContainerOptions { report: report_of(options), ..options.container.clone() };
        let plan = plan_of(job, options)?;
        let basis = open_basis(options, job)?;
        let mut need = need_of(&plan, job.shape, source.need, options.denoise.then_some(job));
        need.fixed_bytes += basis.as_ref().map_or(0, Basis::needs_bytes);
        need.fixed_bytes += if options.denoise { 0 } else { plan.asking_needs_bytes(&job.basis) };
        need.fixed_bytes += options.promise.as_ref().map_or(0, |promise| promise.needs_bytes());
        let overwrite = container.overwrite;
        // Before anything is said of memory and disk.
        check_container_output(path, overwrite)?;
        let there = files_of_pack(path);
        let there = there.each_ref().map(PathBuf::as_path);
        let threads = Threads::new(need.admit("packing", path, &there, options.memory_bytes, watch)?)?;
        let fingerprint = options.fingerprint(job, source.variant, basis.as_ref());
        let writer = ContainerWriter::create(path, job, ContainerOptions { origin: fingerprint, ..container })?;
        let spill = open_spill(path, fingerprint, job.shape.block_count(), overwrite)?;
        let (path, job, denoise) = (path.to_owned(), job.clone(), options.denoise);
        let analysed = Analysed { records: Records::File(spill) };
        let packing = Self {
            begun,
            memory,
            path,
            job,
            analysed,
            writer,
            fingerprint,
            denoise,
            cleaning: None,
            promise: options.promise.clone(),
            basis,
            overwrite,
            allow_lost_lights: options.allow_lost_lights,
            threads,
        };
        Ok((packing, plan))
    }

    /// Packs what shards hold of all blocks.
    #[cfg(feature = "scene")]
    pub(super) fn run_shards(
        mut self,
        compressor: crate::compress::Compressor,
        shards: ShardSet,
        watch: &dyn Watch,
    ) -> Result<PackReport> {
        let stage = PackStage { name: "reading shards", work_unit: "B" };
        let address = shards.address().to_owned();
        let absent =
            |id: BlockId, _: &mut TracedBlock| Err(Error::damaged(&address, format!("{id} is missing"), "merge again"));
        if self.denoise {
            return self.run_cleaned(compressor.into_plan(), Some(shards), stage, watch, absent);
        }
        let own = std::mem::replace(&mut self.analysed.records, Records::Shards(shards));
        own.remove()?;
        self.compress(FirstPass::Analyse(compressor), stage, watch, absent)
    }

    /// Takes scales of columns that are known only now, see [`LightBasis::column_scales`](crate::light::LightBasis::column_scales).
    ///
    /// # Errors
    /// They are not those of these columns.
    pub(super) fn set_column_scales(&mut self, scales: &[f32]) -> Result<()> {
        self.job.basis.set_column_scales(scales.to_vec())?;
        self.writer.set_column_scales(scales)
    }

    /// Where nobody knows the scales of columns, and neither noise nor light of clusters has been summed without them: reads the matrix
    /// once for them.
    fn measure_column_scales(&mut self, source: &dyn BlockSource, watch: &dyn Watch) -> Result<()> {
        if !self.job.basis.column_scales().is_empty() {
            return Ok(());
        }
        let source = Watched { source, watch, path: &self.path, scales: &[] };
        if let Some(scales) = self.threads.run(|| column_scales::measure(&source, &self.job.basis, watch))? {
            self.set_column_scales(&scales)?;
        }
        Ok(())
    }

    /// Where rows and columns are chosen for the whole matrix: reads it for that, as often as the method needs.
    fn choose_globally(&self, plan: CompressorPlan, source: &dyn BlockSource, watch: &dyn Watch) -> Result<FirstPass> {
        let passes = u64::from(plan.global_passes());
        if passes == 0 {
            return Ok(FirstPass::Analyse(plan.for_blocks()?));
        }
        if self.job.shape.blocks().all(|id| self.analysed.records.has(id.0)) {
            return Ok(FirstPass::Read(plan));
        }
        watch.begin("choosing rows and columns", passes * u64::from(self.job.shape.block_count()), "blocks");
        let source = Watched { source, watch, path: &self.path, scales: self.job.basis.column_scales() };
        let chosen = self.threads.run(|| plan.choose_globally(&source));
        watch.end();
        Ok(FirstPass::Analyse(chosen?))
    }

    /// Where nothing tells how lights stand to each other: looks which are alike.
    fn ask_images(&self, plan: CompressorPlan, source: &dyn BlockSource, watch: &dyn Watch) -> Result<CompressorPlan> {
        let blocks = plan.blocks_asked(&self.job.basis);
        if self.denoise || blocks == 0 {
            return Ok(plan);
        }
        watch.begin("looking which lights are alike", blocks, "blocks");
        let source = Watched { source, watch, path: &self.path, scales: self.job.basis.column_scales() };
        let asked = self.threads.run(|| plan.ask_images(&self.job.basis, &source));
        watch.end();
        asked
    }

    /// Cleans the blocks where that is asked for, and compresses them. `make` puts a block into its target and says how much
    /// work that was.
    pub(super) fn run(
        self,
        first_pass: FirstPass,
        stage: PackStage<'_>,
        watch: &dyn Watch,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<PackReport> {
        let scales = self.job.basis.column_scales().to_vec();
        let make = |id: BlockId, block: &mut TracedBlock| {
            let work = make(id, block)?;
            block.divide_columns(&scales);
            Ok(work)
        };
        if !self.denoise {
            let name = format!("{} and analysing", stage.name);
            return self.compress(first_pass, PackStage { name: &name, ..stage }, watch, make);
        }
        self.run_cleaned(first_pass.into_plan(), None, stage, watch, make)
    }

    /// Cleans blocks, of which the planes come as `shards` or are taken from what `make` makes, and compresses them.
    fn run_cleaned(
        mut self,
        plan: CompressorPlan,
        shards: Option<ShardSet>,
        stage: PackStage<'_>,
        watch: &dyn Watch,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<PackReport> {
        // What is made here on is of columns divided by their scales, and so is all that is learnt of it.
        let mut cleaned = Cleaned::begin(&self.job, &self.path, self.fingerprint, self.overwrite, shards)?;
        let blocks_kept = cleaned.gather(&self.threads, stage, watch, make)?;
        match &self.basis {
            Some(basis) => cleaned.take(basis, watch)?,
            None => cleaned.filter(&self.threads, watch)?,
        }
        cleaned.fit(watch)?;
        self.cleaning = cleaned.errors()?;
        let shares = cleaned.shares_of_lights(&self.job.basis)?;
        let first_pass = FirstPass::Analyse(plan.for_lights_alone(&self.job.basis, &shares).for_blocks()?);
        let stage = PackStage { name: "analysing", work_unit: "B" };
        let packed = self.compress(first_pass, stage, watch, |id, block| {
            cleaned.read_block(id, block)?;
            Ok(size_of_val(block.block.entries()) as u64)
        })?;
        cleaned.remove()?;
        Ok(PackReport { blocks_kept, ..packed })
    }

    /// Runs both passes over blocks that are as they shall be stored.
    fn compress(
        mut self,
        first_pass: FirstPass,
        stage: PackStage<'_>,
        watch: &dyn Watch,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<PackReport> {
        let blocks: Vec<BlockId> = self.job.shape.blocks().collect();
        let blocks_kept = blocks.iter().filter(|&&id| self.analysed.records.has(id.0)).count() as u64;
        if blocks_kept > 0 && matches!(self.analysed.records, Records::File(_)) {
            watch.note(&format!("{}: continuing, {blocks_kept} blocks are analysed", self.path.display()));
        }
        watch.begin(stage.name, blocks.len() as u64, "blocks");
        let analyse = |block: &mut TracedBlock, &id: &BlockId| {
            stop_if_interrupted(&self.path, watch)?;
            let (summary, work) = match &first_pass {
                FirstPass::Analyse(compressor) => self.analysed.take(compressor, id, block, &make)?,
                FirstPass::Read(_) => (self.analysed.summary(id)?, 0),
            };
            watch.advance(1, work, stage.work_unit);
            Ok(summary)
        };
        let analysed = self
            .threads
            .run(|| -> Result<Vec<_>> { blocks.par_iter().map_init(TracedBlock::default, analyse).collect() });
        watch.end();
        let analysed = analysed?;
        let plan = first_pass.plan();
        let fineness = self.right_fineness(plan);
        let cut = self.choose(plan, &analysed, &fineness)?;
        let replaced = ReplacedEntries::of(&analysed, &blocks);
        if replaced.count() > 0 {
            watch.note(&format!("{}: {replaced}", self.path.display()));
        }
        let energy = analysed.iter().map(CandidateSummary::energy).sum();
        let lights = LightErrorSums::new(self.job.shape.columns(), energy);
        drop(analysed);

        watch.begin("packing", blocks.len() as u64, "blocks");
        let store = |&id: &BlockId| self.store(id, &cut, &fineness, &lights, watch);
        let stored = self.threads.run(|| -> Result<Vec<WrittenBlock>> { blocks.par_iter().map(store).collect() });
        watch.end();
        let stored = stored?;
        let lossy_lights = lights.lossy_lights(&self.job.basis);
        // What was replaced is no light, and who gives a rank has said what it may cost.
        let asked = replaced.count() > 0 || plan.settings().has_fixed_rank();
        let refuses = !(self.allow_lost_lights || asked);
        if let Some(lost) = lossy_lights.first().filter(|loss| loss.is_severe() && refuses) {
            let hint = "ask for a finer target or a higher rank; forced, it is written all the same";
            return Err(Error::input(self.path.display().to_string(), format!("{lost}: it is not written"), hint));
        }
        let lights = lights.errors(cut.expected_relative_l2);
        let exposed = self.promise.as_ref().map(|promise| promise.reached_packed());
        self.writer.state_errors(StatedErrors { lights: Some(lights), cleaning: self.cleaning, exposed });
        let summary = self.writer.finish()?;
        self.analysed.records.remove()?;
        let sum = |part: fn(&WrittenBlock) -> f64| stored.iter().map(part).sum::<f64>();
        let (error, norm) = (sum(|s| s.report.squared_error), sum(|s| s.report.squared_norm));
        let target = plan.settings().target;
        let is_reached = match target {
            // What blocks take together was estimated from some of them.
            Target::Bytes(bytes) => summary.file_bytes <= bytes,
            _ => cut.reaches_target,
        };
        Ok(PackReport {
            seconds: self.begun.elapsed().as_secs_f64(),
            raw_bytes: self.job.shape.raw_bytes(),
            packed_bytes: summary.file_bytes,
            mean_rank: sum(|s| s.rank as f64) / stored.len() as f64,
            sparse_entries: stored.iter().map(|s| s.sparse_entries as u64).sum(),
            relative_l2: (error / norm.max(f64::MIN_POSITIVE)).sqrt(),
            cleaning: self.cleaning,
            exposed,
            lights,
            lossy_lights,
            short_of_target: (!is_reached).then(|| Shortfall {
                target,
                psnr_db: cut.expected_psnr_db,
                relative_l2: cut.expected_relative_l2,
                file_bytes: summary.file_bytes,
                noise_heeded: cut.noise_factor.is_some() && stored.iter().any(|s| s.report.noise_variance.is_finite()),
            }),
            replaced,
            blocks_kept,
            peak_memory_bytes: self.memory.stop(),
        })
    }

    /// How much finer bands of right sides are stored: by what their errors do to the lightings of the prior. Where a rank is given there
    /// are no steps that they could be finer than.
    fn right_fineness(&self, plan: &CompressorPlan) -> Arc<[i8]> {
        if plan.settings().has_fixed_rank() {
            return Arc::default();
        }
        fineness(&LightLayout::of(&self.job.basis), plan.prior()).into()
    }

    /// The second pass over a block: cuts its candidate, writes it, and adds what it lost to `lights`.
    fn store(
        &self,
        id: BlockId,
        cut: &Cut,
        fineness: &Arc<[i8]>,
        lights: &LightErrorSums,
        watch: &dyn Watch,
    ) -> Result<WrittenBlock> {
        stop_if_interrupted(&self.path, watch)?;
        let (candidate, residual) = self.analysed.read(id)?;
        let factored = kept_of(&candidate, cut, fineness);
        let encoded = self.writer.encode_divided(id, &factored)?;
        let stored = self.writer.decode(id, &encoded)?;
        let (report, columns) = residual.report(&candidate.whole(), &stored);
        lights.add(&columns);
        if let Some(promise) = &self.promise {
            promise.see(id, &stored, &self.job.basis);
        }
        // What an earlier run wrote of it is the same.
        let bytes = match self.writer.written(id) {
            Some(_) => 0,
            None => self.writer.write_encoded(id, &encoded, &report)?.bytes(),
        };
        watch.advance(1, bytes as u64, "B");
        Ok(WrittenBlock { rank: factored.rank(), sparse_entries: factored.sparse.len(), report })
    }

    /// The cut for the target; where that is a number of bytes, the one of the largest file that is not larger.
    fn choose(&self, plan: &CompressorPlan, analysed: &[CandidateSummary], fineness: &Arc<[i8]>) -> Result<Cut> {
        let cut = plan.choose(analysed.iter());
        match plan.settings().target {
            Target::Bytes(bytes) if cut.slope > 0.0 => {
                self.threads.run(|| cut_of_size(cut, bytes, |cut| self.bytes_at(cut, fineness)))
            }
            _ => Ok(cut),
        }
    }

    /// Bytes of the file that a cut makes, from those of the blocks of the sample.
    fn bytes_at(&self, cut: &Cut, fineness: &Arc<[i8]>) -> Result<f64> {
        let blocks = self.job.shape.block_count() as usize;
        let sample: Vec<BlockId> =
            (0..blocks).step_by(blocks.div_ceil(SAMPLE_BLOCKS)).map(|i| BlockId(i as u32)).collect();
        let encode = |&id: &BlockId| -> Result<(usize, usize)> {
            let size = self.writer.encode_divided(id, &kept_of(&self.analysed.read(id)?.0, cut, fineness))?.size();
            Ok((size.bytes(), size.layer_bytes.len()))
        };
        let sizes = sample.par_iter().map(encode).collect::<Result<Vec<_>>>()?;
        let share = blocks as f64 / sample.len() as f64;
        let bytes = share * sizes.iter().map(|(bytes, _)| *bytes as f64).sum::<f64>();
        let layers = share * sizes.iter().map(|(_, layers)| *layers as f64).sum::<f64>();
        Ok(bytes + self.writer.overhead_bytes(layers.round() as u64) as f64)
    }
}

/// What a cut keeps of a candidate, and how finely it is to be stored.
fn kept_of(candidate: &Candidate, cut: &Cut, fineness: &Arc<[i8]>) -> FactoredBlock {
    FactoredBlock { right_fineness: Arc::clone(fineness), ..candidate.cut(cut) }
}

/// What compresses the matrix of a job. Each light alone counts as much as all together: those of columns that are divided by their
/// scales have equal shares of the picture. A matrix that is cleaned knows them better, once it is.
///
/// # Errors
/// Those of [`CompressorPlan::new`].
pub(super) fn plan_of(job: &Job, options: &PackOptions) -> Result<CompressorPlan> {
    let plan = CompressorPlan::new(&job.basis, job.shape, options.compress.clone())?;
    if plan.asks_images(&job.basis) {
        return Ok(plan);
    }
    let lights = job.basis.lights().len();
    Ok(plan.for_lights_alone(&job.basis, &vec![1.0 / lights as f64; lights]))
}

/// The cleaned images that the options name.
///
/// # Errors
/// The matrix is not cleaned at all; those of [`Basis::open`].
fn open_basis(options: &PackOptions, job: &Job) -> Result<Option<Basis>> {
    let Some(path) = &options.basis else { return Ok(None) };
    if !options.denoise {
        let hint = "it takes a matrix whose samples were kept apart, the method auto, and neither --denoise off nor --keep-noise";
        return Err(Error::input(
            path.display().to_string(),
            "is for a matrix that is cleaned, which this is not",
            hint,
        ));
    }
    Basis::open(path, job).map(Some)
}

/// # Errors
/// The watch says to stop.
pub(super) fn stop_if_interrupted(path: &Path, watch: &dyn Watch) -> Result<()> {
    if watch.interrupted() {
        let kept = spill_path(path);
        let text = format!("{} keeps the finished blocks; the same command continues", kept.display());
        return Err(Error::Interrupted(text));
    }
    Ok(())
}

/// A source whose reads are counted and can be stopped, with its columns divided by their scales.
struct Watched<'a> {
    source: &'a dyn BlockSource,
    watch: &'a dyn Watch,
    path: &'a Path,
    scales: &'a [f32],
}

impl BlockSource for Watched<'_> {
    fn shape(&self) -> MatrixShape {
        self.source.shape()
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        stop_if_interrupted(self.path, self.watch)?;
        self.source.read_block(id, target)?;
        target.divide_columns(self.scales);
        self.watch.advance(1, size_of_val(target.block.entries()) as u64, "B");
        Ok(())
    }
}

/// What packing a matrix of this shape takes, or that of the job that is `cleaned`. `source` is what making its blocks takes.
pub(super) fn need_of(plan: &CompressorPlan, shape: MatrixShape, source: Need, cleaned: Option<&Job>) -> Need {
    let (blocks, rows) = (u64::from(shape.block_count()), shape.max_block_rows() as u64);
    let columns = shape.columns() as u64;
    let candidate = plan.candidate_bytes() + Residual::max_bytes(rows, columns, plan.candidate_bytes() / 16);
    let block_bytes = rows * columns * 4;
    // Single entries may be fifty to a row, where fifty texels are seen through it alone; one is usual where any is.
    let sparse = if plan.settings().method == Method::Auto { rows } else { 0 };
    let likely = plan.factor_bytes() + 16 * sparse + Residual::max_bytes(rows, columns, sparse);
    // A rank of its own is stored whole, as 16-bit floats, in two places until it is done. Ours keeps what is worth its
    // bits: a fiftieth at the default target, a fourth where all is asked for.
    let fixed = plan.settings().has_fixed_rank();
    let stored = if fixed { likely } else { likely / 4 };
    // The analysis of a block, and its candidate: as it is, encoded, and multiplied out in strips.
    let compressing = plan.needs_bytes() + 3 * candidate;
    let cleaning = match cleaned {
        Some(job) => Cleaned::need(job, source.per_thread_bytes, compressing),
        None => Need { per_thread_bytes: source.per_thread_bytes + compressing, ..Need::default() },
    };
    Need {
        fixed_bytes: source.fixed_bytes.max(PROGRAM_BYTES)
            + 4096 * blocks
            + 48 * columns
            + plan.global_needs_bytes()
            + cleaning.fixed_bytes,
        per_thread_bytes: block_bytes + cleaning.per_thread_bytes,
        alone_bytes: cleaning.alone_bytes,
        disk_bytes: source.disk_bytes + blocks * (likely + stored) + cleaning.disk_bytes,
        // The spill file; then the waiting blocks and the container, each half as large as a candidate at most.
        most_disk_bytes: source.disk_bytes + 2 * blocks * candidate + cleaning.most_disk_bytes,
    }
}

/// What the container says of how it was made.
fn report_of(options: &PackOptions) -> ContainerReport {
    let settings = &options.compress;
    let target = match settings.target {
        _ if settings.has_fixed_rank() => format!("rank {}", settings.rank),
        Target::PsnrDb(db) => format!("{db} dB PSNR of relit images"),
        Target::RelativeL2(error) => format!("relative L2 {error} of relit images"),
        Target::Bytes(bytes) => format!("{bytes} bytes"),
        Target::Slope(slope) => format!("slope {slope}"),
        Target::Automatic => format!(
            "the noise of the samples, {AUTOMATIC_MOST_DB} dB PSNR of relit images at most ({AUTOMATIC_DB} dB where it is not \
             known)"
        ),
    };
    let provenance = [
        (
            "squared error",
            "measured against the f32 block, after quantisation, but for the product of the rounding of L and what the \
             components lack, whose mean is 0",
        ),
        ("squared norm", "measured"),
        ("uniform error", "measured with weight 1 on every column, after quantisation"),
        ("noise variance", "from the two half-sample estimates of the source; NaN where it has none"),
    ];
    ContainerReport {
        program: match options.denoise {
            true => format!("ltm compressor {COMPRESSOR_VERSION}, cleaner {CLEANER_VERSION}"),
            false => format!("ltm compressor {COMPRESSOR_VERSION}"),
        },
        method: match (options.denoise, &options.basis) {
            (true, None) => format!("{}, images cleaned", settings.method),
            (true, Some(_)) => format!("{}, images cleaned elsewhere", settings.method),
            (false, _) => settings.method.to_string(),
        },
        target,
        prior: settings.prior.identity().to_owned(),
        settings: settings.identity(),
        provenance: provenance.map(|(figure, origin)| (figure.to_owned(), origin.to_owned())).to_vec(),
    }
}
