//! Reading images: EXR and HDR as they are, PNG, JPEG, WebP, TGA and BMP decoded from sRGB.

use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

use super::LinearImage;
use crate::error::{Error, Result};
use crate::files::open_input;

/// Largest side of an image that is read, in pixels.
const MAX_SIDE: u32 = 16_384;

/// Bytes of a pixel as RGBA, and as RGB where alpha is dropped.
const RETURNED_BYTES: u64 = 16 + 12;

/// First four bytes of an OpenEXR file.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

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
}

/// Reads an image, dropping its alpha.
///
/// # Errors
/// Those of [`read_rgba`].
pub fn read_image(path: &Path) -> Result<LinearImage> {
    let RgbaImage { width, height, pixels, .. } = read_rgba(path)?;
    Ok(LinearImage { width, height, pixels: pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect() })
}

/// Reads an image with its alpha. The format is told from the content, not from the name.
///
/// # Errors
/// A file that cannot be opened, is no image of a known format, is damaged, has no pixels, or is larger than 16,384 pixels
/// along a side.
pub fn read_rgba(path: &Path) -> Result<RgbaImage> {
    let facts = image_facts(path)?;
    match format_of(path)? {
        Format::Exr => read_exr(path, &facts),
        Format::Hdr => read_with(path, hdr_decoder(path)?, true),
        Format::Other => {
            let mut reader = other_reader(path)?;
            reader.limits(limits());
            let mut decoder = reader.into_decoder().map_err(|e| refuse(path, &e.to_string()))?;
            decoder.set_limits(limits()).map_err(|e| refuse(path, &e.to_string()))?;
            read_with(path, decoder, false)
        }
    }
}

/// What an image file says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageFacts {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes of memory that [`read_image`] and [`read_rgba`] take at most, with what they return.
    pub needs_bytes: u64,
}

/// Size of an image and what reading it takes, without decoding it.
///
/// # Errors
/// Those of [`read_rgba`].
pub fn image_facts(path: &Path) -> Result<ImageFacts> {
    let ((width, height), decoder_bytes) = match format_of(path)? {
        Format::Exr => {
            let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|e| refuse(path, &e.to_string()))?;
            let header = meta.headers.iter().find(|header| has_colours(header));
            let header = header.ok_or_else(|| refuse(path, "it has no layer of red, green and blue"))?;
            let chunk_bytes = meta.headers.iter().map(|header| header.max_block_byte_size() as u64).max().unwrap_or(0);
            // The library takes a thread for each core, and two chunks more.
            let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64 + 2;
            let size = header.layer_size;
            ((size.x() as u64, size.y() as u64), chunk_bytes.saturating_mul(5 * threads))
        }
        Format::Hdr => {
            let (width, height) = hdr_decoder(path)?.dimensions();
            let size = (u64::from(width), u64::from(height));
            (size, size.0 * size.1 * 16)
        }
        Format::Other => {
            let size = other_reader(path)?.into_dimensions();
            let (width, height) = size.map_err(|e| refuse(path, &e.to_string()))?;
            let size = (u64::from(width), u64::from(height));
            (size, size.0 * size.1 * 16)
        }
    };
    facts_of(path, (width, height), decoder_bytes)
}

/// The facts of an image of this size. Errors: no pixels, or too many.
fn facts_of(path: &Path, (width, height): (u64, u64), decoder_bytes: u64) -> Result<ImageFacts> {
    let problem = match (width, height) {
        (0, _) | (_, 0) => "the image has no pixels".to_owned(),
        _ if width.max(height) > u64::from(MAX_SIDE) => format!("the image has {width} × {height} pixels"),
        _ => {
            let needs_bytes = (width * height * RETURNED_BYTES).saturating_add(decoder_bytes);
            return Ok(ImageFacts { width: width as u32, height: height as u32, needs_bytes });
        }
    };
    let hint = format!("give one of 1 to {MAX_SIDE} a side");
    Err(Error::input(path.display().to_string(), problem, hint))
}

