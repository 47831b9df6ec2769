//! IES LM-63 files of 1986, 1991, 1995, 2002 and 2019, of photometric types A, B and C.

use std::path::Path;

use super::{MAX_ANGLES, Photometry, Web, lines, mirrored};
use crate::error::{Error, Result};

/// Reads an IES file's text; `path` is for messages.
///
/// Symmetric webs are unfolded; a web of type C with one horizontal angle stays one. Errors: no `TILT` line, too few numbers,
/// angles out of order or out of range, a web without light.
pub(super) fn parse(path: &Path, text: &str) -> Result<Photometry> {
    let refuse = |problem: &str| Error::input(path.display().to_string(), problem, "give an IES LM-63 file");
    let mut lines = lines(text);
    let mut head = None;
    let tilt = loop {
        let line = lines.next().ok_or_else(|| refuse("has no TILT line"))?.trim();
        if let Some(tilt) = tilt_of(line) {
            break tilt;
        }
        head = head.or((!line.is_empty()).then_some(line));
    };
    let edition = Edition::of(head.unwrap_or_default());
    let includes_tilt = tilt.eq_ignore_ascii_case("INCLUDE");
    let words: Vec<&str> = lines.flat_map(str::split_ascii_whitespace).collect();
    let separated: Vec<&str> = words.iter().flat_map(|word| word.split(',')).filter(|word| !word.is_empty()).collect();
    let read = |words: &mut dyn Iterator<Item = &str>| Table::read(words, includes_tilt).map_err(&refuse);
    let mut table = read(&mut separated.iter().copied());
    // A comma may be a decimal one if no number has a point. It then stands between digits, once in each word, and as a
    // separator it would make too many numbers.
    if has_decimal_commas(&words) && !table.as_ref().is_ok_and(|table| table.is_all) {
        let decimal: Vec<String> = words.iter().map(|word| word.replace(',', ".")).collect();
        table = read(&mut decimal.iter().map(String::as_str)).or(table);
    }
    let Table { multiplier, kind, ballast, second, web, .. } = table?;
    let kind = Kind::of(kind).ok_or_else(|| refuse("is of no photometric type that there is (1, 2 or 3)"))?;
    let factor = multiplier * ballast * if edition == Edition::Early { second } else { 1.0 };
    let web = web.without_repeated_angles().ok_or_else(|| refuse("has angles that do not increase"))?;
    let found = match kind {
        Kind::C => {
            if web.vertical[0] < -0.1 || web.vertical[web.vertical.len() - 1] > 180.1 {
                return Err(refuse("has vertical angles outside 0 to 180 degrees"));
            }
            let web = unfold(web).ok_or_else(|| {
                refuse("has horizontal angles that do not cover 0, 0 to 90, 0 to 180, 90 to 270 or 0 to 360 degrees")
            })?;
            Photometry::of_web(web, factor)
        }
        Kind::A | Kind::B => {
            let web = whole(web).ok_or_else(|| refuse("has angles outside −90 to 90 degrees, which its type has"))?;
            let directions = if kind == Kind::A { angles_of_a } else { angles_of_b };
            Photometry::of_other_axes(&web, directions, factor)
        }
    };
    let mut found = found.ok_or_else(|| refuse("has no light in it"))?;
    if edition == Edition::Of2002 && second != 1.0 {
        let said = "the number after the ballast factor has no meaning in LM-63-2002, and is not multiplied";
        found.remarks.push(format!("{}: {said}: {second}", path.display()));
    }
    Ok(found)
}

/// What a `TILT=` line says: `NONE`, `INCLUDE` or a file's name. How a lamp dims when its luminaire is tilted is not used: ours
/// shine as they were measured.
fn tilt_of(line: &str) -> Option<&str> {
    let (key, tilt) = line.split_once('=')?;
    key.trim().eq_ignore_ascii_case("TILT").then(|| tilt.trim())
}

/// Meaning of the number after the ballast factor.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Edition {
    /// To 1995: the factor of ballast and lamp together.
    Early,
    /// "Future use".
    Of2002,
    /// From 2019: how the file was made, such as 1.1 for an accredited laboratory.
    Of2019,
}

