//! Scene → `.ltc` without the matrix in between: each traced block is compressed while the next is traced.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::analysis::{FirstPass, PackStage};
use super::pack::{PackSource, Packing};
use super::render::{job_of, settings_of, tracer_of, tracing_need};
use super::stop::forget_samples;
use super::{PackOptions, PackReport, RenderReport};
use crate::compress::Scope;
use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::host::Watch;
use crate::scene::LoadedScene;

/// Renders a scene straight into a container at `path`: byte for byte what [`render`](super::render()) in f32 and then
/// [`pack`](super::pack()) give, without the space for the matrix. Continues where an interrupted run stopped.
///
/// # Errors
/// Those of the tracer, the compressor and the container; a global scope, which needs the matrix more than once; [`crate::Error::Interrupted`] when the watch says so,
/// with every analysed block kept.
pub fn render_packed(
    loaded: LoadedScene,
    path: &Path,
    options: &PackOptions,
    watch: &dyn Watch,
) -> Result<(RenderReport, PackReport)> {
    let begun = Instant::now();
    if options.compress.scope == Scope::Global {
        let hint = "render without packing, then pack the stored matrix";
        return Err(Error::input("global scope", "the matrix is read several times, here it is never stored", hint));
    }
    let mut job = job_of(&loaded)?;
    let settings = settings_of(&loaded);
    // One sample a pixel has no halves.
    let has_planes = settings.samples_per_pixel > 1;
    let source = PackSource { variant: b"f32", need: tracing_need(&loaded, &job), has_planes };
    let (mut packing, plan) = Packing::begin(&job, source, path, options, watch)?;
    let tracer = tracer_of(loaded, &mut job, Some(folder_of(path)), watch)?;
    packing.set_column_scales(tracer.column_scales())?;
    let (rays, non_finite) = (AtomicU64::new(0), AtomicU64::new(0));
    let stage = PackStage { name: "tracing", work_unit: "rays" };
    let pack = packing.run(FirstPass::Analyse(plan.for_blocks()?), stage, watch, |id, block| {
        let stats = tracer.trace_block(id, block);
        rays.fetch_add(stats.rays, Ordering::Relaxed);
        non_finite.fetch_add(stats.non_finite, Ordering::Relaxed);
        Ok(stats.rays)
    })?;
    forget_samples(path);
    let render = RenderReport {
        seconds: begun.elapsed().as_secs_f64(),
        rays: rays.into_inner() + tracer.photon_cost().rays,
        blocks_traced: u64::from(job.shape.block_count()) - pack.blocks_kept,
        blocks_kept: pack.blocks_kept,
        blocks_missing: 0,
        non_finite: non_finite.into_inner(),
        peak_memory_bytes: pack.peak_memory_bytes,
    };
    Ok((render, pack))
}
