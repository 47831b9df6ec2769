//! Any system: no maps, no holes, no advice. Files are read and written at positions, and what is cleared is written as zeros.

use std::convert::Infallible;
use std::fs::File;
use std::io;

use crate::store::access::Access;

/// No map: a file that is cut under one would end the program, and how to survive that is each system's own.
pub(in crate::store) struct NoMap(Infallible);

impl NoMap {
    pub(in crate::store) fn new(_file: &File) -> io::Result<Self> {
        Err(io::ErrorKind::Unsupported.into())
    }

    pub(in crate::store) fn bytes(&self) -> &[u8] {
        match self.0 {}
    }

    pub(in crate::store) fn intact_bytes(&self) -> usize {
        match self.0 {}
    }

    pub(in crate::store) fn will_be_read(&self, _access: Access) {
        match self.0 {}
    }

    pub(in crate::store) fn let_go(&self, _start: usize, _end: usize) {
        match self.0 {}
    }
}

pub(in crate::store) fn will_read(_file: &File, _access: Access) {}

pub(in crate::store) fn expect(_file: &File, _offset: u64, _length: u64) {}

pub(in crate::store) fn release(_file: &File, _offset: u64, _length: u64) {}

/// Space is taken as it is written.
pub(in crate::store) fn reserve(_file: &File, _offset: u64, _length: u64) -> io::Result<()> {
    Ok(())
}

/// Holes cannot be made.
pub(in crate::store) fn clears(_file: &File, _offset: u64, _length: u64) -> io::Result<bool> {
    Ok(false)
}

/// Holes are not known.
pub(in crate::store) fn next_data(file: &File, offset: u64) -> io::Result<Option<u64>> {
    Ok((offset < file.metadata()?.len()).then_some(offset))
}

/// Not known: a disk elsewhere is the careful answer, and there are no maps to use otherwise.
pub(in crate::store) fn is_local(_file: &File) -> bool {
    false
}
