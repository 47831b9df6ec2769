//! A file for each light, and portable float maps.

use std::path::{Path, PathBuf};

use regex::Regex;

use super::{LayerMatch, LayerRole, LightSet, Source, TakeRow, take_pixels};
use crate::error::{Error, Result};
use crate::files::{folder_of, open_input, read_input};
use crate::image::read::place_in_frame;
use crate::image::{LinearImage, image_size, read_image};
use crate::matrix::MatrixShape;

/// Extensions of the image files that a pattern may find.
const EXTENSIONS: [&str; 8] = ["exr", "hdr", "pfm", "png", "jpg", "jpeg", "tga", "bmp"];
const MAX_SIDE: u64 = MatrixShape::MAX_IMAGE_SIDE as u64;

/// Looks at the files of the folder of `pattern` whose names match its last part, `{light}` standing for the light's name
/// and `*` for anything.
pub(super) fn open(pattern: &Path) -> Result<LightSet> {
    let place_of_pattern = || pattern.display().to_string();
    let folder = folder_of(pattern);
    let name = pattern.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(pattern_of_names) = expression(&name) else {
        let hint = "write for example renders/room_{light}.exr";
        return Err(Error::input(place_of_pattern(), "the file name does not have {light} once", hint));
    };
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
    let mut names: Vec<_> =
        entries.filter_map(|e| e.ok()).map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let (mut matches, mut lights, mut paths) = (Vec::new(), Vec::new(), Vec::new());
    for file in names {
        let is_image =
            EXTENSIONS.iter().any(|e| Path::new(&file).extension().is_some_and(|x| x.eq_ignore_ascii_case(e)));
        let light = pattern_of_names.captures(&file).filter(|_| is_image).map(|found| found[1].to_owned());
        let role = light.clone().map_or(LayerRole::Ignored, LayerRole::Light);
        if let Some(light) = light {
            lights.push(light);
            paths.push(folder.join(&file));
        }
        matches.push(LayerMatch { layer: file, role });
    }
    let Some(first) = paths.first() else {
        return Err(Error::input(
            place_of_pattern(),
            "no image file matches",
            "write for example renders/room_{light}.exr",
        ));
    };
    let (width, height) = size_of(first)?;
    let place = |path: &Path| if is_float_map(path) { Ok(([0, 0], (width, height))) } else { place_in_frame(path) };
    let first_place = place(first)?;
    for path in &paths[1..] {
        let size = size_of(path)?;
        if size != (width, height) {
            let problem = format!("has {} × {} pixels, {} has {width} × {height}", size.0, size.1, first.display());
            return Err(Error::input(path.display().to_string(), problem, "render all lights at one resolution"));
        }
        if place(path)? != first_place {
            let problem = format!("holds another part of its frame (data window) than {}", first.display());
            return Err(Error::input(path.display().to_string(), problem, "write all lights with one data window"));
        }
    }
    Ok(LightSet { width, height, lights, has_sum: false, matches, source: Source::Files(paths) })
}

/// Reads the files one after the other.
pub(super) fn read(paths: &[PathBuf], size: (u32, u32), take: &mut TakeRow<'_>) -> Result<()> {
    let mut buffer = Vec::new();
    for (index, path) in paths.iter().enumerate() {
        let image = if is_float_map(path) { read_pfm(path)? } else { read_image(path)? };
        if (image.width, image.height) != size {
            return Err(Error::input(path.display().to_string(), "changed while it was read", "run the command again"));
        }
        for (y, row) in image.pixels.chunks_exact(image.width as usize).enumerate() {
            take_pixels(take, index, y, row, &mut buffer)?;
        }
    }
    Ok(())
}

/// The expression for a name with `{light}` once and `*`s.
fn expression(pattern: &str) -> Option<Regex> {
    let (before, after) = pattern.split_once("{light}").filter(|(_, after)| !after.contains("{light}"))?;
    let parts = |text: &str, any: &str| text.split('*').map(regex::escape).collect::<Vec<_>>().join(any);
    Regex::new(&format!("^{}(.+){}$", parts(before, ".*?"), parts(after, ".*"))).ok()
}

fn is_float_map(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pfm"))
}

fn size_of(path: &Path) -> Result<(u32, u32)> {
    if !is_float_map(path) {
        return image_size(path);
    }
    let mut start = [0; 128];
    let mut file = open_input(path, "open")?;
    let read = std::io::Read::read(&mut file, &mut start).map_err(Error::io(path, "read"))?;
    let header = Header::decode(&start[..read]).map_err(|problem| refuse(path, problem))?;
    Ok((header.width as u32, header.height as u32))
}

fn refuse(path: &Path, problem: String) -> Error {
    Error::input(path.display().to_string(), problem, "write it again as PFM or EXR")
}

/// Reads a portable float map (`PF` or `Pf`), whose rows run from the bottom up.
///
/// Errors: a file that cannot be read, is no such map, or is shorter than its header says.
pub(super) fn read_pfm(path: &Path) -> Result<LinearImage> {
    let bytes = read_input(path, "read", u64::MAX)?;
    decode_pfm(&bytes).map_err(|problem| refuse(path, problem))
}

/// The start of a portable float map.
struct Header {
    channels: usize,
    width: usize,
    height: usize,
    scale: f32,
    /// Bytes before the values.
    bytes: usize,
}

impl Header {
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
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) || scale == 0.0 {
            return Err("its header does not say size and scale".into());
        }
        Ok(Self { channels, width: width as usize, height: height as usize, scale, bytes: at + 1 })
    }
}

fn decode_pfm(bytes: &[u8]) -> Result<LinearImage, String> {
    let Header { channels, width, height, scale, bytes: start } = Header::decode(bytes)?;
    let body = bytes.get(start..).unwrap_or(&[]);
    if (body.len() as u64) < (width * height * channels * 4) as u64 {
        return Err(format!("it is cut short: {width} × {height} pixels take more than its {} bytes", body.len()));
    }
    let value = |i: usize| {
        let word = body[4 * i..4 * i + 4].try_into().expect("4 bytes");
        if scale < 0.0 { f32::from_le_bytes(word) } else { f32::from_be_bytes(word) }
    };
    let mut pixels = Vec::with_capacity(width * height);
    for y in (0..height).rev() {
        for x in 0..width {
            let at = (y * width + x) * channels;
            pixels.push(if channels == 3 { [value(at), value(at + 1), value(at + 2)] } else { [value(at); 3] });
        }
    }
    Ok(LinearImage { width: width as u32, height: height as u32, pixels })
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

    #[test]
    fn patterns_find_the_lights_in_names() {
        let light = |pattern: &str, name: &str| expression(pattern).unwrap().captures(name).map(|c| c[1].to_owned());
        assert_eq!(light("room_{light}_v*.exr", "room_key light_v2.exr"), Some("key light".into()));
        assert_eq!(light("*_{light}.*", "a_b_c.exr"), Some("b_c".into()));
        assert_eq!(light("room_{light}.exr", "room_.exr"), None);
        assert_eq!(light("a.{light}", "axb"), None, "a dot is a dot");
        assert!(expression("room.exr").is_none() && expression("{light}{light}").is_none());
    }
}
