//! Opening what the user gave.

use std::fs::{File, OpenOptions};
use std::io::Read;
use std::path::Path;

use super::system;
use crate::error::{Error, Result};

/// Opens a file for reading; `action` says for what ("open the image"). It never blocks, as opening a pipe without a
/// writer would.
///
/// # Errors
/// There is no such file, it may not be read, or it is a folder, pipe or device.
pub fn open_input(path: &Path, action: &str) -> Result<File> {
    let opened = system::opens_without_waiting(OpenOptions::new().read(true)).open(path);
    let file = opened.map_err(Error::io(path, action))?;
    let found = file.metadata().map_err(Error::io(path, action))?;
    if found.is_file() {
        return Ok(file);
    }
    let problem = if found.is_dir() { "is a folder" } else { "is a pipe or device" };
    Err(Error::input(path.display().to_string(), problem, "give a file"))
}

/// All bytes of a file.
///
/// # Errors
/// Those of [`open_input`]; more than `most_bytes`; reading fails.
pub fn read_input(path: &Path, action: &str, most_bytes: u64) -> Result<Vec<u8>> {
    let file = open_input(path, action)?;
    let length = file.metadata().map_err(Error::io(path, action))?.len();
    let mut bytes = Vec::with_capacity(length.min(most_bytes) as usize);
    // One byte more than is allowed tells a file that is too long, even while it grows.
    file.take(most_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io(path, action))?;
    if bytes.len() as u64 > most_bytes {
        let problem = format!("has more than {most_bytes} bytes, far more than such a file needs");
        return Err(Error::input(path.display().to_string(), problem, "give another file"));
    }
    Ok(bytes)
}

/// A file as text in UTF-8.
///
/// # Errors
/// Those of [`read_input`]; bytes that are no text.
pub fn read_input_text(path: &Path, action: &str, most_bytes: u64) -> Result<String> {
    String::from_utf8(read_input(path, action, most_bytes)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Error::input(path.display().to_string(), format!("is no text in UTF-8 (byte {at})"), "give a text file")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_pipe_without_a_writer_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let said = open_input(&pipe, "open").unwrap_err().to_string();
        assert!(said.contains("is a pipe or device"), "{said}");
        let said = open_input(folder.path(), "open").unwrap_err().to_string();
        assert!(said.contains("is a folder"), "{said}");
    }

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        std::fs::write(&path, "eight by").unwrap();
        assert_eq!(read_input_text(&path, "read", 8).unwrap(), "eight by");
        assert!(read_input(&path, "read", 7).unwrap_err().to_string().contains("more than 7 bytes"));
        std::fs::write(&path, [b'a', 0xff]).unwrap();
        assert!(read_input_text(&path, "read", 8).unwrap_err().to_string().contains("byte 1"));
    }
}
