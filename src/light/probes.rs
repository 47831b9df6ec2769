//! Probe lightings: a few fixed lightings under which the noise of a traced block is kept.

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::LightBasis;

/// Number of probe lightings.
const PROBES: usize = 16;

/// The probe lightings `Ω`: columns × probes, column-major, the same for the same basis.
///
/// Probe 0 is all-on. The others are white (each column ±1), so that an average over probes of `‖uᵀ D Ω‖²` estimates
/// the noise that a direction `u` of the block's range would carry.
pub fn probe_lightings(basis: &LightBasis) -> Vec<f32> {
    let columns = basis.column_count();
    let mut random = Pcg64Mcg::seed_from_u64(0x6c74_6d70_726f_6265);
    let mut probes = vec![1.0; columns];
    probes.extend((0..columns * (PROBES - 1)).map(|_| if random.random::<bool>() { 1.0f32 } else { -1.0 }));
    probes
}
