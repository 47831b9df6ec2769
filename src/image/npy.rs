//! NumPy arrays: reading the header of a file, and writing a file.
//!
//! Format: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>. The header is a Python dictionary
//! with three keys. It is parsed here without recursion and with a bound on its length, since a general parser of
//! Python literals may take unbounded time or stack on a few dozen forged bytes.

use std::io::{BufWriter, Read, Write};
use std::path::Path;

use super::{FetchRow, ImageSize};
use crate::error::{Error, Result};
use crate::files::replace;

/// First bytes of an NPY file, before its version.
const MAGIC: [u8; 6] = *b"\x93NUMPY";
/// Longest header that is read, as NumPy's own default; what images need is below 128 bytes.
const MAX_HEADER_BYTES: usize = 10_000;
/// Most dimensions of an array, as in NumPy.
const MAX_DIMENSIONS: usize = 64;
/// Multiple of bytes at which the values begin.
const ALIGNMENT: usize = 64;

/// The header of an NPY file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NpyHeader {
    /// Type of a value as NumPy writes it, for example `<f4`.
    pub(super) descr: String,
    /// Whether the first index varies fastest.
    pub(super) fortran_order: bool,
    /// Length of each dimension.
    pub(super) shape: Vec<u64>,
    /// Bytes of the file before the values.
    pub(super) bytes: u64,
}

impl NpyHeader {
    /// Reads the start of an NPY file, up to the first value.
    ///
    /// # Errors
    /// As text for the caller to place: no NPY file, another version than 1 to 3, a header that is too long, cut short or
    /// no dictionary of the three keys.
    pub(super) fn read(reader: &mut dyn Read) -> Result<Self, String> {
        let cut_short = |e: std::io::Error| format!("its header is cut short ({e})");
        let mut start = [0; 8];
        reader.read_exact(&mut start).map_err(cut_short)?;
        if start[..6] != MAGIC {
            return Err("is not a NumPy array".into());
        }
        let (length, before) = match start[6] {
            1 => {
                let mut length = [0; 2];
                reader.read_exact(&mut length).map_err(cut_short)?;
                (usize::from(u16::from_le_bytes(length)), 10)
            }
            2 | 3 => {
                let mut length = [0; 4];
                reader.read_exact(&mut length).map_err(cut_short)?;
                (u32::from_le_bytes(length) as usize, 12)
            }
            version => return Err(format!("has version {version} of the NumPy format, not 1 to 3")),
        };
        if length > MAX_HEADER_BYTES {
            return Err(format!("its header has {length} bytes, more than {MAX_HEADER_BYTES}"));
        }
        let mut text = vec![0; length];
        reader.read_exact(&mut text).map_err(cut_short)?;
        let text = std::str::from_utf8(&text).map_err(|_| "its header is no text")?;
        parse_header(text, (before + length) as u64)
    }

    /// Number of values; none where it is beyond 2⁶⁴.
    pub(super) fn values(&self) -> Option<u64> {
        self.shape.iter().try_fold(1u64, |product, &side| product.checked_mul(side))
    }
}

/// A header of `{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }`, before values that begin at byte `bytes`.
fn parse_header(text: &str, bytes: u64) -> Result<NpyHeader, String> {
    let malformed = || "its header is not that of a plain array".to_owned();
    let mut rest = text.trim().strip_prefix('{').ok_or_else(malformed)?.trim_start();
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    while !rest.starts_with('}') {
        let (key, after) = quoted(rest).ok_or_else(malformed)?;
        let value = after.trim_start().strip_prefix(':').ok_or_else(malformed)?.trim_start();
        rest = match key {
            "descr" if value.starts_with('[') => return Err("its array is a structured one".into()),
            "descr" => {
                let (value, after) = quoted(value).ok_or_else(malformed)?;
                descr = Some(value.to_owned());
                after
            }
            "fortran_order" => {
                let word = if value.starts_with("True") { "True" } else { "False" };
                fortran_order = Some(word == "True");
                value.strip_prefix(word).ok_or_else(malformed)?
            }
            "shape" => {
                let (inside, after) = value.strip_prefix('(').and_then(|v| v.split_once(')')).ok_or_else(malformed)?;
                shape = Some(lengths(inside).ok_or_else(malformed)?);
                after
            }
            _ => return Err(malformed()),
        };
        rest = rest.trim_start();
        match rest.strip_prefix(',') {
            Some(after) => rest = after.trim_start(),
            None if rest.starts_with('}') => {}
            None => return Err(malformed()),
        }
    }
    match (descr, fortran_order, shape, rest[1..].trim()) {
        (Some(descr), Some(fortran_order), Some(shape), "") => Ok(NpyHeader { descr, fortran_order, shape, bytes }),
        _ => Err(malformed()),
    }
}

/// A text in single or double quotes at the start, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    let (inside, after) = text[1..].split_once(quote)?;
    (!inside.contains('\\')).then_some((inside, after))
}

