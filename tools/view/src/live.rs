//! Rendering beside the window: a thread that gives an outline, then one estimate after the other, of the newest view asked for.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::{DVec3, Vec2};

use super::system::lower_priority;
use ltm::error::{Error, Result};
use ltm::image::LinearImage;
use ltm::pipeline::{self, Estimate, PackOptions, ProgressiveRender};
use ltm::resources::Progress;
use ltm::scene::{Camera, LoadOptions, NamedCamera};

/// Most pixels of the longer side of an outline, so that one comes with every frame of a drag.
const OUTLINE_SIDE: u32 = 480;

/// What is rendered.
#[derive(Clone, Debug, Default)]
pub struct LiveChoices {
    /// The container to write; none: named after the scene, in the current folder.
    pub output: Option<PathBuf>,
    /// Samples per pixel; none: the scene's.
    pub samples: Option<u32>,
    /// Width and height in pixels; none: the scene's.
    pub size: Option<(u32, u32)>,
    /// Seed of the samples; none: the scene's.
    pub seed: Option<u64>,
    /// Whether a container that is there, or what an interrupted run has left, is replaced.
    pub overwrite: bool,
    /// What may be read, and which camera is the first.
    pub load: LoadOptions,
}

/// Events of a job.
#[derive(Debug)]
pub enum LiveEvent {
    /// The scene was read.
    Opened {
        /// The cameras of a glTF file.
        cameras: Vec<NamedCamera>,
        /// The camera that is used.
        camera: Camera,
        /// Where the zero of the scene lies in its file's coordinates.
        origin: DVec3,
        /// What was mended or looks wrong.
        warnings: Vec<String>,
    },
    /// What a view shows before its first estimate.
    Outline {
        /// The view.
        camera: Camera,
        /// Radiance from 0 to 1.
        image: LinearImage,
        /// Distance to what is in the middle, if anything is.
        distance: Option<f32>,
    },
    /// An estimate of a view.
    Estimate(Camera, Box<Estimate>),
    /// The job cannot go on; another view may.
    Failed(Error),
}

/// A view to render.
#[derive(Clone, Debug)]
pub struct LiveView {
    /// The camera.
    pub camera: Camera,
    /// The container.
    pub path: PathBuf,
    /// Whether that is replaced.
    pub overwrite: bool,
}

/// What is being done.
#[derive(Clone, Debug, Default)]
pub struct LiveProgress {
    /// Name of the job's step.
    pub step: String,
    /// Steps done, and of how many.
    pub done: (u64, u64),
}

#[derive(Default)]
struct Wishes {
    /// Whether the tree stands: only then another view interrupts, which the job would not survive before.
    has_begun: bool,
    view: Option<LiveView>,
    paused: bool,
    /// Whether the job is to end, and whether what is not finished is removed then.
    end: Option<bool>,
}

#[derive(Default)]
struct Shared {
    wishes: Mutex<Wishes>,
    woken: Condvar,
    progress: Mutex<LiveProgress>,
}

impl Shared {
    fn wishes(&self) -> MutexGuard<'_, Wishes> {
        self.wishes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn progress(&self) -> MutexGuard<'_, LiveProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A pause holds every thread at its next question, so that it costs no time and nothing is begun again after it.
impl Progress for Shared {
    fn begin(&self, stage: &str, total: u64, _: &str) {
        let mut progress = self.progress();
        (progress.step, progress.done) = (stage.to_owned(), (0, total));
    }

    fn advance(&self, steps: u64, _: u64, _: &str) {
        self.progress().done.0 += steps;
    }

    fn end(&self) {}

    fn note(&self, _: &str) {}

