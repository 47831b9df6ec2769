//! Pictures side by side with captions, and error maps.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use plotters::prelude::*;

use super::chart::use_font;
use super::flip::Flip;
use super::measured::{displayed, exposure_of};
use ltm::error::{Error, Result};
use ltm::image::LinearImage;

/// Height of a caption, and the gap between pictures, in pixels.
const CAPTION: u32 = 24;
const GAP: u32 = 6;

/// Of JPEG: nothing of what it changes is seen.
const QUALITY: u8 = 90;

/// 8-bit sRGB pixels.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    width: u32,
    height: u32,
    bytes: Vec<u8>,
    caption: String,
}

impl Picture {
    /// An image as the reference is exposed.
    pub(super) fn shown(image: &LinearImage, reference: &LinearImage, caption: impl Into<String>) -> Self {
        let bytes = displayed(image, exposure_of(reference));
        Self { width: image.width, height: image.height, bytes, caption: caption.into() }
    }

    /// The ꟻLIP error map of an image, black (0) over red to white (1).
    pub(super) fn error(image: &LinearImage, reference: &LinearImage, caption: impl Into<String>) -> Self {
        let exposure = exposure_of(reference);
        let bytes = Flip::new(image, reference, |image| displayed(image, exposure)).coloured();
        Self { width: image.width, height: image.height, bytes, caption: caption.into() }
    }
}

/// Writes rows of pictures of one size as PNG or, where the name says `.jpg`, as JPEG, each pixel `scale` pixels wide.
pub(super) fn write(path: &Path, rows: &[Vec<Picture>], scale: u32) -> Result<()> {
    use_font();
    let across = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let Some(first) = rows.first().and_then(|row| row.first()) else { return Ok(()) };
    let cell = (first.width * scale + GAP, first.height * scale + CAPTION);
    let (width, height) = (cell.0 * across + GAP, cell.1 * rows.len() as u32 + GAP);
    let mut canvas = vec![255u8; (width * height * 3) as usize];
    for (row, pictures) in rows.iter().enumerate() {
        for (column, picture) in pictures.iter().enumerate() {
            let (left, top) = (GAP + column as u32 * cell.0, row as u32 * cell.1 + CAPTION);
            for y in 0..picture.height * scale {
                for x in 0..picture.width * scale {
                    let from = 3 * ((y / scale) * picture.width + x / scale) as usize;
                    let to = 3 * ((top + y) * width + left + x) as usize;
                    canvas[to..to + 3].copy_from_slice(&picture.bytes[from..from + 3]);
                }
            }
        }
    }
    let mut draw = || -> Result<(), Box<dyn std::error::Error>> {
        let area = BitMapBackend::with_buffer(&mut canvas, (width, height)).into_drawing_area();
        let style = ("sans-serif", 15).into_text_style(&area);
        for (row, pictures) in rows.iter().enumerate() {
            for (column, picture) in pictures.iter().enumerate() {
                let place = ((GAP + column as u32 * cell.0) as i32, (row as u32 * cell.1) as i32 + 5);
                area.draw_text(&picture.caption, &style, place).map_err(|e| e.to_string())?;
            }
        }
        Ok(())
    };
    draw().map_err(|problem| Error::input(path.display().to_string(), format!("cannot be drawn ({problem})"), ""))?;
    let pixels = image::RgbImage::from_raw(width, height, canvas).expect("three bytes a pixel");
    let mut file = std::fs::File::create(path).map_err(Error::io(path, "create the picture"))?;
    let written = if path.extension().is_some_and(|extension| extension == "jpg") {
        pixels.write_with_encoder(JpegEncoder::new_with_quality(&mut file, QUALITY))
    } else {
        pixels.write_to(&mut std::io::BufWriter::new(file), image::ImageFormat::Png)
    };
    written.map_err(|e| Error::io(path, "write the pictures")(std::io::Error::other(e)))
}
