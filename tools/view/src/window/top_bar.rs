//! The bar above: everything that has no place of its own, with its key beside it.

use std::path::PathBuf;

use eframe::egui::{self, Button, RichText, Ui};

use super::actions::Action;
use super::document::Document;
use super::keys::keys_of;
use super::theme::{ACCENT, WEAK};
use crate::recent::{Recent, RecentKind};

/// The user's choice in the top bar.
pub(super) enum Choice {
    Act(Action),
    Open(PathBuf),
    Look(PathBuf),
}

pub(super) fn top_bar(ui: &mut Ui, document: &Document, recent: &Recent) -> Option<Choice> {
    let mut choice = None;
    egui::MenuBar::new().ui(ui, |ui| {
        let shown = document.front.shown.image.is_some();
        let has_tabs = document.frames.is_none() && !document.behind.is_empty();
        let comparing = document.front.compare.snapshots.compared().is_some();
        ui.menu_button("File", |ui| {
            ui.set_min_width(250.0);
            item(ui, &mut choice, Action::Open, "Open…", true);
            ui.menu_button("Open recent", |ui| {
                if let Some(path) = recent_files(ui, recent, RecentKind::Container) {
                    choice = Some(Choice::Open(path));
                }
            });
            item(ui, &mut choice, Action::AddView, "Add view…", true);
            item(ui, &mut choice, Action::CloseTab, "Close the tab", has_tabs);
            item(ui, &mut choice, Action::Reload, "Reload, keeping your mix", true);
            ui.separator();
            item(ui, &mut choice, Action::Png, "Picture as PNG…", shown);
            item(ui, &mut choice, Action::Exr, "Radiance as EXR…", shown);
            item(ui, &mut choice, Action::Layers, "EXR with a layer per light…", shown);
            item(ui, &mut choice, Action::CopyPicture, "Copy the picture", shown);
            item(ui, &mut choice, Action::CopyCommand, "Copy the command line", shown);
            ui.separator();
            item(ui, &mut choice, Action::Quit, "Quit", true);
        });
        ui.menu_button("Edit", |ui| {
            ui.set_min_width(250.0);
            item(ui, &mut choice, Action::Undo, "Undo", document.work.can_undo());
            item(ui, &mut choice, Action::Redo, "Redo", document.work.can_redo());
            item(ui, &mut choice, Action::ResetLights, "Reset to the scene's own", true);
            ui.separator();
            item(ui, &mut choice, Action::AllOn, "All on", true);
            item(ui, &mut choice, Action::AllOff, "All off", true);
            item(ui, &mut choice, Action::Switch, "Selected on or off", true);
            item(ui, &mut choice, Action::Solo, "Selected solo", true);
            ui.separator();
            item(ui, &mut choice, Action::AllLights, "Select all", true);
            item(ui, &mut choice, Action::Group, "Group", true);
            item(ui, &mut choice, Action::Ungroup, "Ungroup", true);
        });
        ui.menu_button("Look", |ui| {
            ui.set_min_width(250.0);
            item(ui, &mut choice, Action::LoadLook, "Load…", true);
            item(ui, &mut choice, Action::SaveLook, "Save…", true);
            ui.menu_button("Load recent", |ui| {
                if let Some(path) = recent_files(ui, recent, RecentKind::Look) {
                    choice = Some(Choice::Look(path));
                }
            });
        });
        ui.menu_button("View", |ui| {
            ui.set_min_width(250.0);
            item(ui, &mut choice, Action::NextTab, "Next tab", has_tabs);
            item(ui, &mut choice, Action::LastTab, "Previous tab", has_tabs);
            ui.separator();
            item(ui, &mut choice, Action::Fit, "Fit", true);
            item(ui, &mut choice, Action::ActualSize, "Actual size", true);
            let way = if document.front.view.is_around { "See the panorama flat" } else { "Look around" };
            item(ui, &mut choice, Action::LookAround, way, document.front.view.look.is_some());
            item(ui, &mut choice, Action::Normalise, "Automatic exposure", shown);
            item(ui, &mut choice, Action::NextCurve, "Next tone curve", true);
            ui.separator();
            item(ui, &mut choice, Action::Snapshot, "Take a snapshot", shown);
            item(ui, &mut choice, Action::Reference, "Compare with an image…", true);
            item(ui, &mut choice, Action::Other, "See it whole", comparing);
            item(ui, &mut choice, Action::Difference, "See the difference", comparing);
            ui.separator();
            item(ui, &mut choice, Action::Panels, "Panels", true);
            item(ui, &mut choice, Action::Larger, "Larger letters", true);
            item(ui, &mut choice, Action::Smaller, "Smaller letters", true);
            item(ui, &mut choice, Action::FullScreen, "Full screen", true);
            item(ui, &mut choice, Action::Help, "Keys", true);
        });
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let provenance = &document.front.session.container.job().provenance;
            let name = document.front.session.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let label = ui.label(RichText::new(name).color(WEAK));
            let look = document.work.look().and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
            match (document.is_modified(), look) {
                (true, Some(look)) => ui.label(RichText::new(format!("• {look}, not saved")).color(ACCENT)),
                (true, None) => ui.label(RichText::new("• Not saved").color(ACCENT)),
                (false, Some(look)) => ui.label(RichText::new(look).color(WEAK)),
                (false, None) => ui.label(""),
            };
            let samples = match provenance.samples_per_pixel {
                0 => String::new(),
                samples => format!("\n{samples} samples per pixel"),
            };
            label.on_hover_text(format!(
                "{}\nof {}{samples}",
                document.front.session.path.display(),
                provenance.source
            ));
        });
    });
    choice
}

/// An action in a menu.
fn item(ui: &mut Ui, choice: &mut Option<Choice>, action: Action, name: &str, enabled: bool) {
    let button = Button::new(name).shortcut_text(RichText::new(keys_of(action)).color(WEAK));
    if ui.add_enabled(enabled, button).clicked() {
        *choice = Some(Choice::Act(action));
    }
}

/// The remembered files of a kind as buttons; the one that was chosen.
pub(super) fn recent_files(ui: &mut Ui, recent: &Recent, kind: RecentKind) -> Option<PathBuf> {
    let mut chosen = None;
    if recent.of(kind).next().is_none() {
        ui.label(RichText::new("None yet").color(WEAK));
    }
    for path in recent.of(kind) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
            chosen = Some(path.to_owned());
        }
    }
    chosen
}
