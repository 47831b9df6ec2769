//! Climate files: a year of measured light, hour by hour.

mod epw;
mod wea;

use std::path::Path;

use super::Site;
use super::calendar::{day_of_year, is_day, next_day};
use crate::error::{Error, Result, Warnings};
use crate::files::read_input_text;

/// Bytes of a climate file at most; a year by the minute has some 200 MB.
const MAX_CLIMATE_BYTES: u64 = 512 << 20;

/// Largest irradiance in W/m² that is believed; the sun gives 1,367 above the air.
const MAX_IRRADIANCE: f64 = 2000.0;

/// Largest illuminance in lux that is believed.
const MAX_ILLUMINANCE: f64 = 250_000.0;

/// What a climate file says of the light at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// In W/m².
    Irradiance {
        /// By the sun, of a plane across its light.
        direct: f64,
        /// By the sky, of the horizontal.
        diffuse: f64,
    },
    /// In lux, of the same planes.
    Illuminance {
        /// By the sun.
        direct: f64,
        /// By the sky.
        diffuse: f64,
    },
}

impl Measured {
    /// No light.
    fn dark(self) -> Self {
        match self {
            Self::Irradiance { .. } => Self::Irradiance { direct: 0.0, diffuse: 0.0 },
            Self::Illuminance { .. } => Self::Illuminance { direct: 0.0, diffuse: 0.0 },
        }
    }

    /// A share of the way to another; of another quantity the nearer one.
    fn towards(self, other: Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        match (self, other) {
            (Self::Irradiance { direct, diffuse }, Self::Irradiance { direct: to_direct, diffuse: to_diffuse }) => {
                Self::Irradiance { direct: between(direct, to_direct), diffuse: between(diffuse, to_diffuse) }
            }
            (Self::Illuminance { direct, diffuse }, Self::Illuminance { direct: to_direct, diffuse: to_diffuse }) => {
                Self::Illuminance { direct: between(direct, to_direct), diffuse: between(diffuse, to_diffuse) }
            }
            _ => {
                if share < 0.5 {
                    self
                } else {
                    other
                }
            }
        }
    }
}

/// One time of a climate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClimateStep {
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// Hours of the site's time since midnight, in the middle of what the step stands for.
    pub hour: f64,
    /// Number of the day in its year, from 1.
    pub day_of_year: u16,
    /// The light.
    pub measured: Measured,
    /// Dew point in °C, the mean of this step and the two before; none where the file has none.
    pub dew_point: Option<f64>,
}

/// A climate: its site and its times, in order.
#[derive(Clone, Debug)]
pub struct Climate {
    /// Where it is.
    pub site: Site,
    /// Its times.
    pub steps: Vec<ClimateStep>,
    /// What looks odd, one line each.
    pub warnings: Warnings,
}

/// A row of a climate file as it is written.
struct Row {
    line: usize,
    month: u8,
    day: u8,
    hour: f64,
    measured: MeasuredAs,
    dew_point: Option<f64>,
}

/// What the columns of a file mean.
enum MeasuredAs {
    Whole(Measured),
    /// By sun and sky of the horizontal, in W/m².
    Horizontal {
        direct: f64,
        diffuse: f64,
    },
}

