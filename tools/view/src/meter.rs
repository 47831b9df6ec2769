//! Measuring the picture: luminance and illuminance, over areas, in colours with lines of equal value.

use std::fmt::Write;

use rayon::prelude::*;

use super::display::Shown;
use super::surfaces::Surfaces;
use ltm::error::Result;
use ltm::files::csv_field;
use ltm::image::{LinearImage, encode_srgb, false_colour, luminance};

/// The quantity that is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measured {
    /// Luminance of what is seen, cd/m².
    Luminance,
    /// Illuminance on surfaces, lx.
    #[default]
    Illuminance,
}

impl Measured {
    /// The sign of its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Luminance => "cd/m²",
            Self::Illuminance => "lx",
        }
    }
}

/// A value for each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Pixels (across, down).
    pub size: [usize; 2],
    /// Values, row by row; none of a pixel that shows no one surface.
    pub values: Vec<Option<f32>>,
    /// Whether values are the least that there can be: surfaces are taken for white.
    pub is_least: bool,
}

/// Measures a picture of radiances. `lumens_per_watt` makes luminances of them.
///
/// A matt surface of albedo ρ sends on `L = ρ E / π`, channel by channel. Where albedos are not known it is taken for white:
/// it gets at least `E = π L`.
pub fn measure(image: &LinearImage, lumens_per_watt: f32, measured: Measured, surfaces: Option<&Surfaces>) -> Field {
    let value = |(pixel, radiance): (usize, &[f32; 3])| match (measured, surfaces) {
        (Measured::Luminance, _) => Some(luminance(*radiance) * lumens_per_watt),
        (Measured::Illuminance, None) => Some(luminance(*radiance) * lumens_per_watt * std::f32::consts::PI),
        (Measured::Illuminance, Some(surfaces)) => surfaces.albedo(pixel).map(|albedo| {
            let irradiance = [0, 1, 2].map(|ch: usize| radiance[ch] / albedo[ch]);
            luminance(irradiance) * lumens_per_watt * std::f32::consts::PI
        }),
    };
    let values = image.pixels.par_iter().enumerate().map(value).collect();
    let is_least = measured == Measured::Illuminance && surfaces.is_none();
    Field { size: [image.width as usize, image.height as usize], values, is_least }
}

/// Measured values of an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Mean.
    pub average: f32,
    /// Smallest value.
    pub least: f32,
    /// Largest value.
    pub most: f32,
    /// Values.
    pub count: usize,
}

impl Figures {
    fn of(values: &[f32]) -> Option<Self> {
        let (first, count) = (*values.first()?, values.len());
        let average = (values.iter().map(|v| f64::from(*v)).sum::<f64>() / count as f64) as f32;
        let least = values.iter().copied().fold(first, f32::min);
        Some(Self { average, least, most: values.iter().copied().fold(first, f32::max), count })
    }

    /// Uniformity U₀ (EN 12464-1): the smallest value over the mean.
    pub fn uniformity(&self) -> f32 {
        if self.average > 0.0 { self.least / self.average } else { 0.0 }
    }
}

/// An area of the picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Area {
    /// Its corners in order, in pixels from the picture's top left.
    pub corners: Vec<[f32; 2]>,
    /// Whether four corners are those of a rectangle in the scene, on which points are spread evenly in space.
    /// Otherwise every pixel counts alike, near or far.
    pub is_rectangle: bool,
}

/// Points along each side of a rectangle.
pub const GRID: usize = 16;

impl Area {
    /// The pixels at which it is measured: the middles of a grid of [`GRID`] × [`GRID`] over a rectangle, else all inside.
    pub fn points(&self, size: [usize; 2]) -> Vec<[usize; 2]> {
        let fits = |[x, y]: [f32; 2]| {
            (x >= 0.0 && y >= 0.0 && x < size[0] as f32 && y < size[1] as f32).then_some([x as usize, y as usize])
        };
        if let Some(map) = self.perspective() {
            let along = |i: usize| (i as f32 + 0.5) / GRID as f32;
            return (0..GRID * GRID).filter_map(|i| fits(map(along(i % GRID), along(i / GRID)))).collect();
        }
        let all = (0..size[0] * size[1]).map(|pixel| [pixel % size[0], pixel / size[0]]);
        all.filter(|&[x, y]| self.holds([x as f32 + 0.5, y as f32 + 0.5])).collect()
    }

