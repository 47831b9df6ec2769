//! The light meter's part of the panel: what is shown, its colours, the area.

use eframe::egui::{self, Color32, DragValue, Rect, RichText, Sense, Ui, pos2, vec2};

use super::chooser::Purpose;
use super::document::Document;
use super::light_meter::LightMeter;
use super::number_format::short;
use super::surfaces_state::SurfacesState;
use super::theme::{ACCENT, WEAK, section};
use crate::meter::{Area, Measured};

/// The meter's part of the panel.
pub(super) fn light_meter(ui: &mut Ui, document: &mut Document) {
    section(ui, "LIGHT METER");
    if let Err(reason) = document.lumens_per_watt() {
        ui.label(RichText::new(format!("Not in cd/m² or lx: {reason}.")).size(12.0).color(WEAK));
        let is_known_by_picture = reason.contains("picture");
        if !is_known_by_picture && ui.button("Take one unit for 1 m").clicked() {
            document.front.view.assumes_metres = true;
        }
        return;
    }
    let meter = &mut document.front.meter;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for (name, shows, about) in [
            ("Off", None, "The picture in its colours"),
            ("Luminance", Some(Measured::Luminance), "What is seen, in cd/m²"),
            ("Illuminance", Some(Measured::Illuminance), "What falls on surfaces, in lx"),
        ] {
            if ui.selectable_label(meter.shows == shows, name).on_hover_text(about).clicked() {
                meter.show(shows);
            }
        }
    });
    if meter.shows.is_some() {
        legend(ui, meter);
    }
    if area(ui, meter) {
        document.files.wanted = Some(Purpose::Report);
    }
    if meter.measured() == Measured::Illuminance && meter.is_used() {
        origin(ui, &document.front.surfaces);
    }
}

/// Tells where illuminances come from.
fn origin(ui: &mut Ui, surfaces: &SurfacesState) {
    let (text, about) = match surfaces {
        SurfacesState::Known(_) => ("With the surfaces' own albedo".to_owned(), String::new()),
        SurfacesState::Unknown(reason) => ("At least: surfaces are taken for white".to_owned(), reason.clone()),
        SurfacesState::Unasked | SurfacesState::Reading => ("Reading the surfaces…".to_owned(), String::new()),
    };
    let about = match about.as_str() {
        "" => "E = π L / ρ at pixels that show one surface; mirrors, glass and lamps have no value".to_owned(),
        reason => format!("The matrix beside the container would tell their albedo: {reason}"),
    };
    ui.label(RichText::new(text).size(11.0).color(WEAK)).on_hover_text(about);
}

/// The colours with their values, and what can be set of them.
fn legend(ui: &mut Ui, meter: &mut LightMeter) {
    let Some(scale) = meter.scale() else { return };
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 26.0), Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), 10.0));
    let colours = scale.colours(96);
    for (i, [r, g, b]) in colours.iter().enumerate() {
        let [left, right] = [i, i + 1].map(|i| bar.left() + bar.width() * i as f32 / colours.len() as f32);
        let part = Rect::from_x_y_ranges(left..=right + 0.5, bar.y_range());
        ui.painter().rect_filled(part, 0.0, Color32::from_rgb(*r, *g, *b));
    }
    let x = |value: f32| bar.left() + bar.width() * (value / scale.low).ln() / (scale.high / scale.low).ln();
    let mut free = rect.left();
    for step in scale.steps() {
        ui.painter().vline(x(step), bar.y_range(), (1.0, Color32::WHITE));
        let galley =
            ui.painter().layout_no_wrap(short(step), egui::FontId::proportional(10.0), ui.visuals().text_color());
        let width = galley.size().x;
        let left = (x(step) - width / 2.0).clamp(rect.left(), rect.right() - width);
        if left >= free {
            ui.painter().galley(pos2(left, bar.bottom() + 2.0), galley, WEAK);
            free = left + width + 6.0;
        }
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let mut own = scale;
        let number = |value: &mut f32, ui: &mut Ui| {
            let speed = f64::from(*value) * 0.02;
            let number = DragValue::new(value).speed(speed).range(1e-6..=1e9).custom_formatter(|v, _| short(v as f32));
            ui.add(number).changed()
        };
        let mut changed = number(&mut own.low, ui);
        ui.label("to");
        changed |= number(&mut own.high, ui);
        ui.label(meter.measured().unit());
        if changed && own.low < own.high {
            meter.set_scale(Some(own));
        }
        let follows = meter.scale_follows();
        if ui.add_enabled(!follows, egui::Button::new("Fit")).on_hover_text("A scale that fits the picture").clicked() {
            meter.set_scale(None);
        }
        let mut lines = meter.shows_lines();
        if ui.checkbox(&mut lines, "Lines").on_hover_text("Lines of equal value").changed() {
            meter.show_lines(lines);
        }
    });
}

/// The area and what was measured in it; whether a report is asked for.
fn area(ui: &mut Ui, meter: &mut LightMeter) -> bool {
    let mut reports = false;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let about = "Click its corners in the picture; Enter or a double click ends it. Corners can be dragged later.";
        if ui.selectable_label(meter.draws, "Draw area").on_hover_text(about).clicked() {
            meter.draws = !meter.draws;
            if meter.draws {
                meter.area = Area { corners: Vec::new(), is_rectangle: true };
            }
        }
        let some = !meter.area.corners.is_empty();
        if ui.add_enabled(some, egui::Button::new("Clear")).clicked() {
            (meter.area, meter.draws) = (Area::default(), false);
        }
        let about = "A table of lights and of this area, as CSV, or as PDF with the picture";
        reports = ui.button("Report…").on_hover_text(about).clicked();
    });
    if meter.area.corners.len() == 4 {
        let about = "Measured on an even grid as it lies in the scene; else each pixel counts as much as another.";
        ui.checkbox(&mut meter.area.is_rectangle, "A rectangle in the scene").on_hover_text(about);
    }
    if let Some(figures) = meter.figures.filter(|_| meter.area.corners.len() > 2) {
        let unit = meter.measured().unit();
        let least = if meter.is_least() { "≥ " } else { "" };
        let value = |value: f32| format!("{least}{}", short(value));
        let text = format!(
            "Ē {} {unit}   min {}   max {}   U₀ {:.2}",
            value(figures.average),
            value(figures.least),
            value(figures.most),
            figures.uniformity()
        );
        ui.label(RichText::new(text).size(12.0));
    } else if meter.draws {
        let count = meter.area.corners.len();
        ui.label(RichText::new(format!("{count} corners; Enter ends")).size(12.0).color(ACCENT));
    }
    reports
}
