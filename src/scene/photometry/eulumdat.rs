//! EULUMDAT files (`.ldt`).

use std::path::Path;

use super::{MAX_ANGLES, Photometry, Web, lines};
use crate::error::{Error, Result};

/// Most sets of lamps that the format has.
const MAX_SETS: usize = 20;
/// Lines of a set.
const SET_LINES: usize = 6;

/// Reads an EULUMDAT file's text; `path` is for messages.
///
/// Intensities are candela for 1,000 lumens of the first set of lamps; the whole circle is made of what symmetry leaves out.
/// Errors: too few lines, words where numbers should be, angles out of order, a web without light.
pub(super) fn parse(path: &Path, text: &str) -> Result<Photometry> {
    let refuse = |problem: String| Error::input(path.display().to_string(), problem, "give an EULUMDAT file (.ldt)");
    let lines: Vec<&str> = lines(text).map(str::trim).collect();
    // Lines are counted from 1, as the format's description does.
    let text = |line: usize| lines.get(line - 1).copied().ok_or_else(|| refuse(format!("ends before line {line}")));
    let float = |line: usize| -> Result<f32> {
        let value =
            number(text(line)?).ok_or_else(|| refuse(format!("line {line} has no number where one should be")))?;
        if value.is_finite() { Ok(value) } else { Err(refuse(format!("line {line} is not finite"))) }
    };
    let count = |line: usize, most: usize| -> Result<usize> {
        let value = float(line)?;
        if value.fract() == 0.0 && (1.0..=most as f32).contains(&value) {
            Ok(value as usize)
        } else {
            Err(refuse(format!("line {line} is no whole number from 1 to {most}")))
        }
    };
    let symmetry = float(3)?;
    let symmetry = [0, 1, 2, 3, 4].into_iter().find(|known| *known as f32 == symmetry);
    let symmetry = symmetry.ok_or_else(|| refuse("line 3: there is no such symmetry".into()))?;
    let (planes, angles) = (count(4, MAX_ANGLES)?, count(6, MAX_ANGLES)?);
    // Where it is left out or 0, nothing is to be converted.
    let factor = if text(24)?.is_empty() { 1.0 } else { float(24)? };
    let factor = if factor == 0.0 { 1.0 } else { factor };
    let sets = count(26, MAX_SETS)?;
    let lumens = float(29)?;
    let first_plane = 27 + SET_LINES * sets + 10;
    let list = |from: usize, count: usize| (from..from + count).map(float).collect::<Result<Vec<f32>>>();
    let plane_angles = list(first_plane, planes)?;
    let vertical = list(first_plane + planes, angles)?;
    // Some write the plane of 0° once more, as that of 360°.
    let circle = planes - usize::from(planes > 1 && (plane_angles[planes - 1] - plane_angles[0] - 360.0).abs() < 0.1);
    let stored = match (symmetry, circle % 4) {
        (0, _) => planes,
        (1, _) => 1,
        (2 | 3, 0 | 2) => circle / 2 + 1,
        (4, 0) => circle / 4 + 1,
        _ => return Err(refuse(format!("{planes} planes cannot have symmetry {symmetry}"))),
    };
    let first_value = first_plane + planes + angles;
    let row = |i: usize| -> Result<Vec<f32>> {
        Ok(list(first_value + i * angles, angles)?.into_iter().map(|v| v.max(0.0)).collect())
    };
    let rows = (0..stored).map(row).collect::<Result<Vec<_>>>()?;
    let increasing = |angles: &[f32]| angles.windows(2).all(|w| w[0] < w[1]);
    let (lowest, highest) = (vertical[0], vertical[angles - 1]);
    if !increasing(&plane_angles) || !increasing(&vertical) || lowest < 0.0 || highest > 180.0 {
        return Err(refuse("has angles that do not increase, or do not lie in 0 to 180 degrees".into()));
    }
    let web = Web { vertical, horizontal: horizontals(symmetry, &plane_angles[..circle.max(stored)], stored), rows };
    let spread = |web: &Web, wanted: [f32; 2]| {
        let ends = [web.horizontal[0], web.horizontal[web.horizontal.len() - 1]];
        ends.iter().zip(wanted).all(|(end, wanted)| (end - wanted).abs() < 0.1)
    };
    let whole = match symmetry {
        0 if web.horizontal[0].abs() < 0.1 && web.horizontal.last().is_some_and(|a| *a < 360.5) => {
            Some(web.whole_circle())
        }
        1 => Some(web),
        2 if spread(&web, [0.0, 180.0]) => Some(web.continued().whole_circle()),
        3 if spread(&web, [270.0, 450.0]) => Some(web.continued().whole_circle()),
        4 if spread(&web, [0.0, 90.0]) => Some(web.continued().continued().whole_circle()),
        _ => None,
    };
    let whole = whole.ok_or_else(|| refuse(format!("its planes do not cover what symmetry {symmetry} wants")))?;
    Photometry::of_web(whole, factor * lumens.abs() / 1000.0).ok_or_else(|| refuse("has no light in it".into()))
}

