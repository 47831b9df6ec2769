//! The mixer: a row for each light and group.

use eframe::egui::text::{LayoutJob, TextWrapping};
use eframe::egui::{self, Color32, Rect, Response, RichText, Role, Sense, TextEdit, Ui, WidgetInfo, pos2, vec2};

use super::actions::{Action, act};
use super::document::Document;
use super::fader::{NUMBER, fader, stops_number};
use super::light_list::{LightList, search_id};
use super::light_panel::colour_popup;
use super::renaming::Renaming;
use super::row_menu::{group_menu, light_menu};
use super::selection::move_stops;
use super::theme::{ACCENT, IDLE, LINE, SELECTED, TEXT, TROUGH, WEAK, swatch};
use crate::groups::Groups;
use crate::mixer::Mix;
use crate::rows::{Order, Row};

/// Height of a row, in points.
const ROW: f32 = 28.0;
/// Between the parts of a row, in points.
const GAP: f32 = 6.0;
/// How far each group moves what is in it to the right, in points.
const INDENT: f32 = 14.0;

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
    document.list.rank(is_used || ui.memory(|memory| memory.focused().is_some()));
    let rows = document.rows();
    if rows.is_empty() {
        ui.label(RichText::new("No light or group has this name.").color(WEAK));
        return;
    }
    let strongest = document.list.contributions.iter().copied().fold(0.0, f32::max);
    ui.spacing_mut().item_spacing.y = 0.0;
    let mut area = egui::ScrollArea::vertical().id_salt("mixer rows").auto_shrink([false, false]);
    if std::mem::take(&mut document.list.scroll_to_selected) {
        let selected = document.list.selected();
        let is_selected = |row: &Row| matches!(row, Row::Light { light, .. } if Some(*light) == selected);
        if let Some(at) = rows.iter().position(is_selected) {
            area = area.vertical_scroll_offset((at as f32 - 3.0).max(0.0) * ROW);
        }
    }
    area.show_rows(ui, ROW, rows.len(), |ui, range| {
        ui.spacing_mut().item_spacing = vec2(GAP, 0.0);
        for at in range {
            match rows[at] {
                // A menu may have taken it away in this frame.
                Row::Group { group, depth } if group < document.work.mix.groups.len() => {
                    group_row(ui, document, group, depth);
                }
                Row::Group { .. } => {}
                Row::Light { light, depth } => {
                    light_row(ui, document, ListedLight { light, depth, at, rows: &rows }, strongest)
                }
            }
        }
    });
}

/// Title, what is done to all lights, search and order.
fn head(ui: &mut Ui, document: &mut Document, titled: bool) {
    ui.add_space(8.0);
    ui.horizontal(|ui| {
        if titled {
            ui.label(RichText::new("Lights").size(15.0).strong());
        }
        let own = document.front.lights.places();
        let (count, shining) = (own.len(), own.iter().filter(|&&light| document.work.mix.shines(light)).count());
        let chosen = document.list.chosen().len();
        let text = if chosen > 1 { format!("{chosen} selected") } else { format!("{shining} of {count} on") };
        ui.label(RichText::new(text).color(WEAK));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            if ui.button("Reset").on_hover_text("Back to the scene's own lighting; groups stay (Shift+R)").clicked() {
                document.work.reset();
            }
            let solo = document.work.mix.has_solo();
            if ui.add_enabled(solo, egui::Button::new("Solo off")).on_hover_text("End all solo").clicked() {
                document.work.mix.clear_solo();
            }
        });
    });
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for (name, about, action) in [
            ("All on", "Switch every light and group on", Action::AllOn),
            ("All off", "Switch every light off", Action::AllOff),
            (
                "Group",
                "Make a group of the selected lights (Ctrl+G); Ctrl or Shift and a click select several",
                Action::Group,
            ),
        ] {
            if ui.button(name).on_hover_text(about).clicked() {
                act(ui.ctx(), document, action);
            }
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let name = |order| match order {
                Order::File => "as in file",
                Order::Name => "by name",
                Order::Contribution => "by effect",
            };
            let order = &mut document.list.order;
            egui::ComboBox::from_id_salt("order").width(84.0).selected_text(name(*order)).show_ui(ui, |ui| {
                for own in [Order::File, Order::Name, Order::Contribution] {
                    ui.selectable_value(order, own, name(own));
                }
            });
            ui.label(RichText::new("Sort").color(WEAK));
        });
    });
    let width = ui.available_width();
    let search = TextEdit::singleline(&mut document.list.search).hint_text("Search  (Ctrl+P)").desired_width(width);
    ui.add(search.id(search_id()));
    ui.add_space(2.0);
}

