//! What the worker has done, brought to the parts of the document that it concerns.

use eframe::egui;

use super::autosave::NOT_KEPT;
use super::document::Document;
use super::file_reading::take_file;
use super::message::{Message, line};
use super::shown_picture::PictureValues;
use super::view_state::Asked;
use crate::file_watch::FileChange;
use crate::worker::{Brought, Event, Picture};

/// Takes what the worker has done; before the panels are drawn.
pub(super) fn receive(document: &mut Document, context: &egui::Context) {
    let events: Vec<Event> = document.session.worker.events().collect();
    for event in events {
        match event {
            Event::Picture(picture) => take_picture(document, context, *picture),
            Event::Values { generation, image, histogram } => {
                take_values(document, PictureValues { generation, image, histogram });
            }
            Event::Loaded { relighter, adapter, is_paged } => {
                document.shown.is_paged = is_paged;
                document.shown.relighter = relighter;
                document.shown.adapter = adapter;
            }
            Event::Damage(lines) => {
                let blocks = if lines.len() == 1 { "block" } else { "blocks" };
                let first = lines.first().map_or("", String::as_str);
                document.message = Some(Message::problem(format!("{} damaged {blocks}: {first}", lines.len())));
            }
            Event::Brought(Ok(Brought::Unsaved(outcome))) => {
                if let Err(error) = document.autosave.take(outcome) {
                    document.message = Some(Message::failed(NOT_KEPT, &error));
                }
            }
            Event::Brought(Ok(Brought::SnapshotImage { name, revision, image })) => {
                document.compare.is_relighting = false;
                // Else it may be the picture of another of that name, and is made again.
                if revision == document.compare.snapshots.revision() {
                    document.compare.snapshots.set_image(&name, image);
                }
            }
            Event::Brought(Ok(Brought::Difference(of, difference))) => {
                document.compare.take_difference(context, of, difference);
            }
            Event::Brought(Ok(Brought::Surfaces(surfaces))) => document.surfaces.take(surfaces),
            Event::Brought(brought) => {
                document.files.end();
                let outcome = brought.and_then(|brought| take_file(document, brought).map_err(|error| line(&error)));
                document.message = Some(match outcome {
                    Ok(message) => Message::info(message),
                    Err(message) => Message::problem(message),
                });
            }
            Event::Reach(reach) => {
                let lighting = &document.requests.lighting;
                document.list.contributions = reach.contributions(document.session.basis(), lighting);
                document.requests.reach = Some(reach);
            }
            Event::Pixel { pixel, lights } => take_pixel(document, pixel, lights),
            Event::File(change) => document.files.changed = Some(change).filter(|&change| change != FileChange::Same),
            Event::Failed(message) => {
                // It may have been about the pixel.
                document.view.select_strongest = false;
                document.message = Some(Message::problem(message));
            }
        }
    }
    if document.compare.snapshot_wanted {
        document.snapshot();
    }
}

fn take_pixel(document: &mut Document, pixel: [u32; 2], lights: Vec<f32>) {
    if std::mem::take(&mut document.view.select_strongest) {
        let strongest = (0..lights.len()).max_by(|&a, &b| lights[a].total_cmp(&lights[b]));
        if let Some(light) = strongest.filter(|&light| lights[light] > 0.0) {
            document.list.select_and_show(light, &document.work.mix);
        }
    }
    document.view.asked = Some(Asked { pixel, lights });
}

fn take_picture(document: &mut Document, context: &egui::Context, mut picture: Picture) {
    if let Some(latency) = document.requests.answered(&picture, context.cumulative_frame_nr()) {
        document.shown.latency = latency;
    }
    let compared = picture.compared.take();
    if let Some(values) = document.shown.take(context, picture) {
        take_values(document, values);
    }
    document.compare.take(context, compared);
}

fn take_values(document: &mut Document, values: PictureValues) {
    let PictureValues { generation, image, histogram } = values;
    document.view.follow(&image, document.shown.progress.is_complete());
    (document.shown.valued, document.shown.image, document.shown.histogram) = (generation, Some(image), histogram);
}
