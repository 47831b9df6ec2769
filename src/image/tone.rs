//! From linear radiance to a display.

use std::path::Path;

use super::LinearImage;
use super::measure::percentile;
use crate::error::{Error, Result};

/// The sRGB transfer function (IEC 61966-2-1) of a linear value, clamped to [0, 1].
pub fn encode_srgb(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Writes an 8-bit sRGB PNG, exposed so that the 95th luminance percentile maps to `white`.
pub fn write_png(path: &Path, image: &LinearImage, white: f32) -> Result<()> {
    let exposure = white / percentile(image.luminances().collect(), 0.95).max(1e-12);
    let bytes = image.values().iter().map(|v| (encode_srgb(v * exposure) * 255.0 + 0.5) as u8).collect();
    image::RgbImage::from_raw(image.width, image.height, bytes)
        .expect("one byte per channel value")
        .save_with_format(path, image::ImageFormat::Png)
        .map_err(|e| match e {
            image::ImageError::IoError(io) => Error::io(path, "write the image")(io),
            other => Error::io(path, "write the image")(std::io::Error::other(other)),
        })
}
