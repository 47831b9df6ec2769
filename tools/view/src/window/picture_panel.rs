//! The picture: pan, zoom, turns in a panorama, wipe, and the click that asks which light matters.

use eframe::egui::{self, Align2, Color32, FontId, Pos2, Rect, Sense, Ui, pos2, vec2};

use super::comparison::difference_in_words;
use super::document::Document;
use super::message::Message;
use super::meter_overlay::{draw_area, draw_labels};
use super::outline_panel::{camera_moves, is_camera_drag};
use super::picture_place::Place;
use super::seen_lights::{
    SUN_GRIP, SeenSun, draw_band, draw_suns, move_sun, seen_suns, select_in_picture, shows_directions,
};
use super::theme::{ACCENT, WEAK};
use super::view_state::{Beside, FINE_STEP, STEP};

/// How near, in points, the pointer must be to take hold of the wipe.
const GRIP: f32 = 7.0;

/// The object that a drag moves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Held {
    Wipe,
    Corner(usize),
    /// The sun of this light.
    Sun(usize),
    /// A band from here that selects lights.
    Band(Pos2),
    Picture,
}

/// The object at a position.
fn held_at(place: &Place, document: &Document, at: Pos2) -> Held {
    let near = |corner: &[f32; 2]| place.to_screen(*corner).is_some_and(|corner| corner.distance(at) < GRIP);
    let wipes = document.front.compare.id().is_some() && document.front.view.beside == Beside::Wipe;
    match document.front.meter.area.corners.iter().position(near) {
        Some(corner) => Held::Corner(corner),
        None if wipes && (at.x - wipe_x(place, document)).abs() < GRIP => Held::Wipe,
        None => sun_at(place, document, at).map_or(Held::Picture, Held::Sun),
    }
}

fn wipe_x(place: &Place, document: &Document) -> f32 {
    place.picture.left() + document.front.compare.snapshots.wipe * place.picture.width()
}

/// The light whose sun is taken hold of at a place.
fn sun_at(place: &Place, document: &Document, at: Pos2) -> Option<usize> {
    let suns = suns_of(document).into_iter();
    let near = suns.filter_map(|sun| Some((place.to_screen(sun.position)?.distance(at), sun.light)));
    near.filter(|(distance, _)| *distance < SUN_GRIP).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, light)| light)
}

pub(super) fn picture(ui: &mut Ui, document: &mut Document) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let size = document.size();
    document.front.view.viewport.follow([rect.width() - 24.0, rect.height() - 24.0], size);
    document.front.view.room = rect.size().into();
    if document.front.view.moves_camera {
        document.front.view.moves.extend(camera_moves(ui, &response));
    }
    if !(document.front.view.moves_camera && is_camera_drag(&response)) {
        drag(ui, document, &response);
    }
    let place = Place::of(rect, document);
    let hover = response.hover_pos();
    if let Some(pointer) = hover {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let factor = (scroll * 0.004).exp() * pinch;
        let is_camera =
            document.front.view.moves_camera && ui.input(|input| input.modifiers.command || input.modifiers.alt);
        if factor != 1.0 && !is_camera {
            document.front.view.zoom_about(place.offset_of(pointer), factor);
        }
        match held_at(&place, document, pointer) {
            Held::Wipe => ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal),
            Held::Corner(_) | Held::Sun(_) => ui.ctx().set_cursor_icon(egui::CursorIcon::Grab),
            Held::Picture if document.front.meter.draws => ui.ctx().set_cursor_icon(egui::CursorIcon::Crosshair),
            Held::Picture | Held::Band(_) => {}
        }
    }
    turn_by_keys(ui, document, &response);
    let place = Place::of(rect, document);
    document.front.view.hovered = hover.and_then(|pointer| place.pixel_at(pointer));
    if document.front.meter.draws {
        draw_corner(ui, document, &response, &place);
    } else if response.double_clicked() {
        document.front.view.fit();
    } else if let (true, Some(sky), Some(pointer)) =
        (response.clicked(), sky_for_suns(document), response.interact_pointer_pos())
    {
        move_sun_to(document, sky, place.to_picture(pointer));
    } else if let (true, Some(pixel)) = (response.clicked(), document.front.view.hovered) {
        document.front.view.select_strongest = true;
        document.front.session.worker.ask_pixel(pixel);
    }
    let place = Place::of(rect, document);
    draw(ui, document, &place);
    let painter = ui.painter().with_clip_rect(rect);
    draw_suns(&painter, &suns_of(document), |position| place.to_screen(position));
    if let Some(band) = held_band(ui, &response) {
        draw_band(&painter, band);
    }
    if response.has_focus() && document.front.view.around().is_some() {
        painter.rect_stroke(rect, 0.0, (1.0, ACCENT), egui::StrokeKind::Inside);
    }
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "picture"));
}

