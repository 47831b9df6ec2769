//! Keys, as tev has them where it has them, and the window that lists them.

use eframe::egui::{self, Event, Key, Modifiers, RichText};

use super::chooser::Purpose;
use super::document::Document;
use super::light_list::lights_of;
use super::mixer_panel::search_id;
use super::shown_picture::colour_image;
use super::theme::{ACCENT, WEAK};
use super::view_state::Beside;

/// Action of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Open,
    Reload,
    Quit,
    Png,
    Exr,
    Layers,
    CopyPicture,
    CopyCommand,
    LoadLook,
    SaveLook,
    Reference,
    Brighter,
    Darker,
    Normalise,
    ResetDisplay,
    NextCurve,
    LastCurve,
    Fit,
    ActualSize,
    ZoomIn,
    ZoomOut,
    Undo,
    Redo,
    ResetLights,
    Snapshot,
    Wipe,
    /// Compare with the snapshot of this number.
    Compare(usize),
    NextLight,
    LastLight,
    FirstLight,
    EndLight,
    /// Select the light in this row of the mixer.
    Light(usize),
    Switch,
    Solo,
    AllOn,
    AllOff,
    AllLights,
    Group,
    Ungroup,
    Other,
    Difference,
    Find,
    Panels,
    Larger,
    Smaller,
    FullScreen,
    Help,
}

/// A key with what it does; the help lists this table and the window obeys it.
pub(super) struct Binding {
    modifiers: Modifiers,
    key: Key,
    action: Action,
    /// As the help writes the key; empty where another row says it already.
    keys: &'static str,
    meaning: &'static str,
}

const fn bind(modifiers: Modifiers, key: Key, action: Action, keys: &'static str, meaning: &'static str) -> Binding {
    Binding { modifiers, key, action, keys, meaning }
}

const NONE: Modifiers = Modifiers::NONE;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL: Modifiers = Modifiers::COMMAND;
const ALT: Modifiers = Modifiers::ALT;

