//! Daylight of a moment, of a whole day, or of a standard sky: the options of `ltm relight` that concern it.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ltm::daylight::{CieSky, Climate, SkyOptions, Sun};
use ltm::light::{Job, Lighting};
use ltm::pipeline::{StandardSky, lighting_at, lighting_under};
use ltm::resources::Progress;
use ltm::{Error, Result};
use ltm_cli::console::Console;

/// Frames of a day, one for each quarter of an hour.
const FRAMES_OF_A_DAY: usize = 96;

#[derive(Args)]
#[command(next_help_heading = "Daylight")]
pub(crate) struct DaylightArguments {
    /// Light the scene's sky and sun as at a time of a climate, an EPW or a WEA file.
    #[arg(long, value_name = "FILE", requires = "at", group = "daylight")]
    climate: Option<PathBuf>,
    /// The time, MM-DD HH:MM of the site; for an animation of a day only MM-DD, with # in the output's name.
    #[arg(long, value_name = "TIME", requires = "climate", value_parser = parse_time)]
    at: Option<Time>,
    /// Light the scene's sky as a standard sky of the CIE, without the sun's own light.
    #[arg(long, value_enum, value_name = "SKY", group = "daylight", conflicts_with = "climate")]
    cie: Option<CieName>,
    /// Illuminance of open ground by that sky, in lx.
    #[arg(long, default_value = "10000", requires = "cie")]
    lux: f64,
    /// The sun's altitude and azimuth (from north towards east) in degrees, around which clear and intermediate skies are bright.
    #[arg(long, value_name = "ALTITUDE,AZIMUTH", requires = "cie", value_parser = parse_sun, allow_hyphen_values = true)]
    sun: Option<Sun>,
    /// How far the scene's north (−z) is turned towards east, in degrees.
    #[arg(long, default_value = "0", allow_negative_numbers = true, requires = "daylight")]
    north: f64,
    /// Reflectance of the ground that is seen below the horizon.
    #[arg(long, default_value = "0.2", requires = "daylight")]
    ground: f64,
}

/// A standard sky.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum CieName {
    Overcast,
    Uniform,
    Clear,
    Intermediate,
}

impl CieName {
    fn sky(self) -> CieSky {
        match self {
            Self::Overcast => CieSky::Overcast,
            Self::Uniform => CieSky::Uniform,
            Self::Clear => CieSky::Clear,
            Self::Intermediate => CieSky::Intermediate,
        }
    }
}

/// A day (month, day), and an hour of it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Time {
    day: (u8, u8),
    hour: Option<f64>,
}

/// What the sky and the sun are as.
enum Daylight {
    /// A time of a climate, or a day of it.
    Climate(Climate, Time),
    /// A standard sky.
    Standard(StandardSky),
}

/// The daylight that is asked for.
pub(crate) struct Moment {
    daylight: Daylight,
    options: SkyOptions,
}

impl DaylightArguments {
    /// What is asked for; none without a climate or a standard sky.
    pub(crate) fn moment(&self, console: &Console) -> Result<Option<Moment>> {
        let options = SkyOptions { ground_reflectance: self.ground, north_degrees: self.north };
        if let Some(name) = self.cie {
            let is_bright_around_sun = matches!(name, CieName::Clear | CieName::Intermediate);
            if is_bright_around_sun && self.sun.is_none() {
                let hint = "give --sun ALTITUDE,AZIMUTH in degrees, such as 45,180";
                return Err(Error::input("--cie", "this sky is bright around the sun, whose place is missing", hint));
            }
            let sun = self.sun.unwrap_or(Sun { altitude: 0.0, azimuth: 0.0 });
            let daylight = Daylight::Standard(StandardSky { sky: name.sky(), sun, lux: self.lux });
            return Ok(Some(Moment { daylight, options }));
        }
        let (Some(path), Some(time)) = (&self.climate, self.at) else { return Ok(None) };
        let climate = Climate::read(path)?;
        climate.warnings.iter().for_each(|warning| console.note(&format!("warning: {warning}")));
        Ok(Some(Moment { daylight: Daylight::Climate(climate, time), options }))
    }
}

impl Moment {
    /// Number of frames of an animation; none where one time or a standard sky is asked for.
    pub(crate) fn frames(&self) -> Option<usize> {
        matches!(self.daylight, Daylight::Climate(_, Time { hour: None, .. })).then_some(FRAMES_OF_A_DAY)
    }

    /// The lighting of a frame of the day, else of the time that is asked for; lamps stay as they are.
    pub(crate) fn lighting(&self, job: &Job, lamps: &Lighting, frame: Option<usize>) -> Result<Lighting> {
        let (place, basis) = (&*job.provenance.source, &job.basis);
        match &self.daylight {
            Daylight::Climate(climate, time) => {
                let of_frame = |frame: usize| (frame as f64 + 0.5) * 24.0 / FRAMES_OF_A_DAY as f64;
                let hour = time.hour.unwrap_or_else(|| frame.map_or(12.0, of_frame));
                lighting_at(place, lamps, basis, climate, (time.day, hour), self.options)
            }
            Daylight::Standard(standard) => lighting_under(place, lamps, basis, *standard, self.options),
        }
    }
}

/// Reads `45,180`: degrees above the horizon, and from north towards east.
fn parse_sun(text: &str) -> Result<Sun, String> {
    let angles = text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    let valid =
        angles.filter(|(altitude, azimuth): &(f64, f64)| (0.0..=90.0).contains(altitude) && azimuth.is_finite());
    let (altitude, azimuth) =
        valid.ok_or("write ALTITUDE,AZIMUTH in degrees, an altitude from 0 to 90, such as 45,180")?;
    Ok(Sun { altitude: altitude.to_radians(), azimuth: azimuth.to_radians() })
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
    fn the_sun_is_two_angles_in_degrees() {
        let sun = parse_sun("45, 180").unwrap();
        assert!((sun.altitude.to_degrees() - 45.0).abs() < 1e-9 && (sun.azimuth.to_degrees() - 180.0).abs() < 1e-9);
        for text in ["", "45", "-1,0", "91,0", "45,x", "nan,0", "45,inf"] {
            assert!(parse_sun(text).is_err(), "{text}");
        }
    }

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
