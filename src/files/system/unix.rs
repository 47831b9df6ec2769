//! Linux, and as far as it is the same there, macOS.

use std::ffi::{OsStr, OsString};
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use rustix::fs::{CWD, OFlags, RenameFlags};
use rustix::io::Errno;

use super::Renamed;

/// Reads and writes at positions, from any thread, without moving the file's own.
pub(crate) use std::os::unix::fs::FileExt as PositionedFile;

/// Unit of a file's blocks: that of `stat`, whatever the disk's is.
const BLOCK_BYTES: u64 = 512;
/// Bytes of a name that a temporary name repeats, so that it stays within the 255 of the file systems.
const REPEATED_BYTES: usize = 200;

/// Bytes that the disk holds of a file, fewer than its length where it has holes; 0 as well where the file system does not say.
pub(crate) fn allocated_bytes(file: &Metadata) -> u64 {
    file.blocks() * BLOCK_BYTES
}

/// Lets opening a pipe not wait for its other end.
pub(in crate::files) fn opens_without_waiting(options: &mut OpenOptions) -> &mut OpenOptions {
    options.custom_flags(OFlags::NONBLOCK.bits() as i32)
}

/// What tells a file from every other that there is: device and number.
pub(in crate::files) fn identity(file: &Metadata) -> impl PartialEq {
    (file.dev(), file.ino())
}

/// Bytes that an unprivileged process may still write to the file system of `path`.
pub(in crate::files) fn free_bytes(path: &Path) -> io::Result<u64> {
    let volume = rustix::fs::statvfs(path)?;
    Ok(volume.f_bavail.saturating_mul(volume.f_frsize))
}

/// The permissions of `new` without those that others do not have of `old`; none where that changes nothing.
pub(in crate::files) fn no_wider_than(new: &Metadata, old: &Metadata) -> Option<Permissions> {
    let mode = |file: &Metadata| file.permissions().mode() & 0o777;
    let narrowed = mode(new) & (mode(old) | 0o600);
    (narrowed != mode(new)).then(|| Permissions::from_mode(narrowed))
}

/// Renames unless a file has the name.
pub(in crate::files) fn rename_to_new(from: &Path, to: &Path) -> io::Result<Renamed> {
    match rustix::fs::renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        Ok(()) => Ok(Renamed::Done),
        Err(Errno::EXIST) => Ok(Renamed::Taken),
        Err(error) if [Errno::INVAL, Errno::NOSYS, Errno::OPNOTSUPP, Errno::NOTSUP].contains(&error) => {
            Ok(Renamed::Unknown)
        }
        Err(error) => Err(error.into()),
    }
}

/// Makes the names in a folder durable.
pub(in crate::files) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// `.NAME` and a suffix, where a name that would be too long is cut.
pub(in crate::files) fn temporary_name(name: &OsStr, suffix: &str) -> OsString {
    let name = name.as_bytes();
    let repeated = &name[..name.len().min(REPEATED_BYTES)];
    OsString::from_vec([b".", repeated, suffix.as_bytes()].concat())
}
