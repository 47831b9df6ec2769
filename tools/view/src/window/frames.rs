//! The frames of an animation as views under one mix, of which some are open.

use std::cmp::Reverse;
use std::path::PathBuf;

use eframe::egui;

use super::document::{Document, Frames};
use ltm::error::Result;

/// Frames that are open at the same time.
const MOST_OPEN: usize = 8;

impl Document {
    /// Makes this, which shows the first of some frames, go through them all: their numbers and containers.
    pub(super) fn go_through(&mut self, list: Vec<(usize, PathBuf)>) {
        self.frames = Some(Frames { list, at: 0 });
    }

    /// Shows a frame, by its place among them, where the one before it stands.
    ///
    /// Errors: those of opening it; the frame in front stays.
    pub(super) fn show_frame(&mut self, context: &egui::Context, at: usize) -> Result<()> {
        let Some((_, path)) = self.frames.as_ref().and_then(|frames| frames.list.get(at)).cloned() else {
            return Ok(());
        };
        let found = self.views().position(|view| view.session.path == path);
        let tab = match found {
            Some(tab) => tab,
            None => {
                self.add_view(context, &path)?;
                self.behind.len()
            }
        };
        let (viewport, size, seen) = (self.front.view.viewport, self.size(), self.front.shown.handle());
        let (look, is_around) = (self.front.view.look, self.front.view.is_around);
        self.show_tab(tab);
        if self.size() == size {
            self.front.view.viewport = viewport;
            self.front.view.look_as(look, is_around);
        }
        self.front.shown.stand_in(seen);
        if let Some(frames) = &mut self.frames {
            frames.at = at;
        }
        // Not while files are written: the frame they are of brings what has become of them.
        while self.behind.len() >= MOST_OPEN && !self.files.any_open() {
            let others = self.views().enumerate().filter(|(tab, _)| *tab != self.at);
            let Some((oldest, _)) = others.max_by_key(|(_, view)| Reverse(view.seen_at)) else { break };
            self.close_tab(oldest);
        }
        Ok(())
    }

    /// Shows the next frame, or the one before.
    ///
    /// Errors: as for [`show_frame`](Self::show_frame).
    pub(super) fn step_frame(&mut self, context: &egui::Context, back: bool) -> Result<()> {
        let at = self.frames.as_ref().map_or(0, |frames| frames.at);
        self.show_frame(context, if back { at.saturating_sub(1) } else { at + 1 })
    }
}
