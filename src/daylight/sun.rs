//! Where the sun stands.

use std::f64::consts::PI;

use glam::DVec3;

use super::Site;

/// Full angle of the sun's disc in degrees.
pub(super) const SUN_DEGREES: f64 = 0.533;

/// The place of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Above the horizon, in radians.
    pub altitude: f64,
    /// From north towards east, in radians.
    pub azimuth: f64,
}

impl Sun {
    /// The unit direction towards it: +y the zenith, −z north, +x east.
    pub fn towards(self) -> DVec3 {
        let (sin, cos) = self.azimuth.sin_cos();
        let (height, ring) = self.altitude.sin_cos();
        DVec3::new(ring * sin, height, -ring * cos)
    }

    /// Whether any of its disc is above the horizon.
    pub fn is_up(self) -> bool {
        self.altitude > -(0.5 * SUN_DEGREES).to_radians()
    }
}

/// The sun over a site on a day of the year (1 for the first of January) at an hour of the site's time.
///
/// Declination, equation of time and angles are those of the Illuminating Engineering Society (IES Calculation Procedures Committee 1984,
/// *Recommended practice for the calculation of daylight availability*, Journal of the IES 13 (4), eqs. 1 to 5), the declination with a period
/// of 365 days for the printed 368, as Radiance 6 has it.
pub fn sun_at(site: &Site, day_of_year: u16, hour: f64) -> Sun {
    let day = f64::from(day_of_year);
    let declination = 0.4093 * (2.0 * PI / 365.0 * (day - 81.0)).sin();
    let equation_of_time =
        0.170 * (4.0 * PI / 373.0 * (day - 80.0)).sin() - 0.129 * (2.0 * PI / 355.0 * (day - 8.0)).sin();
    let east_of_meridian = (site.longitude_degrees - 15.0 * site.time_zone_hours) / 15.0;
    let hour_angle = (hour + equation_of_time + east_of_meridian) * PI / 12.0;
    let (sin_latitude, cos_latitude) = site.latitude_degrees.to_radians().sin_cos();
    let (sin_declination, cos_declination) = declination.sin_cos();
    let (sin_hour, cos_hour) = hour_angle.sin_cos();
    let height = sin_latitude * sin_declination - cos_latitude * cos_declination * cos_hour;
    // From south towards west, and from there to north.
    let from_south = -(cos_declination * sin_hour)
        .atan2(-cos_latitude * sin_declination - sin_latitude * cos_declination * cos_hour);
    Sun { altitude: height.clamp(-1.0, 1.0).asin(), azimuth: from_south + PI }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `gendaymtx -D suns.rad` of Radiance 6.0a over the file of the module's example and its dates: east, north, up.
    #[test]
    fn the_sun_stands_where_radiance_has_it() {
        let site = Site {
            name: "Testville".into(),
            latitude_degrees: 48.1,
            longitude_degrees: 11.6,
            time_zone_hours: 1.0,
            elevation_metres: 515.0,
        };
        for (day, hour, [east, north, up]) in [
            (80, 6.5, [0.999205, -0.033918, 0.020968]),
            (80, 9.5, [0.678791, -0.551251, 0.485144]),
            (80, 12.5, [-0.039249, -0.748425, 0.662057]),
            (172, 12.5, [-0.059991, -0.415598, 0.907568]),
            (355, 15.5, [-0.700494, -0.706700, 0.099412]),
        ] {
            let towards = sun_at(&site, day, hour).towards();
            assert!((towards - DVec3::new(east, up, -north)).length() < 2e-6, "{day}, {hour}: {towards}");
        }
    }

    #[test]
    fn at_the_pole_the_sun_keeps_its_height_all_day() {
        let site = Site {
            name: "Pole".into(),
            latitude_degrees: 90.0,
            longitude_degrees: 0.0,
            time_zone_hours: 0.0,
            elevation_metres: 0.0,
        };
        let heights: Vec<f64> = (0..24).map(|hour| sun_at(&site, 172, f64::from(hour)).altitude).collect();
        assert!(heights.iter().all(|height| (height.to_degrees() - 23.45).abs() < 0.1), "{heights:?}");
        assert!(!sun_at(&site, 355, 12.0).is_up() && site.is_polar());
    }
}
