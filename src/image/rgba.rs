//! A decoded image with alpha, and the bounds of what is decoded.

use std::path::Path;

use crate::error::{Error, Result};

/// Largest side of an image that is read, in pixels.
pub(super) const MAX_SIDE: u32 = 16_384;

/// Bytes of a pixel as RGBA, and as RGB where alpha is dropped.
pub(super) const RETURNED_BYTES: u64 = 16 + 12;

/// `width × height` linear Rec. 709 RGBA pixels, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbaImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, row by row; alpha is 1 where the file has none.
    pub pixels: Vec<[f32; 4]>,
    /// Whether the file has an alpha channel.
    pub has_alpha: bool,
    /// Whether the file's values are eight bits, of colours by sRGB's curve: then no value is lost by storing these.
    pub is_8_bit: bool,
    /// Whether its values were decoded from sRGB's curve.
    pub is_encoded: bool,
}

/// Properties of an image file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageFacts {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes of memory that [`read_image`](super::read_image) and [`read_rgba`](super::read_rgba) take at most, with what they return.
    pub needs_bytes: u64,
    /// Whether its values are encoded by sRGB's curve, in eight or sixteen bits; otherwise they are floats.
    pub is_encoded: bool,
    /// What is done to its values or chosen among them that could surprise, one line each, for people: "its EXPOSURE of 2 is
    /// divided out".
    pub notes: Vec<String>,
}

/// Errors: no pixels, or too many.
pub(super) fn check_size(path: &Path, (width, height): (u64, u64)) -> Result<()> {
    let problem = match (width, height) {
        (0, _) | (_, 0) => "the image has no pixels".to_owned(),
        _ if width.max(height) > u64::from(MAX_SIDE) => format!("the image has {width} × {height} pixels"),
        _ => return Ok(()),
    };
    let hint = format!("give one of 1 to {MAX_SIDE} a side");
    Err(Error::input(path.display().to_string(), problem, hint))
}

pub(super) fn refuse(path: &Path, reason: &str) -> Error {
    let reason = reason.lines().next().unwrap_or_default();
    let hint = "give an EXR (of no, RLE, ZIP, PIZ, PXR24, B44 or DWA compression), HDR, PFM, PNG, JPEG, WebP, TGA or BMP image";
    Error::input(path.display().to_string(), format!("the image cannot be read ({reason})"), hint)
}
