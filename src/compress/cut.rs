//! Rate–distortion optimisation with one slope for all blocks: which components and entries are kept, and their steps.
//!
//! With distortion `D` (squared radiance under the prior, times the block's weight) and rate in bits, every decision is
//! taken where `−dD/dR` reaches the common slope `λ`:
//!
//! - A component is kept if its gain is above `λ` times its bits.
//! - A uniform quantiser of step `Δ` has the error `Δ²/12` for each entry, and one more bit quarters it. So `−dD/dR = 2
//!   ln 2 · g Δ²/12 = λ` gives the step, where `g` is the weight of an entry's error. It is the component's gain for an
//!   entry of `L`, and the mean of diag `K` for an entry of `R`. Bands of `R` may be stored with finer steps (see
//!   [`FactoredBlock::right_band_steps`]). The estimate ignores that, so the result is slightly better than expected.
//! - A sparse entry is kept if its gain is above `λ` times its bits.

use super::candidate::{Candidate, CandidateSummary, percentile};
use super::{AUTOMATIC_DB, AUTOMATIC_MAX_DB, CompressSettings, Target};
use crate::encoding::{Decode, Encode};
use crate::matrix::FactoredBlock;

/// Bits of a sparse entry: about twelve for its position, the rest for its value.
const SPARSE_BITS: f64 = 14.0;
/// Bits of the codec's transform relative to the entropy of independent entries. Tuned: decision 30.
const CODING_GAIN: f64 = 0.45;
/// Bits of a component beside its entries: steps and lengths.
const COMPONENT_BITS: f64 = 96.0;
/// Quantiser error allowed in `L`, as a multiple of a component's noise variance. The second value holds where noise
/// dominates. Towards the first it falls with the square root of the noise's share of the component. It may exceed 1
/// because the codec's DCT keeps the signal of smooth components below the noise of single entries. Tuned: decision 43.
const LEFT_NOISE_SHARE: (f64, f64) = (0.3, 2.5);
/// A component whose noise is at least 1/30 of its energy uses the larger share.
const NOISE_OF_MOST: f64 = 30.0;
/// Quantiser error allowed in `R`, as a multiple of its noise variance. Tuned: decision 43.
const RIGHT_NOISE_SHARE: f64 = 0.5;
/// Any error that is asked for ends where further bytes would save less than this part of the energy of the samples'
/// noise. Tuned: decision 31.
const SAVED_OVER_NOISE: f64 = 0.002;
/// The same for what is lost at any slope beside noise, since the rank of the candidates does not reach it.
const SAVED_OVER_LOST: f64 = 0.15;
/// Least step relative to an entry's root mean square: the precision of 16-bit floats.
const FINEST_STEP: f64 = 1.0 / 2048.0;

/// Least slope considered, relative to the energy of all blocks.
const MIN_SLOPE: f64 = 1e-22;

/// The common choice for all blocks.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Cut {
    /// The slope λ: weighted squared radiance for each bit.
    pub slope: f64,
    /// White: the 95th percentile of the all-on image, or its root mean square if that is 0. It is the reference of
    /// block brightness and the peak of `expected_psnr_db`.
    pub white: f64,
    /// See [`CompressSettings::exposure_exponent`].
    pub exposure_exponent: f64,
    /// See [`CompressSettings::noise_factor`].
    pub noise_factor: Option<f64>,
    /// See [`CompressSettings::by_eye`].
    pub by_eye: bool,
    /// Expected error of images under the prior, relative to their norm.
    pub expected_relative_l2: f64,
    /// Expected PSNR in dB with the peak at white; see [`Target::PsnrDb`].
    pub expected_psnr_db: f64,
    /// Expected bytes: an estimate from entropies, without the overhead of a file.
    pub expected_bytes: u64,
    /// Whether the target is expected to be reached. Noise, or the rank of the candidates, may prevent it.
    pub reaches_target: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Spent {
    distortion: f64,
    /// Part of the distortion that an exposed image shows; for whole images only.
    shown: f64,
    bits: f64,
}

impl Cut {
    /// Weight of a block's squared error in rate–distortion decisions: 1 at the brightness of white, more if it is
    /// darker, and less if it is brighter, as in an image exposed for white.
    fn weight(&self, brightness: f32) -> f64 {
        let white = self.white.powi(2);
        if white <= 0.0 {
            return 1.0;
        }
        (white / (f64::from(brightness).powi(2) + 0.01 * white)).powf(self.exposure_exponent)
    }

    /// Share of a block's squared error that is visible in an image exposed for white, since brighter values are
    /// clipped.
    fn shown(&self, brightness: f32) -> f64 {
        if self.white <= 0.0 { 1.0 } else { (self.white / f64::from(brightness).max(self.white)).powi(2) }
    }

    fn slope_of(&self, s: &CandidateSummary) -> f64 {
        self.slope / self.weight(s.brightness)
    }

