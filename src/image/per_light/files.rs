//! A file for each light.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use regex_lite::Regex;

use super::{LayerMatch, LayerRole, LightSet, Source, TakeRow, hand_over_black, size_of_frame, take_pixels};
use crate::error::{Error, Hint, Result, Warnings};
use crate::files::{folder_of, natural_order};
use crate::image::open_exr::{Window, common_frame, note_of_frame};
use crate::image::read::ImageReader;

/// Extensions of the image files that a pattern may find.
const EXTENSIONS: [&str; 11] = ["exr", "hdr", "rgbe", "xyze", "pfm", "png", "jpg", "jpeg", "webp", "tga", "bmp"];
/// Extensions of images that are not read, and what they are called.
const UNREAD: [(&str, &str); 13] = [
    ("tif", "TIFF"),
    ("tiff", "TIFF"),
    ("gif", "GIF"),
    ("dpx", "DPX"),
    ("cin", "Cineon"),
    ("psd", "Photoshop"),
    ("jxl", "JPEG XL"),
    ("avif", "AVIF"),
    ("heic", "HEIC"),
    ("dng", "a camera's raw"),
    ("cr2", "a camera's raw"),
    ("nef", "a camera's raw"),
    ("arw", "a camera's raw"),
];
/// Most lines of notes on files.
const MAX_NOTES: usize = 8;

/// The files of a set.
#[derive(Clone, Debug)]
pub(super) struct Files {
    /// Each with the place of its pixels.
    paths: Vec<(PathBuf, Window)>,
    frame: Window,
    needs_bytes: u64,
}

/// Inspects the files of `pattern`'s folder whose names match its last part, where `{light}` stands for the light's
/// name and `*` for any text. They are in natural order, without hidden files.
pub(super) fn open(pattern: &Path) -> Result<LightSet> {
    let folder = folder_of(pattern);
    let (matches, lights, paths) = listed(pattern)?;
    let (mut windows, mut needs_bytes) = (Vec::new(), 0);
    let (mut notes, mut encoded) = (BTreeMap::<String, Vec<&Path>>::new(), 0);
    for path in &paths {
        let image = ImageReader::open(path)?;
        encoded += usize::from(image.is_encoded());
        windows.push(image.windows());
        // Its own pixels are read, wherever they lie.
        let facts = image.facts(path, Some(&image.windows().0))?;
        needs_bytes = needs_bytes.max(facts.needs_bytes);
        facts.notes.into_iter().for_each(|note| notes.entry(note).or_default().push(path));
    }
    let first = paths[0].display();
    let frame = common_frame(&windows).map_err(|other| {
        let (path, (data, frame)) = (&paths[other], windows[other]);
        let is_size = (data.width, data.height) != (windows[0].0.width, windows[0].0.height);
        let (problem, hint) = if is_size && data == frame {
            let (data, whole) = (data.size(), windows[0].0.size());
            (format!("has {data}, {first} has {whole}"), "render all lights at one resolution")
        } else {
            let whole = windows[0].1;
            let problem =
                format!("is of a picture (display window) of {frame}, {first} of one of {whole}: another data window");
            (problem, "write all lights with one display window")
        };
        Error::input(path.display().to_string(), problem, hint)
    })?;
    let (width, height) = size_of_frame(pattern, &frame)?;
    let mut warnings: Warnings = said(&notes).into_iter().collect();
    warnings.extend(note_of_frame(&frame, &windows));
    if encoded > 0 {
        let files = if encoded == 1 { "1 file is".into() } else { format!("{encoded} files are") };
        warnings.push(format!(
            "{files} decoded from sRGB, as PNG and JPEG mean it; give light that is linear or above 1 as EXR, HDR or PFM ({})",
            folder.display()
        ));
    }
    let paths = paths.into_iter().zip(windows).map(|(path, (data, _))| (path, data)).collect();
    let source = Source::Files(Files { paths, frame, needs_bytes });
    Ok(LightSet { width, height, lights, has_sum: false, matches, warnings, source })
}

/// What each file of the folder was taken for, the lights, and their files.
type Listed = (Vec<LayerMatch>, Vec<String>, Vec<PathBuf>);

