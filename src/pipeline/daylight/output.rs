//! A year in files: arrays, tables, pictures in false colours, and Radiance's `.ill`.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::DaylightYear;
use crate::daylight::{ANNUAL_MEASURES, Climate, GLARE_CLASSES, simplified_glare_probability};
use crate::error::{Error, Result};
use crate::files::{PositionedFile, open_input, replace, write_file};
use crate::image::{ValueScale, npy_header, write_npy_values, write_value_map};

/// Steps of a `.ill` file that are turned from the array at once.
const STEPS_AT_ONCE: usize = 256;

/// Place of the hours of direct sun in [`ANNUAL_MEASURES`].
const SUN_HOURS: usize = 7;

/// Largest value of the picture of each of [`ANNUAL_MEASURES`]; none: that of the year.
const SCALE_ENDS: [Option<f32>; ANNUAL_MEASURES.len()] = [
    Some(100.0),
    Some(100.0),
    Some(100.0),
    Some(100.0),
    Some(100.0),
    Some(100.0),
    None,
    None,
    Some(4380.0),
    Some(4380.0),
    Some(4380.0),
    None,
];

/// Writes a year into files beside each other whose names begin with `stem`: `-measures.npy` is `[measures, height, width]` in the order of
/// [`ANNUAL_MEASURES`], `-MEASURE.png` a picture of each, and with `places` (position and normal of each sensor, in the scene's axes)
/// `-measures.csv` a table. Returns the files.
///
/// # Errors
/// The system refuses to write, or a file is there that may not be replaced.
pub fn write_measures(
    year: &DaylightYear,
    stem: &Path,
    places: Option<&[([f32; 3], [f32; 3])]>,
    overwrite: bool,
) -> Result<Vec<PathBuf>> {
    let named = |ending: String| {
        let mut name = stem.file_name().unwrap_or_default().to_owned();
        name.push(ending);
        stem.with_file_name(name)
    };
    let (width, height) = year.size;
    let mut written = Vec::new();
    let array = named("-measures.npy".into());
    let values = |measure: usize| year.measures.iter().map(move |pixel| pixel.values[measure]);
    let all = (0..ANNUAL_MEASURES.len()).flat_map(values);
    write_npy_values(&array, overwrite, &[ANNUAL_MEASURES.len(), height as usize, width as usize], all)?;
    written.push(array);
    if let Some(places) = places {
        let table = named("-measures.csv".into());
        write_file(&table, overwrite, table_of(year, places).as_bytes())?;
        written.push(table);
    }
    for (measure, (name, unit)) in ANNUAL_MEASURES.into_iter().enumerate() {
        let shown: Vec<f32> = values(measure).collect();
        if shown.iter().all(|value| value.is_nan()) {
            continue;
        }
        let largest = shown.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
        let end = SCALE_ENDS[measure].unwrap_or_else(|| round_up(largest));
        let picture = named(format!("-{name}.png"));
        write_value_map(&picture, (width, height), &shown, ValueScale { end, unit })?;
        written.push(picture);
    }
    Ok(written)
}

/// The next of 1, 2 and 5 times a power of ten.
fn round_up(value: f32) -> f32 {
    let power = 10f32.powf(value.max(1e-6).log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|step| step * power).find(|step| *step >= value).unwrap_or(value)
}

fn table_of(year: &DaylightYear, places: &[([f32; 3], [f32; 3])]) -> String {
    let mut text = "x,y,z,normal_x,normal_y,normal_z".to_owned();
    for (name, unit) in ANNUAL_MEASURES {
        let unit = if unit == "%" { "percent" } else { unit };
        let named = if name.ends_with(unit) || name.contains("lux") || name.contains("hours") {
            name.into()
        } else {
            format!("{name}_{unit}")
        };
        let _ = write!(text, ",{named}");
    }
    text.push('\n');
    for ((position, normal), measures) in places.iter().zip(&year.measures) {
        let numbers = position.iter().chain(normal).chain(&measures.values);
        let words: Vec<String> =
            numbers.map(|value| if value.is_nan() { String::new() } else { (value + 0.0).to_string() }).collect();
        text += &words.join(",");
        text.push('\n');
    }
    text
}

/// Names of [`EyeGlare::protection`](crate::daylight::EyeGlare::protection).
const PROTECTIONS: [&str; 4] = ["none", "minimum", "medium", "high"];

