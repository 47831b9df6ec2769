//! Estimates the error of exposed images under the probe lightings, as `--error` promises it.
//!
//! The truth is unknown, but independent samples of some blocks are unbiased. With a value `v` of the image and the
//! values `a`, `b` of two halves of such samples, the mean of `(v − a)(v − b)` is `(v − truth)²`, whatever their noise.
//! So noise, bias of the denoiser and loss by compression all count. A firefly in the samples is in one half only and
//! does not count.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use crate::denoise::{DenoisedSource, windows_of};
use crate::error::{Error, Result};
use crate::image::percentile;
use crate::light::{ExposedError, Job, LightBasis, PROBES, probe_lightings};
use crate::matrix::{BlockId, BlockSource, ColumnIndex, FactoredBlock, MatrixShape, TracedBlock};
use crate::resources::{Held, JobStage, MemoryNeed, PerThread, Progress, ResourceEstimate, Threads};
use crate::store::StoreReader;

/// Name of the stage that measures the noise of a stored matrix.
const MEASURING: &str = "measuring the noise";
/// Number of blocks from which the noise of a stored matrix is estimated.
const BLOCKS: usize = 24;
/// Luminance percentile that is exposed to white.
const WHITE: f64 = 0.95;

/// Side, in blocks, of the windows that are denoised separately.
pub(crate) const WINDOW: u32 = 3;

/// A block's image under the probe lightings, one after the other.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProbedBlock {
    values: Vec<f32>,
    /// Half the difference of the two halves of the samples; empty if unknown.
    noise: Vec<f32>,
}

/// Images of several blocks under the probe lightings.
pub(crate) type ProbedImages = BTreeMap<BlockId, ProbedBlock>;

impl ProbedBlock {
    /// The images of a block with all its entries.
    pub(crate) fn of(traced: &TracedBlock, probes: &[f32]) -> Self {
        let rows = traced.block.rows();
        let mut values = vec![0.0f32; PROBES * rows];
        for (image, weights) in values.chunks_exact_mut(rows).zip(probes.chunks_exact(traced.block.columns())) {
            for (entries, &weight) in traced.block.entries().chunks_exact(rows).zip(weights) {
                image.iter_mut().zip(entries).for_each(|(value, entry)| *value += weight * entry);
            }
        }
        Self { values, noise: traced.noise.as_ref().map_or(Vec::new(), |noise| noise.probes.clone()) }
    }

    /// The images of a block from its factors.
    pub(crate) fn of_factors(block: &FactoredBlock, probes: &[f32]) -> Self {
        let relit = |weights: &[f32]| {
            let weights = weights.iter().enumerate().map(|(column, &w)| (ColumnIndex(column as u32), [w; 3]));
            block.relight(weights).into_iter().map(|value| value as f32).collect::<Vec<_>>()
        };
        Self { values: probes.chunks_exact(block.columns).flat_map(relit).collect(), noise: Vec::new() }
    }
}

/// For each probe lighting the mean over pixels of `square(block, index, value)`, in units of white squared, without
/// clipped pixels. NaN for a lighting that lights nothing.
fn mean_squares(images: &ProbedImages, square: impl Fn(BlockId, usize, f32) -> f64) -> [f64; PROBES] {
    std::array::from_fn(|probe| {
        let each = images.iter().flat_map(|(&id, block)| {
            let rows = block.values.len() / PROBES;
            (probe * rows..(probe + 1) * rows).map(move |index| (id, index, block.values[index]))
        });
        let white = percentile(each.clone().map(|(.., value)| value.abs()).collect(), WHITE);
        let count = each.clone().count();
        let visible = each.filter(|(.., value)| value.abs() < white);
        let sum: f64 = visible.map(|(id, index, value)| square(id, index, value)).sum();
        if white > 0.0 { sum / (count as f64 * f64::from(white).powi(2)) } else { f64::NAN }
    })
}

/// Squared noise of the images, from the halves of their samples.
pub(crate) fn noise_squares(images: &ProbedImages) -> [f64; PROBES] {
    let noise = |id: BlockId, index: usize| images.get(&id).and_then(|block| block.noise.get(index)).copied();
    mean_squares(images, |id, index, _| noise(id, index).map_or(f64::NAN, |noise| f64::from(noise).powi(2)))
}

