//! The bar of a scene that is being rendered: how far it is, what can be done about it, and its views.

use eframe::egui::{self, ProgressBar, RichText, Slider, Ui};

use super::document::Document;
use super::message::Message;
use super::rendering::{Rendering, ShownEstimate};
use super::theme::{ACCENT, ALARM, TEXT, WEAK};
use crate::camera_moves::{CameraMove, FOV_RANGE};
use ltm::scene::NamedCamera;

/// What is asked for in the bar beside what it does itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RenderChoice {
    /// Saves what stands under a name.
    SaveCopy,
    /// Begins again after an error, a stop, or a change of the scene.
    GoOn,
}

pub(super) fn render_bar(
    ui: &mut Ui,
    rendering: &mut Rendering,
    document: Option<&mut Document>,
) -> Option<RenderChoice> {
    let mut choice = None;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 10.0;
        buttons(ui, rendering, document.is_some(), &mut choice);
        if let Some(said) = cameras(ui, rendering, document.as_deref()) {
            if let Some(document) = document {
                document.message = Some(said.map_or_else(Message::problem, Message::info));
            } else if let Err(problem) = said {
                rendering.failed = Some(problem);
            }
        }
        if let Some((share, step)) = share(rendering) {
            let bar = ProgressBar::new(share).desired_width(120.0).desired_height(6.0);
            ui.add(bar).on_hover_text(step);
            // The time goes on although nothing else happens.
            ui.ctx().request_repaint_after_secs(0.25);
        }
        match &rendering.failed {
            Some(failed) => {
                let text = RichText::new(failed).size(12.0).color(ALARM);
                ui.add(egui::Label::new(text).truncate()).on_hover_text(failed);
            }
            None => {
                let (text, is_early) = state_in_words(rendering);
                let text = RichText::new(text).size(12.0).color(if is_early { ACCENT } else { TEXT });
                ui.add(egui::Label::new(text).truncate());
            }
        }
    });
    choice
}

fn buttons(ui: &mut Ui, rendering: &mut Rendering, has_picture: bool, choice: &mut Option<RenderChoice>) {
    if rendering.is_unfinished() && rendering.failed.is_none() {
        let is_paused = rendering.job.as_ref().is_some_and(|job| job.is_paused());
        let (name, about) = match is_paused {
            true => ("Go on", "Renders on from where it was paused"),
            false => ("Pause", "Holds the rendering; mixing goes on"),
        };
        if ui.button(name).on_hover_text(about).clicked()
            && let Some(job) = &rendering.job
        {
            job.pause(!is_paused);
        }
        let about = "Ends the rendering with what stands; it is gone on with when the scene is opened again";
        if ui.button("Stop here").on_hover_text(about).clicked() {
            rendering.end(false);
        }
    } else if !rendering.is_final() && ui.button("Go on").on_hover_text("Renders on").clicked() {
        *choice = Some(RenderChoice::GoOn);
    }
    if rendering.has_changed() {
        let about = "Renders the scene as it is on the disk now, in place of what was rendered of it before";
        let button = egui::Button::new(RichText::new("Scene changed: render anew").color(ACCENT));
        if ui.add(button).on_hover_text(about).clicked() {
            *choice = Some(RenderChoice::GoOn);
        }
    }
    let about = "A container of what is shown now, under a name of your own";
    if ui.add_enabled(has_picture, egui::Button::new("Save as…")).on_hover_text(about).clicked() {
        *choice = Some(RenderChoice::SaveCopy);
    }
}

