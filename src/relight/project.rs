//! `y = R ℓ` for the three channels in one pass over `R`; twin of `shaders/project.wgsl`.

use super::compact::{CompactBlock, FactorPart, Quantum};
use crate::light::Lighting;
use crate::matrix::CHANNELS;

/// Independent sums of one dot product: as many as two of the widest vectors hold, so that additions overlap.
const LANES: usize = 32;

/// A lighting with the weights of each channel apart.
pub(crate) struct PlanarLighting {
    channels: [Vec<f32>; CHANNELS],
}

impl PlanarLighting {
    /// For factors whose columns are divided by these scales; of no scales all are 1.
    pub(crate) fn new(lighting: &Lighting, scales: &[f32]) -> Self {
        let mut channels = [0, 1, 2].map(|channel| lighting.channel(channel));
        for channel in &mut channels {
            channel.iter_mut().zip(scales).for_each(|(weight, scale)| *weight *= scale);
        }
        Self { channels }
    }

    pub(crate) fn channel(&self, channel: usize) -> &[f32] {
        &self.channels[channel]
    }
}

/// Sets `projected[k] = s_k (R ℓ_ch)_k` for each component `k` and channel.
#[inline(always)]
pub(crate) fn project(block: &CompactBlock, lighting: &PlanarLighting, projected: &mut Vec<[f32; CHANNELS]>) {
    projected.clear();
    projected.resize(block.rank(), [0.0; CHANNELS]);
    project_part(&block.right.narrow, block.right.length, lighting, projected);
    project_part(&block.right.wide, block.right.length, lighting, projected);
    for (sums, scale) in projected.iter_mut().zip(&block.scales) {
        *sums = sums.map(|sum| sum * scale);
    }
}

#[inline(always)]
fn project_part<Q: Quantum>(
    part: &FactorPart<Q>,
    columns: usize,
    lighting: &PlanarLighting,
    projected: &mut [[f32; CHANNELS]],
) {
    for (&k, values) in part.components.iter().zip(part.values.chunks_exact(columns)) {
        projected[k as usize] = dot_three(values, lighting);
    }
}

/// The dot products of `values` with the three channels.
#[inline(always)]
fn dot_three<'a, Q: Quantum>(values: &[Q], lighting: &'a PlanarLighting) -> [f32; CHANNELS] {
    let [red, green, blue] = &lighting.channels;
    let mut sums = [[0.0f32; LANES]; CHANNELS];
    let (chunks, tail) = values.as_chunks::<LANES>();
    let whole = |weights: &'a Vec<f32>| weights.as_chunks::<LANES>().0.iter();
    let weights = whole(red).zip(whole(green)).zip(whole(blue));
    for (chunk, ((red, green), blue)) in chunks.iter().zip(weights) {
        for i in 0..LANES {
            let value = chunk[i].to_f32();
            sums[0][i] += value * red[i];
            sums[1][i] += value * green[i];
            sums[2][i] += value * blue[i];
        }
    }
    let start = chunks.len() * LANES;
    for (i, value) in tail.iter().enumerate() {
        for (sums, weights) in sums.iter_mut().zip(&lighting.channels) {
            sums[i] += value.to_f32() * weights[start + i];
        }
    }
    sums.map(total)
}

/// The sum of all lanes: short chains of additions, in the same order on every machine.
#[inline(always)]
pub(super) fn total<const N: usize>(lanes: [f32; N]) -> f32 {
    const WIDTH: usize = 8;
    let mut sum = 0.0;
    for i in 0..WIDTH {
        let mut of_lane = 0.0;
        for j in 0..N / WIDTH {
            of_lane += lanes[i + WIDTH * j];
        }
        sum += of_lane;
    }
    sum
}
