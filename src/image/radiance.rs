//! Radiance pictures (RGBE and XYZE).
//!
//! Format: Ward, *Radiance file formats*, chapter "Picture file format (.hdr)". A header of text lines ends with an
//! empty line; then comes a line with the order of the axes. The scanlines follow: each flat, or run-length encoded as
//! of 1985 or as of 1991.

use std::io::{BufRead, Read};
use std::path::Path;

use super::ImageFacts;
use super::primaries::{ColourMatrix, Primaries, converted, xyz_to_rec_709};
use super::rgba::{RETURNED_BYTES, RgbaImage, check_size, refuse};
use crate::error::{Error, Result};

/// Longest line and longest head that are read, in bytes.
const MAX_LINE_BYTES: u64 = 4096;
const MAX_HEAD_BYTES: usize = 1 << 16;
/// Lengths of scanlines that may be encoded component by component.
const NEW_LENGTHS: std::ops::RangeInclusive<usize> = 8..=0x7fff;

/// Direction of an axis in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    /// 0 for X, which runs to the right, 1 for Y, here from the top.
    dimension: usize,
    length: usize,
    /// Whether the file counts against the image's columns or rows.
    is_reversed: bool,
}

/// The header.
#[derive(Clone, Debug)]
struct RadianceHead {
    /// What a stored value is divided by: `EXPOSURE` and `COLORCORR`, each time they stand there.
    divisors: [f64; 3],
    matrix: Option<ColourMatrix>,
    notes: Vec<String>,
    /// The slow axis, then the fast one.
    axes: [Axis; 2],
}

/// Whether a file that begins so is a Radiance picture. Some writers leave the signature out.
pub(super) fn is_radiance(start: &[u8]) -> bool {
    start.starts_with(b"#?") || start.starts_with(b"FORMAT=32-bit_rle_")
}

/// Size, need and notes of a picture.
///
/// # Errors
/// A head that cannot be read, says nothing of the size, or has an exposure that is not above zero.
pub(super) fn facts(path: &Path, file: &mut dyn BufRead) -> Result<ImageFacts> {
    let head = RadianceHead::read(file).map_err(|problem| place(path, problem))?;
    let [width, height] = head.size();
    check_size(path, (width as u64, height as u64))?;
    let needs_bytes = (width * height) as u64 * RETURNED_BYTES + 4 * width.max(height) as u64;
    Ok(ImageFacts { width: width as u32, height: height as u32, needs_bytes, is_encoded: false, notes: head.notes })
}

/// Reads a picture: rows from the top, each from the left, in the unit of the scene.
///
/// # Errors
/// Those of [`facts`]; scanlines that are cut short or run over their end.
pub(super) fn read(path: &Path, file: &mut dyn BufRead) -> Result<RgbaImage> {
    let head = RadianceHead::read(file).map_err(|problem| place(path, problem))?;
    let [width, height] = head.size();
    check_size(path, (width as u64, height as u64))?;
    let mut pixels = vec![[0.0f32; 4]; width * height];
    let [slow, fast] = head.axes;
    let stride = [1, width];
    let offset =
        |axis: Axis, at: usize| stride[axis.dimension] * if axis.is_reversed { axis.length - 1 - at } else { at };
    let mut scanline = vec![[0u8; 4]; fast.length];
    for at in 0..slow.length {
        read_scanline(file, &mut scanline).map_err(|problem| {
            let problem = match problem {
                Scanline::Io(error) => format!("its scanline {at} is cut short ({error})"),
                Scanline::Bad => format!("its scanline {at} of {} is damaged", slow.length),
            };
            place(path, problem)
        })?;
        let row = offset(slow, at);
        for (i, stored) in scanline.iter().enumerate() {
            pixels[row + offset(fast, i)] = head.colour(*stored);
        }
    }
    Ok(RgbaImage {
        width: width as u32,
        height: height as u32,
        pixels,
        has_alpha: false,
        is_8_bit: false,
        is_encoded: false,
    })
}

fn place(path: &Path, problem: String) -> Error {
    refuse(path, &problem)
}

