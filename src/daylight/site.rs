//! Where a climate was measured.

use crate::error::{Error, Result};

/// A place on the earth, with the time that its climate file counts in.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Name, for people.
    pub name: String,
    /// Degrees north.
    pub latitude_degrees: f64,
    /// Degrees east.
    pub longitude_degrees: f64,
    /// Hours that the time of the file is ahead of UTC.
    pub time_zone_hours: f64,
    /// Metres above the sea.
    pub elevation_metres: f64,
}

impl Site {
    /// The site, if it lies on the earth. `place` names it in the message.
    ///
    /// # Errors
    /// A latitude beyond ±90°, a longitude beyond ±180°, a time zone beyond ±15 hours, a height beyond −1,000 to 9,999 m.
    pub(super) fn checked(self, place: &str) -> Result<Self> {
        let within = |name: &str, value: f64, low: f64, high: f64| match (low..=high).contains(&value) {
            true => Ok(()),
            false => Err(Error::input(place, format!("the {name} is {value}"), format!("it lies in {low} to {high}"))),
        };
        within("latitude", self.latitude_degrees, -90.0, 90.0)?;
        within("longitude", self.longitude_degrees, -180.0, 180.0)?;
        within("time zone", self.time_zone_hours, -15.0, 15.0)?;
        within("elevation", self.elevation_metres, -1000.0, 9999.0)?;
        Ok(self)
    }

    /// Whether there are days on which the sun does not rise or does not set.
    pub fn is_polar(&self) -> bool {
        self.latitude_degrees.abs() > 66.56
    }
}
