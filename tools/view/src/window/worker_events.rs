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

/// Takes what the workers have done; before the panels are drawn.
pub(super) fn receive(document: &mut Document, context: &egui::Context) {
    let events: Vec<Event> = document.front.session.worker.events().collect();
    events.into_iter().for_each(|event| take_event(document, context, event, false));
    for index in 0..document.behind.len() {
        let of_work = document.with_behind(index, |document| take_events_behind(document, context));
        of_work.into_iter().for_each(|event| take_event(document, context, event, false));
    }
    if document.front.compare.snapshot_wanted {
        document.snapshot();
    }
}

/// Takes what the worker of a view has done that is behind the one in front and takes its place meanwhile. Returns what concerns the work on
/// all views, whose snapshots are those of the one in front: a tab was changed while a file was read or written.
fn take_events_behind(document: &mut Document, context: &egui::Context) -> Vec<Event> {
    let (of_work, own): (Vec<Event>, Vec<Event>) = document.front.session.worker.events().partition(is_of_work);
    own.into_iter().for_each(|event| take_event(document, context, event, true));
    of_work
}

/// Whether a file of the work was read or written.
fn is_of_work(event: &Event) -> bool {
    matches!(event, Event::Brought(Ok(Brought::Look { .. } | Brought::Recovered { .. } | Brought::Wrote { .. })))
}

/// Takes what the worker of the view in front has done, or of one that `is_behind` it and takes its place meanwhile.
fn take_event(document: &mut Document, context: &egui::Context, event: Event, is_behind: bool) {
    let name = |document: &Document| if is_behind { format!("{}: ", document.front.name) } else { String::new() };
    match event {
        Event::Picture(picture) => take_picture(document, context, *picture, is_behind),
        Event::Values { generation, image, histogram } => {
            take_values(document, PictureValues { generation, image, histogram }, is_behind);
        }
        Event::Loaded { relighter, adapter, is_paged } => {
            document.front.shown.is_paged = is_paged;
            // What a worker has loaded before it slept is not wanted any more.
            document.front.shown.relighter = relighter.filter(|_| document.front.session.worker.is_awake());
            document.front.shown.adapter = adapter;
        }
        Event::Damage(lines) => {
            let blocks = if lines.len() == 1 { "block" } else { "blocks" };
            let first = lines.first().map_or("", String::as_str);
            document.message =
                Some(Message::problem(format!("{}{} damaged {blocks}: {first}", name(document), lines.len())));
        }
        Event::Brought(Ok(Brought::Unsaved(outcome))) => {
            if let Err(error) = document.autosave.take(outcome) {
                document.message = Some(Message::failed(NOT_KEPT, &error));
            }
        }
        Event::Brought(Ok(Brought::SnapshotImage { name, revision, image })) => {
            document.front.compare.is_relighting = false;
            // Else it may be the picture of another of that name, and is made again.
            if revision == document.front.compare.snapshots.revision() {
                document.front.compare.snapshots.set_image(&name, image);
            }
        }
        Event::Brought(Ok(Brought::Difference(of, difference))) => {
            document.front.compare.take_difference(context, of, difference);
        }
        Event::Brought(Ok(Brought::Surfaces(surfaces))) => document.front.surfaces.take(surfaces),
        Event::Brought(brought) => {
            document.files.end();
            let outcome = brought.and_then(|brought| take_file(document, brought).map_err(|error| line(&error)));
            document.message = Some(match outcome {
                Ok(message) => Message::info(message),
                Err(message) => Message::problem(message),
            });
        }
        Event::Reach(reach) => {
            document.front.requests.reach = Some(reach);
            if !is_behind {
                document.list.contributions = document.front.contributions(&document.lights);
            }
        }
        Event::Pixel { pixel, lights } => take_pixel(document, pixel, &lights),
        Event::File(change) => document.front.files.changed = Some(change).filter(|&change| change != FileChange::Same),
        Event::Failed(message) => {
            // It may have been about the pixel.
            document.front.view.select_strongest = false;
            document.message = Some(Message::problem(format!("{}{message}", name(document))));
        }
    }
}

fn take_pixel(document: &mut Document, pixel: [u32; 2], own: &[f32]) {
    let lights = document.front.lights.spread(own, &document.lights);
    if std::mem::take(&mut document.front.view.select_strongest) {
        let strongest = (0..lights.len()).max_by(|&a, &b| lights[a].total_cmp(&lights[b]));
        if let Some(light) = strongest.filter(|&light| lights[light] > 0.0) {
            document.list.select_and_show(light, &document.work.mix);
        }
    }
    document.front.view.asked = Some(Asked { pixel, lights });
}

fn take_picture(document: &mut Document, context: &egui::Context, mut picture: Picture, is_behind: bool) {
    if let Some(latency) = document.front.requests.answered(&picture, context.cumulative_frame_nr()) {
        document.front.shown.latency = latency;
    }
    let compared = picture.compared.take();
    if let Some(values) = document.front.shown.take(context, picture) {
        take_values(document, values, is_behind);
    }
    document.front.compare.take(context, compared);
}

fn take_values(document: &mut Document, values: PictureValues, is_behind: bool) {
    let PictureValues { generation, image, histogram } = values;
    if !is_behind {
        document.follow_exposure(&image);
    }
    let shown = &mut document.front.shown;
    (shown.valued, shown.image, shown.histogram) = (generation, Some(image), histogram);
}
