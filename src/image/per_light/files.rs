//! A file for each light, and portable float maps.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use regex_lite::Regex;

use super::{LayerMatch, LayerRole, LightSet, MAX_SIDE, Source, TakeRow, take_pixels};
use crate::error::{Error, Result};
use crate::files::{folder_of, open_input};
use crate::image::read::place_in_frame;
use crate::image::{ImageFacts, LinearImage, image_facts, read_image};

/// Extensions of the image files that a pattern may find.
const EXTENSIONS: [&str; 8] = ["exr", "hdr", "pfm", "png", "jpg", "jpeg", "tga", "bmp"];

/// Longest start of a portable float map that is looked at: four words.
const LONGEST_HEADER: u64 = 128;

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
    let ImageFacts { width, height, mut needs_bytes } = facts_of(first)?;
    let place = |path: &Path| if is_float_map(path) { Ok(([0, 0], (width, height))) } else { place_in_frame(path) };
    let first_place = place(first)?;
    for path in &paths[1..] {
        let facts = facts_of(path)?;
        if (facts.width, facts.height) != (width, height) {
            let size = format!("{} × {}", facts.width, facts.height);
            let problem = format!("has {size} pixels, {} has {width} × {height}", first.display());
            return Err(Error::input(path.display().to_string(), problem, "render all lights at one resolution"));
        }
        if place(path)? != first_place {
            let problem = format!("holds another part of its frame (data window) than {}", first.display());
            return Err(Error::input(path.display().to_string(), problem, "write all lights with one data window"));
        }
        needs_bytes = needs_bytes.max(facts.needs_bytes);
    }
    let source = Source::Files { paths, needs_bytes };
    Ok(LightSet { width, height, lights, has_sum: false, matches, warnings: Vec::new(), source })
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
    let parts = |text: &str, any: &str| text.split('*').map(regex_lite::escape).collect::<Vec<_>>().join(any);
    Regex::new(&format!("^{}(.+){}$", parts(before, ".*?"), parts(after, ".*"))).ok()
}

fn is_float_map(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("pfm"))
}

fn facts_of(path: &Path) -> Result<ImageFacts> {
    if !is_float_map(path) {
        return image_facts(path);
    }
    let header = open_pfm(path)?.1;
    let (width, height) = (header.width as u32, header.height as u32);
    // The pixels, and a row as the file has it.
    let needs_bytes = u64::from(width) * (u64::from(height) + 1) * 12;
    Ok(ImageFacts { width, height, needs_bytes })
}

fn refuse(path: &Path, problem: String) -> Error {
    Error::input(path.display().to_string(), problem, "write it again as PFM or EXR")
}

/// Reads a portable float map (`PF` or `Pf`), whose rows run from the bottom up.
///
/// # Errors
/// A file that cannot be read, is no such map, or is shorter than its header says.
fn read_pfm(path: &Path) -> Result<LinearImage> {
    let (mut file, header) = open_pfm(path)?;
    let mut image = LinearImage::black(header.width as u32, header.height as u32);
    let mut bytes = vec![0; header.row_bytes()];
    for row in image.pixels.chunks_exact_mut(header.width).rev() {
        file.read_exact(&mut bytes).map_err(Error::io(path, "read"))?;
        header.decode_row(&bytes, row);
    }
    Ok(image)
}

/// Opens a portable float map: its header, and a reader of its rows.
fn open_pfm(path: &Path) -> Result<(BufReader<File>, Header)> {
    let mut file = open_input(path, "open")?;
    let mut start = Vec::new();
    let failed = || Error::io(path, "read");
    Read::by_ref(&mut file).take(LONGEST_HEADER).read_to_end(&mut start).map_err(failed())?;
    let header = Header::decode(&start).map_err(|problem| refuse(path, problem))?;
    let length = file.metadata().map_err(failed())?.len();
    let needed = (header.bytes + header.height * header.row_bytes()) as u64;
    if length < needed {
        let problem =
            format!("it is cut short: {} × {} pixels take more than its {length} bytes", header.width, header.height);
        return Err(refuse(path, problem));
    }
    file.seek(SeekFrom::Start(header.bytes as u64)).map_err(failed())?;
    Ok((BufReader::new(file), header))
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
    fn decode_row(&self, bytes: &[u8], row: &mut [[f32; 3]]) {
        let value =
            |word: &[u8; 4]| if self.scale < 0.0 { f32::from_le_bytes(*word) } else { f32::from_be_bytes(*word) };
        let words = bytes.as_chunks::<4>().0;
        for (pixel, words) in row.iter_mut().zip(words.chunks_exact(self.channels)) {
            *pixel = match words {
                [r, g, b] => [value(r), value(g), value(b)],
                _ => [value(&words[0]); 3],
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_bytes(bytes: &[u8]) -> Result<LinearImage> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.pfm");
        std::fs::write(&path, bytes).unwrap();
        read_pfm(&path)
    }

    #[test]
    fn a_float_map_is_read_from_the_bottom_up() {
        let mut bytes = b"PF\n2 2\n-1.0\n".to_vec();
        (0..12).for_each(|i| bytes.extend((i as f32).to_le_bytes()));
        let image = read_bytes(&bytes).unwrap();
        assert_eq!(image.pixels, [[6.0, 7.0, 8.0], [9.0, 10.0, 11.0], [0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]);
        for length in 0..bytes.len() {
            assert!(read_bytes(&bytes[..length]).is_err(), "cut at {length}");
        }
    }

    #[test]
    fn grey_and_big_endian_float_maps_are_read() {
        let mut bytes = b"Pf\n3 1\n2.5\n".to_vec();
        [1.0f32, -2.0, 0.25].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
        assert_eq!(read_bytes(&bytes).unwrap().pixels, [[1.0; 3], [-2.0; 3], [0.25; 3]]);
        let mut bytes = b"PF 1 1 1 ".to_vec();
        [1.0f32, 2.0, 3.0].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
        assert_eq!(read_bytes(&bytes).unwrap().pixels, [[1.0, 2.0, 3.0]]);
    }

    #[test]
    fn a_float_map_that_claims_more_than_it_holds_is_refused_before_memory_is_taken() {
        for text in ["PF\n65536 65536\n-1\n", "PF 99999999 2 -1\n", "PF\n2 2\nnan\n", "PF\n2 2\n0\n", "P6 1 1 1\n"] {
            assert!(matches!(read_bytes(text.as_bytes()), Err(Error::Input { .. })), "{text}");
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
