//! NumPy arrays.

use std::path::Path;

use npyz::WriterBuilder;

use super::{FetchRow, ImageSize};
use crate::error::{Error, Result};
use crate::files::replace;

/// Writes `images` images as a little-endian f32 array `[images, height, width, 3]`, asking `fetch` for one row of one
/// channel after the other. `overwrite`: a file of that name is replaced, whole.
///
/// # Errors
/// The file exists and may not be replaced; the system refuses to write; those of `fetch`. Then the old file stands.
pub fn write_npy(path: &Path, overwrite: bool, images: usize, size: ImageSize, fetch: &mut FetchRow<'_>) -> Result<()> {
    let failed = || Error::io(path, "write the array");
    let shape = [images as u64, size.height as u64, size.width as u64, 3];
    replace(path, overwrite, |file| {
        let options = npyz::WriteOptions::<f32>::new().default_dtype().shape(&shape);
        let mut writer = options.writer(file).begin_nd().map_err(failed())?;
        let mut rows = [0, 1, 2].map(|_| vec![0.0; size.width]);
        for image in 0..images {
            for y in 0..size.height {
                for (channel, row) in rows.iter_mut().enumerate() {
                    fetch(image, channel, y, row)?;
                }
                let [red, green, blue] = &rows;
                let pixels = red.iter().zip(green).zip(blue).flat_map(|((&r, &g), &b)| [r, g, b]);
                writer.extend(pixels).map_err(failed())?;
            }
        }
        writer.finish().map_err(failed())
    })
}
