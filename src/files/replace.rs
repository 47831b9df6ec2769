//! Replacing a file whole, or not at all.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::check_output;
use super::lock::{Lock, is_named, say_locks_are_missing, try_lock};
use super::names::{folder_of, sync_folder};
use super::system::{self, Renamed};
use crate::error::{Error, Hint, Result};

/// Ends every temporary name, before its number.
const TEMPORARY: &str = ".ltm-tmp";
/// Temporary names of one output that are looked at for what a killed run left behind.
const LOOKED_AT: u32 = 4;
/// Temporary names of one output at most.
const MAX_TEMPORARIES: u32 = 1000;

/// A file that grows under a private temporary name beside `path` until [`finish`](Self::finish) moves it there. Dropped, it is
/// removed, and what stood under the name is as it was.
///
/// The temporary name is `.NAME.ltm-tmp0`, or a higher number where another process holds that. A living process holds its file's
/// lock, so what a killed one left is told from it, and removed by the next run that writes the same output.
#[derive(Debug)]
pub struct Replacement {
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    overwrite: bool,
    finished: bool,
}

impl Replacement {
    /// Begins a file that will be called `path`; `overwrite` says whether it may replace one. A symbolic link is followed: the
    /// file that it leads to is replaced.
    ///
    /// # Errors
    /// Those of [`check_output`]; the folder cannot be written.
    pub fn begin(path: &Path, overwrite: bool) -> Result<Self> {
        check_output(path, overwrite)?;
        let target = if path.is_symlink() {
            fs::canonicalize(path).map_err(Error::io(path, "follow the link"))?
        } else {
            path.to_owned()
        };
        let (temporary, file) = create_temporary(&target, path)?;
        Ok(Self { path: target, temporary, file, overwrite, finished: false })
    }

    /// The file, to be written.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Makes the file durable and gives it its name.
    ///
    /// # Errors
    /// The system refuses to write; a file of that name was made meanwhile, and may not be replaced.
    pub fn finish(mut self) -> Result<()> {
        self.file.sync_all().map_err(Error::io(&self.path, "write"))?;
        publish(&self.temporary, &self.path, self.overwrite).map_err(|error| match error {
            // It names the temporary file, which is removed with `self`.
            Error::Input { place, problem, .. } => Error::input(place, problem, Hint::Overwrite),
            other => other,
        })?;
        self.finished = true;
        Ok(())
    }
}