/// Arrows turn in a panorama while the picture has the keyboard, finely with Shift.
fn turn_by_keys(ui: &Ui, document: &mut Document, response: &egui::Response) {
    if !response.has_focus() || document.front.view.around().is_none() {
        return;
    }
    let filter = egui::EventFilter { horizontal_arrows: true, vertical_arrows: true, ..Default::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
    use egui::Key::{ArrowDown, ArrowLeft, ArrowRight, ArrowUp};
    for (key, turn) in
        [(ArrowLeft, [-1.0, 0.0]), (ArrowRight, [1.0, 0.0]), (ArrowUp, [0.0, 1.0]), (ArrowDown, [0.0, -1.0])]
    {
        let (presses, is_fine) =
            ui.input_mut(|input| (input.count_and_consume_key(egui::Modifiers::NONE, key), input.modifiers.shift));
        let far = presses as f32 * if is_fine { FINE_STEP } else { STEP };
        document.front.view.turn(turn.map(|way| way * far));
    }
}

/// The sky that a click in the picture puts the sun into: the selected one, while the sun is its tool.
fn sky_for_suns(document: &Document) -> Option<usize> {
    let light = document.list.selected().filter(|&light| document.basis().lights()[light].kind.is_environment());
    light.filter(|_| document.editor.puts_suns() && shows_directions(&document.front.session))
}

fn suns_of(document: &Document) -> Vec<SeenSun> {
    seen_suns(&document.front, &document.work.mix, document.editor.sun.as_ref())
}

fn move_sun_to(document: &mut Document, light: usize, position: [f32; 2]) {
    let all = document.lights.basis();
    move_sun(&document.front, all, &mut document.work.mix, &mut document.editor, (light, position));
}

fn held_id() -> egui::Id {
    egui::Id::unique("held in the picture")
}

/// The band that is being drawn.
fn held_band(ui: &Ui, response: &egui::Response) -> Option<Rect> {
    match (ui.data(|data| data.get_temp(held_id())), response.interact_pointer_pos()) {
        (Some(Held::Band(from)), Some(to)) if response.dragged() => Some(Rect::from_two_pos(from, to)),
        _ => None,
    }
}

/// Moves the wipe, a corner of the measured area, a sun, or the picture; with Shift a band selects lights.
fn drag(ui: &Ui, document: &mut Document, response: &egui::Response) {
    let place = Place::of(response.rect, document);
    let id = held_id();
    let modifiers = ui.input(|input| input.modifiers);
    if response.drag_started() {
        let origin = ui.input(|input| input.pointer.press_origin());
        let held = match origin {
            Some(origin) if modifiers.shift => Held::Band(origin),
            Some(origin) => held_at(&place, document, origin),
            None => Held::Picture,
        };
        ui.data_mut(|data| data.insert_temp(id, held));
    }
    let held = ui.data(|data| data.get_temp(id).unwrap_or(Held::Picture));
    if let (Held::Band(from), Some(to), true) = (held, response.interact_pointer_pos(), response.drag_stopped()) {
        let band = Rect::from_two_pos(from, to);
        let holds = |position| place.to_screen(position).is_some_and(|at| band.contains(at));
        let text = select_in_picture(&document.front, &mut document.list, holds, modifiers.command);
        document.message = Some(Message::info(text));
    }
    if !response.dragged() {
        return;
    }
    match (held, response.interact_pointer_pos()) {
        (Held::Wipe, Some(pointer)) => {
            let part = (pointer.x - place.picture.left()) / place.picture.width();
            document.front.compare.snapshots.wipe = part.clamp(0.0, 1.0);
        }
        (Held::Corner(corner), Some(pointer)) => {
            let position = place.to_picture(pointer);
            if let Some(corner) = document.front.meter.area.corners.get_mut(corner) {
                *corner = position;
            }
        }
        (Held::Sun(light), Some(pointer)) => move_sun_to(document, light, place.to_picture(pointer)),
        (Held::Band(_), _) => {}
        _ => {
            let delta = response.drag_delta();
            let size = document.size();
            document.front.view.pan(delta.into(), size);
        }
    }
}

/// Sets corners of the measured area by clicks; Enter or a double click ends it, Esc gives it up.
fn draw_corner(ui: &Ui, document: &mut Document, response: &egui::Response, place: &Place) {
    let (enter, escape) = ui.input(|input| (input.key_pressed(egui::Key::Enter), input.key_pressed(egui::Key::Escape)));
    if escape {
        (document.front.meter.area.corners, document.front.meter.draws) = (Vec::new(), false);
    } else if enter || response.double_clicked() {
        document.front.meter.draws = false;
    } else if let (true, Some(pointer)) = (response.clicked(), response.interact_pointer_pos()) {
        let position = place.to_picture(pointer);
        document.front.meter.area.corners.push(position);
    }
}

fn draw(ui: &Ui, document: &Document, place: &Place) {
    let rect = place.view;
    let painter = ui.painter().with_clip_rect(rect);
    let Some(texture) = document.front.shown.drawn() else {
        let read = document.front.shown.progress.base;
        let text = format!("Reading {:.0} %", read * 100.0);
        painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(14.0), WEAK);
        let bar = Rect::from_center_size(rect.center() + vec2(0.0, 22.0), vec2(220.0, 3.0));
        painter.rect_filled(bar, 1.5, Color32::from_gray(44));
        let done = Rect::from_min_size(bar.min, vec2(bar.width() * read, 3.0));
        painter.rect_filled(done, 1.5, ACCENT);
        return;
    };
    let texture = document.front.features.id().or(document.front.meter.id()).unwrap_or(texture);
    if let Some(outline) = document.front.view.outline {
        place.draw(&painter, outline, 0.0);
        return tag(&painter, Align2::CENTER_CENTER, pos2(rect.center().x, rect.top() + 18.0), "outline");
    }
    place.draw(&painter, texture, 0.0);
    draw_compared(ui, &painter, document, place);
    if document.front.features.id().is_none() {
        draw_labels(&painter, &document.front.meter, |position| place.to_screen(position));
    }
    draw_area(&painter, &document.front.meter, place.parts_of_side(), |position| place.to_screen(position));
    let asked = document.front.view.asked.as_ref();
    if let Some(at) = asked.and_then(|asked| place.to_screen(asked.pixel.map(|at| at as f32 + 0.5))) {
        painter.circle_stroke(at, 6.0, (2.5, Color32::from_black_alpha(140)));
        painter.circle_stroke(at, 6.0, (1.2, ACCENT));
    }
    let progress = document.front.shown.progress;
    if !progress.is_complete() {
        let text = match progress.base < 1.0 {
            true => format!("base layers {:.0} %", progress.base * 100.0),
            false => format!("refining {:.0} %", progress.whole * 100.0),
        };
        tag(&painter, Align2::CENTER_CENTER, pos2(rect.center().x, rect.top() + 18.0), &text);
    }
}

