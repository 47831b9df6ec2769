//! Sets of per-light images: a file for each light, portable float maps, NumPy arrays.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use super::light_layers::{LayerMatch, LayerRole, LightImage, LightImages, capture};
use super::{LinearImage, read_image};
use crate::error::{Error, Result};

/// Largest number of values of an array that is read: 16 GiB in f32.
const MAX_VALUES: u64 = 1 << 32;
const MAX_SIDE: u64 = 65_536;

/// Reads a file for each light: those of the folder of `pattern` whose names match its last part, with `{light}` in the
/// light's place and `*` for anything. EXR, HDR, PFM, and what `read_image` knows.
///
/// Errors: a folder that cannot be read, no file that matches, a file that cannot be read, different sizes.
pub fn read_light_files(pattern: &Path) -> Result<LightImages> {
    let place = || pattern.display().to_string();
    let folder = pattern.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = pattern.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    if !name.contains("{light}") {
        return Err(Error::input(
            place(),
            "the file name has no {light}",
            "write for example renders/room_{light}.exr",
        ));
    }
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
    let mut files: Vec<_> =
        entries.filter_map(|e| e.ok()).map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    files.sort();
    let mut found = LightImages::default();
    for file in files {
        let role = match capture(&name, &file) {
            Some(light) => {
                let path = folder.join(&file);
                let is_pfm = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pfm"));
                let image = if is_pfm { read_pfm(&path)? } else { read_image(&path)? };
                found.lights.push(LightImage { name: light.clone(), image });
                LayerRole::Light(light)
            }
            None => LayerRole::Ignored,
        };
        found.matches.push(LayerMatch { layer: file, role });
    }
    found.check(pattern)?;
    Ok(found)
}

/// Reads a portable float map (`PF` or `Pf`), whose rows run from the bottom up.
///
/// Errors: a file that cannot be read, is no such map, or is shorter than its header says.
pub fn read_pfm(path: &Path) -> Result<LinearImage> {
    let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
    decode_pfm(&bytes)
        .map_err(|problem| Error::input(path.display().to_string(), problem, "write it again as PFM or EXR"))
}

fn decode_pfm(bytes: &[u8]) -> Result<LinearImage, String> {
    let mut at = 0;
    let mut word = || {
        let start = at + bytes[at.min(bytes.len())..].iter().take_while(|b| b.is_ascii_whitespace()).count();
        let length = bytes[start.min(bytes.len())..].iter().take(32).take_while(|b| !b.is_ascii_whitespace()).count();
        at = start + length;
        std::str::from_utf8(&bytes[start.min(bytes.len())..at.min(bytes.len())]).unwrap_or("")
    };
    let channels = match word() {
        "PF" => 3,
        "Pf" => 1,
        _ => return Err("is not a portable float map".into()),
    };
    let (width, height) = (word().parse::<u64>().unwrap_or(0), word().parse::<u64>().unwrap_or(0));
    let scale: f32 = word().parse().unwrap_or(0.0);
    let body = bytes.get(at + 1..).unwrap_or(&[]);
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) || scale == 0.0 {
        return Err("its header does not say size and scale".into());
    }
    if (body.len() as u64) < width * height * channels * 4 {
        return Err(format!("it is cut short: {width} × {height} pixels take more than its {} bytes", body.len()));
    }
    let value = |i: usize| {
        let word = body[4 * i..4 * i + 4].try_into().expect("4 bytes");
        if scale < 0.0 { f32::from_le_bytes(word) } else { f32::from_be_bytes(word) }
    };
    let (width, height, channels) = (width as usize, height as usize, channels as usize);
    let mut pixels = Vec::with_capacity(width * height);
    for y in (0..height).rev() {
        for x in 0..width {
            let at = (y * width + x) * channels;
            pixels.push(if channels == 3 { [value(at), value(at + 1), value(at + 2)] } else { [value(at); 3] });
        }
    }
    Ok(LinearImage { width: width as u32, height: height as u32, pixels })
}

