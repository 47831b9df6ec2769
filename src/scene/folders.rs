//! Where the files that a scene names are looked for.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Environment variable that names a folder of scene geometry.
const LIBRARY_VARIABLE: &str = "LTM_SCENES";

/// Folders in which relative paths of a scene file are looked up, in this order.
#[derive(Clone, Debug)]
pub(super) struct Folders {
    beside: PathBuf,
    library: Option<PathBuf>,
}

impl Folders {
    /// The scene file's own folder, then the one that `LTM_SCENES` names.
    pub(super) fn of(scene_file: &Path) -> Self {
        let library = std::env::var_os(LIBRARY_VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from);
        Self { beside: scene_file.parent().unwrap_or(Path::new("")).to_owned(), library }
    }

    /// The same for a file that the scene names: its own folder, then the library.
    pub(super) fn beside(&self, file: &Path) -> Self {
        Self { beside: file.parent().unwrap_or(Path::new("")).to_owned(), library: self.library.clone() }
    }

    /// The file that `name` means. Errors: there is none, saying where it was looked for.
    pub(super) fn find(&self, name: &str, asked_by: &str) -> Result<PathBuf> {
        let candidates: Vec<_> = [Some(&self.beside), self.library.as_ref()].into_iter().flatten().collect();
        if let Some(found) = candidates.iter().map(|folder| folder.join(name)).find(|path| path.is_file()) {
            return Ok(found);
        }
        let places: Vec<_> = candidates.iter().map(|folder| folder.join(name).display().to_string()).collect();
        let hint = match self.library {
            Some(_) => format!("put it there, or let {LIBRARY_VARIABLE} name the folder that holds it"),
            None => format!("put it there, or set {LIBRARY_VARIABLE} to the folder that holds the geometry"),
        };
        Err(Error::input(asked_by, format!("the file \"{name}\" is missing (no {})", places.join(", no ")), hint))
    }
}