    /// What the values of a field over it are; none where there are none.
    pub fn figures(&self, field: &Field) -> Option<Figures> {
        let at = |[x, y]: [usize; 2]| field.values.get(y * field.size[0] + x).copied().flatten();
        let values: Vec<f32> = self.points(field.size).into_iter().filter_map(at).collect();
        Figures::of(&values)
    }

    /// Whether a position is inside, by the number of edges to its right.
    fn holds(&self, [x, y]: [f32; 2]) -> bool {
        let corners = &self.corners;
        let edges = corners.iter().zip(corners.iter().cycle().skip(1));
        edges.filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])).count()
            % 2
            == 1
    }

    /// The map from a rectangle's unit square to the picture (P. Heckbert, *Fundamentals of Texture Mapping and Image
    /// Warping*, 1989, section 2.2.3); none unless there are four corners of a rectangle, each on the outside of the others.
    fn perspective(&self) -> Option<impl Fn(f32, f32) -> [f32; 2]> {
        let [p0, p1, p2, p3]: [[f32; 2]; 4] = self.corners.clone().try_into().ok().filter(|_| self.is_rectangle)?;
        let cross =
            |a: [f32; 2], b: [f32; 2], c: [f32; 2]| (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
        let turns = [cross(p0, p1, p2), cross(p1, p2, p3), cross(p2, p3, p0), cross(p3, p0, p1)];
        if !(turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0)) {
            return None;
        }
        let sum = [0, 1].map(|axis: usize| p0[axis] - p1[axis] + p2[axis] - p3[axis]);
        let (d1, d2) = ([p1[0] - p2[0], p1[1] - p2[1]], [p3[0] - p2[0], p3[1] - p2[1]]);
        let whole = d1[0] * d2[1] - d2[0] * d1[1];
        let g = (sum[0] * d2[1] - d2[0] * sum[1]) / whole;
        let h = (d1[0] * sum[1] - sum[0] * d1[1]) / whole;
        Some(move |u: f32, v: f32| {
            let below = g * u + h * v + 1.0;
            [0, 1].map(|axis: usize| {
                let (a, b) = (p1[axis] - p0[axis] + g * p1[axis], p3[axis] - p0[axis] + h * p3[axis]);
                (a * u + b * v + p0[axis]) / below
            })
        })
    }
}

/// Values between which colours are laid, and lines of equal value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Value shown as black, and all below.
    pub low: f32,
    /// Value shown as white, and all above.
    pub high: f32,
    /// Whether lines are drawn where values pass one of [`steps`](Self::steps).
    pub lines: bool,
}

impl Scale {
    /// A scale of round values that fits a field: from its 5th percentile, but a thousandth of its top at least, to its 99th.
    pub fn fitting(field: &Field) -> Self {
        let mut values: Vec<f32> =
            field.values.iter().flatten().copied().filter(|v| v.is_finite() && *v > 0.0).collect();
        values.sort_unstable_by(f32::total_cmp);
        let at = |part: f32| values.get(((values.len().max(1) - 1) as f32 * part) as usize).copied().unwrap_or(1.0);
        let high = round_up(at(0.99));
        let low = round_down(at(0.05).clamp(high * 1e-3, high * 0.5));
        Self { low, high, lines: true }
    }

    /// Round values between its ends: 1, 2 and 5 times powers of ten.
    pub fn steps(&self) -> Vec<f32> {
        let first = self.low.max(1e-20).log10().floor() as i32;
        let last = self.high.max(1e-20).log10().ceil() as i32;
        let all = (first..=last).flat_map(|power| [1.0, 2.0, 5.0].map(|step| step * 10f32.powi(power)));
        all.filter(|value| *value >= self.low && *value <= self.high).collect()
    }

