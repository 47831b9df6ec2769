//! Where a file grows and what it is called when it is finished.

use std::fs::File;
use std::path::{Path, PathBuf};

use rustix::fs::FlockOperation;

use crate::error::{Error, Result};

use super::space::folder_of;

/// Under which names the file grows and stands.
pub(super) struct Place {
    /// The file that is written, for messages too.
    pub(super) grows: PathBuf,
    /// Its name when finished; `None` where it stands in its place already.
    pub(super) becomes: Option<PathBuf>,
    /// Whether a finished file of that name may be replaced.
    pub(super) overwrite: bool,
    /// Whether the file is to be removed when dropped: nobody would continue a file without blocks.
    pub(super) remove_if_empty: bool,
}

/// The name under which a file grows: `NAME.part` beside it.
pub fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

impl Place {
    /// For storages that are not files.
    pub(super) fn unnamed() -> Self {
        Self { grows: "(storage)".into(), becomes: None, overwrite: true, remove_if_empty: false }
    }
}

/// Refuses where something stands in the way.
pub(super) fn refuse_existing(path: &Path, hint: &str) -> Result<()> {
    if path.exists() { Err(Error::input(path.display().to_string(), "exists already", hint)) } else { Ok(()) }
}

/// Opens for reading and writing, held against other writing processes until closed (or killed).
pub(super) fn open_locked(path: &Path, create: bool) -> Result<File> {
    let action = if create { "create" } else { "open for writing" };
    let file = File::options()
        .read(true)
        .write(true)
        .create(create)
        .truncate(false)
        .open(path)
        .map_err(Error::io(path, action))?;
    match rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(rustix::io::Errno::WOULDBLOCK) => {
            Err(Error::input(path.display().to_string(), "another process is writing it", "wait for it, or stop it"))
        }
        // A file system without locks: go on without.
        Err(_) => Ok(file),
    }
}

/// Makes the names in a file's folder durable.
pub(super) fn sync_folder(path: &Path) -> Result<()> {
    let folder = folder_of(path);
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(Error::io(folder, "sync the folder"))
}
