//! Numbered files, such as `shot.0001.exr`, by a pattern: `shot.####.exr`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use ltm::error::{Error, Result};

/// A pattern's name before the number, its least number of digits, and the name after it.
fn parts(pattern: &Path) -> Option<(&str, usize, &str)> {
    let name = pattern.file_name()?.to_str()?;
    let end = name.rfind('#')? + 1;
    let begin = name[..end].trim_end_matches('#').len();
    Some((&name[..begin], end - begin, &name[end..]))
}

/// The name of a frame: the last run of `#` of the pattern's name becomes its number. None of a name without `#`.
pub fn frame_path(pattern: &Path, frame: usize) -> Option<PathBuf> {
    let (before, digits, after) = parts(pattern)?;
    Some(pattern.with_file_name(format!("{before}{frame:0digits$}{after}")))
}

/// The frames that are there by a pattern, in their order, of them those whose numbers lie in a range. None of a name without `#`, or where
/// a file has that very name.
///
/// # Errors
/// The folder cannot be read; there are no such frames.
pub fn frames(pattern: &Path, range: Option<&Range<usize>>) -> Result<Option<Vec<(usize, PathBuf)>>> {
    let Some((before, digits, after)) = parts(pattern).filter(|_| !pattern.exists()) else { return Ok(None) };
    let folder = match pattern.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder, "look into"))? {
        let name = entry.map_err(Error::io(folder, "look into"))?.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix(before)?.strip_suffix(after));
        // A number is written in one way: as many digits as asked for, more only where it needs them.
        let is_number = |text: &&str| {
            let is_whole = text.bytes().all(|byte| byte.is_ascii_digit());
            is_whole && (text.len() == digits || text.len() > digits && !text.starts_with('0'))
        };
        if let Some(frame) = number.filter(is_number).and_then(|text| text.parse().ok()) {
            found.push((frame, pattern.with_file_name(&name)));
        }
    }
    found.sort();
    let all = found.len();
    if let Some(range) = range {
        found.retain(|(frame, _)| range.contains(frame));
    }
    if found.is_empty() {
        let place = pattern.display().to_string();
        return Err(match all {
            0 => Error::input(place, "no file has such a name", "# stands for a digit of the frame's number"),
            _ => Error::input(place, format!("none of its {all} frames is asked for"), "give other --frames"),
        });
    }
    Ok(Some(found))
}

/// Reads `FIRST..END`, of which END is not a part.
///
/// # Errors
/// What to write in its place.
pub fn parse_range(text: &str) -> Result<Range<usize>, String> {
    let (first, end) = text.split_once("..").ok_or("write FIRST..END, for example 0..100")?;
    let number = |s: &str| s.parse().map_err(|e| format!("'{s}' is no frame's number ({e})"));
    Ok(number(first)?..number(end)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_found_by_their_numbers_and_named_likewise() {
        let folder = tempfile::tempdir().unwrap();
        let names =
            ["shot.0010.exr", "shot.0009.exr", "shot.12345.exr", "shot.001.exr", "shot.0x10.exr", "shot.0011.png"];
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        let pattern = folder.path().join("shot.####.exr");
        let numbers = |range: Option<Range<usize>>| {
            let found = frames(&pattern, range.as_ref()).unwrap().unwrap();
            for (frame, path) in &found {
                assert_eq!(frame_path(&pattern, *frame).as_ref(), Some(path));
            }
            found.into_iter().map(|(frame, _)| frame).collect::<Vec<_>>()
        };
        assert_eq!(numbers(None), [9, 10, 12345]);
        assert_eq!(numbers(Some(10..100)), [10]);
        assert!(frames(&pattern, Some(&(0..5))).unwrap_err().to_string().contains("none of its 3 frames"));
        assert!(frames(&folder.path().join("x.##.exr"), None).unwrap_err().to_string().contains("no file has"));
        assert_eq!(frames(&folder.path().join("shot.exr"), None).unwrap(), None);
        // A file that is really called so.
        std::fs::write(folder.path().join("take#1.exr"), "").unwrap();
        assert_eq!(frames(&folder.path().join("take#1.exr"), None).unwrap(), None);
    }

    #[test]
    fn ranges_are_two_numbers() {
        assert_eq!(parse_range("3..10"), Ok(3..10));
        assert!(["", "3", "3..x", "-1..2"].iter().all(|text| parse_range(text).is_err()));
    }
}
