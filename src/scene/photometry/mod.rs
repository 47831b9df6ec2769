//! Measured luminaires: what IES and EULUMDAT files have in common.

mod eulumdat;
mod ies;

use std::path::Path;

use super::IesProfile;
use crate::error::Result;

/// Bytes of a photometric file at most. Real files have some thousand.
pub(super) const MAX_PHOTOMETRY_BYTES: u64 = 16 << 20;
/// Most angles of one kind that a file may state. Real files have at most a few hundred.
pub(super) const MAX_ANGLES: usize = 4096;
/// Finest and coarsest step of the sphere that a web with other axes is sampled on, in degrees.
const STEPS: [f32; 2] = [0.25, 1.0];

/// The content of a photometric file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Photometry {
    /// Intensity relative to its largest value, over the full horizontal circle or one angle.
    pub(super) profile: IesProfile,
    /// The largest intensity, with all of the file's factors.
    pub(super) peak_candela: f32,
    /// What was not heeded or looks wrong, one line each with the file's name.
    pub(super) remarks: Vec<String>,
}

/// Reads a photometric file, EULUMDAT where the name ends in `.ldt`, else IES.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Photometry> {
    let text = text(bytes);
    match path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ldt")) {
        true => eulumdat::parse(path, &text),
        false => ies::parse(path, &text),
    }
}

/// The text of a file: UTF-16 where its mark or its zeros say so, else ASCII with whatever else in names and remarks. The end mark of
/// old systems and zeros are spaces.
fn text(bytes: &[u8]) -> String {
    let zeros = |from: usize| bytes.iter().skip(from).step_by(2).take(64).filter(|byte| **byte == 0).count();
    let units = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        String::from_utf16_lossy(&bytes.as_chunks::<2>().0.iter().map(|pair| unit(*pair)).collect::<Vec<_>>())
    };
    let text = match bytes {
        [0xff, 0xfe, rest @ ..] => units(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => units(rest, u16::from_be_bytes),
        _ if zeros(1) > 16 && zeros(0) == 0 => units(bytes, u16::from_le_bytes),
        _ if zeros(0) > 16 && zeros(1) == 0 => units(bytes, u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)).into_owned(),
    };
    text.replace(['\0', '\u{1a}'], " ")
}

/// The lines of a text, whichever system ends them.
pub(super) fn lines(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.find(['\r', '\n']) else {
            rest = None;
            return (!text.is_empty()).then_some(text);
        };
        let after = if text[end..].starts_with("\r\n") { end + 2 } else { end + 1 };
        rest = Some(&text[after..]);
        Some(&text[..end])
    })
}

/// Intensities over two kinds of angles, in degrees, as a file has them.
#[derive(Clone, Debug)]
pub(super) struct Web {
    pub(super) vertical: Vec<f32>,
    pub(super) horizontal: Vec<f32>,
    /// For each horizontal angle one row over the vertical ones.
    pub(super) rows: Vec<Vec<f32>>,
}

/// A list that begins at the middle, with its mirror image before it.
pub(super) fn mirrored<T>(half: &[T], image: impl Fn(&T) -> T) -> Vec<T>
where
    T: Clone,
{
    half.iter().skip(1).rev().map(image).chain(half.iter().cloned()).collect()
}

impl Web {
    /// With the web's mirror image about its last horizontal angle.
    pub(super) fn continued(mut self) -> Self {
        let count = self.horizontal.len();
        let last = self.horizontal[count - 1];
        for i in (0..count - 1).rev() {
            self.horizontal.push(2.0 * last - self.horizontal[i]);
            self.rows.push(self.rows[i].clone());
        }
        self
    }

