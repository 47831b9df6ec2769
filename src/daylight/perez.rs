//! The all-weather sky of Perez, Seals and Michalsky.

use super::climate::Measured;

/// Solar constant in W/m², and its illuminance in lux (Perez et al. 1990, nomenclature).
const SOLAR_IRRADIANCE: f64 = 1367.0;
const SOLAR_ILLUMINANCE: f64 = 127_500.0;

/// Upper bounds of the categories of clearness ε (Perez et al. 1990, table 1).
const CLEARNESS_BOUNDS: [f64; 7] = [1.065, 1.230, 1.500, 1.950, 2.800, 4.500, 6.200];

/// Coefficients x₁ to x₄ of the parameters a to e, for each category of clearness (Perez, Seals and Michalsky 1993, *All-weather model for sky
/// luminance distribution*, table 1, with its erratum).
const LUMINANCE: [[[f64; 4]; 5]; 8] = [
    [
        [1.3525, -0.2576, -0.2690, -1.4366],
        [-0.7670, 0.0007, 1.2734, -0.1233],
        [2.8000, 0.6004, 1.2375, 1.0000],
        [1.8734, 0.6297, 0.9738, 0.2809],
        [0.0356, -0.1246, -0.5718, 0.9938],
    ],
    [
        [-1.2219, -0.7730, 1.4148, 1.1016],
        [-0.2054, 0.0367, -3.9128, 0.9156],
        [6.9750, 0.1774, 6.4477, -0.1239],
        [-1.5798, -0.5081, -1.7812, 0.1080],
        [0.2624, 0.0672, -0.2190, -0.4285],
    ],
    [
        [-1.1000, -0.2515, 0.8952, 0.0156],
        [0.2782, -0.1812, -4.5000, 1.1766],
        [24.7219, -13.0812, -37.7000, 34.8438],
        [-5.0000, 1.5218, 3.9229, -2.6204],
        [-0.0156, 0.1597, 0.4199, -0.5562],
    ],
    [
        [-0.5484, -0.6654, -0.2672, 0.7117],
        [0.7234, -0.6219, -5.6812, 2.6297],
        [33.3389, -18.3000, -62.2500, 52.0781],
        [-3.5000, 0.0016, 1.1477, 0.1062],
        [0.4659, -0.3296, -0.0876, -0.0329],
    ],
    [
        [-0.6000, -0.3566, -2.5000, 2.3250],
        [0.2937, 0.0496, -5.6812, 1.8415],
        [21.0000, -4.7656, -21.5906, 7.2492],
        [-3.5000, -0.1554, 1.4062, 0.3988],
        [0.0032, 0.0766, -0.0656, -0.1294],
    ],
    [
        [-1.0156, -0.3670, 1.0078, 1.4051],
        [0.2875, -0.5328, -3.8500, 3.3750],
        [14.0000, -0.9999, -7.1406, 7.5469],
        [-3.4000, -0.1078, -1.0750, 1.5702],
        [-0.0672, 0.4016, 0.3017, -0.4844],
    ],
    [
        [-1.0000, 0.0211, 0.5025, -0.5119],
        [-0.3000, 0.1922, 0.7023, -1.6317],
        [19.0000, -5.0000, 1.2438, -1.9094],
        [-4.0000, 0.0250, 0.3844, 0.2656],
        [1.0468, -0.3788, -2.4517, 1.4656],
    ],
    [
        [-1.0500, 0.0289, 0.4260, 0.3590],
        [-0.3250, 0.1156, 0.7781, 0.0025],
        [31.0625, -14.5000, -46.1148, 55.3750],
        [-7.2312, 0.4050, 13.3500, 0.6234],
        [1.5000, -0.6426, 1.8564, 0.5636],
    ],
];

