//! One job on many machines. Ranges of blocks are built anywhere, in any order, any number of times. They are merged
//! into the container that one machine makes of the job by [`render_packed`](crate::pipeline::render_packed).
//!
//! A range becomes a shard ([`crate::block_records`]) in a [`BlobStore`](crate::blob_store::BlobStore): complete or absent, never changed, and the same whoever
//! builds it. The merge does what needs all blocks: it denoises the whole image, chooses the common slope, and cuts the
//! candidates.

use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use super::publish::{BuildReport, go_on};
use super::round::Round;
use super::terms::Terms;
use super::worker::Worker;
use crate::blob_store::BlobStore;
use crate::block_records::{Shard, ShardHead, ShardSet, hex, plan_prefix};
use crate::compress::{CompressorPlan, Scope};
use crate::denoise::DenoisedJob;
use crate::error::{Error, Result};
use crate::files::with_suffix;
use crate::light::Job;
use crate::matrix::{BlockId, TracedBlock};
use crate::pipeline::{
    PackOptions, PackReport, PackSource, Packing, check_container_output, job_of, need_of, plan_of, settings_of,
    tracer_of, tracing_need,
};
use crate::resources::{Held, Progress, ResourceEstimate, Threads, hold_to_memory};
use crate::scene::LoadedScene;
use crate::trace::Tracer;

/// Blocks that a probe builds at most.
const PROBED_BLOCKS: u64 = 24;
/// Wall-clock seconds after which a probe begins no other block.
const PROBE_SECONDS: f64 = 20.0;

/// A scene and its pack options, on which every machine of a farm must agree.
pub struct FarmJob {
    pub(super) loaded: LoadedScene,
    pub(super) terms: Terms,
}

/// Result of a probe.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The blocks that were built, in order.
    pub blocks: Vec<TimedBlock>,
    /// Seconds until the tracer was built, from the loaded scene.
    pub setup_seconds: f64,
    /// Anonymous memory that building takes at most with one thread.
    pub memory_bytes: u64,
    /// Memory of each further thread, in bytes.
    pub thread_memory_bytes: u64,
    /// Anonymous memory that the merge takes at most with one thread.
    pub merge_memory_bytes: u64,
}

/// A block of a [`Probe`].
#[derive(Clone, Copy, Debug)]
pub struct TimedBlock {
    /// Index of the block.
    pub block: BlockId,
    /// Seconds of one thread.
    pub seconds: f64,
    /// Bytes of its record in a shard.
    pub bytes: u64,
}

/// A shard that cannot be merged, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefusedShard {
    /// Name of the shard in the depot.
    pub name: String,
    /// Why it cannot be merged.
    pub problem: String,
}

/// The shards of a job in a depot.
pub struct Shards {
    set: ShardSet,
    /// Shards of the job.
    pub count: usize,
    /// Shards that are not of the job, or damaged.
    pub refused: Vec<RefusedShard>,
    /// Blocks that no shard holds, as ranges in order.
    pub missing: Vec<Range<u32>>,
    /// Path contributions that were not finite and were dropped, over all shards.
    pub non_finite: u64,
}

impl FarmJob {
    /// The job of a scene with these pack options.
    ///
    /// # Errors
    /// A global scope and images denoised elsewhere, which need the matrix as a whole; those of [`job_of`].
    pub fn new(loaded: LoadedScene, options: &PackOptions) -> Result<Self> {
        if options.compress.scope == Scope::Global {
            let hint = "render and pack it on one machine";
            return Err(Error::input("global scope", "the matrix is read several times, here no machine has it", hint));
        }
        if let Some(basis) = &options.basis {
            let hint = "leave denoising to the merge, or render and pack it on one machine";
            return Err(Error::input(basis.display().to_string(), "its images exist only after all blocks", hint));
        }
        let job = job_of(&loaded)?;
        // One sample per pixel has no halves.
        let has_planes = settings_of(&loaded).samples_per_pixel > 1;
        let options = options.for_source(has_planes);
        let fingerprint = options.fingerprint(&job, b"f32", None);
        Ok(Self { loaded, terms: Terms { job, options, fingerprint } })
    }

    /// The description of the matrix.
    pub fn job(&self) -> &Job {
        &self.terms.job
    }

    /// Whether the merge denoises the image.
    pub fn denoises(&self) -> bool {
        self.terms.options.denoise
    }

    /// Hash of the job, its settings and the versions of everything that takes part: 64 hexadecimal digits.
    pub fn fingerprint(&self) -> String {
        hex(&self.terms.fingerprint)
    }

