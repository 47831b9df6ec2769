//! Measures of a year of daylight: of a place, and of a space.

use super::EyeGlare;

/// Illuminances in lux that measures ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Of daylight autonomy: 300.
    pub autonomy: f32,
    /// Between the bins of useful daylight illuminance: 100, 300, 3,000.
    pub useful: [f32; 3],
    /// Of direct sun: 1,000.
    pub sun: f32,
    /// At eyes, those of glare ([`glare_limits_lux`](super::glare_limits_lux)); none where places are no eyes.
    pub glare: Option<[f32; 3]>,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self { autonomy: 300.0, useful: [100.0, 300.0, 3000.0], sun: 1000.0, glare: None }
    }
}

/// Illuminances of EN 17037:2018, table A.1, in lux: what half of the space is to have, and what 95 % of it are to have, for the classes
/// minimum, medium and high.
pub const EN_17037: [(f32, f32); 3] = [(300.0, 100.0), (500.0, 300.0), (750.0, 500.0)];

/// The illuminances of [`EN_17037`] in order.
const EN_LEVELS: [f32; 4] = [100.0, 300.0, 500.0, 750.0];

/// Hours of direct sun a year above which a place counts for annual sunlight exposure.
const SUN_HOURS: f32 = 250.0;

/// Number of measures of a place.
const MEASURES: usize = 12;

/// Names of [`AnnualMeasures::values`], with their units.
pub const ANNUAL_MEASURES: [(&str, &str); MEASURES] = [
    ("da", "%"),
    ("cda", "%"),
    ("udi_below", "%"),
    ("udi_supplementary", "%"),
    ("udi_autonomous", "%"),
    ("udi_above", "%"),
    ("mean_lux", "lx"),
    ("sun_hours", "h"),
    ("hours_above_100", "h"),
    ("hours_above_300", "h"),
    ("hours_above_500", "h"),
    ("daylight_factor", "%"),
];

/// Sums over the hours of a place, from which its measures follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HourSums {
    /// In the time of use: sum of the illuminance, and of its share of the threshold of autonomy, at most 1.
    sum: f64,
    share: f64,
    /// Steps in the time of use at the threshold of autonomy or above, and at those of useful daylight.
    autonomous: u32,
    useful: [u32; 3],
    /// Steps in the time of use with direct sun above its threshold.
    sun: u32,
    /// Steps in the time of use at each of the limits of glare or above.
    glare: [u32; 3],
    /// Steps with the sun up at each of the levels of EN 17037 or above.
    daylight: [u32; 4],
    /// In percent.
    daylight_factor: f32,
}

impl HourSums {
    /// Sets the daylight factor in percent.
    pub fn set_daylight_factor(&mut self, percent: f32) {
        self.daylight_factor = percent;
    }

    /// Adds steps with these illuminances: whether they are in the time of use, and whether the sun is up.
    #[inline(always)]
    pub fn add(&mut self, lux: &[f32], thresholds: &Thresholds, (is_used, is_day): (bool, bool)) {
        let at_least = |level: f32| lux.iter().map(|value| u32::from(*value >= level)).sum::<u32>();
        if is_used {
            let inverse = thresholds.autonomy.recip();
            let mut sums = [[0.0f32; 8]; 2];
            let (eights, rest) = lux.as_chunks::<8>();
            for eight in eights {
                for lane in 0..8 {
                    sums[0][lane] += eight[lane];
                    sums[1][lane] += (eight[lane] * inverse).min(1.0);
                }
            }
            let of = |sums: [f32; 8]| sums.iter().map(|value| f64::from(*value)).sum::<f64>();
            self.sum += of(sums[0]) + rest.iter().map(|value| f64::from(*value)).sum::<f64>();
            self.share += of(sums[1]) + rest.iter().map(|value| f64::from((value * inverse).min(1.0))).sum::<f64>();
            self.autonomous += at_least(thresholds.autonomy);
            for (count, level) in self.useful.iter_mut().zip(thresholds.useful) {
                *count += at_least(level);
            }
            if let Some(limits) = thresholds.glare {
                for (count, limit) in self.glare.iter_mut().zip(limits) {
                    *count += at_least(limit);
                }
            }
        }
        if is_day {
            for (count, level) in self.daylight.iter_mut().zip(EN_LEVELS) {
                *count += at_least(level);
            }
        }
    }

