//! One slope for all blocks: which components and entries are kept, and how finely they are stored.
//!
//! With distortion `D` (squared radiance under the prior, times the block's weight) and rate in bits, every decision is
//! taken where `−dD/dR` passes the same slope `λ`:
//!
//! - a component is kept if its gain is above `λ` times its bits;
//! - a uniform quantiser of step `Δ` makes an error of `Δ²/12` an entry and one bit more quarters it, so
//!   `−dD/dR = 2 ln 2 · g Δ²/12 = λ` gives its step, `g` being how much an entry's error weighs: the component's gain for
//!   an entry of `L` (its row of `R` is what the error is multiplied by), the mean of diag `K` for an entry of `R`;
//! - a sparse entry is kept if what it saves is above `λ` times its bits.

use super::candidate::{Candidate, CandidateSummary};
use super::{CompressSettings, Target};
use crate::matrix::FactoredBlock;

/// Bits that a sparse entry costs: its place (a dozen) and its value.
const SPARSE_BITS: f64 = 24.0;
/// Bits that a component costs beside its entries: steps, lengths.
const COMPONENT_BITS: f64 = 96.0;
/// Error variance of a quantiser over the noise of what it quantises, for entries of `L` and of `R`. The codec transforms
/// `L` as a little image: where a step is a few times the noise, most of the noise falls below it and the image stays.
/// Measured at 16 samples per pixel on four built-in scenes (96 × 64 pixels, 256 columns) against 2,048 samples: 2.5
/// brings diffuse 8.0 and caustics 5.1 dB nearer to the truth than the raw matrix, 0.1 brings 4.6 and 3.3.
const LEFT_NOISE_SHARE: f64 = 2.5;
const RIGHT_NOISE_SHARE: f64 = 0.1;
/// Steps of at least this fraction of an entry's root mean square: what 16-bit floats would keep.
const FINEST_STEP: f64 = 1.0 / 2048.0;

/// The choice that holds for all blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// The slope: squared radiance, weighted, per bit.
    pub slope: f64,
    /// Root mean square of the all-on image: what block brightness is compared with.
    pub brightness: f64,
    /// See [`CompressSettings::exposure_exponent`].
    pub exposure_exponent: f64,
    /// See [`CompressSettings::noise_factor`].
    pub noise_factor: f64,
    /// Error that is expected: of images under the prior, over their norm.
    pub expected_relative_l2: f64,
    /// PSNR that is expected in dB, peak = the largest value of the all-on image.
    pub expected_psnr_db: f64,
    /// Bytes that are expected: an estimate from entropy, without the files' own overhead.
    pub expected_bytes: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Spent {
    distortion: f64,
    bits: f64,
}

impl Cut {
    /// Weight of a block's squared error: 1 at mean brightness, more where it is darker.
    fn weight(&self, brightness: f32) -> f64 {
        let reference = self.brightness.powi(2);
        if reference <= 0.0 {
            return 1.0;
        }
        (reference / (f64::from(brightness).powi(2) + 0.01 * reference)).powf(self.exposure_exponent)
    }

    fn slope_of(&self, s: &CandidateSummary) -> f64 {
        self.slope / self.weight(s.brightness)
    }

    /// Squared steps times weight that the slope allows for an entry of either factor.
    fn allowed(&self, s: &CandidateSummary) -> f64 {
        6.0 * self.slope_of(s) / std::f64::consts::LN_2
    }

    /// Steps of component `k` for `L` and `R`.
    fn steps(&self, s: &CandidateSummary, k: usize) -> (f64, f64) {
        let (gain, rms) = (f64::from(s.gains[k]), f64::from(s.right_mean_square[k]).sqrt());
        let allowed = self.allowed(s);
        let heeded = if self.noise_factor > 0.0 { 12.0 } else { 0.0 };
        // The noise of an entry of R is what falls on the component, spread over the columns.
        let fallen = heeded * RIGHT_NOISE_SHARE * f64::from(s.noise[k]) / f64::from(s.columns);
        // That of an entry of L, what its component was fitted to, spread over the rows.
        let fitted = heeded * LEFT_NOISE_SHARE * f64::from(s.fitted_noise[k]) / f64::from(s.rows);
        let left = (allowed.max(fitted) / gain.max(1e-300)).sqrt();
        let right = allowed.max(fallen).sqrt();
        (left.max(FINEST_STEP / f64::from(s.rows).sqrt()), right.max(FINEST_STEP * rms))
    }

    fn keeps(&self, s: &CandidateSummary, k: usize) -> Option<Spent> {
        let gain = f64::from(s.gains[k]);
        let (left, right) = self.steps(s, k);
        let (m, n) = (f64::from(s.rows), f64::from(s.columns));
        let bits = m * entropy(1.0 / m, left) + n * entropy(f64::from(s.right_mean_square[k]), right) + COMPONENT_BITS;
        let noise = f64::from(s.fitted_noise[k] + s.noise[k]);
        let noisy = self.noise_factor > 0.0 && k > 0 && gain < self.noise_factor * noise;
        // Steps that only pass over noise cost nothing of what the component is kept for.
        let lost = (m + n) * self.allowed(s) / 12.0;
        let worth = !noisy && gain - lost > self.slope_of(s) * bits;
        let distortion = (m * gain * left * left + n * right * right) / 12.0;
        (s.fixed || worth).then_some(Spent { distortion, bits })
    }