    fn interrupted(&self) -> bool {
        let is_asked = |wishes: &Wishes| wishes.end.is_some() || (wishes.has_begun && wishes.view.is_some());
        let wishes = self.wishes();
        let held = self.woken.wait_while(wishes, |wishes| wishes.paused && !is_asked(wishes));
        is_asked(&held.unwrap_or_else(PoisonError::into_inner))
    }
}

/// A scene that is rendered beside the window. Dropping it ends the job; what is not finished stays and is gone on with by the next.
pub struct LiveJob {
    shared: Arc<Shared>,
    events: Receiver<LiveEvent>,
    thread: Option<JoinHandle<()>>,
}

impl LiveJob {
    /// Begins to read a scene and to render it. `wake` is called after every event.
    pub fn start(
        scene: &Path,
        choices: LiveChoices,
        memory_bytes: Option<u64>,
        wake: Arc<dyn Fn() + Send + Sync>,
    ) -> Self {
        let shared = Arc::new(Shared::default());
        let (events, received) = channel();
        let outbox = Outbox { events, wake };
        let thread = {
            let (shared, scene) = (shared.clone(), scene.to_owned());
            std::thread::spawn(move || {
                in_background(|| match Renderer::begin(&scene, &choices, memory_bytes, &shared, &outbox) {
                    Ok(renderer) => renderer.serve(&shared, &outbox),
                    Err(Error::Interrupted { .. }) => {}
                    Err(error) => outbox.send(LiveEvent::Failed(error)),
                });
            })
        };
        Self { shared, events: received, thread: Some(thread) }
    }

    /// Goes on to another view.
    pub fn set_view(&self, view: LiveView) {
        self.shared.wishes().view = Some(view);
        self.shared.woken.notify_all();
    }

    /// Holds the work, or lets it go on.
    pub fn pause(&self, paused: bool) {
        self.shared.wishes().paused = paused;
        self.shared.woken.notify_all();
    }

    /// Whether the work is held.
    pub fn is_paused(&self) -> bool {
        self.shared.wishes().paused
    }

    /// What is being done.
    pub fn progress(&self) -> LiveProgress {
        self.shared.progress().clone()
    }

    /// The events since the last call.
    pub fn events(&self) -> impl Iterator<Item = LiveEvent> + '_ {
        self.events.try_iter()
    }

    /// Ends the job; `discards` removes what is not finished.
    pub fn end(self, discards: bool) {
        self.shared.wishes().end = Some(discards);
    }
}

impl Drop for LiveJob {
    fn drop(&mut self) {
        self.shared.wishes().end.get_or_insert(false);
        self.shared.woken.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic there was reported by its own message.
            let _ = thread.join();
        }
    }
}

