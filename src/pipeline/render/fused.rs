//! From a scene to `.ltc` without the matrix in between: each traced block is compressed while the next is traced.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::unfinished::forget_samples;
use super::{RenderReport, job_of, tracer_of, tracing_need};
use crate::block_records::stop_if_interrupted;
use crate::compress::{CompressorPlan, Scope};
use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::light::Job;
use crate::matrix::BlockSource;
use crate::pipeline::{FirstPass, PackOptions, PackReport, PackSource, Packing};
use crate::resources::{JobStage, Progress, ResourceEstimate};
use crate::scene::LoadedScene;
use crate::trace::Tracer;

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
    let mut job = job_of(&loaded)?;
    let has_planes = loaded.has_planes();
    let need = tracing_need(&loaded, &job);
    let begun = FusedRender::begin(&job, (need, has_planes), path, options, watch)?;
    let tracer = tracer_of(loaded, &mut job, Some(folder_of(path)), watch)?;
    begun.run(&tracer, watch).map(|fused| (fused.render, fused.packed))
}

/// A render that packs, admitted and with its files open, before there is a tracer.
pub(super) struct FusedRender {
    begun: Instant,
    packing: Packing,
    plan: CompressorPlan,
    path: PathBuf,
}

/// What it gave.
pub(super) struct Fused {
    pub(super) render: RenderReport,
    pub(super) packed: PackReport,
    /// Seconds that the threads traced, divided by their number.
    pub(super) tracing_seconds: f64,
}

impl FusedRender {
    /// What tracing needs, and whether blocks have planes.
    ///
    /// # Errors
    /// Those of [`render_packed`] before anything is traced.
    pub(super) fn begin(
        job: &Job,
        (need, has_planes): (ResourceEstimate, bool),
        path: &Path,
        options: &PackOptions,
        watch: &dyn Progress,
    ) -> Result<Self> {
        let begun = Instant::now();
        if options.compress.scope == Scope::Global {
            let hint = "render without packing, then pack the stored matrix";
            return Err(Error::input(
                "global scope",
                "the matrix is read several times, here it is never stored",
                hint,
            ));
        }
        let source = PackSource { variant: b"f32", need, has_planes };
        let (packing, plan) = Packing::begin(job, source, path, options, watch)?;
        Ok(Self { begun, packing, plan, path: path.to_owned() })
    }

    /// Traces with `tracer`, which is that of the job and has its column scales, and packs.
    ///
    /// # Errors
    /// Those of [`render_packed`].
    pub(super) fn run(self, tracer: &Tracer, watch: &dyn Progress) -> Result<Fused> {
        let Self { begun, mut packing, plan, path } = self;
        packing.set_column_scales(tracer.column_scales())?;
        let threads = packing.threads();
        let (rays, non_finite, nanoseconds) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        let stage = JobStage { name: "tracing", work_unit: "rays" };
        let packed = packing.run(FirstPass::Analyse(plan.for_blocks()?), stage, watch, |id, block| {
            let from = Instant::now();
            let Some(stats) = tracer.trace_block_unless(id, block, || watch.interrupted()) else {
                stop_if_interrupted(&path, watch)?;
                return Err(Error::interrupted_keeping("the finished blocks are kept"));
            };
            nanoseconds.fetch_add(from.elapsed().as_nanos() as u64, Ordering::Relaxed);
            rays.fetch_add(stats.rays, Ordering::Relaxed);
            non_finite.fetch_add(stats.non_finite, Ordering::Relaxed);
            Ok(stats.rays)
        })?;
        forget_samples(&path);
        let blocks = u64::from(tracer.shape().block_count());
        let render = RenderReport {
            seconds: begun.elapsed().as_secs_f64(),
            rays: rays.into_inner() + tracer.photon_cost().rays,
            blocks_traced: blocks - packed.blocks_kept,
            blocks_kept: packed.blocks_kept,
            blocks_missing: 0,
            non_finite: non_finite.into_inner(),
            peak_memory_bytes: packed.peak_memory_bytes,
        };
        let tracing_seconds = nanoseconds.into_inner() as f64 * 1e-9 / threads as f64;
        Ok(Fused { render, packed, tracing_seconds })
    }
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
