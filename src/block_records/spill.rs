//! Spill file of a pack: the analysed blocks between both passes, in `NAME.spill` beside the result.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::{ContinuationFile, with_suffix};
use crate::resources::Progress;

const MARK: [u8; 8] = *b"LTMspil3";
/// Suffixes of the files of gathered planes and of denoised images.
pub(crate) const GATHERED: &str = ".planes";
/// Records of each block in the first of them.
pub(crate) const GATHERED_PARTS: u32 = 4;
/// See [`GATHERED`].
pub(crate) const DENOISED: &str = ".clean";

/// Path of the spill file of a result.
pub(crate) fn spill_path(result: &Path) -> PathBuf {
    with_suffix(result, ".spill")
}

/// The files that packing into `path` keeps beside it until it is done, with or without denoising.
pub(crate) fn files_of_pack(path: &Path) -> [PathBuf; 4] {
    let of = |name| spill_path(&with_suffix(path, name));
    [spill_path(path), of(GATHERED), of(DENOISED), with_suffix(path, ".part")]
}

/// Opens the spill file of `result`, continuing one of the same `fingerprint`.
///
/// # Errors
/// Those of [`ContinuationFile::open`].
pub(crate) fn open_spill(result: &Path, fingerprint: [u8; 32], keys: u32, overwrite: bool) -> Result<ContinuationFile> {
    ContinuationFile::open(&spill_path(result), MARK, fingerprint, keys, overwrite)
}

/// Removes what a pack into `path` of so many blocks left beside it when it was killed after its last step.
pub(crate) fn remove_leftovers(path: &Path, blocks: u32) {
    for (name, parts) in [("", 1), (GATHERED, GATHERED_PARTS), (DENOISED, 1)] {
        let left = spill_path(&with_suffix(path, name));
        ContinuationFile::remove_leftover(&left, MARK, parts * blocks, path);
    }
}

/// # Errors
/// The program that runs the job says to stop.
pub(crate) fn stop_if_interrupted(path: &Path, watch: &dyn Progress) -> Result<()> {
    if watch.interrupted() {
        let kept = spill_path(path);
        return Err(Error::interrupted_keeping(format!("{} keeps the finished blocks", kept.display())));
    }
    Ok(())
}
