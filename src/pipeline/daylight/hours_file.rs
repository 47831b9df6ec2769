//! The hours of all pixels as an array on disk, written block by block.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::{PositionedFile, Replacement, check_free_space};
use crate::image::npy_header;

/// A NumPy array `[pixels, steps]` that is being written.
pub(super) struct HoursFile {
    path: PathBuf,
    file: Replacement,
    header: u64,
    steps: usize,
}

impl HoursFile {
    pub(super) fn begin(path: &Path, [pixels, steps]: [usize; 2], overwrite: bool) -> Result<Self> {
        let header = npy_header(&[pixels, steps]);
        let file = Replacement::begin(path, overwrite)?;
        let failed = || Error::io(path, "write the hours");
        check_free_space(path, (pixels * steps * 4) as u64)?;
        file.file().set_len((header.len() + pixels * steps * 4) as u64).map_err(failed())?;
        file.file().write_all_at(&header, 0).map_err(failed())?;
        Ok(Self { path: path.to_owned(), file, header: header.len() as u64, steps })
    }

    /// Writes some pixels: their lit hours, which are these steps, and zeros between. `at` gives the place of each in the array.
    pub(super) fn write(&self, steps: &[u32], hours: &[f32], at: impl Fn(usize) -> usize) -> Result<()> {
        let mut row = vec![0.0f32; self.steps];
        for (pixel, lit) in hours.chunks_exact(steps.len().max(1)).enumerate() {
            steps.iter().zip(lit).for_each(|(&step, &value)| row[step as usize] = value);
            let bytes: Vec<u8> = row.iter().flat_map(|value| value.to_le_bytes()).collect();
            let offset = self.header + (at(pixel) * self.steps * 4) as u64;
            self.file.file().write_all_at(&bytes, offset).map_err(Error::io(&self.path, "write the hours"))?;
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<()> {
        self.file.finish()
    }
}
