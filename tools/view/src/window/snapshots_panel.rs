//! Snapshots and references: compared with, recalled, named.

use eframe::egui::{self, RichText, Sense, TextEdit, Ui};

use super::chooser::Purpose;
use super::comparison::{Comparison, difference_in_words};
use super::document::Document;
use super::message::Message;
use super::renaming::Renaming;
use super::theme::{ACCENT, WEAK, section};
use super::view_state::Beside;
use crate::display::Display;

pub(super) fn snapshots(ui: &mut Ui, document: &mut Document) {
    section(ui, "SNAPSHOTS");
    let mut removed = None;
    for index in 0..document.front.compare.snapshots.list().len() {
        ui.horizontal(|ui| {
            let compares = small_picture(ui, &mut document.front.compare, document.display, index);
            ui.vertical(|ui| removed = buttons(ui, document, index, compares).or(removed));
        });
    }
    if let Some(index) = removed {
        document.front.compare.remove(index);
    }
    if document.front.compare.snapshots.compared().is_some() {
        beside(ui, &document.front.compare, &mut document.front.view.beside);
    }
    ui.horizontal(|ui| {
        if ui.button("Take snapshot").on_hover_text("Keep this lighting and its picture (K)").clicked() {
            document.snapshot();
        }
        if ui.button("Reference…").on_hover_text("Compare with an image of the same size").clicked() {
            document.files.wanted = Some(Purpose::Reference);
        }
    });
    if let Some(purpose) = sequence(ui, &mut document.front.compare) {
        document.files.wanted = Some(purpose);
    }
}

/// Buttons for what is made of all snapshots together; the file that is asked for.
fn sequence(ui: &mut Ui, compare: &mut Comparison) -> Option<Purpose> {
    let (all, mixes) = (compare.snapshots.list().len(), compare.snapshots.mixes().len());
    if all < 2 {
        return None;
    }
    let mut wanted = None;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        if ui.button("Sheet…").on_hover_text("All snapshots with their names, on one PNG or a PDF").clicked() {
            wanted = Some(Purpose::Sheet);
        }
        let about = "From snapshot to snapshot, as numbered PNGs or, where ffmpeg is installed, as a video (MP4, WebM); \
                     times of a look's file count, if it has any";
        if ui.add_enabled(mixes > 1, egui::Button::new("Animation…")).on_hover_text(about).clicked() {
            wanted = Some(Purpose::Animation);
        }
        let step = egui::DragValue::new(&mut compare.step_secs).range(0.1..=600.0).speed(0.05);
        ui.add(step.max_decimals(1).suffix(" s")).on_hover_text("Time from one snapshot to the next");
        let rate = egui::DragValue::new(&mut compare.frames_per_sec).range(1.0..=120.0).speed(0.1);
        ui.add(rate.max_decimals(2).suffix(" fps")).on_hover_text("Frames a second");
    });
    wanted
}

/// How the compared picture stands beside the picture, and how far the two are apart.
fn beside(ui: &mut Ui, compare: &Comparison, beside: &mut Beside) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for (name, own, about) in [
            ("Wipe", Beside::Wipe, "Either at its side of the line, which can be dragged"),
            ("Other", Beside::Other, "The other one whole (V, or Alt held)"),
            ("Difference", Beside::Difference, "FLIP of each pixel (D)"),
        ] {
            let is_so = *beside == own;
            if ui.selectable_label(is_so, name).on_hover_text(about).clicked() {
                *beside = own;
            }
        }
    });
    let text = compare.difference().map_or_else(|| "…".to_owned(), difference_in_words);
    let about =
        "Of the two as they are shown. FLIP: 0 for equal pictures, 1 at most, at 67 pixels a degree. PSNR: of 8 bits.";
    ui.label(RichText::new(text).size(12.0)).on_hover_text(about);
}

/// The small picture; whether it was clicked.
fn small_picture(ui: &mut Ui, compare: &mut Comparison, display: Display, index: usize) -> bool {
    let compared = compare.snapshots.compared() == Some(index);
    let Some(texture) = compare.thumbnail(ui.ctx(), index, display) else {
        let (rect, _) = ui.allocate_exact_size(egui::vec2(64.0, 48.0), Sense::hover());
        ui.painter().rect_filled(rect, 2.0, egui::Color32::from_gray(17));
        return false;
    };
    let size = texture.size_vec2() * (64.0 / texture.size_vec2().max_elem());
    let image = egui::Image::new((texture.id(), size)).sense(Sense::click());
    let response = ui.add(image).on_hover_text("Compare with it");
    if compared {
        ui.painter().rect_stroke(response.rect, 2.0, (1.5, ACCENT), egui::StrokeKind::Outside);
    }
    response.clicked()
}

/// Name and buttons of a snapshot; its index where it is to be taken away. `compares`: its picture was clicked.
fn buttons(ui: &mut Ui, document: &mut Document, index: usize, compares: bool) -> Option<usize> {
    name(ui, document, index);
    let snapshot = &document.front.compare.snapshots.list()[index];
    let (mix, is_displayed) = (snapshot.mix.clone(), snapshot.is_displayed);
    let compared = document.front.compare.snapshots.compared() == Some(index);
    let mut removed = None;
    ui.horizontal(|ui| {
        if ui.selectable_label(compared, "Compare").clicked() || compares {
            document.front.compare.snapshots.toggle_compare(index);
        }
        match mix {
            Some(mix) => {
                if ui.button("Recall").on_hover_text("Light the picture so again; undo takes it back").clicked() {
                    document.work.replace(mix);
                }
            }
            None => {
                let about = if is_displayed { "as it is" } else { "exposed" };
                ui.label(RichText::new(about).size(11.0).color(WEAK));
            }
        }
        if ui.button("×").on_hover_text("Forget it").clicked() {
            removed = Some(index);
        }
    });
    removed
}

/// The name, which a double click changes.
fn name(ui: &mut Ui, document: &mut Document, index: usize) {
    let renamed = document.front.compare.renamed.as_mut().filter(|renaming| renaming.index == index);
    if let Some(Renaming { text, .. }) = renamed {
        let field = ui.add(TextEdit::singleline(text).desired_width(150.0).id(egui::Id::unique("rename snapshot")));
        if field.lost_focus() {
            let keeps = !ui.input(|input| input.key_pressed(egui::Key::Escape));
            let text = document.front.compare.renamed.take().map(|renaming| renaming.text).unwrap_or_default();
            let before = document.front.compare.snapshots.list()[index].name.clone();
            if keeps && document.front.compare.snapshots.rename(index, &text) {
                document.front.compare.forget_thumbnail(&before);
                for (_, look) in document.work.keys.iter_mut().filter(|(_, look)| *look == before) {
                    text.trim().clone_into(look);
                }
            } else if keeps {
                document.message = Some(Message::problem(format!("'{text}' is the name of another snapshot")));
            }
        } else if !field.has_focus() {
            field.request_focus();
        }
        return;
    }
    let text = document.front.compare.snapshots.list()[index].name.clone();
    let label = egui::Label::new(&text).truncate().selectable(false).sense(Sense::click());
    if ui.add(label).on_hover_text("Double-click to rename").double_clicked() {
        document.front.compare.renamed = Some(Renaming::of(index, text));
    }
}