/// All keys but the numbers. Where two differ in their modifiers only, the one with more comes first.
pub(super) const BINDINGS: [Binding; 55] = [
    bind(CTRL, Key::O, Action::Open, "Ctrl+O", "Open a container"),
    bind(CTRL, Key::R, Action::Reload, "Ctrl+R or F5", "Reload it, with your mix"),
    bind(NONE, Key::F5, Action::Reload, "", ""),
    bind(CTRL, Key::S, Action::Png, "Ctrl+S", "Save the picture as PNG"),
    bind(CTRL, Key::E, Action::Exr, "Ctrl+E", "Save the radiance as EXR"),
    bind(CTRL.plus(SHIFT), Key::C, Action::CopyCommand, "Ctrl+Shift+C", "Copy the command that makes the picture"),
    bind(CTRL, Key::C, Action::CopyPicture, "Ctrl+C", "Copy the picture"),
    bind(CTRL, Key::L, Action::LoadLook, "Ctrl+L", "Load a look"),
    bind(CTRL, Key::K, Action::SaveLook, "Ctrl+K", "Save the look"),
    bind(CTRL, Key::Q, Action::Quit, "Ctrl+Q", "Quit"),
    bind(CTRL.plus(SHIFT), Key::Z, Action::Redo, "Ctrl+Shift+Z or Ctrl+Y", "Redo"),
    bind(CTRL, Key::Z, Action::Undo, "Ctrl+Z", "Undo; a drag is one step"),
    bind(CTRL, Key::Y, Action::Redo, "", ""),
    bind(SHIFT, Key::R, Action::ResetLights, "Shift+R", "Reset to the scene's own lighting"),
    bind(NONE, Key::ArrowDown, Action::NextLight, "Down or S / Up or W", "Select the next or previous light"),
    bind(NONE, Key::ArrowUp, Action::LastLight, "", ""),
    bind(NONE, Key::S, Action::NextLight, "", ""),
    bind(NONE, Key::W, Action::LastLight, "", ""),
    bind(NONE, Key::Home, Action::FirstLight, "Home / End", "Select the first or last light"),
    bind(NONE, Key::End, Action::EndLight, "", ""),
    bind(SHIFT, Key::X, Action::Solo, "Shift+X", "Selected lights solo"),
    bind(NONE, Key::X, Action::Switch, "X", "Selected lights on or off"),
    bind(CTRL, Key::A, Action::AllLights, "Ctrl+A", "Select all lights that are listed"),
    bind(CTRL.plus(SHIFT), Key::G, Action::Ungroup, "Ctrl+Shift+G", "Ungroup the selected lights"),
    bind(CTRL, Key::G, Action::Group, "Ctrl+G", "Make a group of the selected lights"),
    bind(CTRL, Key::P, Action::Find, "Ctrl+P or Ctrl+F", "Find a light"),
    bind(CTRL, Key::F, Action::Find, "", ""),
    bind(SHIFT, Key::E, Action::Darker, "", ""),
    bind(NONE, Key::E, Action::Brighter, "E / Shift+E", "Exposure up or down by 0.5"),
    bind(NONE, Key::N, Action::Normalise, "N", "Automatic exposure"),
    bind(NONE, Key::R, Action::ResetDisplay, "R", "Reset exposure, white and curve"),
    bind(SHIFT, Key::ArrowRight, Action::NextCurve, "Shift+Right / Shift+Left", "Next or previous tone curve"),
    bind(SHIFT, Key::ArrowLeft, Action::LastCurve, "", ""),
    bind(SHIFT, Key::D, Action::NextCurve, "", ""),
    bind(SHIFT, Key::A, Action::LastCurve, "", ""),
    bind(NONE, Key::V, Action::Other, "V", "See the compared picture whole, and back"),
    bind(NONE, Key::D, Action::Difference, "D", "See the difference to it, and back"),
    bind(NONE, Key::F, Action::Fit, "F or Ctrl+9", "Zoom to fit"),
    bind(CTRL, Key::Num9, Action::Fit, "", ""),
    bind(CTRL, Key::Num0, Action::ActualSize, "Ctrl+0", "Zoom to actual size"),
    bind(CTRL, Key::Plus, Action::Larger, "Ctrl++ / Ctrl+−", "Larger or smaller letters"),
    bind(CTRL, Key::Equals, Action::Larger, "", ""),
    bind(CTRL, Key::Minus, Action::Smaller, "", ""),
    bind(NONE, Key::Plus, Action::ZoomIn, "+ / − or scroll", "Zoom in or out"),
    bind(NONE, Key::Equals, Action::ZoomIn, "", ""),
    bind(NONE, Key::Minus, Action::ZoomOut, "", ""),
    bind(NONE, Key::K, Action::Snapshot, "K", "Keep a snapshot"),
    bind(NONE, Key::C, Action::Wipe, "C", "Compare with the newest snapshot or reference"),
    bind(CTRL, Key::B, Action::Panels, "Ctrl+B", "Show or hide the panels"),
    bind(ALT, Key::Enter, Action::FullScreen, "Alt+Enter or F11", "Full screen"),
    bind(NONE, Key::F11, Action::FullScreen, "", ""),
    bind(NONE, Key::Questionmark, Action::Help, "? or H or F1", "This list"),
    bind(NONE, Key::Slash, Action::Help, "", ""),
    bind(NONE, Key::H, Action::Help, "", ""),
    bind(NONE, Key::F1, Action::Help, "", ""),
];

/// What the numbers and the pointer do, for the help.
const OTHERS: [(&str, &str); 17] = [
    ("1 … 9", "Select the light in that row"),
    ("Shift+1 … 9", "Compare with that snapshot"),
    ("Alt, held", "See the compared picture whole"),
    ("Tab / Shift+Tab", "Go from control to control; Space presses"),
    ("Left / Right on a fader", "A quarter stop; with Shift a twentieth"),
    ("Drag the picture", "Pan"),
    ("Shift-drag the picture", "Select the lights in a rectangle; with Ctrl too, add them"),
    ("Drag a sun in the picture", "Move it over the sky"),
    ("Click the picture", "Select the light that matters most there"),
    ("Double-click the picture", "Zoom to fit"),
    ("Ctrl-click a light's switch", "Solo; with Shift add to the solo"),
    ("Ctrl- or Shift-click a row", "Select several lights; a drag over rows too"),
    ("Right-click a row", "Copy, paste, group, move"),
    ("Shift-drag a fader", "Ten times finer"),
    ("Double-click a fader", "Back to 0"),
    ("Scroll on a light's shape", "Larger or smaller"),
    ("Drop a file", "Open it, load it, lay it on a light or compare"),
];

