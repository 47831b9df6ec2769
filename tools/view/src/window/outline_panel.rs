//! The outline of a scene in the place of its picture, and the pointer that moves its camera.

use eframe::egui::{self, Align2, Color32, FontId, PointerButton, Rect, Response, Sense, TextureId, Ui, pos2, vec2};
use glam::Vec2;

use super::theme::WEAK;
use crate::camera_moves::CameraMove;
use ltm::scene::Camera;

/// Radians for a drag over the height of the view.
const ORBIT: f32 = 3.0;
/// How much nearer a drag over the height of the view goes, as a power of e, and a point of the wheel.
const DOLLY: f32 = 2.5;
const WHEEL: f32 = 0.004;

/// Shows an outline as large as it goes; how the pointer moves the camera.
pub(super) fn outline_panel(ui: &mut Ui, outline: Option<(TextureId, Camera)>) -> Vec<CameraMove> {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "outline"));
    let painter = ui.painter().with_clip_rect(rect);
    let Some((texture, camera)) = outline else {
        painter.text(rect.center(), Align2::CENTER_CENTER, "Reading the scene", FontId::proportional(14.0), WEAK);
        return Vec::new();
    };
    let size = vec2(camera.width as f32, camera.height as f32);
    let room = rect.size() - vec2(24.0, 24.0);
    let place = Rect::from_center_size(rect.center(), size * (room.x / size.x).min(room.y / size.y));
    painter.image(texture, place, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    camera_moves(ui, &response)
}

/// How the pointer moves the camera over the picture: a drag with another button than the first orbits, with Shift it pans, with Ctrl it
/// goes nearer; so does the wheel with Ctrl.
pub(super) fn camera_moves(ui: &Ui, response: &Response) -> Vec<CameraMove> {
    let height = response.rect.height().max(1.0);
    let mut moves = Vec::new();
    if is_camera_drag(response) {
        let by = response.drag_delta() / height;
        let modifiers = ui.input(|input| input.modifiers);
        if by != egui::Vec2::ZERO {
            moves.push(match (modifiers.shift, modifiers.command) {
                (true, _) => CameraMove::Pan(Vec2::new(by.x, by.y)),
                (_, true) => CameraMove::Dolly((DOLLY * by.y).exp()),
                _ => CameraMove::Orbit(-ORBIT * Vec2::new(by.x, -by.y)),
            });
        }
    }
    if response.hovered() {
        // With Ctrl the wheel is a zoom of its own.
        let zoom = ui.input(|input| if input.modifiers.command { input.zoom_delta() } else { 1.0 });
        if zoom != 1.0 {
            moves.push(CameraMove::Dolly(zoom.recip()));
        }
        let narrower = ui.input(|input| if input.modifiers.alt { input.smooth_scroll_delta().y } else { 0.0 });
        if narrower != 0.0 {
            moves.push(CameraMove::Dolly((-WHEEL * narrower).exp()));
        }
    }
    moves
}

/// Whether a drag moves the camera, and not the picture.
pub(super) fn is_camera_drag(response: &Response) -> bool {
    response.dragged_by(PointerButton::Secondary) || response.dragged_by(PointerButton::Middle)
}
