//! Rendering of a scene into `.ltm`: blocks are traced in parallel, and each is committed when it is done.

mod fused;
mod preview;
mod progressive;
mod repair;
mod unfinished;
mod views;

use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use rayon::prelude::*;

pub use self::fused::render_packed;
pub use self::preview::{PreviewReport, preview};
pub use self::progressive::{Estimate, ProgressiveRender, RenderStage, early_path};
pub use self::repair::repair;
#[cfg(test)]
pub(crate) use self::unfinished::samples_path;
pub(crate) use self::unfinished::{note_samples, samples_of_unfinished};
pub use self::views::{SceneView, render_views};
use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::light::{Clusters, Job, Provenance};
use crate::matrix::{BlockId, BlockSink, MatrixShape, TracedBlock};
use crate::resources::{Held, PROGRAM_BYTES, PeakMemory, PerThread, Progress, ResourceEstimate, Threads, budget_bytes};
use crate::scene::{self, LoadOptions, LoadedScene, RenderSettings, Scene};
use crate::store::{self, StoreOptions, StoreWriter, partial_path};
use crate::trace::{BlockStats, Sending, TRACER_VERSION, TraceSettings, Tracer, TracerMemory};

/// Options of a render that do not change the entries.
#[derive(Clone, Debug, Default)]
pub struct RenderOptions {
    /// Options of the store.
    pub store: StoreOptions,
    /// Only these blocks; `None` for all.
    pub blocks: Option<Range<u32>>,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
}

