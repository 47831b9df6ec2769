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
    autosave(document, context, held);
    relight_snapshot(document);
    compare_pictures(document, held);
    refresh_meter(document, context);
    refresh_features(document, context);
    let relit = document.requests.lit.as_ref() != Some(&document.work.mix);
    let compared = document.compare.compared();
    let image = compared.as_ref().map(|compared| Arc::as_ptr(&compared.image) as usize);
    let snapshot = document.compare.snapshots.compared();
    let display = RequestedDisplay { display: document.view.display, snapshot, image };
    if !relit && document.requests.display == Some(display) {
        return;
    }
    if relit {
        match document.work.mix.lighting(document.session.basis()) {
            Ok(lighting) => document.requests.lighting = Arc::new(lighting),
            Err(error) => document.message = Some(Message::error(&error)),
        }
        document.requests.lit = Some(document.work.mix.clone());
        if let Some(reach) = &document.requests.reach {
            document.list.contributions = reach.contributions(document.session.basis(), &document.requests.lighting);
        }
    }
    document.requests.display = Some(display);
    document.requests.count(context.cumulative_frame_nr(), relit);
    document.session.worker.request(Request {
        generation: document.requests.generation,
        lighting: document.requests.lighting.clone(),
        display: document.view.display,
        looked_at: document.view.viewport.centre,
        compared,
    });
    // After the lighting under which it is asked.
    if let (true, Some(asked)) = (relit, &document.view.asked) {
        document.session.worker.ask_pixel(asked.pixel);
    }
}

/// Writes the work down once it rests.
fn autosave(document: &mut Document, context: &egui::Context, held: bool) {
    let revision = document.compare.snapshots.revision();
    if document.autosave.is_due(context, &document.work, revision, held) {
        let saved = document.saved();
        if let Err(error) = document.autosave.write(&document.session, saved, revision) {
            document.message = Some(Message::failed(NOT_KEPT, &error));
        }
    }
}

/// Measures what has come, where somebody looks at it.
fn refresh_meter(document: &mut Document, context: &egui::Context) {
    let Ok(lumens_per_watt) = document.lumens_per_watt() else { return document.meter.shows = None };
    let Some(image) = document.shown.image.as_deref().filter(|_| document.meter.is_used()) else { return };
    if document.meter.measured() == Measured::Illuminance {
        document.surfaces.ask(&document.session);
    }
    let picture = MeteredPicture { generation: document.shown.valued, image, lumens_per_watt };
    if let Err(error) = document.meter.refresh(context, &picture, document.surfaces.known()) {
        document.message = Some(Message::error(&error));
    }
}

/// Has the surfaces read, and shows of them what is asked for.
fn refresh_features(document: &mut Document, context: &egui::Context) {
    if document.features.missing().is_none() {
        return;
    }
    document.surfaces.ask(&document.session);
    if let Some(surfaces) = document.surfaces.known() {
        document.features.refresh(context, surfaces);
    }
}

/// Measures how far the picture and the compared one are apart, once both stand.
fn compare_pictures(document: &mut Document, held: bool) {
    let stands = document.requests.are_answered()
        && document.shown.valued == document.shown.seen
        && document.requests.lit.as_ref() == Some(&document.work.mix)
        && document.shown.progress.is_complete();
    let (Some(compared), Some(image)) = (document.compare.compared(), document.shown.image.clone()) else {
        return document.compare.forget_difference();
    };
    let display = document.view.display;
    let (generation, other) = (document.shown.valued, Arc::as_ptr(&compared.image) as usize);
    let key = DifferenceKey { generation, display, other };
    if held || !stands || !document.compare.begin_difference(key) {
        return;
    }
    document.session.worker.beside(move || {
        let other = if compared.is_displayed { Display::default() } else { display };
        let difference = difference::between(&display.show(&image), &other.show(&compared.image));
        Ok(Brought::Difference(generation, difference.map(Arc::new)))
    });
}

/// Makes the picture of a snapshot that came without one, once the container is loaded.
fn relight_snapshot(document: &mut Document) {
    if document.compare.is_relighting || !document.shown.progress.is_complete() {
        return;
    }
    let Some((name, mix)) = document.compare.snapshots.without_image() else { return };
    let (name, lighting) = (name.to_owned(), mix.lighting(document.session.basis()));
    let revision = document.compare.snapshots.revision();
    let (container, relighter) = (document.session.container.clone(), document.shown.relighter.clone());
    document.compare.is_relighting = true;
    document.session.worker.beside(move || {
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