/// The keys of an action, as menus show them.
pub(super) fn keys_of(action: Action) -> &'static str {
    let found = BINDINGS.iter().find(|binding| binding.action == action && !binding.keys.is_empty());
    found.map_or("", |binding| binding.keys.split(" or ").next().unwrap_or(""))
}

/// What was pressed in this frame, while no text is being typed.
pub(super) fn pressed(context: &egui::Context) -> Vec<Action> {
    if context.text_edit_focused() || egui::Popup::is_any_open(context) {
        return Vec::new();
    }
    let focused = context.memory(|memory| memory.focused().is_some());
    let moves = |key| matches!(key, Key::ArrowUp | Key::ArrowDown | Key::ArrowLeft | Key::ArrowRight | Key::Home);
    context.input_mut(|input| {
        let mut actions: Vec<Action> = input.events.iter().filter_map(special).collect();
        actions.extend(
            BINDINGS
                .iter()
                // A focused widget keeps the keys that move the focus or the widget.
                .filter(|binding| !(focused && moves(binding.key)))
                .flat_map(|binding| {
                    // A slow frame may have seen a key more than once.
                    let presses = input.count_and_consume_key(binding.modifiers, binding.key);
                    std::iter::repeat_n(binding.action, presses)
                }),
        );
        actions
    })
}

/// Copying, which arrives as an event of its own, and the numbers, which are other signs with Shift.
fn special(event: &Event) -> Option<Action> {
    const NUMBERS: [Key; 9] =
        [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];
    match event {
        Event::Copy => Some(Action::CopyPicture),
        Event::Key { key, physical_key, pressed: true, repeat: false, modifiers } if !modifiers.command => {
            let number = NUMBERS.iter().position(|number| *number == physical_key.unwrap_or(*key))?;
            Some(if modifiers.shift { Action::Compare(number) } else { Action::Light(number) })
        }
        _ => None,
    }
}

/// Does what concerns the document.
pub(super) fn act(context: &egui::Context, document: &mut Document, action: Action) {
    match action {
        Action::Png => document.files.wanted = Some(Purpose::Png),
        Action::Exr => document.files.wanted = Some(Purpose::Exr),
        Action::Layers => document.files.wanted = Some(Purpose::Layers),
        Action::LoadLook => document.files.wanted = Some(Purpose::LoadLook),
        Action::SaveLook => document.files.wanted = Some(Purpose::SaveLook),
        Action::Reference => document.files.wanted = Some(Purpose::Reference),
        Action::CopyPicture => {
            if let Some(image) = &document.shown.image {
                context.copy_image(colour_image(&document.view.display.show(image)));
                document.files.message = Some(("Copied the picture".into(), false));
            }
        }
        Action::CopyCommand => {
            let line = document.command_line();
            context.copy_text(line);
        }
        Action::Brighter => document.view.display.tone.exposure_stops += 0.5,
        Action::Darker => document.view.display.tone.exposure_stops -= 0.5,
        Action::Normalise => document.expose(),
        Action::ResetDisplay => document.reset_display(),
        Action::NextCurve => document.view.display = document.view.display.next(false),
        Action::LastCurve => document.view.display = document.view.display.next(true),
        Action::Fit => document.view.viewport.fit(),
        Action::ActualSize => document.view.viewport.one_to_one(context.pixels_per_point()),
        Action::ZoomIn => document.view.viewport.zoom_about([0.0; 2], 1.25),
        Action::ZoomOut => document.view.viewport.zoom_about([0.0; 2], 0.8),
        Action::Undo => document.work.undo(),
        Action::Redo => document.work.redo(),
        Action::ResetLights => document.work.reset(),
        Action::Snapshot => document.snapshot(),
        Action::Wipe => {
            let last = document.compare.snapshots.list().len().checked_sub(1);
            match document.compare.snapshots.compared().or(last) {
                Some(index) => document.compare.snapshots.toggle_compare(index),
                None => document.files.message = Some(("There is no snapshot yet: K keeps one".into(), false)),
            }
        }
        Action::Compare(index) if index < document.compare.snapshots.list().len() => {
            document.compare.snapshots.toggle_compare(index)
        }
        Action::NextLight | Action::LastLight | Action::FirstLight | Action::EndLight | Action::Light(_) => {
            select(document, action);
        }
        Action::Switch => {
            document.switch_chosen();
        }
        Action::Solo => {
            document.solo_chosen();
        }
        Action::AllOn => document.work.mix.switch_all(true),
        Action::AllOff => document.work.mix.switch_all(false),
        Action::AllLights => {
            let rows = document.rows();
            let first = document.list.selected();
            let others = lights_of(&rows).filter(|light| Some(*light) != first);
            document.list.select_all(first.into_iter().chain(others));
        }
        Action::Group => document.group_chosen(),
        Action::Ungroup => document.ungroup_chosen(),
        Action::Other | Action::Difference => {
            let meant = if action == Action::Other { Beside::Other } else { Beside::Difference };
            let now = document.view.beside;
            document.view.beside = if now == meant { Beside::Wipe } else { meant };
            if document.compare.snapshots.compared().is_none() {
                act(context, document, Action::Wipe);
            }
        }
        Action::Find => context.memory_mut(|memory| memory.request_focus(search_id())),
        // The window's own.
        Action::Open
        | Action::Reload
        | Action::Quit
        | Action::Panels
        | Action::Larger
        | Action::Smaller
        | Action::FullScreen
        | Action::Help
        | Action::Compare(_) => {}
    }
}