    /// The colours from its low to its high end, sRGB.
    pub fn colours(&self, count: usize) -> Vec<[u8; 3]> {
        let part = |i: usize| self.low * (self.high / self.low).powf((i as f32 + 0.5) / count as f32);
        let ramp = LinearImage { width: count as u32, height: 1, pixels: (0..count).map(|i| [part(i); 3]).collect() };
        let coloured = false_colour(&ramp, self.low, self.high).map(|image| image.pixels).unwrap_or_default();
        coloured.into_iter().map(|colour| colour.map(|v| (encode_srgb(v) * 255.0 + 0.5) as u8)).collect()
    }
}

/// The least of 1, 2, 5 times a power of ten that is not below a value.
fn round_up(value: f32) -> f32 {
    let power = 10f32.powf(value.max(1e-20).log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|step| step * power).into_iter().find(|step| *step >= value * 0.9999).unwrap_or(value)
}

/// The largest of 1, 2, 5 times a power of ten that is not above a value.
fn round_down(value: f32) -> f32 {
    let power = 10f32.powf(value.max(1e-20).log10().floor());
    [5.0, 2.0, 1.0].map(|step| step * power).into_iter().find(|step| *step <= value * 1.0001).unwrap_or(value)
}

/// A value written at a line of equal value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// Position in pixels from the image's top left.
    pub at: [f32; 2],
    /// The line's value.
    pub value: f32,
}

/// Labels of a line at most, lines that are tried for each, and how near two labels may be, as a share of the picture's width.
const LABELS_A_LINE: usize = 2;
const TRIES: usize = 400;
const LABELS_APART: f32 = 0.12;

/// Where lines of equal value are named: at clear pieces of them, apart from each other and from the picture's edge.
pub fn labels(field: &Field, scale: Scale) -> Vec<Label> {
    let [width, height] = field.size;
    let margin = (width.min(height) / 20).max(7);
    let value = |x: usize, y: usize| field.values[y * width + x];
    // Whether the line of a value passes a pixel.
    let passes = |step: f32, x: usize, y: usize| {
        let is_above = |v: Option<f32>| v.map(|v| v >= step);
        let own = is_above(value(x, y));
        own.is_some()
            && [value(x + 1, y), value(x, y + 1)].into_iter().any(|v| is_above(v).is_some_and(|v| Some(v) != own))
    };
    // A line that goes through has a pixel for each of some rows or columns around; grain has many, an islet few.
    let is_clear = |step: f32, x: usize, y: usize| {
        let around = (y - 6..=y + 6).flat_map(|y| (x - 6..=x + 6).map(move |x| (x, y)));
        (10..=28).contains(&around.filter(|&(x, y)| passes(step, x, y)).count())
    };
    let mut labels: Vec<Label> = Vec::new();
    let apart = LABELS_APART * width as f32;
    if width <= 2 * margin || height <= 2 * margin {
        return labels;
    }
    for step in scale.steps() {
        let rows = (margin..height - margin).into_par_iter();
        let on_line: Vec<(usize, usize)> = rows
            .flat_map_iter(|y| (margin..width - margin).filter(move |&x| passes(step, x, y)).map(move |x| (x, y)))
            .collect();
        let mut of_line = 0;
        for &(x, y) in on_line.iter().step_by(on_line.len() / TRIES + 1) {
            let at = [x as f32 + 1.0, y as f32 + 1.0];
            let is_apart = |label: &Label| (label.at[0] - at[0]).hypot(label.at[1] - at[1]) >= apart;
            if of_line < LABELS_A_LINE && labels.iter().all(is_apart) && is_clear(step, x, y) {
                labels.push(Label { at, value: step });
                of_line += 1;
            }
        }
    }
    labels
}