struct Outbox {
    events: Sender<LiveEvent>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Outbox {
    fn send(&self, event: LiveEvent) {
        // The window may be gone already; then nobody needs the event.
        if self.events.send(event).is_ok() {
            (self.wake)();
        }
    }
}

/// Runs work on threads that the system prefers all others to, as the window's: a fader stays one frame.
fn in_background<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(rayon::current_num_threads());
    let pool = threads.start_handler(|_| lower_priority(BACKGROUND)).build();
    match pool {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// How much lower the priority of the work is.
const BACKGROUND: i32 = 10;

/// The container of a scene where no other is named: as `ltm render --pack` names it.
pub fn output_of(scene: &Path, choices: &LiveChoices) -> PathBuf {
    let beside = || PathBuf::from(scene.file_stem().unwrap_or(scene.as_os_str())).with_extension("ltc");
    choices.output.clone().unwrap_or_else(beside)
}

struct Renderer {
    render: ProgressiveRender,
}

impl Renderer {
    fn begin(
        scene: &Path,
        choices: &LiveChoices,
        memory_bytes: Option<u64>,
        shared: &Shared,
        outbox: &Outbox,
    ) -> Result<Self> {
        shared.begin("reading the scene", 0, "");
        let mut loaded = pipeline::load_scene(scene, LoadOptions { memory_bytes, ..choices.load.clone() })?;
        if let Some((width, height)) = choices.size {
            loaded = loaded.sized(width, height);
        }
        let settings = &mut loaded.settings;
        settings.samples_per_pixel = choices.samples.unwrap_or(settings.samples_per_pixel);
        settings.seed = choices.seed.unwrap_or(settings.seed);
        outbox.send(LiveEvent::Opened {
            cameras: std::mem::take(&mut loaded.cameras),
            camera: loaded.scene.camera,
            origin: loaded.scene.origin,
            warnings: loaded.warnings.iter().map(ToString::to_string).collect(),
        });
        shared.begin("building the tree", 0, "");
        let mut options = PackOptions { denoise: true, memory_bytes, ..PackOptions::default() };
        options.container.overwrite = choices.overwrite;
        let render = ProgressiveRender::begin(loaded, &output_of(scene, choices), options, shared)?;
        let renderer = Self { render };
        renderer.show_outline(outbox);
        Ok(renderer)
    }

    fn show_outline(&self, outbox: &Outbox) {
        let camera = *self.render.camera();
        let side = camera.width.max(camera.height);
        let scaled = |length: u32| match side > OUTLINE_SIDE {
            true => (u64::from(length) * u64::from(OUTLINE_SIDE) / u64::from(side)).max(1) as u32,
            false => length,
        };
        let mut small = camera;
        (small.width, small.height) = (scaled(camera.width), scaled(camera.height));
        let tracer = self.render.tracer();
        let Some(pixels) = tracer.outline(&small, || false) else { return };
        let distance = tracer.distance(&small, Vec2::new(small.width as f32, small.height as f32) / 2.0);
        let image = LinearImage { width: small.width, height: small.height, pixels };
        outbox.send(LiveEvent::Outline { camera, image, distance });
    }

    /// Renders the newest view until the end is asked for.
    fn serve(mut self, shared: &Shared, outbox: &Outbox) {
        let mut rests = false;
        shared.wishes().has_begun = true;
        loop {
            let wish = {
                let wishes = shared.wishes();
                let rest = |wishes: &mut Wishes| rests && wishes.view.is_none() && wishes.end.is_none();
                let woken = shared.woken.wait_while(wishes, rest);
                let mut wishes = woken.unwrap_or_else(PoisonError::into_inner);
                (wishes.end, wishes.view.take())
            };
            rests = match wish {
                (Some(discards), _) => {
                    if discards && let Err(error) = self.render.discard() {
                        outbox.send(LiveEvent::Failed(error));
                    }
                    return;
                }
                (None, Some(view)) => match self.render.set_view(view.camera, &view.path, view.overwrite) {
                    Ok(()) => {
                        self.show_outline(outbox);
                        false
                    }
                    Err(error) => failed(outbox, error),
                },
                (None, None) => {
                    if let Some((stage, _)) = self.render.next_stage() {
                        shared.begin(&format!("rendering {stage}"), 0, "");
                    }
                    match self.render.next_estimate(shared) {
                        Ok(Some(estimate)) => {
                            outbox.send(LiveEvent::Estimate(*self.render.camera(), Box::new(estimate)));
                            false
                        }
                        Ok(None) => true,
                        Err(Error::Interrupted { .. }) => false,
                        Err(error) => failed(outbox, error),
                    }
                }
            };
        }
    }
}

fn failed(outbox: &Outbox, error: Error) -> bool {
    outbox.send(LiveEvent::Failed(error));
    true
}

/// The time that an estimate states, counted on from when it came.
#[derive(Clone, Copy, Debug)]
pub struct LiveClock {
    seconds: f64,
    expected_seconds: Option<f64>,
    came: Instant,
}

impl LiveClock {
    /// Of an estimate that has just come.
    pub fn of(estimate: &Estimate) -> Self {
        Self { seconds: estimate.seconds, expected_seconds: estimate.expected_seconds, came: Instant::now() }
    }

    /// Seconds so far, and those expected by the end, which are never fewer, if they are known.
    pub fn now(&self) -> (f64, Option<f64>) {
        let seconds = self.seconds + self.came.elapsed().as_secs_f64();
        (seconds, self.expected_seconds.map(|expected| expected.max(seconds)))
    }
}