/// The number at the beginning of a line, with a decimal point or comma; a unit may follow.
fn number(text: &str) -> Option<f32> {
    let word = text.split_whitespace().next()?.replace(',', ".");
    let end = word.find(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c))).unwrap_or(word.len());
    word.parse().ok().or_else(|| word[..end].parse().ok())
}

/// The angles of the planes that are stored, of all: from 0°, but with symmetry 3 from 270° on, through 0° (360°) to 90° (450°).
fn horizontals(symmetry: u32, planes: &[f32], stored: usize) -> Vec<f32> {
    let first = if symmetry == 3 { 3 * planes.len() / 4 } else { 0 };
    match symmetry {
        1 => vec![0.0],
        _ => {
            let angle = |i: usize| planes[i % planes.len()] + if i >= planes.len() { 360.0 } else { 0.0 };
            (first..first + stored).map(angle).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of 2,000 lm, factor 1, planes each 90° and vertical angles 0 and 90°.
    fn file(symmetry: u32, rows: &[[f32; 2]]) -> String {
        let mut lines = vec!["maker".to_owned(), "1".into(), symmetry.to_string(), "4".into(), "90".into(), "2".into()];
        lines.extend(["90", "report", "lamp", "1", "lamp.ldt", "today"].map(String::from));
        lines.extend((13..=23).map(|_| "0".to_owned()));
        lines.extend(["1.0", "0", "1", "1", "LED", "2000", "830", "80", "20"].map(String::from));
        lines.extend((0..10).map(|_| "0.5".to_owned()));
        lines.extend(["0", "90", "180", "270", "0", "90"].map(String::from));
        lines.extend(rows.iter().flatten().map(f32::to_string));
        lines.join("\r\n")
    }

    fn read(text: &str) -> Result<Photometry> {
        parse(Path::new("a.ldt"), text)
    }

    /// Intensities in the first vertical angle, in candela, at each whole quarter of the circle.
    fn around(found: &Photometry) -> Vec<(i32, f32)> {
        let degrees = found.profile.horizontal_radians.iter().map(|a| a.to_degrees().round() as i32);
        degrees.zip(found.profile.intensity.chunks(2).map(|row| (row[0] * found.peak_candela).round())).collect()
    }

    /// By hand: a value is candela for 1,000 lm; of 2,000 lm there is twice as much.
    #[test]
    fn candela_follow_from_the_lumens_of_the_lamps() {
        let found = read(&file(1, &[[150.0, 30.0]])).unwrap();
        assert_eq!(found.peak_candela, 300.0);
        assert_eq!(found.profile.intensity, [1.0, 0.2]);
        assert_eq!(around(&found), [(0, 300.0)]);
    }

    #[test]
    fn every_symmetry_is_unfolded_to_the_whole_circle() {
        let [a, b, c, d] = [[10.0, 1.0], [20.0, 1.0], [30.0, 1.0], [40.0, 1.0]];
        let quarters =
            |values: [f32; 5]| [0, 90, 180, 270, 360].into_iter().zip(values.map(|v| 2.0 * v)).collect::<Vec<_>>();
        assert_eq!(around(&read(&file(0, &[a, b, c, d])).unwrap()), quarters([10.0, 20.0, 30.0, 40.0, 10.0]));
        assert_eq!(around(&read(&file(2, &[a, b, c])).unwrap()), quarters([10.0, 20.0, 30.0, 20.0, 10.0]));
        // Stored are 270°, 0° and 90°.
        assert_eq!(around(&read(&file(3, &[a, b, c])).unwrap()), quarters([20.0, 30.0, 20.0, 10.0, 20.0]));
        assert_eq!(around(&read(&file(4, &[a, b])).unwrap()), quarters([10.0, 20.0, 10.0, 20.0, 10.0]));
    }

    #[test]
    fn every_truncation_and_every_nonsense_is_an_error() {
        let whole = file(0, &[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]);
        assert!(read(&whole).is_ok());
        let lines: Vec<&str> = whole.lines().collect();
        for kept in 0..lines.len() {
            assert!(read(&lines[..kept].join("\n")).is_err(), "{kept} lines");
        }
        for (line, text) in [(3, "7"), (3, "-1"), (4, "1e9"), (6, "0"), (24, "nan"), (26, "900"), (29, "0"), (44, "0")]
        {
            let mut lines = lines.clone();
            lines[line - 1] = text;
            assert!(read(&lines.join("\n")).is_err(), "line {line}: {text}");
        }
    }
}