fn group_row(ui: &mut Ui, document: &mut Document, group: usize, depth: usize) {
    let name = document.work.mix.groups.group(group).name.clone();
    let lights = document.work.mix.groups.lights(group);
    let is_chosen = lights.iter().all(|light| document.list.chosen().contains(light));
    let RowSpace { row, response, mut ui } = begin_row(ui, ("group", group), is_chosen && lights.len() > 1);
    let ui = &mut ui;
    mark(ui, &document.work.mix.groups, row, Some(group));
    ui.add_space(depth as f32 * INDENT);
    // What is searched for shows in folded groups too.
    let folded = document.list.folded.contains(&name) && document.list.search.trim().is_empty();
    let (arrow, toggle) = ui.allocate_exact_size(vec2(14.0, ROW), Sense::click());
    toggle.widget_info(|| WidgetInfo::labeled(Role::DisclosureTriangle, true, format!("group {name}")));
    let [ahead, across] = if folded { [vec2(3.0, 0.0), vec2(0.0, 4.0)] } else { [vec2(0.0, 3.0), vec2(4.0, 0.0)] };
    let centre = arrow.center();
    let corners = vec![centre + ahead, centre - ahead + across, centre - ahead - across];
    ui.painter().add(egui::Shape::convex_polygon(corners, WEAK, egui::Stroke::NONE));
    if toggle.clicked() && !document.list.folded.remove(&name) {
        document.list.folded.insert(name.clone());
    }
    let modifiers = ui.input(|input| input.modifiers);
    let solo = document.work.mix.groups.group(group).solo;
    let mut on = document.work.mix.groups.group(group).on;
    let own = document.work.mix.groups.group(group).colour;
    let colour = own.map_or(NEUTRAL, |[r, g, b]| Color32::from_rgb(r, g, b));
    if switch(ui, &mut on, solo, colour, &name).clicked() {
        match modifiers.alt || modifiers.command {
            true => document.work.mix.toggle_group_solo(group, modifiers.shift),
            false => document.work.mix.groups.group_mut(group).on = on,
        }
    }
    if solo_button(ui, solo, &name).clicked() {
        document.work.mix.toggle_group_solo(group, modifiers.shift);
    }
    if document.list.renamed.as_ref().is_some_and(|renaming| renaming.index == group) {
        rename(ui, &mut document.list, &mut document.work.mix.groups, name_width(ui, row));
    } else {
        let text = if document.work.mix.groups.group(group).on { TEXT } else { WEAK };
        name_text(ui, row, &format!("{name}  ({})", lights.len()), text, true);
    }
    let mix = document.work.mix.groups.group_mut(group);
    fader(ui, &mut mix.stops, fader_width(row), &name, colour);
    stops_number(ui, &mut mix.stops);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("group {name}, row")));
    if response.double_clicked() {
        document.list.renamed = Some(Renaming::of(group, &name));
    } else if response.clicked() {
        document.list.select_all(lights.iter().copied());
    }
    if response.secondary_clicked() && !is_chosen {
        document.list.select_all(lights);
    }
    response.context_menu(|ui| group_menu(ui, document, group));
    response.on_hover_text(format!("{name}\nClick: select its lights.  Double-click: rename.  Right-click: more."));
}

/// The field in which a group's name is typed.
fn rename(ui: &mut Ui, list: &mut LightList, groups: &mut Groups, width: f32) {
    let Some(Renaming { index: group, text }) = &mut list.renamed else { return };
    let field = ui.add(TextEdit::singleline(text).desired_width(width - 8.0).id(egui::Id::unique("rename group")));
    if field.lost_focus() {
        let (group, text) = (*group, text.clone());
        list.renamed = None;
        if !ui.input(|input| input.key_pressed(egui::Key::Escape)) {
            let was_folded = list.folded.remove(&groups.group(group).name);
            groups.rename(group, &text);
            if was_folded {
                list.folded.insert(groups.group(group).name.clone());
            }
        }
    } else if !field.has_focus() {
        field.request_focus();
    }
}

