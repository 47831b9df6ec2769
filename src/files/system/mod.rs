//! What each system does with files in a way of its own, one file for each; a port begins here. Everything else of files is the
//! standard library's.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
use unix as own;
#[cfg(windows)]
use windows as own;

pub(crate) use own::{PositionedFile, allocated_bytes};
pub(super) use own::{
    free_bytes, identity, no_wider_than, opens_without_waiting, rename_to_new, sync_folder, temporary_name,
};

/// What came of giving a file a name that none may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(windows, expect(dead_code, reason = "a rename replaces there: only `Unknown` is told"))]
pub(super) enum Renamed {
    /// It has the name.
    Done,
    /// Another file has it.
    Taken,
    /// This file system cannot look and rename in one step.
    Unknown,
}
