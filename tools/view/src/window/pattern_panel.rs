//! The texture of a light: painted on, laid over with a shape or an image, turned.

use std::f32::consts::TAU;

use eframe::egui::{self, Color32, ColorImage, Rect, Sense, TextureOptions, Ui, pos2, vec2};

use super::chooser::Purpose;
use super::document::Document;
use super::pattern_editor::{PatternEditorState, Tool, Touch, put};
use super::seen_lights::shows_directions;
use super::sun_panel::sun_settings;
use super::theme::{ACCENT, LINE, WEAK};
use crate::mixer::LightMix;
use crate::pattern::{Pattern, ShapeKind};
use ltm::image::encode_srgb;
use ltm::light::Light;

/// How near to a corner, in points, a shape is held there.
const GRIP: f32 = 7.0;

pub(super) fn pattern_editor(ui: &mut Ui, document: &mut Document, index: usize, light: &Light) {
    if head(ui, &mut document.work.mix.lights[index], light) {
        document.files.wanted = Some(Purpose::LightImage(index));
    }
    let has_camera = shows_directions(&document.front.session);
    let (editor, own) = (&mut document.editor, &mut document.work.mix.lights[index]);
    tools(ui, editor, own, index, light, has_camera);
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
            let touch = Touch { at: to_texels(pointer), moved_radians: moved, begins: begins.then_some(GRIP / scale) };
            editor.use_tool(own, index, light, touch);
        }
        _ => editor.lift(),
    }
    if response.hovered() {
        scroll_shape(ui, editor, own, light);
    }
    let white = Pattern::white((across, down));
    let pattern = own.pattern.as_ref().unwrap_or(&white).turned(light.kind, own.turn_radians).into_owned();
    let colour = own.colour(light);
    let texture = ui.ctx().load_texture_cached(
        "pattern",
        egui::Id::unique(("pattern", index)),
        shown(&pattern, colour),
        TextureOptions::NEAREST,
    );
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    ui.painter().rect_stroke(rect, 0.0, (1.0, LINE), egui::StrokeKind::Outside);
    if let (Some(pointer), Tool::Brush) = (response.hover_pos(), editor.tool) {
        let radius = editor.brush.radius_texels.max(0.5) * scale;
        ui.painter().with_clip_rect(rect).circle_stroke(pointer, radius, (1.0, ACCENT));
    }
    if let (Some(shape), Tool::Shape(_)) = (own.shape, editor.tool) {
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

/// The heading with what is done at once, at its right; whether an image is asked for.
fn head(ui: &mut Ui, own: &mut LightMix, light: &Light) -> bool {
    let mut asks_image = false;
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        ui.label(egui::RichText::new("TEXTURE").size(11.0).color(WEAK).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            let (name, about) = match light.kind.is_environment() {
                true => ("Map…", "A lat-long map, its zenith at the top, as what the environment sends"),
                false => ("Image…", "A picture over the light"),
            };
            asks_image = ui.button(name).on_hover_text(about).clicked();
            if ui.button("Black").on_hover_text("All off, to paint light into").clicked() {
                put(own, Pattern::filled(light.layout(), [0.0; 3]));
            }
            if ui.button("Uniform").on_hover_text("The same everywhere").clicked() {
                (own.pattern, own.shape, own.turn_radians) = (None, None, 0.0);
            }
        });
    });
    asks_image
}

/// The row of tools and the settings of the one in use.
fn tools(
    ui: &mut Ui,
    editor: &mut PatternEditorState,
    own: &mut LightMix,
    index: usize,
    light: &Light,
    has_camera: bool,
) {
    let is_environment = light.kind.is_environment();
    if !is_environment && matches!(editor.tool, Tool::Turn | Tool::Sun) {
        editor.tool = Tool::Brush;
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
                ui.selectable_value(&mut editor.tool, tool, name);
            }
        }
    });
    ui.spacing_mut().item_spacing.x = 4.0;
    // In one row in the narrowest panel, the button of the colour too.
    ui.spacing_mut().button_padding.x = 4.0;
    ui.spacing_mut().interact_size.x = 26.0;
    if editor.tool == Tool::Sun {
        return sun_settings(ui, editor, own, index, light, has_camera);
    }
    ui.horizontal_wrapped(|ui| match editor.tool {
        Tool::Sun => {}
        Tool::Brush => {
            let largest = (light.layout().0.max(light.layout().1) as f32 * 0.5).max(2.0);
            ui.add(
                egui::DragValue::new(&mut editor.brush.radius_texels)
                    .range(0.5..=largest)
                    .speed(0.05)
                    .max_decimals(1)
                    .prefix("size "),
            );
            ui.add(
                egui::DragValue::new(&mut editor.brush.hardness)
                    .range(0.0..=1.0)
                    .speed(0.01)
                    .max_decimals(2)
                    .prefix("hard "),
            );
            ui.add(
                egui::DragValue::new(&mut editor.brush.flow)
                    .range(0.01..=1.0)
                    .speed(0.01)
                    .max_decimals(2)
                    .prefix("flow "),
            );
            paint(ui, &mut editor.brush.colour, &mut editor.paint_stops);
        }
        Tool::Shape(_) => {
            ui.label("size");
            ui.spacing_mut().slider_width = (ui.available_width() - 170.0).clamp(50.0, 160.0);
            let slider = egui::Slider::new(&mut editor.shape_size, 0.02..=2.0).logarithmic(true);
            let resized = ui.add(slider.max_decimals(2)).changed();
            let (colour, stops) = (editor.brush.colour, editor.paint_stops);
            paint(ui, &mut editor.brush.colour, &mut editor.paint_stops);
            let repainted = (editor.brush.colour, editor.paint_stops) != (colour, stops);
            if resized || repainted {
                editor.restyle(own, light, resized);
            }
        }
        Tool::Turn => {
            let turn = &mut own.turn_radians;
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

/// Scrolling over a light with a shape makes that larger or smaller.
fn scroll_shape(ui: &Ui, editor: &mut PatternEditorState, own: &mut LightMix, light: &Light) {
    let scroll = ui.input(|input| input.smooth_scroll_delta().y);
    if scroll != 0.0 {
        editor.scale_shape(own, light, (scroll * 0.004).exp());
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
