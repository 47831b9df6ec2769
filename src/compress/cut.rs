//! One slope for all blocks: which components and entries are kept, and how finely they are stored.
//!
//! With distortion `D` (squared radiance under the prior, times the block's weight) and rate in bits, every decision is
//! taken where `−dD/dR` passes the same slope `λ`:
//!
//! - a component is kept if its gain is above `λ` times its bits;
//! - a uniform quantiser of step `Δ` makes an error of `Δ²/12` an entry and one bit more quarters it, so
//!   `−dD/dR = 2 ln 2 · g Δ²/12 = λ` gives its step, `g` being how much an entry's error weighs: the component's gain for
//!   an entry of `L` (its row of `R` is what the error is multiplied by), the mean of diag `K` for an entry of `R` (whoever stores
//!   it may store finer what weighs more, see [`FactoredBlock::right_band_steps`], which is not counted on here: what comes is a little
//!   nearer than what is expected);
//! - a sparse entry is kept if what it saves is above `λ` times its bits.

use super::candidate::{Candidate, CandidateSummary, percentile};
use super::{AUTOMATIC_DB, AUTOMATIC_MAX_DB, CompressSettings, Target};
use crate::matrix::FactoredBlock;

/// Bits that a sparse entry costs: its place (a dozen) and its value.
const SPARSE_BITS: f64 = 14.0;
/// Bits that the codec's transforms take over the bits of independent entries. Measured on five built-in scenes of 192 ×
/// 128 pixels at ratios of 250 to 1,500: between 0.28 and 0.6.
const CODING_GAIN: f64 = 0.45;
/// Bits that a component costs beside its entries: steps, lengths.
const COMPONENT_BITS: f64 = 96.0;
/// Quantiser error allowed in `L`, as a multiple of a component's noise variance: the second where noise dominates, falling
/// with the square root of the noise's part in the component towards the first. It may be above 1 because the DCT of the codec
/// keeps the signal of smooth components below the noise of single entries. Tuned on five built-in scenes.
const LEFT_NOISE_SHARE: (f64, f64) = (0.3, 2.5);
/// A component whose noise is at least 1/30 of its energy uses the larger share.
const NOISE_OF_MOST: f64 = 30.0;
/// Quantiser error allowed in `R`, as a multiple of its noise variance.
const RIGHT_NOISE_SHARE: f64 = 0.5;
/// [`Target::Automatic`], and a PSNR that noise or rank keep from being reached, stop where what further bytes would save
/// is this part of the energy of the samples' noise. Five built-in scenes at 4 to 256 samples: 0.01 takes a third of the
/// bytes again for 0.1 dB, and 2 to 8 % in ꟻLIP.
const SAVED_OVER_NOISE: f64 = 0.002;
/// Steps of at least this fraction of an entry's root mean square: what 16-bit floats would keep.
const FINEST_STEP: f64 = 1.0 / 2048.0;

/// Smallest slope that is looked at, over the energy of all blocks.
const MIN_SLOPE: f64 = 1e-22;

/// The choice that holds for all blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// The slope: squared radiance, weighted, per bit.
    pub slope: f64,
    /// White: the 95th percentile of the values of the all-on image, or their root mean square where that is 0. What block
    /// brightness is compared with, and the peak of `expected_psnr_db`.
    pub white: f64,
    /// See [`CompressSettings::exposure_exponent`].
    pub exposure_exponent: f64,
    /// See [`CompressSettings::noise_factor`].
    pub noise_factor: Option<f64>,
    /// Error that is expected: of images under the prior, over their norm.
    pub expected_relative_l2: f64,
    /// PSNR that is expected in dB, peak = white; see [`Target::PsnrDb`].
    pub expected_psnr_db: f64,
    /// Bytes that are expected: an estimate from entropy, without the files' own overhead.
    pub expected_bytes: u64,
    /// Whether what is expected is what was asked for: noise that is heeded, or the rank of the candidates, may stop it.
    pub reaches_target: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Spent {
    distortion: f64,
    /// Of the distortion, what an exposed image shows; of whole images only.
    shown: f64,
    bits: f64,
}

impl Cut {
    /// Weight of a block's squared error in the choice of what to keep: 1 where it is as bright as white, more where it
    /// is darker, and less where it is brighter, as an image exposed for white shows it.
    fn weight(&self, brightness: f32) -> f64 {
        let white = self.white.powi(2);
        if white <= 0.0 {
            return 1.0;
        }
        (white / (f64::from(brightness).powi(2) + 0.01 * white)).powf(self.exposure_exponent)
    }

