//! Which files a scene or a look may have opened: whoever wrote it may be a stranger.

use std::fs;
use std::path::{Path, PathBuf};

use super::folder_of;
use crate::error::{Error, Hint, Result};

/// Environment variable that names a folder of scene geometry.
pub const LIBRARY_VARIABLE: &str = "LTM_SCENES";

/// The folder that [`LIBRARY_VARIABLE`] names, if it names one.
pub fn library_folder() -> Option<PathBuf> {
    std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// The files that a document may have opened.
#[derive(Clone, Debug)]
pub struct FileAccess {
    /// Real paths of the folders that they must lie in, at any depth; none: they may lie anywhere.
    folders: Option<Vec<PathBuf>>,
}

impl FileAccess {
    /// Any file that the user may read.
    pub fn everywhere() -> Self {
        Self { folders: None }
    }

    /// Files in the folder of `document`, in that of `LTM_SCENES`, and below. Links count as what they lead to.
    pub fn of(document: &Path) -> Self {
        let folders = [Some(folder_of(document).to_owned()), library_folder()];
        Self {
            folders: Some(folders.into_iter().flatten().filter_map(|folder| fs::canonicalize(folder).ok()).collect()),
        }
    }

    /// Refuses a file that a document, `asked_by`, may not have opened.
    ///
    /// # Errors
    /// The file lies elsewhere; the system cannot tell where it lies.
    pub fn admit(&self, path: &Path, asked_by: &str) -> Result<()> {
        let Some(folders) = &self.folders else { return Ok(()) };
        let real = fs::canonicalize(path).map_err(Error::io(path, "find"))?;
        if folders.iter().any(|folder| real.starts_with(folder)) {
            return Ok(());
        }
        let problem = format!("{} lies outside of its folder and of {LIBRARY_VARIABLE}", path.display());
        Err(Error::input(asked_by, problem, Hint::AllowOutside))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_reaches_its_own_folder_and_what_is_below() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("mine/deep")).unwrap();
        // A name that only begins as the folder's.
        fs::create_dir(at("mine too")).unwrap();
        for name in ["secret", "mine/a", "mine/deep/b", "mine too/c"] {
            fs::write(at(name), "").unwrap();
        }
        std::os::unix::fs::symlink(at("secret"), at("mine/link")).unwrap();
        std::os::unix::fs::symlink(at("mine/a"), at("mine/own link")).unwrap();
        let reach = FileAccess::of(&at("mine/scene.toml"));
        for inside in ["mine/a", "mine/deep/b", "mine/deep/../a", "mine/own link"] {
            reach.admit(&at(inside), "scene").unwrap();
        }
        for outside in ["secret", "mine/../secret", "mine/link", "mine too/c"] {
            let error = reach.admit(&at(outside), "scene").unwrap_err();
            assert!(error.to_string().contains("lies outside"), "{outside}: {error}");
            assert_eq!(error.hint(), Some(&Hint::AllowOutside), "{outside}: {error}");
            FileAccess::everywhere().admit(&at(outside), "scene").unwrap();
        }
        assert!(reach.admit(&at("mine/missing"), "scene").is_err());
    }
}
