//! One open container: its worker, its picture, and all that is of this view alone. What is on the lights is shared by all views.

use std::path::Path;
use std::sync::Arc;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::comparison::Comparison;
use super::features_view::FeaturesView;
use super::file_jobs::ViewFiles;
use super::light_meter::LightMeter;
use super::requests::Requests;
use super::sampling::Sampling;
use super::shown_picture::ShownPicture;
use super::surfaces_state::SurfacesState;
use super::view_state::ViewState;
use crate::mixer::Mix;
use crate::panorama::LookAround;
use crate::shared_lights::{SharedLights, ViewLights};
use crate::worker::{Means, PictureProgress, Session};
use ltm::error::Result;
use ltm::light::Lighting;
use ltm::matrix::FactorSource;
use ltm::scene::{Camera, Projection};

pub(super) struct OpenView {
    /// What its tab is called.
    pub(super) name: String,
    /// The container and its worker.
    pub(super) session: Session,
    /// Its lights among those of all views.
    pub(super) lights: ViewLights,
    /// Zoom, and what was asked of the picture.
    pub(super) view: ViewState,
    /// What is known of the surfaces.
    pub(super) surfaces: SurfacesState,
    /// The light meter.
    pub(super) meter: LightMeter,
    /// The view of features.
    pub(super) features: FeaturesView,
    /// Snapshots with their pictures, and references. The lightings of a view that is behind are those of when it was last in front.
    pub(super) compare: Comparison,
    /// The newest picture.
    pub(super) shown: ShownPicture,
    /// Requests to the worker.
    pub(super) requests: Requests,
    /// Its file, and names of files that are made of it.
    pub(super) files: ViewFiles,
    /// The most memory that its factors take, in bytes.
    pub(super) needed_bytes: u64,
    /// Grows with each view that is brought to the front.
    pub(super) seen_at: u64,
}

/// Opens a container whose worker sleeps still; it wakes the window.
pub(super) fn open_session(context: &egui::Context, path: &Path) -> Result<Session> {
    let context = context.clone();
    Session::open_asleep(path, Arc::new(move || context.request_repaint()))
}

impl OpenView {
    /// Shows an open container, whose lights stand so among those of all. The pictures are shown on the device of `state`, if that relights.
    ///
    /// Errors: weights that overflow.
    pub(super) fn new(
        name: String,
        session: Session,
        lights: ViewLights,
        mix: &Mix,
        state: Option<RenderState>,
    ) -> Result<Self> {
        let lighting = Arc::new(lights.mix(mix).lighting(session.basis())?);
        let shape = session.container.shape();
        // By its camera; where none is stated, one can look around in a picture of the right shape.
        let stated = Camera::of_job(session.container.job()).map(|camera| camera.projection == Projection::Panorama);
        let may_be = stated.unwrap_or(shape.width() == 2 * shape.height());
        let look = may_be.then(LookAround::default);
        Ok(Self {
            view: ViewState { look, is_around: stated == Some(true), ..ViewState::default() },
            surfaces: SurfacesState::default(),
            meter: LightMeter::default(),
            features: FeaturesView::default(),
            compare: Comparison::new(),
            shown: ShownPicture::new(format!("picture of {name}"), state),
            requests: Requests::new(lighting),
            files: ViewFiles::new(&session.path),
            needed_bytes: session.needed_bytes(),
            seen_at: 0,
            name,
            session,
            lights,
        })
    }

    /// Width and height of the picture.
    pub(super) fn size(&self) -> [u32; 2] {
        let shape = self.session.container.shape();
        [shape.width(), shape.height()]
    }

    /// Has all that is shown of it sampled as one looks at it.
    pub(super) fn sample(&mut self, context: &egui::Context) {
        let is_around = self.view.is_around;
        let sampling = if is_around { Sampling::Around } else { Sampling::Squares };
        self.compare.sample(context, sampling);
        self.meter.sample(context, sampling);
        self.features.sample(context, sampling);
        if self.shown.look_around(is_around) {
            // The picture comes once more.
            self.requests.display = None;
        }
    }

    /// The lighting of this view by a mix of all lights.
    ///
    /// Errors: weights that overflow.
    pub(super) fn lighting(&self, all: &Mix) -> Result<Lighting> {
        self.lights.mix(all).lighting(self.session.basis())
    }

    /// What each of all lights brings to this view's picture; nothing before that is known.
    pub(super) fn contributions(&self, shared: &SharedLights) -> Vec<f32> {
        let Some(reach) = &self.requests.reach else { return Vec::new() };
        self.lights.spread(&reach.contributions(self.session.basis(), &self.requests.lighting), shared)
    }

    /// Whether its whole picture stands.
    pub(super) fn is_ready(&self) -> bool {
        let stands = self.shown.progress.is_complete() && self.shown.valued == self.shown.seen;
        stands && self.requests.are_answered() && self.shown.id().is_some()
    }

    /// Whether its whole picture stands, under this mix.
    pub(super) fn is_lit_by(&self, mix: &Mix) -> bool {
        self.is_ready() && self.requests.lit.as_ref() == Some(mix)
    }

    /// Loads the factors.
    pub(super) fn wake(&mut self, means: Means) {
        if !self.session.worker.is_awake() {
            self.requests.begin_anew();
            self.shown.progress = PictureProgress::default();
            self.session.worker.wake(means);
        }
    }

    /// Lets the factors go; the picture stays as it is.
    pub(super) fn sleep(&mut self) {
        if self.session.worker.is_awake() {
            self.session.worker.sleep();
            self.requests.begin_anew();
            self.shown.relighter = None;
        }
    }
}
