//! The picture: pan, zoom, wipe, and the click that asks which light matters.

use eframe::egui::{self, Align2, Color32, FontId, Rect, Sense, Ui, pos2, vec2};

use super::document::Document;
use super::theme::{ACCENT, WEAK};

/// How near, in points, the pointer must be to take hold of the wipe.
const GRIP: f32 = 7.0;

pub(super) fn picture(ui: &mut Ui, document: &mut Document) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let size = document.size();
    document.viewport.follow([rect.width() - 24.0, rect.height() - 24.0], size);
    let place = |at: egui::Pos2| [at.x - rect.center().x, at.y - rect.center().y];
    let shown = |document: &Document| {
        let [left, top] = document.viewport.to_view([0.0, 0.0]);
        let extent = vec2(size[0] as f32, size[1] as f32) * document.viewport.zoom;
        Rect::from_min_size(rect.center() + vec2(left, top), extent)
    };
    let wipe_x = |document: &Document| {
        let picture = shown(document);
        picture.left() + document.snapshots.wipe * picture.width()
    };
    let comparing = document.compared_id().is_some();
    let grip = egui::Id::unique("wipe");
    let near = |x: f32, document: &Document| comparing && (x - wipe_x(document)).abs() < GRIP;
    if response.drag_started() {
        let origin = ui.input(|input| input.pointer.press_origin());
        let held = origin.is_some_and(|origin| near(origin.x, document));
        ui.data_mut(|data| data.insert_temp(grip, held));
    }
    if response.dragged() {
        let wiping = ui.data(|data| data.get_temp(grip).unwrap_or(false));
        match (wiping, response.interact_pointer_pos()) {
            (true, Some(pointer)) => {
                let picture = shown(document);
                document.snapshots.wipe = ((pointer.x - picture.left()) / picture.width()).clamp(0.0, 1.0);
            }
            _ => {
                let delta = response.drag_delta();
                document.viewport.pan([delta.x, delta.y], size);
            }
        }
    }
    let hover = response.hover_pos();
    if let Some(pointer) = hover {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let factor = (scroll * 0.004).exp() * pinch;
        if factor != 1.0 {
            document.viewport.zoom_about(place(pointer), factor);
        }
        if near(pointer.x, document) {
            ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
    }
    document.hovered = hover.and_then(|pointer| document.viewport.pixel_at(place(pointer), size));
    if response.double_clicked() {
        document.viewport.fit();
    } else if let (true, Some(pixel)) = (response.clicked(), document.hovered) {
        document.select_strongest = true;
        document.session.worker.ask_pixel(pixel);
    }
    draw(ui, document, rect, shown(document), wipe_x(document));
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "picture"));
}

fn draw(ui: &Ui, document: &Document, rect: Rect, picture: Rect, wipe_x: f32) {
    let painter = ui.painter().with_clip_rect(rect);
    let Some(texture) = document.picture_id() else {
        let read = document.progress.base;
        let text = format!("Reading {:.0} %", read * 100.0);
        painter.text(rect.center(), Align2::CENTER_CENTER, text, FontId::proportional(14.0), WEAK);
        let bar = Rect::from_center_size(rect.center() + vec2(0.0, 22.0), vec2(220.0, 3.0));
        painter.rect_filled(bar, 1.5, Color32::from_gray(44));
        let done = Rect::from_min_size(bar.min, vec2(bar.width() * read, 3.0));
        painter.rect_filled(done, 1.5, ACCENT);
        return;
    };
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    painter.image(texture, picture, whole, Color32::WHITE);
    if let (Some(other), Some(index)) = (document.compared_id(), document.snapshots.compared()) {
        let name = &document.snapshots.list()[index].name;
        // With Alt held the other is seen whole, as references are in tev.
        let whole = ui.input(|input| input.modifiers.alt);
        let (wipe, wipe_x) = if whole { (0.0, picture.left()) } else { (document.snapshots.wipe, wipe_x) };
        let part = Rect::from_min_max(pos2(wipe_x, picture.top()), picture.max);
        let uv = Rect::from_min_max(pos2(wipe, 0.0), pos2(1.0, 1.0));
        painter.image(other, part, uv, Color32::WHITE);
        let top = picture.top().max(rect.top()) + 16.0;
        if whole {
            tag(&painter, Align2::LEFT_CENTER, pos2(picture.left().max(rect.left()) + 14.0, top), name);
        } else {
            painter.vline(wipe_x, picture.y_range(), (1.5, Color32::from_gray(235)));
            painter.circle_filled(pos2(wipe_x, picture.center().y), 5.0, Color32::from_gray(235));
            tag(&painter, Align2::RIGHT_CENTER, pos2(wipe_x - 14.0, top), "now");
            tag(&painter, Align2::LEFT_CENTER, pos2(wipe_x + 14.0, top), name);
        }
    }
    if let Some(asked) = &document.asked {
        let centre = [asked.pixel[0] as f32 + 0.5, asked.pixel[1] as f32 + 0.5];
        let [x, y] = document.viewport.to_view(centre);
        let at = rect.center() + vec2(x, y);
        painter.circle_stroke(at, 6.0, (2.5, Color32::from_black_alpha(140)));
        painter.circle_stroke(at, 6.0, (1.2, ACCENT));
    }
    let progress = document.progress;
    if !progress.is_complete() {
        let text = match progress.base < 1.0 {
            true => format!("base layers {:.0} %", progress.base * 100.0),
            false => format!("refining {:.0} %", progress.whole * 100.0),
        };
        tag(&painter, Align2::CENTER_CENTER, pos2(rect.center().x, rect.top() + 18.0), &text);
    }
}

/// Words on the picture, legible on any.
fn tag(painter: &egui::Painter, anchor: Align2, at: egui::Pos2, text: &str) {
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(12.0), Color32::WHITE);
    let place = anchor.anchor_size(at, galley.size());
    painter.rect_filled(place.expand2(vec2(6.0, 3.0)), 4.0, Color32::from_black_alpha(160));
    painter.galley(place.min, galley, Color32::WHITE);
}
