//! What the status line says.

use ltm::error::Error;

pub(super) use crate::words::line;

/// A message in the status line.
pub(super) struct Message {
    pub(super) text: String,
    pub(super) is_error: bool,
}

impl Message {
    pub(super) fn info(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_error: false }
    }

    /// Something that did not go as it was meant to.
    pub(super) fn problem(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_error: true }
    }

    pub(super) fn error(error: &Error) -> Self {
        Self::problem(line(error))
    }

    /// An error, and what failed by it.
    pub(super) fn failed(what: &str, error: &Error) -> Self {
        Self::problem(format!("{what}: {}", line(error)))
    }
}
