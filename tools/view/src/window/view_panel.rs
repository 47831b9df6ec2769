//! How the picture is shown: exposure, white, histogram, probe; snapshots; export.

use eframe::egui::{self, Color32, Rect, RichText, Sense, Ui, pos2, vec2};

use super::actions::{Action, act};
use super::document::Document;
use super::features_panel::features;
use super::meter_panel::light_meter;
use super::number_format::short;
use super::snapshots_panel::snapshots;
use super::theme::{WEAK, section};
use crate::display::{BINS, CURVES, NEUTRAL_KELVIN, STOPS_SHOWN};
use crate::meter::Measured;
use ltm::image::{LinearImage, encode_srgb, false_colour, luminance};
use ltm::light::LightUnit;

/// Red, green and blue in graphs, of about one lightness.
const CHANNEL_SHADES: [Color32; 3] =
    [Color32::from_rgb(206, 84, 74), Color32::from_rgb(88, 170, 92), Color32::from_rgb(92, 122, 224)];

/// Height of the probe, in points: the same with and without a pixel under the pointer.
const PROBE: f32 = 72.0;

pub(super) fn view_panel(ui: &mut Ui, document: &mut Document) {
    egui::ScrollArea::vertical().id_salt("view panel").auto_shrink([false, false]).show(ui, |ui| {
        display(ui, document);
        section(ui, "HISTOGRAM");
        histogram(ui, &document.front.shown.histogram);
        section(ui, "PROBE");
        let size = vec2(ui.available_width(), PROBE);
        ui.allocate_ui_with_layout(size, egui::Layout::top_down(egui::Align::Min), |ui| {
            ui.set_min_height(PROBE);
            probe(ui, document);
        });
        light_meter(ui, document);
        section(ui, "EXPORT");
        export(ui, document);
        // What grows stands last, so that nothing moves away from under the pointer.
        snapshots(ui, document);
        lights_here(ui, document);
        ui.add_space(8.0);
    });
}

/// Buttons for exports, in a grid.
fn export(ui: &mut Ui, document: &mut Document) {
    let ways = [
        ("PNG…", "The picture as it is shown (Ctrl+S)", Action::Png),
        ("EXR…", "Linear radiance, 32 bits (Ctrl+E)", Action::Exr),
        ("Layers…", "An EXR with a layer for each light that shines", Action::Layers),
        ("Look…", "A file for `ltm relight --lighting` (Ctrl+K)", Action::SaveLook),
        ("Command", "Copy the command line that makes this picture (Ctrl+Shift+C)", Action::CopyCommand),
    ];
    const ACROSS: usize = 3;
    ui.spacing_mut().item_spacing = vec2(4.0, 4.0);
    let width = (ui.available_width() - (ACROSS - 1) as f32 * 4.0) / ACROSS as f32;
    for row in ways.chunks(ACROSS) {
        ui.horizontal(|ui| {
            for &(name, about, action) in row {
                if ui.add_sized(vec2(width, 24.0), egui::Button::new(name)).on_hover_text(about).clicked() {
                    act(ui.ctx(), document, action);
                }
            }
        });
    }
}

fn display(ui: &mut Ui, document: &mut Document) {
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new("View").size(15.0).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.button("1:1").on_hover_text("One pixel per pixel of the screen (Ctrl+0)").clicked() {
                act(ui.ctx(), document, Action::ActualSize);
            }
            if ui.button("Fit").on_hover_text("The whole picture (F)").clicked() {
                act(ui.ctx(), document, Action::Fit);
            }
            if document.front.view.look.is_some() {
                let label = ui.selectable_label(document.front.view.is_around, "Look around");
                if label.on_hover_text("Look around in the panorama, or see it flat (P)").clicked() {
                    act(ui.ctx(), document, Action::LookAround);
                }
            }
        });
    });
    let number = 58.0;
    ui.horizontal(|ui| {
        name(ui, "Exposure");
        ui.spacing_mut().slider_width = (ui.available_width() - number - 58.0).max(40.0);
        let slider = egui::Slider::new(&mut document.display.tone.exposure_stops, -12.0..=12.0);
        ui.add(slider.clamping(egui::SliderClamping::Never).suffix(" EV").fixed_decimals(1))
            .on_hover_text("E / Shift+E");
        if ui.button("Auto").on_hover_text("Expose so that most of the picture is readable (N)").clicked() {
            document.expose();
        }
    });
    let tone = &mut document.display.tone;
    ui.horizontal(|ui| {
        name(ui, "White");
        ui.spacing_mut().slider_width = (ui.available_width() - number - 58.0).max(40.0);
        let mut kelvin = tone.white_kelvin.unwrap_or(NEUTRAL_KELVIN);
        let slider = egui::Slider::new(&mut kelvin, 2000.0..=12_000.0).logarithmic(true);
        if ui.add(slider.suffix(" K").max_decimals(0)).on_hover_text("The light that is shown as white").changed() {
            tone.white_kelvin = Some(kelvin);
        }
        let balanced = tone.white_kelvin.is_some();
        if ui.add_enabled(balanced, egui::Button::new("Off")).on_hover_text("Colours as they are").clicked() {
            tone.white_kelvin = None;
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 6.0;
        let display = &mut document.display;
        for (curve, name) in CURVES {
            let is_shown = !display.false_colour && display.tone.curve == curve;
            if ui.selectable_label(is_shown, name).on_hover_text("Tone curve (Shift+Right)").clicked() {
                (display.tone.curve, display.false_colour) = (curve, false);
            }
        }
        let label = ui.selectable_label(display.false_colour, "False colour");
        if label.on_hover_text("Luminance in stops (Shift+Right)").clicked() {
            display.false_colour = true;
        }
    });
    if document.display.false_colour {
        scale(ui, document);
    }
    features(ui, document);
}

