//! Glare by daylight at eyes.

/// Values of the daylight glare probability at which the next of [`GLARE_CLASSES`] begins (Wienold 2009, *Dynamic daylight glare evaluation*,
/// Building Simulation 2009). High, medium and minimum protection by EN 17037:2018 (annex A) have at most a twentieth of the time of use above them.
pub const GLARE_LIMITS: [f32; 3] = [0.35, 0.40, 0.45];

/// How glare is felt below, between and above [`GLARE_LIMITS`].
pub const GLARE_CLASSES: [&str; 4] = ["imperceptible", "perceptible", "disturbing", "intolerable"];

/// The simplified daylight glare probability at a vertical illuminance of the eye in lux: `DGPs = 6.22·10⁻⁵ E_v + 0.184` (Wienold 2009). It holds where neither the sun itself nor a sharp reflection of it is in view.
pub fn simplified_glare_probability(eye_lux: f64) -> f64 {
    SLOPE * eye_lux + OFFSET
}

const SLOPE: f64 = 6.22e-5;
const OFFSET: f64 = 0.184;

/// The vertical illuminances of [`GLARE_LIMITS`], in lux.
pub fn glare_limits_lux() -> [f32; 3] {
    GLARE_LIMITS.map(|limit| ((f64::from(limit) - OFFSET) / SLOPE) as f32)
}

/// Glare at an eye over the time of use, by the simplified daylight glare probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeGlare {
    /// Percent of the time of use at each of [`GLARE_LIMITS`] or above.
    pub percent: [f32; 3],
}

impl EyeGlare {
    /// Of numbers of steps at each of [`GLARE_LIMITS`] or above, of `used`.
    pub fn of_steps(steps: [u32; 3], used: u32) -> Self {
        Self { percent: steps.map(|count| 100.0 * count as f32 / used.max(1) as f32) }
    }

    /// Percent of the time of use in each of [`GLARE_CLASSES`].
    pub fn classes(&self) -> [f32; 4] {
        let [perceptible, disturbing, intolerable] = self.percent;
        [100.0 - perceptible, perceptible - disturbing, disturbing - intolerable, intolerable]
    }

    /// Protection from glare by EN 17037:2018: 0 where not even the minimum is reached, 1 minimum, 2 medium, 3 high.
    pub fn protection(&self) -> usize {
        self.percent.iter().filter(|percent| **percent <= 5.0).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the equation: 2,669, 3,473 and 4,277 lx are the limits.
    #[test]
    fn the_limits_are_those_of_the_equation() {
        for (found, wanted) in glare_limits_lux().into_iter().zip([2668.8, 3472.7, 4276.5]) {
            assert!((found - wanted).abs() < 0.1, "{found} for {wanted}");
        }
        assert!((simplified_glare_probability(1000.0) - 0.2462).abs() < 1e-12);
    }

    #[test]
    fn an_eye_has_the_shares_and_the_protection_of_its_hours() {
        let glare = EyeGlare::of_steps([40, 20, 10], 400);
        assert_eq!((glare.percent, glare.classes()), ([10.0, 5.0, 2.5], [90.0, 5.0, 2.5, 2.5]));
        assert_eq!(glare.protection(), 2);
        assert_eq!(EyeGlare::of_steps([0, 0, 0], 400).protection(), 3);
        assert_eq!(EyeGlare::of_steps([400, 400, 21], 400).protection(), 0);
        assert_eq!(EyeGlare::of_steps([400, 400, 20], 400).protection(), 1);
    }
}
