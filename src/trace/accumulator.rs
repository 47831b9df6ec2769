//! Collects samples, which come by pixel and column, into a block, which is stored column by column.
//!
//! A pixel's samples reach only some columns: one for each light that a path finds or samples. So a pixel is summed in
//! a table with one record for each column. Only the records that were touched are read again. Their means go to a tile
//! for a short run of pixels, and a full tile is copied into the block one cache line at a time. Only writing the block
//! once has a cost that grows with the number of columns.

use glam::Vec3;

use crate::light::PROBES;
use crate::matrix::{BlockNoise, CHANNELS, TracedBlock};

/// Pixels in a full run: a row of a block of the usual size. One cache line of f32 would be enough. But a block's
/// columns lie pages apart, and each visit to a page costs more than the line that is written there.
pub(super) const RUN: usize = 32;

/// Probe lightings that are processed at once: as many as fit the registers for three channels.
const PROBE_LANES: usize = 16;

/// Columns that share a word of bits.
const WORD: usize = u64::BITS as usize;

/// The sums of one column over one pixel: RGB of the even samples, RGB of the odd ones, each padded to four lanes.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Default)]
struct ColumnSums([[f32; 4]; 2]);

/// Sums of the two half-sample estimates of one pixel, for all columns.
#[derive(Debug)]
pub(super) struct PixelSums {
    records: Vec<ColumnSums>,
    /// One bit for each column, set where its record is not empty.
    touched: Vec<u64>,
}

/// Means of a run of pixels, column by column.
#[derive(Debug)]
pub(super) struct PixelMeans {
    /// Columns × channels.
    lines: Vec<Line>,
    /// One bit for each column, set where one of its lines is not empty.
    dirty: Vec<u64>,
}

#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
struct Line([f32; RUN]);

/// Position of a run of pixels in its block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// First pixel.
    pub(super) first: usize,
    /// Pixels in the run, at most [`RUN`].
    pub(super) count: usize,
    /// Pixels of the block.
    pub(super) pixels: usize,
}

/// Sums for the noise of a block, filled pixel by pixel.
pub(super) struct NoiseSums<'a> {
    /// Columns × probes, probe fastest.
    probes_of_column: &'a [f32],
    probes: usize,
    /// Factor on each column before its noise is counted; empty if all are 1.
    factors: &'a [f32],
    /// Sum of `D²` over pixels for each column, RGB and padding. Some thousand squares at most: f32 keeps four digits.
    entry_squares: Vec<[f32; 4]>,
    row_sums: Vec<f32>,
    /// Rows × probes, column-major.
    products: Vec<f32>,
    /// The nonzero entries of `D` for one pixel: column and RGB.
    differences: Vec<(u32, [f32; CHANNELS])>,
}

impl PixelSums {
    pub(super) fn new(columns: usize) -> Self {
        Self { records: vec![ColumnSums::default(); columns], touched: vec![0; columns.div_ceil(WORD)] }
    }

    pub(super) fn needs_bytes(columns: u64) -> u64 {
        size_of::<ColumnSums>() as u64 * columns + columns / 8 + 8
    }

    #[inline(always)]
    pub(super) fn add(&mut self, half: usize, column: u32, value: Vec3) {
        let at = column as usize;
        if let (Some(record), Some(word)) = (self.records.get_mut(at), self.touched.get_mut(at / WORD)) {
            let [r, g, b, _] = &mut record.0[half & 1];
            *r += value.x;
            *g += value.y;
            *b += value.z;
            *word |= 1 << (at % WORD);
        }
    }

    /// Passes each touched column with the sum of both halves to `each`, and clears the sums.
    pub(super) fn drain(&mut self, mut each: impl FnMut(usize, Vec3)) {
        for (at, word) in self.touched.iter_mut().enumerate() {
            while *word != 0 {
                let column = at * WORD + word.trailing_zeros() as usize;
                *word &= *word - 1;
                let ColumnSums([[r, g, b, _], [s, h, c, _]]) = std::mem::take(&mut self.records[column]);
                each(column, Vec3::new(r + s, g + h, b + c));
            }
        }
    }
}

/// Factors on the sums of the two halves for which the expected square of their difference is the variance of the mean
/// of all samples: `√(m n) / (m + n)` divided by the number of samples in each half. With equal halves it is `1 / (2
/// m)`.
fn difference_scales(samples: [u32; 2]) -> [f32; 2] {
    let [m, n] = samples.map(f64::from);
    let share = (m * n).sqrt() / (m + n);
    samples.map(|count| (share / f64::from(count.max(1))) as f32)
}

