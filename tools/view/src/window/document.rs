//! One open container with everything that the window knows of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::autosave::Autosave;
use super::comparison::Comparison;
use super::features_view::FeaturesView;
use super::file_jobs::{FileJobs, JobCount};
use super::light_list::LightList;
use super::light_meter::LightMeter;
use super::message::Message;
use super::pattern_editor::PatternEditorState;
use super::requests::Requests;
use super::shown_picture::ShownPicture;
use super::surfaces_state::SurfacesState;
use super::view_state::ViewState;
use crate::daylight::Daylight;
use crate::looks::Saved;
use crate::mixer::Mix;
use crate::rows::Row;
use crate::work::Work;
use crate::worker::{Brought, Means, Session};
use ltm::error::Result;
use ltm::image::LUMENS_PER_WATT;
use ltm::light::{LightBasis, LightUnit};
use ltm::matrix::FactorSource;

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

/// Each part stands in a file of its own and knows no other; what concerns several is done here and above.
pub(super) struct Document {
    /// The container and its worker.
    pub(super) session: Session,
    /// The mix, its undo, its file.
    pub(super) work: Work,
    /// The mixer's list.
    pub(super) list: LightList,
    /// How the picture is shown, and what was asked of it.
    pub(super) view: ViewState,
    /// What is known of the surfaces.
    pub(super) surfaces: SurfacesState,
    /// The light meter.
    pub(super) meter: LightMeter,
    /// The view of features.
    pub(super) features: FeaturesView,
    /// Snapshots and references.
    pub(super) compare: Comparison,
    /// The texture editor's settings.
    pub(super) editor: PatternEditorState,
    /// The climate by which sky and sun are set, if one was opened.
    pub(super) daylight: Option<Daylight>,
    /// The newest picture.
    pub(super) shown: ShownPicture,
    /// Requests to the worker.
    pub(super) requests: Requests,
    /// Files that are read and written.
    pub(super) files: FileJobs,
    /// What the status line says.
    pub(super) message: Option<Message>,
    /// The work as it is written down.
    pub(super) autosave: Autosave,
}

impl Document {
    /// Opens a container. The pictures are shown on the device of the opening's state if that is the one of its means.
    pub(super) fn open(context: &egui::Context, path: &Path, opening: Opening) -> Result<Self> {
        let wake = {
            let context = context.clone();
            Arc::new(move || context.request_repaint())
        };
        let session = Session::open(path, opening.means, wake)?;
        let mix = Mix::of_scene(session.basis());
        let lighting = Arc::new(mix.lighting(session.basis())?);
        Ok(Self {
            list: LightList::new(&mix),
            work: Work::new(mix),
            view: ViewState::default(),
            surfaces: SurfacesState::default(),
            meter: LightMeter::default(),
            features: FeaturesView::default(),
            compare: Comparison::new(),
            editor: PatternEditorState::default(),
            daylight: None,
            shown: ShownPicture::new(opening.state),
            requests: Requests::new(lighting),
            files: FileJobs::new(path, opening.jobs),
            message: None,
            autosave: Autosave::new(opening.state_folder, opening.work_of),
            session,
        })
    }

    /// Goes on with the work on `old`, the same container as it was before.
    pub(super) fn go_on(&mut self, old: Self) {
        let same_size = old.size() == self.size();
        let (from, to) = (old.session.container.clone(), self.session.container.clone());
        let (from, to) = (&from.job().basis, &to.job().basis);
        let scene = self.work.scene.clone();
        let carry = |mix: &Mix| mix.carried(from, to, &scene);
        self.compare.snapshots = old.compare.snapshots.carried(self.size(), carry);
        let lost = from.lights().iter().filter(|light| to.find(&light.name).is_none()).count();
        self.work.go_on(old.work, carry);
        if from.lights().len() == to.lights().len() {
            self.list.go_on(old.list, to.lights().len());
        }
        self.view.go_on(old.view, same_size.then_some(1.0));
        self.files.go_on(old.files);
        (self.editor, self.daylight) = (old.editor, old.daylight);
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
        let scale = self.size()[0] as f32 / old.size()[0] as f32;
        let (from, to) = (old.session.container.clone(), self.session.container.clone());
        let (from, to) = (&from.job().basis, &to.job().basis);
        let scene = self.work.scene.clone();
        let mut compare = old.compare;
        compare.snapshots = std::mem::take(&mut self.compare.snapshots);
        compare.forget_difference();
        compare.is_relighting = false;
        self.compare = compare;
        self.work.go_on(old.work, |mix| mix.carried(from, to, &scene));
        if from.lights().len() == to.lights().len() {
            self.list.go_on(old.list, to.lights().len());
        }
        self.view.go_on(old.view, Some(scale));
        self.meter.go_on(old.meter, scale);
        self.features.shows = old.features.shows;
        let wanted = old.files.wanted;
        self.files.go_on(old.files);
        self.files.wanted = wanted;
        (self.editor, self.daylight) = (old.editor, old.daylight);
        self.message = old.message;
        self.autosave = old.autosave;
        self.autosave.go_on();
    }

