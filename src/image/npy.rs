//! NumPy arrays.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use npyz::WriterBuilder;

use super::LinearImage;
use crate::error::{Error, Result};

/// Writes images of one size as a little-endian f32 array `[images, height, width, 3]`. Panics if there are none.
pub fn write_npy(path: &Path, images: &[LinearImage]) -> Result<()> {
    let shape = [images.len() as u64, images[0].height.into(), images[0].width.into(), 3];
    let write = || -> std::io::Result<()> {
        let mut writer = npyz::WriteOptions::<f32>::new()
            .default_dtype()
            .shape(&shape)
            .writer(BufWriter::new(File::create(path)?))
            .begin_nd()?;
        for image in images {
            writer.extend(image.values().iter().copied())?;
        }
        writer.finish()
    };
    write().map_err(Error::io(path, "write the array"))
}
