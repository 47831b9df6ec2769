//! The texture of a light: painted on, laid over with a shape or an image, turned.

use std::f32::consts::{PI, TAU};

use eframe::egui::{self, Color32, ColorImage, Rect, Sense, TextureOptions, Ui, pos2, vec2};

use super::chooser::Purpose;
use super::document::Document;
use super::sun_panel::{put_sun, sun_settings};
use super::theme::{ACCENT, LINE, WEAK};
use crate::pattern::{Brush, Pattern, Shape, ShapeKind};
use crate::sun::{Moment, PlacedSun};
use ltm::image::encode_srgb;
use ltm::light::{Light, LightKind};

/// The tool of the pointer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tool {
    Brush,
    Shape(ShapeKind),
    Turn,
    Sun,
}

/// The texture editor's settings, which outlive a change of light.
pub(super) struct PatternEditorState {
    tool: Tool,
    brush: Brush,
    /// Brightness of the paint, in stops.
    paint_stops: f32,
    /// Size of shapes, as a fraction of the light's size.
    shape_size: f32,
    last_touch: Option<[f32; 2]>,
    /// The handle of the light's shape that a drag moves.
    hold: Hold,
    /// The sun that is being put into a sky, and how far above the whole sky it is, in stops.
    pub(super) sun: Option<PlacedSun>,
    pub(super) sun_stops: f32,
    /// Time and place by which the sun is put.
    pub(super) moment: Moment,
}

/// Handles of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hold {
    /// At a place inside it, given from its middle, in fractions of the light's size.
    Inside([f32; 2]),
    /// At one of its corners.
    Corner,
}

impl Default for PatternEditorState {
    fn default() -> Self {
        Self {
            tool: Tool::Brush,
            brush: Brush { radius_texels: 2.0, hardness: 0.3, flow: 0.5, colour: [1.0; 3] },
            paint_stops: 2.0,
            shape_size: 0.5,
            last_touch: None,
            hold: Hold::Corner,
            sun: None,
            // Of a clear sky the sun sends some five times what the rest does.
            sun_stops: 2.3,
            moment: Moment::default(),
        }
    }
}

impl PatternEditorState {
    /// Whether the pointer places suns in skies.
    pub(super) fn puts_suns(&self) -> bool {
        self.tool == Tool::Sun
    }
}

pub(super) fn pattern_editor(ui: &mut Ui, document: &mut Document, index: usize, light: &Light) {
    head(ui, document, index, light);
    let is_environment = light.kind.is_environment();
    tools(ui, document, index, light, is_environment);
    let (across, down) = light.layout();
    let width = ui.available_width().min(across as f32 * 48.0);
    // As tall as the panel is wide, where the window has the room for it.
    let tallest = (ui.ctx().content_rect().height() * 0.3).clamp(150.0, 420.0);
    let scale = (width / across as f32).min(tallest / down as f32);
    let size = vec2(across as f32, down as f32) * scale;
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let to_texels = |at: egui::Pos2| [(at.x - rect.left()) / scale, (at.y - rect.top()) / scale];
    // A quick click may go down and up between two frames.
    let pressed = response.is_pointer_button_down_on() || response.clicked();
    match (pressed, response.interact_pointer_pos()) {
        (true, Some(pointer)) => {
            let moved = response.drag_delta().x / size.x * TAU;
            let begins = ui.input(|input| input.pointer.any_pressed());
            use_tool(document, index, light, to_texels(pointer), moved, begins.then_some(GRIP / scale));
        }
        _ => document.easel.last_touch = None,
    }
    if response.hovered() {
        scroll_shape(ui, document, index, light);
    }
    let mix = &document.work.mix.lights[index];
    let white = Pattern::white((across, down));
    let pattern = mix.pattern.as_ref().unwrap_or(&white).turned(light.kind, mix.turn_radians).into_owned();
    let colour = mix.colour(light);
    let texture = ui.ctx().load_texture_cached(
        "pattern",
        egui::Id::unique(("pattern", index)),
        shown(&pattern, colour),
        TextureOptions::NEAREST,
    );
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    ui.painter().rect_stroke(rect, 0.0, (1.0, LINE), egui::StrokeKind::Outside);
    if let (Some(pointer), Tool::Brush) = (response.hover_pos(), document.easel.tool) {
        let radius = document.easel.brush.radius_texels.max(0.5) * scale;
        ui.painter().with_clip_rect(rect).circle_stroke(pointer, radius, (1.0, ACCENT));
    }
    if let (Some(shape), Tool::Shape(_)) = (document.work.mix.lights[index].shape, document.easel.tool) {
        let size = vec2(shape.size[0] * rect.width(), shape.size[1] * rect.height());
        let centre = rect.min + vec2(shape.centre[0] * rect.width(), shape.centre[1] * rect.height());
        let outline = Rect::from_center_size(centre, size);
        let painter = ui.painter().with_clip_rect(rect.expand(4.0));
        painter.rect_stroke(outline, 0.0, (1.0, ACCENT), egui::StrokeKind::Middle);
        for corner in [outline.left_top(), outline.right_top(), outline.left_bottom(), outline.right_bottom()] {
            painter.rect_filled(Rect::from_center_size(corner, vec2(6.0, 6.0)), 0.0, ACCENT);
        }
    }
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "texture"));
    response.on_hover_cursor(egui::CursorIcon::Crosshair);
}

