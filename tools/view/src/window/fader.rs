//! The fader: a slider in stops, made for hundreds of rows.

use eframe::egui::{self, Color32, Key, Rect, Response, Sense, Ui, WidgetInfo, vec2};

use super::theme::{ACCENT, TROUGH, WEAK};
use crate::mixer::STOPS_RANGE;

/// Width of stops as a number, in points.
pub(super) const NUMBER: f32 = 46.0;

/// A drag this near to no change, in stops, is no change.
const CATCH: f32 = 0.12;

/// Drags, steps and resets stops: drag sets, shift-drag is ten times finer, a double click resets, the arrow keys
/// step by a quarter (with shift by a twentieth). `colour` is that of what shines.
pub(super) fn fader(ui: &mut Ui, stops: &mut f32, width: f32, name: &str, colour: Color32) -> Response {
    let (low, high) = (*STOPS_RANGE.start(), *STOPS_RANGE.end());
    let height = ui.spacing().interact_size.y;
    let (rect, mut response) = ui.allocate_exact_size(vec2(width, height), Sense::click_and_drag());
    let before = *stops;
    let fine = ui.input(|input| input.modifiers.shift);
    let inner = rect.shrink2(vec2(5.0, 0.0));
    if response.double_clicked() {
        *stops = 0.0;
    } else if response.dragged() && fine {
        *stops += response.drag_delta().x / inner.width() * (high - low) * 0.1;
    } else if let (true, Some(pointer)) = (response.dragged() || response.clicked(), response.interact_pointer_pos()) {
        let at = low + (pointer.x - inner.left()) / inner.width() * (high - low);
        *stops = if at.abs() < CATCH { 0.0 } else { at };
    }
    if response.has_focus() {
        ui.memory_mut(|memory| {
            let filter = egui::EventFilter { horizontal_arrows: true, ..Default::default() };
            memory.set_focus_lock_filter(response.id, filter);
        });
        let step = if fine { 0.05 } else { 0.25 };
        let steps =
            ui.input(|input| input.num_presses(Key::ArrowRight) as f32 - input.num_presses(Key::ArrowLeft) as f32);
        *stops += steps * step;
        if ui.input(|input| input.key_pressed(Key::Home)) {
            *stops = 0.0;
        }
    }
    *stops = stops.clamp(low, high);
    if *stops != before {
        response.mark_changed();
    }
    response.widget_info(|| WidgetInfo::slider(ui.is_enabled(), f64::from(*stops), format!("{name}, stops")));
    paint(ui, &response, inner, *stops, colour);
    response
}

fn paint(ui: &Ui, response: &Response, inner: Rect, stops: f32, colour: Color32) {
    let (low, high) = (*STOPS_RANGE.start(), *STOPS_RANGE.end());
    let x = |stops: f32| inner.left() + (stops - low) / (high - low) * inner.width();
    let middle = inner.center().y;
    let painter = ui.painter();
    let bar = |from: f32, to: f32| Rect::from_x_y_ranges(from.min(to)..=from.max(to), middle - 1.5..=middle + 1.5);
    painter.rect_filled(bar(inner.left(), inner.right()), 1.5, TROUGH);
    painter.rect_filled(bar(x(0.0), x(stops)), 1.5, colour);
    let tick = Rect::from_center_size(egui::pos2(x(0.0), middle), vec2(1.0, 9.0));
    painter.rect_filled(tick, 0.0, Color32::from_gray(90));
    let active = response.hovered() || response.dragged() || response.has_focus();
    let knob = if active { Color32::WHITE } else { Color32::from_gray(196) };
    let knob_rect = Rect::from_center_size(egui::pos2(x(stops), middle), vec2(6.0, 14.0));
    painter.rect_filled(knob_rect, 2.0, if ui.is_enabled() { knob } else { WEAK });
    if response.has_focus() {
        painter.rect_stroke(knob_rect.expand(2.0), 3.0, (1.0, ACCENT), egui::StrokeKind::Outside);
    }
}

/// Stops as a number that can be typed or dragged.
pub(super) fn stops_number(ui: &mut Ui, stops: &mut f32) -> Response {
    let untouched = *stops == 0.0;
    let number = egui::DragValue::new(stops)
        .range(STOPS_RANGE)
        .speed(0.02)
        .update_while_editing(false)
        .custom_formatter(|value, _| if value.abs() < 0.005 { "0".into() } else { format!("{value:+.2}") });
    let size = vec2(NUMBER, ui.spacing().interact_size.y);
    ui.scope(|ui| {
        // A column of boxes would be louder than what is in them.
        let inactive = &mut ui.visuals_mut().widgets.inactive;
        inactive.weak_bg_fill = Color32::TRANSPARENT;
        if untouched {
            inactive.fg_stroke.color = WEAK;
        }
        ui.add_sized(size, number)
    })
    .inner
}
