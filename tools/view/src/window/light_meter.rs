//! The light meter: the picture in cd/m² or lx, over areas drawn in it.

use std::sync::Arc;

use eframe::egui::{self, Color32, DragValue, Rect, RichText, Sense, TextureHandle, TextureId, Ui, pos2, vec2};

use super::chooser::Purpose;
use super::document::Document;
use super::number_format::short;
use super::shown_picture::set_texture;
use super::theme::{ACCENT, WEAK, section};
use crate::display::Shown;
use crate::meter::{Area, Field, Figures, Label, Measured, Scale, coloured, labels, measure};
use crate::surfaces::Surfaces;
use crate::worker::Brought;

/// What is known of the surfaces.
#[derive(Default)]
pub(super) enum Known {
    /// Nobody has asked yet.
    #[default]
    Unasked,
    /// They are being read.
    Reading,
    /// They are known.
    Surfaces(Arc<Surfaces>),
    /// They are not, and why.
    Not(String),
}

/// What the values were measured of: generation of the picture, what, with surfaces, lumens of a watt.
type FieldKey = (u64, Measured, bool, u32);

#[derive(Default)]
pub(super) struct LightMeter {
    /// What the picture is shown in, instead of its colours.
    pub(super) shows: Option<Measured>,
    /// What was shown last; the area is measured in it.
    measured: Measured,
    /// The scale; none: it follows the picture.
    scale: Option<Scale>,
    /// Whether isolines are hidden.
    no_lines: bool,
    pub(super) area: Area,
    /// Whether clicks on the picture set corners of the area.
    pub(super) draws: bool,
    pub(super) known: Known,
    field: Option<(FieldKey, Field)>,
    pub(super) figures: Option<Figures>,
    of_figures: Option<(FieldKey, Area)>,
    /// The picture in colours, with what it was made of.
    overlay: Option<(FieldKey, Scale, Shown)>,
    /// Labels of the isolines.
    labels: Vec<Label>,
    texture: Option<TextureHandle>,
}

impl LightMeter {
    /// The scale of what is shown.
    fn scale(&self) -> Option<Scale> {
        let field = self.field.as_ref().map(|(_, field)| field)?;
        let scale = self.scale.unwrap_or_else(|| Scale::fitting(field));
        Some(Scale { lines: !self.no_lines, ..scale })
    }

    /// The texture to draw instead of the image.
    pub(super) fn id(&self) -> Option<TextureId> {
        self.shows.and(self.texture.as_ref()).map(TextureHandle::id)
    }

    /// Text of the colour legend.
    pub(super) fn legend_in_words(&self) -> Option<String> {
        let (scale, unit) = (self.scale().filter(|_| self.shows.is_some())?, self.measured.unit());
        let lines: Vec<String> = scale.steps().into_iter().map(short).collect();
        let colours = format!("Colours from {} (black) to {} {unit} (white)", short(scale.low), short(scale.high));
        Some(if scale.lines { format!("{colours}; lines at {}", lines.join(", ")) } else { colours })
    }

    /// The picture in colours, as it is shown.
    pub(super) fn overlay(&self) -> Option<&Shown> {
        self.overlay.as_ref().filter(|_| self.shows.is_some()).map(|(_, _, shown)| shown)
    }

    /// The quantity that is measured.
    pub(super) fn measured(&self) -> Measured {
        self.measured
    }

    /// Whether values are lower bounds.
    pub(super) fn is_least(&self) -> bool {
        self.field.as_ref().is_some_and(|(_, field)| field.is_least)
    }

    /// The value of a pixel.
    pub(super) fn value(&self, [x, y]: [u32; 2]) -> Option<f32> {
        let (_, field) = self.field.as_ref()?;
        field.values.get(y as usize * field.size[0] + x as usize).copied().flatten()
    }

    fn is_used(&self) -> bool {
        self.shows.is_some() || self.area.corners.len() > 2
    }
}

impl Document {
    /// Has the surfaces read, unless they were already.
    pub(super) fn ask_surfaces(&mut self) {
        if !matches!(self.meter.known, Known::Unasked) {
            return;
        }
        self.meter.known = Known::Reading;
        let (path, container) = (self.session.path.clone(), self.session.container.clone());
        self.session.worker.beside(move || {
            let surfaces = Surfaces::beside(&path, &container).map_err(|error| error.to_string());
            Ok(Brought::Surfaces(surfaces.map(Arc::new)))
        });
    }

