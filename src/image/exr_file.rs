//! OpenEXR files.

use std::path::Path;

use super::LinearImage;
use crate::error::{Error, Result};

/// Writes 32-bit linear RGB.
pub fn write_exr(path: &Path, image: &LinearImage) -> Result<()> {
    let width = image.width as usize;
    exr::prelude::write_rgb_file(path, width, image.height as usize, |x, y| {
        let [r, g, b] = image.pixels[y * width + x];
        (r, g, b)
    })
    .map_err(|e| Error::io(path, "write the image")(into_io(e)))
}

fn into_io(error: exr::error::Error) -> std::io::Error {
    match error {
        exr::error::Error::Io(io) => io,
        other => std::io::Error::other(other.to_string()),
    }
}
