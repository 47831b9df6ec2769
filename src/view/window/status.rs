//! The line below: what it costs and what it is worth.

use eframe::egui::{self, RichText, Ui};

use super::document::Document;
use super::theme::{ALARM, TEXT, WEAK};

pub(super) fn status(ui: &mut Ui, document: &mut Document) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 14.0;
        let weak = |text: String| RichText::new(text).size(11.5).color(WEAK);
        if let Some((message, alarm)) = &document.message {
            let colour = if *alarm { ALARM } else { TEXT };
            let response = ui.add(egui::Label::new(RichText::new(message).size(11.5).color(colour)).truncate());
            if response.interact(egui::Sense::click()).on_hover_text("Click to dismiss").clicked() {
                document.message = None;
            }
        } else {
            let [width, height] = document.size();
            let container = &document.session.container;
            let columns = container.job().shape.columns();
            ui.label(weak(format!("{width} × {height}")));
            ui.label(weak(format!("{columns} columns, mean rank {:.0}", document.mean_rank)));
            let error = match document.session.stated_error() {
                Some(error) => format!("stated error {:.2} %", error * 100.0),
                None => "error not stated".into(),
            };
            ui.label(weak(error)).on_hover_text("‖packed − stored‖ / ‖stored‖ over all blocks, from the container");
            ui.label(weak(format!("{} resident", bytes(document.factor_bytes))));
            ui.label(weak(format!("{} read of {}", bytes(document.bytes_read()), bytes(container.file_bytes()))));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(weak("? for keys".into()));
            let latency = document.latency;
            let frames = if latency.frames == 1 { "frame" } else { "frames" };
            let text = format!(
                "relit in {:.1} ms, shown after {:.1} ms, {} {frames}",
                latency.relight_secs * 1e3,
                latency.total_secs * 1e3,
                latency.frames
            );
            ui.label(weak(text))
                .on_hover_text("Of the last change: product, product and display, frames of the window");
            let rate = 1.0 / latency.total_secs.max(1e-6);
            if latency.total_secs > 0.0 {
                ui.label(weak(format!("{rate:.0} pictures/s")));
            }
            ui.label(weak(format!("{:.0} %", document.viewport.zoom * ui.ctx().pixels_per_point() * 100.0)));
        });
    });
}

/// A number of bytes for people.
fn bytes(count: u64) -> String {
    const UNITS: [&str; 4] = ["B", "KiB", "MiB", "GiB"];
    let mut value = count as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{count} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}