/// The name of a setting, in a column of its own.
fn name(ui: &mut Ui, text: &str) {
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    ui.allocate_ui_with_layout(vec2(60.0, 20.0), layout, |ui| {
        ui.set_min_width(60.0);
        ui.add(egui::Label::new(text).selectable(false));
    });
}

/// The colours of false colour with what they stand for.
fn scale(ui: &mut Ui, document: &Document) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 40.0), Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), 8.0));
    let (low, high) = STOPS_SHOWN;
    let steps = 96;
    let stops = |part: f32| low + (high - low) * part;
    let ramp = (0..steps).map(|step| [stops((step as f32 + 0.5) / steps as f32).exp2(); 3]).collect();
    let ramp = LinearImage { width: steps, height: 1, pixels: ramp };
    if let Ok(colours) = false_colour(&ramp, low.exp2(), high.exp2()) {
        for (step, colour) in colours.pixels.into_iter().enumerate() {
            let [left, right] = [step, step + 1].map(|s| bar.left() + bar.width() * s as f32 / steps as f32);
            let [r, g, b] = colour.map(|v| (encode_srgb(v) * 255.0 + 0.5) as u8);
            let part = Rect::from_x_y_ranges(left..=right + 0.5, bar.y_range());
            ui.painter().rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
        }
    }
    let lumens_per_watt = document.lumens_per_watt().ok();
    let gain = lumens_per_watt.unwrap_or(1.0);
    // White among them, which says the unit.
    for stops in (low as i32 + 2..=high as i32).step_by(4) {
        let x = bar.left() + bar.width() * (stops as f32 - low) / (high - low);
        let at = pos2(x.clamp(bar.left() + 14.0, bar.right() - 14.0), bar.bottom() + 9.0);
        let text = if stops == 0 { "0 EV".to_owned() } else { format!("{stops:+}") };
        let font = egui::FontId::proportional(10.0);
        ui.painter().text(at, egui::Align2::CENTER_CENTER, text, font.clone(), WEAK);
        let luminance = (stops as f32 - document.display.tone.exposure_stops).exp2() * gain;
        let text = short(luminance) + if stops == 0 && lumens_per_watt.is_some() { " cd/m²" } else { "" };
        ui.painter().text(at + vec2(0.0, 13.0), egui::Align2::CENTER_CENTER, text, font, WEAK);
    }
}

fn histogram(ui: &mut Ui, histogram: &[[f32; 3]]) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 74.0), Sense::hover());
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 3.0, Color32::from_gray(17));
    let (low, high) = STOPS_SHOWN;
    let x = |stops: f32| rect.left() + rect.width() * (stops - low) / (high - low);
    for stops in (low as i32 + 2..high as i32).step_by(2) {
        let shade = if stops == 0 { 92 } else { 34 };
        painter.vline(x(stops as f32), rect.y_range(), (1.0, Color32::from_gray(shade)));
    }
    // The first bin holds all that is black: it would flatten the rest.
    let inner = histogram.get(1..).unwrap_or_default();
    let peak = inner.iter().flatten().copied().fold(1e-6, f32::max);
    for (channel, shade) in CHANNEL_SHADES.into_iter().enumerate() {
        let points: Vec<_> = inner
            .iter()
            .enumerate()
            .map(|(bin, share)| {
                let height = (share[channel] / peak).sqrt() * (rect.height() - 6.0);
                pos2(rect.left() + rect.width() * (bin as f32 + 1.5) / BINS as f32, rect.bottom() - height)
            })
            .collect();
        painter.add(egui::Shape::line(points, egui::Stroke::new(1.3, shade)));
    }
    let clipped: f32 = histogram.iter().enumerate().fold(0.0, |sum, (bin, share)| {
        let stops = low + (high - low) * bin as f32 / BINS as f32;
        if stops >= 0.0 { sum + share.iter().copied().fold(0.0, f32::max) } else { sum }
    });
    if clipped > 0.0005 {
        let text = format!("{:.1} % above white", clipped.min(1.0) * 100.0);
        let at = rect.left_top() + vec2(6.0, 4.0);
        painter.text(at, egui::Align2::LEFT_TOP, text, egui::FontId::proportional(10.0), WEAK);
    }
    response.on_hover_text("Stops after exposure; the line is white.");
}