    /// Measures what has come, where somebody looks at it.
    pub(super) fn refresh_meter(&mut self, context: &egui::Context) {
        let Ok(gain) = self.lumens_per_watt() else { return self.meter.shows = None };
        let Some(image) = self.shown.image.clone().filter(|_| self.meter.is_used()) else { return };
        if self.meter.measured == Measured::Illuminance {
            self.ask_surfaces();
        }
        let surfaces = match &self.meter.known {
            Known::Surfaces(surfaces) => Some(surfaces.clone()),
            _ => None,
        };
        let measured = self.meter.measured;
        let key = (self.shown.valued, measured, surfaces.is_some(), gain.to_bits());
        let meter = &mut self.meter;
        if meter.field.as_ref().is_none_or(|(of, _)| *of != key) {
            meter.field = Some((key, measure(&image, gain, measured, surfaces.as_deref())));
        }
        let Some((_, field)) = &meter.field else { return };
        if meter.of_figures.as_ref().is_none_or(|of| *of != (key, meter.area.clone())) {
            meter.figures = meter.area.figures(field);
            meter.of_figures = Some((key, meter.area.clone()));
        }
        let Some(scale) = meter.scale().filter(|_| meter.shows.is_some()) else { return };
        if meter.overlay.as_ref().is_none_or(|(of, at, _)| (*of, *at) != (key, scale)) {
            match coloured(field, scale) {
                Ok(shown) => {
                    set_texture(context, &mut meter.texture, "meter", &shown);
                    meter.labels = if scale.lines { labels(field, scale) } else { Vec::new() };
                    meter.overlay = Some((key, scale, shown));
                }
                Err(error) => {
                    (meter.shows, meter.scale) = (None, None);
                    self.files.message = Some((error.to_string(), true));
                }
            }
        }
    }
}

/// The meter's part of the panel.
pub(super) fn light_meter(ui: &mut Ui, document: &mut Document) {
    section(ui, "LIGHT METER");
    if let Err(reason) = document.lumens_per_watt() {
        ui.label(RichText::new(format!("Not in cd/m² or lx: {reason}.")).size(12.0).color(WEAK));
        let is_known_by_picture = reason.contains("picture");
        if !is_known_by_picture && ui.button("Take one unit for 1 m").clicked() {
            document.view.assumes_metres = true;
        }
        return;
    }
    let meter = &mut document.meter;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for (name, shows, about) in [
            ("Off", None, "The picture in its colours"),
            ("Luminance", Some(Measured::Luminance), "What is seen, in cd/m²"),
            ("Illuminance", Some(Measured::Illuminance), "What falls on surfaces, in lx"),
        ] {
            if ui.selectable_label(meter.shows == shows, name).on_hover_text(about).clicked() {
                meter.shows = shows;
                if let Some(measured) = shows.filter(|measured| *measured != meter.measured) {
                    (meter.measured, meter.scale) = (measured, None);
                }
            }
        }
    });
    if meter.shows.is_some() {
        legend(ui, meter);
    }
    area(ui, document);
    if document.meter.measured == Measured::Illuminance && document.meter.is_used() {
        origin(ui, document);
    }
}

/// Tells where illuminances come from.
fn origin(ui: &mut Ui, document: &Document) {
    let (text, about) = match &document.meter.known {
        Known::Surfaces(_) => ("With the surfaces' own albedo".to_owned(), String::new()),
        Known::Not(reason) => ("At least: surfaces are taken for white".to_owned(), reason.clone()),
        Known::Unasked | Known::Reading => ("Reading the surfaces…".to_owned(), String::new()),
    };
    let about = match about.as_str() {
        "" => "E = π L / ρ at pixels that show one surface; mirrors, glass and lamps have no value".to_owned(),
        reason => format!("The matrix beside the container would tell their albedo: {reason}"),
    };
    ui.label(RichText::new(text).size(11.0).color(WEAK)).on_hover_text(about);
}

