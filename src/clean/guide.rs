//! A few images that stand for all: what pixels are compared by.

use std::ops::Range;

use super::constants::CHROMA;
use super::kernel::span as overlap;
use super::rows::Rows;

/// Guides and the variance of each.
pub(super) struct Guide {
    pub(super) images: Rows,
    pub(super) variance: Rows,
}

pub(super) struct GuideWidths {
    /// Of the noise: larger averages more.
    pub(super) noise: f32,
    /// Of the value itself: relative differences below this are none.
    pub(super) relative: f32,
}

impl Guide {
    /// Of two halves, one after the other in `halves`: their mean, and its variance, averaged over squares.
    pub(super) fn of_halves(halves: &Rows, reach: usize) -> Self {
        let planes = halves.planes() / 2;
        let (width, height) = (halves.width(), halves.height());
        let both = |f: fn(f32, f32) -> f32| {
            let mut out = Rows::zeros(width, height, planes);
            out.fill_rows(|y, out| {
                for (plane, out) in out.chunks_exact_mut(width).enumerate() {
                    let pairs = halves.row(plane, y).iter().zip(halves.row(planes + plane, y));
                    out.iter_mut().zip(pairs).for_each(|(o, (a, b))| *o = f(*a, *b));
                }
            });
            out
        };
        Self { images: both(|a, b| 0.5 * (a + b)), variance: both(|a, b| 0.25 * (a - b) * (a - b)).box_mean(reach) }
    }

    /// Adds to `out` the mean over guides of the squared differences, less their noise, over the noise.
    pub(super) fn add_distances(
        &self,
        y: usize,
        (across, down): (isize, isize),
        span: Range<usize>,
        widths: &GuideWidths,
        out: &mut [f32],
    ) {
        let row = (y as isize + down) as usize;
        let begin = (span.start as isize + across) as usize;
        let there = begin..begin + span.len();
        let (noise, relative) = (widths.noise * widths.noise, widths.relative * widths.relative);
        let mut squares = vec![0.0f32; span.len()];
        let mut noises = vec![0.0f32; span.len()];
        let mut sizes = vec![0.0f32; span.len()];
        for plane in 0..self.images.planes() {
            let a = &self.images.row(plane, y)[span.clone()];
            let b = &self.images.row(plane, row)[there.clone()];
            let va = &self.variance.row(plane, y)[span.clone()];
            let vb = &self.variance.row(plane, row)[there.clone()];
            for i in 0..squares.len() {
                squares[i] += (a[i] - b[i]) * (a[i] - b[i]);
                noises[i] += va[i] + vb[i];
                sizes[i] += a[i] * a[i] + b[i] * b[i];
            }
        }
        for i in 0..squares.len() {
            let d = (squares[i] - noises[i]) / (noise * noises[i] + relative * sizes[i] + 1e-12);
            out[i] += d;
        }
    }

    /// The same, the mean over a square of pixels around both.
    pub(super) fn add_patch_distances(
        &self,
        y: usize,
        offset: (isize, isize),
        span: Range<usize>,
        (widths, reach): (&GuideWidths, usize),
        out: &mut [f32],
    ) {
        if reach == 0 {
            return self.add_distances(y, offset, span, widths, out);
        }
        let (width, height) = (self.images.width(), self.images.height());
        let mut sums = vec![0.0f32; span.len()];
        let mut rows = 0;
        for near in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            if near.checked_add_signed(offset.1).is_some_and(|row| row < height) {
                self.add_distances(near, offset, overlap(width, offset.0), widths, &mut sums);
                rows += 1;
            }
        }
        for (x, out) in out.iter_mut().enumerate() {
            let near = &sums[x.saturating_sub(reach)..(x + reach + 1).min(sums.len())];
            *out += near.iter().sum::<f32>() / (near.len() * rows) as f32;
        }
    }
}

/// Mixtures of the clusters' images, summed over channels, of each half: `mix` is clusters × guides, guide by guide. Two more
/// say how the first of them is coloured: red and blue less green, [`CHROMA`] times.
pub(super) fn mixtures(halves: &Rows, mix: &[f32]) -> Rows {
    let (width, clusters) = (halves.width(), halves.planes() / 6);
    let guides = mix.len() / clusters;
    let chroma = [[CHROMA, -CHROMA, 0.0], [0.0, -CHROMA, CHROMA]];
    let mut images = Rows::zeros(width, halves.height(), 2 * (guides + chroma.len()));
    images.fill_rows(|y, out| {
        for (plane, out) in out.chunks_exact_mut(width).enumerate() {
            let (half, guide) = (plane / (guides + chroma.len()), plane % (guides + chroma.len()));
            let (guide, channels) = match guide.checked_sub(guides) {
                Some(colour) => (0, chroma[colour]),
                None => (guide, [1.0; 3]),
            };
            for (cluster, weight) in mix[guide * clusters..][..clusters].iter().enumerate() {
                for (channel, share) in channels.iter().enumerate().filter(|(_, share)| **share != 0.0) {
                    let row = halves.row((half * clusters + cluster) * 3 + channel, y);
                    out.iter_mut().zip(row).for_each(|(o, v)| *o += weight * share * v);
                }
            }
        }
    });
    images
}

/// Weights from distances.
pub(super) fn weights(distances: &mut [f32]) {
    // (1 − d/8)⁸ is near exp(−d) and needs no table; far distances count nothing.
    for d in distances {
        let base = (1.0 - d.max(0.0) * 0.125).max(0.0);
        let square = base * base;
        let fourth = square * square;
        *d = fourth * fourth;
    }
}
