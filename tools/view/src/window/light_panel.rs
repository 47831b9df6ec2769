//! The selected light: what it is, its colour, its texture.

use eframe::egui::{self, RichText, Ui};

use super::document::Document;
use super::pattern_editor::pattern_editor;
use super::theme::{WEAK, section, swatch};
use crate::mixer::{LightMix, Tint};
use ltm::image::KELVIN_RANGE;
use ltm::light::Light;

pub(super) fn light_panel(ui: &mut Ui, document: &mut Document) {
    let Some(index) = document.selected else {
        ui.label(RichText::new("Select a light, or click one in the picture.").color(WEAK));
        return;
    };
    let light = document.session.basis().lights()[index].clone();
    ui.add_space(6.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new(&light.name).size(15.0).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let touched = !document.mix.lights[index].is_like(&document.scene_mix.lights[index]);
            if ui.add_enabled(touched, egui::Button::new("Reset light")).clicked() {
                let solo = document.mix.lights[index].solo;
                document.mix.lights[index] = LightMix { solo, ..document.scene_mix.lights[index].clone() };
            }
        });
    });
    ui.label(RichText::new(describe(&light)).size(11.0).color(WEAK));
    section(ui, "COLOUR");
    colour(ui, &mut document.mix.lights[index], &light);
    if light.layout() != (1, 1) {
        pattern_editor(ui, document, index, &light);
    }
    ui.add_space(6.0);
}

/// Kind, texels and the radiometric value, in words.
fn describe(light: &Light) -> String {
    let [r, g, b] = light.emission;
    format!("{}  ·  {r:.3} {g:.3} {b:.3} {}", light.kind, light.unit)
}

/// Three ways to colour a light, whose brightness stays what it is.
fn colour(ui: &mut Ui, mix: &mut LightMix, light: &Light) {
    ui.horizontal(|ui| {
        let is = |tint: Tint, other: Tint| std::mem::discriminant(&tint) == std::mem::discriminant(&other);
        let now = mix.colour(light);
        let peak = now.into_iter().fold(1e-9, f32::max);
        let tints =
            [("Scene", Tint::Scene), ("Kelvin", Tint::Kelvin(3200.0)), ("Colour", Tint::Colour(now.map(|v| v / peak)))];
        for (name, tint) in tints {
            if ui.selectable_label(is(mix.tint, tint), name).clicked() && !is(mix.tint, tint) {
                mix.tint = tint;
            }
        }
        ui.add_space(6.0);
        match &mut mix.tint {
            Tint::Colour(colour) => {
                ui.color_edit_button_rgb(colour);
            }
            Tint::Scene | Tint::Kelvin(_) => {
                let (rect, _) = ui.allocate_exact_size(egui::vec2(40.0, 18.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 3.0, swatch(now));
            }
        }
    });
    // Its room is kept, so that nothing moves away from under the pointer.
    ui.horizontal(|ui| {
        ui.set_min_height(22.0);
        if let Tint::Kelvin(kelvin) = &mut mix.tint {
            let slider = egui::Slider::new(kelvin, KELVIN_RANGE).logarithmic(true).suffix(" K").max_decimals(0);
            ui.spacing_mut().slider_width = (ui.available_width() - 80.0).max(40.0);
            ui.add(slider);
        }
    });
}
