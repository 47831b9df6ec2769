//! A render that gives all lights from the first seconds: coarse estimates, each a container of its own, then the finished one.
//!
//! The image is rendered first with few pixels and few samples. Then the resolution doubles up to the full one, then the samples double,
//! as long as all of this takes a small part of the time that the finished render will take ([`EARLY_PART`]). Each estimate is denoised and
//! packed like the finished container, with the same lights and columns, so that it can be relit by the same lighting. The tree over the
//! triangles is built once. The last estimate is [`render_packed`](super::render_packed), to the byte.

mod cost;
mod stage;
mod stages;

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use sha2::{Digest, Sha256};

use self::cost::CostModel;
pub use self::stage::RenderStage;
use self::stages::Stages;
use super::fused::{Fused, FusedRender};
use super::{RenderReport, job_of_scene, scene_need, trace_settings, while_photons_are_sent};
use crate::block_records::files_of_pack;
use crate::compress::{CompressSettings, Target};
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::files::{check_output, folder_of, open_locked, with_suffix};
use crate::light::{DenoiseErrors, Job, StatedErrors};
use crate::matrix::MatrixShape;
use crate::pipeline::{PackOptions, PackReport, need_of, plan_of};
use crate::resources::{Progress, SilentProgress};
use crate::scene::{Camera, LoadedScene, Projection, RenderSettings, content_hash};
use crate::trace::Tracer;

/// The part of the finished render's time that all earlier estimates together may take.
const EARLY_PART: f64 = 0.15;

/// One container of a progressive render.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The container. That of an early estimate is replaced by the next: whoever has it open keeps what was opened.
    pub path: PathBuf,
    /// Resolution and samples.
    pub stage: RenderStage,
    /// Whether this is the finished container.
    pub is_final: bool,
    /// Stated error: estimated relative L2 of images of single lights or groups of lights against the image of this resolution that
    /// infinitely many samples would give. Noise and bias of the denoiser and the loss by compression, as independent errors. `None`
    /// where it is not known.
    pub error: Option<f64>,
    /// Wall-clock seconds since the view was begun.
    pub seconds: f64,
    /// Wall-clock seconds since the view was begun by which the finished container is expected; `None` where nothing was rendered yet, as
    /// the estimate is of an earlier run.
    pub expected_seconds: Option<f64>,
    /// How it was rendered; `None` where it was found finished.
    pub reports: Option<(RenderReport, Box<PackReport>)>,
}

/// A scene that is rendered progressively, view after view.
///
/// ```
/// use ltm::pipeline::{PackOptions, ProgressiveRender};
/// use ltm::resources::NoProgress;
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("room.ltc");
///
/// // Or `ltm::load_scene("room.toml")?`.
/// let mut scene = ltm::scene::BuiltIn { width: 192, height: 144, texels: 2 }.named("diffuse")?;
/// scene.settings.samples_per_pixel = 16;
/// let options = PackOptions { denoise: true, ..Default::default() };
/// let mut render = ProgressiveRender::begin(scene, &path, options, &NoProgress)?;
/// while let Some(estimate) = render.next_estimate(&NoProgress)? {
///     let matrix = ltm::open(&estimate.path)?;
///     let evening = ltm::Lighting::of_scene(matrix.basis());
///     println!("{}: {} pixels wide", estimate.stage, matrix.relight(&evening)?.width);
/// }
/// assert!(path.exists());
/// # Ok::<(), ltm::Error>(())
/// ```
#[derive(Debug)]
pub struct ProgressiveRender {
    tracer: Tracer,
    settings: RenderSettings,
    /// Camera of the loaded scene, and the hash of the scene with it.
    loaded: (Camera, [u8; 32]),
    camera: Camera,
    path: PathBuf,
    /// Where the containers of earlier views stand.
    earlier: BTreeSet<PathBuf>,
    /// Keeps other processes from rendering to the path; `None` where nothing is to be rendered.
    lock: Option<OutputLock>,
    options: PackOptions,
    stages: Stages,
    costs: CostModel,
    begun: Instant,
    /// Seconds of this view that finished stages took.
    spent: f64,
    /// Whether the finished container was there before, and was not given yet.
    is_found: bool,
    /// Whether the finished container was given.
    is_done: bool,
}

/// Path of the early estimates of a container: `room.early.ltc` for `room.ltc`.
#[must_use]
pub fn early_path(path: &Path) -> PathBuf {
    path.with_extension("early.ltc")
}

