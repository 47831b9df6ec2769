//! A temporary file for what does not fit in memory between two passes.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::error::{Error, Result};

/// Byte strings, appended from any thread and read back by place. The file has no name, so nothing is left behind
/// however the process ends.
pub(super) struct Spill {
    file: File,
    end: Mutex<u64>,
    folder: PathBuf,
}

/// Where an appended string lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    offset: u64,
    length: usize,
}

impl Spill {
    /// A spill file in the folder of `beside`, where the disk is meant to hold results.
    pub(super) fn create(beside: &Path) -> Result<Self> {
        let folder = match beside.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let file =
            tempfile::tempfile_in(&folder).map_err(Error::io(&folder, "create a temporary file in the folder"))?;
        Ok(Self { file, end: Mutex::new(0), folder })
    }

    /// Appends a string.
    pub(super) fn append(&self, bytes: &[u8]) -> Result<Place> {
        let offset = {
            let mut end = self.end.lock().expect("no panic holds it");
            let offset = *end;
            *end += bytes.len() as u64;
            offset
        };
        self.file
            .write_all_at(bytes, offset)
            .map_err(Error::io(&self.folder, "write a temporary file in the folder"))?;
        Ok(Place { offset, length: bytes.len() })
    }

    /// The error for bytes that came back other than they were written.
    pub(super) fn damaged(&self, problem: &str) -> Error {
        let problem = format!("a temporary file in the folder came back damaged ({problem})");
        Error::damaged(&self.folder, problem, "check the disk and run the same command again")
    }

    /// Reads a string back.
    pub(super) fn read(&self, place: &Place) -> Result<Vec<u8>> {
        let mut bytes = vec![0; place.length];
        self.file
            .read_exact_at(&mut bytes, place.offset)
            .map_err(Error::io(&self.folder, "read a temporary file in the folder"))?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_come_back_by_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::create(&folder.path().join("x")).unwrap();
        let places: Vec<_> = (0..10u8).map(|i| spill.append(&vec![i; i as usize]).unwrap()).collect();
        for (i, place) in places.iter().enumerate() {
            assert_eq!(spill.read(place).unwrap(), vec![i as u8; i]);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the file has no name");
    }
}
