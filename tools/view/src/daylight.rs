//! Daylight of a climate: the hour of the year that sky and sun of a mix show.

use std::path::Path;

use super::mixer::{LightMix, Mix};
use ltm::daylight::{Climate, DAYS_BEFORE_MONTH, SkyOptions};
use ltm::error::Result;
use ltm::light::{LightBasis, Lighting};
use ltm::pipeline::lighting_at;

/// The months as they are written beside a day.
const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

/// A climate, and a time of its year.
#[derive(Clone, Debug)]
pub struct Daylight {
    climate: Climate,
    /// Day of a year without a leap day, from 1.
    pub day_of_year: u16,
    /// Hour of the site's time.
    pub hour: f64,
    /// How far north is turned from the world's −z towards +x, in degrees.
    pub north_degrees: f64,
}

impl Daylight {
    /// Reads an EPW or WEA file, at noon of midsummer.
    ///
    /// # Errors
    /// Those of [`Climate::read`].
    pub fn read(path: &Path) -> Result<Self> {
        Ok(Self { climate: Climate::read(path)?, day_of_year: 172, hour: 12.0, north_degrees: 0.0 })
    }

    /// The site's name.
    pub fn site(&self) -> &str {
        &self.climate.site.name
    }

    /// Puts sky and sun of the time on the lights that are the sky and places of the sun; the others stay as they are.
    ///
    /// # Errors
    /// Those of [`lighting_at`].
    pub fn put(&self, place: &str, basis: &LightBasis, mix: &mut Mix) -> Result<()> {
        // Here north is turned from the world's axis, there the axis from north.
        let options = SkyOptions { north_degrees: -self.north_degrees, ..SkyOptions::default() };
        let time = (date_of(self.day_of_year), self.hour);
        let lighting = lighting_at(place, &Lighting::off(basis), basis, &self.climate, time, options)?;
        for (light, own) in basis.lights().iter().zip(&mut mix.lights).filter(|(light, _)| light.kind.is_daylight()) {
            let columns = light.first_column as usize..light.first_column as usize + light.places.len();
            *own = LightMix { solo: own.solo, ..LightMix::of_weights(light, &lighting.weights()[columns]) };
        }
        Ok(())
    }
}

/// Month and day, from 1, of a day of a year without a leap day.
fn date_of(day_of_year: u16) -> (u8, u8) {
    let day = day_of_year.clamp(1, 365);
    let month = DAYS_BEFORE_MONTH.partition_point(|&before| before < day);
    (month as u8, (day - DAYS_BEFORE_MONTH[month - 1]) as u8)
}

/// A day of a year as people write it: `21 Jun`.
pub fn date_in_words(day_of_year: u16) -> String {
    let (month, day) = date_of(day_of_year);
    format!("{day} {}", MONTHS[usize::from(month) - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEA: &str = "place Testville_XX\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\n\
        weather_data_file_units 3\n6 21 11.5 80000 12000\n6 21 12.5 60000 20000\n";

    #[test]
    fn days_of_the_year_are_dates() {
        assert_eq!([1, 31, 32, 172, 365].map(date_of), [(1, 1), (1, 31), (2, 1), (6, 21), (12, 31)]);
        assert_eq!(date_in_words(355), "21 Dec");
    }

    /// The sun stands in the south at noon and, where north is the world's +x, in the direction of −x.
    #[test]
    fn an_hour_lights_the_sky_and_leaves_lamps_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wea");
        std::fs::write(&path, WEA).unwrap();
        let mut daylight = Daylight::read(&path).unwrap();
        assert_eq!(daylight.site(), "Testville, XX");
        let basis = crate::test_lights::sky_and_lamp();
        let mut mix = Mix::of_scene(&basis);
        let lamp = mix.lights[1].clone();
        for (north, middle) in [(0.0, [0.0, 1.0]), (90.0, [-1.0, 0.0])] {
            daylight.north_degrees = north;
            daylight.put("a", &basis, &mut mix).unwrap();
            let weights = mix.lighting(&basis).unwrap().weights().to_vec();
            let sky = &basis.lights()[0];
            let mut sum = [0.0f32; 2];
            for (place, weight) in sky.places.iter().zip(&weights) {
                (sum[0], sum[1]) = (sum[0] + place[0] * weight[1], sum[1] + place[2] * weight[1]);
            }
            let length = sum[0].hypot(sum[1]);
            assert!(length > 0.0 && (0..2).all(|axis| (sum[axis] / length - middle[axis]).abs() < 0.35), "{sum:?}");
            assert_eq!(mix.lights[1], lamp);
        }
        daylight.day_of_year = 1;
        assert!(daylight.put("a", &basis, &mut mix).unwrap_err().to_string().contains("no hours on day 1"));
    }
}