    /// Makes this, which is not shown yet, follow what is done to `shown`, an earlier estimate. Whether it can take its place: its whole
    /// picture stands.
    pub(super) fn follow(&mut self, shown: &Self) -> bool {
        let (from, to) = (shown.session.container.clone(), self.session.container.clone());
        let carry = |mix: &Mix| mix.carried(&from.job().basis, &to.job().basis, &self.work.scene);
        let mix = carry(&shown.work.mix);
        if self.compare.snapshots.revision() != shown.compare.snapshots.revision()
            || self.compare.snapshots.list().len() != shown.compare.snapshots.list().len()
        {
            let before = self.compare.snapshots.clone();
            self.compare.snapshots = shown.compare.snapshots.refined(carry);
            self.compare.snapshots.take_images(&before);
        }
        self.compare.snapshots.follow(&shown.compare.snapshots);
        self.work.mix = mix;
        self.view.set_display(shown.view.display);
        self.view.viewport.centre = shown.view.viewport.scaled(self.size()[0] as f32 / shown.size()[0] as f32).centre;
        self.is_ready() && self.compare.snapshots.without_image().is_none()
    }

    /// Whether its whole picture stands.
    pub(super) fn is_ready(&self) -> bool {
        let stands = self.shown.progress.is_complete() && self.shown.valued == self.shown.seen;
        stands && self.requests.are_answered() && self.shown.id().is_some()
    }

    pub(super) fn basis(&self) -> &LightBasis {
        self.session.basis()
    }

    /// Width and height of the picture.
    pub(super) fn size(&self) -> [u32; 2] {
        let shape = self.session.container.shape();
        [shape.width(), shape.height()]
    }

    /// The rows of the mixer.
    pub(super) fn rows(&self) -> Vec<Row> {
        self.list.rows(self.session.basis(), &self.work.mix)
    }

    /// Whether there are unsaved changes.
    pub(super) fn is_modified(&self) -> bool {
        self.work.is_modified(self.compare.snapshots.revision())
    }

    /// The content of a lighting file.
    pub(super) fn saved(&self) -> Saved {
        Saved {
            mix: self.work.mix.clone(),
            snapshots: self.compare.snapshots.mixes(),
            display: Some(self.view.display),
            keys: self.work.keys.clone(),
        }
    }

    /// Metres of a scene unit; 0 where that is not known.
    pub(super) fn metres_per_unit(&self) -> f32 {
        let stated = self.session.container.job().provenance.metres_per_unit;
        if stated > 0.0 || !self.view.assumes_metres { stated } else { 1.0 }
    }

    /// What makes luminances cd/m², where a weight 1 on each light is a physical quantity and pixels are radiances; else why
    /// they are not.
    pub(super) fn lumens_per_watt(&self) -> std::result::Result<f32, String> {
        let metres = self.metres_per_unit();
        for light in self.basis().lights() {
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
        self.files.start(&self.session, job);
    }

    /// Whether the whole image is complete and nothing is pending.
    pub(super) fn is_settled(&self) -> bool {
        let has_come = self.requests.are_answered() && self.shown.valued == self.shown.seen;
        let is_measured = !self.compare.is_measuring() && !self.surfaces.is_reading();
        let nothing_asked = !self.view.select_strongest && !self.compare.is_relighting && is_measured;
        self.shown.progress.is_complete() && has_come && nothing_asked && !self.files.any_open()
    }

    /// Back to how the picture was first shown.
    pub(super) fn reset_display(&mut self) {
        self.view.display = Default::default();
        self.expose();
    }

    pub(super) fn expose(&mut self) {
        if let Some(image) = &self.shown.image {
            self.view.display.tone.exposure_stops = ltm::image::exposure_for(image);
        }
    }

    /// Keeps the lighting with its picture: at once, or when the picture is there.
    pub(super) fn snapshot(&mut self) {
        let is_there = self.shown.valued >= self.requests.relit && self.requests.lit.as_ref() == Some(&self.work.mix);
        self.compare.snapshot_wanted = !is_there;
        if let (true, Some(image)) = (is_there, self.shown.image.clone()) {
            self.compare.snapshots.take(self.work.mix.clone(), image);
        }
    }
}
