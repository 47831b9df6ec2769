//! What keys, menus and buttons ask for, and what of it is done to the document.

use eframe::egui;

use super::chooser::Purpose;
use super::command_line::command_line;
use super::document::Document;
use super::light_list::{lights_of, search_id};
use super::message::Message;
use super::selection;
use super::shown_picture::colour_image;
use super::view_state::{Beside, STEP};

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Open,
    /// Open containers beside the view in front.
    AddView,
    /// Show the tab of this number.
    Tab(usize),
    NextTab,
    LastTab,
    /// Close the tab in front.
    CloseTab,
    /// Show the frame at this place of the animation.
    Frame(usize),
    NextFrame,
    LastFrame,
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
    /// Look around in a panorama, or see it flat.
    LookAround,
    TurnLeft,
    TurnRight,
    TurnUp,
    TurnDown,
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
            if let Some(image) = &document.front.shown.image {
                context.copy_image(colour_image(&document.display.show(image)));
                document.message = Some(Message::info("Copied the picture"));
            }
        }
        Action::CopyCommand => {
            let line = command_line(document);
            context.copy_text(line);
        }
        Action::Brighter => document.display.tone.exposure_stops += 0.5,
        Action::Darker => document.display.tone.exposure_stops -= 0.5,
        Action::Normalise => document.expose(),
        Action::ResetDisplay => document.reset_display(),
        Action::NextCurve => document.display = document.display.next(false),
        Action::LastCurve => document.display = document.display.next(true),
        Action::Fit
        | Action::ActualSize
        | Action::ZoomIn
        | Action::ZoomOut
        | Action::LookAround
        | Action::TurnLeft
        | Action::TurnRight
        | Action::TurnUp
        | Action::TurnDown => see(context, document, action),
        // The frames of an animation that are open are no tabs.
        Action::Tab(_) | Action::NextTab | Action::LastTab | Action::CloseTab if document.frames.is_some() => {}
        Action::Tab(tab) => document.show_tab(tab),
        Action::NextTab => document.step_tab(false),
        Action::LastTab => document.step_tab(true),
        Action::CloseTab => document.close_tab(document.at),
        Action::Frame(_) | Action::NextFrame | Action::LastFrame => {
            let shown = match action {
                Action::Frame(at) => document.show_frame(context, at),
                _ => document.step_frame(context, action == Action::LastFrame),
            };
            if let Err(error) = shown {
                document.message = Some(Message::error(&error));
            }
        }
        Action::Undo => document.work.undo(),
        Action::Redo => document.work.redo(),
        Action::ResetLights => document.work.reset(),
        Action::Snapshot => document.snapshot(),
        Action::Wipe => {
            let last = document.front.compare.snapshots.list().len().checked_sub(1);
            match document.front.compare.snapshots.compared().or(last) {
                Some(index) => document.front.compare.snapshots.toggle_compare(index),
                None => document.message = Some(Message::info("There is no snapshot yet: K keeps one")),
            }
        }
        Action::Compare(index) if index < document.front.compare.snapshots.list().len() => {
            document.front.compare.snapshots.toggle_compare(index)
        }
        Action::NextLight | Action::LastLight | Action::FirstLight | Action::EndLight | Action::Light(_) => {
            select(document, action);
        }
        Action::Switch => selection::switch(&document.list, &mut document.work.mix),
        Action::Solo => selection::solo(&document.list, &mut document.work.mix),
        Action::AllOn => document.work.mix.switch_all(true),
        Action::AllOff => document.work.mix.switch_all(false),
        Action::AllLights => {
            let rows = document.rows();
            let first = document.list.selected();
            let others = lights_of(&rows).filter(|light| Some(*light) != first);
            document.list.select_all(first.into_iter().chain(others));
        }
        Action::Group => selection::group(&mut document.list, &mut document.work.mix),
        Action::Ungroup => selection::ungroup(&mut document.list, &mut document.work.mix),
        Action::Other | Action::Difference => {
            let meant = if action == Action::Other { Beside::Other } else { Beside::Difference };
            let now = document.front.view.beside;
            document.front.view.beside = if now == meant { Beside::Wipe } else { meant };
            if document.front.compare.snapshots.compared().is_none() {
                act(context, document, Action::Wipe);
            }
        }
        Action::Find => context.memory_mut(|memory| memory.request_focus(search_id())),
        // The window's own.
        Action::Open
        | Action::AddView
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

/// Shows another part of the picture, or shows it otherwise.
fn see(context: &egui::Context, document: &mut Document, action: Action) {
    let [width, _] = document.size();
    let view = &mut document.front.view;
    match action {
        Action::Fit => view.fit(),
        Action::ActualSize => view.one_to_one(width, context.pixels_per_point()),
        Action::ZoomIn => view.zoom_about([0.0; 2], 1.25),
        Action::ZoomOut => view.zoom_about([0.0; 2], 0.8),
        Action::LookAround => view.is_around = view.look.is_some() && !view.is_around,
        Action::TurnLeft => view.turn([-STEP, 0.0]),
        Action::TurnRight => view.turn([STEP, 0.0]),
        Action::TurnUp => view.turn([0.0, STEP]),
        Action::TurnDown => view.turn([0.0, -STEP]),
        _ => {}
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