/// Selects a light by its place among the rows of the mixer, as they are shown.
fn select(document: &mut Document, action: Action) {
    let rows = document.rows();
    let lights: Vec<usize> = lights_of(&rows).collect();
    let count = lights.len();
    let now = lights.iter().position(|light| Some(*light) == document.list.selected());
    let index = match action {
        Action::NextLight => now.map_or(0, |at| (at + 1) % count),
        Action::LastLight => now.map_or(0, |at| (at + count - 1) % count),
        Action::EndLight => count.saturating_sub(1),
        Action::Light(index) => index,
        _ => 0,
    };
    if let Some(&light) = lights.get(index) {
        document.list.select(light);
        document.list.scroll_to_selected = true;
    }
}

/// The list of keys.
pub(super) fn help(context: &egui::Context, open: &mut bool) {
    let room = context.content_rect().size();
    let window = egui::Window::new("Keys").collapsible(false).resizable(false);
    window.anchor(egui::Align2::CENTER_CENTER, [0.0, 0.0]).open(open).show(context, |ui| {
        let listed = BINDINGS.iter().filter(|binding| !binding.keys.is_empty());
        let rows: Vec<_> = listed.map(|b| (b.keys, b.meaning)).chain(OTHERS).collect();
        let columns = if room.x >= 960.0 { 2 } else { 1 };
        // All that the window has room for; the bar floats, and must not do so over words.
        let height = room.y - 150.0;
        let beside_bar = egui::Frame::new().inner_margin(egui::Margin { right: 12, ..Default::default() });
        // A bar that is seen: that there is more must not be found out by chance.
        ui.spacing_mut().scroll = egui::style::ScrollStyle::solid();
        egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height).show(ui, |ui| {
            beside_bar.show(ui, |ui| {
                let down = rows.len().div_ceil(columns);
                egui::Grid::new("keys").num_columns(2 * columns).spacing([24.0, 5.0]).show(ui, |ui| {
                    for index in 0..down {
                        for (keys, meaning) in (0..columns).filter_map(|column| rows.get(column * down + index)) {
                            ui.label(RichText::new(*keys).color(ACCENT));
                            ui.label(*meaning);
                        }
                        ui.end_row();
                    }
                });
            });
        });
        ui.add_space(6.0);
        ui.label(RichText::new("Esc closes this list.").size(11.0).color(WEAK));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_means_two_things_and_the_narrower_one_comes_first() {
        for (i, a) in BINDINGS.iter().enumerate() {
            for b in &BINDINGS[i + 1..] {
                assert!(a.key != b.key || a.modifiers != b.modifiers, "{:?} and {:?}", a.action, b.action);
                // A binding lets Shift pass where it is not asked for.
                assert!(
                    a.key != b.key || !b.modifiers.shift || a.modifiers.command,
                    "{:?} hides {:?}",
                    a.action,
                    b.action
                );
            }
        }
    }
}
