//! Windows, by the standard library alone. It was checked by the compiler and has never run.

use std::ffi::{OsStr, OsString};
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::windows::fs::{FileExt, MetadataExt};
use std::path::Path;

use super::Renamed;

/// Largest length of a name in UTF-16, of which a temporary name repeats so many.
const REPEATED_UNITS: usize = 200;

/// Reads and writes at positions, from any thread. The file's own position moves; nothing here uses it beside this.
pub(crate) trait PositionedFile {
    /// Reads some bytes.
    fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize>;

    /// Writes some bytes.
    fn write_at(&self, buffer: &[u8], offset: u64) -> io::Result<usize>;

    /// Fills a buffer.
    fn read_exact_at(&self, mut buffer: &mut [u8], mut offset: u64) -> io::Result<()> {
        while !buffer.is_empty() {
            match self.read_at(buffer, offset) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => {
                    buffer = &mut buffer[read..];
                    offset += read as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Writes all bytes.
    fn write_all_at(&self, mut buffer: &[u8], mut offset: u64) -> io::Result<()> {
        while !buffer.is_empty() {
            match self.write_at(buffer, offset) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(written) => {
                    buffer = &buffer[written..];
                    offset += written as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

impl PositionedFile for File {
    fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
        match self.seek_read(buffer, offset) {
            // Reading behind the end is an error here and no bytes elsewhere.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(0),
            read => read,
        }
    }

    fn write_at(&self, buffer: &[u8], offset: u64) -> io::Result<usize> {
        self.seek_write(buffer, offset)
    }
}

/// Bytes of a file: what of it is holes is told by the C interface only.
pub(crate) fn allocated_bytes(file: &Metadata) -> u64 {
    file.len()
}

/// Opening does not wait here.
pub(in crate::files) fn opens_without_waiting(options: &mut OpenOptions) -> &mut OpenOptions {
    options
}

/// What tells a file from another of its name, as far as the standard library tells: when it was made and written, and its length.
pub(in crate::files) fn identity(file: &Metadata) -> impl PartialEq {
    (file.creation_time(), file.last_write_time(), file.file_size())
}

/// The system tells of free space by the C interface only: as much as anyone wants, so that writing shows it.
pub(in crate::files) fn free_bytes(path: &Path) -> io::Result<u64> {
    std::fs::metadata(path).map(|_| u64::MAX)
}

/// Files inherit the permissions of their folder.
pub(in crate::files) fn no_wider_than(_new: &Metadata, _old: &Metadata) -> Option<Permissions> {
    None
}

/// A rename replaces here, so that looking first is the best that is left.
pub(in crate::files) fn rename_to_new(_from: &Path, _to: &Path) -> io::Result<Renamed> {
    Ok(Renamed::Unknown)
}

/// Folders cannot be synced here.
pub(in crate::files) fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

/// `.NAME` and a suffix, where a name that would be too long is cut.
pub(in crate::files) fn temporary_name(name: &OsStr, suffix: &str) -> OsString {
    let mut units = 0;
    let name = name.to_string_lossy();
    let repeated: String = name
        .chars()
        .take_while(|c| {
            units += c.len_utf16();
            units <= REPEATED_UNITS
        })
        .collect();
    format!(".{repeated}{suffix}").into()
}
