//! The mixer: a row for each light and group.

use eframe::egui::{self, Color32, Rect, RichText, Role, Sense, Ui, WidgetInfo, pos2, vec2};

use super::document::Document;
use super::fader::{NUMBER, fader, stops_number};
use super::theme::{ACCENT, LINE, TEXT, TROUGH, WEAK, swatch};
use crate::groups::{Order, Row};

/// Height of a row, in points.
const ROW: f32 = 28.0;
/// Between the parts of a row, in points.
const GAP: f32 = 6.0;

/// Colour of a group's faders.
const NEUTRAL: Color32 = Color32::from_gray(150);

/// The whole mixer; `titled` where no tab says already what it is.
pub(super) fn mixer(ui: &mut Ui, document: &mut Document, titled: bool) {
    head(ui, document, titled);
    // Rows that moved while one of them is used would be a trap.
    let is_used = ui.input(|input| {
        let pointer = &input.pointer;
        pointer.any_down() || pointer.latest_pos().is_some_and(|pointer| ui.max_rect().contains(pointer))
    });
    document.rank(is_used || ui.memory(|memory| memory.focused().is_some()));
    let rows = document.rows();
    if rows.is_empty() {
        ui.label(RichText::new("No light has this name.").color(WEAK));
        return;
    }
    let strongest = document.contributions.iter().copied().fold(0.0, f32::max);
    ui.spacing_mut().item_spacing.y = 0.0;
    let mut area = egui::ScrollArea::vertical().id_salt("mixer rows").auto_shrink([false, false]);
    if std::mem::take(&mut document.scroll_to_selected) {
        let is_selected = |row: &Row| matches!(row, Row::Light { light, .. } if Some(*light) == document.selected);
        if let Some(at) = rows.iter().position(is_selected) {
            area = area.vertical_scroll_offset((at as f32 - 3.0).max(0.0) * ROW);
        }
    }
    area.show_rows(ui, ROW, rows.len(), |ui, range| {
        ui.spacing_mut().item_spacing = vec2(GAP, 0.0);
        for row in &rows[range] {
            match *row {
                Row::Group(group) => group_row(ui, document, group),
                Row::Light { light, indented } => light_row(ui, document, light, indented, strongest),
            }
        }
    });
}

/// Title, solo and reset, search and order.
fn head(ui: &mut Ui, document: &mut Document, titled: bool) {
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        if titled {
            ui.label(RichText::new("Lights").size(15.0).strong());
        }
        let count = document.session.basis().lights().len();
        let shining = (0..count).filter(|&light| document.mix.shines(light, &document.groups)).count();
        ui.label(RichText::new(format!("{shining} of {count} on")).color(WEAK));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.button("Reset").on_hover_text("Back to the scene's own lighting (Shift+R)").clicked() {
                document.reset();
            }
            let solo = document.mix.has_solo();
            if ui.add_enabled(solo, egui::Button::new("Unsolo")).on_hover_text("Hear all lights again").clicked() {
                document.mix.lights.iter_mut().for_each(|light| light.solo = false);
            }
        });
    });
    ui.horizontal(|ui| {
        let width = ui.available_width() - 108.0;
        let search =
            egui::TextEdit::singleline(&mut document.search).hint_text("Search  (Ctrl+P)").desired_width(width);
        ui.add(search.id(search_id()));
        let name = |order| match order {
            Order::File => "as in file",
            Order::Name => "by name",
            Order::Contribution => "by effect",
        };
        egui::ComboBox::from_id_salt("order").width(92.0).selected_text(name(document.order)).show_ui(ui, |ui| {
            for order in [Order::File, Order::Name, Order::Contribution] {
                ui.selectable_value(&mut document.order, order, name(order));
            }
        });
    });
    ui.add_space(2.0);
}

/// Identity of the search field, for its key.
pub(super) fn search_id() -> egui::Id {
    egui::Id::unique("search lights")
}

fn group_row(ui: &mut Ui, document: &mut Document, group: usize) {
    let (row, mut ui) = begin_row(ui, ("group", group), false);
    let ui = &mut ui;
    let name = document.groups.group(group).name.clone();
    // What is searched for shows in folded groups too.
    let folded = document.folded.contains(&group) && document.search.trim().is_empty();
    let (arrow, toggle) = ui.allocate_exact_size(vec2(14.0, ROW), Sense::click());
    toggle.widget_info(|| WidgetInfo::labeled(Role::DisclosureTriangle, true, format!("group {name}")));
    let [ahead, across] = if folded { [vec2(3.0, 0.0), vec2(0.0, 4.0)] } else { [vec2(0.0, 3.0), vec2(4.0, 0.0)] };
    let centre = arrow.center();
    let corners = vec![centre + ahead, centre - ahead + across, centre - ahead - across];
    ui.painter().add(egui::Shape::convex_polygon(corners, WEAK, egui::Stroke::NONE));
    let mix = &mut document.mix.groups[group];
    switch(ui, &mut mix.on, false, NEUTRAL, &name);
    let count = document.groups.group(group).lights.len();
    let label = label(ui, row, &format!("{name}  ({count})"), if mix.on { TEXT } else { WEAK }, true);
    if (toggle.clicked() || label.clicked()) && !document.folded.remove(&group) {
        document.folded.insert(group);
    }
    fader(ui, &mut mix.stops, fader_width(row), &name, NEUTRAL);
    stops_number(ui, &mut mix.stops);
}