/// The menu of views; what to say about what was done.
fn cameras(ui: &mut Ui, rendering: &mut Rendering, document: Option<&Document>) -> Option<Result<String, String>> {
    let mut said = None;
    let is_known = rendering.view.is_some() && rendering.job.is_some();
    ui.add_enabled_ui(is_known, |ui| {
        ui.menu_button("Camera", |ui| {
            ui.set_min_width(250.0);
            for NamedCamera { name, camera, .. } in rendering.cameras.clone() {
                let is_shown = rendering.view.as_ref().is_some_and(|view| view.camera == camera);
                if ui.selectable_label(is_shown, name).clicked() {
                    rendering.look_through(camera);
                }
            }
            if let Some(own) = rendering.own {
                let is_shown = rendering.view.as_ref().is_some_and(|view| view.camera == own);
                let is_listed = rendering.cameras.iter().any(|named| named.camera == own);
                if !is_listed && ui.selectable_label(is_shown, "The scene's").clicked() {
                    rendering.look_through(own);
                }
            }
            ui.separator();
            let fov = rendering.view.as_ref().and_then(|view| view.camera.vertical_fov_radians());
            if let Some(fov) = fov {
                let mut degrees = fov.to_degrees();
                let range = FOV_RANGE.0.to_degrees()..=FOV_RANGE.1.to_degrees();
                let slider = Slider::new(&mut degrees, range).suffix("°").max_decimals(1).text("field of view");
                if ui.add(slider).changed() {
                    let step = CameraMove::FieldOfView(degrees.to_radians());
                    rendering.take_moves(ui.ctx(), vec![step]);
                }
            }
            if ui.add_enabled(document.is_some(), egui::Button::new("Frame the selected lamp")).clicked()
                && let Some(document) = document
            {
                said = rendering.frame(document).err().map(Err);
            }
            if ui.add_enabled(rendering.can_undo(), egui::Button::new("Undo the move")).clicked() {
                rendering.undo_move();
            }
            ui.separator();
            if ui.button("Save the view").on_hover_text("Into the scene file, or one beside the scene").clicked() {
                said = Some(rendering.save_view(ui.ctx()));
            }
            let undo = egui::Button::new("Undo the save");
            if ui.add_enabled(rendering.can_restore(), undo).clicked() {
                said = Some(rendering.restore_view(ui.ctx()));
            }
            ui.separator();
            let help = "Right-drag the picture: orbit; with Shift: pan; with Ctrl: nearer or farther";
            ui.label(RichText::new(help).size(11.0).color(WEAK));
        });
    });
    said
}

/// How far the step of the last estimate is, with its name.
fn share(rendering: &Rendering) -> Option<(f32, String)> {
    if !rendering.is_unfinished() || rendering.failed.is_some() {
        return None;
    }
    let progress = rendering.job.as_ref()?.progress();
    let (done, of) = progress.done;
    let share = if of > 0 { done as f32 / of as f32 } else { 0.0 };
    Some((share, progress.step))
}

/// What is shown, and whether it is not the last word.
fn state_in_words(rendering: &Rendering) -> (String, bool) {
    let Some(shown) = &rendering.shown else {
        let step = rendering.job.as_ref().map(|job| job.progress().step).filter(|step| !step.is_empty());
        return (
            format!("Outline only: {}", step.unwrap_or_else(|| "the first picture is being rendered".into())),
            true,
        );
    };
    if rendering.outline_id().is_some() {
        return ("Outline of the new view".into(), true);
    }
    let ShownEstimate { stage, error, is_final, clock, .. } = shown;
    let error =
        error.map_or_else(|| "error not known".to_owned(), |error| format!("stated error {:.1} %", 100.0 * error));
    if *is_final {
        return (format!("Finished: {stage}, {error}"), false);
    }
    let (now, expected) = clock.now();
    let time = match &rendering.job {
        Some(job) if job.is_paused() => "paused".to_owned(),
        Some(_) => match expected {
            Some(expected) => format!("{} of about {}", in_words(now), in_words(expected)),
            None => in_words(now),
        },
        None => "stopped".to_owned(),
    };
    (format!("Early picture: {stage}, {error}, {time}"), true)
}

/// A time for people.
fn in_words(seconds: f64) -> String {
    match seconds.round() as u64 {
        seconds @ 0..100 => format!("{seconds} s"),
        seconds @ 100..6000 => format!("{} min {} s", seconds / 60, seconds % 60),
        seconds => format!("{} h {} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_said_in_the_unit_that_fits() {
        assert_eq!([0.4, 99.2, 150.0, 7260.0].map(in_words), ["0 s", "99 s", "2 min 30 s", "2 h 1 min"]);
    }
}
