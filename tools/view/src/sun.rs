//! The sun: where it stands at a time and place, and on which texel of a sky or as which of several suns.

use solar_positioning::time::JulianDate;
use solar_positioning::{Location, SolarPositions};

use super::mixer::{LightMix, Mix};
use super::pattern::Pattern;
use ltm::error::{Error, Result};
use ltm::light::{Light, LightBasis, LightKind};

/// Difference of terrestrial and universal time in seconds, about today's; a minute of it moves the sun by 0.0007°.
const DELTA_T_SECS: f64 = 69.0;

/// A time at a place on Earth, and how the scene lies there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Year, month (1 to 12), day (1 to 31).
    pub date: [i32; 3],
    /// Hour of the day on the clock there, 0 to 24.
    pub hour: f64,
    /// Hours by which that clock is ahead of universal time.
    pub zone_hours: f64,
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Degrees by which north is turned from the world's −z towards +x.
    pub north_degrees: f64,
}

impl Default for Moment {
    /// Noon of a summer's day in Paris.
    fn default() -> Self {
        let (latitude, longitude) = (48.86, 2.35);
        Self { date: [2026, 6, 21], hour: 12.0, zone_hours: 2.0, latitude, longitude, north_degrees: 0.0 }
    }
}

/// A direction by angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// From north, clockwise as seen from above.
    pub azimuth: f64,
    /// Above the horizon.
    pub elevation: f64,
}

impl Moment {
    /// Where the sun stands, by the Solar Position Algorithm (I. Reda, A. Andreas, 2003), without the air's refraction.
    ///
    /// Errors: a date or place that there is not.
    pub fn sun(&self) -> Result<Angles> {
        let [year, month, day] = self.date;
        let refuse = |error: solar_positioning::Error| Error::input("the sun", error.to_string(), "");
        let (month, day) = (month.max(0) as u32, day.max(0) as u32);
        let days_in = days_in_month(year, month);
        if !(1..=days_in).contains(&day) {
            return Err(Error::input("the sun", format!("{year}-{month:02}-{day:02} is no date"), ""));
        }
        let midnight = JulianDate::from_utc(year, month, day, 0, 0, 0.0, DELTA_T_SECS).map_err(refuse)?;
        let days = (self.hour - self.zone_hours) / 24.0;
        let time = JulianDate::new(midnight.julian_date() + days, DELTA_T_SECS).map_err(refuse)?;
        let place = Location { latitude: self.latitude, longitude: self.longitude };
        let position = SolarPositions::new().at_from_julian(time, place, 0.0, None).map_err(refuse)?;
        Ok(Angles { azimuth: position.azimuth(), elevation: position.elevation_angle() })
    }

    /// The direction of these angles in the world, +y up.
    pub fn direction(&self, angles: Angles) -> [f32; 3] {
        let (sin, cos) = (angles.azimuth + self.north_degrees).to_radians().sin_cos();
        let (up, level) = angles.elevation.to_radians().sin_cos();
        [level * sin, up, -level * cos].map(|v| v as f32)
    }

    /// The angles of a direction in the world.
    pub fn angles(&self, [x, y, z]: [f32; 3]) -> Angles {
        let azimuth = f64::from(x).atan2(f64::from(-z)).to_degrees() - self.north_degrees;
        let elevation = f64::from(y).atan2(f64::from(x).hypot(f64::from(z))).to_degrees();
        Angles { azimuth: azimuth.rem_euclid(360.0), elevation }
    }
}

fn days_in_month(year: i32, month: u32) -> u32 {
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    match month {
        1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
        4 | 6 | 9 | 11 => 30,
        2 => 28 + u32::from(is_leap),
        _ => 0,
    }
}

/// A sky with the sun on one of its texels, which sends `2^stops` times what the whole sky does.
///
/// # Panics
/// If the light has no such texel, or the sky another number of them.
pub fn with_sun(light: &Light, sky: &Pattern, texel: usize, stops: f32) -> Pattern {
    let mut with = sky.clone();
    let mut total = [0.0f32; 3];
    for (value, extent) in sky.texels().iter().zip(&light.extents) {
        (0..3).for_each(|ch| total[ch] += value[ch] * extent);
    }
    let extent = light.extents[texel].max(f32::MIN_POSITIVE);
    let own = &mut with.texels_mut()[texel];
    (0..3).for_each(|ch| own[ch] += total[ch] * stops.exp2() / extent);
    with
}

/// A sun that was put into a sky, so that it can be moved.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedSun {
    light: usize,
    texel: usize,
    sky: Pattern,
    with: Pattern,
}

impl PlacedSun {
    /// Puts a sun into a sky, or moves the one that was put there last; what else is on the sky stays.
    pub fn put(
        before: Option<Self>,
        own: &mut LightMix,
        index: usize,
        light: &Light,
        texel: usize,
        stops: f32,
    ) -> Self {
        let is_last = |before: &Self| before.light == index && own.pattern.as_ref() == Some(&before.with);
        let sky = match before.filter(is_last) {
            Some(before) => before.sky,
            None => match &own.pattern {
                Some(pattern) => pattern.turned(light.kind, own.turn_radians).into_owned(),
                None => Pattern::white(light.layout()),
            },
        };
        let with = with_sun(light, &sky, texel, stops);
        (own.pattern, own.shape, own.turn_radians, own.on) = (Some(with.clone()), None, 0.0, true);
        Self { light: index, texel, sky, with }
    }

    /// The sky that it was put into.
    pub fn light(&self) -> usize {
        self.light
    }

    /// The texel that it stands on, while it is still there.
    pub fn texel(&self, index: usize, own: &LightMix) -> Option<usize> {
        (self.light == index && own.pattern.as_ref() == Some(&self.with)).then_some(self.texel)
    }
}

