//! The report: the numbers of lights and of the measured area, as CSV or PDF.

use std::path::PathBuf;

use super::document::Document;
use super::file_jobs::{is_pdf, name_of, wrote};
use crate::meter::csv;
use crate::pdf::{self, Table};
use crate::photometry::{mean_weight, quantities};

/// Writes the numbers: lights and measured area.
pub(super) fn write_report(document: &mut Document, path: PathBuf) {
    let tables = tables(document);
    if !is_pdf(&path) {
        let text = csv(&tables.concat());
        return document.start_job(move || ltm::files::write_file(&path, true, text.as_bytes()).map(|()| wrote(&path)));
    }
    let (overlay, legend) = (document.front.meter.overlay().cloned(), document.front.meter.legend_in_words());
    let (image, display, title) =
        (document.front.shown.image.clone(), document.display, name_of(&document.front.session.path));
    document.start_job(move || {
        let shown = overlay.or_else(|| image.map(|image| display.show(&image)));
        let about = legend.unwrap_or_else(|| "As shown in the window".to_owned());
        let pages = pdf::report(&title, shown.as_ref().map(|shown| (shown, about.as_str())), &tables)?;
        ltm::files::write_file(&path, true, &pages).map(|()| wrote(&path))
    });
}

/// The tables of a report: the files, the lights, and what was measured.
fn tables(document: &Document) -> Vec<Table> {
    let text = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect::<Vec<String>>();
    let container = document.front.session.path.display().to_string();
    let look = document.work.saved_in().map_or_else(|| "not saved".to_owned(), |path| path.display().to_string());
    let mut tables = vec![vec![text(&["container", &container]), text(&["look", &look])]];
    let mut rows =
        vec![text(&["light", "kind", "group", "shines", "EV", "share of the picture's light, %", "value", "unit"])];
    let metres = document.metres_per_unit();
    let all: f32 = document.list.contributions.iter().map(|v| v.max(0.0)).sum();
    for (&index, light) in document.front.lights.places().iter().zip(document.front.session.basis().lights()) {
        let mix = &document.work.mix;
        let group = mix.groups.of_light(index).map_or("", |group| mix.groups.group(group).name.as_str());
        let share = document.list.contributions.get(index).map_or(0.0, |v| v.max(0.0) / all.max(f32::MIN_POSITIVE));
        let mut row = text(&[&light.name, light.kind.name(), group]);
        row.push(if mix.shines(index) { "yes" } else { "no" }.to_owned());
        row.extend([format!("{:.3}", mix.stops(index)), format!("{:.2}", share * 100.0)]);
        let weight = mean_weight(document.basis(), mix, index);
        for (quantity, at_one) in quantities(light, metres) {
            row.extend([format!("{:.4}", at_one * weight), quantity.unit().to_owned()]);
        }
        rows.push(row);
    }
    tables.push(rows);
    if let Some(figures) = &document.front.meter.figures {
        let unit = document.front.meter.measured().unit();
        let kind = if document.front.meter.is_least() { "at least: surfaces taken for white" } else { "" };
        let head = text(&["area", "average", "minimum", "maximum", "uniformity U0", "points", "unit", "remark"]);
        let corners: Vec<String> =
            document.front.meter.area.corners.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        let mut row = vec![corners.join("; ")];
        row.extend([figures.average, figures.least, figures.most].map(|value| format!("{value:.3}")));
        row.extend([format!("{:.3}", figures.uniformity()), figures.count.to_string()]);
        row.extend(text(&[unit, kind]));
        tables.push(vec![head, row]);
    }
    tables
}
