//! From samples, which come pixel by pixel and scattered over columns, to a block, which is column by column.
//!
//! Samples of a short run of pixels are added to a buffer that stays in the processor's cache, and only finished runs
//! are carried over into the block, a cache line at a time. So the cost of a sample does not grow with the number of
//! columns, and that of a pixel only by its entries.

use glam::Vec3;

use crate::matrix::{BlockNoise, CHANNELS, TracedBlock};

/// Pixels in a full run: as many as f32 fit a cache line.
const RUN: usize = 16;
/// Bytes that the buffer of a run should stay below, where there are so many columns that it would not.
const RUN_BYTES: usize = 2 << 20;

/// Sums of the two half-sample estimates over a run of pixels: for each half and pixel, column by column, RGB.
#[derive(Debug)]
pub(super) struct Halves {
    columns: usize,
    pixels: usize,
    sums: Vec<f32>,
}

impl Halves {
    pub(super) fn new(columns: usize) -> Self {
        let pixels = (RUN_BYTES / (2 * columns * CHANNELS * size_of::<f32>())).clamp(1, RUN);
        Self { columns, pixels, sums: vec![0.0; 2 * pixels * columns * CHANNELS] }
    }

    /// Pixels that fit.
    pub(super) fn pixels(&self) -> usize {
        self.pixels
    }

    #[inline]
    pub(super) fn add(&mut self, half: usize, pixel: usize, column: u32, value: Vec3) {
        let at = ((half * self.pixels + pixel) * self.columns + column as usize) * CHANNELS;
        if let Some([r, g, b]) = self.sums.get_mut(at..at + CHANNELS) {
            *r += value.x;
            *g += value.y;
            *b += value.z;
        }
    }
}

/// What becomes of a block's noise while its runs come in.
pub(super) struct NoiseSums<'a> {
    /// Columns × probes, probe fastest.
    probes_of_column: &'a [f32],
    probes: usize,
    /// Sum of `D²` over pixels for each column and channel. Some thousand squares at most: f32 keeps four digits.
    entry_squares: Vec<f32>,
    row_sums: Vec<f32>,
    /// Rows × probes, column-major.
    products: Vec<f32>,
    /// `D` of one pixel.
    difference: Vec<f32>,
}

/// Probes that are worked on at once: as many as registers hold for three channels.
const PROBE_LANES: usize = 16;

/// Entries that are worked on at once: a multiple of the channels and of all vector widths.
const FOLD_LANES: usize = 8 * CHANNELS;

impl<'a> NoiseSums<'a> {
    /// For a block of `rows`, and probe lightings as [`interleave`] gives them.
    pub(super) fn new(rows: usize, columns: usize, probes_of_column: &'a [f32], probes: usize) -> Self {
        Self {
            probes_of_column,
            probes,
            entry_squares: vec![0.0; columns * CHANNELS],
            row_sums: vec![0.0; rows],
            products: vec![0.0; rows * probes],
            difference: vec![0.0; columns * CHANNELS],
        }
    }

    /// Takes one pixel's sums of both halves, and leaves what [`fold_means`] leaves.
    #[inline(always)]
    fn fold(&mut self, a: &mut [f32], b: &mut [f32], samples: [u32; 2], pixel: usize, pixels: usize) {
        let scale = 1.0 / (samples[0] + samples[1]) as f32;
        let (scale_a, scale_b) = (0.5 / samples[0] as f32, 0.5 / samples[1] as f32);
        let mut squares = [0.0f32; FOLD_LANES];
        let one = |a: &mut f32, b: &mut f32, d: &mut f32, sum: &mut f32, square: &mut f32| {
            let difference = *a * scale_a - *b * scale_b;
            *a = (*a + *b) * scale;
            *b = 0.0;
            *d = difference;
            *sum += difference * difference;
            *square += difference * difference;
        };
        let lanes = a.chunks_mut(FOLD_LANES).zip(b.chunks_mut(FOLD_LANES));
        let sums = self.difference.chunks_mut(FOLD_LANES).zip(self.entry_squares.chunks_mut(FOLD_LANES));
        for ((a, b), (d, sum)) in lanes.zip(sums) {
            if let (Ok(a), Ok(b), Ok(d), Ok(sum)) = (
                <&mut [f32; FOLD_LANES]>::try_from(&mut *a),
                <&mut [f32; FOLD_LANES]>::try_from(&mut *b),
                <&mut [f32; FOLD_LANES]>::try_from(&mut *d),
                <&mut [f32; FOLD_LANES]>::try_from(&mut *sum),
            ) {
                for i in 0..FOLD_LANES {
                    one(&mut a[i], &mut b[i], &mut d[i], &mut sum[i], &mut squares[i]);
                }
            } else {
                for i in 0..a.len() {
                    one(&mut a[i], &mut b[i], &mut d[i], &mut sum[i], &mut squares[i]);
                }
            }
        }
        for channel in 0..CHANNELS {
            self.row_sums[channel * pixels + pixel] = squares.iter().skip(channel).step_by(CHANNELS).sum();
        }
        self.multiply_probes(pixel, pixels);
    }

