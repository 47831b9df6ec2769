//! Probe lightings: a few fixed lightings under which the noise of a traced block is kept.

use super::{LightBasis, LightingPrior};

/// Number of probe lightings.
pub const PROBES: usize = 16;

/// Seed of the draws: fixed, because files hold noise under these very lightings.
const SEED: u64 = 0x6c74_6d70_726f_6265;

/// The probe lightings `Ω`: columns × probes, column-major, the same for the same basis.
///
/// Probe 0 is all-on. The others are draws of the basis's [`LightingPrior`]. For a direction `u` of the block's range,
/// their mean of `(uᵀ D ω)²` estimates `uᵀ D K Dᵀ u`: the noise that this direction brings into images under typical
/// lightings.
pub fn probe_lightings(basis: &LightBasis) -> Vec<f32> {
    let mut probes = vec![1.0; basis.column_count()];
    probes.extend(LightingPrior::of_basis(basis).draws(PROBES - 1, SEED));
    probes
}
