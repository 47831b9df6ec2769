//! `c += S ℓ`; twin of `shaders/scatter.wgsl`.

use super::compact::CompactBlock;
use crate::matrix::CHANNELS;

/// Adds `S ℓ` to `planes`; `channels` are the weights of the columns.
#[inline(always)]
pub(crate) fn scatter(block: &CompactBlock, channels: &[Vec<f32>; CHANNELS], planes: &mut [f32]) {
    let pixels = block.pixels() as u32;
    for at in 0..block.sparse.ends.len() {
        let column = block.sparse.ends[at].0 as usize;
        let weights = [0, 1, 2].map(|channel| channels[channel][column]);
        let (rows, values) = block.sparse.of(at);
        for (&row, value) in rows.iter().zip(values) {
            planes[row as usize] += value * weights[(row / pixels) as usize];
        }
    }
}
