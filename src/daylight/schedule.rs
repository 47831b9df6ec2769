//! When a room is used.

use super::ClimateStep;
use crate::error::{Error, Result};

/// Hours of the day in some months: when a room is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Hour at which it begins, of the site's time.
    pub from_hour: f64,
    /// Hour at which it ends.
    pub to_hour: f64,
    /// The months, bit 0 for January.
    pub months: u16,
}

impl Default for Schedule {
    /// From 8 to 18 o'clock on all days, as IES LM-83-12 has it (§3.2).
    fn default() -> Self {
        Self { from_hour: 8.0, to_hour: 18.0, months: 0xfff }
    }
}

impl Schedule {
    /// Reads `FROM-TO`, hours of the day such as `8-18` or `8.5-17`.
    ///
    /// # Errors
    /// Text of another form, hours that are none, an end that is not after the begin.
    pub fn parse_hours(text: &str) -> Result<Self> {
        let hours =
            text.split_once('-').and_then(|(from, to)| Some((from.trim().parse().ok()?, to.trim().parse().ok()?)));
        let Some((from_hour, to_hour)) = hours else {
            return Err(Error::input(format!("'{text}'"), "is no time of use", "write FROM-TO in hours, such as 8-18"));
        };
        Self::of_hours(from_hour, to_hour)
    }

    /// From one hour of the day to a later one, in all months.
    ///
    /// # Errors
    /// Hours that are none; an end that is not after the begin.
    pub fn of_hours(from_hour: f64, to_hour: f64) -> Result<Self> {
        if from_hour >= 0.0 && from_hour < to_hour && to_hour <= 24.0 {
            return Ok(Self { from_hour, to_hour, ..Self::default() });
        }
        let place = format!("'{from_hour}-{to_hour}'");
        Err(Error::input(place, "is no time of use", "write FROM-TO in hours, such as 8-18"))
    }

    /// Only these months, 1 to 12: from `first` to `last`, which may lie in the next year.
    ///
    /// # Errors
    /// Months that are none.
    pub fn in_months(mut self, first: u8, last: u8) -> Result<Self> {
        if !(1..=12).contains(&first) || !(1..=12).contains(&last) {
            return Err(Error::input(format!("months {first} to {last}"), "are none", "give 1 to 12"));
        }
        let (mut month, mut months) = (first, 1 << (first - 1));
        while month != last {
            month = month % 12 + 1;
            months |= 1 << (month - 1);
        }
        self.months = months;
        Ok(self)
    }

    /// Whether a step's middle is a time of use.
    pub fn holds(&self, step: &ClimateStep) -> bool {
        (self.from_hour..self.to_hour).contains(&step.hour) && self.months >> (step.month - 1) & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::super::Measured;
    use super::*;

    #[test]
    fn a_year_has_3650_hours_of_use_by_lm_83() {
        let measured = Measured::Irradiance { direct: 0.0, diffuse: 0.0 };
        let step = |hour: u32| ClimateStep {
            month: 1,
            day: 1,
            hour: f64::from(hour) + 0.5,
            day_of_year: 1,
            measured,
            dew_point: None,
        };
        let of_day = |schedule: Schedule| (0..24).filter(|hour| schedule.holds(&step(*hour))).count();
        assert_eq!(365 * of_day(Schedule::default()), 3650);
        assert_eq!(of_day(Schedule::parse_hours("8.5-17").unwrap()), 9);
        assert_eq!(of_day(Schedule::default().in_months(11, 2).unwrap()), 10);
        assert_eq!(of_day(Schedule::default().in_months(2, 12).unwrap()), 0);
        for bad in ["", "8", "18-8", "8-25", "a-b", "-1-5"] {
            assert!(Schedule::parse_hours(bad).is_err(), "{bad}");
        }
        assert!(Schedule::default().in_months(0, 13).is_err());
    }
}
