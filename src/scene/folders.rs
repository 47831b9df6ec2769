//! Where the files that a scene names are looked for.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::{FileAccess, LIBRARY_VARIABLE, library_folder};

/// Folders in which relative paths of a scene file are looked up, in this order, and the files that may be opened at all.
#[derive(Clone, Debug)]
pub(super) struct Folders {
    beside: PathBuf,
    library: Option<PathBuf>,
    /// That of the scene file, whoever names a file further on.
    pub(super) reach: FileAccess,
}

impl Folders {
    /// The scene file's own folder, then the one that `LTM_SCENES` names. Files elsewhere may be opened only with
    /// `allow_outside`.
    pub(super) fn of(scene_file: &Path, allow_outside: bool) -> Self {
        let reach = if allow_outside { FileAccess::everywhere() } else { FileAccess::of(scene_file) };
        Self { beside: scene_file.parent().unwrap_or(Path::new("")).to_owned(), library: library_folder(), reach }
    }

    /// The same for a file that the scene names: its own folder, then the library.
    pub(super) fn beside(&self, file: &Path) -> Self {
        Self { beside: file.parent().unwrap_or(Path::new("")).to_owned(), ..self.clone() }
    }

    /// The folder of the file itself.
    pub(super) fn own(&self) -> &Path {
        &self.beside
    }

    /// The file that `name` means, if there is one. Errors: it may not be opened.
    pub(super) fn look_up(&self, name: &str, asked_by: &str) -> Result<Option<PathBuf>> {
        let found = self.candidates(name).find(|path| path.is_file());
        found.map(|path| self.reach.admit(&path, asked_by).map(|()| path)).transpose()
    }

    fn candidates(&self, name: &str) -> impl Iterator<Item = PathBuf> {
        [Some(&self.beside), self.library.as_ref()].into_iter().flatten().map(move |folder| folder.join(name))
    }

    /// The file that `name` means. Errors: there is none, saying where it was looked for; it may not be opened.
    pub(super) fn find(&self, name: &str, asked_by: &str) -> Result<PathBuf> {
        if let Some(found) = self.look_up(name, asked_by)? {
            return Ok(found);
        }
        let places: Vec<_> = self.candidates(name).map(|path| path.display().to_string()).collect();
        let hint = match self.library {
            Some(_) => format!("put it there, or let {LIBRARY_VARIABLE} name the folder that holds it"),
            None => format!("put it there, or set {LIBRARY_VARIABLE} to the folder that holds the geometry"),
        };
        Err(Error::input(asked_by, format!("the file \"{name}\" is missing (no {})", places.join(", no ")), hint))
    }
}
