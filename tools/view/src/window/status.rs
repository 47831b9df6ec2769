//! The line below: what it costs and what it is worth.

use std::sync::atomic::Ordering;

use eframe::egui::{self, RichText, Ui};

use super::document::Document;
use super::message::Message;
use super::theme::{ACCENT, ALARM, TEXT, WEAK};
use ltm::light::denoise_errors_line;
use ltm::resources::human_bytes;

/// Stated error from which on it is pointed out.
const FAR: f64 = 0.15;

pub(super) fn status(ui: &mut Ui, document: &mut Document) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 14.0;
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            cost(ui, document);
            worth(ui, document);
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| message(ui, document));
        });
    });
}

fn weak(text: String) -> RichText {
    RichText::new(text).size(11.5).color(WEAK)
}

fn message(ui: &mut Ui, document: &mut Document) {
    if document.files.any_open() {
        ui.spinner();
        ui.label(weak("working".into()));
    } else if let Some(Message { text: message, is_error }) = &document.message {
        let text = RichText::new(message).size(11.5).color(if *is_error { ALARM } else { TEXT });
        let response = ui.add(egui::Label::new(text).truncate().sense(egui::Sense::click()));
        if response.on_hover_text(format!("{message}\n\nClick to dismiss")).clicked() {
            document.message = None;
        }
    } else {
        let [width, height] = document.size();
        let columns = document.front.session.container.job().shape.columns();
        let rank = document.front.session.mean_rank();
        ui.add(
            egui::Label::new(weak(format!("{width} × {height}, {columns} columns, mean rank {rank:.1}"))).truncate(),
        );
    }
}

/// Frames a second and what a change costs.
fn cost(ui: &mut Ui, document: &Document) {
    ui.label(weak("? for keys".into()));
    ui.label(weak(match document.front.view.around() {
        Some(look) => format!("{:.0}° wide", look.field.to_degrees()),
        None => format!("{:.0} %", document.front.view.viewport.zoom * ui.ctx().pixels_per_point() * 100.0),
    }));
    let latency = document.front.shown.latency;
    if latency.total_secs > 0.0 {
        let frames = if latency.frames == 1 { "frame" } else { "frames" };
        let text = format!("{:.1} ms, {} {frames}", latency.total_secs * 1e3, latency.frames);
        let of = format!(
            "From the last change to its picture: {:.1} ms of relighting, {:.1} ms with display, {} {frames}",
            latency.relight_secs * 1e3,
            latency.total_secs * 1e3,
            latency.frames
        );
        ui.label(weak(text)).on_hover_text(of);
    }
    if let Some(rate) = document.front.shown.per_sec() {
        ui.label(weak(format!("{rate:.0} fps"))).on_hover_text("Pictures a second while something was dragged");
    }
}

/// Bytes, and the error that the container states.
fn worth(ui: &mut Ui, document: &Document) {
    let (container, meter) = (&document.front.session.container, document.front.session.worker.meter());
    let error = match document.front.session.stated_error() {
        Some(error) => weak(format!("stated error {:.2} %", error * 100.0)),
        None => weak("error not stated".into()),
    };
    // What is this far from the samples is not to be read like one that is near.
    let is_far = document.front.session.stated_error().is_some_and(|error| error > FAR);
    ui.label(if is_far { error.color(ACCENT) } else { error })
        .on_hover_text("‖packed − stored‖ / ‖stored‖ over all blocks, as the container says");
    if let Some(errors) = &container.errors().denoising {
        let percent = |share: f32| share * 100.0;
        let text = format!("denoised: noise {:.1} %, bias {:.1} %", percent(errors.noise_after), percent(errors.bias));
        ui.label(weak(text)).on_hover_text(denoise_errors_line(errors));
    }
    let read = format!("{} read", human_bytes(meter.bytes_read.load(Ordering::Relaxed)));
    let file =
        format!("of a file of {}; layers that lean on others are read with them", human_bytes(container.file_bytes()));
    ui.label(weak(read)).on_hover_text(file);
    let on_cpu = human_bytes(meter.resident_bytes.load(Ordering::Relaxed));
    let (resident, about) = match &document.front.shown.adapter {
        Some(adapter) => (
            format!("{} resident on the GPU", human_bytes(meter.device_bytes.load(Ordering::Relaxed))),
            format!("Factors, and pictures made of them, in the memory of {adapter}, which relights"),
        ),
        None => (format!("{on_cpu} resident"), "Factors in memory; the CPU relights".to_owned()),
    };
    let (resident, about) = match document.front.shown.is_paged {
        true => (
            format!("{resident}, the rest passes"),
            format!("{about}. There are more than --memory allows: the rest is read for each picture"),
        ),
        false => (resident, about),
    };
    ui.label(weak(resident)).on_hover_text(about);
}
