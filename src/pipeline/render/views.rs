//! Several views of one scene, rendered in turn: the tree is built once, and photons are sent once for views of one size.

use std::collections::VecDeque;
use std::path::PathBuf;

use super::fused::FusedRender;
use super::{RenderReport, job_of_scene, scene_need, trace_settings, tracer_of, while_photons_are_sent};
use crate::container::ContainerReader;
use crate::error::Result;
use crate::files::folder_of;
use crate::light::Job;
use crate::pipeline::{PackOptions, PackReport};
use crate::resources::Progress;
use crate::scene::{Camera, LoadedScene, content_hash};
use crate::trace::Tracer;

/// A view of a scene and the container that it is rendered into.
#[derive(Clone, Debug)]
pub struct SceneView {
    /// The camera.
    pub camera: Camera,
    /// The container.
    pub path: PathBuf,
}

/// Renders views of a scene into a container each, one after the other; `done` hears of each. Every container has the bytes that
/// [`render_packed`](super::render_packed) gives of the scene with this camera. A view whose container is finished is passed over, and an
/// interrupted one is continued, so that the same call goes on.
///
/// # Errors
/// Those of [`render_packed`](super::render_packed).
pub fn render_views(
    mut loaded: LoadedScene,
    views: &[SceneView],
    options: &PackOptions,
    watch: &dyn Progress,
    mut done: impl FnMut(&SceneView, RenderReport, PackReport) -> Result<()>,
) -> Result<()> {
    let (settings, own) = (loaded.settings, (loaded.scene.camera, loaded.content));
    let traced = trace_settings(&settings);
    let has_planes = loaded.has_planes();
    let mut todo: VecDeque<(&SceneView, Job)> = VecDeque::new();
    for view in views {
        loaded.scene.camera = view.camera;
        let content = if view.camera == own.0 { own.1 } else { content_hash(&loaded.scene, settings.max_depth) };
        let job = job_of_scene(&loaded.scene, &settings, content)?;
        let is_there = ContainerReader::open(&view.path).is_ok_and(|found| found.job().hash() == job.hash());
        match is_there && !options.container.overwrite {
            true => watch.note(&format!("{}: is finished", view.path.display())),
            false => todo.push_back((view, job)),
        }
    }
    let Some((view, mut job)) = todo.pop_front() else { return Ok(()) };
    (loaded.scene.camera, loaded.content) = (view.camera, job.provenance.content);
    let need = scene_need(&loaded.scene, traced, &job);
    let begun = FusedRender::begin(&job, (need, has_planes), &view.path, options, watch)?;
    let mut tracer = tracer_of(loaded, &mut job, Some(folder_of(&view.path)), watch)?;
    let fused = begun.run(&tracer, watch)?;
    done(view, fused.render, fused.packed)?;
    for (view, job) in todo {
        let need = scene_need(tracer.scene(), traced, &job);
        let begun = FusedRender::begin(&job, (need, has_planes), &view.path, options, watch)?;
        let photons = Tracer::photons_sent(tracer.scene(), job.shape, traced);
        while_photons_are_sent(photons, Some(folder_of(&view.path)), watch, |sending| {
            tracer.set_view(view.camera, job.shape, traced, sending)
        })?;
        tracer.measure_scales();
        let fused = begun.run(&tracer, watch)?;
        done(view, fused.render, fused.packed)?;
    }
    Ok(())
}