/// Of the suns of a basis, leaves on the one that is nearest to a direction; its index, if there is a sun.
pub fn choose_sun(basis: &LightBasis, mix: &mut Mix, direction: [f32; 3]) -> Option<usize> {
    let suns: Vec<usize> = suns(basis);
    let nearness = |&sun: &usize| (0..3).map(|i| basis.lights()[sun].places[0][i] * direction[i]).sum::<f32>();
    let nearest = suns.iter().copied().max_by(|a, b| nearness(a).total_cmp(&nearness(b)))?;
    suns.into_iter().for_each(|sun| mix.lights[sun].on = sun == nearest);
    Some(nearest)
}

/// The lights that are suns.
pub fn suns(basis: &LightBasis) -> Vec<usize> {
    (0..basis.lights().len()).filter(|&light| basis.lights()[light].kind == LightKind::Sun).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_stands_where_almanacs_say() {
        // The example of the algorithm's report, Golden (Colorado), 2003-10-17 12:30:30 at UTC − 7: azimuth 194.34°, zenith
        // 50.11° at 1,830 m and with refraction, which lifts it by 0.016°.
        let golden = Moment {
            date: [2003, 10, 17],
            hour: 12.0 + 30.5 / 60.0,
            zone_hours: -7.0,
            latitude: 39.742_476,
            longitude: -105.1786,
            north_degrees: 0.0,
        };
        let sun = golden.sun().unwrap();
        assert!((sun.azimuth - 194.34).abs() < 0.01 && (sun.elevation - 39.872).abs() < 0.01, "{sun:?}");
        // Across midnight of universal time.
        let late = Moment { date: [2003, 10, 16], hour: 12.0 + 30.5 / 60.0 + 24.0, ..golden };
        assert!((late.sun().unwrap().azimuth - sun.azimuth).abs() < 1e-9);
        for date in [[2026, 2, 29], [2026, 13, 1], [2026, 4, 31], [2026, 0, 1], [2026, 5, -1]] {
            assert!(Moment { date, ..golden }.sun().is_err(), "{date:?}");
        }
        assert!(Moment { date: [2024, 2, 29], ..golden }.sun().is_ok());
        assert!(Moment { latitude: 91.0, ..golden }.sun().is_err());
    }

    #[test]
    fn directions_and_angles_are_each_other_s_inverse() {
        let moment = Moment { north_degrees: 30.0, ..Default::default() };
        for (azimuth, elevation) in [(0.0, 0.0), (90.0, 45.0), (200.0, 10.0), (359.0, -20.0)] {
            let angles = moment.angles(moment.direction(Angles { azimuth, elevation }));
            assert!(
                (angles.azimuth - azimuth).abs() < 1e-3 && (angles.elevation - elevation).abs() < 1e-3,
                "{angles:?}"
            );
        }
        let plain = Moment { north_degrees: 0.0, ..moment };
        let east = plain.direction(Angles { azimuth: 90.0, elevation: 0.0 });
        assert!((east[0] - 1.0).abs() < 1e-6, "north is −z, east +x: {east:?}");
    }

    fn sky() -> Light {
        let mut sky = Light::unplaced("sky", LightKind::LatLong { across: 2, down: 2 });
        sky.places = vec![[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]];
        sky.extents = vec![1.0, 2.0, 3.0, 4.0];
        sky
    }

    #[test]
    fn a_sun_is_put_into_the_sky_and_moved_without_leaving_another() {
        let sky = sky();
        let texel = sky.nearest_texel([-1.0, 0.5, 0.0]);
        assert_eq!(texel, 1);
        let mut own = LightMix::of_scene(&sky);
        let first = PlacedSun::put(None, &mut own, 0, &sky, texel, 1.0);
        // Twice the sky's ten over its own two.
        assert_eq!(own.pattern.as_ref().unwrap().texels(), [[1.0; 3], [11.0; 3], [1.0; 3], [1.0; 3]]);
        assert_eq!(first.texel(0, &own), Some(1));
        let second = PlacedSun::put(Some(first.clone()), &mut own, 0, &sky, 0, 0.0);
        assert_eq!(own.pattern.as_ref().unwrap().texels(), [[11.0; 3], [1.0; 3], [1.0; 3], [1.0; 3]]);
        // What was painted meanwhile stays.
        own.pattern.as_mut().unwrap().texels_mut()[3] = [0.0; 3];
        assert_eq!(second.texel(0, &own), None);
        PlacedSun::put(Some(second), &mut own, 0, &sky, 1, 0.0);
        assert_eq!(own.pattern.as_ref().unwrap().texels()[3], [0.0; 3]);
    }

    #[test]
    fn of_several_suns_the_nearest_is_left_on() {
        let mut basis = LightBasis::new();
        for (name, kind, place) in [
            ("noon", LightKind::Sun, [0.0, 1.0, 0.0]),
            ("lamp", LightKind::Lamp, [0.9, 0.1, 0.0]),
            ("evening", LightKind::Sun, [1.0, 0.1, 0.0]),
        ] {
            basis.push(Light { places: vec![place], ..Light::unplaced(name, kind) }).unwrap();
        }
        let mut mix = Mix::of_scene(&basis);
        assert_eq!(choose_sun(&basis, &mut mix, [1.0, 0.0, 0.0]), Some(2));
        assert_eq!(mix.lights.iter().map(|light| light.on).collect::<Vec<_>>(), [false, true, true]);
        assert_eq!(choose_sun(&LightBasis::new(), &mut mix, [1.0, 0.0, 0.0]), None);
    }
}