/// Squared errors of images by independent samples, see the module. For few pixels the estimate may be negative.
pub(crate) fn error_squares<'a>(
    images: &ProbedImages,
    references: impl IntoIterator<Item = &'a ProbedImages>,
) -> [f64; PROBES] {
    let (mut sums, mut count) = ([0.0; PROBES], 0.0f64);
    for reference in references {
        let squares = mean_squares(images, |id, index, value| match reference.get(&id) {
            Some(truth) if truth.noise.len() > index => {
                (f64::from(value) - f64::from(truth.values[index])).powi(2) - f64::from(truth.noise[index]).powi(2)
            }
            _ => f64::NAN,
        });
        sums.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
        count += 1.0;
    }
    sums.map(|sum| sum / count)
}

/// The squared errors by two independent references. The product of their noises has mean 0, so that no estimate of
/// noise must be subtracted. Its own noise is 0.7 of that of [`error_squares`] with both.
fn error_products(images: &ProbedImages, first: &ProbedImages, second: &ProbedImages) -> [f64; PROBES] {
    let value =
        |of: &ProbedImages, id: BlockId, index: usize| of.get(&id).and_then(|block| block.values.get(index)).copied();
    mean_squares(images, |id, index, own| match (value(first, id, index), value(second, id, index)) {
        (Some(a), Some(b)) => (f64::from(own) - f64::from(a)) * (f64::from(own) - f64::from(b)),
        _ => f64::NAN,
    })
}

/// The largest value that is not NaN; NaN if there is none.
pub(crate) fn worst(squares: &[f64; PROBES]) -> f64 {
    squares.iter().copied().fold(f64::NAN, f64::max)
}

/// `count` windows spread over the image. If possible, no two share a row or a column of windows.
pub(crate) fn spread_windows(shape: MatrixShape, count: usize) -> Vec<Vec<BlockId>> {
    let (across, down) = (shape.blocks_across().div_ceil(WINDOW), shape.blocks_down().div_ceil(WINDOW));
    let all = windows_of(shape, (WINDOW, WINDOW));
    if all.len() <= count {
        return all;
    }
    let mut chosen: Vec<usize> = (0..count).map(|i| spread(i, count, across as usize, down as usize)).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|index| all[index].clone()).collect()
}