    /// Adds steps in the time of use with these illuminances by direct sun alone.
    #[inline(always)]
    pub fn add_sun(&mut self, lux: &[f32], thresholds: &Thresholds) {
        self.sun += lux.iter().map(|value| u32::from(*value > thresholds.sun)).sum::<u32>();
    }

    /// Glare of `used` steps, of an eye.
    pub fn eye_glare(&self, used: u32) -> EyeGlare {
        EyeGlare::of_steps(self.glare, used)
    }

    /// Whether no light was added.
    pub fn is_dark(&self) -> bool {
        self.sum == 0.0 && self.daylight[0] == 0
    }

    /// The measures of the place. `used` and `day` are the numbers of steps in the time of use and with the sun up, each of `step_hours`
    /// hours; `knows_sun` says whether direct sun was added.
    pub fn measures(&self, used: u32, day: u32, step_hours: f64, knows_sun: bool) -> AnnualMeasures {
        let percent = |count: f64| (100.0 * count / f64::from(used.max(1))) as f32;
        let [above_100, above_300, above_3000] = self.useful.map(f64::from);
        let below = f64::from(used) - above_100;
        let hours = |count: u32| (f64::from(count) * step_hours) as f32;
        let half = |count: u32| 2 * u64::from(count) >= u64::from(day) && day > 0;
        AnnualMeasures {
            values: [
                percent(self.autonomous.into()),
                percent(self.share),
                percent(below),
                percent(above_100 - above_300),
                percent(above_300 - above_3000),
                percent(above_3000),
                (self.sum / f64::from(used.max(1))) as f32,
                if knows_sun { hours(self.sun) } else { f32::NAN },
                hours(self.daylight[0]),
                hours(self.daylight[1]),
                hours(self.daylight[2]),
                self.daylight_factor,
            ],
            half_of_day: self.daylight.map(half),
        }
    }
}

/// The measures of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnualMeasures {
    /// In the order of [`ANNUAL_MEASURES`]: daylight autonomy DA and its continuous form cDA (Reinhart, Mardaljevic and Rogers 2006, *Dynamic
    /// daylight performance metrics*, §3); useful daylight illuminance below 100, to 300, to 3,000 lx and above (Mardaljevic et al. 2012, *Daylighting
    /// metrics: is there a relation between useful daylight illuminance and daylight glare probability?*, §2); mean illuminance in the time
    /// of use; hours of direct sun above 1,000 lx in the time of use, NaN where unknown; hours of daylight at 100, 300 and 500 lx or above; and
    /// the daylight factor, illuminance over that of open ground under the CIE overcast sky (CIE 16-1970, *Daylight*).
    pub values: [f32; MEASURES],
    /// Whether 100, 300, 500 and 750 lx are reached in half of the hours with the sun up.
    pub half_of_day: [bool; 4],
}

/// The measures of a space: shares of its places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialMeasures {
    /// Places that were counted.
    pub places: u64,
    /// With 300 lx in half of the time of use or more (IES LM-83-12, sDA₃₀₀,₅₀).
    autonomous: u64,
    /// With direct sun above 1,000 lx in more than 250 hours (ASE₁₀₀₀,₂₅₀); none where unknown.
    sunny: Option<u64>,
    /// At each level of EN 17037 in half of the daylight hours.
    half_of_day: [u64; 4],
    /// Sum of the values of [`ANNUAL_MEASURES`].
    sums: [f64; MEASURES],
}

