//! A file read through a memory map where that pays, and positioned where not.

use std::fs::File;
use std::io;
use std::time::SystemTime;

use super::access::Access;
use super::system::{self, GuardedMap};
use super::{FileStorage, Storage};

/// A file for reading that lends its bytes from a memory map, without a copy if its pages are cached. Reads into a
/// caller's buffer are positioned, which is faster than copying from a map (decision 41).
///
/// There is no map on network file systems, where another machine may cut the file and a failed connection shows at the
/// touch of a page. There is none if the system refuses, or if too many maps are open. Nothing is lent of a file that
/// has changed since it was opened. Everything is then read positioned, with the same result.
pub struct MappedStorage {
    file: FileStorage,
    map: Option<GuardedMap>,
    /// The file as it was opened.
    opened: Option<Stamp>,
}

/// What changes when a file is written to or cut: its length, and when it was last written.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Stamp(u64, SystemTime);

impl Stamp {
    fn of(file: &File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        Ok(Self(metadata.len(), metadata.modified()?))
    }
}

impl MappedStorage {
    /// Maps an open file as it is now.
    ///
    /// # Errors
    /// The system does not tell the file's length.
    pub fn new(file: File, access: Access) -> io::Result<Self> {
        let opened = Some(Stamp::of(&file)?);
        let map = if system::is_local(&file) { GuardedMap::new(&file).ok() } else { None };
        let file = FileStorage::new(file);
        file.will_read(access);
        if let Some(map) = &map {
            map.will_be_read(access);
        }
        Ok(Self { file, map, opened })
    }

    /// Reads an open file positioned.
    pub fn without_map(file: File) -> Self {
        Self { file: FileStorage::new(file), map: None, opened: None }
    }

    /// Whether there is a map.
    pub fn is_mapped(&self) -> bool {
        self.map.is_some()
    }
}

impl Storage for MappedStorage {
    fn length(&self) -> io::Result<u64> {
        self.file.length()
    }

    fn set_length(&self, _length: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        self.file.read_at(offset, bytes)
    }

    fn write_at(&self, _offset: u64, _bytes: &[u8]) -> io::Result<usize> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn sync(&self) -> io::Result<()> {
        Ok(())
    }

    fn reserve(&self, _offset: u64, _length: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn clear(&self, _offset: u64, _length: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn next_data(&self, offset: u64) -> io::Result<Option<u64>> {
        self.file.next_data(offset)
    }

    fn expect(&self, offset: u64, length: u64) {
        self.file.expect(offset, length);
    }

    fn release(&self, offset: u64, length: u64) {
        self.file.release(offset, length);
    }

    fn lend(&self, offset: u64, length: u64) -> Option<&[u8]> {
        let map = self.map.as_ref()?;
        let end = offset.checked_add(length)?;
        // Of a file that is not what it was, positioned reading says what is wrong.
        let is_there = end <= map.intact_bytes() as u64 && Stamp::of(self.file.file()).ok() == self.opened;
        is_there.then(|| &map.bytes()[offset as usize..end as usize])
    }

    fn give_back(&self, offset: u64, length: u64) -> io::Result<()> {
        let Some(map) = &self.map else { return Ok(()) };
        let end = offset + length;
        let is_whole = end <= map.intact_bytes() as u64 && Stamp::of(self.file.file()).ok() == self.opened;
        map.let_go(offset as usize, end as usize);
        if is_whole { Ok(()) } else { Err(io::Error::other("the file was changed while it was read")) }
    }
}
