//! How the picture is shown: exposure, white, histogram, probe; snapshots; export.

use eframe::egui::{self, Color32, Rect, RichText, Sense, Ui, pos2, vec2};

use super::chooser::Purpose;
use super::document::Document;
use super::keys::{Action, act};
use super::theme::{ACCENT, WEAK, section};
use crate::image::{LinearImage, encode_srgb, false_colour, luminance};
use crate::view::display::{BINS, CURVES, NEUTRAL_KELVIN, STOPS_SHOWN};

pub(super) fn view_panel(ui: &mut Ui, document: &mut Document) {
    egui::ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        display(ui, document);
        section(ui, "HISTOGRAM");
        histogram(ui, document);
        section(ui, "PROBE");
        probe(ui, document);
        snapshots(ui, document);
        section(ui, "EXPORT");
        ui.horizontal_wrapped(|ui| {
            for (name, about, action) in [
                ("PNG…", "The picture as it is shown (Ctrl+S)", Action::Png),
                ("EXR…", "Linear radiance, 32 bits (Ctrl+E)", Action::Exr),
                ("Layers…", "An EXR with a layer for each light that shines", Action::Layers),
                ("Lighting…", "A file for `ltm relight --lighting` (Ctrl+K)", Action::SaveLook),
                ("Command", "Copy the command line that makes this picture (Ctrl+Shift+C)", Action::CopyCommand),
            ] {
                if ui.button(name).on_hover_text(about).clicked() {
                    act(ui.ctx(), document, action);
                }
            }
        });
        ui.add_space(8.0);
    });
}

