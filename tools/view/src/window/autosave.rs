//! Writing the work down as it goes, in case the window ends by force.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui;

use super::document::Document;
use crate::looks;
use crate::mixer::Mix;
use crate::unsaved::{LeftBehind, Unsaved};
use crate::words::line;
use crate::worker::Brought;
use ltm::error::Result;

/// How long the work must have rested before it is written down.
const REST: Duration = Duration::from_millis(700);

/// Autosave of the work on one container.
#[derive(Default)]
pub(super) struct Autosave {
    state_folder: Option<PathBuf>,
    place: Option<Unsaved>,
    /// The state that was written last, or is being written.
    written: Option<(Mix, u64)>,
    /// The current state, and since when it has not changed.
    resting: Option<(Mix, u64, Instant)>,
    is_writing: bool,
    /// Work of an earlier window that is part of this one's: it stays until that is written down or saved.
    pub(super) recovered: Option<LeftBehind>,
}

impl Autosave {
    /// Without a state folder nothing is saved.
    pub(super) fn new(state_folder: Option<PathBuf>) -> Self {
        Self { state_folder, ..Default::default() }
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
}

impl Document {
    /// Writes the work down once it rests; `held` while a drag is on.
    pub(super) fn autosave(&mut self, context: &egui::Context, held: bool) {
        let Some(state_folder) = self.autosave.state_folder.clone() else { return };
        let revision = self.compare.snapshots.revision();
        if !self.work.is_modified(revision) {
            // While it is being written, its folder stays; what follows takes it away.
            if !self.autosave.is_writing && self.autosave.place.is_some() {
                self.autosave.forget();
            }
            return;
        }
        let now = || (self.work.mix.clone(), revision);
        let is = |of: (&Mix, u64)| *of.0 == self.work.mix && of.1 == revision;
        if held || self.autosave.is_writing || self.autosave.written.as_ref().is_some_and(|(mix, at)| is((mix, *at))) {
            return;
        }
        let since = self.autosave.resting.as_ref().filter(|(mix, at, _)| is((mix, *at))).map(|(_, _, since)| *since);
        let Some(since) = since else {
            let (mix, revision) = now();
            self.autosave.resting = Some((mix, revision, Instant::now()));
            return context.request_repaint_after(REST);
        };
        if let Some(left) = REST.checked_sub(since.elapsed()).filter(|left| !left.is_zero()) {
            return context.request_repaint_after(left);
        }
        if self.autosave.place.is_none() {
            match Unsaved::begin(&state_folder, &self.session.path) {
                Ok(place) => self.autosave.place = Some(place),
                Err(error) => {
                    self.files.message = Some((format!("unsaved work is not kept: {}", line(&error)), true));
                    // Not once more in each frame.
                    self.autosave.state_folder = None;
                    return;
                }
            }
        }
        let Some(look) = self.autosave.place.as_ref().map(Unsaved::look) else { return };
        (self.autosave.written, self.autosave.is_writing) = (Some(now()), true);
        let (container, saved) = (self.session.container.clone(), self.saved());
        let write = move || Ok(Brought::Unsaved(looks::save(&look, &container.job().basis, &saved, true)));
        self.session.worker.beside(write);
    }

    /// Takes note that the work was written down.
    pub(super) fn autosaved(&mut self, outcome: Result<()>) {
        self.autosave.is_writing = false;
        match outcome {
            Ok(()) => self.autosave.recovered.take().into_iter().for_each(LeftBehind::forget),
            Err(error) => self.files.message = Some((format!("unsaved work is not kept: {}", line(&error)), true)),
        }
    }
}
