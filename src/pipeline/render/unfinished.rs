//! The number of samples of a render that is not finished, kept beside it while it was chosen by an error or a time.

use std::path::{Path, PathBuf};

use super::job_of;
use crate::block_records::{files_of_pack, hex};
use crate::error::{Error, Result};
use crate::files::with_suffix;
use crate::scene::LoadedScene;
use crate::store::{StoreReader, partial_path};
use crate::trace::Tracer;

/// Path of the file with the number of samples of an unfinished render that packs.
pub(crate) fn samples_path(path: &Path) -> PathBuf {
    with_suffix(path, ".samples")
}

/// Writes that file.
pub(crate) fn note_samples(loaded: &LoadedScene, path: &Path) -> Result<()> {
    let text = format!("{} {}", loaded.settings.samples_per_pixel, hex(&job_of(loaded)?.hash().0));
    let path = samples_path(path);
    std::fs::write(&path, text).map_err(Error::io(&path, "write"))
}

/// Removes it when the render is finished.
pub(crate) fn forget_samples(path: &Path) {
    // It does not exist if the number was given.
    let _ = std::fs::remove_file(samples_path(path));
}

/// Sets the samples of the scene to those of an unfinished render to `path`, if there is one of this scene.
pub(crate) fn samples_of_unfinished(loaded: &mut LoadedScene, path: &Path) -> Result<Option<u32>> {
    let before = loaded.settings.samples_per_pixel;
    // A pack that was refused after its pilot has not begun.
    let is_begun = files_of_pack(path).iter().any(|file| file.exists());
    let noted = is_begun.then(|| std::fs::read_to_string(samples_path(path)).ok()).flatten();
    let noted = noted.as_deref().and_then(|text| text.split_once(' ')).and_then(|(samples, hash)| {
        Some((samples.parse().ok().filter(|s| (1..=Tracer::MAX_SAMPLES_PER_PIXEL).contains(s))?, hash.to_owned()))
    });
    let stored = || {
        let unfinished = StoreReader::open(&partial_path(path)).ok()?;
        let job = unfinished.job();
        Some((job.provenance.samples_per_pixel, hex(&job.hash().0)))
    };
    if let Some((samples, hash)) = noted.or_else(stored) {
        loaded.settings.samples_per_pixel = samples;
        if hex(&job_of(loaded)?.hash().0) == hash {
            return Ok(Some(samples));
        }
        loaded.settings.samples_per_pixel = before;
    }
    Ok(None)
}
