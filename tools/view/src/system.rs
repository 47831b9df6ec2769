//! What each system does with files in a way of its own, as far as the window needs it.

use std::ffi::{OsStr, OsString};
use std::fs::Metadata;
use std::path::Path;

/// What tells a file from every other, where the system has it: device and number.
#[cfg(unix)]
pub(crate) fn number(file: &Metadata) -> (u64, u64) {
    use std::os::unix::fs::MetadataExt;
    (file.dev(), file.ino())
}

#[cfg(not(unix))]
pub(crate) fn number(_file: &Metadata) -> (u64, u64) {
    (0, 0)
}

/// A path as bytes from which [`path_of`] makes it again.
#[cfg(unix)]
pub(crate) fn bytes_of(path: &OsStr) -> Vec<u8> {
    use std::os::unix::ffi::OsStrExt;
    path.as_bytes().to_vec()
}

#[cfg(not(unix))]
pub(crate) fn bytes_of(path: &OsStr) -> Vec<u8> {
    path.to_string_lossy().into_owned().into_bytes()
}

#[cfg(unix)]
pub(crate) fn path_of(bytes: Vec<u8>) -> Option<OsString> {
    use std::os::unix::ffi::OsStringExt;
    Some(OsString::from_vec(bytes))
}

#[cfg(not(unix))]
pub(crate) fn path_of(bytes: Vec<u8>) -> Option<OsString> {
    String::from_utf8(bytes).ok().map(OsString::from)
}

/// Lets the system prefer all other threads to this one, by so much. Where it is refused nothing changes.
#[cfg(unix)]
pub(crate) fn lower_priority(by: i32) {
    let _ = rustix::process::nice(by);
}

#[cfg(not(unix))]
pub(crate) fn lower_priority(_by: i32) {}

/// Whether a file may be run, as far as the system says before it is tried.
#[cfg(unix)]
pub(crate) fn is_program(path: &Path) -> bool {
    use rustix::fs::{Access, access};
    path.is_file() && access(path, Access::EXEC_OK).is_ok()
}

#[cfg(not(unix))]
pub(crate) fn is_program(path: &Path) -> bool {
    path.is_file()
}