/// Luminous efficacy of diffuse light: a + b·w + c·cos z + d·ln Δ (Perez et al. 1990, *Modeling daylight availability and irradiance components
/// from direct and global irradiance*, eq. 7 and table 4).
const DIFFUSE_EFFICACY: [[f64; 4]; 8] = [
    [97.24, -0.46, 12.00, -8.91],
    [107.22, 1.15, 0.59, -3.95],
    [104.97, 2.96, -5.53, -8.77],
    [102.39, 5.59, -13.95, -13.90],
    [100.71, 5.94, -22.75, -23.74],
    [106.42, 3.83, -36.15, -28.83],
    [141.88, 1.90, -53.24, -14.03],
    [152.23, 0.35, -45.27, -7.98],
];

/// That of direct light: a + b·w + c·exp(5.73 z − 5) + d·Δ (eq. 8 and table 4).
const DIRECT_EFFICACY: [[f64; 4]; 8] = [
    [57.20, -4.55, -2.98, 117.12],
    [98.99, -3.46, -1.21, 12.38],
    [109.83, -4.90, -1.71, -8.81],
    [110.34, -5.84, -1.99, -4.56],
    [106.36, -3.97, -1.75, -6.16],
    [107.19, -1.25, -1.51, -26.73],
    [105.75, 0.77, -1.26, -34.44],
    [101.18, 1.58, -1.10, -8.29],
];

/// The dew point where a climate file has none, in °C.
const USUAL_DEW_POINT: f64 = 11.0;

/// A sky: its relative luminance, and how much it and the sun give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerezSky {
    /// Parameters a to e.
    parameters: [f64; 5],
    /// Angle of the sun from the zenith in radians, as the model takes it: 3° to 90°.
    sun_zenith: f64,
    /// Illuminance of the horizontal by the sky, in lux.
    pub diffuse_illuminance: f64,
    /// Illuminance by the sun of a plane across its light, in lux.
    pub direct_illuminance: f64,
}

/// What efficacies and parameters are looked up by.
#[derive(Clone, Copy)]
struct Weather {
    sun_zenith: f64,
    clearness: f64,
    brightness: f64,
    /// Precipitable water in centimetres.
    water: f64,
}

impl PerezSky {
    /// The sky of a measurement. `altitude` is that of the sun in radians, the dew point in °C. `None` at night: where direct and diffuse light
    /// together are 10⁻⁴ or less.
    pub fn new(measured: Measured, altitude: f64, day_of_year: u16, dew_point: Option<f64>) -> Option<Self> {
        // Neither below the horizon nor so near to the zenith that the light around the sun surrounds it.
        let sun_zenith = std::f64::consts::FRAC_PI_2 - altitude.clamp(0.0, 87f64.to_radians());
        let sun_zenith = if altitude >= 87f64.to_radians() { 3f64.to_radians() } else { sun_zenith };
        // Perez et al. 1990, eq. 3.
        let water = (0.07 * dew_point.unwrap_or(USUAL_DEW_POINT) - 0.075).exp();
        let weather = |[direct, diffuse]: [f64; 2], most_clear: f64| {
            let cubed = 1.041 * sun_zenith.powi(3);
            // Eqs. 1 and 2.
            let clearness = ((diffuse + direct) / diffuse + cubed) / (1.0 + cubed);
            let brightness = diffuse * air_mass(sun_zenith) / (SOLAR_IRRADIANCE * eccentricity(day_of_year));
            // Without diffuse light the clearness is infinite.
            let (clearness, brightness) = (clearness.clamp(1.0, most_clear), brightness.clamp(0.01, 0.6));
            Weather { sun_zenith, clearness, brightness, water }
        };
        let (weather, [direct, diffuse]) = match measured {
            Measured::Irradiance { direct, diffuse } => {
                let weather = weather([direct, diffuse], 11.9);
                (weather, [direct * weather.direct_efficacy(), diffuse * weather.diffuse_efficacy()])
            }
            Measured::Illuminance { direct, diffuse } => {
                let per_lux = SOLAR_IRRADIANCE / SOLAR_ILLUMINANCE;
                let mut irradiance = [direct * per_lux, diffuse * per_lux];
                let (mut found, mut before) = (weather(irradiance, 12.0), [0.1; 2]);
                // The irradiance whose efficacy gives the illuminance, within 10 W/m².
                for _ in 0..5 {
                    if irradiance.iter().zip(before).all(|(now, before)| (now - before).abs() <= 10.0) {
                        break;
                    }
                    before = irradiance;
                    let efficacy = found.direct_efficacy();
                    let direct = if efficacy > 0.1 { direct / efficacy } else { efficacy };
                    irradiance = [direct, diffuse / found.diffuse_efficacy()];
                    found = weather(irradiance, 12.0);
                }
                (found, [direct, diffuse])
            }
        };
        let is_day = direct + diffuse > 1e-4;
        is_day.then(|| Self {
            parameters: weather.parameters(),
            sun_zenith,
            diffuse_illuminance: diffuse,
            direct_illuminance: direct,
        })
    }