/// As [`image_facts`] of a PNG, JPEG or WebP file that is in memory; `name` is for messages.
///
/// # Errors
/// Those of [`image_facts`].
pub fn embedded_facts(name: &Path, bytes: &[u8]) -> Result<ImageFacts> {
    let size = embedded_reader(name, bytes)?.into_dimensions();
    let (width, height) = size.map_err(|e| refuse(name, &e.to_string()))?;
    let size = (u64::from(width), u64::from(height));
    facts_of(name, size, size.0 * size.1 * 16)
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
    read_with(name, decoder, false)
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

/// Whether a layer of an OpenEXR file is one that [`read_exr`] takes.
fn has_colours(header: &exr::meta::header::Header) -> bool {
    let has = |colour: &str| header.channels.list.iter().any(|channel| channel.name.eq(colour));
    !header.deep && ["R", "G", "B"].into_iter().all(has)
}

/// Where an image's pixels lie in the frame that its camera saw: the offset of its top left corner, and the frame's size. OpenEXR
/// files may hold a part of the frame only, their data window.
///
/// # Errors
/// Those of [`image_facts`].
pub(super) fn place_in_frame(path: &Path) -> Result<([i64; 2], (u32, u32))> {
    let ImageFacts { width, height, .. } = image_facts(path)?;
    let size = (width, height);
    let Format::Exr = format_of(path)? else { return Ok(([0, 0], size)) };
    let meta = exr::meta::MetaData::read_from_file(path, false).map_err(|e| refuse(path, &e.to_string()))?;
    let header = meta.headers.first().ok_or_else(|| refuse(path, "it has no layers"))?;
    let (corner, frame) = (header.own_attributes.layer_position, header.shared_attributes.display_window);
    let offset = [(corner.0, frame.position.0), (corner.1, frame.position.1)];
    Ok((offset.map(|(at, from)| i64::from(at) - i64::from(from)), (frame.size.0 as u32, frame.size.1 as u32)))
}

enum Format {
    Exr,
    Hdr,
    Other,
}

fn format_of(path: &Path) -> Result<Format> {
    let mut magic = [0; 4];
    let mut file = open_input(path, "open the image")?;
    // A file too short for its magic is left to the decoders to refuse.
    let _ = file.read_exact(&mut magic);
    if file.metadata().is_ok_and(|found| found.len() == 0) {
        return Err(refuse(path, "it is empty"));
    }
    Ok(match magic {
        EXR_MAGIC => Format::Exr,
        [b'#', b'?', ..] => Format::Hdr,
        _ => Format::Other,
    })
}

/// Takes `#?RGBE` for Radiance as well as `#?RADIANCE`, which is all that a strict decoder knows.
fn hdr_decoder(path: &Path) -> Result<HdrDecoder<BufReader<File>>> {
    let file = File::open(path).map_err(Error::io(path, "open the image"))?;
    HdrDecoder::new_nonstrict(BufReader::new(file)).map_err(|e| refuse(path, &e.to_string()))
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

fn refuse(path: &Path, reason: &str) -> Error {
    let reason = reason.lines().next().unwrap_or_default();
    let hint = "give an EXR, HDR, PNG, JPEG, WebP, TGA or BMP image (EXR without DWA compression)";
    Error::input(path.display().to_string(), format!("the image cannot be read ({reason})"), hint)
}

/// Reads the first layer with colours, whose size `facts` are. Every pixel is set, or the file is refused, so that memory
/// is touched no faster than chunks are decoded.
fn read_exr(path: &Path, facts: &ImageFacts) -> Result<RgbaImage> {
    let (width, height) = (facts.width as usize, facts.height as usize);
    let result = exr::prelude::read_first_rgba_layer_from_file(
        path,
        move |size, _| {
            let fits = (size.x(), size.y()) == (width, height);
            if fits { vec![[0.0; 4]; width * height] } else { Vec::new() }
        },
        move |pixels, position, (r, g, b, a): (f32, f32, f32, f32)| {
            if let Some(pixel) = pixels.get_mut(position.y() * width + position.x()) {
                *pixel = [r, g, b, a];
            }
        },
    );
    let channels = result.map_err(|e| refuse(path, &e.to_string()))?.layer_data.channel_data;
    let has_alpha = channels.channels.3.is_some();
    if channels.pixels.len() != width * height {
        return Err(refuse(path, "its layers of red, green and blue differ in size"));
    }
    Ok(RgbaImage { width: facts.width, height: facts.height, pixels: channels.pixels, has_alpha })
}

fn read_with(path: &Path, decoder: impl ImageDecoder, linear: bool) -> Result<RgbaImage> {
    let decoded = image::DynamicImage::from_decoder(decoder).map_err(|e| refuse(path, &e.to_string()))?;
    let has_alpha = decoded.color().has_alpha();
    let decode = |v: f32| if linear { v } else { decode_srgb(v) };
    let image = decoded.into_rgba32f();
    let (width, height) = (image.width(), image.height());
    let values = image.into_raw();
    let mut pixels: Vec<[f32; 4]> = match bytemuck::try_cast_vec(values) {
        Ok(pixels) => pixels,
        // Where the room was not given out in whole pixels.
        Err((_, values)) => values.as_chunks::<4>().0.to_vec(),
    };
    pixels.iter_mut().flat_map(|pixel| &mut pixel[..3]).for_each(|value| *value = decode(*value));
    Ok(RgbaImage { width, height, pixels, has_alpha })
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