/// The numbers of a tuple; Python 2 wrote an `L` behind long ones.
fn lengths(inside: &str) -> Option<Vec<u64>> {
    let inside = inside.trim();
    let inside = inside.strip_suffix(',').unwrap_or(inside);
    if inside.is_empty() {
        return Some(Vec::new());
    }
    let number = |word: &str| word.trim().trim_end_matches('L').parse().ok();
    inside
        .split(',')
        .take(MAX_DIMENSIONS + 1)
        .map(number)
        .collect::<Option<Vec<u64>>>()
        .filter(|shape| shape.len() <= MAX_DIMENSIONS)
}

/// Writes `images` images as a little-endian f32 array `[images, height, width, 3]`, asking `fetch` for one row of one
/// channel after the other. `overwrite`: a file of that name is replaced, whole.
///
/// # Errors
/// The file exists and may not be replaced; the system refuses to write; those of `fetch`. Then the old file stands.
pub fn write_npy(path: &Path, overwrite: bool, images: usize, size: ImageSize, fetch: &mut FetchRow<'_>) -> Result<()> {
    let failed = || Error::io(path, "write the array");
    replace(path, overwrite, |file| {
        let mut writer = BufWriter::new(file);
        writer.write_all(&npy_header(&[images, size.height, size.width, 3])).map_err(failed())?;
        let mut rows = [0, 1, 2].map(|_| vec![0.0f32; size.width]);
        for image in 0..images {
            for y in 0..size.height {
                for (channel, row) in rows.iter_mut().enumerate() {
                    fetch(image, channel, y, row)?;
                }
                let [red, green, blue] = &rows;
                for ((red, green), blue) in red.iter().zip(green).zip(blue) {
                    let pixel = [red, green, blue].map(|value| value.to_le_bytes());
                    writer.write_all(pixel.as_flattened()).map_err(failed())?;
                }
            }
        }
        writer.flush().map_err(failed())
    })
}

/// Writes values as a little-endian f32 array of this shape, the last dimension fastest. `overwrite`: a file of that name is
/// replaced, whole.
///
/// # Errors
/// The file exists and may not be replaced; the system refuses to write. Then the old file stands.
pub fn write_npy_values(
    path: &Path,
    overwrite: bool,
    shape: &[usize],
    values: impl Iterator<Item = f32>,
) -> Result<()> {
    let failed = || Error::io(path, "write the array");
    replace(path, overwrite, |writer| {
        writer.write_all(&npy_header(shape)).map_err(failed())?;
        values.map(f32::to_le_bytes).try_for_each(|bytes| writer.write_all(&bytes)).map_err(failed())
    })
}

/// Magic, version 1.0 and header of a C-ordered array of little-endian f32.
pub fn npy_header(shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.join(", "));
    // The header ends with a line end where the values begin.
    let length = (10 + text.len() + 1).next_multiple_of(ALIGNMENT) - 10;
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{text:<width$}\n", width = length - 1).bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<NpyHeader, String> {
        let mut bytes = [MAGIC.as_slice(), &[1, 0]].concat();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.bytes());
        NpyHeader::read(&mut bytes.as_slice())
    }

    #[test]
    fn headers_come_back_as_written() {
        let bytes = npy_header(&[3, 24, 40, 3]);
        let header = NpyHeader::read(&mut bytes.as_slice()).unwrap();
        assert_eq!(
            (header.descr.as_str(), header.fortran_order, header.shape.as_slice()),
            ("<f4", false, &[3, 24, 40, 3][..])
        );
        assert!(bytes.len().is_multiple_of(ALIGNMENT) && bytes.len() as u64 == header.bytes);
    }

    #[test]
    fn headers_of_other_writers_are_read() {
        let header = read("{\"shape\" : (2L,3 , ), 'fortran_order':True,'descr':'>f8'}  \n").unwrap();
        assert_eq!((header.descr.as_str(), header.fortran_order, header.shape.as_slice()), (">f8", true, &[2, 3][..]));
        assert_eq!(read("{'descr': '|b1', 'fortran_order': False, 'shape': (), }").unwrap().values(), Some(1));
    }

    #[test]
    fn forged_headers_are_refused_at_once() {
        let long_shape = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", "1,".repeat(4000));
        for text in [
            "{".repeat(20),
            "{".repeat(4000),
            "(".repeat(9000),
            "{'descr': [('a', '<f4', (1, 1))], 'fortran_order': False, 'shape': (1,), }".into(),
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)".into(),
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }".into(),
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }".into(),
            "{'descr': '<f4', 'fortran_order': False, }".into(),
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), } x".into(),
            "{'descr': '<f4', 'fortran_order': Maybe, 'shape': (1,), }".into(),
            "é".into(),
            String::new(),
            long_shape,
        ] {
            assert!(read(&text).is_err(), "{text:.40}");
        }
        let huge = read("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296, 2), }").unwrap();
        assert_eq!(huge.values(), None);
        // A length that the version-2 header claims is not allocated.
        let bytes = [MAGIC.as_slice(), &[2, 0, 0xff, 0xff, 0xff, 0xff]].concat();
        assert!(NpyHeader::read(&mut bytes.as_slice()).unwrap_err().contains("more than"));
    }
}