/// A light among the rows of the list.
#[derive(Clone, Copy)]
struct ListedLight<'a> {
    light: usize,
    /// How many groups it stands in.
    depth: usize,
    /// The place of its row.
    at: usize,
    rows: &'a [Row],
}

fn light_row(ui: &mut Ui, document: &mut Document, listed: ListedLight, strongest: f32) {
    let ListedLight { light, depth, .. } = listed;
    let chosen = document.list.chosen().contains(&light);
    let RowSpace { row, response, mut ui } = begin_row(ui, ("light", light), chosen);
    let ui = &mut ui;
    mark(ui, &document.work.mix.groups, row, document.work.mix.groups.of_light(light));
    let described = document.lights.lights()[light].clone();
    let shines = document.work.mix.shines(light);
    let colour = swatch(document.work.mix.lights[light].colour(&described));
    let name = described.name.clone();
    let shown = document.work.mix.groups.of_light(light).and_then(|group| {
        let short = name.strip_prefix(document.work.mix.groups.group(group).name.as_str())?;
        let short = short.trim_start_matches(['/', ':', '.', '_', '-', ' ', '#']);
        (!short.is_empty()).then(|| short.to_owned())
    });
    ui.add_space(if depth > 0 { depth as f32 * INDENT + 8.0 } else { 0.0 });
    let solo = document.work.mix.lights[light].solo;
    let lamp = if shines { colour } else { colour.gamma_multiply(0.35) };
    let mut on = document.work.mix.lights[light].on;
    let modifiers = ui.input(|input| input.modifiers);
    let about = "Click: on or off.  Ctrl-click: solo.  Ctrl-Shift-click: add to the solo.";
    if switch(ui, &mut on, solo, lamp, &name).on_hover_text(about).clicked() {
        match modifiers.alt || modifiers.command {
            true => document.work.mix.toggle_solo(light, modifiers.shift),
            false => document.work.mix.lights[light].on = on,
        }
    }
    if solo_button(ui, solo, &name).clicked() {
        document.work.mix.toggle_solo(light, modifiers.shift);
    }
    colour_popup(ui, document, light, &described, colour);
    name_text(ui, row, shown.as_deref().unwrap_or(&name), if shines { TEXT } else { WEAK }, false);
    let tint = if shines { colour } else { Color32::from_gray(84) };
    let mut stops = document.work.mix.lights[light].stops;
    let moved = fader(ui, &mut stops, fader_width(row), &name, tint).changed();
    if stops_number(ui, &mut stops).changed() || moved {
        // Selected together, they move together.
        if !chosen {
            document.list.select(light);
        }
        move_stops(&document.list, &mut document.work.mix, light, stops);
    }
    let share = document.list.contributions.get(light).copied().unwrap_or(0.0).max(0.0);
    if strongest > 0.0 {
        let part = (share / strongest).clamp(0.0, 1.0).sqrt();
        let bar = Rect::from_min_size(pos2(row.left(), row.bottom() - 1.5), vec2(row.width() * part, 1.5));
        ui.painter().rect_filled(bar, 0.0, if shines { tint.gamma_multiply(0.28) } else { TROUGH });
    }
    select_by(ui, &mut document.list, &mut document.work.mix, listed, &response);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("{name}, row")));
    response.context_menu(|ui| light_menu(ui, document, light));
    let all: f32 = document.list.contributions.iter().map(|v| v.max(0.0)).sum();
    let percent = if all > 0.0 { share / all * 100.0 } else { 0.0 };
    response.on_hover_text(format!("{name}\n{percent:.1} % of the picture's light, as the line below shows"));
}

/// Selects by clicks and drags on a row.
fn select_by(ui: &Ui, list: &mut LightList, mix: &mut Mix, listed: ListedLight, response: &Response) {
    let ListedLight { light, at, rows, .. } = listed;
    let modifiers = ui.input(|input| input.modifiers);
    if response.clicked() && modifiers.alt {
        mix.toggle_solo(light, modifiers.shift);
    } else if response.clicked() && modifiers.shift {
        list.select_to(light, rows);
    } else if response.clicked() && modifiers.command {
        list.toggle(light);
    } else if response.clicked() || response.drag_started() {
        list.select(light);
    }
    if let (true, Some(pointer)) = (response.dragged(), response.interact_pointer_pos()) {
        let offset = ((pointer.y - response.rect.top()) / ROW).floor() as isize;
        let over = at.saturating_add_signed(offset).min(rows.len() - 1);
        if let Row::Light { light: over, .. } = rows[over] {
            list.select_to(over, rows);
        }
    }
    if response.secondary_clicked() && !list.chosen().contains(&light) {
        list.select(light);
    }
}