fn light_row(ui: &mut Ui, document: &mut Document, light: usize, indented: bool, strongest: f32) {
    let selected = document.selected == Some(light);
    let (row, mut ui) = begin_row(ui, ("light", light), selected);
    let ui = &mut ui;
    let described = &document.session.basis().lights()[light];
    let shines = document.mix.shines(light, &document.groups);
    let colour = swatch(document.mix.lights[light].colour(described));
    let name = described.name.clone();
    let shown = document.groups.of_light(light).filter(|_| indented).and_then(|group| {
        let short = name.strip_prefix(document.groups.group(group).name.as_str())?;
        Some(short.trim_start_matches(['/', ':', '.', '_', '-', ' ', '#']).to_owned())
    });
    ui.add_space(if indented { 22.0 } else { 0.0 });
    let solo = document.mix.lights[light].solo;
    let lamp = if shines { colour } else { colour.gamma_multiply(0.35) };
    let response = switch(ui, &mut document.mix.lights[light].on, solo, lamp, &name);
    let response = response.on_hover_text("Click: on or off.  Alt-click: solo.  Alt-Shift-click: add to the solo.");
    let modifiers = ui.input(|input| input.modifiers);
    if response.clicked() && modifiers.alt {
        // The click has switched the light as well: that is not meant here.
        document.mix.lights[light].on = true;
        document.mix.toggle_solo(light, modifiers.shift);
    }
    if solo_button(ui, solo, &name).clicked() {
        document.mix.toggle_solo(light, modifiers.shift);
    }
    let text = if shines { TEXT } else { WEAK };
    let label = label(ui, row, shown.as_deref().unwrap_or(&name), text, false).on_hover_text(&name);
    if label.clicked() {
        document.selected = Some(light);
        if modifiers.alt {
            document.mix.toggle_solo(light, modifiers.shift);
        }
    }
    let tint = if shines { colour } else { Color32::from_gray(84) };
    let changed = fader(ui, &mut document.mix.lights[light].stops, fader_width(row), &name, tint).changed();
    if stops_number(ui, &mut document.mix.lights[light].stops).changed() || changed {
        document.selected = Some(light);
    }
    if let (Some(&contribution), true) = (document.contributions.get(light), strongest > 0.0) {
        let share = (contribution / strongest).clamp(0.0, 1.0).sqrt();
        let bar = Rect::from_min_size(pos2(row.left(), row.bottom() - 1.5), vec2(row.width() * share, 1.5));
        ui.painter().rect_filled(bar, 0.0, if shines { tint.gamma_multiply(0.28) } else { TROUGH });
    }
}

/// The space of a row, with what lies behind it. What is in it is known by `what`, wherever the row stands: a fader that
/// is dragged or has the keyboard stays that of its light.
fn begin_row(ui: &mut Ui, what: (&str, usize), selected: bool) -> (Rect, Ui) {
    let (row, response) = ui.allocate_exact_size(vec2(ui.available_width(), ROW), Sense::hover());
    if selected {
        ui.painter().rect_filled(row, 3.0, Color32::from_rgb(52, 44, 34));
    } else if response.contains_pointer() {
        ui.painter().rect_filled(row, 3.0, Color32::from_gray(34));
    }
    ui.painter().hline(row.x_range(), row.bottom() - 0.5, (1.0, LINE.gamma_multiply(0.5)));
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    let inside = row.shrink2(vec2(4.0, 0.0));
    (row, ui.new_child(egui::UiBuilder::new().id_salt(what).max_rect(inside).layout(layout)))
}

/// A fader takes what names can spare.
fn fader_width(row: Rect) -> f32 {
    (row.width() * 0.38).clamp(90.0, 220.0)
}

/// A light's switch: filled with its colour when on, ringed when solo.
fn switch(ui: &mut Ui, on: &mut bool, solo: bool, colour: Color32, name: &str) -> egui::Response {
    let (rect, mut response) = ui.allocate_exact_size(vec2(18.0, ROW), Sense::click());
    if response.clicked() {
        *on = !*on;
        response.mark_changed();
    }
    response.widget_info(|| WidgetInfo::selected(Role::CheckBox, true, *on, format!("{name}, on")));
    let (centre, painter) = (rect.center(), ui.painter());
    if *on {
        painter.circle_filled(centre, 5.5, colour);
    } else {
        painter.circle_stroke(centre, 5.0, (1.0, Color32::from_gray(96)));
    }
    if solo {
        painter.circle_stroke(centre, 8.0, (1.5, ACCENT));
    } else if response.hovered() || response.has_focus() {
        painter.circle_stroke(centre, 8.0, (1.0, Color32::from_gray(150)));
    }
    response
}

/// Hears a light alone.
fn solo_button(ui: &mut Ui, solo: bool, name: &str) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(vec2(14.0, ROW), Sense::click());
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, solo, format!("{name}, solo")));
    let near = response.hovered() || response.has_focus();
    let colour = if solo { ACCENT } else { Color32::from_gray(if near { 190 } else { 104 }) };
    let font = egui::FontId::proportional(11.0);
    ui.painter().text(rect.center(), egui::Align2::CENTER_CENTER, "S", font, colour);
    response.on_hover_text("Solo; with Shift add to the solo")
}

/// The name, cut to the space that the fader leaves.
fn label(ui: &mut Ui, row: Rect, text: &str, colour: Color32, strong: bool) -> egui::Response {
    let left = ui.cursor().left();
    let width = (row.right() - left - fader_width(row) - NUMBER - 3.0 * GAP).max(30.0);
    let mut text = RichText::new(text).color(colour);
    if strong {
        text = text.strong();
    }
    let label =
        egui::Label::new(text).truncate().selectable(false).sense(Sense::click()).show_tooltip_when_elided(false);
    ui.allocate_ui_with_layout(vec2(width, ROW), egui::Layout::left_to_right(egui::Align::Center), |ui| {
        ui.set_min_width(width);
        ui.add(label)
    })
    .inner
}
