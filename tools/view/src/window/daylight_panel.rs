//! Daylight by a climate file: the day and the hour that sky and sun show.

use std::path::PathBuf;

use eframe::egui::{DragValue, RichText, Slider, Ui};

use super::chooser::Purpose;
use super::document::Document;
use super::message::{Message, line};
use super::sun_panel::{clock, hours_of};
use super::theme::{WEAK, section};
use crate::daylight::{Daylight, date_in_words};

/// What can be set of the daylight.
pub(super) fn daylight_settings(ui: &mut Ui, document: &mut Document) {
    section(ui, "DAYLIGHT");
    let mut changed = false;
    ui.horizontal_wrapped(|ui| {
        let about = "An EPW or WEA file: sky and sun of any hour of its year";
        if ui.button("Climate…").on_hover_text(about).clicked() {
            document.files.wanted = Some(Purpose::Climate);
        }
        if let Some(daylight) = &document.daylight {
            ui.label(RichText::new(daylight.site()).size(11.5).color(WEAK));
        }
    });
    if let Some(daylight) = &mut document.daylight {
        ui.spacing_mut().slider_width = 120.0;
        let day = Slider::new(&mut daylight.day_of_year, 1..=365).text("day");
        changed |= ui.add(day.custom_formatter(|day, _| date_in_words(day as u16))).changed();
        let hour = Slider::new(&mut daylight.hour, 0.0..=24.0).step_by(1.0 / 12.0).text("hour");
        changed |= ui.add(hour.custom_formatter(|hour, _| clock(hour)).custom_parser(hours_of)).changed();
        let north = DragValue::new(&mut daylight.north_degrees).range(-180.0..=180.0).speed(0.5).max_decimals(1);
        let about = "How far north is turned from the world's −z towards +x";
        changed |= ui.add(north.prefix("north ").suffix("°")).on_hover_text(about).changed();
    }
    if changed {
        put(document);
    }
}

/// Takes up a climate.
pub(super) fn open_climate(document: &mut Document, path: PathBuf) {
    match Daylight::read(&path) {
        Ok(daylight) => {
            document.daylight = Some(daylight);
            put(document);
        }
        Err(error) => document.message = Some(Message::problem(line(&error))),
    }
}

fn put(document: &mut Document) {
    let Some(daylight) = &document.daylight else { return };
    let place = document.front.session.path.display().to_string();
    let mut mix = document.work.mix.clone();
    match daylight.put(&place, document.lights.basis(), &mut mix) {
        Ok(()) => document.work.mix = mix,
        Err(error) => document.message = Some(Message::problem(line(&error))),
    }
}
