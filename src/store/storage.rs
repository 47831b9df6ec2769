//! What the store asks of a file, and the real one.

use std::fs::File;
use std::io;

use super::access::Access;
use super::system;
use crate::files::PositionedFile;

/// What the store asks of a file. Tests put storages in between that fail, tear, freeze and count.
pub trait Storage: Send + Sync {
    /// Bytes of the file.
    ///
    /// # Errors
    /// Those of the system.
    fn length(&self) -> io::Result<u64>;

    /// Sets the length; what is added reads as zero.
    ///
    /// # Errors
    /// Those of the system.
    fn set_length(&self, length: u64) -> io::Result<()>;

    /// Reads some bytes from `offset`, at least one unless the file ends there; may be fewer than asked for.
    ///
    /// # Errors
    /// Those of the system.
    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize>;

    /// Writes some bytes at `offset`; may be fewer than given.
    ///
    /// # Errors
    /// Those of the system.
    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<usize>;

    /// Returns when everything written so far would survive a loss of power.
    ///
    /// # Errors
    /// Those of the system.
    fn sync(&self) -> io::Result<()>;

    /// Reserves disk space for a range, so that writing it cannot fail for want of it; what is there stays. Where the
    /// file system cannot do that, does nothing: a write then fails with an error when the disk is full.
    ///
    /// # Errors
    /// Those of the system.
    fn reserve(&self, offset: u64, length: u64) -> io::Result<()>;

    /// Makes a range read as zero, giving its space back where the file system can.
    ///
    /// # Errors
    /// Those of the system.
    fn clear(&self, offset: u64, length: u64) -> io::Result<()>;

    /// Start of the next range at or after `offset` that is not known to be a hole; `None` if only holes follow.
    ///
    /// # Errors
    /// Those of the system.
    fn next_data(&self, offset: u64) -> io::Result<Option<u64>> {
        Ok((offset < self.length()?).then_some(offset))
    }

    /// Says that a range will be read now, so that reading ahead may begin with all of it.
    fn expect(&self, offset: u64, length: u64) {
        let _ = (offset, length);
    }

    /// Says that a range will not be read again soon, so that its pages need not crowd out others.
    fn release(&self, offset: u64, length: u64) {
        let _ = (offset, length);
    }

    /// Lends a range from memory, where the storage has it there; what is lent is given back with
    /// [`give_back`](Self::give_back).
    fn lend(&self, offset: u64, length: u64) -> Option<&[u8]> {
        let _ = (offset, length);
        None
    }

    /// Ends a loan: its memory need not stay resident.
    ///
    /// # Errors
    /// What was lent may not have been the file's bytes all along: whatever was made of it is void.
    fn give_back(&self, offset: u64, length: u64) -> io::Result<()> {
        let _ = (offset, length);
        Ok(())
    }
}

impl<S: Storage + ?Sized> Storage for &S {
    fn length(&self) -> io::Result<u64> {
        (**self).length()
    }

    fn set_length(&self, length: u64) -> io::Result<()> {
        (**self).set_length(length)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        (**self).read_at(offset, bytes)
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        (**self).write_at(offset, bytes)
    }

    fn sync(&self) -> io::Result<()> {
        (**self).sync()
    }

    fn reserve(&self, offset: u64, length: u64) -> io::Result<()> {
        (**self).reserve(offset, length)
    }

    fn clear(&self, offset: u64, length: u64) -> io::Result<()> {
        (**self).clear(offset, length)
    }

    fn next_data(&self, offset: u64) -> io::Result<Option<u64>> {
        (**self).next_data(offset)
    }

    fn expect(&self, offset: u64, length: u64) {
        (**self).expect(offset, length);
    }

    fn release(&self, offset: u64, length: u64) {
        (**self).release(offset, length);
    }

    fn lend(&self, offset: u64, length: u64) -> Option<&[u8]> {
        (**self).lend(offset, length)
    }

    fn give_back(&self, offset: u64, length: u64) -> io::Result<()> {
        (**self).give_back(offset, length)
    }
}

/// A file, read and written at positions.
#[derive(Debug)]
pub struct FileStorage {
    file: File,
}

impl FileStorage {
    /// Over an open file.
    pub fn new(file: File) -> Self {
        Self { file }
    }

    /// The file.
    pub fn into_file(self) -> File {
        self.file
    }

    /// The file.
    pub(super) fn file(&self) -> &File {
        &self.file
    }

    /// Says what will be read of it.
    pub(super) fn will_read(&self, access: Access) {
        system::will_read(&self.file, access);
    }
}

impl Storage for FileStorage {
    fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn set_length(&self, length: u64) -> io::Result<()> {
        self.file.set_len(length)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        self.file.read_at(bytes, offset)
    }

    fn write_at(&self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.file.write_at(bytes, offset)
    }

    fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    fn reserve(&self, offset: u64, length: u64) -> io::Result<()> {
        system::reserve(&self.file, offset, length)
    }

    fn clear(&self, offset: u64, length: u64) -> io::Result<()> {
        if length == 0 || system::clears(&self.file, offset, length)? {
            return Ok(());
        }
        overwrite_with_zeros(self, offset, length)
    }

    fn next_data(&self, offset: u64) -> io::Result<Option<u64>> {
        system::next_data(&self.file, offset)
    }

    fn expect(&self, offset: u64, length: u64) {
        system::expect(&self.file, offset, length);
    }

    fn release(&self, offset: u64, length: u64) {
        system::release(&self.file, offset, length);
    }
}

/// Zeros a range where it is not zero already, so that holes stay holes.
fn overwrite_with_zeros(storage: &impl Storage, offset: u64, length: u64) -> io::Result<()> {
    let mut bytes = vec![0; 1 << 16];
    let mut at = offset;
    while at < offset + length {
        let part = (offset + length - at).min(bytes.len() as u64) as usize;
        read_exact(storage, at, &mut bytes[..part])?;
        if bytes[..part].iter().any(|&byte| byte != 0) {
            bytes[..part].fill(0);
            write_all(storage, at, &bytes[..part])?;
        }
        at += part as u64;
    }
    Ok(())
}

/// Reads exactly these bytes. Errors: `UnexpectedEof` where the file ends before.
pub(super) fn read_exact(storage: &impl Storage, mut offset: u64, mut bytes: &mut [u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match storage.read_at(offset, bytes) {
            Ok(0) => return Err(io::Error::new(io::ErrorKind::UnexpectedEof, format!("the file ends at {offset}"))),
            Ok(read) => {
                bytes = &mut bytes[read..];
                offset += read as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Writes all of these bytes.
pub(super) fn write_all(storage: &impl Storage, mut offset: u64, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match storage.write_at(offset, bytes) {
            Ok(0) => return Err(io::Error::new(io::ErrorKind::WriteZero, "the file takes no more bytes")),
            Ok(written) => {
                bytes = &bytes[written..];
                offset += written as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
