//! The lighting of a year over the columns of a matrix.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use rayon::prelude::*;

use super::DaylightOptions;
use super::sky_lights::SkyLights;
use crate::daylight::{CieSky, Climate, SkyModel, Sun};
use crate::error::{Error, Result};
use crate::light::LightBasis;

/// The sun of an overcast sky, which is the same around it.
const OVERCAST_SUN: Sun = Sun { altitude: FRAC_PI_2, azimuth: 0.0 };

/// Light of the sun on a column at an hour.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunWeight {
    pub(super) column: u32,
    pub(super) hour: u32,
    pub(super) weight: f32,
    /// Whether the column has what comes straight from the sun.
    pub(super) is_direct: bool,
}

/// Hours in a row of which the same is asked.
#[derive(Clone, Debug)]
pub(super) struct Segment {
    pub(super) hours: Range<usize>,
    pub(super) is_used: bool,
    pub(super) is_day: bool,
    /// Whether blinds are closed.
    pub(super) is_closed: bool,
}

/// The lit steps of a climate, ordered by what is asked of them, and the weights of the columns in each.
pub(super) struct YearLight {
    /// Step of the climate of each hour.
    pub(super) steps: Vec<u32>,
    pub(super) segments: Vec<Segment>,
    first_column: u32,
    texels: u32,
    is_split: bool,
    /// Texels × hours.
    pub(super) sky: Vec<f32>,
    /// By column, then hour.
    pub(super) sun: Vec<SunWeight>,
    of_column: HashMap<u32, Range<usize>>,
    /// Steps in the time of use, and with the sun up, dark ones among them.
    pub(super) used: u32,
    pub(super) day: u32,
    /// Whether what comes straight from the sun has columns that are apart from the rest.
    pub(super) knows_sun: bool,
    /// Radiance of each texel under the CIE overcast sky that lights open ground by 100 lx: illuminance is then the daylight factor in percent.
    pub(super) overcast: Vec<f32>,
}

impl YearLight {
    /// The light of a climate over a basis; `place` names the matrix in messages. Blinds are closed at as many steps as the climate has.
    pub(super) fn new(
        place: &str,
        basis: &LightBasis,
        climate: &Climate,
        options: &DaylightOptions<'_>,
    ) -> Result<Self> {
        let lights = SkyLights::of(place, basis)?;
        let (count, texels, is_split) = (lights.count(), lights.texels(), lights.is_split);
        let model = SkyModel::new(climate, options.sky);
        let is_day = |step: usize| model.sun(&climate.steps[step]).altitude > 0.0;
        let is_used = |step: usize| options.schedule.holds(&climate.steps[step]);
        let is_closed = |step: usize| options.blinds.is_some_and(|blinds| blinds.closed[step]);
        let lit = (0..climate.steps.len()).into_par_iter();
        let mut lit: Vec<_> = lit.filter_map(|step| Some((step, model.at(&climate.steps[step], texels)?))).collect();
        if lit.is_empty() {
            return Err(Error::input(&*climate.site.name, "has no light at any time", "give another climate"));
        }
        lit.sort_by_key(|(step, _)| (!is_used(*step), !is_day(*step), is_closed(*step), *step));
        let mut year = Self {
            steps: lit.iter().map(|(step, _)| *step as u32).collect(),
            segments: Vec::new(),
            first_column: lights.sky.first_column,
            texels: count as u32,
            is_split,
            sky: vec![0.0; count * lit.len()],
            sun: Vec::new(),
            of_column: HashMap::new(),
            used: (0..climate.steps.len()).filter(|step| is_used(*step)).count() as u32,
            day: (0..climate.steps.len()).filter(|step| is_day(*step)).count() as u32,
            knows_sun: is_split,
            overcast: texels.standard(CieSky::Overcast, OVERCAST_SUN, 100.0, options.sky.ground_reflectance),
        };
        let hours = lit.len();
        year.sky.par_chunks_exact_mut(hours).enumerate().for_each(|(texel, row)| {
            row.iter_mut().zip(&lit).for_each(|(value, (_, now))| *value = now.radiance[texel]);
        });
        for (hour, (_, now)) in lit.iter().enumerate() {
            let hour = hour as u32;
            lights.put_sun(place, now, |column, weight, is_direct| {
                year.sun.push(SunWeight { column, hour, weight, is_direct });
            })?;
        }
        year.segments = segments(&year.steps, |step| (is_used(step), is_day(step), is_closed(step)));
        year.sun.sort_by_key(|sun| (sun.column, sun.hour));
        let mut start = 0;
        for run in year.sun.chunk_by(|a, b| a.column == b.column) {
            year.of_column.insert(run[0].column, start..start + run.len());
            start += run.len();
        }
        Ok(year)
    }

    /// Number of lit hours.
    pub(super) fn hours(&self) -> usize {
        self.steps.len()
    }

    /// The row of [`Self::sky`] that lights a column.
    pub(super) fn sky_row(&self, column: u32) -> Option<&[f32]> {
        let texel = column.checked_sub(self.first_column)?;
        let rows = self.texels * (1 + u32::from(self.is_split));
        let texel = (texel < rows).then_some((texel % self.texels) as usize)?;
        Some(&self.sky[texel * self.hours()..][..self.hours()])
    }

    /// Columns of the sky, and texels of it.
    pub(super) fn sky_columns(&self) -> (Range<usize>, usize) {
        let (first, texels) = (self.first_column as usize, self.texels as usize);
        (first..first + texels * (1 + usize::from(self.is_split)), texels)
    }

    /// The sun on a column, hour by hour.
    pub(super) fn sun_of(&self, column: u32) -> &[SunWeight] {
        self.of_column.get(&column).map_or(&[], |range| &self.sun[range.clone()])
    }

    /// Bytes that it takes.
    pub(super) fn bytes(columns: usize, steps: usize) -> u64 {
        // While it is made, each value of the sky is there twice. The sun is on four texels, twice where the sky is split, and on its place.
        (2 * size_of::<f32>() * columns + 9 * size_of::<SunWeight>()) as u64 * steps as u64
    }
}

/// Runs of hours with the same answers.
fn segments(steps: &[u32], of: impl Fn(usize) -> (bool, bool, bool)) -> Vec<Segment> {
    let (mut segments, mut start) = (Vec::new(), 0);
    for run in steps.chunk_by(|a, b| of(*a as usize) == of(*b as usize)) {
        let (is_used, is_day, is_closed) = of(run[0] as usize);
        segments.push(Segment { hours: start..start + run.len(), is_used, is_day, is_closed });
        start += run.len();
    }
    segments
}