/// The heading with what is done at once, at its right.
fn head(ui: &mut Ui, document: &mut Document, index: usize, light: &Light) {
    let is_environment = light.kind.is_environment();
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        ui.label(egui::RichText::new("TEXTURE").size(11.0).color(WEAK).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            let (name, about) = match is_environment {
                true => ("Map…", "A lat-long map, its zenith at the top, as what the environment sends"),
                false => ("Image…", "A picture over the light"),
            };
            if ui.button(name).on_hover_text(about).clicked() {
                document.files.wanted = Some(Purpose::LightImage(index));
            }
            if ui.button("Black").on_hover_text("All off, to paint light into").clicked() {
                put(document, index, Pattern::filled(light.layout(), [0.0; 3]));
            }
            if ui.button("Uniform").on_hover_text("The same everywhere").clicked() {
                let mix = &mut document.work.mix.lights[index];
                (mix.pattern, mix.shape, mix.turn_radians) = (None, None, 0.0);
            }
        });
    });
}

/// The row of tools and the settings of the one in use.
fn tools(ui: &mut Ui, document: &mut Document, index: usize, light: &Light, is_environment: bool) {
    if !is_environment && matches!(document.easel.tool, Tool::Turn | Tool::Sun) {
        document.easel.tool = Tool::Brush;
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for (tool, name) in [
            (Tool::Brush, "Brush"),
            (Tool::Shape(ShapeKind::Disc), "Disc"),
            (Tool::Shape(ShapeKind::Rectangle), "Box"),
            (Tool::Shape(ShapeKind::Gradient), "Ramp"),
            (Tool::Turn, "Rotate"),
            (Tool::Sun, "Sun"),
        ] {
            if !matches!(tool, Tool::Turn | Tool::Sun) || is_environment {
                ui.selectable_value(&mut document.easel.tool, tool, name);
            }
        }
    });
    ui.spacing_mut().item_spacing.x = 4.0;
    // In one row in the narrowest panel, the button of the colour too.
    ui.spacing_mut().button_padding.x = 4.0;
    ui.spacing_mut().interact_size.x = 26.0;
    if document.easel.tool == Tool::Sun {
        return sun_settings(ui, document, index, light);
    }
    ui.horizontal_wrapped(|ui| match document.easel.tool {
        Tool::Sun => {}
        Tool::Brush => {
            let easel = &mut document.easel;
            let largest = (light.layout().0.max(light.layout().1) as f32 * 0.5).max(2.0);
            ui.add(
                egui::DragValue::new(&mut easel.brush.radius_texels)
                    .range(0.5..=largest)
                    .speed(0.05)
                    .max_decimals(1)
                    .prefix("size "),
            );
            ui.add(
                egui::DragValue::new(&mut easel.brush.hardness)
                    .range(0.0..=1.0)
                    .speed(0.01)
                    .max_decimals(2)
                    .prefix("hard "),
            );
            ui.add(
                egui::DragValue::new(&mut easel.brush.flow)
                    .range(0.01..=1.0)
                    .speed(0.01)
                    .max_decimals(2)
                    .prefix("flow "),
            );
            paint(ui, &mut easel.brush.colour, &mut easel.paint_stops);
        }
        Tool::Shape(_) => {
            let easel = &mut document.easel;
            ui.label("size");
            ui.spacing_mut().slider_width = (ui.available_width() - 170.0).clamp(50.0, 160.0);
            let slider = egui::Slider::new(&mut easel.shape_size, 0.02..=2.0).logarithmic(true);
            let resized = ui.add(slider.max_decimals(2)).changed();
            let (colour, stops) = (easel.brush.colour, easel.paint_stops);
            paint(ui, &mut easel.brush.colour, &mut easel.paint_stops);
            let repainted = (easel.brush.colour, easel.paint_stops) != (colour, stops);
            if resized || repainted {
                restyle(document, index, light, resized);
            }
        }
        Tool::Turn => {
            let turn = &mut document.work.mix.lights[index].turn_radians;
            let mut degrees = turn.to_degrees();
            if ui.add(egui::Slider::new(&mut degrees, -180.0..=180.0).suffix("°").max_decimals(1)).changed() {
                *turn = degrees.to_radians();
            }
        }
    });
}