    fn keeps_entry(&self, s: &CandidateSummary, gain: f64) -> bool {
        s.fixed || gain > self.slope_of(s) * SPARSE_BITS
    }

    fn spent_on(&self, s: &CandidateSummary) -> Spent {
        let mut spent = Spent { distortion: f64::from(s.tail), bits: 64.0 };
        for (k, &gain) in s.gains.iter().enumerate() {
            match self.keeps(s, k) {
                Some(part) => {
                    spent.bits += part.bits;
                    spent.distortion += part.distortion;
                }
                // What is left out because it is noise is no error against the truth, but it is against the matrix.
                None => spent.distortion += f64::from(gain),
            }
        }
        for (bin, (sum, count)) in s.sparse_gains.iter().enumerate() {
            if self.keeps_entry(s, CandidateSummary::bin_floor(bin)) {
                spent.bits += SPARSE_BITS * f64::from(*count);
            } else {
                spent.distortion += f64::from(*sum);
            }
        }
        spent
    }
}

/// Bits of an entry of variance `v` under a uniform quantiser, from the differential entropy of a normal: at high rate
/// `½ log₂(2πe v / Δ²)`.
fn entropy(v: f64, step: f64) -> f64 {
    0.5 * (1.0 + 17.08 * v / (step * step)).log2()
}

/// Chooses the slope by bisection so that the target is just met.
pub(super) fn choose<'a>(
    settings: &CompressSettings,
    summaries: impl Iterator<Item = &'a CandidateSummary> + Clone,
) -> Cut {
    let rows: f64 = summaries.clone().map(|s| f64::from(s.rows)).sum::<f64>().max(1.0);
    let squares: f64 = summaries.clone().map(|s| f64::from(s.rows) * f64::from(s.brightness).powi(2)).sum();
    let energy: f64 = summaries.clone().map(CandidateSummary::energy).sum();
    let peak = summaries.clone().map(|s| f64::from(s.peak)).fold(0.0, f64::max);
    // Peak of a typical lighting: that of all-on, scaled by the ratio of their energies.
    let peak_square = if squares > 0.0 { peak * peak * energy / squares } else { 0.0 };
    let mut cut = Cut {
        slope: 0.0,
        brightness: (squares / rows).sqrt(),
        exposure_exponent: settings.exposure_exponent,
        noise_factor: settings.noise_factor,
        expected_relative_l2: 0.0,
        expected_psnr_db: f64::INFINITY,
        expected_bytes: 0,
    };
    let total = |cut: &Cut| {
        summaries
            .clone()
            .map(|s| cut.spent_on(s))
            .fold(Spent::default(), |a, b| Spent { distortion: a.distortion + b.distortion, bits: a.bits + b.bits })
    };
    let fits = |spent: Spent| match settings.target {
        Target::PsnrDb(db) => spent.distortion / rows <= peak_square * 10f64.powf(-db / 10.0),
        Target::RelativeL2(error) => spent.distortion <= error * error * energy,
        Target::Bytes(bytes) => spent.bits / 8.0 > bytes as f64,
        Target::Slope(_) => true,
    };
    match settings.target {
        Target::Slope(slope) => cut.slope = slope,
        _ if energy <= 0.0 => {}
        _ => {
            // The largest slope at which the target still holds (for bytes: the smallest that fits).
            let (mut low, mut high) = ((energy * 1e-22).log2(), energy.log2());
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                cut.slope = middle.exp2();
                if fits(total(&cut)) { low = middle } else { high = middle }
            }
            cut.slope = if matches!(settings.target, Target::Bytes(_)) { high } else { low }.exp2();
        }
    }
    let spent = total(&cut);
    if energy > 0.0 {
        cut.expected_relative_l2 = (spent.distortion / energy).sqrt();
        cut.expected_psnr_db = 10.0 * (peak_square * rows / spent.distortion).log10();
    }
    cut.expected_bytes = (spent.bits / 8.0).ceil() as u64;
    cut
}

impl Candidate {
    /// The block as the cut wants it: components and entries that are worth their bits, and the steps to store them with.
    pub fn cut(&self, cut: &Cut) -> FactoredBlock {
        let s = &self.summary;
        let (m, n) = (s.rows as usize, s.columns as usize);
        let kept: Vec<usize> = (0..self.rank()).filter(|&k| cut.keeps(s, k).is_some()).collect();
        let mut block = FactoredBlock { rows: m, columns: n, ..Default::default() };
        for &k in &kept {
            block.left.extend(&self.left[k * m..][..m]);
            block.right.extend(&self.right[k * n..][..n]);
            if !s.fixed {
                let (left, right) = cut.steps(s, k);
                block.left_step.push(left as f32);
                block.right_step.push(right as f32);
            }
        }
        for (entry, &gain) in self.sparse.iter().zip(&self.sparse_gain) {
            if cut.keeps_entry(s, CandidateSummary::bin_floor(CandidateSummary::sparse_bin(gain))) {
                block.sparse.push(*entry);
            } else {
                // What is not stored on its own goes back to the range, as far as the range holds it.
                for k in 0..kept.len() {
                    block.right[k * n + entry.column.index()] += block.left[k * m + entry.row as usize] * entry.value;
                }
            }
        }
        block
    }
}
