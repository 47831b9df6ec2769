//! Reading images: EXR, HDR and PFM as they are, PNG, JPEG, WebP, TGA and BMP decoded from sRGB.

use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use image::ImageDecoder;

use super::open_exr::{ExrPicture, Window};
use super::rgba::{MAX_SIDE, RETURNED_BYTES, check_size, refuse};
use super::{ImageFacts, LinearImage, RgbaImage, float_map, radiance};
use crate::error::{Error, Result};
use crate::files::open_input;

/// First four bytes of an OpenEXR file.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Bytes of the start of a file by which its format is told.
const MAX_MAGIC_BYTES: u64 = 32;

/// Reads an image, dropping its alpha.
///
/// # Errors
/// Those of [`read_rgba`].
pub fn read_image(path: &Path) -> Result<LinearImage> {
    let RgbaImage { width, height, pixels, .. } = read_rgba(path)?;
    Ok(LinearImage { width, height, pixels: pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect() })
}

/// Reads an image with its alpha. The format is detected from the content, not from the name. An OpenEXR file's image
/// is its display window, black and transparent where it has no pixels.
///
/// # Errors
/// A file that cannot be opened, is no image of a known format, is damaged, has no pixels, or is larger than 16,384 pixels
/// along a side (a portable float map, than 65,536).
pub fn read_rgba(path: &Path) -> Result<RgbaImage> {
    let opened = ImageReader::open(path)?;
    opened.note_of_frame()?;
    opened.read(path, None)
}

/// Size of an image and what reading it takes, without decoding it.
///
/// # Errors
/// Those of [`read_rgba`].
pub fn image_facts(path: &Path) -> Result<ImageFacts> {
    let opened = ImageReader::open(path)?;
    let (mut facts, note) = (opened.facts(path, None)?, opened.note_of_frame()?);
    facts.notes.extend(note);
    Ok(facts)
}

/// An image whose head was read.
pub(super) enum ImageReader {
    Exr(Box<ExrPicture>),
    Hdr(ImageFacts),
    FloatMap(ImageFacts),
    Other(ImageFacts),
}

impl ImageReader {
    /// Looks at a file.
    ///
    /// # Errors
    /// Those of [`read_rgba`].
    pub(super) fn open(path: &Path) -> Result<Self> {
        Ok(match format_of(path)? {
            Format::Exr => Self::Exr(Box::new(ExrPicture::open(path)?)),
            Format::Hdr => Self::Hdr(radiance::facts(path, &mut radiance_file(path)?)?),
            Format::FloatMap => Self::FloatMap(float_map::facts(path)?),
            Format::Other => {
                let size = other_reader(path)?.into_dimensions();
                let (width, height) = size.map_err(|e| refuse(path, &e.to_string()))?;
                Self::Other(decoded_facts(path, (width, height))?)
            }
        })
    }

    /// The windows of its pixels and of the whole frame.
    pub(super) fn windows(&self) -> (Window, Window) {
        match self {
            Self::Exr(picture) => (picture.data, picture.display),
            Self::Hdr(facts) | Self::FloatMap(facts) | Self::Other(facts) => {
                let whole = Window::of_size(facts.width, facts.height);
                (whole, whole)
            }
        }
    }

    /// The facts of a frame of it, by itself the whole picture.
    ///
    /// # Errors
    /// No pixels, or too many.
    pub(super) fn facts(&self, path: &Path, frame: Option<&Window>) -> Result<ImageFacts> {
        match self {
            Self::Exr(picture) => {
                let frame = frame.unwrap_or(&picture.display);
                check_size(path, (frame.width, frame.height))?;
                let (width, height) = (frame.width as u32, frame.height as u32);
                let needs_bytes = picture.needs_bytes(frame);
                Ok(ImageFacts { width, height, needs_bytes, is_encoded: false, notes: picture.notes.clone() })
            }
            Self::Hdr(facts) | Self::FloatMap(facts) | Self::Other(facts) => Ok(facts.clone()),
        }
    }

    fn note_of_frame(&self) -> Result<Option<String>> {
        if let Self::Exr(picture) = self { picture.note_of_frame() } else { Ok(None) }
    }

    /// Whether its values are eight or sixteen bits that are decoded from sRGB.
    pub(super) fn is_encoded(&self) -> bool {
        matches!(self, Self::Other(_))
    }

