//! The desktop's own dialogue for files, where there is a desktop.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use eframe::egui;

use super::chooser::{Answer, Purpose};
use crate::export::with_one_of;

/// No one has looked at a dialogue and cancelled it so soon: there was none.
const NO_ONE_IS_SO_QUICK: Duration = Duration::from_millis(400);

/// A dialogue that is open beside the window.
pub(super) struct NativeDialog {
    pub(super) purpose: Purpose,
    asked: Instant,
    answer: Receiver<Option<PathBuf>>,
}

/// Result of the dialogue.
pub(super) enum Outcome {
    Answered(Answer),
    /// There is none: the window's own list is to be shown.
    Failed,
}

impl NativeDialog {
    /// Asks the desktop for a file near `near`, whose name is proposed where one is saved.
    pub(super) fn open(context: &egui::Context, purpose: Purpose, near: &Path) -> Self {
        let near = std::path::absolute(near).unwrap_or_else(|_| near.to_owned());
        let folder = if near.is_dir() { near.as_path() } else { near.parent().unwrap_or(Path::new("/")) };
        let mut dialog = rfd::FileDialog::new().set_title(purpose.title()).set_directory(folder);
        dialog = dialog.add_filter(purpose.endings().join(", "), purpose.endings());
        if let (true, Some(name)) = (purpose.saves(), near.file_name()) {
            let name = with_one_of(Path::new(name), purpose.endings());
            dialog = dialog.set_file_name(name.display().to_string());
        }
        let (sender, answer) = channel();
        let context = context.clone();
        std::thread::spawn(move || {
            let chosen = if purpose.saves() { dialog.save_file() } else { dialog.pick_file() };
            // A window that has closed meanwhile wants no answer.
            let _ = sender.send(chosen);
            context.request_repaint();
        });
        Self { purpose, asked: Instant::now(), answer }
    }

    /// The answer, once there is one.
    pub(super) fn outcome(&self) -> Option<Outcome> {
        match self.answer.try_recv() {
            Ok(Some(path)) if self.purpose.saves() => {
                Some(Outcome::Answered(Answer::Chosen(with_one_of(&path, self.purpose.endings()))))
            }
            Ok(Some(path)) => Some(Outcome::Answered(Answer::Chosen(path))),
            Ok(None) if self.asked.elapsed() < NO_ONE_IS_SO_QUICK => Some(Outcome::Failed),
            Ok(None) => Some(Outcome::Answered(Answer::Cancelled)),
            Err(TryRecvError::Disconnected) => Some(Outcome::Failed),
            Err(TryRecvError::Empty) => None,
        }
    }
}
