//! Images that wait on disk, between a stage that makes them piece by piece and one that wants them in another order.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::{PositionedFile, folder_of};
use crate::matrix::CHANNELS;

/// Images of one size in a file without a name, plane by plane, in 32-bit floats. Any thread may read and write; what was
/// never written is 0.
#[derive(Debug)]
pub(super) struct RowSpill {
    file: File,
    folder: PathBuf,
    width: usize,
    height: usize,
}

/// Where a piece of a row begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowPlace {
    pub(super) image: usize,
    pub(super) channel: usize,
    pub(super) y: usize,
    pub(super) x: usize,
}

impl RowSpill {
    /// Room for images of `width × height`, in the folder of `beside`, where the disk is meant to hold results.
    pub(super) fn create(beside: &Path, images: usize, width: usize, height: usize) -> Result<Self> {
        let folder = folder_of(beside).to_owned();
        let file = tempfile::tempfile_in(&folder);
        let file = file.map_err(Error::io(&folder, "create a temporary file in the folder"))?;
        file.set_len(Self::bytes(images, width, height))
            .map_err(Error::io(&folder, "make room for a temporary file in the folder"))?;
        Ok(Self { file, folder, width, height })
    }

    /// Disk that so many images take.
    pub(super) fn bytes(images: usize, width: usize, height: usize) -> u64 {
        [CHANNELS, width, height, 4].iter().fold(images as u64, |bytes, &side| bytes.saturating_mul(side as u64))
    }

    /// Writes a piece of a row.
    pub(super) fn write(&self, place: RowPlace, values: &[f32]) -> Result<()> {
        let bytes = bytemuck::cast_slice(values);
        self.file
            .write_all_at(bytes, self.offset(place))
            .map_err(Error::io(&self.folder, "write a temporary file in the folder"))
    }

    /// Reads a piece of a row.
    pub(super) fn read(&self, place: RowPlace, values: &mut [f32]) -> Result<()> {
        let bytes = bytemuck::cast_slice_mut(values);
        self.file
            .read_exact_at(bytes, self.offset(place))
            .map_err(Error::io(&self.folder, "read a temporary file in the folder"))
    }

    fn offset(&self, RowPlace { image, channel, y, x }: RowPlace) -> u64 {
        debug_assert!(channel < CHANNELS && y < self.height && x <= self.width);
        ((((image * CHANNELS + channel) * self.height + y) * self.width + x) * 4) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_come_back_as_rows() {
        let folder = tempfile::tempdir().unwrap();
        let spill = RowSpill::create(&folder.path().join("x"), 2, 5, 3).unwrap();
        spill.write(RowPlace { image: 1, channel: 2, y: 2, x: 3 }, &[4.0, 5.0]).unwrap();
        spill.write(RowPlace { image: 1, channel: 2, y: 2, x: 0 }, &[1.0, 2.0]).unwrap();
        let mut row = [9.0; 5];
        spill.read(RowPlace { image: 1, channel: 2, y: 2, x: 0 }, &mut row).unwrap();
        assert_eq!(row, [1.0, 2.0, 0.0, 4.0, 5.0]);
        spill.read(RowPlace { image: 0, channel: 0, y: 0, x: 0 }, &mut row).unwrap();
        assert_eq!(row, [0.0; 5]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the file has no name");
    }
}