    /// A circle that begins anywhere, closed or not, from 0 to 360°; the plane at 0° is made of its neighbours where none was
    /// measured there.
    pub(super) fn whole_circle(self) -> Self {
        let Self { vertical, horizontal, rows } = self;
        let mut planes: Vec<(f32, Vec<f32>)> = horizontal
            .iter()
            .map(|angle| angle.rem_euclid(360.0))
            .map(|a| if a > 359.95 { 0.0 } else { a })
            .zip(rows)
            .collect();
        planes.sort_by(|a, b| a.0.total_cmp(&b.0));
        planes.dedup_by(|later, earlier| later.0 - earlier.0 < 0.05);
        let (first, last) = (&planes[0], &planes[planes.len() - 1]);
        if first.0 < 0.05 {
            planes[0].0 = 0.0;
        } else {
            let before = 360.0 - last.0;
            let share = before / (before + first.0);
            let row = last.1.iter().zip(&first.1).map(|(l, f)| l * (1.0 - share) + f * share).collect();
            planes.insert(0, (0.0, row));
        }
        planes.push((360.0, planes[0].1.clone()));
        let (horizontal, rows) = planes.into_iter().unzip();
        Self { vertical, horizontal, rows }
    }

    /// Without the angles that stand there twice, of which the first counts. None where angles decrease.
    pub(super) fn without_repeated_angles(mut self) -> Option<Self> {
        let increase = |angles: &[f32]| angles.windows(2).all(|w| w[0] <= w[1]);
        if !increase(&self.vertical) || !increase(&self.horizontal) {
            return None;
        }
        let kept =
            |angles: &[f32]| -> Vec<bool> { (0..angles.len()).map(|i| i == 0 || angles[i] > angles[i - 1]).collect() };
        fn keep<T>(list: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            list.retain(|_| *kept.next().unwrap_or(&false));
        }
        let (vertical, horizontal) = (kept(&self.vertical), kept(&self.horizontal));
        self.rows.iter_mut().for_each(|row| keep(row, &vertical));
        keep(&mut self.rows, &horizontal);
        keep(&mut self.vertical, &vertical);
        keep(&mut self.horizontal, &horizontal);
        Some(self)
    }

    /// The intensity between the measured ones; 0 beyond them.
    fn at(&self, [horizontal, vertical]: [f32; 2]) -> f32 {
        let (Some((h, across)), Some((v, along))) =
            (between(&self.horizontal, horizontal), between(&self.vertical, vertical))
        else {
            return 0.0;
        };
        let row = |h: usize| {
            let row = &self.rows[h.min(self.rows.len() - 1)];
            row[v] * (1.0 - along) + row[(v + 1).min(row.len() - 1)] * along
        };
        row(h) * (1.0 - across) + row(h + 1) * across
    }
}

/// Index and fraction of a place between increasing numbers.
fn between(numbers: &[f32], place: f32) -> Option<(usize, f32)> {
    let after = numbers.partition_point(|n| *n <= place);
    match (after.checked_sub(1), numbers.get(after)) {
        (Some(i), Some(next)) => Some((i, (place - numbers[i]) / (next - numbers[i]))),
        // Angles from directions are rounded.
        (Some(i), None) => (place - numbers[i] < 1e-2).then_some((i, 0.0)),
        (None, _) => numbers.first().filter(|n| **n - place < 1e-2).map(|_| (0, 0.0)),
    }
}

impl Photometry {
    /// Of a web whose vertical angles count from the nadir and whose horizontal ones are one or the whole circle, times
    /// `factor` to make candela of it. None where it has no light.
    pub(super) fn of_web(web: Web, factor: f32) -> Option<Self> {
        let Web { vertical, horizontal, rows } = web;
        let peak = rows.iter().flatten().copied().fold(0.0, f32::max);
        let peak_candela = peak * factor;
        let profile = IesProfile {
            vertical_radians: vertical.into_iter().map(f32::to_radians).collect(),
            horizontal_radians: horizontal.into_iter().map(f32::to_radians).collect(),
            intensity: rows.into_iter().flatten().map(|v| v / peak).collect(),
        };
        (peak_candela > 0.0 && peak_candela.is_finite()).then_some(Self { profile, peak_candela, remarks: Vec::new() })
    }