fn paint(ui: &mut Ui, colour: &mut [f32; 3], stops: &mut f32) {
    ui.color_edit_button_rgb(colour).on_hover_text("Colour of the paint");
    let number = egui::DragValue::new(stops).range(-8.0..=8.0).speed(0.05).max_decimals(1).suffix(" EV");
    ui.add(number).on_hover_text("Brightness of the paint against the light as it was");
}

/// Puts a pattern that no shape made on a light.
fn put(document: &mut Document, index: usize, pattern: Pattern) {
    let mix = &mut document.work.mix.lights[index];
    (mix.pattern, mix.shape) = (Some(pattern), None);
}

/// Uses the tool at a place in texels. `begins`: the button has just gone down; how near, in texels, is near enough to
/// a shape's corner.
fn use_tool(
    document: &mut Document,
    index: usize,
    light: &Light,
    at: [f32; 2],
    moved_radians: f32,
    begins: Option<f32>,
) {
    let (across, down) = light.layout();
    let easel = &mut document.easel;
    let mix = &mut document.work.mix.lights[index];
    match easel.tool {
        Tool::Sun => {
            let texel = [at[0].clamp(0.0, across as f32 - 1.0) as u32, at[1].clamp(0.0, down as f32 - 1.0) as u32];
            put_sun(document, index, light, (texel[1] * across + texel[0]) as usize);
        }
        Tool::Turn => {
            mix.turn_radians = (mix.turn_radians + moved_radians + PI).rem_euclid(TAU) - PI;
            if mix.pattern.is_none() {
                mix.pattern = Some(Pattern::white((across, down)));
            }
        }
        Tool::Brush => {
            let mut pattern = mix.pattern.take().unwrap_or_else(|| Pattern::white((across, down)));
            // One paints on what one sees: a turned environment becomes its texture.
            if mix.turn_radians != 0.0 {
                pattern = pattern.turned(light.kind, mix.turn_radians).into_owned();
                mix.turn_radians = 0.0;
            }
            let brush = Brush { colour: paint_colour(easel), ..easel.brush };
            let wraps = matches!(light.kind, LightKind::LatLong { .. });
            match easel.last_touch {
                Some(last) if last == at => {}
                Some(last) => pattern.stroke(&brush, last, at, wraps),
                None => pattern.touch(&brush, at, wraps),
            }
            easel.last_touch = Some(at);
            put(document, index, pattern);
        }
        Tool::Shape(kind) => {
            let at = [at[0] / across as f32, at[1] / down as f32];
            let mut shape = match mix.shape {
                Some(shape) if shape.kind == kind => shape,
                _ => new_shape(easel, kind, light, at),
            };
            if let Some(near) = begins {
                let near = [near / across as f32, near / down as f32];
                let from_middle = [0, 1].map(|axis| at[axis] - shape.centre[axis]);
                let outside = |reach: f32| {
                    (0..2).any(|axis| from_middle[axis].abs() > shape.size[axis] / 2.0 + reach * near[axis])
                };
                let at_corner =
                    (0..2).all(|axis| (from_middle[axis].abs() - shape.size[axis] / 2.0).abs() <= near[axis]);
                if !at_corner && outside(0.0) {
                    shape = new_shape(easel, kind, light, at);
                }
                easel.hold = match at_corner {
                    true => Hold::Corner,
                    false => Hold::Inside([0, 1].map(|axis| at[axis] - shape.centre[axis])),
                };
            }
            match easel.hold {
                Hold::Inside(offset) => shape.centre = [0, 1].map(|axis| at[axis] - offset[axis]),
                Hold::Corner => {
                    let size = [0, 1].map(|axis| (2.0 * (at[axis] - shape.centre[axis]).abs()).clamp(0.01, 4.0));
                    shape.size = size;
                }
            }
            lay(document, index, light, shape);
        }
    }
}

