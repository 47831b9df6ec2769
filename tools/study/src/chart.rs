//! Line charts as PNG, drawn with the typeface that the program carries.

use std::ops::Range;
use std::path::Path;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use plotters::style::register_font;

use ltm::error::{Error, Result};
use ltm::image::write_rgb_png;

/// Colours of lines, told apart also without colour vision (Okabe and Ito 2008), then darker ones.
const COLOURS: [RGBColor; 10] = [
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
    RGBColor(150, 120, 40),
    RGBColor(120, 60, 160),
    RGBColor(150, 150, 150),
];

/// Size of one panel, of the title, of a line of the legend, in pixels.
const PANEL: (u32, u32) = (560, 400);
const TITLE: u32 = 44;
const LEGEND_LINE: u32 = 24;
const LEGEND_ENTRY: u32 = 350;
const CAPTION: u32 = 24;

/// Makes the typeface known under the name that all text asks for.
pub(super) fn use_font() {
    static FONT: Once = Once::new();
    FONT.call_once(|| {
        // The crate's own bytes of a valid font: nothing to be done about a refusal, and drawing reports it.
        let _ = register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
}

/// Panels side by side with common axes' names and one legend.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    pub(super) title: String,
    /// What stands under it: how it was made.
    pub(super) caption: String,
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) panels: Vec<Panel>,
}

/// What an axis shows.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    /// Name with unit.
    pub(super) name: &'static str,
    pub(super) logarithmic: bool,
}

/// One plot.
#[derive(Clone, Debug, Default)]
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) lines: Vec<Line>,
}

/// One line of a plot; the same name has the same colour in every panel.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

impl Chart {
    /// Draws the chart. Points that an axis cannot show are left out.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        use_font();
        let names = self.names();
        let across = if self.panels.len() > 4 { 3 } else { self.panels.len().clamp(1, 2) } as u32;
        let down = (self.panels.len() as u32).div_ceil(across).max(1);
        let width = (PANEL.0 * across).max(760);
        let entries_across = (width / LEGEND_ENTRY).max(1);
        let legend = LEGEND_LINE * (names.len() as u32).div_ceil(entries_across) + 8;
        let height = TITLE + PANEL.1 * down + legend + CAPTION;
        let mut pixels = vec![255u8; (width * height * 3) as usize];
        let drawn = {
            let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
            self.draw(&area, &names, (across, down), entries_across)
        };
        drawn
            .map_err(|problem| Error::input(path.display().to_string(), format!("cannot be drawn ({problem})"), ""))?;
        write_rgb_png(path, width, height, pixels)
    }

    /// Names of lines in the order of their first appearance.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for line in self.panels.iter().flat_map(|panel| &panel.lines) {
            if !names.contains(&line.name.as_str()) {
                names.push(&line.name);
            }
        }
        names
    }

    fn draw(
        &self,
        area: &Area<'_>,
        names: &[&str],
        (across, down): (u32, u32),
        entries_across: u32,
    ) -> Result<(), Box<dyn std::error::Error + '_>> {
        area.fill(&WHITE)?;
        area.draw_text(&self.title, &("sans-serif", 24).into_text_style(area), (16, 12))?;
        let (_, below) = area.split_vertically(TITLE);
        let (plots, foot) = below.split_vertically(PANEL.1 * down);
        for (panel, area) in self.panels.iter().zip(plots.split_evenly((down as usize, across as usize))) {
            self.draw_panel(panel, &area, names)?;
        }
        let text = ("sans-serif", 16).into_text_style(&foot);
        for (i, name) in names.iter().enumerate() {
            let (x, y) = (
                (i as u32 % entries_across * LEGEND_ENTRY) as i32 + 20,
                (i as u32 / entries_across * LEGEND_LINE) as i32,
            );
            foot.draw(&PathElement::new(vec![(x, y + 11), (x + 34, y + 11)], colour(i).stroke_width(3)))?;
            foot.draw(&Circle::new((x + 17, y + 11), 4, colour(i).filled()))?;
            foot.draw_text(name, &text, (x + 42, y + 3))?;
        }
        let caption = ("sans-serif", 12).into_text_style(&foot).color(&RGBColor(90, 90, 90));
        let bottom = foot.dim_in_pixel().1 as i32 - CAPTION as i32;
        foot.draw_text(&self.caption, &caption, (16, bottom + 4))?;
        Ok(())
    }

    fn draw_panel(
        &self,
        panel: &Panel,
        area: &Area<'_>,
        names: &[&str],
    ) -> Result<(), Box<dyn std::error::Error + '_>> {
        let shown: Vec<(usize, Vec<(f64, f64)>)> = panel
            .lines
            .iter()
            .map(|line| {
                let index = names.iter().position(|name| *name == line.name).unwrap_or(0);
                let mut points: Vec<_> =
                    line.points.iter().filter_map(|&(x, y)| Some((self.x.place(x)?, self.y.place(y)?))).collect();
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                (index, points)
            })
            .collect();
        let all = || shown.iter().flat_map(|(_, points)| points);
        let (x, y) = (range(all().map(|p| p.0)), range(all().map(|p| p.1)));
        let mut context = ChartBuilder::on(area)
            .caption(&panel.title, ("sans-serif", 18))
            .margin(10)
            .margin_right(20)
            .x_label_area_size(44)
            .y_label_area_size(62)
            .build_cartesian_2d(Span::new(x, &self.x), Span::new(y, &self.y))?;
        context
            .configure_mesh()
            .x_desc(self.x.name)
            .y_desc(self.y.name)
            .x_labels(24)
            .y_labels(24)
            .x_label_formatter(&|v| self.x.label(*v))
            .y_label_formatter(&|v| self.y.label(*v))
            .label_style(("sans-serif", 14))
            .axis_desc_style(("sans-serif", 15))
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (index, points) in shown {
            context.draw_series(LineSeries::new(points.iter().copied(), colour(index).stroke_width(2)))?;
            context.draw_series(points.iter().map(|&p| Circle::new(p, 3, colour(index).filled())))?;
        }
        Ok(())
    }
}

