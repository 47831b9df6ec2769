//! What the picture shows beside light, instead of it: albedo, normals, depth.

use eframe::egui::{self, TextureHandle, TextureId};

use super::number_format::short;
use super::sampling::Sampling;
use super::shown_picture::set_texture;
use crate::display::Shown;
use crate::surfaces::Surfaces;
use ltm::matrix::Feature;

#[derive(Default)]
pub(super) struct FeaturesView {
    /// The feature shown instead of light.
    pub(super) shows: Option<Feature>,
    /// The content of the texture.
    made: Option<(Feature, Shown)>,
    texture: Option<TextureHandle>,
    sampling: Sampling,
}

impl FeaturesView {
    /// The image shown instead of light.
    pub(super) fn shown(&self) -> Option<&Shown> {
        self.made.as_ref().filter(|(feature, _)| self.shows == Some(*feature)).map(|(_, shown)| shown)
    }

    /// The texture to draw instead of the image.
    pub(super) fn id(&self) -> Option<TextureId> {
        self.shown().and(self.texture.as_ref()).map(TextureHandle::id)
    }

    /// Shows images from now on as sampled so.
    pub(super) fn sample(&mut self, context: &egui::Context, sampling: Sampling) {
        if std::mem::replace(&mut self.sampling, sampling) != sampling
            && let Some((_, shown)) = &self.made
        {
            set_texture(context, &mut self.texture, "features", shown, sampling);
        }
    }

    /// Makes of the surfaces what is to be shown, unless that was done.
    pub(super) fn refresh(&mut self, context: &egui::Context, surfaces: &Surfaces) {
        let Some(feature) = self.missing() else { return };
        if let Some(shown) = surfaces.shown(feature) {
            set_texture(context, &mut self.texture, "features", &shown, self.sampling);
            self.made = Some((feature, shown));
        }
    }

    /// The feature that is to be shown, and is not yet.
    pub(super) fn missing(&self) -> Option<Feature> {
        self.shows.filter(|_| self.shown().is_none())
    }

    /// What is shown of a pixel instead of light, in words. The picture is `width` pixels wide.
    pub(super) fn in_words(&self, surfaces: &Surfaces, [x, y]: [u32; 2], width: u32) -> Option<String> {
        let pixel = y as usize * width as usize + x as usize;
        let feature = self.shows?;
        let value = surfaces.value(feature, pixel)?;
        Some(value[..feature.planes().len()].iter().map(|v| short(*v)).collect::<Vec<_>>().join(", "))
    }
}