/// How near to a corner, in points, a shape is held there.
const GRIP: f32 = 7.0;

fn paint_colour(easel: &PatternEditorState) -> [f32; 3] {
    let gain = easel.paint_stops.exp2();
    easel.brush.colour.map(|v| v * gain)
}

/// A shape of the easel's size, which is in fractions of the light's smaller side, so that a disc is round.
fn new_shape(easel: &PatternEditorState, kind: ShapeKind, light: &Light, centre: [f32; 2]) -> Shape {
    let (across, down) = light.layout();
    let side = across.min(down) as f32 * easel.shape_size;
    let size = [side / across as f32, side / down as f32];
    Shape { kind, centre, size, inside: paint_colour(easel), outside: [0.0; 3] }
}

/// Gives a light's shape the easel's colour, and its size if that was changed.
fn restyle(document: &mut Document, index: usize, light: &Light, resized: bool) {
    if let Some(shape) = document.work.mix.lights[index].shape {
        let new = new_shape(&document.easel, shape.kind, light, shape.centre);
        let size = if resized { new.size } else { shape.size };
        lay(document, index, light, Shape { size, ..new });
    }
}

/// Lays a shape over a light.
fn lay(document: &mut Document, index: usize, light: &Light, shape: Shape) {
    let (across, down) = light.layout();
    // What is laid next, and the slider, follow what was drawn by hand.
    let sides = [shape.size[0] * across as f32, shape.size[1] * down as f32];
    document.easel.shape_size = sides[0].max(sides[1]) / across.min(down) as f32;
    let mix = &mut document.work.mix.lights[index];
    mix.turn_radians = 0.0;
    (mix.pattern, mix.shape) = (Some(Pattern::of_shape(light.layout(), &shape)), Some(shape));
}

/// Scrolling over a light with a shape makes that larger or smaller.
fn scroll_shape(ui: &Ui, document: &mut Document, index: usize, light: &Light) {
    let scroll = ui.input(|input| input.smooth_scroll_delta().y);
    let (Tool::Shape(_), Some(shape)) = (document.easel.tool, document.work.mix.lights[index].shape) else { return };
    if scroll != 0.0 {
        let size = shape.size.map(|size| (size * (scroll * 0.004).exp()).clamp(0.01, 4.0));
        lay(document, index, light, Shape { size, ..shape });
    }
}

/// The texture in the light's colour; what is brighter than 1 is brought into range together.
fn shown(pattern: &Pattern, colour: [f32; 3]) -> ColorImage {
    let peak = colour.into_iter().fold(1e-9, f32::max);
    let brightest = pattern.texels().iter().flatten().copied().fold(1.0, f32::max);
    let texels = pattern.texels().iter().map(|texel| {
        let byte = |ch: usize| (encode_srgb(texel[ch] * colour[ch] / peak / brightest) * 255.0 + 0.5) as u8;
        Color32::from_rgb(byte(0), byte(1), byte(2))
    });
    let (across, down) = pattern.size();
    ColorImage::new([across as usize, down as usize], texels.collect())
}
