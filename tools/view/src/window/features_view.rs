//! What the picture shows beside light, instead of it: albedo, normals, depth.

use eframe::egui::{self, RichText, TextureHandle, TextureId, Ui};

use super::document::Document;
use super::light_meter::Known;
use super::number_format::short;
use super::shown_picture::set_texture;
use super::theme::WEAK;
use crate::display::Shown;
use ltm::matrix::Feature;

/// What can be seen, with what is said of it.
const WAYS: [(&str, Option<Feature>, &str); 4] = [
    ("Image", None, "The lit image"),
    ("Albedo", Some(Feature::Albedo), "What part of the light surfaces send on"),
    ("Normals", Some(Feature::Normal), "How surfaces lie: x, y, z as red, green, blue"),
    ("Depth", Some(Feature::Depth), "How far surfaces are: the farther the darker"),
];

#[derive(Default)]
pub(super) struct FeaturesView {
    /// The feature shown instead of light.
    pub(super) shows: Option<Feature>,
    /// The content of the texture.
    made: Option<(Feature, Shown)>,
    texture: Option<TextureHandle>,
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
}

impl Document {
    /// Has the surfaces read, and shows of them what is asked for.
    pub(super) fn refresh_features(&mut self, context: &egui::Context) {
        let Some(feature) = self.features.shows.filter(|_| self.features.shown().is_none()) else { return };
        self.ask_surfaces();
        let Known::Surfaces(surfaces) = &self.meter.known else { return };
        if let Some(shown) = surfaces.shown(feature) {
            set_texture(context, &mut self.features.texture, "features", &shown);
            self.features.made = Some((feature, shown));
        }
    }

    /// What is shown of a pixel instead of light, in words.
    fn feature_in_words(&self, [x, y]: [u32; 2]) -> Option<String> {
        let Known::Surfaces(surfaces) = &self.meter.known else { return None };
        let pixel = y as usize * self.size()[0] as usize + x as usize;
        let feature = self.features.shows?;
        let value = surfaces.value(feature, pixel)?;
        Some(value[..feature.planes().len()].iter().map(|v| short(*v)).collect::<Vec<_>>().join(", "))
    }
}

/// The choice, and what is known of it.
pub(super) fn features(ui: &mut Ui, document: &mut Document) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 6.0;
        for (name, shows, about) in WAYS {
            if ui.selectable_label(document.features.shows == shows, name).on_hover_text(about).clicked() {
                document.features.shows = shows;
            }
        }
    });
    if document.features.shows.is_none() {
        return;
    }
    let text = match &document.meter.known {
        Known::Surfaces(_) => match document.view.hovered.and_then(|pixel| document.feature_in_words(pixel)) {
            Some(value) => value,
            None => "Point at the picture to read it".to_owned(),
        },
        Known::Not(reason) => format!("Not known: {reason}"),
        Known::Unasked | Known::Reading => "Reading the surfaces…".to_owned(),
    };
    ui.label(RichText::new(text).size(11.0).color(WEAK));
}
