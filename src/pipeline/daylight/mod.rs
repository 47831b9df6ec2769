//! A year of daylight over the pixels or sensors of a matrix, block by block.

mod blinds;
mod hours_file;
mod output;
mod product;
mod sensor;
mod sky_lights;
mod year_light;

use std::path::Path;
use std::sync::Mutex;

use rayon::prelude::*;

pub use self::blinds::{Blinds, SunLimit, steps_above_sun_limit};
use self::hours_file::HoursFile;
pub use self::output::{write_glare, write_glare_hours, write_ill, write_measures};
use self::product::{BlindsState, BlockHours, PixelHours};
pub use self::sensor::{SensorYear, sensor_years};
pub use self::sky_lights::{StandardSky, lighting_at, lighting_under};
use self::year_light::YearLight;
use crate::container::ContainerReader;
use crate::daylight::{
    ANNUAL_MEASURES, AnnualMeasures, Climate, EyeGlare, HourSums, Schedule, SkyOptions, SpatialMeasures, Thresholds,
};
use crate::error::{Error, Result};
use crate::light::Job;
use crate::matrix::{BlockId, BlockSource, TracedBlock};
use crate::resources::{Held, PerThread, Progress, ResourceEstimate, Threads};
use crate::store::StoreReader;

/// Place of the mean illuminance in [`ANNUAL_MEASURES`].
const MEAN: usize = 6;

/// Mean illuminance over the median of a picture's below which a pixel of a container sees no surface: what compression leaves where an
/// emitter is in view.
const LEFT_OVER: f32 = 0.02;

/// Choices of a year.
#[derive(Clone, Copy, Debug, Default)]
pub struct DaylightOptions<'a> {
    /// Blinds that are closed in some hours; none: the matrix as it is in all.
    pub blinds: Option<Blinds<'a>>,
    /// Ground and north.
    pub sky: SkyOptions,
    /// The time of use.
    pub schedule: Schedule,
    /// Illuminances that measures ask for.
    pub thresholds: Thresholds,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
    /// Whether files are replaced.
    pub overwrite: bool,
}

/// A matrix whose rows are irradiance, in either form.
#[derive(Clone, Copy)]
pub enum DaylightSource<'a> {
    /// A container.
    Container(&'a ContainerReader),
    /// A stored matrix.
    Stored(&'a StoreReader),
}

/// What a year gives.
#[derive(Clone, Debug)]
pub struct DaylightYear {
    /// Pixels or sensors (across, down).
    pub size: (u32, u32),
    /// Measures of each, row by row; NaN where no light reaches.
    pub measures: Vec<AnnualMeasures>,
    /// Measures of all that any light reaches.
    pub space: SpatialMeasures,
    /// Pixels or sensors that no light reaches; of a container also pixels below a fiftieth of the median's illuminance, which see
    /// emitters and no surface.
    pub dark: usize,
    /// Glare at each where they are eyes (`thresholds` has limits of glare), else empty; none where no light reaches.
    pub glare: Vec<Option<EyeGlare>>,
    /// Lit steps of the climate.
    pub lit_steps: usize,
}

impl DaylightSource<'_> {
    fn job(&self) -> &Job {
        match self {
            Self::Container(container) => container.job(),
            Self::Stored(matrix) => matrix.job(),
        }
    }

    /// A block over the hours of a year.
    fn hours(&self, id: BlockId, year: &YearLight, scratch: &mut TracedBlock) -> Result<BlockHours> {
        Ok(match self {
            Self::Container(container) => BlockHours::of_factors(&container.read_block(id)?, year),
            Self::Stored(matrix) => {
                let pixels = self.job().shape.rect(id).pixels();
                let mut made = None;
                matrix.visit_block(id, scratch, &mut |block| {
                    made = Some(BlockHours::of_entries(block.view(), pixels, year));
                    Ok(())
                })?;
                made.ok_or_else(|| Error::input(id.to_string(), "was not read", ""))?
            }
        })
    }

    /// Upper bound of the bytes of a block over so many hours.
    fn block_bytes(&self, hours: usize) -> u64 {
        let shape = self.job().shape;
        let (pixels, columns) = ((shape.block_side() as usize).pow(2), shape.columns());
        match self {
            Self::Container(container) => {
                let rank = shape.blocks().map(|id| container.rank(id)).max().unwrap_or(0);
                BlockHours::bytes_of_factors(pixels, rank, columns, hours)
            }
            Self::Stored(_) => shape.max_block_bytes() + BlockHours::bytes_of_entries(pixels, columns),
        }
    }
}

