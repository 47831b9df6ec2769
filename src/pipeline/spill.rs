//! Spill file of a pack: the analysed blocks between both passes, in `NAME.spill` beside the result.

use std::path::{Path, PathBuf};

use crate::container::ContainerReader;
use crate::error::Result;
use crate::files::{ContinuationFile, check_output, with_suffix};

const MARK: [u8; 8] = *b"LTMspil2";
/// Suffixes of the files of gathered planes and of denoised images.
pub(super) const GATHERED: &str = ".planes";
/// See [`GATHERED`].
pub(super) const CLEANED: &str = ".clean";

/// Path of the spill file of a result.
pub(super) fn spill_path(result: &Path) -> PathBuf {
    with_suffix(result, ".spill")
}

/// The files that packing into `path` keeps beside it until it is done, with or without denoising.
pub(super) fn files_of_pack(path: &Path) -> [PathBuf; 4] {
    let of = |name| spill_path(&with_suffix(path, name));
    [spill_path(path), of(GATHERED), of(CLEANED), with_suffix(path, ".part")]
}

/// Opens the spill file of `result`, continuing one of the same `fingerprint`.
///
/// # Errors
/// Those of [`ContinuationFile::open`].
pub(super) fn open_spill(
    result: &Path,
    fingerprint: [u8; 32],
    blocks: u32,
    overwrite: bool,
) -> Result<ContinuationFile> {
    ContinuationFile::open(&spill_path(result), MARK, fingerprint, blocks, overwrite)
}

/// Refuses a container that exists, as [`check_output`] does. Removes temporary files of a pack that was killed after
/// its last step.
///
/// # Errors
/// Those of [`check_output`].
pub fn check_container_output(path: &Path, overwrite: bool) -> Result<()> {
    let checked = check_output(path, overwrite);
    if checked.is_err()
        && let Ok(container) = ContainerReader::open(path)
    {
        container.remove_leftover();
        for name in ["", GATHERED, CLEANED] {
            let left = spill_path(&with_suffix(path, name));
            ContinuationFile::remove_leftover(&left, MARK, container.job().shape.block_count(), path);
        }
    }
    checked
}
