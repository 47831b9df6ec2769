//! Files that are written of the document: the look, pictures, a sheet, an animation.

use std::path::PathBuf;

use super::document::Document;
use super::file_jobs::{is_pdf, wrote};
use crate::animation::{self, frames};
use crate::display::Display;
use crate::export;
use crate::looks;
use crate::mixer::Mix;
use crate::pdf;
use crate::sheet::contact_sheet;
use crate::worker::Brought;
use ltm::error::{Error, Result};
use ltm::light::Lighting;
use ltm::relight::relight_streaming;

/// Writes the lighting.
pub(super) fn write_look(document: &mut Document, path: PathBuf) {
    let message = format!("Saved {}", path.display());
    let (basis, saved) = (Box::new(document.basis().clone()), Box::new(document.saved()));
    let revision = document.front.compare.snapshots.revision();
    document.start_job(move || {
        looks::save(&path, &basis, &saved, true)?;
        Ok(Brought::Wrote { path, saved, basis, revision, message })
    });
}

/// Writes the picture as it is shown.
pub(super) fn write_png(document: &mut Document, path: PathBuf) {
    if let Some(shown) = document.front.features.shown().or(document.front.meter.overlay()).cloned() {
        return document.start_job(move || export::write_rgba(&path, shown.size, &shown.rgba).map(|()| wrote(&path)));
    }
    let (Some(image), display) = (document.front.shown.image.clone(), document.display) else { return };
    document.start_job(move || export::write_png(&path, &image, &display).map(|()| wrote(&path)));
}

/// Writes the radiance.
pub(super) fn write_exr(document: &mut Document, path: PathBuf) {
    let Some(image) = document.front.shown.image.clone() else { return };
    document.start_job(move || export::write_radiance(&path, &image).map(|()| wrote(&path)));
}

/// Writes a layer for each light.
pub(super) fn write_layers(document: &mut Document, path: PathBuf) {
    let (container, relighter) = (document.front.session.container.clone(), document.front.shown.relighter.clone());
    let mix = document.front.lights.mix(&document.work.mix).into_owned();
    document.start_job(move || {
        export::write_layers(&path, &container, relighter.as_deref(), &mix)?;
        Ok(wrote(&path))
    });
}

/// Writes all snapshots on one sheet, each as it is shown.
pub(super) fn write_sheet(document: &mut Document, path: PathBuf) {
    let display = document.display;
    let pictures: Vec<_> = document
        .front
        .compare
        .snapshots
        .list()
        .iter()
        .filter_map(|s| Some((s.name.clone(), s.image.clone()?, s.is_displayed)))
        .collect();
    document.start_job(move || {
        let shown = pictures.into_iter().map(|(name, image, is_displayed)| {
            let own = if is_displayed { Display::default() } else { display };
            (name, own.show(&image))
        });
        let shown: Vec<_> = shown.collect();
        if is_pdf(&path) {
            return ltm::files::write_file(&path, true, &pdf::sheet(&shown)?).map(|()| wrote(&path));
        }
        let sheet = contact_sheet(&shown)?;
        export::write_rgba(&path, sheet.size, &sheet.rgba).map(|()| wrote(&path))
    });
}

/// Writes an animation from snapshot to snapshot, as numbered pictures or a video: by the times of the look's file, else evenly.
pub(super) fn write_animation(document: &mut Document, path: PathBuf) {
    let mixes = document.front.compare.snapshots.mixes();
    let mix_of = |name: &String| mixes.iter().find(|(own, _)| own == name).map(|(_, mix)| mix);
    let by_file: Vec<(f32, &Mix)> =
        document.work.keys.iter().filter_map(|(time, name)| Some((*time, mix_of(name)?))).collect();
    let step_secs = document.front.compare.step_secs;
    let evenly = mixes.iter().enumerate().map(|(index, (_, mix))| (index as f32 * step_secs, mix));
    let timed: Vec<(f32, &Mix)> = if by_file.len() > 1 { by_file } else { evenly.collect() };
    let lit = timed.into_iter().map(|(time, mix)| Ok((time, document.front.lighting(mix)?)));
    let looks = lit.collect::<Result<Vec<_>>>();
    let (container, relighter) = (document.front.session.container.clone(), document.front.shown.relighter.clone());
    let (display, per_sec) = (document.display, document.front.compare.frames_per_sec);
    document.start_job(move || {
        let looks = looks?;
        let frames = frames(&looks, per_sec)?;
        let relight = |lighting: &Lighting| match &relighter {
            Some(relighter) => relighter.relight(lighting),
            None => relight_streaming(&*container, lighting).map(|(image, _)| image),
        };
        animation::write(&path, &frames, per_sec, &display, relight).map(Brought::Message)
    });
}

/// Copies the container that is shown.
pub(super) fn copy_container(document: &mut Document, path: PathBuf) {
    let from = document.front.session.path.clone();
    document.start_job(move || {
        // Onto itself it stays what it is: it is replaced only once the copy stands.
        let mut source = ltm::files::open_input(&from, "copy")?;
        ltm::files::replace(&path, true, |target| {
            std::io::copy(&mut source, target)
                .map(drop)
                .map_err(Error::io(&path, format!("copy {} to it", from.display())))
        })?;
        Ok(wrote(&path))
    });
}
