//! What the picture is compared with: snapshots, references, and how far the two are apart.

use std::collections::BTreeMap;
use std::sync::Arc;

use eframe::egui::{self, TextureHandle, TextureId, TextureOptions};

use super::renaming::Renaming;
use super::sampling::Sampling;
use super::shown_picture::{colour_image, set_texture};
use crate::difference::Difference;
use crate::display::{Display, Shown};
use crate::snapshots::{Snapshots, thumbnail};
use crate::worker::Compared;

/// What a difference is of.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct DifferenceKey {
    /// Generation of the picture.
    pub(super) generation: u64,
    /// How it is shown.
    pub(super) display: Display,
    /// Address of the other picture.
    pub(super) other: usize,
}

#[derive(Default)]
pub(super) struct Comparison {
    pub(super) snapshots: Snapshots,
    /// A snapshot whose name is being typed.
    pub(super) renamed: Option<Renaming>,
    thumbnails: BTreeMap<String, TextureHandle>,
    texture: Option<(Arc<Shown>, TextureHandle)>,
    sampling: Sampling,
    /// What was measured last, and of what; nothing while it is being measured.
    difference: Option<(DifferenceKey, Option<Arc<Difference>>)>,
    /// The comparison being measured.
    measuring: Option<DifferenceKey>,
    difference_texture: Option<TextureHandle>,
    /// Whether to take a snapshot as soon as the picture's values are there.
    pub(super) snapshot_wanted: bool,
    /// Whether the image of a snapshot is being made.
    pub(super) is_relighting: bool,
    /// Seconds from one snapshot to the next in an animation, and its rate.
    pub(super) step_secs: f32,
    pub(super) frames_per_sec: f32,
}

impl Comparison {
    pub(super) fn new() -> Self {
        Self { step_secs: 2.0, frames_per_sec: 24.0, ..Self::default() }
    }

    /// What the picture is compared with, if its picture is there.
    pub(super) fn compared(&self) -> Option<Compared> {
        let snapshot = &self.snapshots.list()[self.snapshots.compared()?];
        Some(Compared { image: snapshot.image.clone()?, is_displayed: snapshot.is_displayed })
    }

    /// The compared picture, as the worker shows it.
    pub(super) fn take(&mut self, context: &egui::Context, shown: Option<Arc<Shown>>) {
        let Some(shown) = shown else { return self.texture = None };
        let (kept, mut texture) = self.texture.take().unzip();
        if !kept.is_some_and(|kept| Arc::ptr_eq(&kept, &shown)) {
            set_texture(context, &mut texture, "compared", &shown, self.sampling);
        }
        self.texture = texture.map(|texture| (shown, texture));
    }

    /// Shows pictures from now on as sampled so.
    pub(super) fn sample(&mut self, context: &egui::Context, sampling: Sampling) {
        if std::mem::replace(&mut self.sampling, sampling) == sampling {
            return;
        }
        if let Some((shown, _)) = self.texture.take() {
            self.take(context, Some(shown));
        }
        if let Some((_, Some(difference))) = &self.difference {
            set_texture(context, &mut self.difference_texture, "difference", &difference.map, sampling);
        }
    }

    /// The texture to draw beside the wipe.
    pub(super) fn id(&self) -> Option<TextureId> {
        self.texture.as_ref().map(|(_, texture)| texture.id())
    }

    /// The small picture of a snapshot, made once; none before its picture is there.
    pub(super) fn thumbnail(
        &mut self,
        context: &egui::Context,
        index: usize,
        display: Display,
    ) -> Option<TextureHandle> {
        let snapshot = &self.snapshots.list()[index];
        if let Some(texture) = self.thumbnails.get(&snapshot.name) {
            return Some(texture.clone());
        }
        let display = if snapshot.is_displayed { Display::default() } else { display };
        let shown = display.show(&thumbnail(snapshot.image.as_ref()?, 128));
        let texture = context.load_texture(&snapshot.name, colour_image(&shown), TextureOptions::LINEAR);
        self.thumbnails.insert(snapshot.name.clone(), texture.clone());
        Some(texture)
    }

    /// Whether a difference is to be measured: it is not known, and none is being measured.
    pub(super) fn begin_difference(&mut self, key: DifferenceKey) -> bool {
        let is_known = self.difference.as_ref().is_some_and(|(of, _)| *of == key);
        if is_known || self.measuring.is_some() {
            return false;
        }
        self.measuring = Some(key);
        true
    }

    pub(super) fn is_measuring(&self) -> bool {
        self.measuring.is_some()
    }

    /// Takes a difference that was measured of the picture of this generation.
    pub(super) fn take_difference(&mut self, context: &egui::Context, of: u64, difference: Option<Arc<Difference>>) {
        let Some(key) = self.measuring.take().filter(|key| key.generation == of) else { return };
        if let Some(difference) = &difference {
            set_texture(context, &mut self.difference_texture, "difference", &difference.map, self.sampling);
        }
        self.difference = Some((key, difference));
    }

    pub(super) fn forget_difference(&mut self) {
        self.difference = None;
    }

    /// How far the pictures are apart, where that is known.
    pub(super) fn difference(&self) -> Option<&Difference> {
        self.difference.as_ref()?.1.as_deref()
    }

    /// The difference as a picture.
    pub(super) fn difference_id(&self) -> Option<TextureId> {
        self.difference().and(self.difference_texture.as_ref()).map(TextureHandle::id)
    }

    /// Makes the small picture of a snapshot anew.
    pub(super) fn forget_thumbnail(&mut self, name: &str) {
        self.thumbnails.remove(name);
    }

    /// Makes all small pictures anew: the snapshots are others, whatever their names.
    pub(super) fn forget_thumbnails(&mut self) {
        self.thumbnails.clear();
    }

    /// Goes on with the lightings of the snapshots, and the settings, of a view that was in front before.
    pub(super) fn share(&mut self, front: &mut Self) {
        self.snapshots.share(&front.snapshots);
        self.forget_thumbnails();
        (self.step_secs, self.frames_per_sec) = (front.step_secs, front.frames_per_sec);
        self.snapshot_wanted = std::mem::take(&mut front.snapshot_wanted);
        (self.renamed, front.renamed) = (None, None);
    }

    /// Takes a snapshot away.
    pub(super) fn remove(&mut self, index: usize) {
        self.thumbnails.remove(&self.snapshots.list()[index].name);
        self.snapshots.remove(index);
    }
}

/// The numbers of a difference.
pub(super) fn difference_in_words(difference: &Difference) -> String {
    match difference.psnr_db.is_finite() {
        true => format!("FLIP {:.3}   PSNR {:.1} dB", difference.flip, difference.psnr_db),
        false => "Equal, pixel by pixel".to_owned(),
    }
}
