//! The open views of a scene under one mix: what they share, the one in front, and those behind it.

use std::path::{Path, PathBuf};

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::autosave::Autosave;
use super::exposure::Exposure;
use super::file_jobs::{FileJobs, JobCount};
use super::light_list::LightList;
use super::message::Message;
use super::open_view::{OpenView, open_session};
use super::pattern_editor::PatternEditorState;
use crate::daylight::Daylight;
use crate::display::Display;
use crate::looks::Saved;
use crate::mixer::Mix;
use crate::rows::Row;
use crate::shared_lights::SharedLights;
use crate::work::Work;
use crate::worker::{Brought, Means};
use ltm::error::Result;
use ltm::image::{LUMENS_PER_WATT, LinearImage};
use ltm::light::{LightBasis, LightUnit};

/// Options for opening a document.
#[derive(Clone)]
pub(super) struct Opening {
    /// Resources of the worker.
    pub(super) means: Means,
    /// The device that draws the window, where it relights too.
    pub(super) state: Option<RenderState>,
    /// Folder for autosaved work.
    pub(super) state_folder: Option<PathBuf>,
    /// Jobs in the background.
    pub(super) jobs: JobCount,
    /// The file that unsaved work belongs to, where that is not the container: the scene that is rendered.
    pub(super) work_of: Option<PathBuf>,
}

/// The frames of an animation, and which of them is in front.
pub(super) struct Frames {
    /// The number of each, and its container.
    pub(super) list: Vec<(usize, PathBuf)>,
    /// Place of the one in front.
    pub(super) at: usize,
}

/// What all views of a scene share, the view in front, and those behind it. Each part stands in a file of its own and knows no other; what
/// concerns several is done here and above.
pub(super) struct Document {
    /// The lights of all views.
    pub(super) lights: SharedLights,
    /// The mix, its undo, its file.
    pub(super) work: Work,
    /// The mixer's list.
    pub(super) list: LightList,
    /// How pictures are shown.
    pub(super) display: Display,
    exposure: Exposure,
    /// The texture editor's settings.
    pub(super) editor: PatternEditorState,
    /// The climate by which sky and sun are set, if one was opened.
    pub(super) daylight: Option<Daylight>,
    /// Files that are read and written.
    pub(super) files: FileJobs,
    /// What the status line says.
    pub(super) message: Option<Message>,
    /// The work as it is written down.
    pub(super) autosave: Autosave,
    /// The view in front, which the panels show.
    pub(super) front: OpenView,
    /// The others, in the order of their tabs, and the place of the one in front among all.
    pub(super) behind: Vec<OpenView>,
    pub(super) at: usize,
    /// The animation whose frames the views are, if they are.
    pub(super) frames: Option<Frames>,
    /// Resources for further views.
    pub(super) opening: Opening,
}

impl Document {
    /// Opens a container. The pictures are shown on the device of the opening's state if that is the one of its means.
    pub(super) fn open(context: &egui::Context, path: &Path, opening: Opening) -> Result<Self> {
        let session = open_session(context, path)?;
        let (lights, own) = SharedLights::of(session.basis());
        let mix = Mix::of_scene(lights.basis());
        let work_of = opening.work_of.clone().unwrap_or_else(|| path.to_owned());
        let mut document = Self {
            list: LightList::new(&mix),
            front: OpenView::new(view_name(path), session, own, &mix, opening.state.clone())?,
            work: Work::new(mix),
            display: Display::default(),
            exposure: Exposure::default(),
            editor: PatternEditorState::default(),
            daylight: None,
            files: FileJobs::new(opening.jobs.clone()),
            message: None,
            autosave: Autosave::new(opening.state_folder.clone(), work_of),
            lights,
            behind: Vec::new(),
            at: 0,
            frames: None,
            opening,
        };
        document.share_memory();
        Ok(document)
    }

