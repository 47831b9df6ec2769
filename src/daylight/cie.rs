//! Standard skies of the CIE: overcast, clear and intermediate, and the uniform one.

use std::f64::consts::FRAC_PI_2;

/// A sky of known shape.
///
/// The shapes are those of Radiance's `gensky`: the CIE overcast sky (Moon and Spencer 1942), the CIE clear sky (CIE S 003/E-1996), and the
/// intermediate one (Matsuura 1987, as in CIE TC 4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CieSky {
    /// Equal everywhere.
    Uniform,
    /// Three times as bright at the zenith as at the horizon.
    Overcast,
    /// Without a cloud, around the sun.
    Clear,
    /// Between the two, around the sun.
    Intermediate,
}

impl CieSky {
    /// Luminance relative to that of the zenith, at an altitude above 0 and an angle from the sun, under a sun at an altitude; all in
    /// radians.
    pub fn relative_luminance(self, altitude: f64, from_sun: f64, sun_altitude: f64) -> f64 {
        let (zenith, sun_zenith) = (FRAC_PI_2 - altitude, FRAC_PI_2 - sun_altitude);
        match self {
            Self::Uniform => 1.0,
            Self::Overcast => (1.0 + 2.0 * altitude.sin()) / 3.0,
            Self::Clear => {
                let around = |angle: f64| 0.91 + 10.0 * (-3.0 * angle).exp() + 0.45 * angle.cos().powi(2);
                let height = altitude.sin();
                let gradation = if height > 0.01 { 1.0 - (-0.32 / height).exp() } else { 1.0 };
                around(from_sun) * gradation / (around(sun_zenith) * (1.0 - (-0.32f64).exp()))
            }
            Self::Intermediate => {
                let shape = |zenith: f64, from_sun: f64| {
                    let height = (1.35 * (5.631 - 3.59 * zenith).sin() + 3.12) * (4.396 - 2.6 * sun_zenith).sin();
                    let gradation = (height + 6.37 - zenith) / 2.326;
                    let falling = (2.629 - zenith) * (1.562 - sun_zenith) + 0.812;
                    gradation * (-0.563 * from_sun * falling).exp()
                };
                shape(zenith, from_sun) / shape(0.0, sun_zenith)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Horizontal illuminance for a zenith luminance of 1, by Simpson's rule over altitude and azimuth.
    fn horizontal(sky: CieSky, sun_altitude: f64) -> f64 {
        const STEPS: usize = 200;
        let weight = |i: usize| match i {
            0 | STEPS => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let mut sum = 0.0;
        for i in 0..=STEPS {
            let altitude = FRAC_PI_2 * i as f64 / STEPS as f64;
            for j in 0..=STEPS {
                let azimuth = PI * j as f64 / STEPS as f64;
                let cosine = altitude.sin() * sun_altitude.sin() + altitude.cos() * sun_altitude.cos() * azimuth.cos();
                let from_sun = cosine.clamp(-1.0, 1.0).acos();
                let part = sky.relative_luminance(altitude, from_sun, sun_altitude) * altitude.sin() * altitude.cos();
                sum += part * weight(i) * weight(j);
            }
        }
        // Both halves of the azimuth.
        2.0 * sum * (FRAC_PI_2 / STEPS as f64 / 3.0) * (PI / STEPS as f64 / 3.0)
    }

    /// The overcast sky gives 7π/9 of its zenith luminance, the uniform one π.
    #[test]
    fn the_horizontal_illuminance_is_the_analytic_one() {
        assert!((horizontal(CieSky::Uniform, 0.5) - PI).abs() < 1e-6);
        assert!((horizontal(CieSky::Overcast, 0.5) - 7.0 * PI / 9.0).abs() < 1e-6);
    }

    #[test]
    fn all_skies_are_1_at_the_zenith() {
        for sky in [CieSky::Uniform, CieSky::Overcast, CieSky::Clear, CieSky::Intermediate] {
            for sun in [0.1, 0.7, 1.3] {
                let found = sky.relative_luminance(FRAC_PI_2, FRAC_PI_2 - sun, sun);
                assert!((found - 1.0).abs() < 1e-9, "{sky:?}, {sun}: {found}");
            }
        }
    }
}