impl PixelMeans {
    pub(super) fn new(columns: usize) -> Self {
        let lines = vec![Line([0.0; RUN]); columns * CHANNELS];
        Self { lines, dirty: vec![0; columns.div_ceil(WORD)] }
    }

    pub(super) fn needs_bytes(columns: u64) -> u64 {
        (size_of::<Line>() * CHANNELS) as u64 * columns + columns / 8 + 8
    }

    /// Moves the means of pixel `pixel` of `run` out of `sums`, with their noise; the emission seen has none. `samples`
    /// are the numbers of samples in each half. If the second is 0, the noise is unknown.
    pub(super) fn take(
        &mut self,
        sums: &mut PixelSums,
        noise: Option<(&mut NoiseSums<'_>, &PixelSums)>,
        run: Run,
        pixel: usize,
        samples: [u32; 2],
    ) {
        let scale = 1.0 / (samples[0] + samples[1]) as f32;
        let scales = difference_scales(samples);
        let PixelSums { records, touched } = sums;
        let mut differences = noise;
        if let Some((noise, _)) = &mut differences {
            noise.differences.clear();
        }
        let mut squares = [0.0f32; 4];
        for (at, word) in touched.iter_mut().enumerate() {
            self.dirty[at] |= *word;
            while *word != 0 {
                let column = at * WORD + word.trailing_zeros() as usize;
                *word &= *word - 1;
                let ColumnSums([a, b]) = std::mem::take(&mut records[column]);
                let lines = &mut self.lines[column * CHANNELS..][..CHANNELS];
                for (channel, line) in lines.iter_mut().enumerate() {
                    line.0[pixel] = (a[channel] + b[channel]) * scale;
                }
                if let Some((noise, emission)) = &mut differences {
                    let ColumnSums([of_a, of_b]) = emission.records[column];
                    let mut d = [0.0f32; 4];
                    let factor = noise.factors.get(column).copied().unwrap_or(1.0);
                    for lane in 0..4 {
                        d[lane] = factor * ((a[lane] - of_a[lane]) * scales[0] - (b[lane] - of_b[lane]) * scales[1]);
                        squares[lane] += d[lane] * d[lane];
                        noise.entry_squares[column][lane] += d[lane] * d[lane];
                    }
                    noise.differences.push((column as u32, [d[0], d[1], d[2]]));
                }
            }
        }
        if let Some((noise, _)) = differences {
            for (channel, &square) in squares.iter().take(CHANNELS).enumerate() {
                noise.row_sums[channel * run.pixels + run.first + pixel] = square;
            }
            noise.multiply_probes(run.first + pixel, run.pixels);
        }
    }

    /// Copies a run into the block, every entry of it, and clears the tile.
    pub(super) fn carry(&mut self, target: &mut TracedBlock, run: Run) {
        let whole = run.count == RUN;
        let columns = target.block.entries_mut().chunks_exact_mut(CHANNELS * run.pixels);
        for ((column, entries), lines) in columns.enumerate().zip(self.lines.chunks_exact_mut(CHANNELS)) {
            let dirty = self.dirty[column / WORD] >> (column % WORD) & 1 == 1;
            for (line, entries) in lines.iter_mut().zip(entries.chunks_exact_mut(run.pixels)) {
                let entries = &mut entries[run.first..run.first + run.count];
                match (<&mut [f32; RUN]>::try_from(&mut *entries), dirty) {
                    (Ok(entries), true) if whole => *entries = std::mem::replace(&mut line.0, [0.0; RUN]),
                    (Ok(entries), false) if whole => *entries = [0.0; RUN],
                    (_, true) => {
                        entries.copy_from_slice(&line.0[..run.count]);
                        line.0 = [0.0; RUN];
                    }
                    (_, false) => entries.fill(0.0),
                }
            }
        }
        self.dirty.fill(0);
    }
}

impl<'a> NoiseSums<'a> {
    /// For a block of (rows, columns). `probes` are as [`interleave`] gives them, with their number; `factors` apply to
    /// columns.
    pub(super) fn new(
        (rows, columns): (usize, usize),
        probes_of_column: &'a [f32],
        probes: usize,
        factors: &'a [f32],
    ) -> Self {
        Self {
            probes_of_column,
            probes,
            factors,
            entry_squares: vec![[0.0; 4]; columns],
            row_sums: vec![0.0; rows],
            products: vec![0.0; rows * probes],
            differences: Vec::new(),
        }
    }

