//! The sun: put into a sky by hand or by date and place, or chosen among several.

use eframe::egui::{DragValue, RichText, Ui};

use super::document::Document;
use super::message::line;
use super::pattern_editor::PatternEditorState;
use super::theme::{WEAK, section};
use crate::mixer::LightMix;
use crate::sun::{Moment, choose_sun, suns};
use ltm::light::Light;

/// What can be set of the sun of a sky.
pub(super) fn sun_settings(
    ui: &mut Ui,
    editor: &mut PatternEditorState,
    own: &mut LightMix,
    index: usize,
    light: &Light,
    has_camera: bool,
) {
    let texel = editor.sun.as_ref().and_then(|sun| sun.texel(index, own));
    ui.horizontal_wrapped(|ui| {
        ui.label("Sun over sky");
        let stops = DragValue::new(&mut editor.sun_stops).range(-4.0..=10.0).speed(0.05).max_decimals(1);
        let about = "How much more the sun sends than the rest of the sky, in stops";
        let changed = ui.add(stops.suffix(" EV")).on_hover_text(about).changed();
        if let (true, Some(texel)) = (changed, texel) {
            editor.put_sun(own, index, light, texel);
        }
        match texel {
            Some(texel) => {
                let angles = editor.moment.angles(light.places[texel]);
                let text = format!("{:.0}° from north, {:.0}° high", angles.azimuth, angles.elevation);
                ui.label(RichText::new(text).size(11.5).color(WEAK));
            }
            None => {
                let where_to = match has_camera {
                    true => "Click on the map below or in the picture",
                    false => "Click or drag on the map below",
                };
                ui.label(RichText::new(where_to).size(11.5).color(WEAK));
            }
        }
    });
    if let Some(direction) = by_date(ui, &mut editor.moment) {
        editor.put_sun(own, index, light, light.nearest_texel(direction));
    }
}

/// What can be done with a sun of the scene: it stands where it was rendered, but may be one of several.
pub(super) fn sun_of_several(ui: &mut Ui, document: &mut Document, index: usize) {
    section(ui, "SUN");
    let count = suns(document.basis()).len();
    let angles = document.editor.moment.angles(document.lights.lights()[index].places[0]);
    let text = format!(
        "It stands {:.0}° from north, {:.0}° high, as it was rendered. {}",
        angles.azimuth,
        angles.elevation,
        match count {
            1 => "Render several suns, or a sky, to move it.".to_owned(),
            _ => format!("By date, the nearest of {count} suns is left on."),
        }
    );
    ui.label(RichText::new(text).size(11.5).color(WEAK));
    if count < 2 {
        return;
    }
    if let Some(direction) = by_date(ui, &mut document.editor.moment) {
        let mut mix = document.work.mix.clone();
        if let Some(sun) = choose_sun(document.basis(), &mut mix, direction) {
            document.work.replace(mix);
            document.list.select_and_show(sun, &document.work.mix);
        }
    }
}

/// Date, hour, place and north; the direction to the sun then, where it was asked for.
fn by_date(ui: &mut Ui, moment: &mut Moment) -> Option<[f32; 3]> {
    let mut changed = false;
    ui.horizontal_wrapped(|ui| {
        let [year, month, day] = &mut moment.date;
        let mut number = |ui: &mut Ui, widget: DragValue, about: &str| {
            changed |= ui.add(widget).on_hover_text(about).changed();
        };
        number(ui, DragValue::new(year).range(1900..=2200).speed(0.05), "Year");
        number(ui, DragValue::new(month).range(1..=12).speed(0.05), "Month");
        number(ui, DragValue::new(day).range(1..=31).speed(0.1), "Day");
        let hour = DragValue::new(&mut moment.hour).range(0.0..=23.983).speed(0.02);
        let hour = hour.custom_formatter(|hours, _| clock(hours)).custom_parser(hours_of);
        number(ui, hour, "Hour on the clock there; drag it through the day");
        let zone = DragValue::new(&mut moment.zone_hours).range(-12.0..=14.0).speed(0.05).prefix("UTC ");
        number(
            ui,
            zone.custom_formatter(|hours, _| format!("{hours:+}")),
            "Hours ahead of universal time, summer time too",
        );
        let latitude = DragValue::new(&mut moment.latitude).range(-90.0..=90.0).speed(0.1).max_decimals(2);
        number(ui, latitude.suffix("° N"), "Latitude; negative in the south");
        let longitude = DragValue::new(&mut moment.longitude).range(-180.0..=180.0).speed(0.1).max_decimals(2);
        number(ui, longitude.suffix("° E"), "Longitude; negative in the west");
        let north = DragValue::new(&mut moment.north_degrees).range(-180.0..=180.0).speed(0.5).max_decimals(1);
        number(ui, north.prefix("north ").suffix("°"), "How far north is turned from the world's −z towards +x");
    });
    let sun = moment.sun();
    let mut asked = changed;
    ui.horizontal_wrapped(|ui| {
        asked |= ui.button("Put the sun there").clicked();
        let text = match &sun {
            Ok(angles) if angles.elevation > 0.0 => {
                format!("{:.1}° from north, {:.1}° high", angles.azimuth, angles.elevation)
            }
            Ok(_) => "below the horizon".to_owned(),
            Err(error) => line(error),
        };
        ui.label(RichText::new(text).size(11.5).color(WEAK));
    });
    let angles = sun.ok().filter(|angles| asked && angles.elevation > 0.0)?;
    Some(moment.direction(angles))
}

/// An hour as a clock shows it.
pub(super) fn clock(hours: f64) -> String {
    let minutes = (hours * 60.0).round() as u32;
    format!("{:02}:{:02}", minutes / 60, minutes % 60)
}

/// Hours of a text: `14:30` or `14.5`.
pub(super) fn hours_of(text: &str) -> Option<f64> {
    match text.split_once(':') {
        Some((hours, minutes)) => {
            let (hours, minutes) = (hours.trim().parse::<f64>().ok()?, minutes.trim().parse::<f64>().ok()?);
            (0.0..60.0).contains(&minutes).then_some(hours + minutes / 60.0)
        }
        None => text.trim().parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_are_read_as_people_write_them() {
        assert_eq!((hours_of("14:30"), hours_of(" 7.25 "), hours_of("9")), (Some(14.5), Some(7.25), Some(9.0)));
        assert_eq!((hours_of("7:75"), hours_of("noon"), hours_of("")), (None, None, None));
    }
}