/// Reads an array `[lights, height, width, 3]` from an NPY file, or `images` and optionally `lights` (names) from an
/// NPZ file.
///
/// Errors: a file that cannot be read, an array of another shape or type than f16, f32 or f64, names of another number.
pub fn read_light_array(path: &Path) -> Result<LightImages> {
    let refuse = |problem: String| {
        Error::input(path.display().to_string(), problem, "save it as float32 [lights, height, width, 3]")
    };
    let failed = |e: std::io::Error| refuse(e.to_string());
    let mut names: Option<Vec<String>> = None;
    let is_npz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
    let images = if is_npz {
        let file = BufReader::new(File::open(path).map_err(Error::io(path, "open"))?);
        let mut archive = npyz::npz::NpzArchive::new(file).map_err(failed)?;
        if let Some(lights) = archive.by_name("lights").map_err(failed)? {
            names = Some(read_names(lights).map_err(refuse)?);
        }
        let images = archive.by_name("images").map_err(failed)?;
        decode_array(images.ok_or_else(|| refuse("it has no array 'images'".into()))?).map_err(refuse)?
    } else {
        let file = BufReader::new(File::open(path).map_err(Error::io(path, "open"))?);
        decode_array(npyz::NpyFile::new(file).map_err(failed)?).map_err(refuse)?
    };
    let names = names.unwrap_or_else(|| (0..images.len()).map(|i| format!("light {i}")).collect());
    if names.len() != images.len() {
        return Err(refuse(format!("it names {} lights but holds {} images", names.len(), images.len())));
    }
    let role = |name: &String| LayerMatch { layer: name.clone(), role: LayerRole::Light(name.clone()) };
    let matches = names.iter().map(role).collect();
    let lights = names.into_iter().zip(images).map(|(name, image)| LightImage { name, image }).collect();
    let found = LightImages { lights, sum: None, matches };
    found.check(path)?;
    Ok(found)
}

fn decode_array<R: Read>(array: npyz::NpyFile<R>) -> Result<Vec<LinearImage>, String> {
    let shape = array.shape().to_vec();
    let &[lights, height, width, 3] = shape.as_slice() else {
        return Err(format!("its array has the shape {shape:?}"));
    };
    let values = lights.checked_mul(height).and_then(|v| v.checked_mul(width)).and_then(|v| v.checked_mul(3));
    if lights == 0 || !(1..=MAX_SIDE).contains(&height) || !(1..=MAX_SIDE).contains(&width) {
        return Err(format!("its array has the shape {shape:?}"));
    }
    if values.is_none_or(|v| v > MAX_VALUES) || array.order() != npyz::Order::C {
        return Err("its array is too large, or in Fortran order".into());
    }
    // Grows as values come, so that a header alone earns no memory.
    let read = |value: std::io::Result<f32>| value.map_err(|e| format!("its array is cut short ({e})"));
    let mut flat: Vec<f32> = Vec::new();
    if matches!(array.dtype(), npyz::DType::Plain(dtype) if dtype.to_string() == "<f2") {
        let mut reader = array.into_inner();
        for _ in 0..values.unwrap_or(0) {
            let mut bytes = [0; 2];
            reader.read_exact(&mut bytes).map_err(|e| format!("its array is cut short ({e})"))?;
            flat.push(half::f16::from_le_bytes(bytes).to_f32());
        }
        return Ok(to_images(&flat, width as usize, height as usize));
    }
    match array.try_data::<f32>() {
        Ok(data) => data.map(read).try_for_each(|v| v.map(|v| flat.push(v)))?,
        Err(array) => {
            let data =
                array.data::<f64>().map_err(|_| "its array is neither float16, float32 nor float64".to_owned())?;
            data.map(|v| read(v.map(|v| v as f32))).try_for_each(|v| v.map(|v| flat.push(v)))?;
        }
    }
    Ok(to_images(&flat, width as usize, height as usize))
}

fn to_images(flat: &[f32], width: usize, height: usize) -> Vec<LinearImage> {
    let images = flat.as_chunks::<3>().0.chunks_exact(width * height);
    images.map(|p| LinearImage { width: width as u32, height: height as u32, pixels: p.to_vec() }).collect()
}

/// Reads an array of texts of one length (`<U…`: 32-bit code points, padded with zeros).
fn read_names<R: Read>(array: npyz::NpyFile<R>) -> Result<Vec<String>, String> {
    let npyz::DType::Plain(dtype) = array.dtype() else {
        return Err("its names are not texts".into());
    };
    let dtype = dtype.to_string();
    let length = dtype.strip_prefix("<U").and_then(|n| n.parse::<usize>().ok()).filter(|n| (1..=4096).contains(n));
    let length = length.ok_or(format!("its names are of the type {dtype}"))?;
    let count = array.shape().iter().product::<u64>();
    let mut reader = array.into_inner();
    let mut names = Vec::new();
    let mut bytes = vec![0; 4 * length];
    for _ in 0..count {
        reader.read_exact(&mut bytes).map_err(|e| format!("its names are cut short ({e})"))?;
        let points = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        names.push(points.take_while(|&p| p != 0).filter_map(char::from_u32).collect());
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_float_map_is_read_from_the_bottom_up() {
        let mut bytes = b"PF\n2 2\n-1.0\n".to_vec();
        (0..12).for_each(|i| bytes.extend((i as f32).to_le_bytes()));
        let image = decode_pfm(&bytes).unwrap();
        assert_eq!(image.pixels, [[6.0, 7.0, 8.0], [9.0, 10.0, 11.0], [0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
        for length in 0..bytes.len() {
            assert!(decode_pfm(&bytes[..length]).is_err(), "cut at {length}");
        }
    }
}