fn display(ui: &mut Ui, document: &mut Document) {
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new("View").size(15.0).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.button("1:1").on_hover_text("One pixel per pixel of the screen (Ctrl+0)").clicked() {
                document.viewport.one_to_one(ui.ctx().pixels_per_point());
            }
            if ui.button("Fit").on_hover_text("The whole picture (F)").clicked() {
                document.viewport.fit();
            }
        });
    });
    let number = 58.0;
    ui.horizontal(|ui| {
        ui.add_sized(vec2(62.0, 20.0), egui::Label::new("Exposure").selectable(false));
        ui.spacing_mut().slider_width = (ui.available_width() - number - 58.0).max(40.0);
        let slider = egui::Slider::new(&mut document.display.tone.exposure_stops, -12.0..=12.0);
        ui.add(slider.clamping(egui::SliderClamping::Never).suffix(" EV").fixed_decimals(1))
            .on_hover_text("E / Shift+E");
        if ui.button("Auto").on_hover_text("Expose for most of the picture (N)").clicked() {
            document.expose();
        }
    });
    let tone = &mut document.display.tone;
    ui.horizontal(|ui| {
        ui.add_sized(vec2(62.0, 20.0), egui::Label::new("White").selectable(false));
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
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
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
    let lumens_per_watt = document.lumens_per_watt();
    let gain = lumens_per_watt.unwrap_or(1.0);
    for stops in (low as i32..=high as i32).step_by(4) {
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

/// A number in about three digits.
fn short(value: f32) -> String {
    match value.abs() {
        v if v == 0.0 || (0.001..1.0).contains(&v) => format!("{value:.3}"),
        v if (1.0..100.0).contains(&v) => format!("{value:.1}"),
        v if (100.0..100_000.0).contains(&v) => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}

fn histogram(ui: &mut Ui, document: &Document) {
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
    let inner = document.histogram.get(1..).unwrap_or_default();
    let peak = inner.iter().flatten().copied().fold(1e-6, f32::max);
    let shades = [Color32::from_rgb(200, 70, 60), Color32::from_rgb(80, 170, 80), Color32::from_rgb(80, 110, 220)];
    for (channel, shade) in shades.into_iter().enumerate() {
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
    let clipped: f32 = document.histogram.iter().enumerate().fold(0.0, |sum, (bin, share)| {
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

fn probe(ui: &mut Ui, document: &mut Document) {
    let pixel = document.hovered.or(document.asked.as_ref().map(|asked| asked.pixel));
    let value = pixel.and_then(|[x, y]| {
        let image = document.image.as_ref()?;
        image.pixels.get(y as usize * image.width as usize + x as usize).copied()
    });
    let text = match (pixel, value) {
        (Some([x, y]), Some([r, g, b])) => {
            let bright = luminance([r, g, b]);
            let stops = if bright > 0.0 { format!("{:+.2} EV", bright.log2()) } else { "black".into() };
            let rgb = [r, g, b].map(|v| format!("{:>9}", short(v))).concat();
            let radiance = format!("{x:>5}, {y:<5}{rgb}\n");
            // A matt surface sends on at most what it gets: E ≥ π L.
            match document.lumens_per_watt() {
                Some(gain) => {
                    let candela = bright * gain;
                    let lux = short(candela * std::f32::consts::PI);
                    format!("{radiance}W/(sr·m²)   {stops}\n{} cd/m²   {lux} lx if matt white", short(candela))
                }
                None => format!("{radiance}times as rendered   {stops}\nY {}", short(bright)),
            }
        }
        _ => "Point at the picture to read it;\nclick to ask which light matters there.\n".into(),
    };
    ui.label(RichText::new(text).monospace().size(11.0));
    let Some(asked) = &document.asked else { return };
    let total: f32 = asked.lights.iter().map(|v| v.max(0.0)).sum();
    let mut order: Vec<usize> = (0..asked.lights.len()).filter(|&light| asked.lights[light] > 0.0).collect();
    order.sort_by(|&a, &b| asked.lights[b].total_cmp(&asked.lights[a]));
    ui.add_space(2.0);
    ui.label(RichText::new(format!("Light at {}, {}", asked.pixel[0], asked.pixel[1])).size(11.0).color(WEAK));
    let mut chosen = None;
    for &light in order.iter().take(5) {
        let share = asked.lights[light] / total.max(1e-30);
        let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 18.0), Sense::click());
        let bar = Rect::from_min_size(rect.min, vec2(rect.width() * share, rect.height()));
        ui.painter().rect_filled(bar, 2.0, Color32::from_rgb(70, 56, 36));
        let name = document.session.basis().lights()[light].name.as_str();
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
        document.selected = Some(light);
        document.scroll_to_selected = true;
    }
}

fn snapshots(ui: &mut Ui, document: &mut Document) {
    section(ui, "SNAPSHOTS");
    let mut removed = None;
    for index in 0..document.snapshots.list().len() {
        let texture = document.thumbnail(ui.ctx(), index);
        let compared = document.snapshots.compared() == Some(index);
        ui.horizontal(|ui| {
            let size = texture.size_vec2() * (64.0 / texture.size_vec2().max_elem());
            let image = egui::Image::new((texture.id(), size)).sense(Sense::click());
            let response = ui.add(image).on_hover_text("Compare with it");
            if compared {
                ui.painter().rect_stroke(response.rect, 2.0, (1.5, ACCENT), egui::StrokeKind::Outside);
            }
            let mut compare = response.clicked();
            ui.vertical(|ui| {
                let snapshot = &document.snapshots.list()[index];
                ui.add(egui::Label::new(&snapshot.name).truncate());
                ui.horizontal(|ui| {
                    compare |= ui.selectable_label(compared, "Compare").clicked();
                    if snapshot.mix.is_some() && ui.button("Recall").clicked() {
                        document.mix = snapshot.mix.clone().unwrap_or_else(|| document.mix.clone());
                    }
                    if ui.button("×").on_hover_text("Forget it").clicked() {
                        removed = Some(index);
                    }
                });
            });
            if compare {
                document.snapshots.toggle_compare(index);
            }
        });
    }
    if let Some(index) = removed {
        document.thumbnails.remove(&document.snapshots.list()[index].name);
        document.snapshots.remove(index);
    }
    ui.horizontal(|ui| {
        if ui.button("Take snapshot").on_hover_text("Keep this lighting and its picture (K)").clicked() {
            document.snapshot();
        }
        if ui.button("Reference…").on_hover_text("Compare with an image of the same size").clicked() {
            document.wanted = Some(Purpose::Reference);
        }
    });
}