impl Drop for Replacement {
    fn drop(&mut self) {
        if !self.finished && is_named(&self.file, &self.temporary) {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Lets `write` fill a [`Replacement`] of `path` through a buffer, and finishes it.
///
/// # Errors
/// Those of [`Replacement`] and of `write`; then the old file stands.
pub fn replace(path: &Path, overwrite: bool, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    let replacement = Replacement::begin(path, overwrite)?;
    let mut buffer = BufWriter::with_capacity(1 << 18, replacement.file());
    write(&mut buffer)?;
    buffer.flush().map_err(Error::io(path, "write"))?;
    drop(buffer);
    replacement.finish()
}

/// Writes these bytes as a [`Replacement`] of `path`.
///
/// # Errors
/// Those of [`Replacement`]; then the old file stands.
pub fn write_file(path: &Path, overwrite: bool, bytes: &[u8]) -> Result<()> {
    replace(path, overwrite, |file| file.write_all(bytes).map_err(Error::io(path, "write")))
}

/// Renames a finished, durable file to its final name, and makes the name durable. The file gets no permissions that
/// the one it replaces did not have.
///
/// # Errors
/// `to` exists and may not be replaced, even if it was made only now; the system refuses.
pub fn publish(from: &Path, to: &Path, overwrite: bool) -> Result<()> {
    if overwrite && let Ok(old) = fs::metadata(to) {
        let new = fs::metadata(from).map_err(Error::io(from, "look at"))?;
        if let Some(narrowed) = system::no_wider_than(&new, &old) {
            fs::set_permissions(from, narrowed).map_err(Error::io(from, "set the permissions of"))?;
        }
    }
    let failed = || Error::io(to, "give the finished file its name");
    let exists = || {
        let hint = format!("the finished file is {}", from.display());
        Err(Error::input(to.display().to_string(), "was made by another program meanwhile", hint))
    };
    if overwrite {
        fs::rename(from, to).map_err(failed())?;
    } else {
        match system::rename_to_new(from, to).map_err(failed())? {
            Renamed::Done => {}
            Renamed::Taken => return exists(),
            // Looking first is the best that is left.
            Renamed::Unknown if to.exists() => return exists(),
            Renamed::Unknown => fs::rename(from, to).map_err(failed())?,
        }
    }
    sync_folder(to)
}

/// Makes a file of this process alone beside `path`, and removes what killed runs left there. `said` is the name for messages.
fn create_temporary(path: &Path, said: &Path) -> Result<(PathBuf, File)> {
    let mut made = None;
    for number in 0..MAX_TEMPORARIES {
        let temporary = temporary_path(path, number);
        if made.is_none() {
            made = claim(&temporary).map_err(Error::io(said, "create a temporary file beside"))?;
        } else if number < LOOKED_AT {
            let _ = remove_if_orphan(&temporary);
        }
        if number + 1 >= LOOKED_AT
            && let Some(made) = made.take()
        {
            return Ok(made);
        }
    }
    let problem = format!("{MAX_TEMPORARIES} other processes are writing it, or left {TEMPORARY} files beside it");
    Err(Error::input(said.display().to_string(), problem, "wait for them, or remove those files"))
}

/// Makes and locks a file of a temporary name; none where another process holds it.
fn claim(temporary: &Path) -> std::io::Result<Option<(PathBuf, File)>> {
    loop {
        let file = match OpenOptions::new().read(true).write(true).create_new(true).open(temporary) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                if remove_if_orphan(temporary)? {
                    continue;
                }
                return Ok(None);
            }
            Err(error) => return Err(error),
        };
        match try_lock(&file)? {
            // Another process took the new file for an orphan before it was locked.
            Lock::Held if !is_named(&file, temporary) => {}
            Lock::HeldByAnother => {}
            Lock::Held => return Ok(Some((temporary.to_owned(), file))),
            Lock::Unknown => {
                say_locks_are_missing(temporary);
                return Ok(Some((temporary.to_owned(), file)));
            }
        }
    }
}

/// Removes a temporary file that no process holds; whether the name is free now.
fn remove_if_orphan(temporary: &Path) -> std::io::Result<bool> {
    match fs::symlink_metadata(temporary) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
        Err(error) => return Err(error),
        Ok(found) if !found.is_file() => return Ok(false),
        Ok(_) => {}
    }
    let file = match OpenOptions::new().write(true).open(temporary) {
        Ok(file) => file,
        Err(error) => return Ok(error.kind() == ErrorKind::NotFound),
    };
    if try_lock(&file)? != Lock::Held || !is_named(&file, temporary) {
        return Ok(false);
    }
    fs::remove_file(temporary)?;
    Ok(true)
}

fn temporary_path(path: &Path, number: u32) -> PathBuf {
    let name = path.file_name().unwrap_or(OsStr::new("file"));
    folder_of(path).join(system::temporary_name(name, &format!("{TEMPORARY}{number}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path, overwrite: bool, text: &str) -> Result<()> {
        write_file(path, overwrite, text.as_bytes())
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_write_that_fails_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        write(&path, false, "old").unwrap();
        let refused = replace(&path, true, |file| {
            file.write_all(b"half").unwrap();
            Err(Error::input("x", "no", ""))
        });
        assert!(refused.is_err());
        assert!(write(&path, false, "new").unwrap_err().to_string().contains("exists already"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        write(&path, true, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(names(folder.path()), ["x"]);
    }

    #[test]
    fn what_killed_runs_left_is_removed_and_what_others_write_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        for orphan in [0, 2] {
            fs::write(temporary_path(&path, orphan), "left behind").unwrap();
        }
        // Another process writes the same output.
        let other = Replacement::begin(&path, false).unwrap();
        assert_eq!(names(folder.path()), [".x.ltm-tmp0"]);
        (&other.file).write_all(b"other").unwrap();
        fs::write(temporary_path(&path, 3), "left behind").unwrap();
        let ours = Replacement::begin(&path, false).unwrap();
        assert_eq!(names(folder.path()), [".x.ltm-tmp0", ".x.ltm-tmp1"]);
        (&ours.file).write_all(b"ours").unwrap();
        other.finish().unwrap();
        let said = ours.finish().unwrap_err().to_string();
        assert!(said.contains("meanwhile"), "{said}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "other");
        assert_eq!(names(folder.path()), ["x"]);
    }

    #[test]
    #[cfg(unix)]
    fn permissions_are_those_of_the_umask_and_never_wider_than_before() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (path, plain) = (folder.path().join("x"), folder.path().join("plain"));
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        fs::write(&plain, "").unwrap();
        write(&path, false, "a").unwrap();
        assert_eq!(mode(&path), mode(&plain));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        write(&path, true, "b").unwrap();
        assert_eq!(mode(&path), 0o600);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_followed_and_a_long_name_fits() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("ä".repeat(127)), folder.path().join("link"));
        write(&path, false, "a").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write(&link, true, "b").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), "b");
    }
}