/// What stands at the pixel under the pointer, or at the one that was asked about.
fn probe(ui: &mut Ui, document: &Document) {
    let pixel = document.front.view.hovered.or(document.front.view.asked.as_ref().map(|asked| asked.pixel));
    let value = pixel.and_then(|pixel| document.front.shown.pixel(pixel));
    let (Some([x, y]), Some([r, g, b])) = (pixel, value) else {
        let text = "Point at the picture to read it;\nclick to see which light matters there.\n";
        ui.label(RichText::new(text).size(12.0).color(WEAK));
        return;
    };
    let bright = luminance([r, g, b]);
    let stops = if bright > 0.0 { format!("{:+.2} EV", bright.log2()) } else { "black".into() };
    let weak = |text: String| RichText::new(text).size(12.0).color(WEAK);
    let plain = |text: String| RichText::new(text).size(12.0);
    ui.spacing_mut().item_spacing.y = 2.0;
    ui.horizontal(|ui| {
        ui.label(weak(format!("{x}, {y}")));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| ui.label(weak(stops)));
    });
    let per_part = ui.available_width() / 3.0;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 0.0;
        for (value, shade) in [r, g, b].into_iter().zip(CHANNEL_SHADES) {
            let layout = egui::Layout::left_to_right(egui::Align::Center);
            ui.allocate_ui_with_layout(vec2(per_part, 16.0), layout, |ui| {
                ui.set_min_width(per_part);
                let (dot, _) = ui.allocate_exact_size(vec2(14.0, 16.0), Sense::hover());
                ui.painter().circle_filled(dot.left_center() + vec2(4.0, 0.0), 3.0, shade);
                ui.label(plain(short(value)));
            });
        }
    });
    ui.horizontal(|ui| match document.lumens_per_watt() {
        Ok(gain) => {
            let candela = bright * gain;
            ui.label(plain(format!("{} cd/m²", short(candela))));
            let measured = document
                .front
                .meter
                .value([x, y])
                .filter(|_| document.front.meter.shows == Some(Measured::Illuminance));
            let (text, about) = match measured.filter(|_| !document.front.meter.is_least()) {
                Some(value) => (format!("{} lx", short(value)), "Illuminance, by the surface's own albedo"),
                // A matt surface sends on at most what it gets: E ≥ π L.
                None => (
                    format!("≥ {} lx", short(candela * std::f32::consts::PI)),
                    "The least illuminance that there can be: that of a matt surface which is white",
                ),
            };
            ui.label(plain(text)).on_hover_text(about);
            let unit = weak(LightUnit::Radiance.to_string());
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| ui.label(unit));
        }
        Err(reason) => {
            ui.label(plain(format!("Y {}", short(bright)))).on_hover_text(format!("Not in cd/m²: {reason}"));
        }
    });
}

/// What each light brings to the pixel that was asked about, the strongest first.
fn lights_here(ui: &mut Ui, document: &mut Document) {
    let Some(asked) = &document.front.view.asked else { return };
    let total: f32 = asked.lights.iter().map(|v| v.max(0.0)).sum();
    let mut order: Vec<usize> = (0..asked.lights.len()).filter(|&light| asked.lights[light] > 0.0).collect();
    order.sort_by(|&a, &b| asked.lights[b].total_cmp(&asked.lights[a]));
    section(ui, &format!("LIGHT AT {}, {}", asked.pixel[0], asked.pixel[1]));
    if order.is_empty() {
        ui.label(RichText::new("None").size(12.0).color(WEAK));
    }
    let mut chosen = None;
    for &light in order.iter().take(5) {
        let share = asked.lights[light] / total.max(1e-30);
        let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 18.0), Sense::click());
        let bar = Rect::from_min_size(rect.min, vec2(rect.width() * share, rect.height()));
        ui.painter().rect_filled(bar, 2.0, Color32::from_rgb(70, 56, 36));
        let name = document.lights.lights()[light].name.as_str();
        let font = egui::FontId::proportional(12.0);
        let colour = if response.hovered() { Color32::WHITE } else { ui.visuals().text_color() };
        ui.painter().text(rect.left_center() + vec2(5.0, 0.0), egui::Align2::LEFT_CENTER, name, font.clone(), colour);
        let percent = format!("{:.0} %", share * 100.0);
        ui.painter().text(rect.right_center() - vec2(5.0, 0.0), egui::Align2::RIGHT_CENTER, percent, font, WEAK);
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
        if response.clicked() {
            chosen = Some(light);
        }
    }
    if let Some(light) = chosen {
        document.list.select_and_show(light, &document.work.mix);
    }
}
