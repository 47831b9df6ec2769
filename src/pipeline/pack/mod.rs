//! Packing: blocks in, `.ltc` out. One pass over the blocks, one over the candidates.
//!
//! The first pass analyses blocks in parallel. They are read from a store ([`pack`]), or traced on the spot
//! ([`render_packed`](super::render_packed)), so that the matrix never exists as a whole. Each candidate goes to a
//! spill file with the residual of its block, so that memory does not grow with the matrix. The second pass cuts every
//! candidate at the common slope, encodes it, and measures the error of the stored block ([`Residual`]). It does not
//! need the blocks again, so both ways give the same bytes. Choosing rows and columns for the whole matrix
//! ([`Scope::Global`](crate::compress::Scope::Global)) takes further passes before these, over a stored matrix only.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use sha2::{Digest, Sha256};

mod analysis;
mod output;
mod report;
mod second_pass;

pub(crate) use self::analysis::{Analysed, FirstPass};
pub use self::output::check_container_output;
pub use self::report::{PackReport, ReplacedEntries, Shortfall};
pub(crate) use self::second_pass::{PackedBlocks, SecondPass, Sizing, energy_of};
use super::column_scales;
use crate::block_records::{Records, ShardSet, files_of_pack, open_spill, stop_if_interrupted};
use crate::compress::{
    AUTOMATIC_DB, AUTOMATIC_MAX_DB, COMPRESSOR_VERSION, CompressSettings, CompressorPlan, LightErrorSums, Method,
    Residual, Target,
};
use crate::container::{ContainerOptions, ContainerReport, ContainerWriter, WrittenBlock};
use crate::denoise::DENOISER_VERSION;
use crate::denoise::{DenoisedJob, DenoisedSource, ExternalImages};
use crate::error::{Error, Hint, Result};
use crate::error_estimate::ErrorMonitor;
use crate::light::{DenoiseErrors, DenoisedLight, Job};
use crate::matrix::{BlockId, BlockSource, MatrixShape, TracedBlock};
use crate::resources::{Held, JobStage, MemoryNeed, PerThread, ResourceEstimate, Threads, budget_bytes};
use crate::resources::{PeakMemory, Progress};
use crate::store;

/// PSNR in dB of [`Target::Automatic`] for denoised images, which have no noise that would hide errors. Each of several
/// lights alone counts as much as all together
/// ([`LightingPrior::of_lights_alone`](crate::light::LightingPrior::of_lights_alone)), and steps go by the eye
/// ([`CompressSettings::by_eye`]). Tuned: decisions 32 and 70.
const DENOISED_DB: f64 = 62.0;

/// Largest number of components of a block of denoised images, unless another number is chosen: those of the clusters
/// and of their residual.
const DENOISED_RANK: usize = 64;

/// Choices of a pack.
#[derive(Clone, Debug, Default)]
pub struct PackOptions {
    /// Settings of the compressor.
    pub compress: CompressSettings,
    /// Options of the container; its report is made here.
    pub container: ContainerOptions,
    /// Whether images are denoised before compression. This needs [`Method::Auto`], halves of the samples, and a noise
    /// factor ([`CompressSettings::noise_factor`]). The container then holds the denoised matrix, and its errors are
    /// against that.
    pub denoise: bool,
    /// Images denoised by another program, used instead of our denoiser: an EXR with the layers and size of
    /// [`write_basis`](super::write_basis).
    pub basis: Option<PathBuf>,
    /// Error promised for the container. It is measured and stored if images are denoised, and does not change the
    /// blocks.
    pub promise: Option<Arc<ErrorMonitor>>,
    /// Whether to write a container even if single lights lose too much: see
    /// [`LightLoss::is_severe`](crate::light::LightLoss::is_severe).
    pub allow_lost_lights: bool,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
}

