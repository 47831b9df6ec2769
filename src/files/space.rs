//! Room on the disk.

use std::path::Path;

use super::names::folder_of;
use super::system;
use crate::error::{Error, Result};

/// Bytes that an unprivileged process may still write to the file system of `path`, a folder or file that exists; the largest number
/// where the system does not say.
///
/// # Errors
/// There is nothing at `path`, or the system does not tell.
pub fn free_bytes(path: &Path) -> Result<u64> {
    system::free_bytes(path).map_err(Error::io(path, "ask for free space"))
}

/// Refuses at once where the folder that will hold `path` has no room for `needed` bytes.
///
/// # Errors
/// There is less room, in one line with both numbers; as [`free_bytes`].
pub fn check_free_space(path: &Path, needed: u64) -> Result<()> {
    let folder = folder_of(path);
    let free = free_bytes(folder)?;
    if needed <= free {
        return Ok(());
    }
    Err(Error::Resources {
        what: format!("storing {}", path.display()),
        needed: in_gib(needed),
        available: format!("only {} are free in {}", in_gib(free), folder.display()),
        hint: "make room, store in f16, or render fewer pixels or columns".into(),
    })
}

fn in_gib(bytes: u64) -> String {
    format!("{:.2} GiB", bytes as f64 / (1u64 << 30) as f64)
}