    /// Builds some blocks, spread evenly, to learn what they cost. They are not kept.
    ///
    /// # Errors
    /// Those of the tracer; [`Error::Interrupted`].
    pub fn probe(self, watch: &dyn Progress) -> Result<Probe> {
        let begun = Instant::now();
        let job = &self.terms.job;
        let plan = self.plan()?;
        let denoised = self.denoises().then_some(DenoisedJob { job, budget_bytes: u64::MAX });
        let merging = need_of(&plan, job.shape, ResourceEstimate::of(&[]), denoised);
        let merging = merging.bytes(1).max(self.measuring_need().bytes(1));
        let (worker, need) = self.worker(plan, None)?;
        let threads = Threads::new(need.threads_within("probing", self.terms.options.memory_bytes)?)?;
        let tracer = tracer_of(self.loaded, &mut self.terms.job.clone(), None, watch)?;
        let setup_seconds = begun.elapsed().as_secs_f64();
        let count = u64::from(job.shape.block_count());
        let probed = PROBED_BLOCKS.min(count);
        // The middles of equal parts.
        let blocks: Vec<BlockId> = (0..probed).map(|i| BlockId(((2 * i + 1) * count / (2 * probed)) as u32)).collect();
        watch.begin("probing", probed, "blocks");
        let (begun, found) = (Instant::now(), Mutex::new(Vec::new()));
        let build = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
            let begins = Instant::now();
            let late = begun.elapsed().as_secs_f64() > PROBE_SECONDS;
            if late && !found.lock().unwrap_or_else(|e| e.into_inner()).is_empty() {
                return Ok(());
            }
            worker.build(id, block, watch, &|id, block| {
                let rays = tracer.trace_block(id, block).rays;
                block.divide_columns(tracer.column_scales());
                Ok(rays)
            })?;
            let (seconds, bytes) = (begins.elapsed().as_secs_f64(), worker.bytes_of(id, count as u32)?);
            found.lock().unwrap_or_else(|e| e.into_inner()).push(TimedBlock { block: id, seconds, bytes });
            watch.advance(1, 0, "rays");
            Ok(())
        };
        let done = threads.run(|| blocks.par_iter().with_max_len(1).try_for_each_init(TracedBlock::default, build));
        watch.end();
        done?;
        let mut blocks = found.into_inner().unwrap_or_else(|e| e.into_inner());
        blocks.sort_by_key(|probed| probed.block);
        Ok(Probe {
            blocks,
            setup_seconds,
            memory_bytes: need.bytes(1),
            thread_memory_bytes: need.per_thread_bytes,
            merge_memory_bytes: merging,
        })
    }

    /// Builds a range of blocks into a shard in the depot. Until it is complete, it is in an unlinked temporary file in
    /// `scratch` or the system's temporary folder.
    ///
    /// # Errors
    /// A range that the matrix has not; those of the tracer, the compressor and the depot; [`Error::Interrupted`], with nothing kept.
    pub fn build(
        self,
        blocks: Range<u32>,
        depot: &BlobStore,
        scratch: Option<&Path>,
        watch: &dyn Progress,
    ) -> Result<BuildReport> {
        let begun = Instant::now();
        let count = self.terms.job.shape.block_count();
        if blocks.is_empty() || blocks.end > count {
            let problem = format!("{}..{} is not a range of its blocks, 0..{count}", blocks.start, blocks.end);
            return Err(Error::input("the matrix", problem, "take the ranges of the plan"));
        }
        let (worker, need) = self.worker(self.plan()?, scratch)?;
        let need = need.and(&[&Held(depot.held_bytes())]);
        let output = Path::new(depot.address()).join(format!("{}..{}", blocks.start, blocks.end));
        let threads =
            need.threads_within(&format!("building {}", output.display()), self.terms.options.memory_bytes)?;
        let threads = Threads::new(threads)?;
        let tracer = tracer_of(self.loaded, &mut self.terms.job.clone(), scratch, watch)?;
        let (rays, non_finite) = (AtomicU64::new(0), AtomicU64::new(0));
        watch.begin("tracing and analysing", blocks.len() as u64, "blocks");
        let trace = |id: BlockId, block: &mut TracedBlock| {
            let stats = tracer.trace_block(id, block);
            block.divide_columns(tracer.column_scales());
            rays.fetch_add(stats.rays, Ordering::Relaxed);
            non_finite.fetch_add(stats.non_finite, Ordering::Relaxed);
            Ok(stats.rays)
        };
        let build = |block: &mut TracedBlock, key: u32| -> Result<()> {
            let work = worker.build(BlockId(key), block, watch, &trace)?;
            watch.advance(1, work, "rays");
            Ok(())
        };
        let done = threads.run(|| blocks.clone().into_par_iter().try_for_each_init(TracedBlock::default, build));
        watch.end();
        done?;
        let (rays, non_finite) = (rays.into_inner() + tracer.photon_cost().rays, non_finite.into_inner());
        let (job, fingerprint) = (self.terms.job.hash().0, self.terms.fingerprint);
        let head = ShardHead { job, fingerprint, blocks, parts: worker.parts(), rays, non_finite };
        let name = worker.publish(&head, count, depot)?;
        Ok(BuildReport { name, seconds: begun.elapsed().as_secs_f64(), rays, non_finite })
    }

    /// Reads every shard of the depot completely, and separates those of this job from those that cannot be merged.
    /// Shards that are not local files are copied into the folder `cache`, unless a copy is there already.
    ///
    /// # Errors
    /// The depot cannot be read; [`Error::Interrupted`].
    pub fn shards(&self, depot: &BlobStore, cache: &Path, watch: &dyn Progress) -> Result<Shards> {
        let Terms { job, fingerprint, .. } = &self.terms;
        let names = depot.names("")?;
        let extension = Round::Trace.extension();
        let names: Vec<String> =
            names.into_iter().filter(|name| name.ends_with(extension) && !name.starts_with('.')).collect();
        hold_to_memory("fetching shards", depot.held_bytes(), self.terms.options.memory_bytes)?;
        watch.begin("checking shards", names.len() as u64, "shards");
        let check = |name: &String| -> Result<Result<Shard, String>> {
            go_on(watch, "nothing was written")?;
            let open = || Shard::open(&depot.local(name, cache)?, name);
            let checked = if !name.starts_with(&plan_prefix(&hex(fingerprint))) {
                // Only the head is read, for the message.
                let head = ShardHead::of(&*depot.open_file(name)?, &Path::new(depot.address()).join(name))?;
                let renamed = "its content is not that of its name: it was renamed";
                head.and_then(|head| self.terms.accept(&head)).and(Err(renamed.to_owned()))
            } else {
                let checked = match open()? {
                    // The copy may be damaged although the shard is not.
                    Err(_) if depot.remove_copies(cache, Some(name))? => open()?,
                    checked => checked,
                };
                checked.and_then(|shard| self.terms.accept(&shard.head).map(|()| shard))
            };
            watch.advance(1, 0, "B");
            Ok(checked)
        };
        let checked: Result<Vec<_>> = names.par_iter().map(check).collect();
        watch.end();
        let mut found = Shards {
            set: ShardSet::new(depot.address(), job.shape.block_count()),
            count: 0,
            refused: Vec::new(),
            missing: Vec::new(),
            non_finite: 0,
        };
        for (name, checked) in names.into_iter().zip(checked?) {
            match checked {
                Err(problem) => found.refused.push(RefusedShard { name, problem }),
                Ok(shard) => {
                    found.count += 1;
                    found.non_finite += shard.head.non_finite;
                    if let Some((key, other)) = found.set.add(shard) {
                        let other = other.file_name().unwrap_or_default().to_string_lossy().into_owned();
                        watch.note(&format!("{name}: block {key} is not that of {other}, which is taken"));
                    }
                }
            }
        }
        found.missing = found.set.missing();
        Ok(found)
    }

    /// Makes the container of shards that hold all blocks: byte for byte that of [`render_packed`](crate::pipeline::render_packed). An
    /// interrupted merge is continued by the same call.
    ///
    /// # Errors
    /// [`Error::Incomplete`] where blocks are missing; those of denoising, packing and the container; [`Error::Interrupted`].
    pub fn merge(self, shards: Shards, path: &Path, watch: &dyn Progress) -> Result<PackReport> {
        let measuring = self.measuring_need();
        let Terms { mut job, options, .. } = self.terms;
        if !shards.missing.is_empty() {
            let blocks: usize = shards.missing.iter().map(|range| range.len()).sum();
            return Err(Error::Incomplete {
                place: shards.set.address().to_owned(),
                missing: format!("{blocks} of {} blocks are in no shard", job.shape.block_count()),
                hint: "build the missing ranges, then merge again".into(),
            });
        }
        check_container_output(path, options.container.overwrite)?;
        measuring.threads_within("merging", options.memory_bytes)?;
        let max_depth = self.loaded.settings.max_depth;
        job.basis.set_column_scales(Tracer::measure_column_scales(self.loaded.scene, max_depth)?)?;
        let source = PackSource { variant: b"f32", need: ResourceEstimate::of(&[]), has_planes: options.denoise };
        let (packing, plan) = Packing::begin(&job, source, path, &options, watch)?;
        packing.run_shards(plan.for_blocks()?, shards.set, watch)
    }

    /// What the merge takes while it measures the scales of columns, before it packs.
    pub(super) fn measuring_need(&self) -> ResourceEstimate {
        let tracing = tracing_need(&self.loaded, &self.terms.job);
        ResourceEstimate { fixed_bytes: tracing.fixed_bytes, ..ResourceEstimate::default() }
    }

    /// Folder for copies of shards during the merge of a container.
    pub fn cache_path(container: &Path) -> std::path::PathBuf {
        with_suffix(container, ".shards")
    }

    fn plan(&self) -> Result<CompressorPlan> {
        plan_of(&self.terms.job, &self.terms.options)
    }

    /// What builds, and what that takes.
    fn worker(&self, plan: CompressorPlan, scratch: Option<&Path>) -> Result<(Worker, ResourceEstimate)> {
        let need = Worker::need(&self.terms, &plan, tracing_need(&self.loaded, &self.terms.job));
        Ok((Worker::new(&self.terms, plan, scratch)?, need))
    }
}
