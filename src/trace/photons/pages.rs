//! Arrays in memory, or in an unlinked temporary file that is memory-mapped, so that the system can evict its pages.

use std::fs::File;
use std::io::Write;
use std::marker::PhantomData;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::Mmap;

use crate::error::{Error, Result};

/// Read-only items.
#[derive(Debug)]
pub(super) enum Items<T> {
    Held(Vec<T>),
    Paged { file: Arc<Mmap>, place: Place<T> },
}

/// Where items lie in the file.
#[derive(Debug)]
pub(super) struct Place<T> {
    bytes: Range<usize>,
    of: PhantomData<T>,
}

/// The file, while it is written.
#[derive(Debug)]
pub(super) struct Pages {
    file: File,
    folder: PathBuf,
    length: usize,
}

/// The file, once it is written: it can be read.
#[derive(Debug)]
pub(super) struct WrittenPages(Arc<Mmap>);

impl WrittenPages {
    /// Items that were put into this file.
    pub(super) fn items<T>(&self, place: Place<T>) -> Items<T> {
        Items::Paged { file: Arc::clone(&self.0), place }
    }
}

impl<T: Pod> Deref for Items<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            Self::Held(items) => items,
            Self::Paged { file, place } => bytemuck::cast_slice(&file[place.bytes.clone()]),
        }
    }
}

impl<T> FromIterator<T> for Items<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Self::Held(Vec::from_iter(items))
    }
}

impl Pages {
    /// Creates the file in a folder, or in the system's temporary folder.
    pub(super) fn begin(folder: Option<&Path>) -> Result<Self> {
        let folder = folder.map_or_else(tempfile::env::temp_dir, Path::to_owned);
        let file = tempfile::tempfile_in(&folder);
        let file = file.map_err(Error::io(&folder, "create a temporary file for photons in the folder"))?;
        Ok(Self { file, folder, length: 0 })
    }

    /// Moves items into the file, to be read once it is [finished](Self::finish). All items of a file have the same alignment, so that what
    /// comes next begins where it may.
    pub(super) fn put<T: Pod>(&mut self, items: &[T]) -> Result<Place<T>> {
        debug_assert!(self.length.is_multiple_of(align_of::<T>()));
        let bytes: &[u8] = bytemuck::cast_slice(items);
        let written = self.file.write_all(bytes);
        written.map_err(Error::io(&self.folder, "write a temporary file for photons in the folder"))?;
        let bytes = self.length..self.length + bytes.len();
        self.length = bytes.end;
        Ok(Place { bytes, of: PhantomData })
    }

    /// Opens what was written for reading.
    pub(super) fn finish(self) -> Result<WrittenPages> {
        #[expect(unsafe_code, reason = "a file that is larger than the memory is read where it lies")]
        // SAFETY: the file has no name, and nobody else has it.
        let map = unsafe { Mmap::map(&self.file) };
        let map = map.map_err(Error::io(&self.folder, "map a temporary file for photons in the folder"))?;
        Ok(WrittenPages(Arc::new(map)))
    }
}
