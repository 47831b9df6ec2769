//! Names beside other names, and what may stand in the way of an output.

use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

use super::system;
use crate::error::{Error, Hint, Result};

/// The folder of a file, `.` for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The path with something appended to its name: `NAME.part` for `NAME`.
pub fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// The order in which people count files and layers: numbers by their value, `frame_2` before `frame_10`; names that are equal so
/// far, as `2` and `02`, by their letters.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let (Some(x), Some(y)) = (left.chars().next(), right.chars().next()) else {
            return left.len().cmp(&right.len()).then_with(|| a.cmp(b));
        };
        let order = if x.is_ascii_digit() && y.is_ascii_digit() {
            let [(first, after), (second, behind)] = [left, right].map(number);
            (left, right) = (after, behind);
            first.len().cmp(&second.len()).then_with(|| first.cmp(second))
        } else {
            (left, right) = (&left[x.len_utf8()..], &right[y.len_utf8()..]);
            x.cmp(&y)
        };
        if order.is_ne() {
            return order;
        }
    }
}

/// The number that a text begins with, without zeros before it, and what follows.
fn number(text: &str) -> (&str, &str) {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    (digits.trim_start_matches('0'), rest)
}

/// Checks, before any work is done, that an output can be given its name in the end.
///
/// # Errors
/// The folder is not there; a folder or device stands under the name; a file does, and may not be replaced (`overwrite`).
pub fn check_output(path: &Path, overwrite: bool) -> Result<()> {
    let refuse = |problem: &str, hint: &str| Err(Error::input(path.display().to_string(), problem, hint));
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => refuse("is a folder", "give the name of a file in it"),
        Ok(found) if !found.is_file() => refuse("is a device or pipe, which cannot be replaced", "name a file"),
        Ok(_) if !overwrite => Err(Error::input(path.display().to_string(), "exists already", Hint::Overwrite)),
        Ok(_) => Ok(()),
        Err(_) if path.file_name().is_none() => refuse("is no name for a file", "name a file"),
        Err(_) if path.is_symlink() => refuse("is a link that leads nowhere", "remove it, or choose another name"),
        Err(_) => {
            let folder = folder_of(path);
            match fs::metadata(folder) {
                Ok(found) if found.is_dir() => Ok(()),
                Ok(_) => {
                    let problem = format!("{} is no folder", folder.display());
                    refuse(&problem, "choose another place")
                }
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                    let problem = format!("there is no folder {}", folder.display());
                    refuse(&problem, "make it, or choose another place")
                }
                Err(error) => Err(Error::io(folder, "look into the folder")(error)),
            }
        }
    }
}

/// Makes the names in a file's folder durable.
///
/// # Errors
/// The folder cannot be opened or synced.
pub fn sync_folder(path: &Path) -> Result<()> {
    let folder = folder_of(path);
    system::sync_folder(folder).map_err(Error::io(folder, "sync the folder"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_name_is_in_the_present_folder() {
        assert_eq!(folder_of(Path::new("a.ltm")), Path::new("."));
        assert_eq!(folder_of(Path::new("b/a.ltm")), Path::new("b"));
        assert_eq!(with_suffix(Path::new("b/a.ltm"), ".part"), Path::new("b/a.ltm.part"));
    }

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let ordered = [
            "",
            "01.png",
            "1.png",
            "2.png",
            "10.png",
            "99999999999999999999998.png",
            "99999999999999999999999.png",
            "a",
            "a2b3",
            "a2b12",
            "a10b1",
            "frame",
            "frame_0",
            "frame_00",
            "frame_1",
            "frame_2.pfm",
            "frame_10.pfm",
            "ä1",
            "ä2",
            "ä10",
        ];
        for (i, a) in ordered.iter().enumerate() {
            for (j, b) in ordered.iter().enumerate() {
                assert_eq!(natural_order(a, b), i.cmp(&j), "{a} {b}");
            }
        }
    }

    #[test]
    fn an_output_that_cannot_be_is_refused_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("there"), "x").unwrap();
        std::os::unix::fs::symlink(at("nowhere"), at("dangling")).unwrap();
        let said = |path: &Path, overwrite| check_output(path, overwrite).unwrap_err().to_string();
        assert!(said(folder.path(), true).contains("is a folder"));
        assert!(said(Path::new("/dev/null"), true).contains("is a device"));
        assert!(said(&at("there"), false).contains("exists already"));
        assert!(said(&at("missing/x"), true).contains("there is no folder"));
        assert!(said(&at("there/x"), true).contains("is no folder"));
        assert!(said(&at("dangling"), true).contains("leads nowhere"));
        check_output(&at("there"), true).unwrap();
        check_output(&at("new"), false).unwrap();
    }
}