impl Climate {
    /// Reads an EPW file (EnergyPlus) or a WEA file (Daysim, Radiance).
    ///
    /// # Errors
    /// Those of reading the file, and of [`parse`](Self::parse).
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_input_text(path, "read the climate", MAX_CLIMATE_BYTES)?;
        Self::parse(&path.display().to_string(), &text)
    }

    /// As [`read`](Self::read), of the file's text; `place` names it in messages.
    ///
    /// # Errors
    /// Neither kind of file, a header without the site, a line that lacks a column or has a value that is missing or no light, times
    /// that are none, stand twice or go back, and hours that an EPW file leaves out.
    pub fn parse(place: &str, text: &str) -> Result<Self> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let first = text.lines().next().unwrap_or_default().trim_start().to_ascii_lowercase();
        let (site, rows, is_whole) = if first.starts_with("location,") {
            let (site, rows) = epw::parse(place, text)?;
            (site, rows, true)
        } else if first.starts_with("place") {
            let (site, rows) = wea::parse(place, text)?;
            (site, rows, false)
        } else {
            let hint = "an EPW file begins with LOCATION, a WEA file with place";
            return Err(Error::input(place, "is no climate file", hint));
        };
        if rows.is_empty() {
            return Err(Error::input(place, "has no hours", "give a file with a line for each hour"));
        }
        check_times(place, &rows, is_whole)?;
        let mut warnings = Warnings::new();
        let steps = steps_of(place, &site, rows, &mut warnings)?;
        if site.is_polar() {
            let text = "lies beyond a polar circle: on some days the sun does not rise, and such hours count as dark";
            warnings.push(format!("{place}: {text}"));
        }
        Ok(Self { site, steps, warnings })
    }

    /// The step of a day (month, day) at an hour of the site's time: between two steps of the day in proportion, before its first
    /// and after its last as there for as long as a step is, and dark beyond: files may leave the night out.
    ///
    /// # Errors
    /// A day without steps; an hour that is none.
    pub fn at(&self, (month, day): (u8, u8), hour: f64) -> Result<ClimateStep> {
        let refuse = |problem: String, hint: &str| Err(Error::input(&*self.site.name, problem, hint));
        if !(0.0..=24.0).contains(&hour) {
            return refuse(format!("a day has no hour {hour}"), "give 0 to 24");
        }
        let of_day = |step: &&ClimateStep| (step.month, step.day) == (month, day);
        let steps: Vec<&ClimateStep> = self.steps.iter().filter(of_day).collect();
        let after = steps.partition_point(|step| step.hour < hour);
        let (before, after) = match (after.checked_sub(1).map(|at| steps[at]), steps.get(after).copied()) {
            (Some(before), Some(after)) => (before, after),
            (Some(only), None) | (None, Some(only)) => {
                let is_covered = (only.hour - hour).abs() <= self.step_hours();
                let measured = if is_covered { only.measured } else { only.measured.dark() };
                return Ok(ClimateStep { hour, measured, ..*only });
            }
            (None, None) => {
                return refuse(
                    format!("has no hours on day {day} of month {month}"),
                    "choose a day that the climate has",
                );
            }
        };
        let span = after.hour - before.hour;
        let share = if span > 0.0 { (hour - before.hour) / span } else { 0.0 };
        let nearest = if share < 0.5 { before } else { after };
        Ok(ClimateStep { hour, measured: before.measured.towards(after.measured, share), ..*nearest })
    }

    /// Hours that a step stands for: the least time between two steps of a day, at most one hour, since a file may leave hours out.
    pub fn step_hours(&self) -> f64 {
        let in_a_day =
            self.steps.windows(2).filter(|pair| (pair[0].month, pair[0].day) == (pair[1].month, pair[1].day));
        let least = in_a_day.map(|pair| pair[1].hour - pair[0].hour).fold(f64::INFINITY, f64::min);
        least.min(1.0)
    }
}

/// Errors: times that are none; times out of order; in a file of whole years hours that are left out.
fn check_times(place: &str, rows: &[Row], is_whole: bool) -> Result<()> {
    let is_time = |row: &&Row| is_day(row.month, row.day) && (0.0..=24.0).contains(&row.hour);
    if let Some(row) = rows.iter().find(|row| !is_time(row)) {
        let problem = format!("there is no {} h of day {} in month {}", row.hour, row.day, row.month);
        return Err(Error::input(format!("{place}, line {}", row.line), problem, "give month, day and hour"));
    }
    let has_leap_day = rows.iter().any(|row| (row.month, row.day) == (2, 29));
    let steps_of_day = rows.iter().take_while(|row| (row.month, row.day) == (rows[0].month, rows[0].day)).count();
    let step = 24.0 / steps_of_day as f64;
    for pair in rows.windows(2) {
        let [before, after] = pair else { continue };
        let refuse =
            |problem: String, hint: &str| Err(Error::input(format!("{place}, line {}", after.line), problem, hint));
        let (date, hour) = ((after.month, after.day), after.hour);
        let expected_date = next_day((before.month, before.day), has_leap_day);
        if (before.month, before.day) == date && hour <= before.hour {
            return refuse(format!("the hour {hour} stands twice or goes back"), "put the hours in order");
        }
        if !is_whole {
            continue;
        }
        let is_next = match (before.month, before.day) == date {
            true => hour - before.hour < 1.5 * step,
            false => date == expected_date && 24.0 - before.hour + hour < 1.5 * step,
        };
        if !is_next {
            let (month, day) = (before.month, before.day);
            let problem = format!("hours are left out after {:.2} h of {day:02}.{month:02}.", before.hour);
            return refuse(problem, "fill the gap from another year, or write a WEA file of the hours that there are");
        }
    }
    Ok(())
}