    /// Goes on with the work on `old`, the same containers as they were before.
    pub(super) fn go_on(&mut self, mut old: Self) {
        let (from, to) = (old.lights.basis(), self.lights.basis());
        let scene = self.work.scene.clone();
        let carry = |mix: &Mix| mix.carried(from, to, &scene);
        let lost = from.lights().iter().filter(|light| to.find(&light.name).is_none()).count();
        self.work.go_on(old.work, carry);
        if from.lights().len() == to.lights().len() {
            self.list.go_on(old.list, to.lights().len());
        }
        let old_views = std::iter::once(old.front).chain(std::mem::take(&mut old.behind));
        for (view, old) in std::iter::once(&mut self.front).chain(&mut self.behind).zip(old_views) {
            view.compare.snapshots = old.compare.snapshots.carried(view.size(), carry);
            let same_size = old.size() == view.size();
            view.view.go_on(old.view, same_size.then_some(1.0));
            view.files.go_on(old.files);
        }
        self.set_display(old.display);
        (self.editor, self.daylight, self.frames) = (old.editor, old.daylight, old.frames);
        let lost = match lost {
            0 => String::new(),
            1 => "; one light is no longer there".to_owned(),
            count => format!("; {count} lights are no longer there"),
        };
        self.message = Some(Message { is_error: !lost.is_empty(), text: format!("Reloaded with your mix{lost}") });
        self.autosave = old.autosave;
        self.autosave.go_on();
    }

    /// Takes the place of `old`, an estimate of the same scene with the same lights, with all that was done to it. Where both are of one view,
    /// nothing but the picture changes.
    pub(super) fn take_place_of(&mut self, old: Self) {
        let (front, before) = (&mut self.front, old.front);
        let scale = front.size()[0] as f32 / before.size()[0] as f32;
        let (from, to) = (old.lights.basis(), self.lights.basis());
        let scene = self.work.scene.clone();
        let mut compare = before.compare;
        compare.snapshots = std::mem::take(&mut front.compare.snapshots);
        compare.forget_difference();
        compare.is_relighting = false;
        front.compare = compare;
        self.work.go_on(old.work, |mix| mix.carried(from, to, &scene));
        if from.lights().len() == to.lights().len() {
            self.list.go_on(old.list, to.lights().len());
        }
        front.view.go_on(before.view, Some(scale));
        front.meter.go_on(before.meter, scale);
        front.features.shows = before.features.shows;
        front.files.go_on(before.files);
        self.files.wanted = old.files.wanted;
        self.set_display(old.display);
        (self.editor, self.daylight) = (old.editor, old.daylight);
        self.message = old.message;
        self.autosave = old.autosave;
        self.autosave.go_on();
    }

    /// Makes this, which is not shown yet, follow what is done to `shown`, an earlier estimate. Whether it can take its place: its whole
    /// picture stands.
    pub(super) fn follow(&mut self, shown: &Self) -> bool {
        let (from, to) = (shown.lights.basis(), self.lights.basis());
        let carry = |mix: &Mix| mix.carried(from, to, &self.work.scene);
        let mix = carry(&shown.work.mix);
        let (own, theirs) = (&mut self.front.compare.snapshots, &shown.front.compare.snapshots);
        if own.revision() != theirs.revision() || own.list().len() != theirs.list().len() {
            let before = own.clone();
            *own = theirs.refined(carry);
            own.take_images(&before);
        }
        own.follow(theirs);
        self.work.mix = mix;
        self.set_display(shown.display);
        let scale = self.front.size()[0] as f32 / shown.front.size()[0] as f32;
        self.front.view.viewport.centre = shown.front.view.viewport.scaled(scale).centre;
        self.front.view.look_as(shown.front.view.look, shown.front.view.is_around);
        self.front.is_ready() && self.front.compare.snapshots.without_image().is_none()
    }

    /// The lights of all views.
    pub(super) fn basis(&self) -> &LightBasis {
        self.lights.basis()
    }

