//! Byte strings of blocks, in a file of this process or in shards that were built elsewhere.

use super::shard::ShardSet;
use crate::error::{Error, Result};
use crate::files::ContinuationFile;

/// One byte string for each block, or for some blocks.
pub(crate) enum Records {
    /// Written by this process.
    File(ContinuationFile),
    /// Built elsewhere; complete.
    Shards(ShardSet),
}

impl Records {
    pub(crate) fn has(&self, key: u32) -> bool {
        match self {
            Self::File(file) => file.has(key),
            Self::Shards(shards) => shards.has(key),
        }
    }

    /// # Errors
    /// Those of [`ContinuationFile::append`]; shards are not written to.
    pub(crate) fn append(&self, key: u32, parts: &[&[u8]]) -> Result<()> {
        match self {
            Self::File(file) => file.append(key, parts),
            Self::Shards(shards) => Err(shards.damaged(key, "it is not there")),
        }
    }

    /// # Errors
    /// They are not there, cannot be read, or are not those that were written.
    pub(crate) fn read(&self, key: u32) -> Result<Vec<u8>> {
        match self {
            Self::File(file) => file.read(key),
            Self::Shards(shards) => shards.read(key),
        }
    }

    /// As [`read`](Self::read), into a buffer that is reused if the bytes are in a file.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn read_into(&self, key: u32, bytes: &mut Vec<u8>) -> Result<()> {
        match self {
            Self::File(file) => file.read_into(key, bytes)?,
            Self::Shards(shards) => *bytes = shards.read(key)?,
        }
        Ok(())
    }

    /// The error for bytes that differ from what was written.
    pub(crate) fn damaged(&self, key: u32, problem: &str) -> Error {
        match self {
            Self::File(file) => file.damaged(key, problem),
            Self::Shards(shards) => shards.damaged(key, problem),
        }
    }

    /// Removes what this process wrote; shards stay.
    ///
    /// # Errors
    /// The system refuses.
    pub(crate) fn remove(self) -> Result<()> {
        match self {
            Self::File(file) => file.remove(),
            Self::Shards(_) => Ok(()),
        }
    }
}