impl ProgressiveRender {
    /// Checks the output, states the memory and the disk that the finished render takes, and builds the tree. Continues what an
    /// interrupted run of the same scene has left; a container that is finished is the only estimate.
    ///
    /// # Errors
    /// A container at `path` that is of another scene or of other settings and may not be overwritten; a global scope; those of the
    /// tracer; memory or disk that do not suffice; another process that renders to `path`; [`Error::Interrupted`].
    pub fn begin(loaded: LoadedScene, path: &Path, options: PackOptions, watch: &dyn Progress) -> Result<Self> {
        let begun = Instant::now();
        let LoadedScene { scene, settings, content, .. } = loaded;
        if scene.sensors.is_some() {
            let problem = "shows sensors, which have no picture to begin with";
            return Err(Error::input(scene.name, problem, "render it without a window, or choose a camera"));
        }
        let camera = scene.camera;
        let job = job_of_scene(&scene, &settings, content)?;
        let is_found = is_finished(&job, path, &options)?;
        let lock = if is_found { None } else { Some(OutputLock::of(path)?) };
        if !is_found {
            let need = scene_need(&scene, trace_settings(&settings), &job);
            let of_source = options.for_source(scene.has_planes(settings.samples_per_pixel));
            let need = need_of(&plan_of(&job, &of_source)?, job.shape, need, of_source.denoised(&job));
            let there = files_of_pack(path);
            need.admit("rendering", path, &there.each_ref().map(PathBuf::as_path), options.memory_bytes, watch)?;
        }
        if watch.interrupted() {
            return Err(Error::interrupted("nothing was begun"));
        }
        let stages = Stages::new((camera.width, camera.height), settings.samples_per_pixel);
        let (mut first, mut first_settings) = (camera, trace_settings(&settings));
        if let Some(stage) = stages.first() {
            first = reduced(camera, stage);
            first_settings.samples_per_pixel = stage.samples_per_pixel;
        }
        let mut scene = scene;
        scene.camera = first;
        let shape = job_of_scene(&scene, &settings, content)?.shape;
        let photons = Tracer::photons_sent(&scene, shape, first_settings);
        let tracer = while_photons_are_sent(photons, Some(folder_of(path)), watch, |sending| {
            Tracer::sending(scene, shape, first_settings, sending)
        })?;
        let mut render = Self {
            tracer,
            settings,
            loaded: (camera, content),
            camera,
            path: path.to_owned(),
            earlier: BTreeSet::new(),
            lock,
            options,
            stages,
            costs: CostModel::default(),
            begun,
            spent: 0.0,
            is_found,
            is_done: false,
        };
        render.find_early();
        Ok(render)
    }

    /// Goes on to another view of the scene, whose container will stand at `path`; the tree stays. What was rendered of the view before
    /// stays where it is. `overwrite`: whether a container at `path`, or what an interrupted run has left there, is replaced.
    ///
    /// # Errors
    /// A container at `path` that is of another view and may not be overwritten; another process renders to `path`.
    pub fn set_view(&mut self, camera: Camera, path: &Path, overwrite: bool) -> Result<()> {
        let is_found = !overwrite && path.exists() && {
            let mut scene = self.tracer.scene().clone();
            scene.camera = camera;
            let content =
                if camera == self.loaded.0 { self.loaded.1 } else { content_hash(&scene, self.settings.max_depth) };
            let mut options = self.options.clone();
            options.container.overwrite = overwrite;
            is_finished(&job_of_scene(&scene, &self.settings, content)?, path, &options)?
        };
        if is_found {
            self.lock = None;
        } else if self.lock.as_ref().is_none_or(|lock| lock.path != OutputLock::path_of(path)) {
            // The one before goes first: the same process may come back to its path.
            self.lock = None;
            self.lock = Some(OutputLock::of(path)?);
        }
        (self.is_found, self.options.container.overwrite) = (is_found, overwrite);
        self.earlier.insert(std::mem::replace(&mut self.path, path.to_owned()));
        self.camera = camera;
        self.stages = Stages::new((camera.width, camera.height), self.settings.samples_per_pixel);
        (self.begun, self.spent, self.is_done) = (Instant::now(), 0.0, false);
        self.find_early();
        Ok(())
    }

