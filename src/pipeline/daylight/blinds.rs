//! Blinds: a second matrix of the same scene, in the hours in which they are closed.

use std::fmt;
use std::path::Path;
use std::sync::Mutex;

use rayon::prelude::*;

use super::year_light::YearLight;
use super::{DaylightOptions, DaylightSource};
use crate::daylight::Climate;
use crate::error::{Error, Result};
use crate::matrix::{BlockId, MatrixShape, TracedBlock};
use crate::resources::{Held, PerThread, Progress, ResourceEstimate, Threads};

/// The same scene with its blinds closed, and when they are.
#[derive(Clone, Copy)]
pub struct Blinds<'a> {
    /// The matrix with closed blinds, of the same sensors or pixels.
    pub source: DaylightSource<'a>,
    /// Its name in messages.
    pub place: &'a str,
    /// Whether they are closed, for each step of the climate.
    pub closed: &'a [bool],
}

impl fmt::Debug for Blinds<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let closed = self.closed.iter().filter(|is_closed| **is_closed).count();
        write!(f, "blinds of {}, closed at {closed} of {} steps", self.place, self.closed.len())
    }
}

impl Blinds<'_> {
    /// The light of a climate over the closed blinds, which go with a matrix `open` of a name and a shape. Errors: other sensors or another
    /// climate; those of [`YearLight::new`].
    pub(super) fn year(
        &self,
        (place, open): (&str, MatrixShape),
        climate: &Climate,
        options: &DaylightOptions<'_>,
    ) -> Result<YearLight> {
        if self.closed.len() != climate.steps.len() {
            let problem = format!("blinds have {} steps, the climate {}", self.closed.len(), climate.steps.len());
            return Err(Error::input(self.place, problem, "decide when blinds are closed by the same climate"));
        }
        let job = self.source.job();
        let said = |shape: MatrixShape| (shape.width(), shape.height(), shape.block_side());
        let (own, other) = (said(job.shape), said(open));
        if own != other {
            let of = |(width, height, side)| format!("{width} × {height} places in blocks of {side}");
            let problem = format!("has {}, {place} has {}", of(own), of(other));
            return Err(Error::input(self.place, problem, "render both of the same grid or camera and block_side"));
        }
        YearLight::new(self.place, &job.basis, climate, options)
    }
}

/// How much direct sun is let in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunLimit {
    /// Illuminance by direct sun above which a place counts, in lux.
    pub lux: f32,
    /// Share of the places that may count, 0 to 1.
    pub share: f64,
}

impl Default for SunLimit {
    /// 1,000 lx at 2 % of the places: the rule by which IES LM-83-12 closes the blinds of a window group.
    fn default() -> Self {
        Self { lux: 1000.0, share: 0.02 }
    }
}

/// For each step of a climate, whether more direct sun comes in than the limit says. Places that no light reaches are left out. `place` names
/// the matrix in messages.
///
/// # Errors
/// A matrix that does not tell direct sun: a container, or one whose sky is not split; a limit that is none; those of
/// [`daylight`](super::daylight).
///
/// # Panics
/// If a thread panicked.
pub fn steps_above_sun_limit(
    source: &DaylightSource<'_>,
    place: &str,
    climate: &Climate,
    options: &DaylightOptions<'_>,
    limit: SunLimit,
    watch: &dyn Progress,
) -> Result<Vec<bool>> {
    options.sky.check()?;
    if !(limit.lux >= 0.0 && limit.lux.is_finite() && (0.0..1.0).contains(&limit.share)) {
        let problem = format!("{} lx at {} % of the places are no limit", limit.lux, 100.0 * limit.share);
        return Err(Error::input("direct sun", problem, "give lx from 0 and 0 % to less than 100 %"));
    }
    let (job, steps) = (source.job(), climate.steps.len());
    let shape = job.shape;
    let held = Held(YearLight::bytes(shape.columns(), steps));
    let need = ResourceEstimate::of(&[&held, &PerThread(source.block_bytes(steps) + 8 * steps as u64)]);
    let threads = Threads::new(need.admit("direct sun", Path::new(place), &[], options.memory_bytes, watch)?)?;
    let year = YearLight::new(place, &job.basis, climate, options)?;
    if !(year.knows_sun && matches!(source, DaylightSource::Stored(_))) {
        let hint =
            "give sensors, or a picture that is not packed, under a sky with split = true; or close blinds by a sensor";
        return Err(Error::input(place, "does not tell direct sun, by which blinds are closed", hint));
    }
    let sums = Mutex::new((0, vec![0; year.hours()]));
    watch.begin("direct sun", u64::from(shape.block_count()), "blocks");
    let one = |scratch: &mut TracedBlock, id: BlockId| -> Result<()> {
        if watch.interrupted() {
            return Err(Error::interrupted("nothing is kept of an unfinished year"));
        }
        let mut counts = vec![0; year.hours()];
        let lit = source.hours(id, &year, scratch)?.count_sun(&year, limit.lux, &mut counts);
        let mut sums = sums.lock().expect("no panic holds it");
        sums.0 += lit;
        sums.1.iter_mut().zip(&counts).for_each(|(sum, count): (&mut u32, &u32)| *sum += count);
        drop(sums);
        watch.advance(1, 0, "");
        Ok(())
    };
    let blocks: Vec<BlockId> = shape.blocks().collect();
    let counted = threads.run(|| blocks.into_par_iter().try_for_each_init(TracedBlock::default, one));
    watch.end();
    counted?;
    let (lit, counts) = sums.into_inner().expect("no panic holds it");
    let mut is_above = vec![false; steps];
    for (&step, &count) in year.steps.iter().zip(&counts) {
        is_above[step as usize] = f64::from(count) > limit.share * f64::from(lit);
    }
    Ok(is_above)
}
