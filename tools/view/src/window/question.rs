//! Questions that are asked before work would be lost.

use std::path::PathBuf;
use std::time::SystemTime;

use eframe::egui::{self, Key, RichText, Ui};

use super::theme::{TEXT, WEAK};
use crate::unsaved::LeftBehind;

/// What is to be done, and would take the place of unsaved work.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Next {
    Close,
    Open(Vec<PathBuf>),
    LoadLook(PathBuf),
}

/// The question to the user.
pub(super) enum Question {
    /// Whether to save the work first.
    Unsaved(Next),
    /// Whether to keep what is rendered of a scene before this.
    Unfinished(Next),
    /// Whether to go on with work that an earlier window left behind.
    LeftBehind(LeftBehind),
}

/// The answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// Save, or recover.
    Yes,
    /// Discard.
    No,
    /// Neither now.
    Cancel,
}

impl Question {
    /// Shows the question until there is a reply. Enter keeps the work, Esc leaves everything as it is.
    pub(super) fn show(&self, context: &egui::Context) -> Option<Reply> {
        let (title, about, yes, no, cancel) = match self {
            Self::Unsaved(next) => {
                let before = match next {
                    Next::Close => "closing",
                    Next::Open(_) => "opening another container",
                    Next::LoadLook(_) => "loading another look",
                };
                let title = format!("Save your mix before {before}?");
                (title, "What is not saved would be lost.".to_owned(), "Save", "Discard", "Cancel")
            }
            Self::Unfinished(_) => {
                let about = "The render is not finished. What is kept is shown and gone on with when the scene is opened again.";
                ("Keep what is rendered?".to_owned(), about.to_owned(), "Keep", "Discard", "Cancel")
            }
            Self::LeftBehind(left) => {
                let about = format!("A window on this container ended {} before its mix was saved.", ago(left.written));
                ("Recover unsaved work?".to_owned(), about, "Recover", "Discard", "Later")
            }
        };
        let mut reply = None;
        let modal = egui::Modal::new(egui::Id::unique("question")).show(context, |ui| {
            ui.set_width(360.0);
            ui.label(RichText::new(title).size(15.0).strong().color(TEXT));
            ui.label(RichText::new(about).color(WEAK));
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                let button = |ui: &mut Ui, name: &str, own: Reply, reply: &mut Option<Reply>| {
                    if ui.add(egui::Button::new(name).min_size(egui::vec2(84.0, 26.0))).clicked() {
                        *reply = Some(own);
                    }
                };
                button(ui, yes, Reply::Yes, &mut reply);
                button(ui, no, Reply::No, &mut reply);
                button(ui, cancel, Reply::Cancel, &mut reply);
            });
        });
        let nothing_focused = context.memory(|memory| memory.focused().is_none());
        if nothing_focused && context.input(|input| input.key_pressed(Key::Enter)) {
            reply = Some(Reply::Yes);
        }
        if modal.should_close() && reply.is_none() {
            reply = Some(Reply::Cancel);
        }
        reply
    }
}

/// Text for how long ago something was.
pub(super) fn ago(then: SystemTime) -> String {
    let minutes = then.elapsed().map_or(0, |elapsed| elapsed.as_secs() / 60);
    match minutes {
        0 => "a moment ago".to_owned(),
        1..60 => format!("{minutes} min ago"),
        60..2880 => format!("{} h ago", minutes / 60),
        _ => format!("{} days ago", minutes / 1440),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn times_are_said_in_the_unit_that_fits() {
        let before = |secs| ago(SystemTime::now() - Duration::from_secs(secs));
        assert_eq!(before(0), "a moment ago");
        assert_eq!(before(61), "1 min ago");
        assert_eq!(before(7300), "2 h ago");
        assert_eq!(before(200_000), "2 days ago");
        assert_eq!(ago(SystemTime::now() + Duration::from_secs(99)), "a moment ago");
    }
}