impl RadianceHead {
    fn read(file: &mut dyn BufRead) -> Result<Self, String> {
        let (mut exposure, mut correction, mut bytes) = (1.0f64, [1.0f64; 3], 0);
        let (mut is_xyz, mut primaries) = (false, None);
        loop {
            let line = line(file)?;
            bytes += line.len() + 1;
            if bytes > MAX_HEAD_BYTES {
                return Err("its head does not end".into());
            }
            if line.is_empty() {
                break;
            }
            // Lines of the programs that made the picture are indented.
            let Some((key, value)) = line.split_once('=') else { continue };
            match key {
                "FORMAT" => match value.trim() {
                    "32-bit_rle_rgbe" => is_xyz = false,
                    "32-bit_rle_xyze" => is_xyz = true,
                    other => return Err(format!("its FORMAT {} is not known", other.escape_debug())),
                },
                "EXPOSURE" => {
                    let [one] = factors(value).ok_or_else(|| unusable(&line))?;
                    exposure *= one;
                }
                "COLORCORR" => {
                    let three: [f64; 3] = factors(value).ok_or_else(|| unusable(&line))?;
                    correction = [0, 1, 2].map(|i: usize| correction[i] * three[i]);
                }
                "PRIMARIES" => {
                    let eight: [f64; 8] = numbers(value).ok_or_else(|| unusable(&line))?;
                    primaries = Some(Primaries([0, 2, 4, 6].map(|i: usize| [eight[i], eight[i + 1]])));
                }
                _ => {}
            }
        }
        let divisors = correction.map(|v| v * exposure);
        if !divisors.iter().all(|v| v.is_normal() && (1e-30..1e30).contains(v)) {
            return Err("the product of its exposures is beyond what can be divided out".into());
        }
        let mut notes = Vec::new();
        if exposure != 1.0 {
            notes.push(format!("its EXPOSURE of {} is divided out", exposure as f32));
        }
        if correction != [1.0; 3] {
            let [r, g, b] = correction.map(|v| v as f32);
            notes.push(format!("its COLORCORR of {r} {g} {b} is divided out"));
        }
        let matrix = if is_xyz {
            notes.push("its colours are converted from CIE XYZ to Rec. 709; 1 stays 1, whichever its unit".into());
            Some(xyz_to_rec_709())
        } else {
            let matrix = primaries.map_or(Ok(None), |primaries| primaries.to_rec_709())?;
            if let (Some(primaries), Some(_)) = (primaries, matrix) {
                notes.push(format!("its colours are converted from {} to Rec. 709", primaries.name()));
            }
            matrix
        };
        Ok(Self { divisors, matrix, notes, axes: axes(&line(file)?)? })
    }

    /// Width and height of the image.
    fn size(&self) -> [usize; 2] {
        let [slow, fast] = self.axes;
        if slow.dimension == 0 { [slow.length, fast.length] } else { [fast.length, slow.length] }
    }

    /// Four stored bytes as a colour. The mantissa counts as it is, without the half that rounds it, as most readers have it.
    fn colour(&self, [r, g, b, exponent]: [u8; 4]) -> [f32; 4] {
        if exponent == 0 {
            return [0.0, 0.0, 0.0, 1.0];
        }
        let unit = f64::from(i32::from(exponent) - 136).exp2();
        let colour = [r, g, b].map(|v| f64::from(v) * unit);
        let [r, g, b] = [0, 1, 2].map(|i: usize| (colour[i] / self.divisors[i]) as f32);
        let [r, g, b] = self.matrix.as_ref().map_or([r, g, b], |matrix| converted(matrix, [r, g, b]));
        [r, g, b, 1.0]
    }
}

fn unusable(line: &str) -> String {
    format!("its head has '{}'", line.trim().escape_debug())
}

/// Numbers above zero, which is what can be divided by.
fn factors<const N: usize>(text: &str) -> Option<[f64; N]> {
    numbers(text).filter(|numbers: &[f64; N]| numbers.iter().all(|v| *v > 0.0))
}

/// Parses `N` finite numbers.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().take(N + 1).map(|word| word.parse().ok()).collect();
    let numbers: [f64; N] = numbers?.try_into().ok()?;
    numbers.iter().all(|v| v.is_finite()).then_some(numbers)
}

