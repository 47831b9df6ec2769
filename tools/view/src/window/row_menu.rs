//! Menus of the mixer's rows.

use eframe::egui::{self, Color32, Ui};

use super::document::Document;
use super::renaming::Renaming;
use super::selection;
use super::theme::WEAK;

/// Colours that groups are told apart by: of about one lightness, names for those who cannot tell them apart.
const COLOURS: [(&str, [u8; 3]); 7] = [
    ("Red", [214, 96, 84]),
    ("Orange", [222, 146, 66]),
    ("Yellow", [206, 184, 76]),
    ("Green", [104, 178, 104]),
    ("Blue", [96, 150, 222]),
    ("Violet", [164, 122, 216]),
    ("Grey", [150, 150, 150]),
];

fn item(ui: &mut Ui, name: &str, enabled: bool) -> bool {
    ui.add_enabled(enabled, egui::Button::new(name)).clicked()
}

/// The menu of a light, which speaks of all selected lights where it is one of them.
pub(super) fn light_menu(ui: &mut Ui, document: &mut Document, light: usize) {
    ui.set_min_width(190.0);
    let count = document.list.chosen().len();
    if count > 1 {
        ui.label(egui::RichText::new(format!("{count} lights")).color(WEAK));
    }
    let any_on = document.list.chosen().iter().any(|&light| document.work.mix.lights[light].on);
    if item(ui, if any_on { "Switch off" } else { "Switch on" }, true) {
        selection::switch(&document.list, &mut document.work.mix);
    }
    if item(ui, "Solo", true) {
        selection::solo(&document.list, &mut document.work.mix);
    }
    ui.separator();
    if item(ui, "Copy settings", true) {
        document.list.copied = Some(document.work.mix.lights[light].clone());
    }
    if item(ui, "Paste settings", document.list.copied.is_some()) {
        selection::paste(&document.list, document.lights.basis(), &mut document.work.mix);
    }
    if item(ui, "Reset", true) {
        selection::reset(&document.list, &mut document.work);
    }
    ui.separator();
    if item(ui, "Make a group", true) {
        selection::group(&mut document.list, &mut document.work.mix);
    }
    let names: Vec<String> = document.work.mix.groups.list().iter().map(|group| group.name.clone()).collect();
    ui.menu_button("Move to group", |ui| {
        egui::ScrollArea::vertical().max_height(300.0).show(ui, |ui| {
            for (group, name) in names.iter().enumerate() {
                if item(ui, name, true) {
                    selection::move_to_group(&mut document.list, &mut document.work.mix, Some(group));
                }
            }
            if item(ui, "None", true) {
                selection::move_to_group(&mut document.list, &mut document.work.mix, None);
            }
        });
    });
}

/// The menu of a group.
pub(super) fn group_menu(ui: &mut Ui, document: &mut Document, group: usize) {
    ui.set_min_width(190.0);
    let Some(own) = document.work.mix.groups.list().get(group).cloned() else { return };
    if item(ui, if own.on { "Switch off" } else { "Switch on" }, true) {
        document.work.mix.groups.group_mut(group).on = !own.on;
    }
    if item(ui, "Solo", true) {
        document.work.mix.toggle_group_solo(group, false);
    }
    if item(ui, "Paste settings to its lights", document.list.copied.is_some()) {
        document.list.select_all(document.work.mix.groups.lights(group));
        selection::paste(&document.list, document.lights.basis(), &mut document.work.mix);
    }
    ui.separator();
    if item(ui, "Rename", true) {
        document.list.renamed = Some(Renaming::of(group, &own.name));
    }
    ui.menu_button("Colour", |ui| {
        for (name, colour) in COLOURS {
            let [r, g, b] = colour;
            let text = egui::RichText::new(name).color(Color32::from_rgb(r, g, b));
            if ui.button(text).clicked() {
                document.work.mix.groups.group_mut(group).colour = Some(colour);
            }
        }
        if item(ui, "None", own.colour.is_some()) {
            document.work.mix.groups.group_mut(group).colour = None;
        }
    });
    ui.menu_button("Put into", |ui| {
        let groups = &document.work.mix.groups;
        let fits: Vec<(usize, String)> = (0..groups.len())
            .filter(|&other| !groups.is_inside(other, group) && own.parent != Some(other))
            .map(|other| (other, groups.group(other).name.clone()))
            .collect();
        for (other, name) in fits {
            if item(ui, &name, true) {
                document.work.mix.groups.nest(group, Some(other));
            }
        }
        if item(ui, "None", own.parent.is_some()) {
            document.work.mix.groups.nest(group, None);
        }
    });
    if item(ui, "Ungroup", true) {
        document.work.mix.groups.dissolve(group);
        document.list.renamed = None;
    }
}