fn steps_of(place: &str, site: &Site, rows: Vec<Row>, warnings: &mut Warnings) -> Result<Vec<ClimateStep>> {
    let (mut after_leap_day, mut dew_points, mut negative) = (false, None, 0usize);
    let mut steps = Vec::with_capacity(rows.len());
    for row in rows {
        let place = || format!("{place}, line {}", row.line);
        let is_leap_day = (row.month, row.day) == (2, 29);
        let day_of_year = if is_leap_day { 60 } else { day_of_year(row.month, row.day, after_leap_day) };
        after_leap_day |= is_leap_day;
        let measured = match row.measured {
            MeasuredAs::Whole(measured) => measured,
            MeasuredAs::Horizontal { direct, diffuse } => {
                let altitude = super::sun_at(site, day_of_year, row.hour).altitude;
                let direct = if altitude > 1e-6 { direct / altitude.sin() } else { direct };
                Measured::Irradiance { direct, diffuse }
            }
        };
        let ([direct, diffuse], most, unit) = match measured {
            Measured::Irradiance { direct, diffuse } => ([direct, diffuse], MAX_IRRADIANCE, "W/m²"),
            Measured::Illuminance { direct, diffuse } => ([direct, diffuse], MAX_ILLUMINANCE, "lux"),
        };
        // The sun at the horizon makes any horizontal share of it large.
        let most_direct = if matches!(row.measured, MeasuredAs::Horizontal { .. }) { f64::MAX } else { most };
        if !(direct <= most_direct && diffuse <= most) {
            let problem = format!("{direct} and {diffuse} {unit} are no light of sun and sky");
            return Err(Error::input(place(), problem, "fill in what is missing"));
        }
        negative += usize::from(direct < 0.0 || diffuse < 0.0);
        let [direct, diffuse] = [direct, diffuse].map(|value| value.max(0.0));
        let measured = match measured {
            Measured::Irradiance { .. } => Measured::Irradiance { direct, diffuse },
            Measured::Illuminance { .. } => Measured::Illuminance { direct, diffuse },
        };
        let dew_point = row.dew_point.map(|now| {
            let [first, second] = dew_points.unwrap_or([now; 2]);
            dew_points = Some([second, now]);
            (first + second + now) / 3.0
        });
        if row.dew_point.is_none() {
            dew_points = None;
        }
        let (month, day, hour) = (row.month, row.day, row.hour);
        steps.push(ClimateStep { month, day, hour, day_of_year, measured, dew_point });
    }
    if negative > 0 {
        warnings.push(format!("{place}: {negative} hours have negative light, which counts as none"));
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEA: &str =
        "place A_B\nlatitude 48\nlongitude -11\ntime_zone -15\nsite_elevation 500\nweather_data_file_units 1\n";
    const EPW: &str = "LOCATION,A,-,B,C,0,48,11,1,500\nDESIGN CONDITIONS,0\nTYPICAL/EXTREME PERIODS,0\nGROUND TEMPERATURES,0\n\
        HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\nCOMMENTS 1,\nCOMMENTS 2,\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31\n";

    fn epw_row((month, day): (u8, u8), hour: u8, direct: &str) -> String {
        format!("1999,{month},{day},{hour},60,?,20,11,50,101325,0,0,300,0,{direct},100,0,0\n")
    }

    /// A year of 24 hours a day.
    fn epw_year(has_leap_day: bool) -> String {
        let (mut text, mut day) = (EPW.to_owned(), (1, 1));
        loop {
            (1..=24).for_each(|hour| text += &epw_row(day, hour, "10"));
            if day == (12, 31) {
                return text;
            }
            day = next_day(day, has_leap_day);
        }
    }

    fn problem(text: &str) -> String {
        Climate::parse("a", text).unwrap_err().to_string()
    }

    #[test]
    fn months_that_are_none_are_told_wherever_they_stand() {
        for month in [0, 13, 31] {
            let text = format!("{WEA}{month} 1 0.5 0 0\n1 1 0.5 0 0\n");
            assert!(problem(&text).contains(&format!("day 1 in month {month}")), "{}", problem(&text));
        }
    }

    #[test]
    fn years_with_and_without_a_leap_day_are_read() {
        let year = Climate::parse("a", &epw_year(false)).unwrap();
        assert_eq!((year.steps.len(), year.step_hours()), (8760, 1.0));
        assert_eq!((year.steps[12].hour, year.steps[8759].day_of_year), (12.5, 365));
        let leap = Climate::parse("a", &epw_year(true)).unwrap();
        assert_eq!((leap.steps.len(), leap.step_hours()), (8784, 1.0));
        // 29 February and 1 March: as Radiance counts them.
        assert_eq!((leap.steps[59 * 24].day_of_year, leap.steps[60 * 24].day_of_year), (60, 61));
        assert_eq!(leap.steps[8783].day_of_year, 366);
    }

    #[test]
    fn what_is_no_climate_is_told_in_a_line_that_names_it() {
        assert!(problem("hello").contains("no climate file"));
        assert!(problem(WEA).contains("no hours"));
        assert!(problem(&WEA.replace("48", "x")).contains("line 2: 'x' is no number"));
        assert!(problem(&format!("{}1 1 1 0 0\n", WEA.replace("48", "98"))).contains("latitude is 98"));
        assert!(problem(&WEA.replace("time_zone", "zone")).contains("line 4: does not begin with 'time_zone'"));
        assert!(problem(&WEA.replace("units 1", "units 7")).contains("7 is no unit"));
        assert!(problem(&format!("{WEA}1 1 0.5 0\n")).contains("line 7: has 4 columns"));
        assert!(problem(&format!("{WEA}1 1 0.5 0 x\n")).contains("line 7: 'x' is no number"));
        assert!(problem(&format!("{WEA}2 30 0.5 0 0\n")).contains("line 7: there is no 0.5 h of day 30 in month 2"));
        assert!(problem(&format!("{WEA}1 1 0.5 0 9999\n")).contains("line 7: 0 and 9999 W/m² are no light"));
        assert!(problem(&format!("{WEA}1 1 1.5 0 0\n1 1 0.5 0 0\n")).contains("line 8: the hour 0.5 stands twice"));
        assert!(problem(&EPW.replace("48", "")).contains("has no latitude"));
        assert!(problem(&EPW.replace("DATA PERIODS,1,1", "DATA PERIODS,2,1")).contains("data period"));
        assert!(problem(&EPW.replace("DATA", "DATE")).contains("no DATA PERIODS"));
        assert!(problem(&format!("{EPW}1999,1,1,1,60,?\n")).contains("line 9: has 6 columns"));
        let missing = problem(&format!("{EPW}{}", epw_row((1, 1), 1, "9999")));
        assert!(missing.contains("line 9: the direct normal irradiance is missing"), "{missing}");
        let year = epw_year(false);
        let gap = year.replacen(&epw_row((3, 2), 5, "10"), "", 1);
        let problem = problem(&gap);
        assert!(problem.contains("hours are left out after 3.50 h of 02.03."), "{problem}");
    }

    #[test]
    fn a_wea_file_may_leave_hours_out_and_a_polar_site_is_told() {
        let some = Climate::parse("a", &format!("{WEA}1 1 8.5 1 1\n6 1 8.5 -1 1\n")).unwrap();
        assert_eq!((some.steps.len(), some.step_hours()), (2, 1.0));
        let at = |hour: f64| some.at((1, 1), hour).unwrap().measured;
        let (lit, dark) =
            (Measured::Irradiance { direct: 1.0, diffuse: 1.0 }, Measured::Irradiance { direct: 0.0, diffuse: 0.0 });
        assert_eq!([7.6, 8.5, 9.4, 2.0].map(at), [lit, lit, lit, dark]);
        // Quarters of an hour of one morning.
        let quarters = Climate::parse("a", &format!("{WEA}1 1 8.125 1 1\n1 1 8.375 1 1\n1 1 9.125 1 1\n")).unwrap();
        assert_eq!(quarters.step_hours(), 0.25);
        assert!(some.warnings.iter().any(|warning| warning.text.contains("1 hours have negative light")));
        let polar = Climate::parse("a", &format!("{}1 1 8.5 1 1\n", WEA.replace("48", "78"))).unwrap();
        assert!(polar.warnings.iter().any(|warning| warning.text.contains("polar circle")));
    }
}