fn listed(pattern: &Path) -> Result<Listed> {
    let refuse = |problem: String, hint: &str| Err(Error::input(pattern.display().to_string(), problem, hint));
    let folder = folder_of(pattern);
    let name = pattern.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(pattern_of_names) = expression(&name) else {
        return refuse("the file name does not have {light} once".into(), "write for example renders/room_{light}.exr");
    };
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
    let names = entries.filter_map(|e| e.ok()).filter(|e| !e.path().is_dir()).map(|e| e.file_name());
    let mut names: Vec<_> = names.map(|name| (name.to_string_lossy().into_owned(), name)).collect();
    // What systems and editors leave beside files: `._1.exr` of macOS is no image.
    names.retain(|(name, _)| !name.starts_with('.'));
    names.sort_by(|(a, _), (b, _)| natural_order(a, b));
    let (mut matches, mut lights, mut paths, mut unread) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (file, name) in names {
        let extension = Path::new(&file).extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let light = pattern_of_names.captures(&file).map(|found| found[1].to_owned());
        let is_image = EXTENSIONS.contains(&extension.as_str());
        let role = light.clone().filter(|_| is_image).map_or(LayerRole::Ignored, LayerRole::Light);
        let known = UNREAD.iter().find(|(unread, _)| *unread == extension);
        match (light, known) {
            (Some(light), _) if is_image => {
                lights.push(light);
                paths.push(folder.join(name));
            }
            (Some(light), Some((_, format))) => unread.push((light, file.clone(), format)),
            _ => {}
        }
        matches.push(LayerMatch { layer: file, role });
    }
    // One that is there in another format too is not missing.
    if let Some((_, file, format)) = unread.iter().find(|(light, _, _)| !lights.contains(light)) {
        let count = unread.len();
        let others = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
        let problem = format!("'{file}'{others} would be lights, but {format} is not read");
        return refuse(problem, "convert them to OpenEXR, or choose the files by a narrower pattern");
    }
    if paths.is_empty() {
        return refuse("no image file matches".into(), "write for example renders/room_{light}.exr");
    }
    Ok((matches, lights, paths))
}

/// Notes on files, each kind in one line.
fn said(notes: &BTreeMap<String, Vec<&Path>>) -> Vec<String> {
    let line = |(note, paths): (&String, &Vec<&Path>)| {
        let first = paths[0].display();
        let others = if paths.len() > 1 { format!(" and {} more", paths.len() - 1) } else { String::new() };
        format!("{first}{others}: {note}")
    };
    let mut lines: Vec<String> = notes.iter().take(MAX_NOTES).map(line).collect();
    if notes.len() > MAX_NOTES {
        lines.push(format!("{} more of such lines", notes.len() - MAX_NOTES));
    }
    lines
}

impl Files {
    /// Bytes of memory for one image at a time.
    pub(super) fn needs_bytes(&self) -> u64 {
        self.needs_bytes
    }

    /// Reads the files one after the other.
    pub(super) fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        let (mut buffer, mut row_buffer) = (Vec::new(), Vec::new());
        for (index, (path, data)) in self.paths.iter().enumerate() {
            let changed = || Error::input(path.display().to_string(), "changed while it was read", Hint::Repeat);
            let opened = ImageReader::open(path)?;
            if opened.windows().0 != *data {
                return Err(changed());
            }
            hand_over_black(index, data, &self.frame, take)?;
            let image = opened.read(path, Some(data))?;
            if (u64::from(image.width), u64::from(image.height)) != (data.width, data.height) {
                return Err(changed());
            }
            for (y, row) in image.pixels.chunks_exact(image.width as usize).enumerate() {
                let Some(inside) = data.clip(&self.frame, (0, y), row.len()) else { continue };
                row_buffer.clear();
                row_buffer.extend(row.iter().map(|&[r, g, b, _]| [r, g, b]));
                take_pixels(take, (index, inside.x, inside.y), &row_buffer, &mut buffer)?;
            }
        }
        Ok(())
    }
}

/// The expression for a name with `{light}` once and `*`s.
fn expression(pattern: &str) -> Option<Regex> {
    let (before, after) = pattern.split_once("{light}").filter(|(_, after)| !after.contains("{light}"))?;
    let parts = |text: &str, any: &str| text.split('*').map(regex_lite::escape).collect::<Vec<_>>().join(any);
    Regex::new(&format!("^{}(.+){}$", parts(before, ".*?"), parts(after, ".*"))).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

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
