//! Where the panels stand: beside the picture where there is room, else behind tabs at its left.

use eframe::egui::{self, Color32, Margin, RichText, Ui, vec2};

use super::actions::Action;
use super::document::Document;
use super::light_panel::light_panel;
use super::mixer_panel::mixer;
use super::picture_panel::picture;
use super::status::status;
use super::tabs_panel::tabs;
use super::theme::{ACCENT, LINE, PANEL, SELECTED, SURROUND, TEXT, WEAK};
use super::top_bar::{Choice, top_bar};
use super::view_panel::view_panel;
use crate::file_watch::FileChange;
use crate::recent::Recent;

/// Points across from which the picture has room between two panels, and points down from which the mixer has room
/// over the selected light.
const WIDE: f32 = 1040.0;
const HIGH: f32 = 640.0;

/// Content of a single panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Tab {
    #[default]
    Lights,
    Light,
    View,
}

/// Draws the bars, the panels and the picture.
pub(super) fn show_document(
    ui: &mut Ui,
    document: &mut Document,
    panels: bool,
    tab: &mut Tab,
    recent: &Recent,
) -> Option<Choice> {
    let room = ui.ctx().content_rect().size();
    let frame = |fill: Color32, margin: Margin| egui::Frame::new().fill(fill).inner_margin(margin);
    let bar = frame(PANEL, Margin::symmetric(10, 4)).stroke((1.0, LINE));
    let choice = egui::Panel::top("bar").frame(bar).show(ui, |ui| top_bar(ui, document, recent)).inner;
    let choice = changed_on_disk(ui, document, bar).or(choice);
    let choice = tabs(ui, document, bar).map(Choice::Act).or(choice);
    egui::Panel::bottom("status").frame(bar).show(ui, |ui| status(ui, document));
    let side = frame(PANEL, Margin::symmetric(10, 0));
    let (wide, high) = (room.x >= WIDE, room.y >= HIGH);
    document.list.rect = egui::Rect::NOTHING;
    if panels {
        let left = match (wide, high) {
            (true, true) => egui::Panel::left("mixer").default_size(356.0).size_range(300.0..=640.0),
            // A panel of its own, so that each keeps the width that it was given.
            _ => egui::Panel::left("tabs").default_size(300.0).size_range(270.0..=440.0),
        };
        let left = left.frame(side).show(ui, |ui| {
            if wide && high {
                egui::Panel::bottom("light").frame(egui::Frame::new()).show(ui, |ui| light_panel(ui, document));
                return mixer(ui, document, true);
            }
            let tabs = [(Tab::Lights, "Lights"), (Tab::Light, "Light"), (Tab::View, "View")];
            let tabs = if wide { &tabs[..2] } else { &tabs };
            if !tabs.iter().any(|(own, _)| own == tab) {
                *tab = Tab::Lights;
            }
            choose_tab(ui, tabs, tab);
            match tab {
                Tab::Lights => mixer(ui, document, false),
                Tab::View => view_panel(ui, document),
                Tab::Light => {
                    egui::ScrollArea::vertical()
                        .id_salt("light panel")
                        .auto_shrink(false)
                        .show(ui, |ui| light_panel(ui, document));
                }
            }
        });
        if wide || *tab != Tab::View {
            document.list.rect = left.response.rect;
        }
        if wide {
            let right = egui::Panel::right("view").frame(side).default_size(300.0).size_range(270.0..=460.0);
            right.show(ui, |ui| view_panel(ui, document));
        }
    }
    egui::CentralPanel::default().frame(frame(SURROUND, Margin::ZERO)).show(ui, |ui| picture(ui, document));
    choice
}

/// Says that the open file is no longer the one that was opened, with what can be done.
fn changed_on_disk(ui: &mut Ui, document: &mut Document, bar: egui::Frame) -> Option<Choice> {
    let change = document.front.files.changed?;
    let name = document.front.session.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_there = change != FileChange::Gone;
    let text = match is_there {
        true => format!("{name} has changed on disk: the picture is that of the older file."),
        false => format!("{name} is no longer on disk: the picture is what was read of it."),
    };
    let (mut choice, mut dismissed) = (None, false);
    egui::Panel::top("changed").frame(bar.fill(SELECTED)).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(text).color(TEXT));
            if is_there && ui.button("Reload and keep my mix").clicked() {
                choice = Some(Choice::Act(Action::Reload));
            }
            dismissed = ui.button("Dismiss").clicked();
        });
    });
    if dismissed {
        document.front.files.changed = None;
    }
    choice
}

/// A row of tabs across the panel, a line under the open one.
fn choose_tab(ui: &mut Ui, tabs: &[(Tab, &str)], open: &mut Tab) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 0.0;
        let size = vec2(ui.available_width() / tabs.len() as f32, 24.0);
        for &(tab, name) in tabs {
            let is_open = *open == tab;
            let text = RichText::new(name).color(if is_open { TEXT } else { WEAK });
            let button = egui::Button::new(text).frame(false);
            let response = ui.add_sized(size, button);
            let (colour, width) = if is_open { (ACCENT, 1.5) } else { (LINE, 1.0) };
            ui.painter().hline(response.rect.x_range(), response.rect.bottom() - 0.5, (width, colour));
            if response.clicked() {
                *open = tab;
            }
        }
    });
}
