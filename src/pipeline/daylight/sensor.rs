//! Single sensors over a year: daylight at each step, and what each lamp gives there.

use std::path::Path;

use super::product::{BlindsState, PixelHours};
use super::year_light::YearLight;
use super::{DaylightOptions, DaylightSource};
use crate::daylight::{Climate, HourSums, LUMENS_PER_WATT, LUMINANCE_WEIGHTS};
use crate::error::{Error, Result};
use crate::light::{LightBasis, LightKind};
use crate::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, MatrixShape, TracedBlock};
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
    let year = YearLight::new(place, &job.basis, climate, options)?;
    let mut scratch = TracedBlock::default();
    let one = |sensor: &usize| {
        let (id, pixel) = block_of(shape, place, *sensor)?;
        let pixels = shape.rect(id).pixels();
        let (mut sums, mut hours) = (vec![HourSums::default(); pixels], vec![0.0; pixels * year.hours()]);
        let mut target = PixelHours { sums: &mut sums, hours: Some(&mut hours) };
        let block = source.hours(id, &year, &mut scratch)?;
        block.add_to(&year, &options.thresholds, BlindsState::Open, &mut target);
        drop(block);
        let lights = lights_at(source, &job.basis, (id, pixel), &mut scratch)?;
        let mut closed_lights = lights.clone();
        if let (Some(blinds), Some(year)) = (&options.blinds, &closed) {
            let block = blinds.source.hours(id, year, &mut scratch)?;
            block.add_to(year, &options.thresholds, BlindsState::Closed, &mut target);
            let basis = &blinds.source.job().basis;
            let names = |basis: &LightBasis| basis.lights().iter().map(|light| light.name.clone()).collect::<Vec<_>>();
            if names(basis) != names(&job.basis) {
                let problem = format!("has other lights than {place}");
                return Err(Error::input(blinds.place, problem, "render both with the same lights"));
            }
            closed_lights = lights_at(&blinds.source, basis, (id, pixel), &mut scratch)?;
        }
        let mut daylight = vec![0.0; steps];
        for (&step, lux) in year.steps.iter().zip(&hours[pixel * year.hours()..]) {
            daylight[step as usize] = *lux;
        }
        Ok(SensorYear { daylight, lights, closed_lights })
    };
    sensors.iter().map(one).collect()
}

/// The block of a pixel, and the pixel's place in it.
fn block_of(shape: MatrixShape, place: &str, sensor: usize) -> Result<(BlockId, usize)> {
    let (width, count) = (shape.width() as usize, shape.width() as usize * shape.height() as usize);
    let (x, y) = ((sensor % width) as u32, sensor / width);
    let holds = |id: &BlockId| {
        let rect = shape.rect(*id);
        (rect.x..rect.x + rect.width).contains(&x) && (rect.y as usize..(rect.y + rect.height) as usize).contains(&y)
    };
    let found = shape.blocks().find(holds).map(|id| {
        let rect = shape.rect(id);
        (id, (y - rect.y as usize) * rect.width as usize + (x - rect.x) as usize)
    });
    found.ok_or_else(|| {
        Error::input(place, format!("has {count} sensors, none of number {}", sensor + 1), "give one of them")
    })
}

/// Lux by each light at a pixel of a block.
fn lights_at(
    source: &DaylightSource<'_>,
    basis: &LightBasis,
    (id, pixel): (BlockId, usize),
    scratch: &mut TracedBlock,
) -> Result<Vec<f32>> {
    let (weights, pixels) = (basis.scene_weights(), source.job().shape.rect(id).pixels());
    let lux = |channel: usize, column: u32| {
        LUMINANCE_WEIGHTS[channel] * LUMENS_PER_WATT as f32 * weights[column as usize][channel]
    };
    let lamps = basis.lights().iter().enumerate();
    let lamps: Vec<_> = lamps
        .filter(|(_, light)| !light.kind.is_environment() && !matches!(light.kind, LightKind::Suns { .. }))
        .collect();
    let mut lights = vec![0.0f32; basis.lights().len()];
    match source {
        DaylightSource::Container(container) => {
            let block = container.read_block(id)?;
            for k in 0..block.rank() {
                let (left, right) = (block.left_component(k), block.right_component(k));
                for (at, lamp) in &lamps {
                    for (channel, column) in (0..CHANNELS).flat_map(|c| lamp.columns().map(move |column| (c, column))) {
                        let entry = left[channel * pixels + pixel] * right[column as usize];
                        lights[*at] += lux(channel, column) * entry;
                    }
                }
            }
            for entry in block.sparse.iter().filter(|entry| entry.row as usize % pixels == pixel) {
                let owner = lamps.iter().find(|(_, lamp)| lamp.columns().contains(&entry.column.0));
                if let Some((at, _)) = owner {
                    lights[*at] += lux(entry.row as usize / pixels, entry.column.0) * entry.value;
                }
            }
        }
        DaylightSource::Stored(matrix) => matrix.visit_block(id, scratch, &mut |block| {
            lights.fill(0.0);
            for (at, lamp) in &lamps {
                for column in lamp.columns() {
                    let values = block.view().column(ColumnIndex(column));
                    let by_channel =
                        (0..CHANNELS).map(|channel| lux(channel, column) * values[channel * pixels + pixel]);
                    lights[*at] += by_channel.sum::<f32>();
                }
            }
            Ok(())
        })?,
    }
    // Noise and compression may leave less than nothing.
    lights.iter_mut().for_each(|lux| *lux = lux.max(0.0));
    Ok(lights)
}