    /// Width and height of the picture.
    pub(super) fn size(&self) -> [u32; 2] {
        self.front.size()
    }

    /// The rows of the mixer.
    pub(super) fn rows(&self) -> Vec<Row> {
        self.list.rows(self.basis(), &self.work.mix)
    }

    /// Whether there are unsaved changes.
    pub(super) fn is_modified(&self) -> bool {
        self.work.is_modified(self.front.compare.snapshots.revision())
    }

    /// The content of a lighting file.
    pub(super) fn saved(&self) -> Saved {
        Saved {
            mix: self.work.mix.clone(),
            snapshots: self.front.compare.snapshots.mixes(),
            display: Some(self.display),
            keys: self.work.keys.clone(),
        }
    }

    /// Metres of a scene unit; 0 where that is not known.
    pub(super) fn metres_per_unit(&self) -> f32 {
        let stated = self.front.session.container.job().provenance.metres_per_unit;
        if stated > 0.0 || !self.front.view.assumes_metres { stated } else { 1.0 }
    }

    /// What makes luminances cd/m², where a weight 1 on each light is a physical quantity and pixels are radiances; else why
    /// they are not.
    pub(super) fn lumens_per_watt(&self) -> std::result::Result<f32, String> {
        let metres = self.metres_per_unit();
        for light in self.front.session.basis().lights() {
            match light.unit {
                LightUnit::Radiance | LightUnit::Irradiance => {}
                // Intensity falls with the square of a distance, whose unit must be known.
                LightUnit::Intensity if metres > 0.0 => {}
                LightUnit::Intensity => {
                    return Err(format!(
                        "the scene does not say how long its unit is, and '{}' has an intensity",
                        light.name
                    ));
                }
                LightUnit::Multiple => return Err(format!("'{}' is known by its picture alone", light.name)),
            }
        }
        Ok(LUMENS_PER_WATT)
    }

    /// Starts a job on files beside the worker.
    pub(super) fn start_job(&mut self, job: impl FnOnce() -> Result<Brought> + Send + 'static) {
        self.files.start(&self.front.session, job);
    }

    /// Whether the whole image is complete and nothing is pending.
    pub(super) fn is_settled(&self) -> bool {
        let is_measured = !self.front.compare.is_measuring() && !self.front.surfaces.is_reading();
        let nothing_asked = !self.front.view.select_strongest && !self.front.compare.is_relighting && is_measured;
        let is_done = self.front.is_ready() && nothing_asked && !self.files.any_open();
        is_done && self.are_settled_behind()
    }

    /// Shows from now on as it is told.
    pub(super) fn set_display(&mut self, display: Display) {
        self.display = display;
        self.exposure.stay();
    }

    /// Exposes for a picture that streams in, unless the exposure was set.
    pub(super) fn follow_exposure(&mut self, image: &LinearImage) {
        self.exposure.follow(&mut self.display, image, self.front.shown.progress.is_complete());
    }

    /// Back to how the picture was first shown.
    pub(super) fn reset_display(&mut self) {
        self.display = Default::default();
        self.expose();
    }

    pub(super) fn expose(&mut self) {
        if let Some(image) = &self.front.shown.image {
            self.display.tone.exposure_stops = ltm::image::exposure_for(image);
        }
    }

    /// Keeps the lighting with its picture: at once, or when the picture is there.
    pub(super) fn snapshot(&mut self) {
        let is_there = self.front.shown.valued >= self.front.requests.relit
            && self.front.requests.lit.as_ref() == Some(&self.work.mix);
        self.front.compare.snapshot_wanted = !is_there;
        if let (true, Some(image)) = (is_there, self.front.shown.image.clone()) {
            self.front.compare.snapshots.take(self.work.mix.clone(), image);
        }
    }
}

/// What the tab of a container is called: its file's name without its ending.
pub(super) fn view_name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