    /// The camera of the view.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The tracer, for what else is to be seen of the scene: [`Tracer::outline`].
    pub fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// Where the container of the view will stand.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The stage that [`next_estimate`](Self::next_estimate) will render, and whether it is the last; `None` after it.
    pub fn next_stage(&self) -> Option<(RenderStage, bool)> {
        (!self.is_done).then(|| self.choose())
    }

    /// Renders the next estimate. `None` once the finished container was given. After an error the same stage is begun again, and goes on
    /// with the blocks that are kept.
    ///
    /// # Errors
    /// Those of [`render_packed`](super::render_packed); [`Error::Interrupted`] when the watch says so, within a few pixels.
    pub fn next_estimate(&mut self, watch: &dyn Progress) -> Result<Option<Estimate>> {
        if self.is_done {
            return Ok(None);
        }
        if self.is_found {
            let found = self.estimate(self.path.clone(), self.stages.last(), None)?;
            self.is_done = true;
            return Ok(Some(found));
        }
        if let Some(found) = self.stages.take_found() {
            return self.estimate(early_path(&self.path), found, None).map(Some);
        }
        let begun = Instant::now();
        let (stage, is_final) = self.choose();
        let estimate = match is_final {
            true => self.finish(stage, watch)?,
            false => self.render_early(stage, &SilentProgress(watch))?,
        };
        self.spent += begun.elapsed().as_secs_f64();
        self.stages.done(stage);
        self.is_done = is_final;
        if is_final {
            self.lock = None;
        }
        Ok(Some(estimate))
    }

    /// Removes the early estimates and what is not finished of all views: nothing is left to go on with.
    ///
    /// # Errors
    /// The system does not remove a file.
    pub fn discard(self) -> Result<()> {
        self.earlier.iter().chain([&self.path]).try_for_each(|path| {
            // Another process may render there by now: what it has is not ours.
            let Ok(_lock) = (*path != self.path).then(|| OutputLock::of(path)).transpose() else { return Ok(()) };
            let early = early_path(path);
            let unfinished = files_of_pack(path).into_iter().chain(files_of_pack(&early));
            unfinished.chain([early]).try_for_each(|path| remove(&path))
        })
    }

    fn choose(&self) -> (RenderStage, bool) {
        self.stages.next(&self.costs, self.spent, EARLY_PART)
    }

    /// An early estimate of this view that an interrupted run has left is the first again.
    fn find_early(&mut self) {
        let Ok(container) = ContainerReader::open(&early_path(&self.path)) else { return };
        let job = container.job();
        let stage = RenderStage {
            width: job.shape.width(),
            height: job.shape.height(),
            samples_per_pixel: job.provenance.samples_per_pixel,
        };
        if job.provenance.content == self.early_content(stage) && job.provenance.seed == self.settings.seed {
            self.stages.find(stage);
        }
    }

    fn render_early(&mut self, stage: RenderStage, watch: &dyn Progress) -> Result<Estimate> {
        let path = early_path(&self.path);
        let mut options = PackOptions {
            compress: CompressSettings { target: Target::Automatic, ..self.options.compress.clone() },
            promise: None,
            basis: None,
            allow_lost_lights: true,
            ..self.options.clone()
        };
        options.container.overwrite = true;
        let settings = RenderSettings { samples_per_pixel: stage.samples_per_pixel, ..self.settings };
        let fused = self.render(
            reduced(self.camera, stage),
            settings,
            |render| render.early_content(stage),
            (&path, &options),
            watch,
        )?;
        self.costs.add(stage, fused.tracing_seconds, fused.render.seconds);
        self.estimate(path, stage, Some((fused.render, Box::new(fused.packed))))
    }

    fn finish(&mut self, stage: RenderStage, watch: &dyn Progress) -> Result<Estimate> {
        let (path, options) = (self.path.clone(), self.options.clone());
        let content = |render: &Self| match render.camera == render.loaded.0 {
            true => render.loaded.1,
            false => content_hash(render.tracer.scene(), render.settings.max_depth),
        };
        let fused = self.render(self.camera, self.settings, content, (&path, &options), watch)?;
        // It is worth nothing beside the finished one.
        let early = early_path(&path);
        let leftovers = files_of_pack(&early);
        std::iter::once(&early).chain(&leftovers).try_for_each(|path| remove(path))?;
        self.estimate(path, stage, Some((fused.render, Box::new(fused.packed))))
    }

