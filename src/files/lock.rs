//! The one rule for locks.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::Path;
use std::sync::OnceLock;

use super::system;
use crate::error::{Error, Result};

type Teller = Box<dyn Fn(&str) + Send + Sync>;

static TELLER: OnceLock<Teller> = OnceLock::new();
static TOLD: OnceLock<()> = OnceLock::new();

/// Result of trying to lock a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lock {
    /// This process holds it, until the file is closed or the process ends.
    Held,
    /// Another process holds it.
    HeldByAnother,
    /// The file system knows no locks.
    Unknown,
}

/// Sets what is told of a file system without locks, one line for the whole process. Only the first setting counts.
pub fn tell_missing_locks(tell: impl Fn(&str) + Send + Sync + 'static) {
    let _ = TELLER.set(Box::new(tell));
}

/// Opens a file for reading and writing, and holds it against other writing processes until it is closed or the process ends.
/// With `create` a missing file is made; one that is there is never changed.
///
/// # Errors
/// The file cannot be opened or is no regular file; another process holds it.
pub fn open_locked(path: &Path, create: bool) -> Result<File> {
    open_locked_by(path, create, try_lock)
}

fn open_locked_by(path: &Path, create: bool, try_lock: impl Fn(&File) -> io::Result<Lock>) -> Result<File> {
    let action = if create { "create" } else { "open for writing" };
    loop {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(create).truncate(false);
        let file = system::opens_without_waiting(&mut options).open(path).map_err(Error::io(path, action))?;
        if !file.metadata().map_err(Error::io(path, action))?.is_file() {
            return Err(Error::input(path.display().to_string(), "is a pipe or device", "give a file"));
        }
        match try_lock(&file).map_err(Error::io(path, "lock"))? {
            Lock::HeldByAnother => {
                let problem = "another process is writing it";
                return Err(Error::input(path.display().to_string(), problem, "wait for it, or stop it"));
            }
            Lock::Unknown => {
                say_locks_are_missing(path);
                return Ok(file);
            }
            // Between opening and locking another process may have given the file its final name, or removed it: then the name
            // is of another file by now, or of none.
            Lock::Held if is_named(&file, path) => return Ok(file),
            Lock::Held => {}
        }
    }
}

/// Tries to lock an open file.
pub(super) fn try_lock(file: &File) -> io::Result<Lock> {
    loop {
        return match file.try_lock() {
            Ok(()) => Ok(Lock::Held),
            Err(TryLockError::WouldBlock) => Ok(Lock::HeldByAnother),
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Interrupted => continue,
            // A file system without locks, or a system out of them, or where the network lost its lock server.
            Err(TryLockError::Error(_)) => Ok(Lock::Unknown),
        };
    }
}

/// Whether `path` names this very file.
pub(super) fn is_named(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(named)) = (file.metadata(), std::fs::metadata(path)) else { return false };
    system::identity(&open) == system::identity(&named)
}

pub(super) fn say_locks_are_missing(path: &Path) {
    TOLD.get_or_init(|| {
        if let Some(tell) = TELLER.get() {
            let path = path.display();
            tell(&format!("{path}: this file system has no locks; start no second process that writes the same file"));
        }
    });
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn a_second_process_is_refused_until_the_first_has_closed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let first = open_locked(&path, true).unwrap();
        let said = open_locked(&path, true).unwrap_err().to_string();
        assert!(said.contains("another process is writing it"), "{said}");
        drop(first);
        open_locked(&path, false).unwrap();
    }

    #[test]
    fn a_name_that_went_to_another_file_between_opening_and_locking_is_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let (path, finished) = (folder.path().join("x.part"), folder.path().join("x"));
        std::fs::write(&path, "finished").unwrap();
        let tries = Cell::new(0);
        let file = open_locked_by(&path, true, |file| {
            tries.set(tries.get() + 1);
            if tries.get() == 1 {
                std::fs::rename(&path, &finished).unwrap();
            }
            try_lock(file)
        });
        let file = file.unwrap();
        assert_eq!(tries.get(), 2);
        assert_eq!(file.metadata().unwrap().len(), 0, "the finished file was taken for the partial one");
        assert!(is_named(&file, &path) && !is_named(&file, &finished));
    }

    #[test]
    fn without_locks_the_work_goes_on_and_one_line_says_so() {
        static SAID: Mutex<Vec<String>> = Mutex::new(Vec::new());
        tell_missing_locks(|line| SAID.lock().unwrap().push(line.to_owned()));
        let folder = tempfile::tempdir().unwrap();
        for name in ["x", "y"] {
            open_locked_by(&folder.path().join(name), true, |_| Ok(Lock::Unknown)).unwrap();
        }
        let said = SAID.lock().unwrap();
        assert!(said.len() == 1 && said[0].contains("has no locks"), "{said:?}");
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        assert!(open_locked(&pipe, true).unwrap_err().to_string().contains("is a pipe"));
    }
}