/// The colours with their values, and what can be set of them.
fn legend(ui: &mut Ui, meter: &mut LightMeter) {
    let Some(scale) = meter.scale() else { return };
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 26.0), Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), 10.0));
    let colours = scale.colours(96);
    for (i, [r, g, b]) in colours.iter().enumerate() {
        let [left, right] = [i, i + 1].map(|i| bar.left() + bar.width() * i as f32 / colours.len() as f32);
        let part = Rect::from_x_y_ranges(left..=right + 0.5, bar.y_range());
        ui.painter().rect_filled(part, 0.0, Color32::from_rgb(*r, *g, *b));
    }
    let x = |value: f32| bar.left() + bar.width() * (value / scale.low).ln() / (scale.high / scale.low).ln();
    let mut free = rect.left();
    for step in scale.steps() {
        ui.painter().vline(x(step), bar.y_range(), (1.0, Color32::WHITE));
        let galley =
            ui.painter().layout_no_wrap(short(step), egui::FontId::proportional(10.0), ui.visuals().text_color());
        let width = galley.size().x;
        let left = (x(step) - width / 2.0).clamp(rect.left(), rect.right() - width);
        if left >= free {
            ui.painter().galley(pos2(left, bar.bottom() + 2.0), galley, WEAK);
            free = left + width + 6.0;
        }
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let mut own = scale;
        let number = |value: &mut f32, ui: &mut Ui| {
            let speed = f64::from(*value) * 0.02;
            let number = DragValue::new(value).speed(speed).range(1e-6..=1e9).custom_formatter(|v, _| short(v as f32));
            ui.add(number).changed()
        };
        let mut changed = number(&mut own.low, ui);
        ui.label("to");
        changed |= number(&mut own.high, ui);
        ui.label(meter.measured.unit());
        if changed && own.low < own.high {
            meter.scale = Some(own);
        }
        let follows = meter.scale.is_none();
        if ui.add_enabled(!follows, egui::Button::new("Fit")).on_hover_text("A scale that fits the picture").clicked() {
            meter.scale = None;
        }
        let mut lines = !meter.no_lines;
        if ui.checkbox(&mut lines, "Lines").on_hover_text("Lines of equal value").changed() {
            meter.no_lines = !lines;
        }
    });
}

/// The area and what was measured in it.
fn area(ui: &mut Ui, document: &mut Document) {
    let meter = &mut document.meter;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let about = "Click its corners in the picture; Enter or a double click ends it. Corners can be dragged later.";
        if ui.selectable_label(meter.draws, "Draw area").on_hover_text(about).clicked() {
            meter.draws = !meter.draws;
            if meter.draws {
                meter.area = Area { corners: Vec::new(), is_rectangle: true };
            }
        }
        let some = !meter.area.corners.is_empty();
        if ui.add_enabled(some, egui::Button::new("Clear")).clicked() {
            (meter.area, meter.draws) = (Area::default(), false);
        }
        if ui
            .button("Report…")
            .on_hover_text("A table of lights and of this area, as CSV, or as PDF with the picture")
            .clicked()
        {
            document.files.wanted = Some(Purpose::Report);
        }
    });
    let meter = &mut document.meter;
    if meter.area.corners.len() == 4 {
        let about = "Measured on an even grid as it lies in the scene; else each pixel counts as much as another.";
        ui.checkbox(&mut meter.area.is_rectangle, "A rectangle in the scene").on_hover_text(about);
    }
    if let Some(figures) = meter.figures.filter(|_| meter.area.corners.len() > 2) {
        let unit = meter.measured.unit();
        let least = if meter.is_least() { "≥ " } else { "" };
        let value = |value: f32| format!("{least}{}", short(value));
        let text = format!(
            "Ē {} {unit}   min {}   max {}   U₀ {:.2}",
            value(figures.average),
            value(figures.least),
            value(figures.most),
            figures.uniformity()
        );
        ui.label(RichText::new(text).size(12.0));
    } else if meter.draws {
        let count = meter.area.corners.len();
        ui.label(RichText::new(format!("{count} corners; Enter ends")).size(12.0).color(ACCENT));
    }
}

/// Writes the values at the lines. `to_screen` brings picture positions there.
pub(super) fn draw_labels(painter: &egui::Painter, meter: &LightMeter, to_screen: impl Fn([f32; 2]) -> egui::Pos2) {
    for label in meter.labels.iter().filter(|_| meter.shows.is_some()) {
        let galley = painter.layout_no_wrap(short(label.value), egui::FontId::proportional(11.0), Color32::WHITE);
        let place = egui::Align2::CENTER_CENTER.anchor_size(to_screen(label.at), galley.size());
        painter.rect_filled(place.expand2(vec2(3.0, 1.0)), 3.0, Color32::from_black_alpha(190));
        painter.galley(place.min, galley, Color32::WHITE);
    }
}

/// Draws the area over the picture. `to_screen` brings picture positions there.
pub(super) fn draw_area(painter: &egui::Painter, meter: &LightMeter, to_screen: impl Fn([f32; 2]) -> egui::Pos2) {
    let corners: Vec<egui::Pos2> = meter.area.corners.iter().map(|corner| to_screen(*corner)).collect();
    if corners.is_empty() {
        return;
    }
    let outline = |stroke: (f32, Color32)| match meter.draws {
        true => egui::Shape::line(corners.clone(), stroke),
        false => egui::Shape::closed_line(corners.clone(), stroke),
    };
    painter.add(outline((3.0, Color32::from_black_alpha(150))));
    painter.add(outline((1.5, ACCENT)));
    for corner in corners {
        painter.circle_filled(corner, 4.0, Color32::from_black_alpha(150));
        painter.circle_filled(corner, 3.0, ACCENT);
    }
}
