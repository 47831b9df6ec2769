//! `c = L y`; twin of `shaders/reconstruct.wgsl`.

use super::compact::{CompactBlock, FactorPart, Quantum};
use crate::matrix::CHANNELS;

/// Rows that are finished together: their sums stay in registers while the components pass by.
const TILE: usize = 64;

/// Sets `planes` (the rows of the block, channel-planar) to `L y`.
#[inline(always)]
pub(crate) fn reconstruct(block: &CompactBlock, projected: &[[f32; CHANNELS]], planes: &mut Vec<f32>) {
    planes.clear();
    planes.resize(block.left.length, 0.0);
    let pixels = block.pixels();
    for (channel, plane) in planes.chunks_exact_mut(pixels).enumerate() {
        add_part(&block.left.narrow, block.left.length, channel * pixels, channel, projected, plane);
        add_part(&block.left.wide, block.left.length, channel * pixels, channel, projected, plane);
    }
}

#[inline(always)]
fn add_part<Q: Quantum>(
    part: &FactorPart<Q>,
    rows: usize,
    first_row: usize,
    channel: usize,
    projected: &[[f32; CHANNELS]],
    plane: &mut [f32],
) {
    if part.components.is_empty() {
        return;
    }
    let (tiles, tail) = plane.as_chunks_mut::<TILE>();
    let tail_start = first_row + tiles.len() * TILE;
    for (t, tile) in tiles.iter_mut().enumerate() {
        let start = first_row + t * TILE;
        let mut sums = *tile;
        for (&k, values) in part.components.iter().zip(part.values.chunks_exact(rows)) {
            let weight = projected[k as usize][channel];
            let values: &[Q; TILE] = values[start..start + TILE].try_into().expect("a whole tile");
            for i in 0..TILE {
                sums[i] += values[i].to_f32() * weight;
            }
        }
        *tile = sums;
    }
    for (&k, values) in part.components.iter().zip(part.values.chunks_exact(rows)) {
        let weight = projected[k as usize][channel];
        for (sum, value) in tail.iter_mut().zip(&values[tail_start..]) {
            *sum += value.to_f32() * weight;
        }
    }
}
