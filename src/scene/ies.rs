//! Photometric files: IES LM-63 of 1986, 1991, 1995 and 2002, type C.

use std::path::Path;

use super::IesProfile;
use crate::error::{Error, Result};

/// Most angles of one kind that a file may state. Real files have at most a few hundred.
const MAX_ANGLES: usize = 4096;

/// What a photometric file says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Photometry {
    /// Intensity relative to its largest value, over the full horizontal circle or one angle.
    pub(super) profile: IesProfile,
    /// The largest intensity, with all of the file's factors.
    pub(super) peak_candela: f32,
}

/// Reads a photometric file's text; `path` is for messages.
///
/// Symmetric webs are unfolded to horizontal angles from 0 to 360°; a web of one horizontal angle stays one. Errors: no
/// `TILT` line, too few numbers, angles out of order, types A and B, a web without light.
pub(super) fn parse(path: &Path, text: &str) -> Result<Photometry> {
    let refuse = |problem: &str| {
        Error::input(path.display().to_string(), problem, "give an IES LM-63 file of photometric type C")
    };
    let mut lines = text.lines();
    let tilt = lines.find_map(|line| line.trim().strip_prefix("TILT=")).ok_or_else(|| refuse("has no TILT line"))?;
    let mut numbers = lines.flat_map(|line| line.split([' ', '\t', ',', '\r'])).filter(|word| !word.is_empty());
    let mut next = || -> Result<f32> {
        let word = numbers.next().ok_or_else(|| refuse("ends before its numbers do"))?;
        word.parse().ok().filter(|v: &f32| v.is_finite()).ok_or_else(|| refuse("has a word where a number should be"))
    };
    match tilt.trim() {
        "NONE" => {}
        "INCLUDE" => {
            // How the lamp dims when the luminaire is tilted; ours hang as they were measured.
            let _geometry = next()?;
            let pairs = count(next()?).ok_or_else(|| refuse("has an impossible number of tilt angles"))?;
            for _ in 0..2 * pairs {
                next()?;
            }
        }
        _ => return Err(refuse("keeps its tilt factors in another file")),
    }
    let (_lamps, _lumens, multiplier) = (next()?, next()?, next()?);
    let verticals = count(next()?).ok_or_else(|| refuse("has an impossible number of vertical angles"))?;
    let horizontals = count(next()?).ok_or_else(|| refuse("has an impossible number of horizontal angles"))?;
    let kind = next()?;
    if kind != 1.0 {
        return Err(refuse("is of photometric type A or B"));
    }
    let (_units, _width, _length, _height) = (next()?, next()?, next()?, next()?);
    let (ballast, lamp_factor, _watts) = (next()?, next()?, next()?);
    let factor = multiplier * ballast * lamp_factor;
    let mut angles = |count: usize| -> Result<Vec<f32>> {
        let angles = (0..count).map(|_| next()).collect::<Result<Vec<_>>>()?;
        let increasing = angles.windows(2).all(|w| w[0] < w[1]);
        if increasing { Ok(angles) } else { Err(refuse("has angles that do not increase")) }
    };
    let vertical = angles(verticals)?;
    let horizontal = angles(horizontals)?;
    if vertical[0] < 0.0 || vertical[verticals - 1] > 180.0 {
        return Err(refuse("has vertical angles outside 0 to 180 degrees"));
    }
    let rows = (0..horizontals)
        .map(|_| (0..verticals).map(|_| next().map(|v| v.max(0.0))).collect::<Result<Vec<_>>>())
        .collect::<Result<Vec<_>>>()?;
    let (horizontal, rows) = unfold(horizontal, rows).ok_or_else(|| {
        refuse("has horizontal angles that do not cover 0, 0 to 90, 0 to 180, 90 to 270 or 0 to 360 degrees")
    })?;
    let peak = rows.iter().flatten().copied().fold(0.0, f32::max);
    let peak_candela = peak * factor;
    if !(peak_candela > 0.0 && peak_candela.is_finite()) {
        return Err(refuse("has no light in it"));
    }
    let profile = IesProfile {
        vertical_radians: vertical.into_iter().map(f32::to_radians).collect(),
        horizontal_radians: horizontal.into_iter().map(f32::to_radians).collect(),
        intensity: rows.into_iter().flatten().map(|v| v / peak).collect(),
    };
    Ok(Photometry { profile, peak_candela })
}

fn count(value: f32) -> Option<usize> {
    (value.fract() == 0.0 && (1.0..=MAX_ANGLES as f32).contains(&value)).then_some(value as usize)
}

type Web = (Vec<f32>, Vec<Vec<f32>>);

