//! Keys, as tev has them where it has them, and the window that lists them.

use eframe::egui::{self, Key, Modifiers, RichText};

use super::document::Document;
use super::export::save_png;
use super::mixer_panel::search_id;
use super::theme::{ACCENT, WEAK};

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Brighter,
    Darker,
    Normalise,
    Reset,
    Fit,
    ActualSize,
    ZoomIn,
    ZoomOut,
    Undo,
    Redo,
    Snapshot,
    Wipe,
    FalseColour,
    Find,
    SavePng,
    Panels,
    NextLight,
    LastLight,
    Switch,
    Solo,
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

/// All keys. Where two differ in their modifiers only, the one with more comes first.
pub(super) const BINDINGS: [Binding; 26] = [
    bind(SHIFT, Key::E, Action::Darker, "", ""),
    bind(NONE, Key::E, Action::Brighter, "E / Shift+E", "Exposure up or down by 0.5"),
    bind(NONE, Key::N, Action::Normalise, "N", "Expose for the picture"),
    bind(NONE, Key::R, Action::Reset, "R", "Reset to the scene's own lighting"),
    bind(NONE, Key::F, Action::Fit, "F or Ctrl+9", "Zoom to fit"),
    bind(CTRL, Key::Num9, Action::Fit, "", ""),
    bind(CTRL, Key::Num0, Action::ActualSize, "Ctrl+0", "Zoom to actual size"),
    bind(NONE, Key::Plus, Action::ZoomIn, "+ / − or scroll", "Zoom in or out"),
    bind(NONE, Key::Equals, Action::ZoomIn, "", ""),
    bind(NONE, Key::Minus, Action::ZoomOut, "", ""),
    bind(NONE, Key::L, Action::FalseColour, "L", "False colour"),
    bind(CTRL.plus(SHIFT), Key::Z, Action::Redo, "Ctrl+Shift+Z or Ctrl+Y", "Redo"),
    bind(CTRL, Key::Z, Action::Undo, "Ctrl+Z", "Undo; a drag is one step"),
    bind(CTRL, Key::Y, Action::Redo, "", ""),
    bind(CTRL, Key::S, Action::SavePng, "Ctrl+S", "Save the picture as PNG"),
    bind(NONE, Key::S, Action::Snapshot, "S", "Take a snapshot"),
    bind(NONE, Key::W, Action::Wipe, "W", "Compare with the last snapshot or reference"),
    bind(NONE, Key::ArrowDown, Action::NextLight, "Up / Down", "Select another light"),
    bind(NONE, Key::ArrowUp, Action::LastLight, "", ""),
    bind(NONE, Key::X, Action::Switch, "X", "Selected light on or off"),
    bind(NONE, Key::O, Action::Solo, "O", "Selected light solo"),
    bind(CTRL, Key::F, Action::Find, "Ctrl+F", "Find a light"),
    bind(CTRL, Key::B, Action::Panels, "Ctrl+B or Tab", "Show or hide the panels"),
    bind(NONE, Key::Tab, Action::Panels, "", ""),
    bind(NONE, Key::Questionmark, Action::Help, "? or F1", "This list"),
    bind(NONE, Key::F1, Action::Help, "", ""),
];

/// What the pointer does, for the help.
const POINTER: [(&str, &str); 8] = [
    ("Drag the picture", "Pan"),
    ("Click the picture", "Select the light that matters most there"),
    ("Double-click the picture", "Zoom to fit"),
    ("Alt-click a light", "Solo; with Shift add to the solo"),
    ("Shift-drag a fader", "Ten times finer"),
    ("Double-click a fader", "Back to 0"),
    ("Left / Right on a fader", "A quarter stop; with Shift a twentieth"),
    ("Drop a file", "Open a container, lay an image on a light, add a reference"),
];

/// What was pressed in this frame, while no text is being typed.
pub(super) fn pressed(context: &egui::Context) -> Vec<Action> {
    if context.text_edit_focused() {
        return Vec::new();
    }
    let focused = context.memory(|memory| memory.focused().is_some());
    let arrow = |key| matches!(key, Key::ArrowUp | Key::ArrowDown | Key::Tab);
    context.input_mut(|input| {
        BINDINGS
            .iter()
            // A focused widget keeps the keys that move the focus.
            .filter(|binding| !(focused && arrow(binding.key)))
            .filter(|binding| input.consume_key(binding.modifiers, binding.key))
            .map(|binding| binding.action)
            .collect()
    })
}

/// Does what concerns the document.
pub(super) fn act(context: &egui::Context, document: &mut Document, action: Action) {
    match action {
        Action::Brighter => document.display.exposure_stops += 0.5,
        Action::Darker => document.display.exposure_stops -= 0.5,
        Action::Normalise => document.expose(),
        Action::Reset => document.reset(),
        Action::Fit => document.viewport.fit(),
        Action::ActualSize => document.viewport.one_to_one(context.pixels_per_point()),
        Action::ZoomIn => document.viewport.zoom_about([0.0; 2], 1.25),
        Action::ZoomOut => document.viewport.zoom_about([0.0; 2], 0.8),
        Action::Undo => document.undo(),
        Action::Redo => document.redo(),
        Action::Snapshot => document.snapshot(),
        Action::Wipe => {
            let last = document.snapshots.list().len().checked_sub(1);
            if let Some(index) = document.snapshots.compared().or(last) {
                document.snapshots.toggle_compare(index);
            }
        }
        Action::FalseColour => document.display.false_colour = !document.display.false_colour,
        Action::Find => context.memory_mut(|memory| memory.request_focus(search_id())),
        Action::SavePng => save_png(document),
        Action::NextLight | Action::LastLight => {
            let count = document.mix.lights.len();
            let step = if action == Action::NextLight { 1 } else { count.saturating_sub(1) };
            if count > 0 {
                document.selected = Some(document.selected.map_or(0, |light| (light + step) % count));
                document.scroll_to_selected = true;
            }
        }
        Action::Switch => {
            if let Some(light) = document.selected {
                document.mix.lights[light].on = !document.mix.lights[light].on;
            }
        }
        Action::Solo => {
            if let Some(light) = document.selected {
                document.mix.toggle_solo(light, false);
            }
        }
        Action::Panels | Action::Help => {}
    }
}

/// The list of keys.
pub(super) fn help(context: &egui::Context, open: &mut bool) {
    let window = egui::Window::new("Keys").collapsible(false).resizable(false);
    window.anchor(egui::Align2::CENTER_CENTER, [0.0, 0.0]).open(open).show(context, |ui| {
        egui::Grid::new("keys").num_columns(2).spacing([28.0, 5.0]).show(ui, |ui| {
            let listed = BINDINGS.iter().filter(|binding| !binding.keys.is_empty());
            for (keys, meaning) in listed.map(|b| (b.keys, b.meaning)).chain(POINTER) {
                ui.label(RichText::new(keys).color(ACCENT));
                ui.label(meaning);
                ui.end_row();
            }
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
                // `consume_key` lets Shift pass where it is not asked for.
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
