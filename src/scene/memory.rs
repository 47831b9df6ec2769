//! Memory that a scene may take while it is loaded.

use std::path::Path;

use crate::error::{Error, Result};

/// A bound on memory, and what of it is taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct MemoryBound {
    limit_bytes: u64,
    taken_bytes: u64,
}

impl MemoryBound {
    /// A budget of `limit_bytes`, all of it free.
    pub(super) fn of(limit_bytes: u64) -> Self {
        Self { limit_bytes, taken_bytes: 0 }
    }

    /// Bytes that are not taken.
    pub(super) fn left(&self) -> u64 {
        self.limit_bytes.saturating_sub(self.taken_bytes)
    }

    /// Holds `bytes` more, which reading `path` takes for now, to the bound.
    ///
    /// # Errors
    /// [`Error::Resources`] where they do not fit.
    pub(super) fn check(&self, bytes: u64, path: &Path) -> Result<()> {
        let needed = self.taken_bytes.saturating_add(bytes);
        if needed <= self.limit_bytes {
            return Ok(());
        }
        Err(Error::Resources {
            what: format!("loading the scene up to {}", path.display()),
            needed: format!("{} or more of memory", mebibytes(needed)),
            available: format!("only {} are to be had", mebibytes(self.limit_bytes)),
            hint: "give it more, or simplify the geometry and scale the images down".into(),
        })
    }

    /// As [`check`](Self::check), and reserves the bytes.
    pub(super) fn take(&mut self, bytes: u64, path: &Path) -> Result<()> {
        self.check(bytes, path)?;
        self.taken_bytes += bytes;
        Ok(())
    }
}

fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}