/// `count` blocks, evenly spread over `blocks`.
pub(crate) fn spread_blocks(shape: MatrixShape, blocks: Vec<BlockId>, count: usize) -> Vec<BlockId> {
    if blocks.len() <= count {
        return blocks;
    }
    let across = shape.blocks_across() as usize;
    let mut chosen: Vec<_> = (0..count)
        .map(|i| blocks[spread(i, count, across, blocks.len().div_ceil(across)).min(blocks.len() - 1)])
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Index of the `i`-th of `count` points on a grid: evenly spaced down it, and by the golden section across it.
fn spread(i: usize, count: usize, across: usize, down: usize) -> usize {
    let turn = (0.5 + i as f64 * 0.618_033_988_749_895).fract();
    (2 * i + 1) * down / (2 * count) * across + (turn * across as f64) as usize
}

/// The error that a render was asked for, and independent samples of some blocks to measure it.
#[derive(Debug)]
pub struct ErrorMonitor {
    /// The error asked for; `None` if a time was asked for.
    pub(crate) asked: Option<f64>,
    /// Whether the error is promised for denoised images, or for the matrix as it is.
    pub(crate) denoises: bool,
    pub(crate) windows: Vec<Vec<BlockId>>,
    pub(crate) references: [ProbedImages; 2],
    /// Images of the packed container, as far as its blocks are written.
    pub(crate) packed: Mutex<ProbedImages>,
}

impl MemoryNeed for ErrorMonitor {
    /// All that it holds, including the images of the container.
    fn fixed_bytes(&self) -> u64 {
        let held =
            |images: &ProbedImages| images.values().map(|block| block.values.len() + block.noise.len()).sum::<usize>();
        let seen = held(&self.references[0]) / 2;
        4 * (self.references.iter().map(held).sum::<usize>() + seen) as u64
    }
}

impl ErrorMonitor {
    /// Whether the error is promised for denoised images, as a container holds them, or for the matrix as it is.
    pub fn denoises(&self) -> bool {
        self.denoises
    }

    /// The number of samples that would reach an error that was missed by far; `None` if it was reached. It assumes the
    /// usual slowest fall of the error, with the square root of the samples.
    pub fn samples_instead(error: &ExposedError, samples: u32) -> Option<u32> {
        let ratio = f64::from(error.reached) / f64::from(error.asked);
        let pairs = (f64::from(samples) * ratio.powi(2) / 2.0).ceil() as u32;
        (error.asked > 0.0 && ratio > 1.25).then(|| 2 * pairs.min(u32::MAX / 2))
    }

    /// Records the images of a written block.
    pub(crate) fn see(&self, id: BlockId, block: &FactoredBlock, basis: &LightBasis) {
        if self.windows.iter().any(|window| window.contains(&id)) {
            let probed = ProbedBlock::of_factors(block, &probe_lightings(basis));
            self.packed.lock().unwrap_or_else(PoisonError::into_inner).insert(id, probed);
        }
    }

    /// The error reached by a container of which all blocks were recorded.
    pub(crate) fn reached_packed(&self) -> ExposedError {
        self.reached(&self.packed.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn reached(&self, images: &ProbedImages) -> ExposedError {
        let [first, second] = &self.references;
        let square = worst(&error_products(images, first, second));
        ExposedError { asked: self.asked.unwrap_or(0.0) as f32, reached: square.max(0.0).sqrt() as f32 }
    }

    /// The error reached by a stored matrix, as it is or once it is denoised.
    ///
    /// # Errors
    /// Those of reading and of the disk; [`Error::Interrupted`].
    pub fn reached_by(
        &self,
        matrix: &StoreReader,
        memory_bytes: Option<u64>,
        watch: &dyn Progress,
    ) -> Result<ExposedError> {
        let job = matrix.job();
        let images = Held(Blocks::images_need_bytes(job.shape, self.windows.concat().len()));
        let reading = ResourceEstimate::of(&[self, &images, matrix, &PerThread(job.shape.max_block_bytes())]);
        let need = if self.denoises { DenoisedSource::need_of_windows(job, reading, WINDOW) } else { reading };
        let threads = Threads::new(need.threads_within("measuring the error", memory_bytes)?)?;
        let source = Blocks { source: matrix, job, windows: &self.windows };
        Ok(self.reached(&source.images(self.denoises, &threads, "measuring the error", watch)?.shown))
    }
}

/// Blocks of windows of a matrix, from wherever it comes.
pub(crate) struct Blocks<'a> {
    pub(crate) source: &'a dyn BlockSource,
    pub(crate) job: &'a Job,
    pub(crate) windows: &'a [Vec<BlockId>],
}

/// Images of windows.
pub(crate) struct WindowImages {
    /// Images of the samples, not denoised.
    pub(crate) sampled: ProbedImages,
    /// The displayed images: denoised if asked for.
    pub(crate) shown: ProbedImages,
    /// Seconds that denoising took.
    pub(crate) denoising_seconds: f64,
}

impl Blocks<'_> {
    /// Bytes of the images of `blocks` blocks, for three runs with their noise.
    pub(crate) fn images_need_bytes(shape: MatrixShape, blocks: usize) -> u64 {
        6 * 4 * PROBES as u64 * shape.max_block_rows() as u64 * blocks as u64
    }

    /// Reads or makes the blocks and shows their images.
    ///
    /// # Errors
    /// Those of the source and of the disk; [`Error::Interrupted`].
    pub(crate) fn images(
        &self,
        denoises: bool,
        threads: &Threads,
        stage: &str,
        watch: &dyn Progress,
    ) -> Result<WindowImages> {
        let (probes, scales) = (probe_lightings(&self.job.basis), self.job.basis.column_scales());
        let sampled = Mutex::new(ProbedImages::new());
        let make = |id: BlockId, block: &mut TracedBlock| -> Result<u64> {
            self.source.read_block(id, block)?;
            block.divide_columns(scales);
            let probed = ProbedBlock::of(block, &probes);
            sampled.lock().unwrap_or_else(PoisonError::into_inner).insert(id, probed);
            Ok(0)
        };
        if !denoises {
            let blocks = self.windows.concat();
            watch.begin(stage, blocks.len() as u64, "blocks");
            let one = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
                if watch.interrupted() {
                    return Err(Error::interrupted("nothing was begun"));
                }
                make(id, block)?;
                watch.advance(1, 0, "blocks");
                Ok(())
            };
            let done: Result<()> = threads.run(|| blocks.par_iter().map_init(TracedBlock::default, one).collect());
            watch.end();
            done?;
            let sampled = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
            return Ok(WindowImages { shown: sampled.clone(), sampled, denoising_seconds: 0.0 });
        }
        let mut denoised = DenoisedSource::of_windows(self.job, self.windows.to_vec())?;
        denoised.gather(threads, JobStage { name: stage, work_unit: "blocks" }, watch, make)?;
        let begun = Instant::now();
        denoised.filter(threads, watch)?;
        denoised.fit(self.job, watch)?;
        let denoising_seconds = begun.elapsed().as_secs_f64();
        let mut shown = ProbedImages::new();
        let mut block = TracedBlock::default();
        for &id in self.windows.iter().flatten() {
            denoised.read_block(id, &mut block)?;
            shown.insert(id, ProbedBlock::of(&block, &probes));
        }
        let sampled = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(WindowImages { sampled, shown, denoising_seconds })
    }
}

