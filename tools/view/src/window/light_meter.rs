//! The light meter: the picture in cd/m² or lx, over areas drawn in it.

use std::sync::Arc;

use eframe::egui::{self, TextureHandle, TextureId};

use super::number_format::short;
use super::sampling::Sampling;
use super::shown_picture::set_texture;
use crate::display::Shown;
use crate::meter::{Area, Field, Figures, Label, Measured, Scale, coloured, labels, measure};
use crate::surfaces::Surfaces;
use ltm::error::Result;
use ltm::image::LinearImage;

/// The picture that is measured.
pub(super) struct MeteredPicture<'a> {
    /// Generation of its values.
    pub(super) generation: u64,
    pub(super) image: &'a LinearImage,
    /// What makes its luminances cd/m².
    pub(super) lumens_per_watt: f32,
}

/// What the values were measured of.
#[derive(Clone, Copy, PartialEq)]
struct FieldKey {
    /// Generation of the picture.
    generation: u64,
    measured: Measured,
    with_surfaces: bool,
    lumens_per_watt: f32,
}

/// The picture in colours.
struct Overlay {
    /// What it was made of.
    of: FieldKey,
    scale: Scale,
    shown: Shown,
}

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
    field: Option<(FieldKey, Field)>,
    pub(super) figures: Option<Figures>,
    of_figures: Option<(FieldKey, Area)>,
    overlay: Option<Overlay>,
    /// Labels of the isolines.
    labels: Vec<Label>,
    texture: Option<TextureHandle>,
    sampling: Sampling,
}

impl LightMeter {
    /// Goes on over a picture of the same view that is `scale` times as large.
    pub(super) fn go_on(&mut self, old: Self, scale: f32) {
        let mut area = old.area;
        area.corners.iter_mut().for_each(|corner| *corner = corner.map(|at| at * scale));
        let Self { shows, measured, scale: shown, no_lines, draws, .. } = old;
        *self = Self { shows, measured, scale: shown, no_lines, draws, area, ..Self::default() };
    }

    /// The scale of what is shown.
    pub(super) fn scale(&self) -> Option<Scale> {
        let field = self.field.as_ref().map(|(_, field)| field)?;
        let scale = self.scale.unwrap_or_else(|| Scale::fitting(field));
        Some(Scale { lines: !self.no_lines, ..scale })
    }

    /// Shows pictures from now on as sampled so.
    pub(super) fn sample(&mut self, context: &egui::Context, sampling: Sampling) {
        if std::mem::replace(&mut self.sampling, sampling) != sampling
            && let Some(overlay) = &self.overlay
        {
            set_texture(context, &mut self.texture, "meter", &overlay.shown, sampling);
        }
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
        self.overlay.as_ref().filter(|_| self.shows.is_some()).map(|overlay| &overlay.shown)
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

    /// Whether somebody looks at what is measured.
    pub(super) fn is_used(&self) -> bool {
        self.shows.is_some() || self.area.corners.len() > 2
    }

    /// Shows a quantity instead of the picture's colours; none: the colours.
    pub(super) fn show(&mut self, shows: Option<Measured>) {
        self.shows = shows;
        if let Some(measured) = shows.filter(|measured| *measured != self.measured) {
            (self.measured, self.scale) = (measured, None);
        }
    }

    /// Sets the scale; none: it follows the picture.
    pub(super) fn set_scale(&mut self, scale: Option<Scale>) {
        self.scale = scale;
    }

    /// Whether the scale follows the picture.
    pub(super) fn scale_follows(&self) -> bool {
        self.scale.is_none()
    }

    /// Shows isolines, or hides them.
    pub(super) fn show_lines(&mut self, lines: bool) {
        self.no_lines = !lines;
    }

    /// Whether isolines are shown.
    pub(super) fn shows_lines(&self) -> bool {
        !self.no_lines
    }

    /// Labels of the isolines, where they are shown.
    pub(super) fn labels(&self) -> &[Label] {
        if self.shows.is_some() { &self.labels } else { &[] }
    }

    /// Measures a picture, unless that was done. Surfaces tell what falls on them.
    ///
    /// Errors: the values cannot be shown in colours; they are not shown from then on.
    pub(super) fn refresh(
        &mut self,
        context: &egui::Context,
        picture: &MeteredPicture,
        surfaces: Option<&Arc<Surfaces>>,
    ) -> Result<()> {
        let (measured, lumens_per_watt) = (self.measured, picture.lumens_per_watt);
        let with_surfaces = surfaces.is_some();
        let key = FieldKey { generation: picture.generation, measured, with_surfaces, lumens_per_watt };
        if self.field.as_ref().is_none_or(|(of, _)| *of != key) {
            let surfaces = surfaces.map(Arc::as_ref);
            self.field = Some((key, measure(picture.image, lumens_per_watt, measured, surfaces)));
        }
        let Some((_, field)) = &self.field else { return Ok(()) };
        if self.of_figures.as_ref().is_none_or(|(of, area)| *of != key || *area != self.area) {
            self.figures = self.area.figures(field);
            self.of_figures = Some((key, self.area.clone()));
        }
        let Some(scale) = self.scale().filter(|_| self.shows.is_some()) else { return Ok(()) };
        if self.overlay.as_ref().is_none_or(|overlay| overlay.of != key || overlay.scale != scale) {
            match coloured(field, scale) {
                Ok(shown) => {
                    set_texture(context, &mut self.texture, "meter", &shown, self.sampling);
                    self.labels = if scale.lines { labels(field, scale) } else { Vec::new() };
                    self.overlay = Some(Overlay { of: key, scale, shown });
                }
                Err(error) => {
                    (self.shows, self.scale) = (None, None);
                    return Err(error);
                }
            }
        }
        Ok(())
    }
}
