//! What the light meter draws over the picture: values at its lines, and the area.

use eframe::egui::{self, Color32, vec2};

use super::light_meter::LightMeter;
use super::number_format::short;
use super::theme::ACCENT;

/// Writes the values at the lines. `to_screen` brings picture positions there.
pub(super) fn draw_labels(
    painter: &egui::Painter,
    meter: &LightMeter,
    to_screen: impl Fn([f32; 2]) -> Option<egui::Pos2>,
) {
    for label in meter.labels() {
        let galley = painter.layout_no_wrap(short(label.value), egui::FontId::proportional(11.0), Color32::WHITE);
        let Some(at) = to_screen(label.at) else { continue };
        let place = egui::Align2::CENTER_CENTER.anchor_size(at, galley.size());
        painter.rect_filled(place.expand2(vec2(3.0, 1.0)), 3.0, Color32::from_black_alpha(190));
        painter.galley(place.min, galley, Color32::WHITE);
    }
}

/// Draws the area over the picture, each side in so many straight parts. `to_screen` brings picture positions there.
pub(super) fn draw_area(
    painter: &egui::Painter,
    meter: &LightMeter,
    parts: usize,
    to_screen: impl Fn([f32; 2]) -> Option<egui::Pos2>,
) {
    let corners = &meter.area.corners;
    let last = if meter.draws { corners.len().saturating_sub(1) } else { corners.len() };
    let along = |step: usize| {
        let (from, to) = (corners[step / parts % corners.len()], corners[(step / parts + 1) % corners.len()]);
        let share = (step % parts) as f32 / parts as f32;
        to_screen([0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share))
    };
    let steps: Vec<Option<egui::Pos2>> =
        if corners.is_empty() { Vec::new() } else { (0..=last * parts).map(along).collect() };
    for stroke in [(3.0, Color32::from_black_alpha(150)), (1.5, ACCENT)] {
        for seen in steps.split(Option::is_none).filter(|seen| seen.len() > 1) {
            painter.add(egui::Shape::line(seen.iter().copied().flatten().collect(), stroke));
        }
    }
    for corner in corners.iter().filter_map(|corner| to_screen(*corner)) {
        painter.circle_filled(corner, 4.0, Color32::from_black_alpha(150));
        painter.circle_filled(corner, 3.0, ACCENT);
    }
}
