//! A scene that is rendered while it is mixed: its views, its estimates, and the document that shows the newest of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use eframe::egui::{self, TextureHandle, TextureId};
use glam::{DVec3, Vec3};

use super::document::{Document, Opening};
use super::message::{Message, line};
use super::sampling::Sampling;
use super::shown_picture::set_texture;
use super::{worker_events, worker_requests};
use crate::camera_moves::{CameraMove, MovingCamera};
use crate::display::Display;
use crate::file_watch::{FileChange, FileWatch};
use crate::live::{LiveChoices, LiveClock, LiveEvent, LiveJob, LiveView, output_of};
use crate::saved_view::{self, Saved};
use ltm::error::Error;
use ltm::pipeline::{Estimate, RenderStage};
use ltm::scene::{Camera, NamedCamera, Projection};

/// Moves that can be undone.
const MOST_UNDO: usize = 200;

/// What is known of the estimate that is shown, or will be.
#[derive(Clone)]
pub(super) struct ShownEstimate {
    pub(super) camera: Camera,
    pub(super) stage: RenderStage,
    pub(super) error: Option<f64>,
    pub(super) is_final: bool,
    pub(super) clock: LiveClock,
}

impl ShownEstimate {
    fn of(camera: Camera, estimate: &Estimate) -> Self {
        let Estimate { stage, error, is_final, .. } = estimate;
        Self { camera, stage: *stage, error: *error, is_final: *is_final, clock: LiveClock::of(estimate) }
    }
}

pub(super) struct Rendering {
    pub(super) scene: PathBuf,
    choices: LiveChoices,
    /// None once it was stopped.
    pub(super) job: Option<LiveJob>,
    /// The cameras of a glTF file.
    pub(super) cameras: Vec<NamedCamera>,
    /// The scene's camera, and the newest view; none before the scene was read.
    pub(super) own: Option<Camera>,
    pub(super) view: Option<MovingCamera>,
    origin: DVec3,
    undo: Vec<MovingCamera>,
    /// Whether a drag moves the camera, which is one step.
    is_moving: bool,
    outline: Option<(Camera, TextureHandle)>,
    pub(super) shown: Option<ShownEstimate>,
    /// An estimate that is not shown yet.
    next: Option<(Box<Document>, ShownEstimate)>,
    /// Whether the container of the scene's own view is of an older scene, and is replaced.
    replaces_own: bool,
    /// Whether the scene's file has changed since it was read, as its watch tells.
    is_changed: Arc<AtomicBool>,
    _watch: FileWatch,
    /// A warning of the scene that is not shown yet, as there was no document.
    warning: Option<String>,
    /// The view that a job that begins anew goes on with, once the scene is read.
    resumed: Option<MovingCamera>,
    /// Why the job does not go on.
    pub(super) failed: Option<String>,
    /// The same as it came.
    error: Option<Error>,
    /// What saving views has replaced.
    saved: Vec<Saved>,
}

impl Rendering {
    /// Begins to render a scene.
    pub(super) fn start(context: &egui::Context, scene: &Path, choices: LiveChoices, memory: Option<u64>) -> Self {
        let job = start(context, scene, &choices, memory);
        let is_changed = Arc::new(AtomicBool::new(false));
        Self {
            _watch: watch(context, scene, &is_changed),
            is_changed,
            replaces_own: false,
            scene: scene.to_owned(),
            choices,
            job: Some(job),
            cameras: Vec::new(),
            own: None,
            view: None,
            origin: DVec3::ZERO,
            undo: Vec::new(),
            is_moving: false,
            outline: None,
            shown: None,
            next: None,
            warning: None,
            resumed: None,
            failed: None,
            error: None,
            saved: Vec::new(),
        }
    }

    /// Begins anew, with the scene as it is on the disk now, and goes on with a view that was moved.
    pub(super) fn restart(&mut self, context: &egui::Context, memory: Option<u64>) {
        self.job = None;
        self.replaces_own |= self.has_changed();
        self.look_again(context);
        // What is not finished is of the older scene. What is finished stays, unless the scene has changed.
        let overwrite = self.replaces_own || self.choices.overwrite || !output_of(&self.scene, &self.choices).exists();
        self.resumed = self.view.filter(|view| self.own != Some(view.camera)).or(self.resumed);
        (self.own, self.view, self.next, self.failed, self.error) = (None, None, None, None, None);
        self.undo.clear();
        if let Some(shown) = &mut self.shown {
            shown.is_final = false;
        }
        let choices = LiveChoices { overwrite, ..self.choices.clone() };
        self.job = Some(start(context, &self.scene, &choices, memory));
    }

    /// Whether the scene's file has changed since it was read.
    pub(super) fn has_changed(&self) -> bool {
        self.is_changed.load(Ordering::Relaxed)
    }

    /// Takes the scene's file as it is now for what is rendered.
    fn look_again(&mut self, context: &egui::Context) {
        self.is_changed = Arc::default();
        self._watch = watch(context, &self.scene, &self.is_changed);
    }

