//! Bytes that are read where they are wanted.

use std::fmt::Debug;
use std::fs::File;
use std::io::Result;

use super::system::{PositionedFile, allocated_bytes};

/// What can be read by ranges, from several threads at once: a file, or an object of a store.
pub trait Ranged: Debug + Send + Sync {
    /// How many bytes there are.
    ///
    /// # Errors
    /// The system does not tell.
    fn bytes(&self) -> Result<u64>;

    /// Fills `buffer` with the bytes from `offset` on.
    ///
    /// # Errors
    /// There are too few, or they cannot be read.
    fn fill(&self, buffer: &mut [u8], offset: u64) -> Result<()>;

    /// Bytes that the disk really holds, fewer than [`bytes`](Self::bytes) of a file with holes; their number where the file system does
    /// not say.
    ///
    /// # Errors
    /// The system does not tell.
    fn stored_bytes(&self) -> Result<u64> {
        self.bytes()
    }

    /// Memory that reading takes at most, beside the buffers that it fills.
    fn held_bytes(&self) -> u64 {
        0
    }
}

impl Ranged for File {
    fn bytes(&self) -> Result<u64> {
        self.metadata().map(|metadata| metadata.len())
    }

    fn fill(&self, buffer: &mut [u8], offset: u64) -> Result<()> {
        self.read_exact_at(buffer, offset)
    }

    fn stored_bytes(&self) -> Result<u64> {
        let metadata = self.metadata()?;
        Ok(if allocated_bytes(&metadata) == 0 { metadata.len() } else { allocated_bytes(&metadata) })
    }
}
