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
    answer: Receiver<Option<Vec<PathBuf>>>,
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
            let chosen = match (purpose.saves(), purpose.takes_several()) {
                (true, _) => dialog.save_file().map(|path| vec![path]),
                (false, true) => dialog.pick_files(),
                (false, false) => dialog.pick_file().map(|path| vec![path]),
            };
            // A window that has closed meanwhile wants no answer.
            let _ = sender.send(chosen);
            context.request_repaint();
        });
        Self { purpose, asked: Instant::now(), answer }
    }

    /// The answer, once there is one.
    pub(super) fn outcome(&self) -> Option<Outcome> {
        match self.answer.try_recv() {
            Ok(Some(paths)) => {
                let ended = |path: PathBuf| match self.purpose.saves() {
                    true => with_one_of(&path, self.purpose.endings()),
                    false => path,
                };
                Some(Outcome::Answered(Answer::Chosen(paths.into_iter().map(ended).collect())))
            }
            Ok(None) if self.asked.elapsed() < NO_ONE_IS_SO_QUICK => Some(Outcome::Failed),
            Ok(None) => Some(Outcome::Answered(Answer::Cancelled)),
            Err(TryRecvError::Disconnected) => Some(Outcome::Failed),
            Err(TryRecvError::Empty) => None,
        }
    }
}
