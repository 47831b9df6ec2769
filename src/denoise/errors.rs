//! Error estimates of denoising from the two halves of the samples, for each group of lights: noise removed, noise left, bias
//! added, and light lost.

use std::ops::Range;

use rayon::prelude::*;

use super::image_rows::{ImageRows, Region};
use crate::light::DenoiseErrors;
use crate::matrix::CHANNELS;
use crate::simd::dispatch;

/// Sums over pixels and channels, from which [`DenoiseErrors`] follow.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ErrorSums {
    /// Squared light of the denoised images.
    pub light: f64,
    /// Squared noise of the input images.
    pub noise_before: f64,
    /// Squared noise of the denoised images.
    pub noise_after: f64,
    /// Squared difference between denoised and input images.
    pub changed: f64,
    /// Squared noise of that difference.
    pub noise_of_change: f64,
    /// Light of the input images.
    pub light_before: f64,
    /// Light of the denoised images.
    pub light_after: f64,
}

impl ErrorSums {
    /// The errors that follow.
    pub(super) fn errors(&self) -> DenoiseErrors {
        let share = |squares: f64| (squares.max(0.0) / self.light.max(f64::MIN_POSITIVE)).sqrt() as f32;
        DenoiseErrors {
            noise_before: share(self.noise_before),
            noise_after: share(self.noise_after),
            bias: share(self.changed - self.noise_of_change),
        }
    }

    /// Adds the sums of another part of the image, or of another image.
    pub fn add(&mut self, part: &Self) {
        self.light += part.light;
        self.noise_before += part.noise_before;
        self.noise_after += part.noise_after;
        self.changed += part.changed;
        self.noise_of_change += part.noise_of_change;
        self.light_before += part.light_before;
        self.light_after += part.light_after;
    }
}

/// The sums of the blocks of a step, by block and then by group of images. The image of a group is the sum of its clusters' images.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct BlockErrors(Vec<(Region, Vec<ErrorSums>)>);

impl BlockErrors {
    /// Of blocks of `side` × `side` pixels from the top left of the region on, with nothing summed yet.
    pub(super) fn none_yet(region: &Region, side: usize, groups: usize) -> Self {
        let begins = |range: &Range<usize>| {
            let end = range.end;
            range.clone().step_by(side).map(move |begin| begin..(begin + side).min(end))
        };
        let blocks = begins(&region.y).flat_map(|y| begins(&region.x).map(move |x| Region { x, y: y.clone() }));
        Self(blocks.map(|block| (block, vec![ErrorSums::default(); groups])).collect())
    }

    /// Adds the blocks of a later step.
    #[cfg(test)]
    pub(super) fn append(&mut self, later: &Self) {
        self.0.extend_from_slice(&later.0);
    }

    /// The sums of each group over the blocks that lie in a region.
    pub(super) fn of(&self, region: &Region) -> Vec<ErrorSums> {
        let within = |part: &Range<usize>, whole: &Range<usize>| part.start >= whole.start && part.end <= whole.end;
        let mut blocks = self.0.iter().filter(|(block, _)| within(&block.x, &region.x) && within(&block.y, &region.y));
        let mut sums = blocks.next().map(|(_, sums)| sums.clone()).unwrap_or_default();
        for (_, more) in blocks {
            sums.iter_mut().zip(more).for_each(|(sum, more)| sum.add(more));
        }
        sums
    }

    /// Adds direct or indirect light, each in two halves: `raw` before and `denoised` after filtering, in units that `scale`
    /// brings to light, for a channel, a row and some pixels of it. The squared noise of a mean of two halves is the square of half their difference. Direct and
    /// indirect light are taken as independent. `groups` has the group of each cluster.
    pub(super) fn add_change(
        &mut self,
        [raw, denoised]: [&ImageRows; 2],
        groups: &[u16],
        scale: impl Fn(usize, usize, &Range<usize>) -> Vec<f32> + Sync,
    ) {
        let planes = raw.planes() / 2;
        self.0.par_iter_mut().for_each(|(block, sums)| {
            // For each group and channel the light of both halves, raw and denoised.
            let across = block.x.len();
            let mut halves = vec![[0.0f32; 4]; sums.len() * CHANNELS * across];
            for y in block.y.clone() {
                halves.fill([0.0; 4]);
                for plane in 0..planes {
                    let from = [(raw, 0), (raw, planes), (denoised, 0), (denoised, planes)];
                    let [raw_a, raw_b, a, b] = from.map(|(rows, half)| &rows.row(half + plane, y)[block.x.clone()]);
                    let group = usize::from(groups[plane / CHANNELS]) * CHANNELS + plane % CHANNELS;
                    let sums = &mut halves[group * across..][..across];
                    dispatch(
                        #[inline(always)]
                        || {
                            for (((sums, (raw_a, raw_b)), a), b) in
                                sums.iter_mut().zip(raw_a.iter().zip(raw_b)).zip(a).zip(b)
                            {
                                *sums = [sums[0] + raw_a, sums[1] + raw_b, sums[2] + a, sums[3] + b];
                            }
                        },
                    );
                }
                let scales: [Vec<f32>; CHANNELS] = std::array::from_fn(|channel| scale(channel, y, &block.x));
                for (plane, halves) in halves.chunks_exact(across).enumerate() {
                    add_row(&mut sums[plane / CHANNELS], halves, &scales[plane % CHANNELS]);
                }
            }
        });
    }

    /// Adds the light of the denoised images.
    pub(super) fn add_light(&mut self, images: &ImageRows, groups: &[u16]) {
        self.0.par_iter_mut().for_each(|(block, sums)| {
            let across = block.x.len();
            let mut light = vec![0.0f32; sums.len() * CHANNELS * across];
            for y in block.y.clone() {
                light.fill(0.0);
                for plane in 0..images.planes() {
                    let group = usize::from(groups[plane / CHANNELS]) * CHANNELS + plane % CHANNELS;
                    let from = &images.row(plane, y)[block.x.clone()];
                    light[group * across..][..across].iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
                }
                for (plane, light) in light.chunks_exact(across).enumerate() {
                    let sum = &mut sums[plane / CHANNELS];
                    sum.light += light.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
                    sum.light_after += light.iter().map(|&v| f64::from(v)).sum::<f64>();
                }
            }
        });
    }
}

/// Adds a row of one channel of one group.
fn add_row(sums: &mut ErrorSums, halves: &[[f32; 4]], scale: &[f32]) {
    for (&[raw_a, raw_b, a, b], &scale) in halves.iter().zip(scale) {
        let square = |value: f32| f64::from(0.5 * scale * value).powi(2);
        let (was, is) = (raw_a - raw_b, a - b);
        sums.noise_before += square(was);
        sums.noise_after += square(is);
        sums.changed += square(raw_a + raw_b - a - b);
        sums.noise_of_change += square(was - is);
        sums.light_before += f64::from(0.5 * scale * (raw_a + raw_b));
    }
}
