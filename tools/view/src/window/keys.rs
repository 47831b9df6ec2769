//! Keys, as tev has them where it has them, and the window that lists them.

use eframe::egui::{self, Event, Key, Modifiers, RichText};

use super::actions::Action;
use super::theme::{ACCENT, WEAK};

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
pub(super) const BINDINGS: [Binding; 68] = [
    bind(CTRL.plus(SHIFT), Key::O, Action::AddView, "Ctrl+Shift+O", "Open containers beside this view, as tabs"),
    bind(CTRL, Key::O, Action::Open, "Ctrl+O", "Open a container, or several as tabs"),
    bind(CTRL.plus(SHIFT), Key::Tab, Action::LastTab, "", ""),
    bind(CTRL, Key::Tab, Action::NextTab, "Ctrl+Tab / Ctrl+Shift+Tab", "Next or previous tab"),
    bind(CTRL, Key::PageUp, Action::LastTab, "", ""),
    bind(CTRL, Key::PageDown, Action::NextTab, "", ""),
    bind(NONE, Key::PageUp, Action::LastFrame, "", ""),
    bind(NONE, Key::PageDown, Action::NextFrame, "Page down / Page up", "Next or previous frame of an animation"),
    bind(CTRL, Key::W, Action::CloseTab, "Ctrl+W", "Close the tab"),
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
    bind(CTRL, Key::ArrowLeft, Action::TurnLeft, "Ctrl+arrows", "Turn in a panorama"),
    bind(CTRL, Key::ArrowRight, Action::TurnRight, "", ""),
    bind(CTRL, Key::ArrowUp, Action::TurnUp, "", ""),
    bind(CTRL, Key::ArrowDown, Action::TurnDown, "", ""),
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
    bind(NONE, Key::P, Action::LookAround, "P", "Look around in a panorama, or see it flat"),
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
const OTHERS: [(&str, &str); 18] = [
    ("Ctrl+1 … 8", "Show that tab"),
    ("1 … 9", "Select the light in that row"),
    ("Shift+1 … 9", "Compare with that snapshot"),
    ("Alt, held", "See the compared picture whole"),
    ("Tab / Shift+Tab", "Go from control to control; Space presses"),
    ("Left / Right on a fader", "A quarter stop; with Shift a twentieth"),
    ("Drag the picture", "Pan; in a panorama turn"),
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
        Event::Key { key, physical_key, pressed: true, repeat: false, modifiers } => {
            let number = NUMBERS.iter().position(|number| *number == physical_key.unwrap_or(*key))?;
            match (modifiers.command, modifiers.shift) {
                // Ctrl+9 fits the picture.
                (true, false) => Some(Action::Tab(number)).filter(|_| number < 8),
                (true, true) => None,
                (false, true) => Some(Action::Compare(number)),
                (false, false) => Some(Action::Light(number)),
            }
        }
        _ => None,
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
