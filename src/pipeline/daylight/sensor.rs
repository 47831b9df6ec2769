//! Single sensors over a year: daylight at each step, and what each lamp gives there.

use std::path::Path;

use super::product::{BlindsState, PixelHours, lux_of};
use super::year_light::YearLight;
use super::{DaylightOptions, DaylightSource};
use crate::daylight::{Climate, HourSums};
use crate::error::{Error, Result};
use crate::light::{Job, Light};
use crate::matrix::{BlockSource, CHANNELS, ColumnIndex, TracedBlock};
use crate::relight::pixel_rows;
use crate::resources::{Held, PerThread, Progress, ResourceEstimate};

/// What a sensor sees in a year.
#[derive(Clone, Debug)]
pub struct SensorYear {
    /// Illuminance by sky and sun at each step of the climate, in lux.
    pub daylight: Vec<f32>,
    /// Illuminance by each light of the basis as the scene lights it, in lux; 0 of the sky and of places of the sun.
    pub lights: Vec<f32>,
    /// The same with blinds closed; the same as `lights` without blinds.
    pub closed_lights: Vec<f32>,
}

/// The years of some sensors, or pixels, of a matrix whose rows are irradiance: row by row, the first is 0. `place` names the matrix in
/// messages.
///
/// # Errors
/// A sensor that is not there; blinds with other lights; those of [`daylight`](super::daylight).
pub fn sensor_years(
    source: &DaylightSource<'_>,
    place: &str,
    climate: &Climate,
    options: &DaylightOptions<'_>,
    sensors: &[usize],
    watch: &dyn Progress,
) -> Result<Vec<SensorYear>> {
    options.sky.check()?;
    let job = source.job();
    let (shape, steps) = (job.shape, climate.steps.len());
    let kept = (shape.block_side() as usize).pow(2) * steps * size_of::<f32>();
    let sources = options.blinds.map(|blinds| blinds.source).into_iter().chain([*source]);
    let columns = sources.clone().map(|source| source.job().shape.columns()).sum();
    let block_bytes = sources.map(|source| source.block_bytes(steps)).max().unwrap_or(0);
    let parts = [Held(YearLight::bytes(columns, steps)), Held((sensors.len() * steps * 4) as u64)];
    let need = ResourceEstimate::of(&[&parts[0], &parts[1], &PerThread(block_bytes + kept as u64)]);
    need.admit("the sensors", Path::new(place), &[], options.memory_bytes, watch)?;
    let closed = options.blinds.map(|blinds| blinds.year((place, shape), climate, options)).transpose()?;
    if let Some(blinds) = options.blinds.filter(|blinds| names(blinds.source.job()).ne(names(job))) {
        let problem = format!("has other lights than {place}");
        return Err(Error::input(blinds.place, problem, "render both with the same lights"));
    }
    let year = YearLight::new(place, &job.basis, climate, options)?;
    let mut scratch = TracedBlock::default();
    let one = |sensor: &usize| {
        let (width, height) = (shape.width() as usize, shape.height() as usize);
        let at = [sensor % width, sensor / width].map(|at| u32::try_from(at).unwrap_or(u32::MAX));
        let Some((id, pixel)) = shape.block_at(at[0], at[1]) else {
            let problem = format!("has {} sensors, none of number {}", width * height, sensor + 1);
            return Err(Error::input(place, problem, "give one of them"));
        };
        let pixels = shape.rect(id).pixels();
        let (mut sums, mut hours) = (vec![HourSums::default(); pixels], vec![0.0; pixels * year.hours()]);
        let mut target = PixelHours { sums: &mut sums, hours: Some(&mut hours) };
        let block = source.hours(id, &year, &mut scratch)?;
        block.add_to(&year, &options.thresholds, BlindsState::Open, &mut target);
        drop(block);
        let lights = lights_at(source, at, &mut scratch)?;
        let mut closed_lights = lights.clone();
        if let (Some(blinds), Some(year)) = (&options.blinds, &closed) {
            let block = blinds.source.hours(id, year, &mut scratch)?;
            block.add_to(year, &options.thresholds, BlindsState::Closed, &mut target);
            closed_lights = lights_at(&blinds.source, at, &mut scratch)?;
        }
        let mut daylight = vec![0.0; steps];
        for (&step, lux) in year.steps.iter().zip(&hours[pixel * year.hours()..]) {
            daylight[step as usize] = *lux;
        }
        Ok(SensorYear { daylight, lights, closed_lights })
    };
    sensors.iter().map(one).collect()
}

fn names(job: &Job) -> impl Iterator<Item = &str> {
    job.basis.lights().iter().map(|light| &*light.name)
}

/// Lux by each light at a pixel; 0 of the sky and of places of the sun.
fn lights_at(source: &DaylightSource<'_>, pixel: [u32; 2], scratch: &mut TracedBlock) -> Result<Vec<f32>> {
    let basis = &source.job().basis;
    let (weights, rows) = (basis.scene_weights(), rows_at(source, pixel, scratch)?);
    let lux_of_column = |column: u32| -> f32 {
        let (row, weight) = (rows[column as usize], weights[column as usize]);
        (0..CHANNELS).map(|channel| lux_of(channel) * weight[channel] * row[channel]).sum()
    };
    let lux = |light: &Light| match light.kind.is_daylight() {
        true => 0.0,
        // Noise and compression may leave less than nothing.
        false => light.columns().map(lux_of_column).sum::<f32>().max(0.0),
    };
    Ok(basis.lights().iter().map(lux).collect())
}

/// Three rows of `T`: what each column brings to a pixel.
fn rows_at(source: &DaylightSource<'_>, [x, y]: [u32; 2], scratch: &mut TracedBlock) -> Result<Vec<[f32; CHANNELS]>> {
    let matrix = match source {
        DaylightSource::Container(container) => return pixel_rows(*container, [x, y]),
        DaylightSource::Stored(matrix) => matrix,
    };
    let shape = source.job().shape;
    let (id, inside) = shape.block_at(x, y).expect("a sensor is in its matrix");
    let pixels = shape.rect(id).pixels();
    let mut rows = Vec::new();
    matrix.visit_block(id, scratch, &mut |block| {
        let columns = (0..shape.columns() as u32).map(|column| block.view().column(ColumnIndex(column)));
        rows = columns.map(|values| [0, 1, 2].map(|channel| values[channel * pixels + inside])).collect();
        Ok(())
    })?;
    Ok(rows)
}