/// What the picture is compared with: beside the wipe, whole, or the difference.
fn draw_compared(ui: &Ui, painter: &egui::Painter, document: &Document, place: &Place) {
    let (rect, picture) = (place.view, place.picture);
    let (Some(other), Some(index)) = (document.front.compare.id(), document.front.compare.snapshots.compared()) else {
        return;
    };
    let name = &document.front.compare.snapshots.list()[index].name;
    // With Alt held the other is seen whole, as references are in tev.
    let alt = ui.input(|input| input.modifiers.alt);
    let beside = if alt { Beside::Other } else { document.front.view.beside };
    let top = picture.top().max(rect.top()) + 16.0;
    let left = picture.left().max(rect.left()) + 14.0;
    match (beside, document.front.compare.difference_id()) {
        (Beside::Wipe, _) => {
            let wipe_x = wipe_x(place, document);
            place.draw(painter, other, document.front.compare.snapshots.wipe);
            painter.vline(wipe_x, picture.y_range(), (1.5, Color32::from_gray(235)));
            painter.circle_filled(pos2(wipe_x, picture.center().y), 5.0, Color32::from_gray(235));
            tag(painter, Align2::RIGHT_CENTER, pos2(wipe_x - 14.0, top), "now");
            tag(painter, Align2::LEFT_CENTER, pos2(wipe_x + 14.0, top), name);
        }
        (Beside::Other, _) => {
            place.draw(painter, other, 0.0);
            tag(painter, Align2::LEFT_CENTER, pos2(left, top), name);
        }
        (Beside::Difference, Some(difference)) => {
            place.draw(painter, difference, 0.0);
            let text = format!("FLIP of now and {name}: black is none, yellow much");
            tag(painter, Align2::LEFT_CENTER, pos2(left, top), &text);
        }
        (Beside::Difference, None) => tag(painter, Align2::LEFT_CENTER, pos2(left, top), "Measuring the difference"),
    }
    if let Some(difference) = document.front.compare.difference() {
        let bottom = picture.bottom().min(rect.bottom()) - 16.0;
        tag(painter, Align2::CENTER_CENTER, pos2(rect.center().x, bottom), &difference_in_words(difference));
    }
}

/// Words on the picture, legible on any.
fn tag(painter: &egui::Painter, anchor: Align2, at: Pos2, text: &str) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(12.0), Color32::WHITE);
    let place = anchor.anchor_size(at, galley.size());
    painter.rect_filled(place.expand2(vec2(6.0, 3.0)), 4.0, Color32::from_black_alpha(160));
    painter.galley(place.min, galley, Color32::WHITE);
}