/// Writes a table of glare at eyes: the number of each, with `places` its place and normal, percent of the time of use in each of
/// [`GLARE_CLASSES`], hours of direct sun above 1,000 lx, in which they are too low, and the protection by EN 17037. Where no light reaches, the fields
/// are empty.
///
/// # Errors
/// The system refuses to write, or a file is there that may not be replaced.
pub fn write_glare(
    path: &Path,
    year: &DaylightYear,
    places: Option<&[([f32; 3], [f32; 3])]>,
    overwrite: bool,
) -> Result<()> {
    let mut text = "eye".to_owned();
    if places.is_some() {
        text += ",x,y,z,normal_x,normal_y,normal_z";
    }
    GLARE_CLASSES.iter().for_each(|class| text += &format!(",{class}_percent"));
    text += ",sun_hours,en_17037_protection\n";
    for (at, (glare, measures)) in year.glare.iter().zip(&year.measures).enumerate() {
        let _ = write!(text, "{}", at + 1);
        let place = places.and_then(|places| places.get(at));
        for value in place.iter().flat_map(|(position, normal)| position.iter().chain(normal)) {
            let _ = write!(text, ",{}", value + 0.0);
        }
        match glare {
            Some(glare) => {
                glare.classes().iter().for_each(|percent| text += &format!(",{percent:.3}"));
                let sun = measures.values[SUN_HOURS];
                text += &if sun.is_nan() { ",".to_owned() } else { format!(",{sun}") };
                let _ = writeln!(text, ",{}", PROTECTIONS[glare.protection()]);
            }
            None => text += ",,,,,,\n",
        }
    }
    write_file(path, overwrite, text.as_bytes())
}

/// Turns the array of hours of eyes that [`daylight`](super::daylight) wrote into one of the simplified daylight glare probability,
/// `[eyes, steps]`.
///
/// # Errors
/// As of [`write_ill`].
pub fn write_glare_hours(path: &Path, hours: &Path, climate: &Climate, eyes: usize, overwrite: bool) -> Result<()> {
    let steps = climate.steps.len();
    let (file, header) = open_hours(hours, [eyes, steps])?;
    replace(path, overwrite, |writer| {
        let failed = || Error::io(path, "write");
        writer.write_all(&npy_header(&[eyes, steps])).map_err(failed())?;
        let mut row = vec![0u8; steps * 4];
        for eye in 0..eyes {
            file.read_exact_at(&mut row, header + (eye * steps * 4) as u64)
                .map_err(Error::io(hours, "read the hours"))?;
            for value in row.as_chunks_mut::<4>().0 {
                *value = (simplified_glare_probability(f32::from_le_bytes(*value).into()) as f32).to_le_bytes();
            }
            writer.write_all(&row).map_err(failed())?;
        }
        Ok(())
    })
}

/// Opens an array of hours, and gives the length of its header. Errors: it has not these sensors and steps.
fn open_hours(hours: &Path, [sensors, steps]: [usize; 2]) -> Result<(File, u64)> {
    let file = open_input(hours, "read the hours")?;
    let header = npy_header(&[sensors, steps]).len() as u64;
    let length = file.metadata().map_err(Error::io(hours, "look at"))?.len();
    if length == header + (sensors * steps * 4) as u64 {
        return Ok((file, header));
    }
    let hint = "write the hours and this file of the same climate";
    Err(Error::input(hours.display().to_string(), "has not the hours of these sensors", hint))
}

/// Turns the array of hours that [`daylight`](super::daylight) wrote into Radiance's and Daysim's `.ill`: a line for each step with month, day, hour
/// and the illuminance of each sensor in lux.
///
/// # Errors
/// The array cannot be read or is another's; the system refuses to write.
pub fn write_ill(path: &Path, hours: &Path, climate: &Climate, sensors: usize, overwrite: bool) -> Result<()> {
    let steps = climate.steps.len();
    let (file, header) = open_hours(hours, [sensors, steps])?;
    replace(path, overwrite, |writer| {
        for begin in (0..steps).step_by(STEPS_AT_ONCE) {
            let count = STEPS_AT_ONCE.min(steps - begin);
            let mut tile = vec![0u8; sensors * count * 4];
            for (sensor, row) in tile.chunks_exact_mut(count * 4).enumerate() {
                let offset = header + ((sensor * steps + begin) * 4) as u64;
                file.read_exact_at(row, offset).map_err(Error::io(hours, "read the hours"))?;
            }
            for (at, step) in climate.steps[begin..begin + count].iter().enumerate() {
                let mut line = format!("{} {} {:.3}", step.month, step.day, step.hour);
                for row in tile.chunks_exact(count * 4) {
                    let value = f32::from_le_bytes(std::array::from_fn(|byte| row[4 * at + byte]));
                    let _ = write!(line, " {value:.1}");
                }
                line.push('\n');
                writer.write_all(line.as_bytes()).map_err(Error::io(path, "write"))?;
            }
        }
        Ok(())
    })
}