    /// Squared step times weight that the slope allows for an entry of either factor.
    fn allowed(&self, s: &CandidateSummary) -> f64 {
        6.0 * self.slope_of(s) / std::f64::consts::LN_2
    }

    /// Steps of `L` and `R` of component `k`.
    fn steps(&self, s: &CandidateSummary, k: usize) -> (f64, f64) {
        let (gain, rms) = (f64::from(s.gains[k]), f64::from(s.right_mean_square[k]).sqrt());
        let allowed = self.allowed(s);
        let heeded = if self.noise_factor.is_some() { 12.0 } else { 0.0 };
        // Noise of an entry of R: the component's projected noise, spread over the columns.
        let fallen = heeded * RIGHT_NOISE_SHARE * f64::from(s.noise[k]) / f64::from(s.columns);
        // Noise of an entry of L: what its component was fitted to, spread over the rows.
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
        // Steps below the noise cost nothing of the component's gain.
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
                // Dropped noise is no error against the truth, but it is one against the matrix.
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

/// Estimated bits of a component in a file. For each factor: number of entries, their variance, and their step.
pub fn component_bits(left: (f64, f64, f64), right: (f64, f64, f64)) -> f64 {
    let independent = |(count, variance, step): (f64, f64, f64)| count * entropy(variance, step);
    CODING_GAIN * (independent(left) + independent(right)) + COMPONENT_BITS
}

/// Bits of an entry of variance `v` under a uniform quantiser, from the differential entropy of a normal: at high rate
/// `½ log₂(2πe v / Δ²)`.
fn entropy(v: f64, step: f64) -> f64 {
    0.5 * (1.0 + 17.08 * v / (step * step)).log2()
}

/// The 95th percentile of the all-on image, to which images are exposed whatever lamps are in view.
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

/// Statistics of all blocks together.
struct Whole<I> {
    summaries: I,
    rows: f64,
    energy: f64,
    /// Squared white of a typical lighting: that of all-on times a known factor, or else times the ratio of their
    /// visible energies.
    white_square: f64,
    /// Energy of the noise that is visible in an exposed image.
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

    /// Rate and distortion of a cut.
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

    /// Visible distortion of images with this PSNR.
    fn shown_at(&self, db: f64) -> f64 {
        self.rows * self.white_square * 10f64.powf(-db / 10.0)
    }

    /// Exponents of two between which the slope of every target lies.
    fn exponents(&self) -> (f64, f64) {
        ((self.energy * MIN_SLOPE).log2(), self.energy.log2())
    }
}

/// Chooses the slope by bisection so that the target is just met. `white_square` is the squared white of a typical
/// lighting over that of all-on, if known.
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
        by_eye: settings.by_eye,
        expected_relative_l2: 0.0,
        expected_psnr_db: f64::INFINITY,
        expected_bytes: 0,
        reaches_target: true,
    };
    let whole = Whole::new(summaries.clone(), &cut, white_square);
    // Error below which bytes buy next to nothing: what no slope removes, and a small part of that.
    cut.slope = whole.energy * MIN_SLOPE;
    let least = whole.spent(&cut);
    let worthless =
        |least: f64| least + SAVED_OVER_LOST * (least - whole.noise).max(0.0) + SAVED_OVER_NOISE * whole.noise;
    let fits = |spent: Spent| match target {
        Target::PsnrDb(db) => spent.shown <= whole.shown_at(db).max(worthless(least.shown)),
        Target::RelativeL2(error) => {
            spent.distortion <= (error * error * whole.energy).max(worthless(least.distortion))
        }
        Target::Bytes(bytes) => spent.bits / 8.0 > bytes as f64,
        Target::Slope(_) | Target::Automatic => true,
    };
    match target {
        Target::Slope(slope) => cut.slope = slope,
        _ if whole.energy <= 0.0 => {}
        _ => {
            // The largest slope that meets the target (for bytes: the smallest that fits).
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
        Target::RelativeL2(error) => spent.distortion <= error * error * whole.energy,
        // Bytes are a limit, and a slope is given.
        Target::Bytes(_) | Target::Slope(_) | Target::Automatic => true,
    };
    cut
}

impl Candidate {
    /// Applies the cut: components and entries that are worth their bits, and the steps to store them with.
    pub fn cut(&self, cut: &Cut) -> FactoredBlock {
        let s = &self.summary;
        let (m, n) = (s.rows as usize, s.columns as usize);
        let kept: Vec<usize> = (0..self.rank()).filter(|&k| cut.keeps(s, k).is_some()).collect();
        let mut block = FactoredBlock { rows: m, columns: n, by_eye: cut.by_eye, ..Default::default() };
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
                // Entries that are not stored by themselves return to the range, as far as it contains them.
                for k in 0..kept.len() {
                    block.right[k * n + entry.column.index()] += block.left[k * m + entry.row as usize] * entry.value;
                }
            }
        }
        block
    }
}
