//! One open container with everything that the window knows of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::autosave::Autosave;
use super::comparison::Comparison;
use super::features_view::FeaturesView;
use super::file_jobs::{Errands, UnderWay};
use super::light_list::LightList;
use super::light_meter::{LightMeter, MeteredPicture};
use super::pattern_editor::PatternEditorState;
use super::requests::Requests;
use super::shown_picture::ShownPicture;
use super::surfaces_state::SurfacesState;
use super::view_state::{Asked, ViewState};
use crate::difference;
use crate::display::Display;
use crate::file_watch::FileChange;
use crate::looks::Saved;
use crate::meter::Measured;
use crate::mixer::Mix;
use crate::rows::Row;
use crate::work::Work;
use crate::worker::{Brought, Event, Means, Picture, Request, Session};
use ltm::error::Result;
use ltm::image::{LUMENS_PER_WATT, LinearImage};
use ltm::light::{LightBasis, LightUnit};
use ltm::matrix::FactorSource;
use ltm::relight::relight_streaming;

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
    pub(super) under_way: UnderWay,
}

/// Each part is a room of its own; what concerns several stands here.
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
    pub(super) easel: PatternEditorState,
    /// The newest picture.
    pub(super) shown: ShownPicture,
    /// Requests to the worker.
    pub(super) requests: Requests,
    /// Files that are read and written, and what is said of it.
    pub(super) files: Errands,
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
            easel: PatternEditorState::default(),
            shown: ShownPicture::new(opening.state),
            requests: Requests::new(lighting),
            files: Errands::new(path, opening.under_way),
            autosave: Autosave::new(opening.state_folder),
            session,
        })
    }

    /// Goes on with the work on `old`, the same container as it was before.
    pub(super) fn go_on(&mut self, old: Self) {
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
        let same_size = old.session.container.shape().width() == self.size()[0]
            && old.session.container.shape().height() == self.size()[1];
        self.view.go_on(old.view, same_size);
        self.files.go_on(old.files);
        self.easel = old.easel;
        let lost = match lost {
            0 => String::new(),
            1 => "; one light is no longer there".to_owned(),
            count => format!("; {count} lights are no longer there"),
        };
        self.files.message = Some((format!("Reloaded with your mix{lost}"), !lost.is_empty()));
        self.autosave = old.autosave;
        self.autosave.go_on();
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

    /// Takes what the worker has done; before the panels are drawn.
    pub(super) fn receive(&mut self, context: &egui::Context) {
        let events: Vec<Event> = self.session.worker.events().collect();
        for event in events {
            match event {
                Event::Picture(picture) => self.take_picture(context, *picture),
                Event::Values { generation, image, histogram } => self.take_values(generation, image, histogram),
                Event::Loaded { relighter, adapter, is_paged } => {
                    self.shown.is_paged = is_paged;
                    self.shown.relighter = relighter;
                    self.shown.adapter = adapter;
                }
                Event::Damage(lines) => {
                    let blocks = if lines.len() == 1 { "block" } else { "blocks" };
                    let first = lines.first().map_or("", String::as_str);
                    self.files.message = Some((format!("{} damaged {blocks}: {first}", lines.len()), true));
                }
                Event::Brought(Ok(Brought::Unsaved(outcome))) => self.autosaved(outcome),
                Event::Brought(Ok(Brought::SnapshotImage { name, revision, image })) => {
                    self.compare.is_relighting = false;
                    // Else it may be the picture of another of that name, and is made again.
                    if revision == self.compare.snapshots.revision() {
                        self.compare.snapshots.set_image(&name, image);
                    }
                }
                Event::Brought(Ok(Brought::Difference(of, difference))) => {
                    self.compare.take_difference(context, of, difference);
                }
                Event::Brought(Ok(Brought::Surfaces(surfaces))) => self.surfaces.take(surfaces),
                Event::Brought(brought) => {
                    self.files.beside -= 1;
                    let outcome = brought.and_then(|brought| self.take(brought).map_err(|error| error.to_string()));
                    self.files.message = match outcome {
                        Ok(message) => Some((message, false)),
                        Err(message) => Some((message, true)),
                    };
                }
                Event::Reach(reach) => {
                    let lighting = &self.requests.lighting;
                    self.list.contributions = reach.contributions(self.session.basis(), lighting);
                    self.requests.reach = Some(reach);
                }
                Event::Pixel { pixel, lights } => self.take_pixel(pixel, lights),
                Event::File(change) => self.files.changed = Some(change).filter(|&change| change != FileChange::Same),
                Event::Failed(message) => {
                    // It may have been about the pixel.
                    self.view.select_strongest = false;
                    self.files.message = Some((message, true));
                }
            }
        }
        if self.compare.snapshot_wanted {
            self.snapshot();
        }
    }

    /// Measures what has come, where somebody looks at it.
    fn refresh_meter(&mut self, context: &egui::Context) {
        let Ok(lumens_per_watt) = self.lumens_per_watt() else { return self.meter.shows = None };
        let Some(image) = self.shown.image.as_deref().filter(|_| self.meter.is_used()) else { return };
        if self.meter.measured() == Measured::Illuminance {
            self.surfaces.ask(&self.session);
        }
        let picture = MeteredPicture { generation: self.shown.valued, image, lumens_per_watt };
        if let Err(error) = self.meter.refresh(context, &picture, self.surfaces.known()) {
            self.files.message = Some((error.to_string(), true));
        }
    }

    /// Has the surfaces read, and shows of them what is asked for.
    fn refresh_features(&mut self, context: &egui::Context) {
        if self.features.missing().is_none() {
            return;
        }
        self.surfaces.ask(&self.session);
        if let Some(surfaces) = self.surfaces.known() {
            self.features.refresh(context, surfaces);
        }
    }

    fn take_pixel(&mut self, pixel: [u32; 2], lights: Vec<f32>) {
        if std::mem::take(&mut self.view.select_strongest) {
            let strongest = (0..lights.len()).max_by(|&a, &b| lights[a].total_cmp(&lights[b]));
            if let Some(light) = strongest.filter(|&light| lights[light] > 0.0) {
                self.list.select_and_show(light, &self.work.mix);
            }
        }
        self.view.asked = Some(Asked { pixel, lights });
    }

    fn take_picture(&mut self, context: &egui::Context, mut picture: Picture) {
        if let Some(latency) = self.requests.answered(&picture, context.cumulative_frame_nr()) {
            self.shown.latency = latency;
        }
        let (generation, compared) = (picture.generation, picture.compared.take());
        if let Some((image, histogram)) = self.shown.take(context, picture) {
            self.take_values(generation, image, histogram);
        }
        self.compare.take(context, compared);
    }

    fn take_values(&mut self, generation: u64, image: Arc<LinearImage>, histogram: Vec<[f32; 3]>) {
        self.view.follow(&image, self.shown.progress.is_complete());
        (self.shown.valued, self.shown.image, self.shown.histogram) = (generation, Some(image), histogram);
    }

    /// Asks for what has changed; after the panels were drawn. `held` while a drag is on.
    pub(super) fn ask(&mut self, context: &egui::Context, held: bool) {
        self.work.observe(held);
        self.autosave(context, held);
        self.relight_snapshot();
        self.compare_pictures(held);
        self.refresh_meter(context);
        self.refresh_features(context);
        let relit = self.requests.lit.as_ref() != Some(&self.work.mix);
        let compared = self.compare.compared();
        let image = compared.as_ref().map(|compared| Arc::as_ptr(&compared.image) as usize);
        let display = (self.view.display, self.compare.snapshots.compared(), image);
        if !relit && self.requests.display == Some(display) {
            return;
        }
        if relit {
            match self.work.mix.lighting(self.session.basis()) {
                Ok(lighting) => self.requests.lighting = Arc::new(lighting),
                Err(error) => self.files.message = Some((error.to_string(), true)),
            }
            self.requests.lit = Some(self.work.mix.clone());
            if let Some(reach) = &self.requests.reach {
                self.list.contributions = reach.contributions(self.session.basis(), &self.requests.lighting);
            }
        }
        self.requests.display = Some(display);
        self.requests.count(context.cumulative_frame_nr(), relit);
        self.session.worker.request(Request {
            generation: self.requests.generation,
            lighting: self.requests.lighting.clone(),
            display: self.view.display,
            looked_at: self.view.viewport.centre,
            compared,
        });
        // After the lighting under which it is asked.
        if let (true, Some(asked)) = (relit, &self.view.asked) {
            self.session.worker.ask_pixel(asked.pixel);
        }
    }

    /// Whether the whole image is complete and nothing is pending.
    pub(super) fn is_settled(&self) -> bool {
        let has_come = self.requests.are_answered() && self.shown.valued == self.shown.seen;
        let is_measured = !self.compare.is_measuring() && !self.surfaces.is_reading();
        let nothing_asked = !self.view.select_strongest && !self.compare.is_relighting && is_measured;
        self.shown.progress.is_complete() && has_come && nothing_asked && self.files.beside == 0
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

    /// Measures how far the picture and the compared one are apart, once both stand.
    fn compare_pictures(&mut self, held: bool) {
        let stands = self.requests.are_answered()
            && self.shown.valued == self.shown.seen
            && self.requests.lit.as_ref() == Some(&self.work.mix)
            && self.shown.progress.is_complete();
        let (Some(compared), Some(image)) = (self.compare.compared(), self.shown.image.clone()) else {
            return self.compare.forget_difference();
        };
        let display = self.view.display;
        let key = (self.shown.valued, display, Arc::as_ptr(&compared.image) as usize);
        if held || !stands || !self.compare.begin_difference(key) {
            return;
        }
        let of = self.shown.valued;
        self.session.worker.beside(move || {
            let other = if compared.is_displayed { Display::default() } else { display };
            let difference = difference::between(&display.show(&image), &other.show(&compared.image));
            Ok(Brought::Difference(of, difference.map(Arc::new)))
        });
    }

    /// Makes the picture of a snapshot that came without one, once the container is loaded.
    fn relight_snapshot(&mut self) {
        if self.compare.is_relighting || !self.shown.progress.is_complete() {
            return;
        }
        let Some((name, mix)) = self.compare.snapshots.without_image() else { return };
        let (name, lighting) = (name.to_owned(), mix.lighting(self.session.basis()));
        let revision = self.compare.snapshots.revision();
        let (container, relighter) = (self.session.container.clone(), self.shown.relighter.clone());
        self.compare.is_relighting = true;
        self.session.worker.beside(move || {
            let made = lighting.and_then(|lighting| match relighter {
                Some(relighter) => relighter.relight(&lighting),
                None => Ok(relight_streaming(&*container, &lighting)?.0),
            });
            // One that cannot be made is black, and the picture says why itself.
            let shape = container.shape();
            let image = made.unwrap_or_else(|_| LinearImage::black(shape.width(), shape.height()));
            Ok(Brought::SnapshotImage { name, revision, image: Arc::new(image) })
        });
    }
}