impl Edition {
    /// That which the first line states: `IESNA:LM-63-2002`, `IES:LM-63-2019`; files of 1986 have no such line, those of 1991 another.
    fn of(head: &str) -> Self {
        let head = head.replace(' ', "").to_ascii_uppercase();
        let digits = head.split_once("LM-63-").map_or("", |(_, after)| after);
        let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        let year = match digits[..end].parse().unwrap_or(0) {
            short @ 1..=85 => 2000 + short,
            year => year,
        };
        match year {
            2019.. => Self::Of2019,
            2002.. => Self::Of2002,
            _ => Self::Early,
        }
    }
}

/// Whether all commas of numbers can only be decimal ones, or separators without spaces.
fn has_decimal_commas(words: &[&str]) -> bool {
    let is_number = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    let decimal = |word: &str| {
        let (whole, fraction) = word.split_once(',').unwrap_or(("", ""));
        is_number(whole.trim_start_matches(['-', '+'])) && is_number(fraction)
    };
    let mut with_comma = words.iter().filter(|word| word.contains(',')).peekable();
    with_comma.peek().is_some() && with_comma.all(|word| decimal(word)) && !words.iter().any(|word| word.contains('.'))
}

/// The numbers of a file, as they stand there.
struct Table {
    multiplier: f32,
    kind: f32,
    ballast: f32,
    /// The number after the ballast factor.
    second: f32,
    web: Web,
    /// Whether no number is left over.
    is_all: bool,
}

impl Table {
    fn read(words: &mut dyn Iterator<Item = &str>, includes_tilt: bool) -> std::result::Result<Self, &'static str> {
        let mut next = || -> std::result::Result<f32, &'static str> {
            let word = words.next().ok_or("ends before its numbers do")?;
            word.parse().ok().filter(|v: &f32| v.is_finite()).ok_or("has a word where a number should be")
        };
        if includes_tilt {
            let _geometry = next()?;
            let pairs = count(next()?).ok_or("has an impossible number of tilt angles")?;
            for _ in 0..2 * pairs {
                next()?;
            }
        }
        let (_lamps, _lumens, multiplier) = (next()?, next()?, next()?);
        let verticals = count(next()?).ok_or("has an impossible number of vertical angles")?;
        let horizontals = count(next()?).ok_or("has an impossible number of horizontal angles")?;
        let kind = next()?;
        let (_units, _width, _length, _height) = (next()?, next()?, next()?, next()?);
        let (ballast, second, _watts) = (next()?, next()?, next()?);
        let mut list = |count: usize| (0..count).map(|_| next()).collect::<std::result::Result<Vec<_>, _>>();
        let (vertical, horizontal) = (list(verticals)?, list(horizontals)?);
        let mut rows = Vec::new();
        for _ in 0..horizontals {
            rows.push(list(verticals)?.into_iter().map(|v| v.max(0.0)).collect());
        }
        let web = Web { vertical, horizontal, rows };
        Ok(Self { multiplier, kind, ballast, second, web, is_all: words.next().is_none() })
    }
}

/// How the planes of a web lie. In luminaire axes the nadir is −z and the plane of 0° holds +x.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Planes share the vertical axis; (0, 0) is horizontal, along +x.
    A,
    /// Planes share a horizontal axis, y; (0, 0) is the nadir.
    B,
    /// Planes share the vertical axis; vertical angles count from the nadir.
    C,
}

impl Kind {
    fn of(number: f32) -> Option<Self> {
        [(1.0, Self::C), (2.0, Self::B), (3.0, Self::A)].into_iter().find(|(n, _)| *n == number).map(|(_, kind)| kind)
    }
}

/// Horizontal and vertical angle of a direction in a web of type A, in degrees; horizontal ones count clockwise from above.
fn angles_of_a([x, y, z]: [f32; 3]) -> [f32; 2] {
    [turned(-y, x), z.clamp(-1.0, 1.0).asin().to_degrees()]
}