impl SpatialMeasures {
    /// The measures of several places.
    pub fn of<'a>(places: impl IntoIterator<Item = &'a AnnualMeasures>) -> Self {
        let mut all = Self { sunny: Some(0), ..Self::default() };
        for place in places {
            all.places += 1;
            let [da, .., sun, _, _, _, _] = place.values;
            all.autonomous += u64::from(da >= 50.0);
            all.sunny = all.sunny.filter(|_| !sun.is_nan()).map(|count| count + u64::from(sun > SUN_HOURS));
            for (count, reached) in all.half_of_day.iter_mut().zip(place.half_of_day) {
                *count += u64::from(reached);
            }
            for (sum, value) in all.sums.iter_mut().zip(place.values) {
                *sum += f64::from(value);
            }
        }
        all
    }

    fn percent(&self, count: u64) -> f64 {
        100.0 * count as f64 / self.places.max(1) as f64
    }

    /// Spatial daylight autonomy sDA₃₀₀,₅₀ in percent.
    pub fn spatial_autonomy(&self) -> f64 {
        self.percent(self.autonomous)
    }

    /// Annual sunlight exposure ASE₁₀₀₀,₂₅₀ in percent; none where the direct sun is not known.
    pub fn sunlight_exposure(&self) -> Option<f64> {
        self.sunny.map(|count| self.percent(count))
    }

    /// The mean of one of [`ANNUAL_MEASURES`].
    pub fn mean(&self, measure: usize) -> f64 {
        self.sums[measure] / self.places.max(1) as f64
    }

    /// Class of EN 17037: 0 where not even the minimum is reached, 1 minimum, 2 medium, 3 high.
    pub fn en_17037_class(&self) -> usize {
        let reached = |level: f32| {
            let at = EN_LEVELS.iter().position(|known| *known == level).unwrap_or(0);
            self.percent(self.half_of_day[at])
        };
        EN_17037.iter().take_while(|(target, minimum)| reached(*target) >= 50.0 && reached(*minimum) >= 95.0).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: of ten hours of use 2 are below 100 lx, 3 below 300, 4 below 3,000, and 1 is above.
    #[test]
    fn the_measures_are_those_counted_by_hand() {
        let lux = [0.0, 50.0, 100.0, 200.0, 250.0, 300.0, 600.0, 900.0, 2999.0, 3000.0];
        let thresholds = Thresholds::default();
        let mut sums = HourSums::default();
        sums.add(&lux, &thresholds, (true, true));
        sums.add(&[5000.0, 20.0], &thresholds, (false, true));
        sums.add_sun(&[1000.0, 1001.0], &thresholds);
        sums.set_daylight_factor(2.5);
        let AnnualMeasures { values, half_of_day } = sums.measures(10, 12, 1.0, true);
        let share = (0.0 + 50.0 + 100.0 + 200.0 + 250.0) / 300.0 + 5.0;
        let mean = lux.iter().sum::<f32>() / 10.0;
        let wanted = [50.0, 10.0 * share, 20.0, 30.0, 40.0, 10.0, mean, 1.0, 9.0, 6.0, 5.0, 2.5];
        for ((name, _), (found, wanted)) in ANNUAL_MEASURES.iter().zip(values.iter().zip(wanted)) {
            assert!((found - wanted).abs() < 1e-3, "{name}: {found} for {wanted}");
        }
        // Of eyes, 2,999 and 3,000 lx are perceptible; without limits of glare nothing is.
        assert_eq!(sums.eye_glare(10).percent, [0.0; 3]);
        let eyes = Thresholds { glare: Some(super::super::glare_limits_lux()), ..thresholds };
        sums.add(&lux, &eyes, (true, true));
        assert_eq!(sums.eye_glare(10).percent, [20.0, 0.0, 0.0]);
        // 750 lx: 900, 2,999, 3,000 and 5,000 of twelve hours.
        assert_eq!(half_of_day, [true, true, false, false]);
    }

    #[test]
    fn a_space_has_the_shares_and_the_class_of_its_places() {
        let place = |da: f32, sun: f32, half_of_day: [bool; 4]| {
            let mut values = [1.0; MEASURES];
            (values[0], values[7]) = (da, sun);
            AnnualMeasures { values, half_of_day }
        };
        let bright = place(80.0, 300.0, [true, true, true, false]);
        let dim = place(40.0, 250.0, [true, true, false, false]);
        let space = SpatialMeasures::of(&[bright, bright, dim]);
        assert!((space.spatial_autonomy() - 200.0 / 3.0).abs() < 1e-9);
        assert!((space.sunlight_exposure().unwrap() - 200.0 / 3.0).abs() < 1e-9);
        assert!((space.mean(0) - 200.0 / 3.0).abs() < 1e-5);
        // Two of three reach 500 lx, all of them 300.
        assert_eq!(space.en_17037_class(), 2);
        let dark = place(0.0, f32::NAN, [false; 4]);
        let with_dark = SpatialMeasures::of(&[bright, dark]);
        assert_eq!((with_dark.en_17037_class(), with_dark.sunlight_exposure()), (0, None));
    }
}
