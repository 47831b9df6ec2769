//! Where a file grows and what it is called when it is finished.

use std::path::{Path, PathBuf};

use crate::error::{Error, Hint, Result};
use crate::files::{self, ContinuationFile, with_suffix};

const ORIGIN_MARK: [u8; 8] = *b"LTMorig1";

/// Under which names the file grows and stands.
pub(super) struct StorePaths {
    /// The file that is written, for messages too.
    pub(super) grows: PathBuf,
    /// Its name when finished; `None` where it stands in its place already.
    pub(super) becomes: Option<PathBuf>,
    /// Whether a finished file of that name may be replaced.
    pub(super) overwrite: bool,
    /// Whether the file is to be removed when dropped: nobody would continue a file without blocks.
    pub(super) remove_if_empty: bool,
    /// Says beside a growing file where its blocks come from, if the job does not.
    pub(super) origin: Option<ContinuationFile>,
}

/// The name under which a file grows: `NAME.part` beside it.
pub fn partial_path(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}

/// As [`files::check_output`], for a matrix. If the finished file exists, removes the leftovers of a process that was
/// killed right after it had renamed it.
///
/// # Errors
/// Those of [`files::check_output`].
pub fn check_output(path: &Path, overwrite: bool) -> Result<()> {
    let checked = files::check_output(path, overwrite);
    let partial = partial_path(path);
    if checked.is_err() && path.is_file() && !partial.exists() {
        ContinuationFile::remove_leftover(&with_suffix(&partial, ".origin"), ORIGIN_MARK, 1, path);
    }
    checked
}

impl StorePaths {
    /// For storages that are not files.
    pub(super) fn unnamed() -> Self {
        Self { grows: "(storage)".into(), becomes: None, overwrite: true, remove_if_empty: false, origin: None }
    }
}

/// Checks that the partial file of `path`, if there is one, holds blocks of this origin, and stores the origin in
/// `NAME.part.origin`. With `anew` the partial file is about to be begun again, whatever it holds.
///
/// # Errors
/// The partial file is of another origin; another process is writing it; the folder cannot be written.
pub(super) fn claim_origin(path: &Path, origin: Option<[u8; 32]>, anew: bool) -> Result<Option<ContinuationFile>> {
    let partial = partial_path(path);
    let note = with_suffix(&partial, ".origin");
    // A note without its file was left by a process that was killed while it began or ended.
    let anew = anew || !partial.exists();
    let refuse = || {
        let problem = "keeps blocks that were made in another way";
        Err(Error::input(partial.display().to_string(), problem, Hint::BeginAnew))
    };
    match origin {
        None if !note.exists() => Ok(None),
        None if !anew => refuse(),
        None => {
            ContinuationFile::open(&note, ORIGIN_MARK, [0; 32], 1, true)?.remove()?;
            Ok(None)
        }
        Some(_) if !anew && !note.exists() => refuse(),
        Some(origin) => {
            let note = ContinuationFile::open(&note, ORIGIN_MARK, origin, 1, anew)?;
            if !note.has(0) {
                note.append(0, &[])?;
            }
            Ok(Some(note))
        }
    }
}
