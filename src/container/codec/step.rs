//! Quantisation steps: powers of 2^(1/8), so that they are a small integer on disk.

/// Indices run from `-STEP_LIMIT` to `STEP_LIMIT`: steps from 2⁻⁷⁵ to 2⁷⁵.
pub(super) const STEP_LIMIT: i32 = 600;
/// Bits of a stored index.
pub(super) const STEP_BITS: u32 = 11;

/// 2^(i/8).
const EIGHTHS: [f32; 8] =
    [1.0, 1.090_507_7, 1.189_207_1, 1.296_839_6, std::f32::consts::SQRT_2, 1.542_210_8, 1.681_792_9, 1.834_008];

/// The step of an index (clamped to the limits).
pub(super) fn step_of(index: i32) -> f32 {
    let index = index.clamp(-STEP_LIMIT, STEP_LIMIT);
    let exponent = index.div_euclid(8);
    EIGHTHS[index.rem_euclid(8) as usize] * f32::from_bits(((exponent + 127) as u32) << 23)
}

/// The index of the step nearest to `step`.
pub(super) fn index_of(step: f32) -> i32 {
    let index = (step.max(f32::MIN_POSITIVE).log2() * 8.0).round() as i32;
    index.clamp(-STEP_LIMIT, STEP_LIMIT)
}

/// Steps of the bands of an image: the zones of one that is transformed, else its values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps<'a> {
    /// Index of the step of a band that is no finer: the component's.
    pub(super) index: i32,
    /// How much finer each band is, in half octaves; empty: all alike.
    pub(super) band_steps: &'a [i8],
}

impl Steps<'_> {
    /// Whether all bands have the same step.
    pub(super) fn are_even(self) -> bool {
        self.band_steps.is_empty()
    }

    /// Whether the step of each band is that of the component over a power of √2: none is held at the ends of what there is.
    pub(super) fn are_in_range(self) -> bool {
        self.band_steps.iter().all(|&finer| (self.index - 4 * i32::from(finer)).abs() <= STEP_LIMIT)
    }

    /// The step of a band.
    #[inline(always)]
    pub(super) fn of(self, band: usize) -> f32 {
        step_of(self.index - 4 * self.band_steps.get(band).map_or(0, |&finer| i32::from(finer)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_index_is_the_index_of_its_step() {
        for index in -STEP_LIMIT..=STEP_LIMIT {
            assert_eq!(index_of(step_of(index)), index);
        }
        assert_eq!(step_of(-8), 0.5);
    }
}
