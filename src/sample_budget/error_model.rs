//! How the error of images and the seconds of a render follow from the samples, fitted to what a pilot measured.

use std::ops::RangeInclusive;

use crate::error_estimate::worst;
use crate::light::PROBES;

/// Samples per pixel of the pilot's two runs.
pub(super) const FEW_SAMPLES: u32 = 8;
pub(super) const MORE_SAMPLES: u32 = 32;
/// Slowest fall of the squared error that is believed, as a power of the samples.
const MIN_POWER: f64 = 0.25;

/// The law by which an error falls with the samples: its square is a power of them, and no lower than the noise of the
/// samples allows.
#[derive(Clone, Copy, Debug)]
pub(super) struct ErrorModel {
    /// Squared error of the worst lighting at `samples`.
    square: f64,
    samples: f64,
    power: f64,
    /// Squared noise of the worst lighting for one sample per pixel.
    noise: f64,
}

/// Cost of a render in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seconds {
    /// For the BVH and for denoising.
    pub(super) fixed: f64,
    pub(super) per_photon: f64,
    pub(super) per_sample: f64,
}

impl ErrorModel {
    /// The law of images that are not denoised.
    pub(super) fn of_noise(noise: f64, samples: u32) -> Self {
        let samples = f64::from(samples);
        Self { square: noise, samples, power: 1.0, noise: noise * samples }
    }

    /// The law from squared errors of the probe lightings at few and at more samples. `noise` is the squared noise at
    /// more samples. A fall faster than that of noise is not believed. One power holds for all lightings.
    pub(super) fn fitted(few: &[f64; PROBES], more: &[f64; PROBES], noise: f64) -> Self {
        let (of_few, of_more) = (f64::from(FEW_SAMPLES), f64::from(MORE_SAMPLES));
        let least = of_few / of_more;
        let believed: [f64; PROBES] = std::array::from_fn(|probe| more[probe].max(few[probe] * least));
        let sum = |squares: &[f64; PROBES]| squares.iter().filter(|square| square.is_finite()).sum::<f64>();
        let power = (sum(few) / sum(&believed)).ln() / (of_more / of_few).ln();
        let power = if power.is_finite() { power.clamp(MIN_POWER, 1.0) } else { 1.0 };
        Self { square: worst(&believed), samples: of_more, power, noise: noise * of_more }
    }

    /// Below the fewest samples measured, the error falls as that of noise, since filters fail with too little to
    /// compare.
    pub(super) fn error(&self, samples: f64) -> f64 {
        let least = f64::from(FEW_SAMPLES).min(self.samples);
        let few = self.square * (self.samples / samples.max(least)).powf(self.power);
        let denoised = few * (least / samples).max(1.0);
        denoised.min(self.noise / samples).max(0.0).sqrt()
    }

    /// Number of sample pairs that reduces the error to this, within bounds.
    pub(super) fn pairs(&self, error: f64, between: RangeInclusive<u32>) -> u32 {
        first(*between.end(), |pairs| pairs >= *between.start() && self.error(2.0 * f64::from(pairs)) <= error)
    }
}

/// The least number from 1 on above which `holds` is always true, or `most`.
pub(super) fn first(most: u32, holds: impl Fn(u32) -> bool) -> u32 {
    let (mut low, mut high) = (1, most.max(1));
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    high
}

impl Seconds {
    pub(super) fn of(&self, samples: u32, photons: u64) -> f64 {
        self.fixed + self.per_photon * photons as f64 + self.per_sample * f64::from(samples)
    }
}