    /// Whether the job goes on, and its end would leave something unfinished.
    pub(super) fn is_unfinished(&self) -> bool {
        self.job.is_some() && !self.is_final()
    }

    /// Whether the finished container of the newest view is shown.
    pub(super) fn is_final(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.is_final && self.is_newest(&shown.camera))
    }

    /// Whether no estimate is shown yet though one is to come, or a newer one is about to be shown.
    pub(super) fn awaits_picture(&self) -> bool {
        (self.shown.is_none() && self.failed.is_none() && self.job.is_some()) || self.next.is_some()
    }

    /// Why there is no picture and none will come.
    pub(super) fn take_error(&mut self) -> Option<Error> {
        self.error.take().filter(|_| self.shown.is_none())
    }

    fn is_newest(&self, camera: &Camera) -> bool {
        self.view.as_ref().is_none_or(|view| view.camera == *camera)
    }

    /// Takes what the job has brought, and shows the newest estimate once its picture stands.
    pub(super) fn receive(&mut self, context: &egui::Context, document: &mut Option<Document>, opening: &Opening) {
        let events: Vec<LiveEvent> = self.job.iter().flat_map(LiveJob::events).collect();
        for event in events {
            match event {
                LiveEvent::Opened { cameras, camera, origin, warnings } => {
                    (self.cameras, self.own, self.origin) = (cameras, Some(camera), origin);
                    self.view = Some(MovingCamera::new(camera, 1.0));
                    self.warning = warnings.into_iter().next();
                    if let Some(mut view) = self.resumed.take() {
                        (view.camera.width, view.camera.height) = (camera.width, camera.height);
                        self.view = Some(view);
                        self.set_view();
                    }
                }
                LiveEvent::Outline { camera, image, distance } => {
                    let mut texture = self.outline.take().map(|(_, texture)| texture);
                    let shown = Display::default().show(&image);
                    let is_panorama = camera.projection == Projection::Panorama;
                    let sampling = if is_panorama { Sampling::Around } else { Sampling::Smooth };
                    set_texture(context, &mut texture, "outline", &shown, sampling);
                    self.outline = texture.map(|texture| (camera, texture));
                    let is_moving = self.is_moving;
                    if let (Some(view), Some(distance), false) = (&mut self.view, distance, is_moving)
                        && view.camera == camera
                    {
                        view.distance = distance;
                    }
                }
                LiveEvent::Estimate(camera, estimate) if self.is_newest(&camera) => {
                    let opening = Opening { work_of: Some(self.scene.clone()), ..opening.clone() };
                    match Document::open(context, &estimate.path, opening) {
                        Ok(mut next) => {
                            // Files are named after the finished container, whichever estimate is shown.
                            next.front.files.name_after(&output_of(&self.scene, &self.choices));
                            self.failed = None;
                            self.replaces_own &= !(estimate.is_final && self.own == Some(camera));
                            next.front.shown.is_smooth = !estimate.is_final;
                            self.next = Some((Box::new(next), ShownEstimate::of(camera, &estimate)));
                        }
                        Err(error) => self.failed = Some(line(&error)),
                    }
                }
                LiveEvent::Estimate(..) => {}
                LiveEvent::Failed(error) => {
                    self.failed = Some(line(&error));
                    self.error = Some(error);
                }
            }
        }
        self.show_next(context, document);
        if let Some(document) = document {
            if let Some(warning) = self.warning.take() {
                document.message = Some(Message::info(warning));
            }
            // Whoever renders it knows that it changes.
            document.front.files.changed = None;
            document.front.view.moves_camera = self.view.is_some() && self.job.is_some();
            document.front.view.outline = self.outline_id();
        }
    }

    /// The outline, while it is newer than what is shown.
    pub(super) fn outline_id(&self) -> Option<TextureId> {
        let is_older = self.shown.as_ref().is_none_or(|shown| !self.is_newest(&shown.camera));
        self.outline.as_ref().filter(|_| is_older).map(|(_, texture)| texture.id())
    }

    fn show_next(&mut self, context: &egui::Context, document: &mut Option<Document>) {
        let Some((mut next, estimate)) = self.next.take() else { return };
        worker_events::receive(&mut next, context);
        let is_ready = match document {
            Some(shown) => next.follow(shown) && !shown.files.any_open() && !context.input(|i| i.pointer.any_down()),
            None => next.front.is_ready(),
        };
        if !is_ready {
            worker_requests::ask(&mut next, context, false);
            context.request_repaint();
            self.next = Some((next, estimate));
            return;
        }
        if let Some(old) = document.take() {
            next.take_place_of(old);
        }
        self.shown = Some(estimate);
        *document = Some(*next);
    }

    /// Takes up how the pointer has moved the camera.
    pub(super) fn take_moves(&mut self, context: &egui::Context, moves: Vec<CameraMove>) {
        let held = context.input(|input| input.pointer.any_down());
        if moves.is_empty() {
            self.is_moving &= held;
            return;
        }
        let Some(before) = self.view else { return };
        if !self.is_moving {
            self.remember(before);
        }
        self.is_moving = held;
        if let Some(view) = &mut self.view {
            moves.into_iter().for_each(|step| view.apply(step));
        }
        self.set_view();
    }

    fn remember(&mut self, view: MovingCamera) {
        self.undo.push(view);
        if self.undo.len() > MOST_UNDO {
            self.undo.remove(0);
        }
    }

    /// Whether a move can be taken back.
    pub(super) fn can_undo(&self) -> bool {
        !self.undo.is_empty()
    }

    /// Takes the newest move back.
    pub(super) fn undo_move(&mut self) {
        if let Some(before) = self.undo.pop() {
            self.view = Some(before);
            self.set_view();
        }
    }

    /// Goes on to a camera.
    pub(super) fn look_through(&mut self, camera: Camera) {
        if let Some(before) = self.view.filter(|view| view.camera != camera) {
            self.remember(before);
            self.view = Some(MovingCamera::new(camera, before.distance));
            self.set_view();
        }
    }

    /// Frames a light: the box of its places.
    pub(super) fn frame(&mut self, document: &Document) -> Result<(), String> {
        let Some(light) = document.list.selected() else { return Err("Select a lamp first".into()) };
        let light = &document.basis().lights()[light];
        if light.kind.is_environment() || light.places.is_empty() {
            return Err(format!("{} stands nowhere in the scene", light.name));
        }
        let Some(mut view) = self.view else { return Err("The scene is not read yet".into()) };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for place in light.places.iter().map(|place| Vec3::from(*place)) {
            (low, high) = (low.min(place), high.max(place));
        }
        let extent = light.extents.iter().copied().fold(0.0, f32::max);
        // A lamp without extent is shown with what is around it.
        let radius = (0.5 * (high - low).length() + extent).max(0.1 * view.distance);
        self.remember(view);
        view.frame(0.5 * (low + high), radius);
        self.view = Some(view);
        self.set_view();
        Ok(())
    }

    /// Has the newest view rendered: the scene's own into its container, others into one beside it.
    fn set_view(&mut self) {
        let (Some(view), Some(job)) = (&self.view, &self.job) else { return };
        let is_own = self.own == Some(view.camera);
        let output = output_of(&self.scene, &self.choices);
        let path = if is_own { output.clone() } else { view_path(&output) };
        let overwrite = !is_own || self.replaces_own || !output.exists();
        job.set_view(LiveView { camera: view.camera, overwrite, path });
        self.failed = None;
        self.next = None;
    }

    /// Saves the view into the scene file, or into one beside the scene.
    pub(super) fn save_view(&mut self, context: &egui::Context) -> Result<String, String> {
        let Some(view) = &self.view else { return Err("The scene is not read yet".into()) };
        let saved = saved_view::save(&self.scene, &view.camera, self.origin).map_err(|error| line(&error))?;
        let said = format!("Saved the view in {}", saved.path.display());
        self.saved.push(saved);
        self.keep_watch(context);
        Ok(said)
    }

    /// Whether a saved view can be taken back.
    pub(super) fn can_restore(&self) -> bool {
        !self.saved.is_empty()
    }

    /// Takes the newest save of a view back.
    pub(super) fn restore_view(&mut self, context: &egui::Context) -> Result<String, String> {
        let Some(saved) = self.saved.pop() else { return Err("No view was saved".into()) };
        saved_view::restore(&saved).map_err(|error| line(&error))?;
        self.keep_watch(context);
        Ok(format!("{} is as it was", saved.path.display()))
    }

    /// After the window itself has written the scene's file: what was rendered is of it still.
    fn keep_watch(&mut self, context: &egui::Context) {
        if !self.has_changed() {
            self.look_again(context);
        }
    }

    /// Ends the job. What is not finished stays, unless it is discarded.
    pub(super) fn end(&mut self, discards: bool) {
        if let Some(job) = self.job.take() {
            job.end(discards);
        }
    }
}

/// The container of a view that the scene does not have.
fn view_path(output: &Path) -> PathBuf {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{stem}-view.ltc"))
}

/// Watches the scene's file, and sets `is_changed` once it is another.
fn watch(context: &egui::Context, scene: &Path, is_changed: &Arc<AtomicBool>) -> FileWatch {
    let (context, is_changed) = (context.clone(), is_changed.clone());
    FileWatch::start(scene.to_owned(), move |change| {
        is_changed.store(change == FileChange::Replaced, Ordering::Relaxed);
        context.request_repaint();
    })
}

fn start(context: &egui::Context, scene: &Path, choices: &LiveChoices, memory: Option<u64>) -> LiveJob {
    let context = context.clone();
    LiveJob::start(scene, choices.clone(), memory, Arc::new(move || context.request_repaint()))
}