    /// Share of a block's squared error that an image exposed for white shows: what is brighter is clipped.
    fn shown(&self, brightness: f32) -> f64 {
        if self.white <= 0.0 { 1.0 } else { (self.white / f64::from(brightness).max(self.white)).powi(2) }
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
        let heeded = if self.noise_factor.is_some() { 12.0 } else { 0.0 };
        // The noise of an entry of R is what falls on the component, spread over the columns.
        let fallen = heeded * RIGHT_NOISE_SHARE * f64::from(s.noise[k]) / f64::from(s.columns);
        // That of an entry of L, what its component was fitted to, spread over the rows.
        let noise_share = f64::from(s.fitted_noise[k]) / gain.max(1e-300);
        let (least, most) = LEFT_NOISE_SHARE;
        let share = (most * (NOISE_OF_MOST * noise_share).sqrt()).clamp(least, most);
        let fitted = heeded * share * f64::from(s.noise_quartile_ratio * s.fitted_noise[k]) / f64::from(s.rows);
        let left = (allowed.max(fitted) / gain.max(1e-300)).sqrt();
        let right = allowed.max(fallen).sqrt();
        (left.max(FINEST_STEP / f64::from(s.rows).sqrt()), right.max(FINEST_STEP * rms))
    }

    fn keeps(&self, s: &CandidateSummary, k: usize) -> Option<Spent> {
        let gain = f64::from(s.gains[k]);
        let (left, right) = self.steps(s, k);
        let (m, n) = (f64::from(s.rows), f64::from(s.columns));
        let bits = component_bits((m, 1.0 / m, left), (n, f64::from(s.right_mean_square[k]), right));
        let noise = f64::from(s.fitted_noise[k] + s.noise[k]);
        let noisy = k > 0 && self.noise_factor.is_some_and(|factor| gain < factor * noise);
        // Steps that only pass over noise cost nothing of what the component is kept for.
        let lost = (m + n) * self.allowed(s) / 12.0;
        let worth = !noisy && gain - lost > self.slope_of(s) * bits;
        let distortion = (m * gain * left * left + n * right * right) / 12.0;
        (s.fixed || worth).then_some(Spent { distortion, bits, ..Default::default() })
    }

    fn keeps_entry(&self, s: &CandidateSummary, gain: f64) -> bool {
        s.fixed || gain > self.slope_of(s) * SPARSE_BITS
    }

    fn spent_on(&self, s: &CandidateSummary) -> Spent {
        let mut spent = Spent { distortion: f64::from(s.tail), bits: 64.0, ..Default::default() };
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

/// Estimated bits of a component in a file: of each of its two sides the number of entries, their variance, and
/// their step.
pub fn component_bits(left: (f64, f64, f64), right: (f64, f64, f64)) -> f64 {
    let independent = |(count, variance, step): (f64, f64, f64)| count * entropy(variance, step);
    CODING_GAIN * (independent(left) + independent(right)) + COMPONENT_BITS
}

/// Bits of an entry of variance `v` under a uniform quantiser, from the differential entropy of a normal: at high rate
/// `½ log₂(2πe v / Δ²)`.
fn entropy(v: f64, step: f64) -> f64 {
    0.5 * (1.0 + 17.08 * v / (step * step)).log2()
}

/// The 95th percentile of the values of the all-on image: what an image is exposed for, whatever lamps are in view.
fn white_of<'a>(summaries: impl Iterator<Item = &'a CandidateSummary> + Clone) -> f64 {
    let mut counts: Vec<u64> = Vec::new();
    let (mut rows, mut squares) = (0.0, 0.0);
    for s in summaries {
        counts.resize(counts.len().max(s.histogram.len()), 0);
        counts.iter_mut().zip(&s.histogram).for_each(|(sum, &count)| *sum += u64::from(count));
        rows += f64::from(s.rows);
        squares += f64::from(s.rows) * f64::from(s.brightness).powi(2);
    }
    let white = percentile(&counts, 0.95);
    if white > 0.0 || rows == 0.0 { white } else { (squares / rows).sqrt() }
}

/// What all blocks are together.
struct Whole<I> {
    summaries: I,
    rows: f64,
    energy: f64,
    /// Squared white of a typical lighting: that of all-on, scaled as is known or else by the ratio of what they show of the image.
    white_square: f64,
    /// Energy of the noise, as far as an exposed image shows it.
    noise: f64,
}

impl<'a, I: Iterator<Item = &'a CandidateSummary> + Clone> Whole<I> {
    fn new(summaries: I, cut: &Cut, white_square: Option<f64>) -> Self {
        let square = |s: &CandidateSummary| f64::from(s.rows) * f64::from(s.brightness).powi(2);
        let sum = |part: &dyn Fn(&CandidateSummary) -> f64| -> f64 {
            summaries.clone().map(|s| cut.shown(s.brightness) * part(s)).sum()
        };
        let squares = sum(&square);
        let by_energy = || sum(&CandidateSummary::energy) / squares;
        let ratio = if squares > 0.0 { white_square.unwrap_or_else(by_energy) } else { 0.0 };
        let white_square = cut.white.powi(2) * ratio;
        Self {
            rows: summaries.clone().map(|s| f64::from(s.rows)).sum::<f64>().max(1.0),
            energy: summaries.clone().map(CandidateSummary::energy).sum(),
            white_square,
            noise: sum(&|s| f64::from(s.noise_energy)),
            summaries,
        }
    }