/// Result of a render.
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderReport {
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Rays traced, those of photons included.
    pub rays: u64,
    /// Blocks traced now.
    pub blocks_traced: u64,
    /// Blocks found committed by an earlier, interrupted run.
    pub blocks_kept: u64,
    /// Blocks that the file still lacks, where only some were asked for.
    pub blocks_missing: u64,
    /// Path contributions that were not finite and were dropped.
    pub non_finite: u64,
    /// Peak resident anonymous memory, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// The job that rendering a scene makes.
///
/// # Errors
/// A shape that a matrix cannot have.
pub fn job_of(loaded: &LoadedScene) -> Result<Job> {
    job_of_scene(&loaded.scene, &loaded.settings, loaded.content)
}

/// As [`job_of`], of the parts of a loaded scene.
fn job_of_scene(scene: &Scene, settings: &RenderSettings, content: [u8; 32]) -> Result<Job> {
    let columns = u32::try_from(scene.basis.column_count()).unwrap_or(u32::MAX);
    let shape = MatrixShape::new(scene.camera.width, scene.camera.height, columns, settings.block_side)?;
    let provenance = Provenance {
        source: scene.name.clone(),
        content,
        program: format!("ltm tracer {TRACER_VERSION}"),
        samples_per_pixel: settings.samples_per_pixel,
        seed: settings.seed,
        settings: format!(
            "{} samples per pixel, depth {}, seed {}; {}",
            settings.samples_per_pixel,
            settings.max_depth,
            settings.seed,
            match &scene.sensors {
                Some(sensors) => sensors.in_words(),
                None if scene.shows_irradiance => {
                    format!("{}{}", scene::IRRADIANCE, scene.camera.in_words(scene.origin))
                }
                None => scene.camera.in_words(scene.origin),
            }
        ),
        metres_per_unit: scene.metres_per_unit,
    };
    Ok(Job { shape, basis: scene.basis.clone(), provenance })
}

/// Renders a scene into `path`. Continues where an interrupted run of the same job stopped.
///
/// # Errors
/// Those of the tracer and the store; [`Error::Interrupted`] when the watch says so, with every finished block
/// kept.
pub fn render(loaded: LoadedScene, path: &Path, options: &RenderOptions, watch: &dyn Progress) -> Result<RenderReport> {
    let begun = Instant::now();
    let memory = PeakMemory::start();
    let mut job = job_of(&loaded)?;
    let wanted = options.blocks.clone().unwrap_or(0..job.shape.block_count());
    let stored = StoreOptions { planes: loaded.has_planes(), ..options.store };
    let requirements = store::requirements_of(&job, &stored, wanted.clone())?;
    let mut need = tracing_need(&loaded, &job);
    need = need.and(&[&Held(need.per_thread_bytes), &Held(requirements.memory_bytes)]);
    need.disk_bytes = if options.store.reserve { requirements.disk_bytes } else { 0 };
    // A finished file with missing blocks is completed in place.
    let fill_in = options.blocks.is_some() && path.exists() && !options.store.overwrite;
    let lazy = StoreOptions { reserve: false, ..stored };
    if !fill_in {
        // Before any message on memory and disk.
        store::check_output(path, options.store.overwrite)?;
    }
    let there = if fill_in { path.to_owned() } else { partial_path(path) };
    let threads = need.admit("rendering", path, &[&there], options.memory_bytes, watch)?;
    let tracer = tracer_of(loaded, &mut job, Some(folder_of(path)), watch)?;
    let writer = match fill_in {
        true => StoreWriter::reopen(path, &job, lazy)?,
        false => StoreWriter::create_or_resume(path, &job, lazy)?,
    };
    if options.store.reserve {
        writer.reserve(wanted.clone())?;
    }
    let todo: Vec<BlockId> = wanted.map(BlockId).filter(|&id| !writer.is_committed(id)).collect();
    let blocks_kept = u64::from(writer.committed_count());
    if blocks_kept > 0 {
        watch.note(&format!("{}: continuing, {blocks_kept} blocks are done", path.display()));
    }
    let mut report = trace_into(&writer, &tracer, &todo, threads, watch)?;
    report.rays += tracer.photon_cost().rays;
    report.blocks_missing = writer.finish()?.missing.len() as u64;
    report.blocks_kept = blocks_kept;
    report.seconds = begun.elapsed().as_secs_f64();
    report.peak_memory_bytes = memory.stop();
    Ok(report)
}

/// Number of photons from which on sending them takes seconds.
const MANY_PHOTONS: u64 = 1 << 22;

/// The tracer of a job, whose column scales it sets. Photons beyond the memory limit go to `folder` or the system's
/// temporary folder.
///
/// # Errors
/// Those of [`Tracer::sending`].
pub(crate) fn tracer_of(
    loaded: LoadedScene,
    job: &mut Job,
    folder: Option<&Path>,
    watch: &dyn Progress,
) -> Result<Tracer> {
    let settings = settings_of(&loaded);
    let photons = Tracer::photons_sent(&loaded.scene, job.shape, settings);
    let tracer = while_photons_are_sent(photons, folder, watch, |sending| {
        Tracer::sending(loaded.scene, job.shape, settings, sending)
    })?;
    let tracer = tracer.with_column_scales();
    job.basis.set_column_scales(tracer.column_scales().to_vec())?;
    Ok(tracer)
}

/// Runs what sends so many photons, with its progress where they are many.
fn while_photons_are_sent<T>(
    photons: u64,
    folder: Option<&Path>,
    watch: &dyn Progress,
    work: impl FnOnce(Sending<'_>) -> Result<T>,
) -> Result<T> {
    let says = photons >= MANY_PHOTONS;
    if says {
        watch.begin("sending photons", photons, "photons");
    }
    let goes_on = |sent: u64| {
        if says {
            watch.advance(sent, sent, "photons");
        }
        !watch.interrupted()
    };
    let done = work(Sending { folder, goes_on: &goes_on });
    if says {
        watch.end();
    }
    done
}

/// Traces blocks in parallel. One more thread commits them, so that no core waits for the disk. At most one block more
/// than there are threads is in memory.
pub(crate) fn trace_into(
    writer: &StoreWriter,
    tracer: &Tracer,
    blocks: &[BlockId],
    threads: usize,
    watch: &dyn Progress,
) -> Result<RenderReport> {
    let threads = Threads::new(threads)?;
    let mut report = RenderReport::default();
    let spare = Mutex::new(Vec::new());
    watch.begin("tracing", blocks.len() as u64, "blocks");
    let result = std::thread::scope(|scope| {
        let (to_commit, traced) = std::sync::mpsc::sync_channel::<(BlockId, TracedBlock, BlockStats)>(0);
        let (report, spare) = (&mut report, &spare);
        let committer = scope.spawn(move || -> Result<()> {
            for (id, block, stats) in traced {
                writer.write_block(id, &block)?;
                spare.lock().expect("no panic holds it").push(block);
                report.rays += stats.rays;
                report.non_finite += stats.non_finite;
                report.blocks_traced += 1;
                watch.advance(1, stats.rays, "rays");
            }
            Ok(())
        });
        let stopped = || {
            let kept = writer.path().display();
            Error::interrupted_keeping(format!("{kept} keeps the finished blocks"))
        };
        let trace_one = |&id: &BlockId| {
            if watch.interrupted() {
                return Err(stopped());
            }
            let mut block = spare.lock().expect("no panic holds it").pop().unwrap_or_default();
            let stats = tracer.trace_block(id, &mut block);
            // Fails if the committing thread has stopped with an error, which it returns.
            to_commit.send((id, block, stats)).map_err(|_| stopped())
        };
        let tracing = threads.run(|| blocks.par_iter().try_for_each(trace_one));
        drop(to_commit);
        committer.join().expect("committing does not panic")?;
        tracing
    });
    watch.end();
    result.map(|()| report)
}

/// Reads a scene file and everything that it names, within the memory given or, without such, that the system has.
///
/// # Errors
/// Those of [`scene::load_with`].
pub fn load_scene(path: &Path, options: LoadOptions) -> Result<LoadedScene> {
    let memory_bytes = budget_bytes(options.memory_bytes).saturating_sub(PROGRAM_BYTES);
    scene::load_with(path, LoadOptions { memory_bytes: Some(memory_bytes), ..options })
}

/// The trace settings of a loaded scene.
pub(crate) fn settings_of(loaded: &LoadedScene) -> TraceSettings {
    trace_settings(&loaded.settings)
}

fn trace_settings(settings: &RenderSettings) -> TraceSettings {
    let RenderSettings { samples_per_pixel, seed, max_depth, .. } = *settings;
    TraceSettings { samples_per_pixel, seed, max_depth }
}

/// Resources of tracing, wherever the blocks go: the scene and its photons, and a block for each thread.
pub(crate) fn tracing_need(loaded: &LoadedScene, job: &Job) -> ResourceEstimate {
    scene_need(&loaded.scene, settings_of(loaded), job)
}

fn scene_need(scene: &Scene, settings: TraceSettings, job: &Job) -> ResourceEstimate {
    let clusters = Clusters::of_basis(&job.basis).count();
    let tracer = TracerMemory { scene, shape: job.shape, clusters, settings };
    ResourceEstimate::of(&[&tracer, &PerThread(job.shape.max_block_bytes())])
}
