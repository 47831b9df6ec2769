//! `y = R ℓ` for the three channels, by the right side itself; twin of `shaders/project.wgsl`.

use super::compact::CompactBlock;
use super::lighting::LightingCoefficients;
use crate::matrix::CHANNELS;

/// Sets `projected[k] = s_k (R ℓ_ch)_k` for each component `k` and channel.
#[inline(always)]
pub(crate) fn project(block: &CompactBlock, lighting: &LightingCoefficients, projected: &mut Vec<[f32; CHANNELS]>) {
    projected.clear();
    projected.resize(block.rank(), [0.0; CHANNELS]);
    block.right.project(lighting, projected);
}