/// The year of a climate over a matrix whose rows are irradiance; `place` names it in messages. With `hours`, the illuminance of every
/// pixel at every step of the climate goes to a NumPy array `[pixels, steps]` there, as it is made.
///
/// Memory grows with the pixels by their measures alone, and not with pixels × hours. With blinds, hours of direct sun and the daylight factor
/// are those of open ones.
///
/// # Errors
/// Options that are out of range; blinds whose matrix or hours are not of these sensors and this climate; a matrix without a sky, or with one that does not fit its places of the sun; a block that cannot be read; too little memory; the system
/// refuses to write; [`Error::Interrupted`] when the watch says so.
///
/// # Panics
/// If a thread panicked.
pub fn daylight(
    source: &DaylightSource<'_>,
    place: &str,
    climate: &Climate,
    options: &DaylightOptions<'_>,
    hours: Option<&Path>,
    watch: &dyn Progress,
) -> Result<DaylightYear> {
    options.sky.check()?;
    let Job { shape, basis, .. } = source.job();
    let (pixels, block) = (shape.width() as usize * shape.height() as usize, shape.block_side() as usize);
    let (columns, steps) = (shape.columns(), climate.steps.len());
    let kept = if hours.is_some() { 4 * (block * block * steps) as u64 } else { 0 };
    let measured = pixels * (size_of::<AnnualMeasures>() + size_of::<HourSums>());
    let closed_columns = options.blinds.map_or(0, |blinds| blinds.source.job().shape.columns());
    let block_bytes =
        options.blinds.map_or(0, |blinds| blinds.source.block_bytes(steps)).max(source.block_bytes(steps));
    let parts = [Held(YearLight::bytes(columns + closed_columns, steps)), Held(measured as u64)];
    let need = ResourceEstimate::of(&[&parts[0], &parts[1], &PerThread(block_bytes + kept)]);
    let output = hours.unwrap_or(Path::new(place));
    let threads = Threads::new(need.admit("the year", output, &[], options.memory_bytes, watch)?)?;
    let closed = options.blinds.map(|blinds| blinds.year((place, *shape), climate, options)).transpose()?;
    let mut year = YearLight::new(place, basis, climate, options)?;
    // Compression keeps what lightings of many columns show: of a place of the sun alone it loses whether 1,000 lx are reached.
    year.knows_sun &= matches!(source, DaylightSource::Stored(_));
    let year = year;
    let file = hours.map(|path| HoursFile::begin(path, [pixels, steps], options.overwrite)).transpose()?;
    let sums = Mutex::new(vec![HourSums::default(); pixels]);
    watch.begin("the year", u64::from(shape.block_count()), "blocks");
    let one = |scratch: &mut TracedBlock, id: BlockId| -> Result<()> {
        if watch.interrupted() {
            return Err(Error::interrupted("nothing is kept of an unfinished year"));
        }
        let rect = shape.rect(id);
        let hours = source.hours(id, &year, scratch)?;
        let mut own = vec![HourSums::default(); rect.pixels()];
        let mut kept = file.as_ref().map(|_| vec![0.0; rect.pixels() * year.hours()]);
        let mut target = PixelHours { sums: &mut own, hours: kept.as_deref_mut() };
        hours.add_to(&year, &options.thresholds, BlindsState::Open, &mut target);
        drop(hours);
        if let (Some(blinds), Some(year)) = (&options.blinds, &closed) {
            let hours = blinds.source.hours(id, year, scratch)?;
            hours.add_to(year, &options.thresholds, BlindsState::Closed, &mut target);
        }
        let at = |pixel: usize| {
            let (x, y) = (pixel as u32 % rect.width, pixel as u32 / rect.width);
            (rect.y + y) as usize * shape.width() as usize + (rect.x + x) as usize
        };
        if let (Some(file), Some(kept)) = (&file, &kept) {
            file.write(&year.steps, kept, at)?;
        }
        let mut sums = sums.lock().expect("no panic holds it");
        own.into_iter().enumerate().for_each(|(pixel, own)| sums[at(pixel)] = own);
        drop(sums);
        watch.advance(1, (rect.pixels() * year.hours()) as u64, "hours of pixels");
        Ok(())
    };
    let made =
        threads.run(|| shape.blocks().collect::<Vec<_>>().into_par_iter().try_for_each_init(TracedBlock::default, one));
    watch.end();
    made?;
    if let Some(file) = file {
        file.finish()?;
    }
    let sums = sums.into_inner().expect("no panic holds it");
    Ok(summed_up(source, (&year, climate.step_hours()), options, &sums))
}

/// The year of all places from the sums of their hours.
fn summed_up(
    source: &DaylightSource<'_>,
    (year, step_hours): (&YearLight, f64),
    options: &DaylightOptions<'_>,
    sums: &[HourSums],
) -> DaylightYear {
    let of = |sums: &HourSums| sums.measures(year.used, year.day, step_hours, year.knows_sun);
    let mut measures: Vec<AnnualMeasures> = sums.iter().map(of).collect();
    let least = match source {
        DaylightSource::Container(_) => LEFT_OVER * median(measures.iter().map(|pixel| pixel.values[MEAN])),
        DaylightSource::Stored(_) => 0.0,
    };
    for (pixel, sums) in measures.iter_mut().zip(sums) {
        if sums.is_dark() || pixel.values[MEAN] < least {
            pixel.values = [f32::NAN; ANNUAL_MEASURES.len()];
        }
    }
    let is_lit = |pixel: &AnnualMeasures| !pixel.values[MEAN].is_nan();
    let space = SpatialMeasures::of(measures.iter().filter(|pixel| is_lit(pixel)));
    let dark = measures.iter().filter(|pixel| !is_lit(pixel)).count();
    let eyes = sums.iter().zip(&measures).filter(|_| options.thresholds.glare.is_some());
    let glare = eyes.map(|(sums, pixel)| is_lit(pixel).then(|| sums.eye_glare(year.used))).collect();
    let shape = source.job().shape;
    let size = (shape.width(), shape.height());
    DaylightYear { size, measures, space, dark, glare, lit_steps: year.hours() }
}

/// The median of the values above 0; 0 without any.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut lit: Vec<f32> = values.filter(|value| *value > 0.0).collect();
    let middle = lit.len() / 2;
    if lit.is_empty() { 0.0 } else { *lit.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
