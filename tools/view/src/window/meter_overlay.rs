//! What the light meter draws over the picture: values at its lines, and the area.

use eframe::egui::{self, Color32, vec2};

use super::light_meter::LightMeter;
use super::number_format::short;
use super::theme::ACCENT;

/// Writes the values at the lines. `to_screen` brings picture positions there.
pub(super) fn draw_labels(painter: &egui::Painter, meter: &LightMeter, to_screen: impl Fn([f32; 2]) -> egui::Pos2) {
    for label in meter.labels() {
        let galley = painter.layout_no_wrap(short(label.value), egui::FontId::proportional(11.0), Color32::WHITE);
        let place = egui::Align2::CENTER_CENTER.anchor_size(to_screen(label.at), galley.size());
        painter.rect_filled(place.expand2(vec2(3.0, 1.0)), 3.0, Color32::from_black_alpha(190));
        painter.galley(place.min, galley, Color32::WHITE);
    }
}

/// Draws the area over the picture. `to_screen` brings picture positions there.
pub(super) fn draw_area(painter: &egui::Painter, meter: &LightMeter, to_screen: impl Fn([f32; 2]) -> egui::Pos2) {
    let corners: Vec<egui::Pos2> = meter.area.corners.iter().map(|corner| to_screen(*corner)).collect();
    if corners.is_empty() {
        return;
    }
    let outline = |stroke: (f32, Color32)| match meter.draws {
        true => egui::Shape::line(corners.clone(), stroke),
        false => egui::Shape::closed_line(corners.clone(), stroke),
    };
    painter.add(outline((3.0, Color32::from_black_alpha(150))));
    painter.add(outline((1.5, ACCENT)));
    for corner in corners {
        painter.circle_filled(corner, 4.0, Color32::from_black_alpha(150));
        painter.circle_filled(corner, 3.0, ACCENT);
    }
}
