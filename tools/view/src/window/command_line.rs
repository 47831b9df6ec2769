//! The command line that makes the picture, with the look that it needs.

use std::path::{Path, PathBuf};

use super::document::Document;
use super::file_jobs::{CommandLook, name_of};
use super::message::Message;
use crate::export::{self, with_ending};
use crate::looks::{self, Saved};
use crate::worker::Brought;

/// The command that makes this picture. The lighting is written for it, into a new file of its own, unless it stands in
/// one already.
pub(super) fn command_line(document: &mut Document) -> String {
    let own =
        document.front.files.command_look.as_ref().filter(|own| own.mix == document.work.mix && own.path.is_file());
    // A file of all lights may name some that this view lacks.
    let saved = document.work.saved_in().filter(|_| document.front.lights.are_all(&document.lights));
    let saved = saved.or(own.map(|own| own.path.as_path())).map(Path::to_owned);
    let look = saved.clone().unwrap_or_else(|| free_look(&document.front.files.export_base));
    let png = with_ending(&document.front.files.export_base, "png");
    let line = export::command_line(
        &document.front.session.path,
        &look,
        &png,
        &document.display,
        document.lumens_per_watt().ok(),
    );
    if saved.is_some() {
        document.message = Some(Message::info(format!("Copied: {line}")));
        return line;
    }
    let message = format!("Wrote {} and copied: {line}", name_of(&look));
    document.front.files.command_look = Some(CommandLook { path: look.clone(), mix: document.work.mix.clone() });
    let mix = document.front.lights.mix(&document.work.mix).into_owned();
    let (container, saved) = (document.front.session.container.clone(), Saved::of(mix));
    document.start_job(move || {
        looks::save(&look, &container.job().basis, &saved, false)?;
        Ok(Brought::Message(message))
    });
    line
}

/// A name for a lighting file that none has yet, nor patterns of one.
fn free_look(base: &Path) -> PathBuf {
    let folder = base.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .collect();
    let stem = base.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let free = |stem: &String| {
        let toml = format!("{stem}.toml");
        let dashed = format!("{stem}-");
        !names.iter().any(|name| *name == toml || name.starts_with(&dashed))
    };
    let mut stems = (1..).map(|number| format!("{stem}-command{number}"));
    base.with_file_name(format!("{}.toml", stems.find(free).unwrap_or(stem)))
}