/// The space of a row.
struct RowSpace {
    row: Rect,
    /// Of all of it.
    response: Response,
    /// For what is in it.
    ui: Ui,
}

/// The space of a row, with what lies behind it: all of it can be clicked. What is in it is known by `what`, wherever the
/// row stands: a fader that is dragged or has the keyboard stays that of its light.
fn begin_row(ui: &mut Ui, what: impl egui::AsIdSalt + Copy, selected: bool) -> RowSpace {
    let (_, row) = ui.allocate_space(vec2(ui.available_width(), ROW));
    // Not a stop for Tab: its parts are.
    let response = ui.interact(row, ui.scope_id().with((what, "row")), Sense::CLICK | Sense::DRAG);
    if selected {
        ui.painter().rect_filled(row, 3.0, SELECTED);
    } else if response.contains_pointer() {
        ui.painter().rect_filled(row, 3.0, Color32::from_gray(34));
    }
    ui.painter().hline(row.x_range(), row.bottom() - 0.5, (1.0, LINE.gamma_multiply(0.5)));
    let layout = egui::Layout::left_to_right(egui::Align::Center);
    let inside = row.shrink2(vec2(4.0, 0.0));
    let ui = ui.new_child(egui::UiBuilder::new().id_salt(what).max_rect(inside).layout(layout));
    RowSpace { row, response, ui }
}

/// The colours of the groups around a row, at its left edge.
fn mark(ui: &Ui, groups: &Groups, row: Rect, group: Option<usize>) {
    let around = std::iter::successors(group, |&group| groups.group(group).parent);
    if let Some([r, g, b]) = around.into_iter().find_map(|group| groups.group(group).colour) {
        let bar = Rect::from_min_size(row.left_top(), vec2(3.0, row.height()));
        ui.painter().rect_filled(bar, 0.0, Color32::from_rgb(r, g, b));
    }
}

/// A fader takes what names can spare.
fn fader_width(row: Rect) -> f32 {
    (row.width() * 0.36).clamp(90.0, 220.0)
}

/// A light's switch: filled with its colour when on, ringed when solo.
fn switch(ui: &mut Ui, on: &mut bool, solo: bool, colour: Color32, name: &str) -> Response {
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
        painter.circle_stroke(centre, 5.0, (1.0, IDLE));
    }
    if solo {
        painter.circle_stroke(centre, 8.0, (1.5, ACCENT));
    } else if response.hovered() || response.has_focus() {
        painter.circle_stroke(centre, 8.0, (1.0, Color32::from_gray(150)));
    }
    response
}

/// Solo on a light or group.
fn solo_button(ui: &mut Ui, solo: bool, name: &str) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(14.0, ROW), Sense::click());
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, solo, format!("{name}, solo")));
    let near = response.hovered() || response.has_focus();
    let colour = if solo { ACCENT } else { if near { TEXT } else { IDLE } };
    let font = egui::FontId::proportional(11.0);
    ui.painter().text(rect.center(), egui::Align2::CENTER_CENTER, "S", font, colour);
    response.on_hover_text("Solo; with Shift add to the solo")
}

/// Width that a name has beside the fader.
fn name_width(ui: &Ui, row: Rect) -> f32 {
    (row.right() - ui.cursor().left() - fader_width(row) - NUMBER - 3.0 * GAP).max(24.0)
}

/// The name, cut to the space that the fader leaves; what is clicked is the row.
fn name_text(ui: &mut Ui, row: Rect, text: &str, colour: Color32, strong: bool) {
    let width = name_width(ui, row);
    let font = egui::TextStyle::Body.resolve(ui.style());
    let colour = if strong && colour == TEXT { Color32::WHITE } else { colour };
    let mut job = LayoutJob::simple_singleline(text.to_owned(), font, colour);
    job.wrap = TextWrapping::truncate_at_width(width);
    let galley = ui.painter().layout_job(job);
    let (_, rect) = ui.allocate_space(vec2(width, ROW));
    ui.painter().galley(rect.left_center() - vec2(0.0, galley.size().y / 2.0), galley, colour);
}
