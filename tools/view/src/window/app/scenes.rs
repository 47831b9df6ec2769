//! The window over a scene that is rendered.

use std::path::Path;

use eframe::egui::{self, Ui};

use super::App;
use crate::unsaved::LeftBehind;
use crate::window::chooser::Purpose;
use crate::window::outline_panel::outline_panel;
use crate::window::question::Question;
use crate::window::render_bar::{RenderChoice, render_bar};
use crate::window::rendering::Rendering;
use crate::window::theme::{LINE, PANEL, SURROUND};

impl App {
    /// Renders a scene.
    pub(super) fn render(&mut self, context: &egui::Context, path: &Path) {
        if let Some(mut old) = self.document.take() {
            old.autosave.forget();
        }
        self.message = None;
        // One job after the other: both may write the same container.
        self.rendering = None;
        self.rendering = Some(Rendering::start(context, path, self.choices.clone(), self.memory_bytes));
        let left = self.opening.state_folder.as_ref().and_then(|folder| LeftBehind::find(folder, path));
        self.left = left.filter(|_| self.screenshot.is_none());
    }

    /// Takes the newest estimate of a scene that is rendered, and shows how far it is.
    pub(super) fn show_rendering(&mut self, ui: &mut Ui) -> Option<RenderChoice> {
        let rendering = self.rendering.as_mut()?;
        rendering.receive(ui.ctx(), &mut self.document, &self.opening);
        if self.document.is_some() && self.question.is_none() {
            self.question = self.left.take().map(Question::LeftBehind);
        }
        let bar = egui::Frame::new().fill(PANEL).inner_margin(egui::Margin::symmetric(10, 4)).stroke((1.0, LINE));
        let document = self.document.as_mut();
        egui::Panel::bottom("render").frame(bar).show(ui, |ui| render_bar(ui, rendering, document)).inner
    }

    /// Does what was asked for in its bar, and moves its camera.
    pub(super) fn act_on_rendering(&mut self, context: &egui::Context, choice: Option<RenderChoice>) {
        let Some(rendering) = &mut self.rendering else { return };
        let moves = self.document.as_mut().map(|document| std::mem::take(&mut document.front.view.moves));
        rendering.take_moves(context, moves.unwrap_or_default());
        match choice {
            Some(RenderChoice::GoOn) => rendering.restart(context, self.memory_bytes),
            Some(RenderChoice::SaveCopy) => {
                if let Some(document) = &mut self.document {
                    document.files.wanted = Some(Purpose::SaveContainer);
                }
            }
            None => {}
        }
    }

    /// The screen before the first estimate: what the scene shows without its lights.
    pub(super) fn outline(&mut self, ui: &mut Ui) {
        let Some(rendering) = &mut self.rendering else { return };
        egui::CentralPanel::default().frame(egui::Frame::new().fill(SURROUND)).show(ui, |ui| {
            let outline = rendering.outline_id().zip(rendering.view.as_ref().map(|view| view.camera));
            let moves = outline_panel(ui, outline);
            rendering.take_moves(ui.ctx(), moves);
        });
    }
}