/// A line without its end, which is LF or CRLF. What is no text is kept as far as it goes.
fn line(file: &mut dyn BufRead) -> Result<String, String> {
    let mut bytes = Vec::new();
    file.take(MAX_LINE_BYTES).read_until(b'\n', &mut bytes).map_err(|e| format!("its head cannot be read ({e})"))?;
    if bytes.pop() != Some(b'\n') {
        return Err("its head is cut short".into());
    }
    if bytes.last() == Some(&b'\r') {
        bytes.pop();
    }
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// `-Y height +X width` and its seven other orders: Y counts upwards in the file, X to the right.
fn axes(line: &str) -> Result<[Axis; 2], String> {
    let words: Vec<&str> = line.split_whitespace().take(5).collect();
    let axis = |name: &str, length: &str| {
        let (dimension, is_reversed) = match name {
            "+X" => (0, false),
            "-X" => (0, true),
            "-Y" => (1, false),
            "+Y" => (1, true),
            _ => return None,
        };
        let length = length.parse::<u32>().ok()? as usize;
        Some(Axis { dimension, length, is_reversed })
    };
    let found = match words.as_slice() {
        [first, length, second, other] => axis(first, length).zip(axis(second, other)),
        _ => None,
    };
    let found = found.filter(|(slow, fast)| slow.dimension != fast.dimension);
    let (slow, fast) = found.ok_or_else(|| format!("its size is '{}'", line.escape_debug()))?;
    Ok([slow, fast])
}

/// Why a scanline cannot be read.
enum Scanline {
    Io(std::io::Error),
    Bad,
}

impl From<std::io::Error> for Scanline {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

fn read_scanline(file: &mut dyn BufRead, scanline: &mut [[u8; 4]]) -> Result<(), Scanline> {
    let mut first = [0; 4];
    file.read_exact(&mut first)?;
    if NEW_LENGTHS.contains(&scanline.len()) && first[0] == 2 && first[1] == 2 && first[2] < 128 {
        if usize::from(first[2]) << 8 | usize::from(first[3]) != scanline.len() {
            return Err(Scanline::Bad);
        }
        return read_components(file, scanline);
    }
    read_pixels(file, first, scanline)
}

/// Each component by itself: a count above 128 repeats a byte, others say how many follow.
fn read_components(file: &mut dyn BufRead, scanline: &mut [[u8; 4]]) -> Result<(), Scanline> {
    let mut bytes = [0; 128];
    for component in 0..4 {
        let mut at = 0;
        while at < scanline.len() {
            let mut count = [0];
            file.read_exact(&mut count)?;
            let (length, is_run) = match count[0] {
                0 => return Err(Scanline::Bad),
                literal @ 1..=128 => (usize::from(literal), false),
                run => (usize::from(run - 128), true),
            };
            let target = scanline.get_mut(at..at + length).ok_or(Scanline::Bad)?;
            let bytes = &mut bytes[..if is_run { 1 } else { length }];
            file.read_exact(bytes)?;
            for (pixel, byte) in target.iter_mut().zip(bytes.iter().cycle()) {
                pixel[component] = *byte;
            }
            at += length;
        }
    }
    Ok(())
}

/// Pixel by pixel, where `1 1 1 n` repeats the one before n times, and one after another such count the bytes of n.
fn read_pixels(file: &mut dyn BufRead, first: [u8; 4], scanline: &mut [[u8; 4]]) -> Result<(), Scanline> {
    let (mut next, mut at, mut shift) = (Some(first), 0, 0u32);
    while at < scanline.len() {
        let mut pixel = [0; 4];
        match next.take() {
            Some(first) => pixel = first,
            None => file.read_exact(&mut pixel)?,
        }
        if let [1, 1, 1, count] = pixel {
            // Four such bytes count more pixels than any scanline has.
            let count = if shift <= 24 { usize::from(count) << shift } else { return Err(Scanline::Bad) };
            let before = *scanline.get(at.wrapping_sub(1)).ok_or(Scanline::Bad)?;
            let end = at.checked_add(count).filter(|end| *end <= scanline.len()).ok_or(Scanline::Bad)?;
            scanline[at..end].fill(before);
            (at, shift) = (end, shift + 8);
        } else {
            scanline[at] = pixel;
            (at, shift) = (at + 1, 0);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<RgbaImage> {
        read(Path::new("a.hdr"), &mut &bytes[..])
    }

    fn flat(head: &str, size: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
        [head.as_bytes(), size.as_bytes(), b"\n", pixels.as_flattened()].concat()
    }

    #[test]
    fn a_run_counts_in_bytes_from_the_lowest() {
        let runs = [[9, 8, 7, 136], [1, 1, 1, 44], [1, 1, 1, 1]];
        let image = read_bytes(&flat("#?RADIANCE\n\n", "-Y 1 +X 301", &runs)).unwrap();
        assert!(image.pixels.iter().all(|p| *p == [9.0, 8.0, 7.0, 1.0]));
        for bad in [
            &[[1, 1, 1, 4]][..],
            &[[9, 8, 7, 136], [1, 1, 1, 255], [1, 1, 1, 255]],
            &[[9, 8, 7, 136]],
            &[[2, 2, 2, 9]],
            &[[9, 8, 7, 136], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 0]],
        ] {
            assert!(read_bytes(&flat("#?RADIANCE\n\n", "-Y 1 +X 301", bad)).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_head_without_end_or_size_is_refused() {
        for head in [
            "#?RADIANCE\n",
            "#?RADIANCE\n\n",
            "#?RADIANCE\n\n-Y 1\n",
            "#?RADIANCE\n\n-Y 1 +Y 1\n",
            "#?RGBE\n\n-Y -1 +X 2\n",
        ] {
            assert!(read_bytes(head.as_bytes()).is_err(), "{head}");
        }
        let long = format!("#?RADIANCE\n{}", "x=y\n".repeat(MAX_HEAD_BYTES));
        assert!(read_bytes(long.as_bytes()).unwrap_err().to_string().contains("does not end"));
    }
}
