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
const RUN_BYTES: usize = 4 << 20;

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

    fn pixel(&self, half: usize, pixel: usize) -> &[f32] {
        let entries = self.columns * CHANNELS;
        &self.sums[(half * self.pixels + pixel) * entries..][..entries]
    }
}

/// What becomes of a block's noise while its runs come in.
pub(super) struct NoiseSums<'a> {
    /// Columns × probes, probe fastest.
    probes_of_column: &'a [f32],
    probes: usize,
    row_sums: Vec<f64>,
    column_sums: Vec<f64>,
    /// Rows × probes, column-major.
    products: Vec<f32>,
}

/// Probes that are worked on at once.
const PROBE_LANES: usize = 8;

impl<'a> NoiseSums<'a> {
    /// For a block of `rows`, and probe lightings padded by [`interleave`] to a multiple of [`PROBE_LANES`].
    pub(super) fn new(rows: usize, columns: usize, probes_of_column: &'a [f32], probes: usize) -> Self {
        Self {
            probes_of_column,
            probes,
            row_sums: vec![0.0; rows],
            column_sums: vec![0.0; columns],
            products: vec![0.0; rows * probes],
        }
    }

    /// Adds one pixel's row of `D`, given column by column, RGB.
    fn add_pixel(&mut self, difference: &[f32], pixel: usize, pixels: usize) {
        let stride = self.probes.next_multiple_of(PROBE_LANES);
        let mut squares = [0.0f64; CHANNELS];
        for (entry, sum) in difference.chunks_exact(CHANNELS).zip(&mut self.column_sums) {
            let square = |c: usize| f64::from(entry[c] * entry[c]);
            *sum += square(0) + square(1) + square(2);
            (0..CHANNELS).for_each(|c| squares[c] += square(c));
        }
        for (channel, square) in squares.iter().enumerate() {
            self.row_sums[channel * pixels + pixel] = *square;
        }
        let rows = self.row_sums.len();
        for first in (0..self.probes).step_by(PROBE_LANES) {
            let mut sums = [[0.0f32; PROBE_LANES]; CHANNELS];
            for (entry, weights) in difference.chunks_exact(CHANNELS).zip(self.probes_of_column.chunks_exact(stride)) {
                if entry[0] == 0.0 && entry[1] == 0.0 && entry[2] == 0.0 {
                    continue;
                }
                for lane in 0..PROBE_LANES {
                    for channel in 0..CHANNELS {
                        sums[channel][lane] += entry[channel] * weights[first + lane];
                    }
                }
            }
            for (channel, sums) in sums.iter().enumerate() {
                for (probe, &sum) in (first..self.probes).zip(sums) {
                    self.products[probe * rows + channel * pixels + pixel] = sum;
                }
            }
        }
    }

    pub(super) fn finish(self) -> BlockNoise {
        let (rows, columns) = (self.row_sums.len(), self.column_sums.len());
        BlockNoise {
            row_variance: self.row_sums.iter().map(|&s| (s / columns as f64) as f32).collect(),
            column_variance: self.column_sums.iter().map(|&s| (s / rows as f64) as f32).collect(),
            probes: self.products,
        }
    }
}

/// Probe lightings, columns × probes column-major, as `NoiseSums` wants them: all probes of a column side by side,
/// padded with zeros.
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
        (first, count, pixels): (usize, usize, usize),
        samples: [u32; 2],
    ) {
        if let Some(noise) = noise {
            let (scale_a, scale_b) = (0.5 / samples[0] as f32, 0.5 / samples[1] as f32);
            let mut difference = vec![0.0; self.columns * CHANNELS];
            for pixel in 0..count {
                let (a, b) = (self.pixel(0, pixel), self.pixel(1, pixel));
                for ((d, a), b) in difference.iter_mut().zip(a).zip(b) {
                    *d = a * scale_a - b * scale_b;
                }
                noise.add_pixel(&difference, first + pixel, pixels);
            }
        }
        let scale = 1.0 / (samples[0] + samples[1]) as f32;
        let entries = self.columns * CHANNELS;
        let (half_a, half_b) = self.sums.split_at_mut(self.pixels * entries);
        let rows = pixels * CHANNELS;
        let block = target.block.entries_mut();
        for entry in 0..entries {
            let (column, channel) = (entry / CHANNELS, entry % CHANNELS);
            let at = column * rows + channel * pixels + first;
            for (pixel, value) in block[at..at + count].iter_mut().enumerate() {
                *value = (half_a[pixel * entries + entry] + half_b[pixel * entries + entry]) * scale;
            }
        }
        self.sums.fill(0.0);
    }
}
