//! The row of tabs: the views of the scene under one mix.

use eframe::egui::{self, Button, RichText, Slider, Ui};

use super::actions::Action;
use super::document::{Document, Frames};
use super::theme::{ACCENT, TEXT, WEAK};
use ltm::resources::human_bytes;

/// Shows the tabs, if there are several; what is asked for.
pub(super) fn tabs(ui: &mut Ui, document: &mut Document, frame: egui::Frame) -> Option<Action> {
    if let Some(frames) = &document.frames {
        return frame_slider(ui, frames, frame);
    }
    if document.behind.is_empty() {
        return None;
    }
    let (mut action, mut closed) = (None, None);
    egui::Panel::top("views").frame(frame).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 2.0;
            for (tab, view) in document.views().enumerate() {
                let is_front = tab == document.at;
                let text = RichText::new(&view.name).color(if is_front { TEXT } else { WEAK });
                let button = ui.add(Button::selectable(is_front, text));
                if is_front {
                    ui.painter().hline(button.rect.x_range(), button.rect.bottom() - 0.5, (1.5, ACCENT));
                }
                let memory = match view.session.worker.is_awake() {
                    true => String::new(),
                    false => format!("\nRead when it is shown: needs up to {}", human_bytes(view.needed_bytes)),
                };
                let about = format!("{}{memory}", view.session.path.display());
                if button.on_hover_text(about).clicked() {
                    action = Some(Action::Tab(tab));
                }
                let close = ui.add(Button::new(RichText::new("×").color(WEAK)).frame(false));
                let name = format!("close {}", view.name);
                close.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name.clone()));
                if close.on_hover_text("Close the tab; your mix stays").clicked() {
                    closed = Some(tab);
                }
                ui.add_space(8.0);
            }
            if ui.button("Add view…").on_hover_text("Another container of this scene (Ctrl+Shift+O)").clicked() {
                action = Some(Action::AddView);
            }
        });
    });
    if let Some(tab) = closed {
        document.close_tab(tab);
    }
    action
}

/// A slider over the frames of an animation; what is asked for.
fn frame_slider(ui: &mut Ui, frames: &Frames, frame: egui::Frame) -> Option<Action> {
    let mut at = frames.at;
    egui::Panel::top("frames").frame(frame).show(ui, |ui| {
        ui.horizontal(|ui| {
            let text = format!("Frame {}  ({} of {})", frames.list[frames.at].0, frames.at + 1, frames.list.len());
            let width = ui.available_width();
            ui.label(RichText::new(text).color(TEXT));
            ui.spacing_mut().slider_width = (width - 220.0).max(80.0);
            let slider = ui.add(Slider::new(&mut at, 0..=frames.list.len() - 1).show_value(false));
            slider.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, "frame"));
            slider.on_hover_text("The frames under your mix (Page down, Page up)");
        });
    });
    (at != frames.at).then_some(Action::Frame(at))
}
