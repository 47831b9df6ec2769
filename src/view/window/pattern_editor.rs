//! The texture of a light: painted on, laid over with a shape or an image, turned.

use std::f32::consts::{PI, TAU};
use std::path::Path;

use eframe::egui::{self, Color32, ColorImage, Rect, Sense, TextureOptions, Ui, pos2, vec2};

use super::document::{Document, Tool};
use super::theme::{ACCENT, LINE, section};
use crate::error::Result;
use crate::image::encode_srgb;
use crate::image::read_image;
use crate::light::{Light, LightKind};
use crate::view::pattern::{Pattern, Shape, ShapeKind};

pub(super) fn pattern_editor(ui: &mut Ui, document: &mut Document, index: usize, light: &Light) {
    section(ui, "TEXTURE");
    let is_environment = matches!(light.kind, LightKind::LatLong { .. } | LightKind::Octahedral { .. });
    tools(ui, document, index, light, is_environment);
    let (across, down) = light.layout();
    let width = ui.available_width().min(across as f32 * 48.0);
    let scale = (width / across as f32).min(190.0 / down as f32);
    let size = vec2(across as f32, down as f32) * scale;
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let to_texels = |at: egui::Pos2| [(at.x - rect.left()) / scale, (at.y - rect.top()) / scale];
    let pressed = response.is_pointer_button_down_on();
    match (pressed, response.interact_pointer_pos()) {
        (true, Some(pointer)) => {
            let moved = response.drag_delta().x / size.x * TAU;
            use_tool(document, index, light, to_texels(pointer), moved);
        }
        _ => document.easel.last_touch = None,
    }
    let mix = &document.mix.lights[index];
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
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "texture"));
    response.on_hover_cursor(egui::CursorIcon::Crosshair);
}

/// The row of tools and the settings of the one in use.
fn tools(ui: &mut Ui, document: &mut Document, index: usize, light: &Light, is_environment: bool) {
    ui.horizontal_wrapped(|ui| {
        for (tool, name) in [
            (Tool::Brush, "Brush"),
            (Tool::Shape(ShapeKind::Disc), "Disc"),
            (Tool::Shape(ShapeKind::Rectangle), "Box"),
            (Tool::Shape(ShapeKind::Gradient), "Ramp"),
            (Tool::Turn, "Turn"),
        ] {
            if tool != Tool::Turn || is_environment {
                ui.selectable_value(&mut document.easel.tool, tool, name);
            }
        }
        if !is_environment && document.easel.tool == Tool::Turn {
            document.easel.tool = Tool::Brush;
        }
        ui.separator();
        if ui.button("Even").on_hover_text("The same everywhere").clicked() {
            document.mix.lights[index].pattern = None;
        }
        if ui.button("Dark").on_hover_text("Black, to paint light into").clicked() {
            document.mix.lights[index].pattern = Some(Pattern::filled(light.layout(), [0.0; 3]));
        }
    });
    let easel = &mut document.easel;
    ui.horizontal_wrapped(|ui| match easel.tool {
        Tool::Brush => {
            let largest = (light.layout().0.max(light.layout().1) as f32 * 0.5).max(2.0);
            ui.add(
                egui::DragValue::new(&mut easel.brush.radius_texels).range(0.5..=largest).speed(0.05).prefix("size "),
            );
            ui.add(egui::DragValue::new(&mut easel.brush.hardness).range(0.0..=1.0).speed(0.01).prefix("hard "));
            ui.add(egui::DragValue::new(&mut easel.brush.flow).range(0.01..=1.0).speed(0.01).prefix("flow "));
            paint(ui, &mut easel.brush.colour, &mut easel.paint_stops);
        }
        Tool::Shape(_) => {
            ui.add(egui::Slider::new(&mut easel.shape_size, 0.02..=2.0).logarithmic(true).text("size"));
            paint(ui, &mut easel.brush.colour, &mut easel.paint_stops);
        }
        Tool::Turn => {
            let turn = &mut document.mix.lights[index].turn_radians;
            let mut degrees = turn.to_degrees();
            if ui.add(egui::Slider::new(&mut degrees, -180.0..=180.0).suffix("°").max_decimals(1)).changed() {
                *turn = degrees.to_radians();
            }
        }
    });
    ui.horizontal(|ui| {
        let field =
            egui::TextEdit::singleline(&mut document.easel.image_path).hint_text("Image file, or drop one here");
        let entered = ui.add(field.desired_width(ui.available_width() - 64.0)).lost_focus()
            && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if (ui.button("Load").clicked() || entered) && !document.easel.image_path.is_empty() {
            let path = document.easel.image_path.clone();
            if let Err(error) = load_image(document, index, Path::new(&path)) {
                document.message = Some((error.to_string(), true));
            }
        }
    });
}

fn paint(ui: &mut Ui, colour: &mut [f32; 3], stops: &mut f32) {
    ui.color_edit_button_rgb(colour).on_hover_text("Colour of the paint");
    let number = egui::DragValue::new(stops).range(-8.0..=8.0).speed(0.05).prefix("paint ").suffix(" EV");
    ui.add(number).on_hover_text("Brightness of the paint against the light as it was");
}

/// Lays an image over a light.
pub(super) fn load_image(document: &mut Document, index: usize, path: &Path) -> Result<()> {
    let image = read_image(path)?;
    let kind = document.session.basis().lights()[index].kind;
    document.mix.lights[index].pattern = Some(Pattern::of_image(kind, &image));
    document.message = Some((format!("{} lies on the light", path.display()), false));
    Ok(())
}

fn use_tool(document: &mut Document, index: usize, light: &Light, at: [f32; 2], moved_radians: f32) {
    let (across, down) = light.layout();
    let easel = &mut document.easel;
    let gain = easel.paint_stops.exp2();
    let colour = easel.brush.colour.map(|v| v * gain);
    let mix = &mut document.mix.lights[index];
    match easel.tool {
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
            let brush = crate::view::pattern::Brush { colour, ..easel.brush };
            let wraps = matches!(light.kind, LightKind::LatLong { .. });
            match easel.last_touch {
                Some(last) if last == at => {}
                Some(last) => pattern.stroke(&brush, last, at, wraps),
                None => pattern.touch(&brush, at, wraps),
            }
            easel.last_touch = Some(at);
            mix.pattern = Some(pattern);
        }
        Tool::Shape(kind) => {
            // Sizes are those of the light's smaller side, so that a disc is round on the texels.
            let side = across.min(down) as f32 * easel.shape_size;
            let shape = Shape {
                kind,
                centre: [at[0] / across as f32, at[1] / down as f32],
                size: [side / across as f32, side / down as f32],
                inside: colour,
                outside: [0.0; 3],
            };
            mix.turn_radians = 0.0;
            mix.pattern = Some(Pattern::of_shape((across, down), &shape));
        }
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
