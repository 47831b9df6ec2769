//! The selected light: what it is, its colour, its texture.

use eframe::egui::{self, Color32, RichText, Ui};

use super::daylight_panel::daylight_settings;
use super::document::Document;
use super::message::Message;
use super::number_format::short;
use super::pattern_panel::pattern_editor;
use super::selection::{reset_light, share_tint};
use super::sun_panel::sun_of_several;
use super::theme::{ACCENT, IDLE, WEAK, section, swatch};
use crate::mixer::{LightMix, STOPS_RANGE, Tint};
use crate::photometry::{Quantity, mean_weight, quantities, stops_to};
use ltm::image::{KELVIN_RANGE, decode_srgb};
use ltm::light::{Light, LightKind};

pub(super) fn light_panel(ui: &mut Ui, document: &mut Document) {
    let Some(index) = document.list.selected() else {
        ui.label(RichText::new("Select a light, or click one in the picture.").color(WEAK));
        return;
    };
    let light = document.lights.lights()[index].clone();
    ui.add_space(6.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new(&light.name).size(15.0).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let touched = !document.work.mix.lights[index].is_like(&document.work.scene.lights[index]);
            if ui.add_enabled(touched, egui::Button::new("Reset light")).clicked() {
                reset_light(&mut document.work, index);
            }
        });
    });
    ui.label(RichText::new(describe(&light)).size(11.0).color(WEAK));
    if document.list.absent.contains(&index) {
        ui.label(RichText::new("Not in this view").size(11.0).color(ACCENT));
    }
    absolute(ui, document, index, &light);
    section(ui, "COLOUR");
    if colour(ui, &mut document.work.mix.lights[index], &light) {
        // Lights that are selected together are coloured together.
        share_tint(&document.list, &mut document.work.mix, index);
    }
    if light.kind == LightKind::Sun {
        sun_of_several(ui, document, index);
    }
    if light.kind.is_daylight() {
        daylight_settings(ui, document);
    }
    if light.layout() != (1, 1) {
        pattern_editor(ui, document, index, &light);
    }
    ui.add_space(6.0);
}

/// Kind, texels and what the scene's file says, in words.
fn describe(light: &Light) -> String {
    let [r, g, b] = light.emission;
    format!("{}  ·  in the scene {r:.3} {g:.3} {b:.3} {}", light.kind, light.unit)
}

/// How bright the light is, in the units that are known of it, to be read and typed. With several lights selected, those
/// that have the unit take the value too.
fn absolute(ui: &mut Ui, document: &mut Document, index: usize, light: &Light) {
    let known = quantities(light, document.metres_per_unit());
    if known.is_empty() {
        return;
    }
    section(ui, "INTENSITY");
    let weight = mean_weight(document.basis(), &document.work.mix, index);
    let mut typed = None;
    ui.horizontal_wrapped(|ui| {
        for (quantity, at_one) in known {
            let mut value = at_one * weight;
            // What is only passed by Tab comes back rounded as it is shown, and is no change.
            let (speed, before) = (value * 0.01, short(value as f32));
            let number = egui::DragValue::new(&mut value)
                .range(0.0..=f64::MAX)
                .speed(speed)
                .update_while_editing(false)
                .custom_formatter(|value, _| short(value as f32))
                .suffix(format!(" {}", quantity.unit()));
            if ui.add(number).on_hover_text(about(quantity)).changed() && short(value as f32) != before {
                typed = Some((quantity, value));
            }
        }
        if !document.work.mix.shines(index) {
            ui.label(RichText::new("when on").size(11.0).color(WEAK));
        }
    });
    if let Some((quantity, value)) = typed {
        set_absolute(document, index, quantity, value);
    }
}

fn about(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Luminance => "Mean luminance of the light, with the stops of its groups",
        Quantity::Intensity => "Luminous intensity: of a spot on its axis, of a measured luminaire at its peak",
        Quantity::Flux => "Luminous flux: of a surface that sends to one side evenly, of a point all around",
        Quantity::Power => "Radiant flux, at the 179 lm/W of white light",
        Quantity::Illuminance => "Illuminance on a plane that faces the light",
    }
}

