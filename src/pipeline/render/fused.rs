//! From a scene to `.ltc` without the matrix in between: each traced block is compressed while the next is traced.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::unfinished::forget_samples;
use super::{RenderReport, job_of, tracer_of, tracing_need};
use crate::compress::Scope;
use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::pipeline::{FirstPass, PackOptions, PackReport, PackSource, Packing};
use crate::resources::JobStage;
use crate::resources::Progress;
use crate::scene::LoadedScene;

/// Renders a scene straight into a container at `path`, without space for the matrix. The bytes are those of
/// [`render`](super::render()) in f32 followed by [`pack`](crate::pipeline::pack()). Continues where an interrupted run stopped.
///
/// # Errors
/// Those of the tracer, the compressor and the container; a global scope, which needs the matrix more than once; [`crate::Error::Interrupted`] when the watch says so,
/// with every analysed block kept.
pub fn render_packed(
    loaded: LoadedScene,
    path: &Path,
    options: &PackOptions,
    watch: &dyn Progress,
) -> Result<(RenderReport, PackReport)> {
    let begun = Instant::now();
    if options.compress.scope == Scope::Global {
        let hint = "render without packing, then pack the stored matrix";
        return Err(Error::input("global scope", "the matrix is read several times, here it is never stored", hint));
    }
    let mut job = job_of(&loaded)?;
    let has_planes = loaded.has_planes();
    let source = PackSource { variant: b"f32", need: tracing_need(&loaded, &job), has_planes };
    let (mut packing, plan) = Packing::begin(&job, source, path, options, watch)?;
    let tracer = tracer_of(loaded, &mut job, Some(folder_of(path)), watch)?;
    packing.set_column_scales(tracer.column_scales())?;
    let (rays, non_finite) = (AtomicU64::new(0), AtomicU64::new(0));
    let stage = JobStage { name: "tracing", work_unit: "rays" };
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

#[cfg(test)]
mod tests {
    use crate::matrix::TracedBlock;
    use crate::pipeline::{job_of, settings_of};
    use crate::resources::NoProgress;
    use crate::scene::BuiltIn;
    use crate::trace::Tracer;

    #[test]
    fn the_rays_of_photons_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let room = || {
            let mut room = BuiltIn { width: 32, height: 24, texels: 2 }.named("caustics").unwrap();
            room.settings.samples_per_pixel = 4;
            room
        };
        let (loaded, job) = (room(), job_of(&room()).unwrap());
        let settings = settings_of(&loaded);
        let tracer = Tracer::new(loaded.scene, job.shape, settings).unwrap();
        let cost = tracer.photon_cost();
        assert_eq!(cost.sent, Tracer::photons_sent(tracer.scene(), job.shape, settings));
        // Each stored photon has come by a mirror or glass.
        assert!(cost.rays >= 2 * tracer.photon_count() as u64 && tracer.photon_count() > 0);
        let trace = |id| tracer.trace_block(id, &mut TracedBlock::default()).rays;
        let rays = cost.rays + job.shape.blocks().map(trace).sum::<u64>();
        let report =
            crate::pipeline::render(room(), &folder.path().join("a.ltm"), &Default::default(), &NoProgress).unwrap();
        assert_eq!(report.rays, rays);
        let packed = folder.path().join("a.ltc");
        let (report, _) = crate::pipeline::render_packed(room(), &packed, &Default::default(), &NoProgress).unwrap();
        assert_eq!(report.rays, rays);
        assert_eq!(tracer.without_photons().photon_cost(), Default::default());
    }
}