    /// Renders and packs the scene from a camera with settings.
    fn render(
        &mut self,
        camera: Camera,
        settings: RenderSettings,
        content: impl FnOnce(&Self) -> [u8; 32],
        (path, options): (&Path, &PackOptions),
        watch: &dyn Progress,
    ) -> Result<Fused> {
        let columns = u32::try_from(self.tracer.scene().basis.column_count()).unwrap_or(u32::MAX);
        let shape = MatrixShape::new(camera.width, camera.height, columns, settings.block_side)?;
        let traced = trace_settings(&settings);
        let photons = Tracer::photons_sent(self.tracer.scene(), shape, traced);
        let folder = Some(folder_of(path));
        while_photons_are_sent(photons, folder, watch, |sending| self.tracer.set_view(camera, shape, traced, sending))?;
        let job = job_of_scene(self.tracer.scene(), &settings, content(self))?;
        let need = scene_need(self.tracer.scene(), traced, &job);
        let has_planes = self.tracer.scene().has_planes(settings.samples_per_pixel);
        let begun = FusedRender::begin(&job, (need, has_planes), path, options, watch)?;
        self.tracer.measure_scales();
        begun.run(&self.tracer, watch)
    }

    fn estimate(
        &self,
        path: PathBuf,
        stage: RenderStage,
        reports: Option<(RenderReport, Box<PackReport>)>,
    ) -> Result<Estimate> {
        let (is_final, error) = (path == self.path, stated_error_of(&path)?);
        let seconds = self.begun.elapsed().as_secs_f64();
        let left =
            if is_final { Some(0.0) } else { self.costs.is_known().then(|| self.costs.seconds(self.stages.last())) };
        Ok(Estimate {
            path,
            stage,
            is_final,
            error,
            seconds,
            expected_seconds: left.map(|left| seconds + left),
            reports,
        })
    }

    /// What tells an early estimate of this view from others.
    fn early_content(&self, stage: RenderStage) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(self.loaded.1);
        hash.update(format!("early estimate, {stage}, of {}", self.camera.in_words(self.tracer.scene().origin)));
        hash.finalize().into()
    }
}

/// Whether the container of a job is at a path already.
fn is_finished(job: &Job, path: &Path, options: &PackOptions) -> Result<bool> {
    let found = ContainerReader::open(path).is_ok_and(|container| container.job().hash() == job.hash());
    if found && !options.container.overwrite {
        return Ok(true);
    }
    check_output(path, options.container.overwrite).map(|()| false)
}

/// The camera with the pixels of a stage. The same is in view: where the pixels do not divide evenly, they are not quite square.
fn reduced(camera: Camera, stage: RenderStage) -> Camera {
    let mut coarse = camera;
    (coarse.width, coarse.height) = (stage.width, stage.height);
    let shape = |camera: &Camera| camera.width as f32 / camera.height as f32;
    let is_uneven =
        u64::from(stage.width) * u64::from(camera.height) != u64::from(stage.height) * u64::from(camera.width);
    if is_uneven && camera.projection != Projection::Panorama {
        coarse.pixel_aspect *= shape(&camera) / shape(&coarse);
    }
    coarse
}

/// What a container states of its images of single lights or groups of lights, as relative L2: what denoising and packing leave, as
/// independent errors.
fn stated_error_of(path: &Path) -> Result<Option<f64>> {
    let container = ContainerReader::open(path)?;
    let StatedErrors { denoising, lights, .. } = container.errors();
    let Some(DenoiseErrors { noise_after, bias, .. }) = *denoising else { return Ok(None) };
    let errors = [noise_after, bias, lights.map_or(0.0, |lights| lights.single_mean)];
    let squares = errors.map(|error| f64::from(error) * f64::from(error));
    Ok(Some(squares.iter().sum::<f64>().sqrt()).filter(|error| error.is_finite()))
}

fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path, "remove")(error)),
        _ => Ok(()),
    }
}

/// A file beside an output that is locked, and there, as long as this lives. One that a killed process has left is taken over.
#[derive(Debug)]
struct OutputLock {
    path: PathBuf,
    _file: File,
}

impl OutputLock {
    fn path_of(output: &Path) -> PathBuf {
        with_suffix(&early_path(output), ".lock")
    }

    /// Errors: another process holds it, or the folder cannot be written.
    fn of(output: &Path) -> Result<Self> {
        let path = Self::path_of(output);
        Ok(Self { _file: open_locked(&path, true)?, path })
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        // Where it stays, the next process takes it over.
        let _ = std::fs::remove_file(&self.path);
    }
}