/// As [`angles_of_a`], of type B: the vertical angle turns the plane about y from the nadir towards +x, the horizontal
/// one leads out of it towards −y.
fn angles_of_b([x, y, z]: [f32; 3]) -> [f32; 2] {
    [(-y).clamp(-1.0, 1.0).asin().to_degrees(), turned(x, -z)]
}

/// The angle of a plane, in degrees; 0 on the axis, where all planes meet.
fn turned(sideways: f32, along: f32) -> f32 {
    if sideways.hypot(along) < 1e-5 { 0.0 } else { sideways.atan2(along).to_degrees() }
}

/// A web of type A or B over all that it means: what begins at 0° is symmetric about it. None for angles beyond 90°.
fn whole(mut web: Web) -> Option<Web> {
    let within = |angles: &[f32]| angles.iter().all(|a| (-90.1..=90.1).contains(a));
    if !within(&web.horizontal) || !within(&web.vertical) {
        return None;
    }
    if web.horizontal[0] == 0.0 && web.horizontal.len() > 1 {
        web.horizontal = mirrored(&web.horizontal, |a| -a);
        web.rows = mirrored(&web.rows, Clone::clone);
    }
    if web.vertical[0] == 0.0 && web.vertical.len() > 1 {
        web.vertical = mirrored(&web.vertical, |a| -a);
        web.rows = web.rows.iter().map(|row| mirrored(row, |v| *v)).collect();
    }
    Some(web)
}

fn count(value: f32) -> Option<usize> {
    (value.fract() == 0.0 && (1.0..=MAX_ANGLES as f32).contains(&value)).then_some(value as usize)
}