    /// What a cut spends and loses.
    fn spent(&self, cut: &Cut) -> Spent {
        self.summaries.clone().fold(Spent::default(), |sum, s| {
            let spent = cut.spent_on(s);
            Spent {
                distortion: sum.distortion + spent.distortion,
                shown: sum.shown + cut.shown(s.brightness) * spent.distortion,
                bits: sum.bits + spent.bits,
            }
        })
    }

    /// Distortion, as far as it is shown, of images of this PSNR.
    fn shown_at(&self, db: f64) -> f64 {
        self.rows * self.white_square * 10f64.powf(-db / 10.0)
    }

    /// Slopes between which every target lies, as powers of two.
    fn exponents(&self) -> (f64, f64) {
        ((self.energy * MIN_SLOPE).log2(), self.energy.log2())
    }
}

/// Chooses the slope by bisection so that the target is just met. `white_square` is that of a typical lighting over that of all on,
/// where it is known.
pub(super) fn choose<'a>(
    settings: &CompressSettings,
    white_square: Option<f64>,
    summaries: impl Iterator<Item = &'a CandidateSummary> + Clone,
) -> Cut {
    let target = match settings.target {
        Target::Automatic
            if settings.noise_factor.is_some() && summaries.clone().any(CandidateSummary::knows_noise) =>
        {
            Target::PsnrDb(AUTOMATIC_MAX_DB)
        }
        Target::Automatic => Target::PsnrDb(AUTOMATIC_DB),
        target => target,
    };
    let mut cut = Cut {
        slope: 0.0,
        white: white_of(summaries.clone()),
        exposure_exponent: settings.exposure_exponent,
        noise_factor: settings.noise_factor,
        expected_relative_l2: 0.0,
        expected_psnr_db: f64::INFINITY,
        expected_bytes: 0,
        reaches_target: true,
    };
    let whole = Whole::new(summaries.clone(), &cut, white_square);
    // Error that no slope takes away, and what more of it the noise makes worthless to take away.
    let mut worthless = 0.0;
    if let Target::PsnrDb(db) = target {
        cut.slope = whole.energy * MIN_SLOPE;
        let least = whole.spent(&cut).shown;
        if settings.target == Target::Automatic || least > whole.shown_at(db) {
            worthless = least + SAVED_OVER_NOISE * whole.noise;
        }
    }
    let fits = |spent: Spent| match target {
        Target::PsnrDb(db) => spent.shown <= whole.shown_at(db).max(worthless),
        Target::RelativeL2(error) => spent.distortion <= error * error * whole.energy,
        Target::Bytes(bytes) => spent.bits / 8.0 > bytes as f64,
        Target::Slope(_) | Target::Automatic => true,
    };
    match target {
        Target::Slope(slope) => cut.slope = slope,
        _ if whole.energy <= 0.0 => {}
        _ => {
            // The largest slope at which the target still holds (for bytes: the smallest that fits).
            let (mut low, mut high) = whole.exponents();
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                cut.slope = middle.exp2();
                if fits(whole.spent(&cut)) { low = middle } else { high = middle }
            }
            cut.slope = if matches!(target, Target::Bytes(_)) { high } else { low }.exp2();
        }
    }
    let spent = whole.spent(&cut);
    if whole.energy > 0.0 {
        cut.expected_relative_l2 = (spent.distortion / whole.energy).sqrt();
        cut.expected_psnr_db = 10.0 * (whole.white_square * whole.rows / spent.shown).log10();
    }
    cut.expected_bytes = (spent.bits / 8.0).ceil() as u64;
    cut.reaches_target = match target {
        _ if whole.energy <= 0.0 || summaries.clone().all(|s| s.fixed) => true,
        Target::PsnrDb(db) => spent.shown <= whole.shown_at(db),
        Target::RelativeL2(_) => fits(spent),
        // Bytes are a limit, and a slope is what it is.
        Target::Bytes(_) | Target::Slope(_) | Target::Automatic => true,
    };
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
