//! What the worker is asked for once the panels were drawn: the picture, and all that is made beside it.

use std::sync::Arc;

use eframe::egui;

use super::autosave::NOT_KEPT;
use super::comparison::DifferenceKey;
use super::document::Document;
use super::light_meter::MeteredPicture;
use super::message::Message;
use super::requests::RequestedDisplay;
use crate::difference;
use crate::display::Display;
use crate::meter::Measured;
use crate::worker::{Brought, Request};
use ltm::image::LinearImage;
use ltm::matrix::FactorSource;
use ltm::relight::relight_streaming;

/// Asks for what has changed; after the panels were drawn. `held` while a drag is on.
pub(super) fn ask(document: &mut Document, context: &egui::Context, held: bool) {
    document.work.observe(held);
    document.front.sample(context);
    autosave(document, context, held);
    relight_snapshot(document);
    compare_pictures(document, held);
    refresh_meter(document, context);
    refresh_features(document, context);
    let before = document.front.requests.relit;
    ask_picture(document, context);
    if document.front.requests.relit != before {
        document.list.contributions = document.front.contributions(&document.lights);
    }
    document.ask_behind(context, held);
}

/// Asks for the picture, if it has changed.
pub(super) fn ask_picture(document: &mut Document, context: &egui::Context) {
    let front = &mut document.front;
    let relit = front.requests.lit.as_ref() != Some(&document.work.mix);
    let compared = front.compare.compared();
    let image = compared.as_ref().map(|compared| Arc::as_ptr(&compared.image) as usize);
    let snapshot = front.compare.snapshots.compared();
    let display = RequestedDisplay { display: document.display, snapshot, image };
    if !relit && front.requests.display == Some(display) {
        return;
    }
    if relit {
        match front.lighting(&document.work.mix) {
            Ok(lighting) => front.requests.lighting = Arc::new(lighting),
            Err(error) => document.message = Some(Message::error(&error)),
        }
        front.requests.lit = Some(document.work.mix.clone());
    }
    front.requests.display = Some(display);
    front.requests.count(context.cumulative_frame_nr(), relit);
    front.session.worker.request(Request {
        generation: front.requests.generation,
        lighting: front.requests.lighting.clone(),
        display: document.display,
        looked_at: front.view.looked_at(front.size()),
        compared,
    });
    // After the lighting under which it is asked.
    if let (true, Some(asked)) = (relit, &front.view.asked) {
        front.session.worker.ask_pixel(asked.pixel);
    }
}

/// Writes the work down once it rests.
fn autosave(document: &mut Document, context: &egui::Context, held: bool) {
    let revision = document.front.compare.snapshots.revision();
    if document.autosave.is_due(context, &document.work, revision, held) {
        let saved = document.saved();
        let worker = &document.front.session.worker;
        if let Err(error) = document.autosave.write(worker, document.lights.basis(), saved, revision) {
            document.message = Some(Message::failed(NOT_KEPT, &error));
        }
    }
}

/// Measures what has come, where somebody looks at it.
fn refresh_meter(document: &mut Document, context: &egui::Context) {
    let Ok(lumens_per_watt) = document.lumens_per_watt() else { return document.front.meter.shows = None };
    let Some(image) = document.front.shown.image.as_deref().filter(|_| document.front.meter.is_used()) else { return };
    if document.front.meter.measured() == Measured::Illuminance {
        document.front.surfaces.ask(&document.front.session);
    }
    let picture = MeteredPicture { generation: document.front.shown.valued, image, lumens_per_watt };
    if let Err(error) = document.front.meter.refresh(context, &picture, document.front.surfaces.known()) {
        document.message = Some(Message::error(&error));
    }
}

/// Has the surfaces read, and shows of them what is asked for.
fn refresh_features(document: &mut Document, context: &egui::Context) {
    if document.front.features.missing().is_none() {
        return;
    }
    document.front.surfaces.ask(&document.front.session);
    if let Some(surfaces) = document.front.surfaces.known() {
        document.front.features.refresh(context, surfaces);
    }
}

/// Measures how far the picture and the compared one are apart, once both stand.
fn compare_pictures(document: &mut Document, held: bool) {
    let stands = document.front.is_lit_by(&document.work.mix);
    let (Some(compared), Some(image)) = (document.front.compare.compared(), document.front.shown.image.clone()) else {
        return document.front.compare.forget_difference();
    };
    let display = document.display;
    let (generation, other) = (document.front.shown.valued, Arc::as_ptr(&compared.image) as usize);
    let key = DifferenceKey { generation, display, other };
    if held || !stands || !document.front.compare.begin_difference(key) {
        return;
    }
    document.front.session.worker.beside(move || {
        let other = if compared.is_displayed { Display::default() } else { display };
        let difference = difference::between(&display.show(&image), &other.show(&compared.image));
        Ok(Brought::Difference(generation, difference.map(Arc::new)))
    });
}

/// Makes the picture of a snapshot that came without one, once the container is loaded.
fn relight_snapshot(document: &mut Document) {
    if document.front.compare.is_relighting || !document.front.shown.progress.is_complete() {
        return;
    }
    let Some((name, mix)) = document.front.compare.snapshots.without_image() else { return };
    let (name, lighting) = (name.to_owned(), document.front.lighting(mix));
    let revision = document.front.compare.snapshots.revision();
    let (container, relighter) = (document.front.session.container.clone(), document.front.shown.relighter.clone());
    document.front.compare.is_relighting = true;
    document.front.session.worker.beside(move || {
        let made = lighting.and_then(|lighting| match relighter {
            Some(relighter) => relighter.relight(&lighting),
            None => Ok(relight_streaming(&*container, &lighting)?.0),
        });
        // One that cannot be made is black, and the picture says why itself.
        let shape = container.shape();
        let image = made.unwrap_or_else(|_| LinearImage::black(shape.width(), shape.height()));
        Ok(Brought::SnapshotImage { name, revision, image: Arc::new(image) })
    });
}
