//! How a unit of work becomes a shard in a depot: from files that vanish with the process, complete or not at all.

use std::path::{Path, PathBuf};

use crate::blob_store::BlobStore;
use crate::block_records::{ShardContent, ShardHead, open_spill};
use crate::error::{Error, Result};
use crate::files::ContinuationFile;
use crate::resources::Progress;

/// Result of a unit.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// Name of the shard.
    pub name: String,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Rays traced.
    pub rays: u64,
    /// Path contributions that were not finite and were dropped.
    pub non_finite: u64,
}

/// To be asked before each step of a job; `kept` says what is left of it where it stops.
///
/// # Errors
/// The program that runs the job says to stop.
pub(super) fn go_on(watch: &dyn Progress, kept: &str) -> Result<()> {
    if watch.interrupted() { Err(Error::interrupted(kept)) } else { Ok(()) }
}

/// A file that vanishes with the process, however that ends, for byte strings of so many keys; and a path for messages.
///
/// # Errors
/// The folder cannot be written.
pub(super) fn scratch_file(scratch: Option<&Path>, keys: u32) -> Result<(PathBuf, ContinuationFile)> {
    let folder = match scratch {
        Some(scratch) => tempfile::tempdir_in(scratch).map_err(Error::io(scratch, "create a folder in"))?,
        None => tempfile::tempdir().map_err(Error::io("the system's temporary files", "create a folder for them"))?,
    };
    let path = folder.path().join("shard");
    let file = open_spill(&path, [0; 32], keys, false)?;
    // An unlinked file lives as long as it is open.
    folder.close().map_err(Error::io(&path, "take the name of"))?;
    Ok((path, file))
}

/// Writes the records of a range into a depot, as a shard. Returns its name.
///
/// # Errors
/// A record is missing; those of the disk and of the depot.
pub(super) fn publish(head: &ShardHead, content: &ShardContent<'_>, depot: &BlobStore) -> Result<String> {
    let name = head.name(content)?;
    depot.put(&name, &|out| head.write(content, &name, out))?;
    Ok(name)
}
