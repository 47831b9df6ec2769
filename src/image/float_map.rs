//! Portable float maps.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::ImageFacts;
use super::rgba::{RETURNED_BYTES, RgbaImage};
use crate::error::{Error, Result};
use crate::files::open_input;

/// Longest start of a portable float map that is looked at: four words.
const MAX_HEADER_BYTES: u64 = 128;
/// Longest side, in pixels.
const MAX_SIDE: u64 = 65_536;

/// Whether a file that begins so is a portable float map.
pub(super) fn is_float_map(start: &[u8]) -> bool {
    matches!(start, [b'P', b'F' | b'f', white, ..] if white.is_ascii_whitespace())
}

/// Size, need and notes of a map.
///
/// # Errors
/// Those of [`read`].
pub(super) fn facts(path: &Path) -> Result<ImageFacts> {
    let header = open(path)?.1;
    let (width, height) = (header.width as u32, header.height as u32);
    // The pixels, and a row as the file has it.
    let needs_bytes = u64::from(width) * (u64::from(height) * RETURNED_BYTES + 12);
    let unit = header.scale.abs();
    let is_scaled = unit != 1.0;
    let notes = is_scaled.then(|| format!("its scale of {unit} is left alone: the values are taken as they stand"));
    Ok(ImageFacts { width, height, needs_bytes, is_encoded: false, notes: notes.into_iter().collect() })
}

/// Reads a portable float map (`PF` or `Pf`), whose rows run from the bottom up.
///
/// # Errors
/// A file that cannot be read, is no such map, or is shorter than its header says.
pub(super) fn read(path: &Path) -> Result<RgbaImage> {
    let (mut file, header) = open(path)?;
    let mut pixels = vec![[1.0; 4]; header.width * header.height];
    let mut bytes = vec![0; header.row_bytes()];
    for row in pixels.chunks_exact_mut(header.width).rev() {
        file.read_exact(&mut bytes).map_err(Error::io(path, "read"))?;
        header.decode_row(&bytes, row);
    }
    Ok(RgbaImage {
        width: header.width as u32,
        height: header.height as u32,
        pixels,
        has_alpha: false,
        is_8_bit: false,
        is_encoded: false,
    })
}

fn malformed(path: &Path, problem: String) -> Error {
    Error::input(path.display().to_string(), problem, "write it again as PFM or EXR")
}

/// Opens a portable float map: its header, and a reader of its rows.
fn open(path: &Path) -> Result<(BufReader<File>, FloatMapHead)> {
    let mut file = open_input(path, "open")?;
    let mut start = Vec::new();
    let failed = || Error::io(path, "read");
    Read::by_ref(&mut file).take(MAX_HEADER_BYTES).read_to_end(&mut start).map_err(failed())?;
    let header = FloatMapHead::decode(&start).map_err(|problem| malformed(path, problem))?;
    let length = file.metadata().map_err(failed())?.len();
    let needed = (header.bytes + header.height * header.row_bytes()) as u64;
    if length < needed {
        let problem =
            format!("it is cut short: {} × {} pixels take more than its {length} bytes", header.width, header.height);
        return Err(malformed(path, problem));
    }
    file.seek(SeekFrom::Start(header.bytes as u64)).map_err(failed())?;
    Ok((BufReader::new(file), header))
}

/// The start of a portable float map.
struct FloatMapHead {
    channels: usize,
    width: usize,
    height: usize,
    scale: f32,
    /// Bytes before the values.
    bytes: usize,
}

impl FloatMapHead {
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let mut at = 0;
        let mut word = || {
            let start = at + bytes[at.min(bytes.len())..].iter().take_while(|b| b.is_ascii_whitespace()).count();
            let rest = bytes[start.min(bytes.len())..].iter();
            at = start + rest.take(32).take_while(|b| !b.is_ascii_whitespace()).count();
            std::str::from_utf8(&bytes[start.min(bytes.len())..at.min(bytes.len())]).unwrap_or("")
        };
        let channels = match word() {
            "PF" => 3,
            "Pf" => 1,
            _ => return Err("is not a portable float map".into()),
        };
        let (width, height) = (word().parse::<u64>().unwrap_or(0), word().parse::<u64>().unwrap_or(0));
        let scale: f32 = word().parse().unwrap_or(0.0);
        let is_scale = scale.is_finite() && scale != 0.0;
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) || !is_scale {
            return Err("its header does not say size and scale".into());
        }
        Ok(Self { channels, width: width as usize, height: height as usize, scale, bytes: at + 1 })
    }

    fn row_bytes(&self) -> usize {
        self.width * self.channels * 4
    }

    /// A negative scale says that the lowest byte comes first. One channel is grey.
    fn decode_row(&self, bytes: &[u8], row: &mut [[f32; 4]]) {
        let value =
            |word: &[u8; 4]| if self.scale < 0.0 { f32::from_le_bytes(*word) } else { f32::from_be_bytes(*word) };
        let words = bytes.as_chunks::<4>().0;
        for (pixel, words) in row.iter_mut().zip(words.chunks_exact(self.channels)) {
            *pixel = match words {
                [r, g, b] => [value(r), value(g), value(b), 1.0],
                _ => [value(&words[0]), value(&words[0]), value(&words[0]), 1.0],
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<Vec<[f32; 3]>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.pfm");
        std::fs::write(&path, bytes).unwrap();
        Ok(read(&path)?.pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect())
    }

    #[test]
    fn a_float_map_is_read_from_the_bottom_up() {
        let mut bytes = b"PF\n2 2\n-1.0\n".to_vec();
        (0..12).for_each(|i| bytes.extend((i as f32).to_le_bytes()));
        let image = read_bytes(&bytes).unwrap();
        assert_eq!(image, [[6.0, 7.0, 8.0], [9.0, 10.0, 11.0], [0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
        for length in 0..bytes.len() {
            assert!(read_bytes(&bytes[..length]).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn grey_and_big_endian_float_maps_are_read() {
        let mut bytes = b"Pf\n3 1\n2.5\n".to_vec();
        [1.0f32, -2.0, 0.25].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
        assert_eq!(read_bytes(&bytes).unwrap(), [[1.0; 3], [-2.0; 3], [0.25; 3]]);
        let mut bytes = b"PF 1 1 1 ".to_vec();
        [1.0f32, 2.0, 3.0].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
        assert_eq!(read_bytes(&bytes).unwrap(), [[1.0, 2.0, 3.0]]);
    }

    #[test]
    fn a_float_map_that_claims_more_than_it_holds_is_refused_before_memory_is_taken() {
        for text in ["PF\n65536 65536\n-1\n", "PF 99999999 2 -1\n", "PF\n2 2\nnan\n", "PF\n2 2\n0\n", "P6 1 1 1\n"] {
            assert!(matches!(read_bytes(text.as_bytes()), Err(Error::Input { .. })), "{text}");
        }
    }
}