/// Unfolds the symmetries that LM-63 lets a file leave out.
fn unfold(angles: Vec<f32>, rows: Vec<Vec<f32>>) -> Option<Web> {
    let (first, last) = (*angles.first()?, *angles.last()?);
    let near = |value: f32, wanted: f32| (value - wanted).abs() < 0.1;
    /// Appends the web's mirror image about its last angle.
    fn mirror((angles, rows): Web) -> Web {
        let last = angles[angles.len() - 1];
        let (mut more_angles, mut more_rows) = (angles.clone(), rows.clone());
        for i in (0..angles.len() - 1).rev() {
            more_angles.push(2.0 * last - angles[i]);
            more_rows.push(rows[i].clone());
        }
        (more_angles, more_rows)
    }
    match () {
        () if angles.len() == 1 => Some((vec![0.0], rows)),
        () if near(first, 0.0) && near(last, 90.0) => Some(mirror(mirror((angles, rows)))),
        () if near(first, 0.0) && near(last, 180.0) => Some(mirror((angles, rows))),
        () if near(first, 90.0) && near(last, 270.0) => {
            // Mirrored about 270°, to 450°; then turned so that it begins at 0°.
            let (angles, rows) = mirror((angles, rows));
            let begin = angles.iter().position(|&a| a >= 359.9)?;
            let mut turned: Web = (Vec::new(), Vec::new());
            for i in begin..angles.len() {
                turned.0.push((angles[i] - 360.0).max(0.0));
                turned.1.push(rows[i].clone());
            }
            for i in 1..=begin {
                turned.0.push(angles[i]);
                turned.1.push(rows[i].clone());
            }
            // Without a measured plane at 0° the circle would not close.
            (near(angles[begin], 360.0)).then_some(turned)
        }
        () if near(first, 0.0) && last > 270.0 && last < 360.5 => {
            let (mut angles, mut rows) = (angles, rows);
            if !near(last, 360.0) {
                angles.push(360.0);
                rows.push(rows[0].clone());
            }
            Some((angles, rows))
        }
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Photometry> {
        parse(Path::new("a.ies"), text)
    }

    fn degrees(profile: &IesProfile) -> Vec<i32> {
        profile.horizontal_radians.iter().map(|a| a.to_degrees().round() as i32).collect()
    }

    #[test]
    fn a_file_of_1986_without_a_head_is_read() {
        let found = read("a lamp\r\nTILT=NONE\r\n1 1000 2.0 3 1 1 2 -.12 0 0 0.5 1.0 75\n0 45,90\n0\n100. 50 25\n");
        let found = found.unwrap();
        assert_eq!(found.peak_candela, 100.0);
        assert_eq!(found.profile.intensity, [1.0, 0.5, 0.25]);
        assert_eq!(degrees(&found.profile), [0]);
    }

    #[test]
    fn symmetric_webs_are_unfolded_to_the_whole_circle() {
        let web = |head: &str, rows: &str| {
            read(&format!("IESNA:LM-63-2002\n[TEST] x\nTILT=NONE\n{head}\n0 90\n{rows}\n")).unwrap().profile
        };
        let quarter = web("1 1 1 2 3 1 1 0 0 0 1 1 1", "0 45 90\n4 0\n3 0\n2 0");
        assert_eq!(degrees(&quarter), [0, 45, 90, 135, 180, 225, 270, 315, 360]);
        let first: Vec<_> = quarter.intensity.chunks(2).map(|row| (row[0] * 4.0) as i32).collect();
        assert_eq!(first, [4, 3, 2, 3, 4, 3, 2, 3, 4]);
        let half = web("1 1 1 2 2 1 1 0 0 0 1 1 1", "0 180\n4 0\n2 0");
        assert_eq!(degrees(&half), [0, 180, 360]);
        let side = web("1 1 1 2 3 1 1 0 0 0 1 1 1", "90 180 270\n4 0\n3 0\n2 0");
        assert_eq!(degrees(&side), [0, 90, 180, 270, 360]);
        let first: Vec<_> = side.intensity.chunks(2).map(|row| (row[0] * 4.0) as i32).collect();
        assert_eq!(first, [3, 4, 3, 2, 3]);
        let open = web("1 1 1 2 4 1 1 0 0 0 1 1 1", "0 90 180 270.5\n4 0\n3 0\n2 0\n1 0");
        assert_eq!(degrees(&open).last(), Some(&360));
    }

    #[test]
    fn tilt_factors_are_stepped_over() {
        let found = read("IESNA91\nTILT=INCLUDE\n1 2\n0 90\n1 0.8\n1 1 1 2 1 1 1 0 0 0 1 1 1\n0 90\n0\n8 4\n").unwrap();
        assert_eq!(found.peak_candela, 8.0);
    }

    #[test]
    fn every_truncation_and_every_nonsense_is_an_error() {
        let whole = "TILT=NONE\n1 1 1 2 2 1 1 0 0 0 1 1 1 0 90 0 90 4 3 2 1";
        assert!(read(whole).is_ok());
        let words: Vec<_> = whole.split_inclusive([' ', '\n']).collect();
        for kept in 0..words.len() {
            assert!(read(&words[..kept].concat()).is_err(), "{kept} words");
        }
        for (from, to) in
            [(" 2 2 1 1", " 2 2 2 1"), (" 2 2 1 1", " 1e9 2 1 1"), ("0 90 0", "90 0 0"), ("4 3 2 1", "0 0 0 0")]
        {
            assert!(read(&whole.replacen(from, to, 1)).is_err(), "{to}");
        }
    }
}