/// The error of exposed images of a stored matrix without denoising, from its own noise, as a fraction of white: see
/// [`ExposedError`]. It is estimated from some blocks; `None` if the matrix does not know its noise.
///
/// # Errors
/// Those of reading; the memory is too small; [`Error::Interrupted`].
pub fn expected_error(matrix: &StoreReader, memory_bytes: Option<u64>, watch: &dyn Progress) -> Result<Option<f64>> {
    let shape = BlockSource::shape(matrix);
    let committed = shape.blocks().filter(|&id| matrix.is_committed(id)).collect();
    let blocks = [spread_blocks(shape, committed, BLOCKS)];
    let images = Held(Blocks::images_need_bytes(shape, blocks[0].len()));
    let need = ResourceEstimate::of(&[&images, matrix, &PerThread(shape.max_block_bytes())]);
    let threads = Threads::new(need.threads_within(MEASURING, memory_bytes)?)?;
    let blocks = Blocks { source: matrix, job: matrix.job(), windows: &blocks };
    let images = blocks.images(false, &threads, MEASURING, watch)?;
    Ok(Some(worst(&noise_squares(&images.sampled)).sqrt()).filter(|error| error.is_finite()))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn windows_stand_in_no_line() {
        let shape = MatrixShape::new(1024, 768, 3, 32).unwrap();
        let firsts: Vec<u32> = spread_windows(shape, 4).iter().map(|window| window[0].0).collect();
        assert_eq!(firsts.len(), 4);
        for (i, a) in firsts.iter().enumerate() {
            assert!(firsts[i + 1..].iter().all(|b| a / 32 != b / 32 && a % 32 != b % 32), "{firsts:?}");
        }
        let small = MatrixShape::new(64, 64, 3, 32).unwrap();
        assert_eq!(spread_windows(small, 4).concat().len(), 4);
        let blocks = spread_blocks(shape, shape.blocks().collect(), 24);
        let columns: std::collections::BTreeSet<u32> = blocks.iter().map(|id| id.0 % 32).collect();
        assert!(blocks.len() == 24 && columns.len() > 12, "{blocks:?}");
    }

    /// Noise that both references do not share cancels in the mean of the products.
    #[test]
    fn the_error_is_seen_through_the_noise_of_the_samples() {
        let rows = 30_000;
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let grain: Vec<f32> = (0..2 * PROBES * rows).map(|_| random.random::<f32>() - 0.5).collect();
        let truth = |row: usize| 1.0 + (row % 100) as f32 / 100.0;
        let image = |value: &dyn Fn(usize) -> f32, noise: &dyn Fn(usize) -> f32| {
            let all = |each: &dyn Fn(usize) -> f32| (0..PROBES * rows).map(each).collect::<Vec<_>>();
            ProbedImages::from([(BlockId(0), ProbedBlock { values: all(value), noise: all(noise) })])
        };
        // An error of ±0.05 in an image whose white is near 2; samples have twice as much noise.
        let shown = image(&|i| truth(i % rows) + if i % 2 == 0 { 0.05 } else { -0.05 }, &|_| 0.0);
        let (a, b) = (|i: usize| 0.4 * grain[2 * i], |i: usize| 0.4 * grain[2 * i + 1]);
        let samples = image(&|i| truth(i % rows) + 0.5 * (a(i) + b(i)), &|i| 0.5 * (a(i) - b(i)));
        let error = worst(&error_squares(&shown, [&samples])).sqrt();
        // The 95 % of the pixels that are not clipped.
        assert!((error / (0.05 * 0.95f64.sqrt() / 1.99) - 1.0).abs() < 0.15, "{error}");
    }
}