    /// Reads the pixels of a frame, by itself the whole picture.
    ///
    /// # Errors
    /// Those of [`read_rgba`].
    pub(super) fn read(&self, path: &Path, frame: Option<&Window>) -> Result<RgbaImage> {
        match self {
            Self::Exr(picture) => {
                let frame = frame.unwrap_or(&picture.display);
                check_size(path, (frame.width, frame.height))?;
                picture.read(frame)
            }
            Self::Hdr(_) => radiance::read(path, &mut radiance_file(path)?),
            Self::FloatMap(_) => float_map::read(path),
            Self::Other(_) => {
                let mut reader = other_reader(path)?;
                reader.limits(limits());
                let mut decoder = reader.into_decoder().map_err(|e| refuse(path, &e.to_string()))?;
                decoder.set_limits(limits()).map_err(|e| refuse(path, &e.to_string()))?;
                read_with(path, decoder)
            }
        }
    }
}

/// The facts of an image of this size that a decoder gives in four floats a pixel.
fn decoded_facts(path: &Path, (width, height): (u32, u32)) -> Result<ImageFacts> {
    check_size(path, (width.into(), height.into()))?;
    let needs_bytes = u64::from(width) * u64::from(height) * (RETURNED_BYTES + 16);
    Ok(ImageFacts { width, height, needs_bytes, is_encoded: true, notes: Vec::new() })
}

/// As [`image_facts`] of a PNG, JPEG or WebP file that is in memory; `name` is for messages.
///
/// # Errors
/// Those of [`image_facts`].
pub fn embedded_facts(name: &Path, bytes: &[u8]) -> Result<ImageFacts> {
    let size = embedded_reader(name, bytes)?.into_dimensions();
    decoded_facts(name, size.map_err(|e| refuse(name, &e.to_string()))?)
}

/// As [`read_rgba`] of a PNG, JPEG or WebP file that is in memory; `name` is for messages.
///
/// # Errors
/// Those of [`read_rgba`].
pub fn read_embedded(name: &Path, bytes: &[u8]) -> Result<RgbaImage> {
    embedded_facts(name, bytes)?;
    let mut reader = embedded_reader(name, bytes)?;
    reader.limits(limits());
    let mut decoder = reader.into_decoder().map_err(|e| refuse(name, &e.to_string()))?;
    decoder.set_limits(limits()).map_err(|e| refuse(name, &e.to_string()))?;
    read_with(name, decoder)
}

fn embedded_reader<'a>(name: &Path, bytes: &'a [u8]) -> Result<image::ImageReader<Cursor<&'a [u8]>>> {
    let format = match bytes {
        [0x89, b'P', b'N', b'G', ..] => image::ImageFormat::Png,
        [0xff, 0xd8, ..] => image::ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => image::ImageFormat::WebP,
        _ => return Err(refuse(name, kind_by_name(bytes).unwrap_or("it is neither PNG, JPEG nor WebP"))),
    };
    Ok(image::ImageReader::with_format(Cursor::new(bytes), format))
}

/// What an image that is not read is, where its first bytes say so.
fn kind_by_name(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0xab, b'K', b'T', b'X', ..] => Some("it is KTX"),
        [b'D', b'D', b'S', b' ', ..] => Some("it is DDS"),
        [_, _, _, _, b'f', b't', b'y', b'p', b'a', b'v', b'i', b'f', ..] => Some("it is AVIF"),
        _ => None,
    }
}

/// File formats, detected by content.
enum Format {
    Exr,
    Hdr,
    FloatMap,
    Other,
}

fn format_of(path: &Path) -> Result<Format> {
    let mut start = Vec::new();
    let mut file = open_input(path, "open the image")?;
    Read::by_ref(&mut file).take(MAX_MAGIC_BYTES).read_to_end(&mut start).map_err(Error::io(path, "read the image"))?;
    if start.is_empty() {
        return Err(refuse(path, "it is empty"));
    }
    Ok(match start.as_slice() {
        start if start.starts_with(&EXR_MAGIC) => Format::Exr,
        start if radiance::is_radiance(start) => Format::Hdr,
        start if float_map::is_float_map(start) => Format::FloatMap,
        _ => Format::Other,
    })
}

fn radiance_file(path: &Path) -> Result<BufReader<File>> {
    Ok(BufReader::new(open_input(path, "open the image")?))
}

