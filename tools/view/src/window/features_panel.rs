//! Which feature the picture shows instead of light.

use eframe::egui::{RichText, Ui};

use super::document::Document;
use super::surfaces_state::SurfacesState;
use super::theme::WEAK;
use ltm::matrix::Feature;

/// What can be seen, with what is said of it.
const WAYS: [(&str, Option<Feature>, &str); 4] = [
    ("Image", None, "The lit image"),
    ("Albedo", Some(Feature::Albedo), "What part of the light surfaces send on"),
    ("Normals", Some(Feature::Normal), "How surfaces lie: x, y, z as red, green, blue"),
    ("Depth", Some(Feature::Depth), "How far surfaces are: the farther the darker"),
];

/// The choice, and what is known of it.
pub(super) fn features(ui: &mut Ui, document: &mut Document) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 6.0;
        for (name, shows, about) in WAYS {
            if ui.selectable_label(document.front.features.shows == shows, name).on_hover_text(about).clicked() {
                document.front.features.shows = shows;
            }
        }
    });
    if document.front.features.shows.is_none() {
        return;
    }
    let text = match &document.front.surfaces {
        SurfacesState::Known(surfaces) => {
            let [width, _] = document.size();
            let value =
                document.front.view.hovered.and_then(|pixel| document.front.features.in_words(surfaces, pixel, width));
            value.unwrap_or_else(|| "Point at the picture to read it".to_owned())
        }
        SurfacesState::Unknown(reason) => format!("Not known: {reason}"),
        SurfacesState::Unasked | SurfacesState::Reading => "Reading the surfaces…".to_owned(),
    };
    ui.label(RichText::new(text).size(11.0).color(WEAK));
}
