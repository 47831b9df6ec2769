//! Files that are read for the document: looks, images, work that was left behind.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::document::Document;
use super::file_jobs::name_of;
use crate::looks::{self, Saved};
use crate::mixer::{LightMix, Mix};
use crate::pattern::Pattern;
use crate::unsaved::LeftBehind;
use crate::worker::Brought;
use ltm::error::{Error, Result};
use ltm::image::{LinearImage, read_image as read_file};
use ltm::light::LightBasis;

/// Reads an image for a light, or as a reference.
pub(super) fn read_image(document: &mut Document, path: PathBuf, light: Option<usize>) {
    document.start_job(move || Ok(Brought::Image { image: read_file(&path)?, path, light }));
}

/// Reads a lighting file.
pub(super) fn read_look(document: &mut Document, path: PathBuf) {
    let basis = Box::new(document.basis().clone());
    document.start_job(move || {
        let saved = Box::new(looks::load(&path, &basis)?);
        Ok(Brought::Look { path, saved, basis })
    });
}

/// Goes on with work that an earlier window left behind.
pub(super) fn recover(document: &mut Document, left: LeftBehind) {
    let basis = Box::new(document.basis().clone());
    // Where it cannot be read it stays for another time.
    document.start_job(move || {
        let saved = Box::new(looks::load(&left.look(), &basis)?);
        Ok(Brought::Recovered { saved, basis, left })
    });
}

/// Takes what a job on files has brought; what to say about it.
pub(super) fn take_file(document: &mut Document, brought: Brought) -> Result<String> {
    match brought {
        Brought::Message(message) => Ok(message),
        Brought::Wrote { path, saved, basis, revision, message } => {
            let saved = over_all_lights(document, *saved, &basis);
            document.work.is_kept(path, saved.mix, revision);
            Ok(message)
        }
        Brought::Look { path, saved, basis } => {
            let message = format!("Loaded {}", path.display());
            let saved = over_all_lights(document, *saved, &basis);
            let mix = saved.mix.clone();
            take_look(document, saved);
            document.work.is_kept(path, mix, document.front.compare.snapshots.revision());
            Ok(message)
        }
        Brought::Recovered { saved, basis, left } => {
            let saved = over_all_lights(document, *saved, &basis);
            take_look(document, saved);
            document.autosave.recovered = Some(left);
            Ok("Recovered unsaved work; save it to keep it".to_owned())
        }
        Brought::Image { path, light: None, image } => add_reference(document, &path, image),
        Brought::Image { path, light: Some(index), image } => {
            lay_image(document, index, &image);
            Ok(format!("{} is on {} now", name_of(&path), document.basis().lights()[index].name))
        }
        // They are no jobs on files.
        Brought::Unsaved(outcome) => outcome.map(|()| String::new()),
        Brought::SnapshotImage { name, .. } => Ok(name),
        Brought::Surfaces(_) | Brought::Difference(..) => Ok(String::new()),
    }
}

/// A lighting file's content over all lights: it is over those that there were when the job began, and views may have been added since.
fn over_all_lights(document: &Document, mut saved: Saved, before: &LightBasis) -> Saved {
    let all = document.basis();
    if before.lights().len() < all.lights().len() {
        let grown = |mix: &Mix| mix.grown(before, all, &document.work.scene);
        saved.mix = grown(&saved.mix);
        saved.snapshots.iter_mut().for_each(|(_, mix)| *mix = grown(mix));
    }
    saved
}

/// Takes a lighting file's content instead of the mix, as one step, and of the snapshots.
fn take_look(document: &mut Document, saved: Saved) {
    let Saved { mix, snapshots, display, keys } = saved;
    document.work.replace(mix);
    if !snapshots.is_empty() || !document.front.compare.snapshots.mixes().is_empty() {
        document.front.compare.snapshots.read(snapshots);
        document.front.compare.forget_thumbnails();
    }
    document.work.keys = keys;
    if let Some(display) = display {
        document.set_display(display);
    }
}

/// Lays an image over a light: a picture multiplies an area light, a map becomes what an environment sends.
fn lay_image(document: &mut Document, index: usize, image: &LinearImage) {
    let light = &document.lights.lights()[index];
    let mut pattern = Pattern::of_image(light.kind, image);
    let mut mix = document.work.mix.clone();
    let own = &mut mix.lights[index];
    if light.kind.is_environment() {
        *own = LightMix { solo: own.solo, ..LightMix::of_weights(light, pattern.texels()) };
    } else {
        // A picture brighter than white would be no picture of this light.
        let peak = pattern.texels().iter().flatten().copied().fold(1.0, f32::max);
        pattern.texels_mut().iter_mut().flatten().for_each(|v| *v /= peak);
        (own.pattern, own.shape) = (Some(pattern), None);
    }
    document.work.replace(mix);
}

/// Adds an image of the picture's size to compare with.
fn add_reference(document: &mut Document, path: &Path, image: LinearImage) -> Result<String> {
    let [width, height] = document.size();
    if [image.width, image.height] != [width, height] {
        let problem = format!("is {} × {} pixels, and the picture is {width} × {height}", image.width, image.height);
        return Err(Error::input(path.display().to_string(), problem, "choose an image of the picture's size"));
    }
    // What is linear is kept in EXR, HDR and PFM; all else was made for a display.
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    let is_displayed = !["exr", "hdr", "pfm"].contains(&ending.as_str());
    let name = name_of(path);
    let index = document.front.compare.snapshots.add_reference(&name, Arc::new(image), is_displayed);
    document.front.compare.forget_thumbnail(&name);
    if document.front.compare.snapshots.compared() != Some(index) {
        document.front.compare.snapshots.toggle_compare(index);
    }
    let how = if is_displayed { ", shown as it is" } else { "" };
    Ok(format!("Comparing with {name}{how}"))
}
