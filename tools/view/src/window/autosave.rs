//! Writing the work down as it goes, in case the window ends by force.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui;

use crate::looks::{self, Saved};
use crate::mixer::Mix;
use crate::unsaved::{LeftBehind, Unsaved};
use crate::work::Work;
use crate::worker::{Brought, Worker};
use ltm::error::Result;
use ltm::light::LightBasis;

/// How long the work must have rested before it is written down.
const REST: Duration = Duration::from_millis(700);

/// What is said where the work cannot be written down.
pub(super) const NOT_KEPT: &str = "unsaved work is not kept";

/// A state of the work: the mix, and the revision of the snapshots.
struct WorkState {
    mix: Mix,
    revision: u64,
}

impl WorkState {
    fn is_of(&self, work: &Work, revision: u64) -> bool {
        self.mix == work.mix && self.revision == revision
    }
}

/// Autosave of the work on the views of a scene.
pub(super) struct Autosave {
    state_folder: Option<PathBuf>,
    /// The file that the work belongs to: the container that was opened first, or the scene that is rendered.
    work_of: PathBuf,
    place: Option<Unsaved>,
    /// The state that was written last, or is being written.
    written: Option<WorkState>,
    /// The current state, and since when it has not changed.
    resting: Option<(WorkState, Instant)>,
    is_writing: bool,
    /// Work of an earlier window that is part of this one's: it stays until that is written down or saved.
    pub(super) recovered: Option<LeftBehind>,
}

impl Autosave {
    /// Without a state folder nothing is saved.
    pub(super) fn new(state_folder: Option<PathBuf>, work_of: PathBuf) -> Self {
        Self { state_folder, work_of, place: None, written: None, resting: None, is_writing: false, recovered: None }
    }

    /// Goes on in a document that was opened anew: what the old one's worker was writing is not heard of any more.
    pub(super) fn go_on(&mut self) {
        (self.is_writing, self.written) = (false, None);
    }

    /// Takes away what was written: the work is saved, or is not wanted.
    pub(super) fn forget(&mut self) {
        self.place.take().into_iter().for_each(Unsaved::forget);
        self.recovered.take().into_iter().for_each(LeftBehind::forget);
        self.written = None;
    }

    /// Whether the work is to be written down, because it rests; `held` while a drag is on. The snapshots are at `revision`.
    pub(super) fn is_due(&mut self, context: &egui::Context, work: &Work, revision: u64, held: bool) -> bool {
        if self.state_folder.is_none() {
            return false;
        }
        if !work.is_modified(revision) {
            // While it is being written, its folder stays; what follows takes it away.
            if !self.is_writing && self.place.is_some() {
                self.forget();
            }
            return false;
        }
        if held || self.is_writing || self.written.as_ref().is_some_and(|state| state.is_of(work, revision)) {
            return false;
        }
        let Some((_, since)) = self.resting.as_ref().filter(|(state, _)| state.is_of(work, revision)) else {
            self.resting = Some((WorkState { mix: work.mix.clone(), revision }, Instant::now()));
            context.request_repaint_after(REST);
            return false;
        };
        let left = REST.checked_sub(since.elapsed()).filter(|left| !left.is_zero());
        left.into_iter().for_each(|left| context.request_repaint_after(left));
        left.is_none()
    }

    /// Writes the work on these lights down, beside the worker.
    ///
    /// Errors: there is no place for it; it is not tried again.
    pub(super) fn write(&mut self, worker: &Worker, basis: &LightBasis, saved: Saved, revision: u64) -> Result<()> {
        let Some(state_folder) = &self.state_folder else { return Ok(()) };
        if self.place.is_none() {
            match Unsaved::begin(state_folder, &self.work_of) {
                Ok(place) => self.place = Some(place),
                Err(error) => {
                    // Not once more in each frame.
                    self.state_folder = None;
                    return Err(error);
                }
            }
        }
        let Some(look) = self.place.as_ref().map(Unsaved::look) else { return Ok(()) };
        (self.written, self.is_writing) = (Some(WorkState { mix: saved.mix.clone(), revision }), true);
        let basis = basis.clone();
        worker.beside(move || Ok(Brought::Unsaved(looks::save(&look, &basis, &saved, true))));
        Ok(())
    }

    /// Takes note that the work was written down, or could not be.
    pub(super) fn take(&mut self, outcome: Result<()>) -> Result<()> {
        self.is_writing = false;
        if outcome.is_ok() {
            self.recovered.take().into_iter().for_each(LeftBehind::forget);
        }
        outcome
    }
}
