//! Work that no file has yet, written down as it goes, so that a window which ends by force loses none of it.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use ltm::error::{Error, Result};
use ltm::files::{open_locked, write_file};

use crate::system;

/// Folder of all unsaved work, in the state folder.
const FOLDER: &str = "unsaved";
/// In the folder of one window: what it holds locked while it lives, the container's path, the work as a lighting file.
const LOCK: &str = "lock";
const CONTAINER: &str = "container";
const LOOK: &str = "work.toml";

/// Windows that may have unsaved work at the same time.
const MOST: u32 = 10_000;

/// The place where one window writes down its work on one container. It stays when this is dropped: see
/// [`forget`](Self::forget).
#[derive(Debug)]
pub struct Unsaved {
    folder: PathBuf,
    /// Held as long as the window lives: the system lets it go however that ends.
    _lock: File,
}

/// Work that a window left behind which is no more.
#[derive(Debug)]
pub struct LeftBehind {
    place: Unsaved,
    /// When it was written.
    pub written: SystemTime,
}

impl Unsaved {
    /// Makes a place for work on a container, in a state folder.
    ///
    /// Errors: the system refuses.
    pub fn begin(state_folder: &Path, container: &Path) -> Result<Self> {
        let container = fs::canonicalize(container).map_err(Error::io(container, "find"))?;
        let all = state_folder.join(FOLDER);
        fs::create_dir_all(&all).map_err(Error::io(&all, "create the folder"))?;
        for number in 0..MOST {
            let folder = all.join(number.to_string());
            match fs::create_dir(&folder) {
                Ok(()) => {}
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(Error::io(&folder, "create the folder")(error)),
            }
            let lock = open_locked(&folder.join(LOCK), true)?;
            write_file(&folder.join(CONTAINER), true, &system::bytes_of(container.as_os_str()))?;
            return Ok(Self { folder, _lock: lock });
        }
        Err(Error::input(all.display().to_string(), "is full of unsaved work", "remove what is not needed there"))
    }

    /// The lighting file to write the work to.
    pub fn look(&self) -> PathBuf {
        self.folder.join(LOOK)
    }

    /// Takes the work away: it was saved, or is not wanted.
    pub fn forget(self) {
        // What cannot be removed would only be offered once more.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

impl LeftBehind {
    /// The newest work on a container that a window left behind, if there is any; held from now on.
    pub fn find(state_folder: &Path, container: &Path) -> Option<Self> {
        let container = fs::canonicalize(container).ok()?;
        let folders = fs::read_dir(state_folder.join(FOLDER)).ok()?;
        let found = folders.filter_map(|entry| {
            let folder = entry.ok()?.path();
            let of = PathBuf::from(system::path_of(fs::read(folder.join(CONTAINER)).ok()?)?);
            let written = fs::metadata(folder.join(LOOK)).and_then(|look| look.modified()).ok()?;
            (of == container).then_some((written, folder))
        });
        let mut found: Vec<_> = found.collect();
        found.sort();
        // A window that lives holds the lock of its own.
        found.into_iter().rev().find_map(|(written, folder)| {
            let lock = open_locked(&folder.join(LOCK), true).ok()?;
            Some(Self { place: Unsaved { folder, _lock: lock }, written })
        })
    }

    /// The lighting file that it stands in.
    pub fn look(&self) -> PathBuf {
        self.place.look()
    }

    /// Takes it away.
    pub fn forget(self) {
        self.place.forget();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_window_left_is_found_once_it_is_gone_and_only_for_its_container() {
        let folder = tempfile::tempdir().unwrap();
        let [state, container, other] = ["state", "a.ltc", "b.ltc"].map(|name| folder.path().join(name));
        fs::write(&container, "a").unwrap();
        fs::write(&other, "b").unwrap();
        let [first, second] = [(); 2].map(|()| Unsaved::begin(&state, &container).unwrap());
        assert!(LeftBehind::find(&state, &container).is_none(), "nothing was written");
        fs::write(first.look(), "base = \"scene\"").unwrap();
        assert!(LeftBehind::find(&state, &container).is_none(), "its window lives");
        let look = first.look();
        drop(first);
        assert!(LeftBehind::find(&state, &other).is_none());
        let left = LeftBehind::find(&state, &container).unwrap();
        assert_eq!(left.look(), look);
        assert!(LeftBehind::find(&state, &container).is_none(), "it is held by who found it");
        left.forget();
        second.forget();
        assert_eq!(fs::read_dir(state.join(FOLDER)).unwrap().count(), 0);
    }
}