/// A field in colours; what has no value is grey.
///
/// Errors: a scale whose ends are not positive and in order.
pub fn coloured(field: &Field, scale: Scale) -> Result<Shown> {
    let [width, height] = field.size;
    let pixels = field.values.iter().map(|value| [value.unwrap_or(0.0); 3]).collect();
    let image = LinearImage { width: width as u32, height: height as u32, pixels };
    let colours = false_colour(&image, scale.low, scale.high)?;
    let steps = scale.steps();
    let step_of = |value: Option<f32>| value.map(|value| steps.partition_point(|step| *step <= value));
    let mut rgba = vec![255u8; width * height * 4];
    rgba.par_chunks_mut((width * 4).max(1)).enumerate().for_each(|(y, row)| {
        for (x, bytes) in row.chunks_exact_mut(4).enumerate() {
            let at = y * width + x;
            let own = step_of(field.values[at]);
            let right = if x + 1 < width { step_of(field.values[at + 1]) } else { own };
            let below = if y + 1 < height { step_of(field.values[at + width]) } else { own };
            let is_line =
                scale.lines && [right, below].into_iter().any(|other| other.is_some() && own.is_some() && other != own);
            let colour = match (is_line, field.values[at]) {
                (true, _) => [255; 3],
                (false, Some(_)) => colours.pixels[at].map(|v| (encode_srgb(v) * 255.0 + 0.5) as u8),
                (false, None) => [60; 3],
            };
            bytes[..3].copy_from_slice(&colour);
        }
    });
    Ok(Shown { size: field.size, rgba, histogram: Vec::new() })
}