    /// The list of differences grows by doubling and may reach every column.
    pub(super) fn needs_bytes(rows: u64, columns: u64) -> u64 {
        let differences = 2 * size_of::<(u32, [f32; CHANNELS])>() as u64;
        columns * (size_of::<[f32; 4]>() as u64 + differences) + 4 * (rows * (1 + PROBES as u64) + rows + columns)
    }

    /// `D Ω` of one pixel.
    fn multiply_probes(&mut self, pixel: usize, pixels: usize) {
        let rows = self.row_sums.len();
        let stride = self.probes.next_multiple_of(PROBE_LANES);
        for first in (0..self.probes).step_by(PROBE_LANES) {
            let sums = project(&self.differences, &self.probes_of_column[first..], stride);
            for (channel, sums) in sums.iter().enumerate() {
                for (probe, &sum) in (first..self.probes).zip(sums) {
                    self.products[probe * rows + channel * pixels + pixel] = sum;
                }
            }
        }
    }

    pub(super) fn finish(self) -> BlockNoise {
        let (rows, columns) = (self.row_sums.len(), self.entry_squares.len());
        BlockNoise {
            row_variance: self.row_sums.iter().map(|&s| s / columns as f32).collect(),
            column_variance: self.entry_squares.iter().map(|[r, g, b, _]| (r + g + b) / rows as f32).collect(),
            probes: self.products,
        }
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

type Projected = [[f32; PROBE_LANES]; CHANNELS];

/// Sums over columns of a difference times the column's weights, which begin at `column · stride` of `weights`.
#[inline(always)]
fn project_lanes(differences: &[(u32, [f32; CHANNELS])], weights: &[f32], stride: usize) -> Projected {
    let [mut red, mut green, mut blue] = [[0.0f32; PROBE_LANES]; CHANNELS];
    for &(column, [r, g, b]) in differences {
        let weights = weights.get(column as usize * stride..).and_then(|w| w.first_chunk::<PROBE_LANES>());
        let Some(weights) = weights else { continue };
        for lane in 0..PROBE_LANES {
            red[lane] += r * weights[lane];
            green[lane] += g * weights[lane];
            blue[lane] += b * weights[lane];
        }
    }
    [red, green, blue]
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn project_avx2(differences: &[(u32, [f32; CHANNELS])], weights: &[f32], stride: usize) -> Projected {
    project_lanes(differences, weights, stride)
}

/// [`project_lanes`] with the widest vectors of the processor. Lanes never mix, so the result is the same with any
/// width.
fn project(differences: &[(u32, [f32; CHANNELS])], weights: &[f32], stride: usize) -> Projected {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(unsafe_code, reason = "a measured SIMD leaf: the plain body compiled for wider vectors")]
        // SAFETY: the processor has AVX2.
        return unsafe { project_avx2(differences, weights, stride) };
    }
    project_lanes(differences, weights, stride)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Over many pixels of samples with a known variance, with equal halves and with one more sample in the first.
    #[test]
    fn the_stated_variance_is_that_of_the_mean_for_any_number_of_samples() {
        const PIXELS: usize = 20_000;
        // Uniform between −1 and 1: a variance of a third.
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut sample = || random.random_range(-1.0f32..1.0);
        for halves in [[1u32, 1], [2, 1], [3, 2], [8, 8]] {
            let mut sums = PixelSums::new(1);
            let (mut tile, mut noise) = (PixelMeans::new(1), NoiseSums::new((3 * PIXELS, 1), &[], 0, &[]));
            for pixel in 0..PIXELS {
                for (half, count) in halves.into_iter().enumerate() {
                    (0..count).for_each(|_| sums.add(half, 0, Vec3::splat(sample())));
                }
                let run = Run { first: pixel, count: 1, pixels: PIXELS };
                tile.take(&mut sums, Some((&mut noise, &PixelSums::new(1))), run, 0, halves);
            }
            let stated = f64::from(noise.finish().column_variance[0]);
            let expected = 1.0 / 3.0 / f64::from(halves[0] + halves[1]);
            // A mean of 20,000 squares has a relative standard deviation of 1 %.
            assert!((stated / expected - 1.0).abs() < 0.05, "{halves:?}: {stated} for {expected}");
        }
    }
}
