//! Measured luminaires: what IES and EULUMDAT files have in common.

use std::path::Path;

use super::{IesProfile, eulumdat, ies};
use crate::error::Result;

/// Bytes of a photometric file at most. Real files have some thousand.
pub(super) const MOST_PHOTOMETRY_BYTES: u64 = 16 << 20;
/// Most angles of one kind that a file may state. Real files have at most a few hundred.
pub(super) const MAX_ANGLES: usize = 4096;
/// Finest and coarsest step of the sphere that a web with other axes is sampled on, in degrees.
const STEPS: [f32; 2] = [0.25, 1.0];

/// What a photometric file says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Photometry {
    /// Intensity relative to its largest value, over the full horizontal circle or one angle.
    pub(super) profile: IesProfile,
    /// The largest intensity, with all of the file's factors.
    pub(super) peak_candela: f32,
}

/// Reads a photometric file's text, EULUMDAT where the name ends in `.ldt`, else IES.
pub(super) fn parse(path: &Path, text: &str) -> Result<Photometry> {
    match path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ldt")) {
        true => eulumdat::parse(path, text),
        false => ies::parse(path, text),
    }
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

    /// A circle that begins anywhere, from 0 to 360°. None where no plane was measured at 0°: it would not close.
    pub(super) fn turned(self) -> Option<Self> {
        let begin = self.horizontal.iter().position(|&a| a >= 359.9)?;
        if self.horizontal[begin] > 360.1 {
            return None;
        }
        let order = (begin..self.horizontal.len()).map(|i| (i, 360.0)).chain((1..=begin).map(|i| (i, 0.0)));
        let (horizontal, rows) =
            order.map(|(i, less)| ((self.horizontal[i] - less).max(0.0), self.rows[i].clone())).unzip();
        Some(Self { vertical: self.vertical, horizontal, rows })
    }

    /// A circle from 0°, with its first plane once more at 360°.
    pub(super) fn closed(mut self) -> Self {
        if self.horizontal.last().is_none_or(|last| (last - 360.0).abs() >= 0.1) {
            self.horizontal.push(360.0);
            self.rows.push(self.rows[0].clone());
        }
        self
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
        (peak_candela > 0.0 && peak_candela.is_finite()).then_some(Self { profile, peak_candela })
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