impl PackOptions {
    /// Distinguishes this pack of a job from every other. The options are those after [`for_source`](Self::for_source).
    pub(crate) fn fingerprint(&self, job: &Job, variant: &[u8], basis: Option<&ExternalImages>) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(job.hash().0);
        hash.update(variant);
        hash.update(format!(" compressor {COMPRESSOR_VERSION} {}", self.compress.identity()));
        if self.denoise {
            hash.update(format!("cleaner {DENOISER_VERSION}"));
        }
        if let Some(basis) = basis {
            hash.update(basis.hash);
        }
        if job.basis.is_unplaced() {
            hash.update("lights alike by their images, 1");
        }
        hash.finalize().into()
    }

    /// Options of the container, with its report. These options are those after [`for_source`](Self::for_source).
    pub(crate) fn container_options(&self) -> ContainerOptions {
        ContainerOptions { report: report_of(self), ..self.container.clone() }
    }

    /// The job as it is denoised, if it is. These options are those after [`for_source`](Self::for_source).
    pub(crate) fn denoised<'a>(&self, job: &'a Job) -> Option<DenoisedJob<'a>> {
        self.denoise.then(|| DenoisedJob { job, budget_bytes: budget_bytes(self.memory_bytes) })
    }

    /// These options as they apply to blocks with or without planes.
    pub(crate) fn for_source(&self, has_planes: bool) -> Self {
        let mut options = self.clone();
        let compress = &mut options.compress;
        options.denoise &= has_planes && compress.method == Method::Auto && compress.noise_factor.is_some();
        if options.denoise && compress.rank == CompressSettings::default().rank {
            compress.rank = DENOISED_RANK;
        }
        if options.denoise && compress.target == Target::Automatic {
            compress.target = Target::PsnrDb(DENOISED_DB);
            compress.by_eye = true;
        }
        options
    }
}

/// Compresses `source`, the matrix of `job`, into a container at `path`. Continues where an interrupted run over the
/// same entries with the same settings stopped.
///
/// # Errors
/// Those of reading, compressing and writing; [`Error::Interrupted`] when the watch says so, with every analysed
/// block kept and nothing under the final name.
pub fn pack(
    source: &dyn BlockSource,
    job: &Job,
    path: &Path,
    options: &PackOptions,
    watch: &dyn Progress,
) -> Result<PackReport> {
    let reading = store::requirements(job, &store::StoreOptions { planes: true, ..Default::default() }).memory_bytes;
    // Before any message on memory and disk.
    check_container_output(path, options.container.overwrite)?;
    let has_planes = options.denoise && {
        let need = ResourceEstimate::of(&[&PerThread(reading + job.shape.max_block_bytes())]);
        need.threads_within("packing", options.memory_bytes)?;
        let mut first = TracedBlock::default();
        source.read_block(BlockId(0), &mut first)?;
        first.planes.is_some()
    };
    let need = ResourceEstimate::of(&[&PerThread(reading)]);
    let variant = source.variant()?;
    let of_blocks = PackSource { variant: &variant, need, has_planes };
    let (mut packing, plan) = Packing::begin(job, of_blocks, path, options, watch)?;
    packing.measure_column_scales(source, watch)?;
    let plan = packing.ask_images(plan, source, watch)?;
    let first_pass = packing.choose_globally(plan, source, watch)?;
    packing.run(first_pass, JobStage { name: "reading", work_unit: "B" }, watch, |id, block| {
        source.read_block(id, block)?;
        Ok(size_of_val(block.block.entries()) as u64)
    })
}

/// Where the blocks of a pack come from.
pub(crate) struct PackSource<'a> {
    /// What tells them from other blocks of the same job: [`BlockSource::variant`].
    pub(crate) variant: &'a [u8],
    /// What making them takes.
    pub(crate) need: ResourceEstimate,
    /// Whether they come with planes.
    pub(crate) has_planes: bool,
}

/// A pack that has been admitted and whose files are open.
pub(crate) struct Packing {
    begun: Instant,
    memory: PeakMemory,
    path: PathBuf,
    job: Job,
    analysed: Analysed,
    writer: ContainerWriter,
    /// Hash of the job, its entries, and the settings.
    fingerprint: [u8; 32],
    denoise: bool,
    denoising: Option<(DenoiseErrors, Vec<DenoisedLight>)>,
    promise: Option<Arc<ErrorMonitor>>,
    basis: Option<ExternalImages>,
    overwrite: bool,
    allow_lost_lights: bool,
    budget_bytes: u64,
    threads: Threads,
}