    /// Relative luminance at an altitude and an azimuth from that of the sun, in radians (Perez, Seals and Michalsky 1993, eq. 1).
    pub fn relative_luminance(&self, altitude: f64, azimuth_from_sun: f64) -> f64 {
        let zenith = std::f64::consts::FRAC_PI_2 - altitude;
        let cosine =
            self.sun_zenith.cos() * zenith.cos() + self.sun_zenith.sin() * zenith.sin() * azimuth_from_sun.cos();
        let (angle, [a, b, c, d, e]) = (cosine.clamp(-1.0, 1.0).acos(), self.parameters);
        let gradation = 1.0 + a * (b / zenith.cos()).exp();
        let indicatrix = 1.0 + c * (d * angle).exp() + e * angle.cos().powi(2);
        (gradation * indicatrix).max(0.0)
    }
}

impl Weather {
    fn category(self) -> usize {
        CLEARNESS_BOUNDS.iter().take_while(|bound| self.clearness >= **bound).count()
    }

    fn diffuse_efficacy(self) -> f64 {
        let [a, b, c, d] = DIFFUSE_EFFICACY[self.category()];
        a + b * self.water + c * self.sun_zenith.cos() + d * self.brightness.ln()
    }

    fn direct_efficacy(self) -> f64 {
        let [a, b, c, d] = DIRECT_EFFICACY[self.category()];
        (a + b * self.water + c * (5.73 * self.sun_zenith - 5.0).exp() + d * self.brightness).max(0.0)
    }

    /// The parameters a to e (Perez, Seals and Michalsky 1993, eqs. 6 to 8).
    fn parameters(self) -> [f64; 5] {
        let Self { sun_zenith: z, clearness, brightness, .. } = self;
        let delta = if clearness > 1.065 && clearness < 2.8 { brightness.max(0.2) } else { brightness };
        let of = LUMINANCE[self.category()];
        let mut parameters = of.map(|[x1, x2, x3, x4]| x1 + x2 * z + delta * (x3 + x4 * z));
        if self.category() == 0 {
            let [x1, x2, x3, x4] = of[2];
            parameters[2] = (delta * (x1 + x2 * z)).powf(x3).exp() - x4;
            let [x1, x2, x3, x4] = of[3];
            parameters[3] = -(delta * (x1 + x2 * z)).exp() + x3 + delta * x4;
        }
        parameters
    }
}

/// Relative air mass (Kasten 1966).
fn air_mass(sun_zenith: f64) -> f64 {
    1.0 / (sun_zenith.cos() + 0.15 * (93.885 - sun_zenith.to_degrees()).powf(-1.253))
}

/// Square of the mean distance of the sun over that of the day (Sen 2008, *Solar energy fundamentals and modeling techniques*, p. 72).
fn eccentricity(day_of_year: u16) -> f64 {
    let angle = (f64::from(day_of_year) - 1.0) * std::f64::consts::TAU / 365.0;
    1.00011
        + 0.034221 * angle.cos()
        + 0.00128 * angle.sin()
        + 0.000719 * (2.0 * angle).cos()
        + 0.000077 * (2.0 * angle).sin()
}