/// A span of places with its tick marks.
struct Span {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Span {
    fn new((low, high): (f64, f64), axis: &Axis) -> Self {
        Self { low, high, ticks: axis.ticks((low, high)) }
    }
}

impl Ranged for Span {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        first + ((value - self.low) / (self.high - self.low) * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// A little more than the values span.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = ((high - low) * 0.05).max(1e-3 * high.abs()).max(1e-9);
    (low - margin, high + margin)
}

impl Axis {
    pub(super) fn linear(name: &'static str) -> Self {
        Self { name, logarithmic: false }
    }

    pub(super) fn logarithmic(name: &'static str) -> Self {
        Self { name, logarithmic: true }
    }

    /// Where a value stands on the axis; none if it cannot.
    fn place(&self, value: f64) -> Option<f64> {
        let place = if self.logarithmic { value.log10() } else { value };
        place.is_finite().then_some(place)
    }

    /// Places of tick marks: multiples of 1, 2 or 5 times a power of ten.
    fn ticks(&self, (low, high): (f64, f64)) -> Vec<f64> {
        if self.logarithmic {
            let steps: &[f64] = match high - low {
                span if span < 1.2 => &[1.0, 2.0, 3.0, 5.0, 7.0],
                span if span < 3.0 => &[1.0, 2.0, 5.0],
                _ => &[1.0],
            };
            let decades = (low.floor() as i32)..=(high.ceil() as i32);
            let all = decades.flat_map(|d| steps.iter().map(move |s| f64::from(d) + s.log10()));
            return all.filter(|v| (low..=high).contains(v)).collect();
        }
        let raw = (high - low) / 6.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * power).find(|s| *s >= raw).unwrap_or(raw);
        let first = (low / step).ceil() as i64;
        (first..).map(|i| i as f64 * step).take_while(|v| *v <= high).collect()
    }

    fn label(&self, place: f64) -> String {
        let value = if self.logarithmic { 10f64.powf(place) } else { place };
        let (scaled, prefix) = match value.abs() {
            v if v >= 0.9999e9 => (value / 1e9, " G"),
            v if v >= 0.9999e6 => (value / 1e6, " M"),
            v if v >= 0.9999e4 => (value / 1e3, " k"),
            _ => (value, ""),
        };
        let digits = if scaled == 0.0 { 0 } else { (1 - scaled.abs().log10().floor() as i32).clamp(0, 6) as usize };
        let text = format!("{scaled:.digits$}");
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        format!("{text}{prefix}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_axis() {
        let linear = Axis::linear("x");
        assert_eq!(linear.ticks((0.0, 60.0)), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        let log = Axis::logarithmic("x");
        let labels: Vec<_> = log.ticks((3.9, 6.1)).into_iter().map(|v| log.label(v)).collect();
        assert_eq!(labels, ["10 k", "20 k", "50 k", "100 k", "200 k", "500 k", "1 M"]);
        assert_eq!((linear.label(0.25).as_str(), log.label(-2.0).as_str()), ("0.25", "0.01"));
    }

    #[test]
    fn a_chart_has_ink_and_a_legend() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.png");
        let line = |name: &str, y: f64| Line { name: name.into(), points: vec![(1.0, y), (10.0, 2.0 * y), (0.0, 1.0)] };
        let chart = Chart {
            title: "a title".into(),
            caption: "how".into(),
            x: Axis::logarithmic("bytes"),
            y: Axis::linear("dB"),
            panels: vec![Panel { title: "p".into(), lines: vec![line("a", 1.0), line("b", 2.0)] }; 2],
        };
        chart.write(&path).unwrap();
        let drawn = image::open(&path).unwrap().into_rgb8();
        for wanted in [COLOURS[0], COLOURS[1]] {
            assert!(drawn.pixels().any(|p| (p.0[0], p.0[1], p.0[2]) == (wanted.0, wanted.1, wanted.2)));
        }
        // Letters of the title: dark pixels in the strip that holds nothing else.
        assert!(drawn.enumerate_pixels().any(|(_, y, p)| y < TITLE && p.0[0] < 80));
    }
}