impl Packing {
    /// Checks the options and opens the files. `variant` identifies the blocks' source. `source` has the resources for
    /// making them, and whether they come with planes.
    pub(crate) fn begin(
        job: &Job,
        source: PackSource<'_>,
        path: &Path,
        options: &PackOptions,
        watch: &dyn Progress,
    ) -> Result<(Self, CompressorPlan)> {
        let (begun, memory) = (Instant::now(), PeakMemory::start());
        let options = &options.for_source(source.has_planes);
        let container = options.container_options();
        let plan = plan_of(job, options)?;
        let basis = open_basis(options, job)?;
        let asking = Held(if options.denoise { 0 } else { plan.asking_needs_bytes(&job.basis) });
        let denoised = options.denoised(job);
        let budget_bytes = denoised.map_or(0, |of| of.budget_bytes);
        let need = need_of(&plan, job.shape, source.need, denoised);
        let need = need.and(&[&basis, &asking, &options.promise.as_deref()]);
        let overwrite = container.overwrite;
        // Before any message on memory and disk.
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
            denoising: None,
            promise: options.promise.clone(),
            basis,
            overwrite,
            allow_lost_lights: options.allow_lost_lights,
            budget_bytes,
            threads,
        };
        Ok((packing, plan))
    }

    /// Packs the records that shards hold of all blocks.
    #[cfg(feature = "scene")]
    pub(crate) fn run_shards(
        mut self,
        compressor: crate::compress::Compressor,
        shards: ShardSet,
        watch: &dyn Progress,
    ) -> Result<PackReport> {
        let stage = JobStage { name: "reading shards", work_unit: "B" };
        let address = shards.address().to_owned();
        let absent =
            |id: BlockId, _: &mut TracedBlock| Err(Error::damaged(&address, format!("{id} is missing"), "merge again"));
        if self.denoise {
            return self.run_denoised(compressor.into_plan(), Some(shards), stage, watch, absent);
        }
        let own = std::mem::replace(&mut self.analysed.records, Records::Shards(shards));
        own.remove()?;
        self.compress(FirstPass::Analyse(compressor), stage, watch, absent)
    }

    /// Number of threads that it was admitted with.
    #[cfg(feature = "scene")]
    pub(crate) fn threads(&self) -> usize {
        self.threads.count()
    }

    /// Sets scales of columns that were measured after the start, see
    /// [`LightBasis::column_scales`](crate::light::LightBasis::column_scales).
    ///
    /// # Errors
    /// They are not those of these columns.
    pub(crate) fn set_column_scales(&mut self, scales: &[f32]) -> Result<()> {
        self.job.basis.set_column_scales(scales.to_vec())?;
        self.writer.set_column_scales(scales)
    }

    /// Measures the scales of columns in one pass, if they are unknown and neither noise nor cluster light has been
    /// summed without them.
    fn measure_column_scales(&mut self, source: &dyn BlockSource, watch: &dyn Progress) -> Result<()> {
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
    fn choose_globally(
        &self,
        plan: CompressorPlan,
        source: &dyn BlockSource,
        watch: &dyn Progress,
    ) -> Result<FirstPass> {
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
    fn ask_images(
        &self,
        plan: CompressorPlan,
        source: &dyn BlockSource,
        watch: &dyn Progress,
    ) -> Result<CompressorPlan> {
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

    /// Denoises the blocks if asked for, and compresses them. `make` fills a block and returns the amount of work, in
    /// `work_unit`.
    pub(crate) fn run(
        self,
        first_pass: FirstPass,
        stage: JobStage<'_>,
        watch: &dyn Progress,
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
            return self.compress(first_pass, JobStage { name: &name, ..stage }, watch, make);
        }
        self.run_denoised(first_pass.into_plan(), None, stage, watch, make)
    }

    /// Denoises blocks, whose planes come from `shards` or are gathered from what `make` makes, and compresses them.
    fn run_denoised(
        mut self,
        plan: CompressorPlan,
        shards: Option<ShardSet>,
        stage: JobStage<'_>,
        watch: &dyn Progress,
        make: impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync,
    ) -> Result<PackReport> {
        // From here on columns are divided by their scales.
        let of = DenoisedJob { job: &self.job, budget_bytes: self.budget_bytes };
        let mut denoised = DenoisedSource::begin(of, &self.path, self.fingerprint, self.overwrite, shards)?;
        let blocks_kept = denoised.gather(&self.threads, stage, watch, make)?;
        match &self.basis {
            Some(basis) => denoised.take(basis, watch)?,
            None => denoised.filter(&self.threads, watch)?,
        }
        let fit = denoised.fit(&self.job, watch)?;
        self.denoising = fit.errors;
        let first_pass = FirstPass::Analyse(plan.for_lights_alone(&self.job.basis, &fit.brightness).for_blocks()?);
        let stage = JobStage { name: "analysing", work_unit: "B" };
        let packed = self.compress(first_pass, stage, watch, |id, block| {
            denoised.read_block(id, block)?;
            Ok(size_of_val(block.block.entries()) as u64)
        })?;
        denoised.remove()?;
        Ok(PackReport { blocks_kept, ..packed })
    }

    /// Both passes over blocks as they are to be stored.
    fn compress(
        mut self,
        first_pass: FirstPass,
        stage: JobStage<'_>,
        watch: &dyn Progress,
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
        let sizing = Sizing { job: &self.job, report: self.writer.report(), encoder: self.writer.encoder() };
        let read = |id: BlockId| Ok(self.analysed.read(id)?.0);
        let second = self.threads.run(|| sizing.second_pass(plan, &analysed, &read))?;
        let replaced = ReplacedEntries::of(&analysed, &blocks);
        if replaced.count() > 0 {
            watch.note(&format!("{}: {replaced}", self.path.display()));
        }
        let lights = LightErrorSums::new(self.job.shape.columns(), energy_of(&analysed));
        drop(analysed);

        watch.begin("packing", blocks.len() as u64, "blocks");
        let store = |&id: &BlockId| self.store(id, &second, &lights, watch);
        let stored = self.threads.run(|| -> Result<Vec<WrittenBlock>> { blocks.par_iter().map(store).collect() });
        watch.end();
        let exposed = self.promise.as_ref().map(|promise| promise.reached_packed());
        let packed =
            PackedBlocks { cut: second.cut, replaced, stored: stored?, denoising: self.denoising.take(), exposed };
        let whole = packed.conclude(&self.job, plan.settings(), &lights);
        whole.check_lights(&self.path, self.allow_lost_lights)?;
        self.writer.state_errors(whole.errors.clone());
        let summary = self.writer.finish()?;
        self.analysed.records.remove()?;
        let seconds = self.begun.elapsed().as_secs_f64();
        let report = whole.report(&self.job, &summary, seconds);
        Ok(PackReport { blocks_kept, peak_memory_bytes: self.memory.stop(), ..report })
    }

    /// The second pass over a block: cuts its candidate, writes it, and adds its errors to `lights`.
    fn store(
        &self,
        id: BlockId,
        second: &SecondPass,
        lights: &LightErrorSums,
        watch: &dyn Progress,
    ) -> Result<WrittenBlock> {
        stop_if_interrupted(&self.path, watch)?;
        let coded = second.code(id, &self.analysed, self.writer.encoder())?;
        lights.add(&coded.columns);
        if let Some(promise) = &self.promise {
            promise.see(id, &coded.stored, &self.job.basis);
        }
        // An earlier run has written the same bytes.
        let bytes = match self.writer.written(id) {
            Some(_) => 0,
            None => self.writer.write_encoded(id, &coded.encoded, &coded.written.report)?.bytes(),
        };
        watch.advance(1, bytes as u64, "B");
        Ok(coded.written)
    }
}

/// The compressor for the matrix of a job. Each light alone counts as much as all together. Lights have equal shares of
/// the image if columns are divided by their scales; of a denoised matrix the shares are measured.
///
/// # Errors
/// Those of [`CompressorPlan::new`].
pub(crate) fn plan_of(job: &Job, options: &PackOptions) -> Result<CompressorPlan> {
    let plan = CompressorPlan::new(&job.basis, job.shape, options.compress.clone())?;
    if plan.asks_images(&job.basis) {
        return Ok(plan);
    }
    let lights = job.basis.lights().len();
    Ok(plan.for_lights_alone(&job.basis, &vec![1.0 / lights as f64; lights]))
}

/// The images denoised by another program that the options name.
///
/// # Errors
/// The matrix is not denoised at all; those of [`ExternalImages::open`].
fn open_basis(options: &PackOptions, job: &Job) -> Result<Option<ExternalImages>> {
    let Some(path) = &options.basis else { return Ok(None) };
    if !options.denoise {
        let problem = "is for a matrix that is denoised, which this is not";
        return Err(Error::input(path.display().to_string(), problem, Hint::DenoiseMatrix));
    }
    ExternalImages::open(path, job).map(Some)
}

/// A source that counts its reads, can be stopped, and divides columns by their scales.
struct Watched<'a> {
    source: &'a dyn BlockSource,
    watch: &'a dyn Progress,
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

/// Resources of packing a matrix of this shape, or of the job that is denoised (`denoised`). `source` is for making its
/// blocks.
pub(crate) fn need_of(
    plan: &CompressorPlan,
    shape: MatrixShape,
    source: ResourceEstimate,
    denoised: Option<DenoisedJob<'_>>,
) -> ResourceEstimate {
    let (blocks, rows) = (u64::from(shape.block_count()), shape.max_block_rows() as u64);
    let columns = shape.columns() as u64;
    let candidate = plan.candidate_bytes() + Residual::max_bytes(rows, columns, plan.candidate_bytes() / 16);
    // Single entries may be fifty to a row, where fifty texels are seen through it alone; one is usual where any is.
    let sparse = if plan.settings().method == Method::Auto { rows } else { 0 };
    let likely = plan.factor_bytes() + 16 * sparse + Residual::max_bytes(rows, columns, sparse);
    // A rank of its own is stored whole, as 16-bit floats, in two places until it is done. Ours keeps what is worth its
    // bits: a fiftieth at the default target, a fourth where all is asked for.
    let fixed = plan.settings().has_fixed_rank();
    let stored = if fixed { likely } else { likely / 4 };
    // The analysis of a block, and its candidate: as it is, encoded, and multiplied out in strips.
    let compressing = plan.thread_bytes() + 3 * candidate;
    let making = match denoised {
        Some(of) => DenoisedSource::need(of, source, compressing),
        None => ResourceEstimate { most_disk_bytes: source.disk_bytes, ..source.and(&[&PerThread(compressing)]) },
    };
    let held = Held(4096 * blocks + 48 * columns + plan.fixed_bytes());
    ResourceEstimate {
        disk_bytes: making.disk_bytes + blocks * (likely + stored),
        // The spill file; then the waiting blocks and the container, each at most half as large as a candidate.
        most_disk_bytes: making.most_disk_bytes + 2 * blocks * candidate,
        ..making.and(&[&held, &PerThread(shape.max_block_bytes())])
    }
}

/// The container's report of how it was made.
fn report_of(options: &PackOptions) -> ContainerReport {
    let settings = &options.compress;
    let target = match settings.target {
        _ if settings.has_fixed_rank() => format!("rank {}", settings.rank),
        Target::PsnrDb(db) if settings.by_eye => {
            format!("{db} dB PSNR of relit images, with steps as the eye resolves them")
        }
        Target::PsnrDb(db) => format!("{db} dB PSNR of relit images"),
        Target::RelativeL2(error) => format!("relative L2 {error} of relit images"),
        Target::Bytes(bytes) => format!("{bytes} bytes"),
        Target::Slope(slope) => format!("slope {slope}"),
        Target::Automatic => format!(
            "the noise of the samples, {AUTOMATIC_MAX_DB} dB PSNR of relit images at most ({AUTOMATIC_DB} dB where it is not \
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
            true => format!("ltm compressor {COMPRESSOR_VERSION}, cleaner {DENOISER_VERSION}"),
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
