//! A file read through a memory map.

use std::fs::File;
use std::io;

use memmap2::{Advice, Mmap, UncheckedAdvice};

use super::{FileStorage, PAGE_BYTES, Storage};

/// A file read through a memory map, for reading only: no system call and no second copy where its pages are in the
/// page cache already.
///
/// Touching a mapped page that the file no longer has kills the process. So the length is asked for before each access,
/// and what lies beyond it is an ordinary end of file. What is left is a file cut between this question and the copy:
/// where others may cut the file, use [`FileStorage`].
pub struct MappedStorage {
    file: FileStorage,
    map: Mmap,
}

impl MappedStorage {
    /// Maps an open file as long as it is now.
    pub fn new(file: File) -> io::Result<Self> {
        #[expect(unsafe_code, reason = "mapping a file is unsafe: others may change it")]
        // SAFETY: the map is only copied from, never lent out as a slice that must stay as it is; what is copied is
        // checked by its checksum. The length is looked at before each copy.
        let map = unsafe { Mmap::map(&file)? };
        // Without it the kernel reads far less ahead: 0.6 against 1.1 GB/s from a cold file.
        let _ = map.advise(Advice::Sequential);
        Ok(Self { file: FileStorage::new(file), map })
    }

    /// The whole pages inside a range of the map.
    fn pages(&self, offset: u64, length: u64) -> Option<(usize, usize)> {
        let start = offset.next_multiple_of(PAGE_BYTES);
        let end = (offset + length).min(self.map.len() as u64) / PAGE_BYTES * PAGE_BYTES;
        (start < end).then(|| (start as usize, (end - start) as usize))
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
        let there = self.length()?.min(self.map.len() as u64).saturating_sub(offset);
        let read = there.min(bytes.len() as u64) as usize;
        if read > 0 {
            bytes[..read].copy_from_slice(&self.map[offset as usize..][..read]);
        }
        Ok(read)
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
        if let Some((start, length)) = self.pages(offset, length) {
            let _ = self.map.advise_range(Advice::WillNeed, start, length);
        }
    }

    fn release(&self, offset: u64, length: u64) {
        if let Some((start, length)) = self.pages(offset, length) {
            #[expect(unsafe_code, reason = "dropping pages is unsafe for maps that may have been written to")]
            // SAFETY: the map is shared and read-only; a page that is dropped is read from the file again.
            let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, start, length) };
        }
        self.file.release(offset, length);
    }
}
