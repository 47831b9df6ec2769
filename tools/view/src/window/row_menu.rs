//! Menus of the mixer's rows, and what is done to several lights at once.

use eframe::egui::{self, Color32, Ui};

use super::document::Document;
use super::theme::WEAK;
use crate::mixer::LightMix;

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

impl Document {
    /// Makes a group of the selected lights, whose name can be typed at once.
    pub(super) fn group_chosen(&mut self) {
        let lights: Vec<usize> = self.list.chosen().iter().copied().collect();
        let group = self.work.mix.groups.make("Group", &lights);
        let Some(group) = group else { return };
        let groups = &self.work.mix.groups;
        for around in std::iter::successors(Some(group), |&group| groups.group(group).parent) {
            self.list.folded.remove(&groups.group(around).name);
        }
        self.list.search.clear();
        self.list.renamed = Some((group, groups.group(group).name.clone()));
        if let Some(&first) = lights.first() {
            self.list.select_all(lights.iter().copied());
            self.list.scroll_to_selected = first > 0;
        }
    }

    /// Takes the innermost groups of the selected lights away.
    pub(super) fn ungroup_chosen(&mut self) {
        let groups = &mut self.work.mix.groups;
        let of_chosen = |groups: &crate::groups::Groups, light: usize| groups.of_light(light);
        let mut names: Vec<String> = Vec::new();
        for &light in self.list.chosen() {
            if let Some(group) = of_chosen(groups, light) {
                names.push(groups.group(group).name.clone());
            }
        }
        for name in names {
            if let Some(group) = groups.find(&name) {
                groups.dissolve(group);
            }
        }
        self.list.renamed = None;
    }

    /// Puts the selected lights into a group, or into none.
    fn put_chosen(&mut self, group: Option<usize>) {
        let name = group.map(|group| self.work.mix.groups.group(group).name.clone());
        for &light in self.list.chosen() {
            // An emptied group moves the indices of others.
            let group = name.as_ref().and_then(|name| self.work.mix.groups.find(name));
            self.work.mix.groups.put(light, group);
        }
        self.list.renamed = None;
    }

    /// Switches the selected lights: off where any of them is on.
    pub(super) fn switch_chosen(&mut self) {
        let lights = &mut self.work.mix.lights;
        let on = !self.list.chosen().iter().any(|&light| lights[light].on);
        self.list.chosen().iter().for_each(|&light| lights[light].on = on);
    }

    /// Solo on the selected lights together, or an end of it.
    pub(super) fn solo_chosen(&mut self) {
        let chosen = self.list.chosen();
        let lights = &self.work.mix.lights;
        let is_so = (0..lights.len()).all(|light| lights[light].solo == chosen.contains(&light));
        self.work.mix.clear_solo();
        if !is_so {
            chosen.iter().for_each(|&light| self.work.mix.lights[light].solo = true);
        }
    }

    /// Gives the selected lights the settings that were copied; a texture only where it fits.
    fn paste(&mut self) {
        let Some(copied) = self.list.copied.clone() else { return };
        for &light in self.list.chosen() {
            let own = &mut self.work.mix.lights[light];
            let size = self.session.basis().lights()[light].layout();
            let fits = copied.pattern.as_ref().is_none_or(|pattern| pattern.size() == size);
            let LightMix { on, stops, tint, .. } = copied;
            *own = match fits {
                true => LightMix { solo: own.solo, ..copied.clone() },
                false => LightMix { on, stops, tint, ..own.clone() },
            };
        }
    }

    fn reset_chosen(&mut self) {
        for &light in self.list.chosen() {
            let solo = self.work.mix.lights[light].solo;
            self.work.mix.lights[light] = LightMix { solo, ..self.work.scene.lights[light].clone() };
        }
    }
}

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
        document.switch_chosen();
    }
    if item(ui, "Solo", true) {
        document.solo_chosen();
    }
    ui.separator();
    if item(ui, "Copy settings", true) {
        document.list.copied = Some(document.work.mix.lights[light].clone());
    }
    if item(ui, "Paste settings", document.list.copied.is_some()) {
        document.paste();
    }
    if item(ui, "Reset", true) {
        document.reset_chosen();
    }
    ui.separator();
    if item(ui, "Make a group", true) {
        document.group_chosen();
    }
    let names: Vec<String> = document.work.mix.groups.list().iter().map(|group| group.name.clone()).collect();
    ui.menu_button("Move to group", |ui| {
        egui::ScrollArea::vertical().max_height(300.0).show(ui, |ui| {
            for (group, name) in names.iter().enumerate() {
                if item(ui, name, true) {
                    document.put_chosen(Some(group));
                }
            }
            if item(ui, "None", true) {
                document.put_chosen(None);
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
        document.paste();
    }
    ui.separator();
    if item(ui, "Rename", true) {
        document.list.renamed = Some((group, own.name.clone()));
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