fn other_reader(path: &Path) -> Result<image::ImageReader<BufReader<File>>> {
    let reader = image::ImageReader::open(path).and_then(|r| r.with_guessed_format());
    let reader = reader.map_err(Error::io(path, "open the image"))?;
    // Where the content tells nothing, the name counts.
    match reader.format().is_some_and(|format| format.reading_enabled()) {
        true => Ok(reader),
        false => {
            let mut bytes = [0; 12];
            // A file too short for its first bytes is of no format.
            let _ = File::open(path).and_then(|mut file| file.read_exact(&mut bytes));
            Err(refuse(path, kind_by_name(&bytes).unwrap_or("it is of no format that is known")))
        }
    }
}

fn limits() -> image::Limits {
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(u64::from(MAX_SIDE).pow(2) * 16);
    limits
}

fn read_with(path: &Path, decoder: impl ImageDecoder) -> Result<RgbaImage> {
    let decoded = image::DynamicImage::from_decoder(decoder).map_err(|e| refuse(path, &e.to_string()))?;
    let has_alpha = decoded.color().has_alpha();
    let is_8_bit = decoded.color().bytes_per_pixel() == decoded.color().channel_count();
    let image = decoded.into_rgba32f();
    let (width, height) = (image.width(), image.height());
    let values = image.into_raw();
    let mut pixels: Vec<[f32; 4]> = match bytemuck::try_cast_vec(values) {
        Ok(pixels) => pixels,
        // Where the room was not given out in whole pixels.
        Err((_, values)) => values.as_chunks::<4>().0.to_vec(),
    };
    pixels.iter_mut().flat_map(|pixel| &mut pixel[..3]).for_each(|value| *value = decode_srgb(*value));
    Ok(RgbaImage { width, height, pixels, has_alpha, is_8_bit, is_encoded: true })
}

/// Inverse of the sRGB transfer function (IEC 61966-2-1).
pub fn decode_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{encode_srgb, write_exr};

    #[test]
    fn srgb_decodes_what_it_encodes() {
        for i in 0..=255 {
            let v = i as f32 / 255.0;
            assert!((encode_srgb(decode_srgb(v)) - v).abs() < 1e-5);
        }
    }

    #[test]
    fn an_exr_comes_back_as_written_whatever_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        let image = LinearImage { width: 3, height: 2, pixels: (0..6).map(|i| [i as f32, 0.5, 7e3]).collect() };
        write_exr(&path, &image).unwrap();
        assert_eq!(read_image(&path).unwrap(), image);
        let facts = image_facts(&path).unwrap();
        assert_eq!((facts.width, facts.height), (3, 2));
        assert!(!read_rgba(&path).unwrap().has_alpha);
    }

    #[test]
    fn a_png_keeps_its_alpha_and_is_made_linear() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.png");
        image::RgbaImage::from_raw(2, 1, vec![255, 188, 0, 255, 0, 0, 0, 64]).unwrap().save(&path).unwrap();
        let read = read_rgba(&path).unwrap();
        assert!(read.has_alpha && read.pixels[0][0] == 1.0 && (read.pixels[0][1] - 0.503).abs() < 1e-3);
        assert!((read.pixels[1][3] - 64.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn both_signatures_of_radiance_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image");
        for signature in ["RGBE", "RADIANCE"] {
            let head = format!("#?{signature}\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n");
            std::fs::write(&path, [head.as_bytes(), &[128, 64, 0, 129, 128, 128, 128, 132]].concat()).unwrap();
            let read = read_image(&path).unwrap();
            assert_eq!(read.pixels, [[1.0, 0.5, 0.0], [8.0; 3]], "{signature}");
        }
    }

    #[test]
    fn what_is_no_image_is_refused_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text.png");
        std::fs::write(&path, "no image").unwrap();
        assert!(read_image(&path).unwrap_err().to_string().contains("text.png"));
        for (name, content, reason) in
            [("empty.exr", "", "is empty"), ("text.exr", "no image", "no format that is known")]
        {
            std::fs::write(folder.path().join(name), content).unwrap();
            let said = read_image(&folder.path().join(name)).unwrap_err().to_string();
            assert!(said.contains(name) && said.contains(reason), "{said}");
        }
        std::fs::write(&path, [EXR_MAGIC.as_slice(), &[2, 0, 0, 0, 9, 9]].concat()).unwrap();
        assert!(read_image(&path).unwrap_err().to_string().contains("text.png"));
        assert!(read_image(&folder.path().join("none.exr")).is_err());
    }
}
