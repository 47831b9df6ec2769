//! Scene → `.ltm`: blocks traced in parallel, each committed when it is done.

use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::host::{Need, PROGRAM_BYTES, PeakMemory, Threads, Watch, budget_bytes};
use crate::light::{Clusters, Job, Provenance};
use crate::matrix::{BlockId, BlockSink, MatrixShape, TracedBlock};
use crate::scene::{self, LoadOptions, LoadedScene, Triangle};
use crate::store::{self, StoreOptions, StoreWriter, partial_path};
use crate::trace::{BlockStats, Sending, TRACER_VERSION, TraceSettings, Tracer};

/// Choices of a render that do not change the entries.
#[derive(Clone, Debug, Default)]
pub struct RenderOptions {
    /// How the store keeps the entries.
    pub store: StoreOptions,
    /// Only these blocks; all if none.
    pub blocks: Option<Range<u32>>,
    /// Anonymous memory to stay within; none: what the system has.
    pub memory_bytes: Option<u64>,
}

/// What a render did.
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
    let (scene, settings) = (&loaded.scene, &loaded.settings);
    let columns = u32::try_from(scene.basis.column_count()).unwrap_or(u32::MAX);
    let shape = MatrixShape::new(scene.camera.width, scene.camera.height, columns, settings.block_side)?;
    let provenance = Provenance {
        source: scene.name.clone(),
        content: loaded.content,
        program: format!("ltm tracer {TRACER_VERSION}"),
        samples_per_pixel: settings.samples_per_pixel,
        seed: settings.seed,
        settings: format!(
            "{} samples per pixel, depth {}, seed {}; {}",
            settings.samples_per_pixel,
            settings.max_depth,
            settings.seed,
            scene.camera.in_words(scene.origin)
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
pub fn render(loaded: LoadedScene, path: &Path, options: &RenderOptions, watch: &dyn Watch) -> Result<RenderReport> {
    let begun = Instant::now();
    let memory = PeakMemory::start();
    let mut job = job_of(&loaded)?;
    let wanted = options.blocks.clone().unwrap_or(0..job.shape.block_count());
    // One sample a pixel has no halves.
    let stored = StoreOptions { planes: loaded.settings.samples_per_pixel > 1, ..options.store };
    let requirements = store::requirements_of(&job, &stored, wanted.clone())?;
    let mut need = tracing_need(&loaded, &job);
    need.fixed_bytes += need.per_thread_bytes + requirements.memory_bytes;
    need.disk_bytes = if options.store.reserve { requirements.disk_bytes } else { 0 };
    // A finished file that lacks blocks is filled in where it stands, part by part.
    let fill_in = options.blocks.is_some() && path.exists() && !options.store.overwrite;
    let lazy = StoreOptions { reserve: false, ..stored };
    if !fill_in {
        // Before anything is said of memory and disk.
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

/// Photons from which on sending them takes seconds.
const MANY_PHOTONS: u64 = 1 << 22;

/// The tracer of a job, which learns the scales of its columns by it; with photons for which there is no memory in a folder, or the system's for temporary files.
///
/// # Errors
/// Those of [`Tracer::sending`].
pub(super) fn tracer_of(
    loaded: LoadedScene,
    job: &mut Job,
    folder: Option<&Path>,
    watch: &dyn Watch,
) -> Result<Tracer> {
    let settings = settings_of(&loaded);
    let photons = Tracer::photons_sent(&loaded.scene, job.shape, settings);
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
    let tracer = Tracer::sending(loaded.scene, job.shape, settings, Sending { folder, goes_on: &goes_on });
    if says {
        watch.end();
    }
    let tracer = tracer?.with_column_scales();
    job.basis.set_column_scales(tracer.column_scales().to_vec())?;
    Ok(tracer)
}

/// Traces blocks in parallel; one thread more commits them, so that no core waits for the disk. At most one block more
/// than there are threads is in memory.
pub(super) fn trace_into(
    writer: &StoreWriter,
    tracer: &Tracer,
    blocks: &[BlockId],
    threads: usize,
    watch: &dyn Watch,
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
            // Fails where the committer has stopped for an error, which it returns.
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

/// How a loaded scene asks to be traced.
pub(super) fn settings_of(loaded: &LoadedScene) -> TraceSettings {
    TraceSettings {
        samples_per_pixel: loaded.settings.samples_per_pixel,
        seed: loaded.settings.seed,
        max_depth: loaded.settings.max_depth,
    }
}

/// What tracing takes, wherever the blocks go: the scene and its photons, and for each thread a block.
pub(super) fn tracing_need(loaded: &LoadedScene, job: &Job) -> Need {
    let photons = Tracer::photons_need_bytes(&loaded.scene, job.shape, settings_of(loaded));
    Need { fixed_bytes: scene_bytes(loaded) + photons, per_thread_bytes: block_need(job), ..Need::default() }
}

/// Memory of a scene while it is traced: its arrays, its textures, and the tree, whose nodes and building take about
/// 450 bytes for each triangle.
fn scene_bytes(loaded: &LoadedScene) -> u64 {
    let mesh = &loaded.scene.mesh;
    let texels: usize = loaded.scene.textures.iter().map(|texture| texture.texels.len()).sum();
    let vertices = size_of_val(&*mesh.vertices);
    (vertices + texels * 16 + mesh.triangles.len() * (450 + size_of::<Triangle>())) as u64 + PROGRAM_BYTES
}

/// Memory of a thread that traces a block: the block, and what tracing it takes beside it.
fn block_need(job: &Job) -> u64 {
    let block = job.shape.max_block_rows() as u64 * job.shape.columns() as u64 * 4;
    block + Tracer::block_needs_bytes(job.shape, Clusters::of_basis(&job.basis).count())
}
