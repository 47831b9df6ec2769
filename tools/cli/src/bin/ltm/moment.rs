//! Daylight of a moment, or of a whole day: the options of `ltm relight` that concern a climate.

use std::path::PathBuf;

use clap::Args;
use ltm::Result;
use ltm::daylight::{Climate, SkyOptions};
use ltm::light::{Job, Lighting};
use ltm::pipeline::lighting_at;
use ltm::resources::Progress;
use ltm_cli::console::Console;

/// Frames of a day, one for each quarter of an hour.
const FRAMES_OF_A_DAY: usize = 96;

#[derive(Args)]
#[command(next_help_heading = "Daylight")]
pub(crate) struct DaylightArguments {
    /// Light the scene's sky and sun as at a time of a climate, an EPW or a WEA file.
    #[arg(long, value_name = "FILE", requires = "at")]
    climate: Option<PathBuf>,
    /// The time, MM-DD HH:MM of the site; for an animation of a day only MM-DD, with # in the output's name.
    #[arg(long, value_name = "TIME", requires = "climate", value_parser = parse_time)]
    at: Option<Time>,
    /// How far the scene's north (−z) is turned towards east, in degrees.
    #[arg(long, default_value = "0", allow_negative_numbers = true, requires = "climate")]
    north: f64,
    /// Reflectance of the ground that is seen below the horizon.
    #[arg(long, default_value = "0.2", requires = "climate")]
    ground: f64,
}

/// A day (month, day), and an hour of it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Time {
    day: (u8, u8),
    hour: Option<f64>,
}

/// A time of a climate, or a day of it.
pub(crate) struct Moment {
    climate: Climate,
    time: Time,
    options: SkyOptions,
}

impl DaylightArguments {
    /// What is asked for; none without a climate.
    pub(crate) fn moment(&self, console: &Console) -> Result<Option<Moment>> {
        let (Some(path), Some(time)) = (&self.climate, self.at) else { return Ok(None) };
        let climate = Climate::read(path)?;
        climate.warnings.iter().for_each(|warning| console.note(&format!("warning: {warning}")));
        let options = SkyOptions { ground_reflectance: self.ground, north_degrees: self.north };
        Ok(Some(Moment { climate, time, options }))
    }
}

impl Moment {
    /// Number of frames of an animation; none where one time is asked for.
    pub(crate) fn frames(&self) -> Option<usize> {
        self.time.hour.is_none().then_some(FRAMES_OF_A_DAY)
    }

    /// The lighting of a frame of the day, else of the time that is asked for; lamps stay as they are.
    pub(crate) fn lighting(&self, job: &Job, lamps: &Lighting, frame: Option<usize>) -> Result<Lighting> {
        let of_frame = |frame: usize| (frame as f64 + 0.5) * 24.0 / FRAMES_OF_A_DAY as f64;
        let hour = self.time.hour.unwrap_or_else(|| frame.map_or(12.0, of_frame));
        lighting_at(&job.provenance.source, lamps, &job.basis, &self.climate, (self.time.day, hour), self.options)
    }
}

/// Reads `06-21 14:30`, `06-21T14:30` or `06-21`.
fn parse_time(text: &str) -> Result<Time, String> {
    let asked = || format!("'{text}' is no time: write MM-DD HH:MM, such as 06-21 14:30, or MM-DD");
    let (day, clock) = match text.trim().split_once([' ', 'T']) {
        Some((day, clock)) => (day, Some(clock.trim())),
        None => (text.trim(), None),
    };
    let (month, day) = day.split_once('-').ok_or_else(asked)?;
    let day = (month.parse().map_err(|_| asked())?, day.parse().map_err(|_| asked())?);
    let of_clock = |clock: &str| -> Option<f64> {
        let (hours, minutes) = clock.split_once(':')?;
        let (hours, minutes) = (hours.parse::<u8>().ok()?, minutes.parse::<u8>().ok()?);
        let hour = f64::from(hours) + f64::from(minutes) / 60.0;
        (minutes < 60 && hour <= 24.0).then_some(hour)
    };
    let hour = clock.map(|clock| of_clock(clock).ok_or_else(asked)).transpose()?;
    Ok(Time { day, hour })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_as_people_write_them() {
        let time = |text| parse_time(text).ok();
        assert_eq!(time("06-21 14:30"), Some(Time { day: (6, 21), hour: Some(14.5) }));
        assert_eq!(time("12-01T08:00"), Some(Time { day: (12, 1), hour: Some(8.0) }));
        assert_eq!(time("3-5"), Some(Time { day: (3, 5), hour: None }));
        for text in ["", "June 21", "06-21 25:00", "06-21 12:60", "06-21 12", "300-1"] {
            assert_eq!(time(text), None, "{text}");
        }
    }
}
