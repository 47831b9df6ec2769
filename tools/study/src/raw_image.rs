//! Images that go to other programs and come back: RGB, little-endian f32, row by row, without a header.

use std::fs;
use std::path::Path;

use ltm::error::{Error, Result};
use ltm::files::write_file;
use ltm::image::LinearImage;

/// Writes one.
pub(super) fn write_f32(path: &Path, image: &LinearImage) -> Result<()> {
    let bytes: Vec<u8> = image.values().iter().flat_map(|value| value.to_le_bytes()).collect();
    write_file(path, true, &bytes)
}

/// Reads one of that size.
///
/// Errors: a file that cannot be read, or of another length.
pub(super) fn read_f32(path: &Path, width: u32, height: u32) -> Result<LinearImage> {
    let bytes = fs::read(path).map_err(Error::io(path, "read"))?;
    let mut image = LinearImage::black(width, height);
    if bytes.len() != size_of_val(image.values()) {
        return Err(Error::input(path.display().to_string(), format!("has {} bytes", bytes.len()), ""));
    }
    let values = bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("4 bytes")));
    image.pixels.as_flattened_mut().iter_mut().zip(values).for_each(|(to, value)| *to = value);
    Ok(image)
}