fn set_absolute(document: &mut Document, index: usize, quantity: Quantity, value: f64) {
    let metres = document.metres_per_unit();
    let (least, most) = (*STOPS_RANGE.start(), *STOPS_RANGE.end());
    let mut out_of_range = false;
    let all = document.list.chosen().iter().copied().filter(|&other| other != index).chain([index]);
    for light in all.collect::<Vec<_>>() {
        let known = quantities(&document.lights.lights()[light], metres);
        let Some((_, at_one)) = known.into_iter().find(|(own, _)| *own == quantity) else { continue };
        let now = at_one * mean_weight(document.basis(), &document.work.mix, light);
        let own = &mut document.work.mix.lights[light].stops;
        match stops_to(now, value) {
            Some(stops) => {
                let wanted = *own + stops;
                // A rounding's width beyond the range is within it.
                out_of_range |= wanted < least - 1e-3 || wanted > most + 1e-3;
                *own = wanted.clamp(least, most);
            }
            None => out_of_range = true,
        }
    }
    if out_of_range {
        let text = format!("A light goes {most} EV up or down from the scene's, no further");
        document.message = Some(Message::problem(text));
    }
}

/// The colour of a light in its row, behind which it can be changed.
pub(super) fn colour_popup(ui: &mut Ui, document: &mut Document, index: usize, light: &Light, shown: Color32) {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(12.0, 18.0), egui::Sense::click());
    let chip = egui::Rect::from_center_size(rect.center(), egui::vec2(12.0, 12.0));
    ui.painter().rect_filled(chip, 2.0, shown);
    let edge = if response.hovered() || response.has_focus() { Color32::WHITE } else { IDLE };
    ui.painter().rect_stroke(chip, 2.0, (1.0, edge), egui::StrokeKind::Inside);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{}, colour", light.name)));
    let about = match document.work.mix.lights[index].tint {
        Tint::Scene => "Colour: the scene's".to_owned(),
        Tint::Kelvin(kelvin) => format!("Colour: {kelvin:.0} K"),
        Tint::Colour(colour) => format!("Colour: {}", hex_of(colour)),
    };
    let behaviour = egui::PopupCloseBehavior::CloseOnClickOutside;
    egui::Popup::menu(&response).close_behavior(behaviour).show(|ui| {
        ui.set_min_width(250.0);
        ui.label(RichText::new(&light.name).strong());
        if colour(ui, &mut document.work.mix.lights[index], light) {
            // Lights that are selected together are coloured together.
            share_tint(&document.list, &mut document.work.mix, index);
        }
    });
    response.on_hover_text(about);
}

/// A linear colour as `#rrggbb`, its largest channel brought to white as the panel shows it.
fn hex_of(colour: [f32; 3]) -> String {
    let [r, g, b, _] = swatch(colour).to_array();
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The linear colour that `#rrggbb` means; none where it means none, or black, which no light has.
fn of_hex(text: &str) -> Option<[f32; 3]> {
    let digits = text.trim().trim_start_matches('#');
    let number = u32::from_str_radix(digits, 16).ok().filter(|number| digits.len() == 6 && *number != 0)?;
    Some([16, 8, 0].map(|shift| decode_srgb(((number >> shift) & 255) as f32 / 255.0)))
}

/// Three ways to colour a light, whose brightness stays what it is; whether it was changed.
fn colour(ui: &mut Ui, mix: &mut LightMix, light: &Light) -> bool {
    let before = mix.tint;
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
                hex_field(ui, colour);
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
    mix.tint != before
}

/// A colour as text, to be read, copied and typed.
fn hex_field(ui: &mut Ui, colour: &mut [f32; 3]) {
    let id = ui.scope_id().with("hex");
    let typed = ui.data_mut(|data| data.get_temp::<String>(id));
    let mut text = typed.unwrap_or_else(|| hex_of(*colour));
    let field = egui::TextEdit::singleline(&mut text).desired_width(64.0).font(egui::TextStyle::Monospace);
    let response = ui.add(field).on_hover_text("sRGB as #rrggbb; the brightness stays");
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "hex colour"));
    if response.has_focus() {
        ui.data_mut(|data| data.insert_temp(id, text));
    } else if response.lost_focus() {
        ui.data_mut(|data| data.remove_temp::<String>(id));
        if let Some(typed) = of_hex(&text) {
            *colour = typed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_goes_to_text_and_back() {
        for text in ["#ff8000", "#ffffff", "#00ff7f"] {
            assert_eq!(hex_of(of_hex(text).unwrap()), text);
        }
        assert_eq!(of_hex(" FF8000 "), of_hex("#ff8000"));
        for none in ["", "#000000", "#ff80", "#gg8000", "#ff80001"] {
            assert_eq!(of_hex(none), None, "{none}");
        }
    }
}