    /// `D Ω` of one pixel.
    #[inline(always)]
    fn multiply_probes(&mut self, pixel: usize, pixels: usize) {
        let rows = self.row_sums.len();
        let stride = self.probes.next_multiple_of(PROBE_LANES);
        for first in (0..self.probes).step_by(PROBE_LANES) {
            let [mut red, mut green, mut blue] = [[0.0f32; PROBE_LANES]; CHANNELS];
            let entries = self.difference.chunks_exact(CHANNELS);
            for (entry, weights) in entries.zip(self.probes_of_column.chunks_exact(stride)) {
                let Ok(weights) = <&[f32; PROBE_LANES]>::try_from(&weights[first..first + PROBE_LANES]) else {
                    continue;
                };
                let (r, g, b) = (entry[0], entry[1], entry[2]);
                if r == 0.0 && g == 0.0 && b == 0.0 {
                    continue;
                }
                for lane in 0..PROBE_LANES {
                    red[lane] += r * weights[lane];
                    green[lane] += g * weights[lane];
                    blue[lane] += b * weights[lane];
                }
            }
            for (channel, sums) in [red, green, blue].iter().enumerate() {
                for (probe, &sum) in (first..self.probes).zip(sums) {
                    self.products[probe * rows + channel * pixels + pixel] = sum;
                }
            }
        }
    }

    pub(super) fn finish(self) -> BlockNoise {
        let (rows, columns) = (self.row_sums.len(), self.entry_squares.len() / CHANNELS);
        let column = |squares: &[f32]| squares.iter().sum::<f32>() / rows as f32;
        BlockNoise {
            row_variance: self.row_sums.iter().map(|&s| s / columns as f32).collect(),
            column_variance: self.entry_squares.chunks_exact(CHANNELS).map(column).collect(),
            probes: self.products,
        }
    }
}

/// Makes the sums of both halves of one pixel their mean, in `a`, and empties `b`.
fn fold_means(a: &mut [f32], b: &mut [f32], samples: [u32; 2]) {
    let scale = 1.0 / (samples[0] + samples[1]) as f32;
    for (a, b) in a.iter_mut().zip(b) {
        *a = (*a + *b) * scale;
        *b = 0.0;
    }
}

/// Probe lightings, columns × probes column-major, as `NoiseSums` wants them: all probes of a column side by side,
/// padded with zeros to a multiple of [`PROBE_LANES`].
pub(super) fn interleave(probes: &[f32], columns: usize) -> (Vec<f32>, usize) {
    let count = probes.len() / columns;
    let stride = count.next_multiple_of(PROBE_LANES);
    let mut interleaved = vec![0.0; columns * stride];
    for (probe, weights) in probes.chunks_exact(columns).enumerate() {
        for (column, &weight) in weights.iter().enumerate() {
            interleaved[column * stride + probe] = weight;
        }
    }
    (interleaved, count)
}

impl Halves {
    /// Carries a run of `count` pixels, the first of them `first` of the block's `pixels`, into the block, and empties
    /// the buffer. `samples` are those of each half; with none in the second there is no noise to know.
    pub(super) fn flush(
        &mut self,
        target: &mut TracedBlock,
        noise: Option<&mut NoiseSums<'_>>,
        run: Run,
        samples: [u32; 2],
    ) {
        let entries = self.columns * CHANNELS;
        let (half_a, half_b) = self.sums.split_at_mut(self.pixels * entries);
        match noise {
            Some(noise) => fold_run(noise, half_a, half_b, run, samples),
            None => {
                let halves = half_a.chunks_exact_mut(entries).zip(half_b.chunks_exact_mut(entries));
                halves.take(run.count).for_each(|(a, b)| fold_means(a, b, samples));
            }
        }
        transpose(half_a, entries, target.block.entries_mut(), run);
        half_a.fill(0.0);
    }
}

/// A run of pixels inside a block.
#[derive(Clone, Copy)]
pub(super) struct Run {
    /// Its first pixel.
    pub(super) first: usize,
    /// Its pixels.
    pub(super) count: usize,
    /// Pixels of the block.
    pub(super) pixels: usize,
}

#[inline(always)]
fn fold_pixels(noise: &mut NoiseSums<'_>, half_a: &mut [f32], half_b: &mut [f32], run: Run, samples: [u32; 2]) {
    let entries = noise.difference.len();
    let halves = half_a.chunks_exact_mut(entries).zip(half_b.chunks_exact_mut(entries));
    for (pixel, (a, b)) in halves.take(run.count).enumerate() {
        noise.fold(a, b, samples, run.first + pixel, run.pixels);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn fold_pixels_avx2(noise: &mut NoiseSums<'_>, half_a: &mut [f32], half_b: &mut [f32], run: Run, samples: [u32; 2]) {
    fold_pixels(noise, half_a, half_b, run, samples);
}

/// Folds a run with the widest vectors there are. Lanes never mix, so the result is the same with any width.
fn fold_run(noise: &mut NoiseSums<'_>, half_a: &mut [f32], half_b: &mut [f32], run: Run, samples: [u32; 2]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(unsafe_code, reason = "a measured SIMD leaf: the plain body compiled for wider vectors")]
        // SAFETY: the processor has AVX2.
        unsafe {
            fold_pixels_avx2(noise, half_a, half_b, run, samples);
        }
        return;
    }
    fold_pixels(noise, half_a, half_b, run, samples);
}

/// Carries pixels, each a row of `entries`, to columns. In tiles, so that both sides are read and written by whole
/// cache lines.
fn transpose(pixels: &[f32], entries: usize, block: &mut [f32], run: Run) {
    const TILE: usize = 8;
    let rows = run.pixels * CHANNELS;
    let start = |entry: usize| (entry / CHANNELS) * rows + (entry % CHANNELS) * run.pixels + run.first;
    for first in (0..entries).step_by(TILE) {
        let width = TILE.min(entries - first);
        let mut tile = [[0.0f32; RUN]; TILE];
        for (pixel, row) in pixels.chunks_exact(entries).take(run.count).enumerate() {
            for (lane, &value) in row[first..first + width].iter().enumerate() {
                tile[lane][pixel] = value;
            }
        }
        for (lane, column) in tile.iter().enumerate().take(width) {
            let at = start(first + lane);
            block[at..at + run.count].copy_from_slice(&column[..run.count]);
        }
    }
}