    /// Of a web with other axes, sampled over the sphere in steps as fine as its own; `angles` gives the web's horizontal and
    /// vertical angle of a unit direction in luminaire axes.
    pub(super) fn of_other_axes(web: &Web, angles: fn([f32; 3]) -> [f32; 2], factor: f32) -> Option<Self> {
        let steps = web.horizontal.windows(2).chain(web.vertical.windows(2)).map(|w| w[1] - w[0]);
        let step = steps.fold(STEPS[1], f32::min).max(STEPS[0]);
        let count = |degrees: f32| (degrees / step).ceil() as usize;
        let places = |degrees: f32| -> Vec<f32> {
            (0..=count(degrees)).map(|i| degrees * i as f32 / count(degrees) as f32).collect()
        };
        let (vertical, horizontal) = (places(180.0), places(360.0));
        let row = |h: &f32| {
            let (sin_h, cos_h) = h.to_radians().sin_cos();
            let toward = |v: &f32| {
                let (sin_v, cos_v) = v.to_radians().sin_cos();
                web.at(angles([sin_v * cos_h, sin_v * sin_h, -cos_v]))
            };
            vertical.iter().map(toward).collect()
        };
        let rows = horizontal.iter().map(row).collect();
        // The strongest direction may lie between the steps: what the file says is the peak.
        let measured = web.rows.iter().flatten().copied().fold(0.0, f32::max);
        let mut found = Self::of_web(Web { vertical, horizontal, rows }, factor)?;
        let sampled = found.peak_candela / (measured * factor);
        found.profile.intensity.iter_mut().for_each(|v| *v *= sampled);
        found.peak_candela = measured * factor;
        found.peak_candela.is_finite().then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_every_coding_are_read() {
        let wide = |mark: bool, swap: bool| -> Vec<u8> {
            let text = format!(
                "{}{}",
                if mark { "\u{feff}" } else { "" },
                "TILT=NONE, a line of some length without a mark\r\n1"
            );
            text.encode_utf16().flat_map(|unit| if swap { unit.to_be_bytes() } else { unit.to_le_bytes() }).collect()
        };
        let whole = "TILT=NONE, a line of some length without a mark\r\n1";
        for bytes in [wide(true, false), wide(true, true), wide(false, false), wide(false, true), whole.into()] {
            assert_eq!(text(&bytes), whole);
        }
        assert_eq!(text(b"\xef\xbb\xbfa\x1a"), "a ");
        assert_eq!(lines("a\rb\r\nc\n\nd").collect::<Vec<_>>(), ["a", "b", "c", "", "d"]);
        assert_eq!(lines("a\r\n").collect::<Vec<_>>(), ["a"]);
    }

    #[test]
    fn circles_that_begin_anywhere_begin_at_0() {
        let circle = |horizontal: &[f32], rows: &[f32]| {
            let web = Web {
                vertical: vec![0.0],
                horizontal: horizontal.into(),
                rows: rows.iter().map(|v| vec![*v]).collect(),
            };
            let web = web.whole_circle();
            (web.horizontal, web.rows.concat())
        };
        let (angles, values) = circle(&[-90.0, 0.0, 90.0, 180.0, 270.0], &[1.0, 2.0, 3.0, 4.0, 1.0]);
        assert_eq!((angles, values), (vec![0.0, 90.0, 180.0, 270.0, 360.0], vec![2.0, 3.0, 4.0, 1.0, 2.0]));
        let (angles, values) = circle(&[30.0, 150.0, 300.0], &[1.0, 2.0, 4.0]);
        assert_eq!((angles, values), (vec![0.0, 30.0, 150.0, 300.0, 360.0], vec![2.0, 1.0, 2.0, 4.0, 2.0]));
    }
}