/// Unfolds the symmetries that type C lets a file omit. A half or a quarter of the circle may start at any angle. Any
/// other range is the whole circle, which may be open at its end, as the spacing of its planes shows.
fn unfold(web: Web) -> Option<Web> {
    let angles = &web.horizontal;
    let (first, last) = (*angles.first()?, *angles.last()?);
    let near = |value: f32, wanted: f32| (value - wanted).abs() < 0.1;
    let is_quarter = near((first + 45.0).rem_euclid(90.0), 45.0);
    let widest = angles.windows(2).map(|w| w[1] - w[0]).fold(0.0, f32::max);
    let (span, gap) = (last - first, 360.0 - (last - first));
    match () {
        () if angles.len() == 1 => Some(Web { horizontal: vec![0.0], ..web }),
        () if is_quarter && near(span, 90.0) => Some(web.continued().continued().whole_circle()),
        () if is_quarter && near(span, 180.0) => Some(web.continued().whole_circle()),
        () if gap > -0.5 && (gap < 90.1 || gap < 1.01 * widest) => Some(web.whole_circle()),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::IesProfile;
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
            [(" 2 2 1 1", " 2 2 4 1"), (" 2 2 1 1", " 1e9 2 1 1"), ("0 90 0", "90 0 0"), ("4 3 2 1", "0 0 0 0")]
        {
            assert!(read(&whole.replacen(from, to, 1)).is_err(), "{to}");
        }
    }
    /// Relative intensity at a grid point of the sphere that webs of type A and B become.
    fn at(found: &Photometry, vertical: f32, horizontal: f32) -> f32 {
        let IesProfile { vertical_radians, horizontal_radians, intensity } = &found.profile;
        let place = |angles: &[f32], wanted: f32| {
            angles.iter().position(|a| (a.to_degrees() - wanted).abs() < 1e-3).expect("a point of the grid")
        };
        intensity[place(horizontal_radians, horizontal) * vertical_radians.len() + place(vertical_radians, vertical)]
    }

    /// By hand: H 0, V 0 is level along the plane of 0°; V 90 the zenith; H 90 a quarter turn clockwise from above, 270°.
    #[test]
    fn type_a_shines_level() {
        let found = read("TILT=NONE\n1 1 2 3 3 3 1 0 0 0 1 1 1\n-90 0 90\n-90 0 90\n1 10 3\n1 20 3\n1 5 3\n").unwrap();
        assert_eq!(found.peak_candela, 40.0);
        for (vertical, horizontal, wanted) in
            [(90.0, 0.0, 20.0), (0.0, 0.0, 1.0), (180.0, 0.0, 3.0), (90.0, 270.0, 5.0), (90.0, 90.0, 10.0)]
        {
            let found = 20.0 * at(&found, vertical, horizontal);
            assert!((found - wanted).abs() < 1e-3, "{vertical}, {horizontal}: {found} for {wanted}");
        }
        // Halfway between 20 and 5, and behind the luminaire.
        assert!((20.0 * at(&found, 90.0, 315.0) - 12.5).abs() < 1e-3);
        assert_eq!(at(&found, 90.0, 180.0), 0.0);
    }

    /// By hand: H 0, V 0 is the nadir; V 90 level along 0°, V −90 along 180°; H 90 level at 270°, whatever V is.
    #[test]
    fn type_b_shines_down() {
        let web = "TILT=NONE\n1 1 1 3 3 2 1 0 0 0 1 1 1\n-90 0 90\n-90 0 90\n6 6 6\n2 20 4\n8 8 8\n";
        let found = read(web).unwrap();
        for (vertical, horizontal, wanted) in [
            (0.0, 0.0, 20.0),
            (90.0, 0.0, 4.0),
            (90.0, 180.0, 2.0),
            (90.0, 270.0, 8.0),
            (90.0, 90.0, 6.0),
            (45.0, 0.0, 12.0),
        ] {
            let found = 20.0 * at(&found, vertical, horizontal);
            assert!((found - wanted).abs() < 1e-3, "{vertical}, {horizontal}: {found} for {wanted}");
        }
        // 45° out of the plane towards 270°: H 45, V 0, between 20 and 8.
        assert!((20.0 * at(&found, 45.0, 270.0) - 14.0).abs() < 1e-3);
        assert_eq!(at(&found, 180.0, 0.0), 0.0);
    }

    #[test]
    fn types_a_and_b_that_begin_at_0_are_symmetric() {
        for kind in [2, 3] {
            let head = format!("TILT=NONE\n1 1 1 2 2 {kind} 1 0 0 0 1 1 1\n");
            let short = read(&format!("{head}0 90\n0 90\n4 3\n2 1\n")).unwrap();
            let head = head.replace(" 2 2 ", " 3 3 ");
            let long = read(&format!("{head}-90 0 90\n-90 0 90\n1 2 1\n3 4 3\n1 2 1\n")).unwrap();
            assert_eq!(short, long);
        }
        assert!(read("TILT=NONE\n1 1 1 2 2 2 1 0 0 0 1 1 1\n0 120\n0 90\n4 3\n2 1\n").is_err());
    }

    #[test]
    fn editions_are_told_by_their_first_line() {
        for (head, edition) in [
            ("IESNA:LM-63-2019", Edition::Of2019),
            ("IES:LM-63-2019", Edition::Of2019),
            ("ies: lm-63-19", Edition::Of2019),
            ("IESNA:LM-63-2002", Edition::Of2002),
            ("IESNA:LM-63-02 ", Edition::Of2002),
            ("IESNA:LM-63-1995", Edition::Early),
            ("IESNA91", Edition::Early),
            ("", Edition::Early),
        ] {
            assert_eq!(Edition::of(head), edition, "{head}");
        }
    }

    /// By hand: a comma is a decimal one where as a separator it would make too many numbers.
    #[test]
    fn commas_are_what_makes_the_numbers_come_out() {
        let decimal = read("TILT=NONE\n1 1000 1,5 2 1 1 2 0,1 0 0\n1,0 1,0 10\n0,0 90\n0\n200,5 0\n").unwrap();
        assert_eq!(decimal.peak_candela, 1.5 * 200.5);
        let separated = read("TILT=NONE\n1,1000,2,2,1,1,2,0,0,0\n1,1,10\n0,90\n0\n200,50\n").unwrap();
        assert_eq!((separated.peak_candela, separated.profile.intensity.len()), (400.0, 2));
        let with_points = read("TILT=NONE\n1 1000 2.0 2 1 1 2 0 0 0\n1 1 10\n0,90\n0\n200,50\n").unwrap();
        assert_eq!(with_points.peak_candela, 400.0);
    }
}