/// A table in CSV (RFC 4180) of rows of texts.
pub fn csv(rows: &[Vec<String>]) -> String {
    let mut text = String::new();
    for row in rows {
        let cells: Vec<_> = row.iter().map(|cell| csv_field(cell)).collect();
        // A string takes all that is written to it.
        let _ = write!(text, "{}\r\n", cells.join(","));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> Field {
        let values = (0..width * height).map(|i| Some((i % width) as f32 + 1.0)).collect();
        Field { size: [width, height], values, is_least: false }
    }

    #[test]
    fn illuminance_is_that_on_a_matt_surface_or_the_least_that_there_can_be() {
        let image = LinearImage { width: 2, height: 1, pixels: vec![[0.5, 0.25, 0.125], [0.5; 3]] };
        let pi = std::f32::consts::PI;
        // E = π L / ρ: under white light of 1 W/(sr·m²) reflected by half, a quarter, an eighth, all channels get π.
        let surfaces = Surfaces::of_albedo(vec![Some([0.5, 0.25, 0.125]), None]);
        let field = measure(&image, 100.0, Measured::Illuminance, Some(&surfaces));
        assert!((field.values[0].unwrap() - 100.0 * pi).abs() < 1e-2 && field.values[1].is_none() && !field.is_least);
        let least = measure(&image, 100.0, Measured::Illuminance, None);
        assert!((least.values[1].unwrap() - 50.0 * pi).abs() < 1e-3 && least.is_least);
        assert!(least.values[0] < field.values[0]);
        let seen = measure(&image, 100.0, Measured::Luminance, Some(&surfaces));
        assert!((seen.values[1].unwrap() - 50.0).abs() < 1e-3 && !seen.is_least);
    }

    #[test]
    fn figures_are_those_of_the_pixels_inside() {
        let corners = vec![[2.0, 0.0], [6.0, 0.0], [6.0, 4.0], [2.0, 4.0]];
        let area = Area { corners, is_rectangle: false };
        let figures = area.figures(&ramp(10, 4)).unwrap();
        // The columns 2 to 5 have the values 3 to 6.
        assert_eq!((figures.average, figures.least, figures.most, figures.count), (4.5, 3.0, 6.0, 16));
        assert!((figures.uniformity() - 3.0 / 4.5).abs() < 1e-6);
        assert_eq!(Area::default().figures(&ramp(10, 4)), None);
        let outside = Area { corners: vec![[20.0, 0.0], [30.0, 0.0], [30.0, 9.0]], is_rectangle: false };
        assert_eq!(outside.figures(&ramp(10, 4)), None);
    }

    #[test]
    fn a_rectangle_in_perspective_is_measured_as_it_lies_in_the_scene() {
        // A floor from 1 to 3 in depth, seen by x = X / Z: its far half is the smaller part of the picture.
        let seen = |x: f32, z: f32| [100.0 + 80.0 * x / z, 100.0 - 80.0 / z];
        let corners = vec![seen(-1.0, 1.0), seen(1.0, 1.0), seen(1.0, 3.0), seen(-1.0, 3.0)];
        let area = Area { corners, is_rectangle: true };
        let points = area.points([200, 200]);
        assert_eq!(points.len(), GRID * GRID);
        // Row by row: the depth at the middle of each is 1 + 2 (i + ½) / 16.
        for (row, points) in points.chunks_exact(GRID).enumerate() {
            let expected = seen(0.0, 1.0 + 2.0 * (row as f32 + 0.5) / GRID as f32)[1];
            assert!(
                points.iter().all(|point| (point[1] as f32 + 0.5 - expected).abs() <= 0.51),
                "row {row}: {points:?}"
            );
        }
        let crossed = Area { corners: vec![[0.0, 0.0], [9.0, 9.0], [9.0, 0.0], [0.0, 9.0]], is_rectangle: true };
        assert!(crossed.perspective().is_none());
    }

    #[test]
    fn scales_are_round_and_lines_stand_where_values_pass_their_steps() {
        let field = ramp(100, 2);
        let scale = Scale::fitting(&field);
        assert_eq!((scale.low, scale.high), (5.0, 100.0));
        assert_eq!(scale.steps(), [5.0, 10.0, 20.0, 50.0, 100.0]);
        let shown = coloured(&field, scale).unwrap();
        let white: Vec<usize> = (0..100).filter(|x| shown.rgba[x * 4..x * 4 + 3] == [255; 3]).collect();
        // The pixel before each step; at the right end the scale itself is white.
        assert_eq!(white, [3, 8, 18, 48, 98, 99]);
        let none = Field { values: vec![None; 200], ..field };
        assert!(coloured(&none, scale).unwrap().rgba.chunks_exact(4).all(|pixel| pixel == [60, 60, 60, 255]));
        assert!(coloured(&none, Scale { low: 2.0, high: 1.0, lines: false }).is_err());
        assert_eq!(scale.colours(64).len(), 64);
    }

    #[test]
    fn lines_are_named_where_they_are_clear() {
        let field = ramp(100, 60);
        let scale = Scale { low: 5.0, high: 100.0, lines: true };
        let named = labels(&field, scale);
        // The steps are 5, 10, 20, 50 and 100, of which the first and the last lie at the edge.
        for value in [10.0, 20.0, 50.0] {
            let own: Vec<_> = named.iter().filter(|label| label.value == value).collect();
            assert!((1..=LABELS_A_LINE).contains(&own.len()), "{named:?}");
            // Column x has the value x + 1: the line stands at the left edge of column 9, 19, 49.
            assert!(own.iter().all(|label| label.at[0] == value - 1.0), "{named:?}");
        }
        assert!(named.iter().all(|label| ![5.0, 100.0].contains(&label.value)), "{named:?}");
        let near = |a: &Label, b: &Label| a != b && (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) < 12.0;
        assert!(!named.iter().any(|a| named.iter().any(|b| near(a, b))), "{named:?}");
        // Grain has lines everywhere, and none that can be named.
        let grain = (0..6000u32).map(|i| Some(if i.wrapping_mul(2_654_435_769) >> 31 == 1 { 6.0 } else { 60.0 }));
        let grain = Field { values: grain.collect(), ..field };
        assert!(labels(&grain, scale).is_empty());
        assert!(labels(&ramp(9, 9), scale).is_empty());
    }

    #[test]
    fn cells_with_commas_and_quotes_are_quoted() {
        let rows = [vec!["a,b".to_owned(), "c\"d".to_owned()], vec!["1".to_owned(), String::new()]];
        assert_eq!(csv(&rows), "\"a,b\",\"c\"\"d\"\r\n1,\r\n");
    }
}
