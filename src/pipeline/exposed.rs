//! How far exposed images are from the truth, under the probe lightings: what `--error` asks for.
//!
//! The truth is not known, but samples of some blocks that the images have no part in are unbiased: with `v` a value of the image
//! and `a`, `b` those of two halves of such samples, `(v − a)(v − b)` is `(v − truth)²` in the mean, whatever their noise. So noise,
//! what cleaning blurs and what compression leaves out all count, and a firefly in the samples, which is in one half only,
//! does not.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;

use super::analysis::PackStage;
use super::clean::{Cleaned, windows_of};
use crate::error::{Error, Result};
use crate::host::{Need, PROGRAM_BYTES, Threads, Watch};
use crate::image::percentile;
use crate::light::{ExposedError, Job, LightBasis, PROBES, probe_lightings};
use crate::matrix::{BlockId, BlockSource, ColumnIndex, FactoredBlock, MatrixShape, TracedBlock};
use crate::store::{self, StoreReader};

/// Luminance percentile that an image is exposed by.
const WHITE: f64 = 0.95;

/// Blocks along the side of the windows that are cleaned apart from the rest of the picture.
pub(super) const WINDOW: u32 = 3;

/// A block's image under the probe lightings, one after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct ProbedBlock {
    values: Vec<f32>,
    /// Half the difference of the two halves of the samples; empty where that is not known.
    noise: Vec<f32>,
}

/// Those of some blocks.
pub(super) type Images = BTreeMap<BlockId, ProbedBlock>;

impl ProbedBlock {
    /// Of a block with all its entries.
    pub(super) fn of(traced: &TracedBlock, probes: &[f32]) -> Self {
        let rows = traced.block.rows();
        let mut values = vec![0.0f32; PROBES * rows];
        for (image, weights) in values.chunks_exact_mut(rows).zip(probes.chunks_exact(traced.block.columns())) {
            for (entries, &weight) in traced.block.entries().chunks_exact(rows).zip(weights) {
                image.iter_mut().zip(entries).for_each(|(value, entry)| *value += weight * entry);
            }
        }
        Self { values, noise: traced.noise.as_ref().map_or(Vec::new(), |noise| noise.probes.clone()) }
    }

    /// Of a block's factors.
    pub(super) fn of_factors(block: &FactoredBlock, probes: &[f32]) -> Self {
        let relit = |weights: &[f32]| {
            let weights = weights.iter().enumerate().map(|(column, &w)| (ColumnIndex(column as u32), [w; 3]));
            block.relight(weights).into_iter().map(|value| value as f32).collect::<Vec<_>>()
        };
        Self { values: probes.chunks_exact(block.columns).flat_map(relit).collect(), noise: Vec::new() }
    }
}

/// For each probe lighting the mean over the pixels of `square(block, index, value)`, those beyond white left out, in units of white
/// squared; NaN where it lights nothing.
fn mean_squares(images: &Images, square: impl Fn(BlockId, usize, f32) -> f64) -> [f64; PROBES] {
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

/// The squares of an image's own noise, as the halves of its samples show it.
pub(super) fn noise_squares(images: &Images) -> [f64; PROBES] {
    let noise = |id: BlockId, index: usize| images.get(&id).and_then(|block| block.noise.get(index)).copied();
    mean_squares(images, |id, index, _| noise(id, index).map_or(f64::NAN, |noise| f64::from(noise).powi(2)))
}

/// The squares of an image's error, by independent samples: see the module. Of few pixels they may come out below 0.
pub(super) fn error_squares<'a>(images: &Images, references: impl IntoIterator<Item = &'a Images>) -> [f64; PROBES] {
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

/// The same by two independent references at once: their noises are multiplied with each other, and so have the mean 0 that no
/// estimate of them has to be taken off for. Its own noise is 0.7 of that of [`error_squares`] with both.
fn error_products(images: &Images, first: &Images, second: &Images) -> [f64; PROBES] {
    let value = |of: &Images, id: BlockId, index: usize| of.get(&id).and_then(|block| block.values.get(index)).copied();
    mean_squares(images, |id, index, own| match (value(first, id, index), value(second, id, index)) {
        (Some(a), Some(b)) => (f64::from(own) - f64::from(a)) * (f64::from(own) - f64::from(b)),
        _ => f64::NAN,
    })
}

/// The largest of those that are known; NaN where none is.
pub(super) fn worst(squares: &[f64; PROBES]) -> f64 {
    squares.iter().copied().fold(f64::NAN, f64::max)
}

/// Some windows that stand for the picture, spread over it so that no two share a row or a column of windows where that can be.
pub(super) fn spread_windows(shape: MatrixShape, count: usize) -> Vec<Vec<BlockId>> {
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

/// Some blocks that stand for all of these.
pub(super) fn spread_blocks(shape: MatrixShape, blocks: Vec<BlockId>, count: usize) -> Vec<BlockId> {
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

/// Index of the `i`-th of `count` places on a grid: evenly down it, and across by the golden section, so that they stand in no line.
fn spread(i: usize, count: usize, across: usize, down: usize) -> usize {
    let turn = (0.5 + i as f64 * 0.618_033_988_749_895).fract();
    (2 * i + 1) * down / (2 * count) * across + (turn * across as f64) as usize
}

/// What a render was asked for, and samples of some blocks, independent of its own, to hold it to that.
#[derive(Debug)]
pub struct Promise {
    /// None where that was a time.
    pub(super) asked: Option<f64>,
    /// Whether it is promised of cleaned images; else of the matrix as it is.
    pub(super) cleans: bool,
    pub(super) windows: Vec<Vec<BlockId>>,
    pub(super) references: [Images; 2],
    /// What has been seen of the container that is packed.
    pub(super) packed: Mutex<Images>,
}

impl Promise {
    /// Whether it is promised of cleaned images, as a container holds them, or of the matrix as it is.
    pub fn cleans(&self) -> bool {
        self.cleans
    }

    /// Bytes that it holds, with what it will see of a container.
    pub fn needs_bytes(&self) -> u64 {
        let held = |images: &Images| images.values().map(|block| block.values.len() + block.noise.len()).sum::<usize>();
        let seen = held(&self.references[0]) / 2;
        4 * (self.references.iter().map(held).sum::<usize>() + seen) as u64
    }

    /// Samples that would do, where so many have missed what was promised by far; none where they have not. By the slowest fall of
    /// the error that is usual: with the root of the samples.
    pub fn samples_instead(error: &ExposedError, samples: u32) -> Option<u32> {
        let ratio = f64::from(error.reached) / f64::from(error.asked);
        let pairs = (f64::from(samples) * ratio.powi(2) / 2.0).ceil() as u32;
        (error.asked > 0.0 && ratio > 1.25).then(|| 2 * pairs.min(u32::MAX / 2))
    }

    /// Notes how a block of a container came out.
    pub(super) fn see(&self, id: BlockId, block: &FactoredBlock, basis: &LightBasis) {
        if self.windows.iter().any(|window| window.contains(&id)) {
            let probed = ProbedBlock::of_factors(block, &probe_lightings(basis));
            self.packed.lock().unwrap_or_else(PoisonError::into_inner).insert(id, probed);
        }
    }

    /// What the container has reached of which all blocks were seen.
    pub(super) fn reached_packed(&self) -> ExposedError {
        self.reached(&self.packed.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn reached(&self, images: &Images) -> ExposedError {
        let [first, second] = &self.references;
        let square = worst(&error_products(images, first, second));
        ExposedError { asked: self.asked.unwrap_or(0.0) as f32, reached: square.max(0.0).sqrt() as f32 }
    }

    /// What a stored matrix has reached: as it is, or as it will be when it is cleaned.
    ///
    /// # Errors
    /// Those of reading and of the disk; [`Error::Interrupted`].
    pub fn reached_by(
        &self,
        matrix: &StoreReader,
        memory_bytes: Option<u64>,
        watch: &dyn Watch,
    ) -> Result<ExposedError> {
        let job = matrix.job();
        let reading = reading_need_bytes(matrix);
        let cleaning = match self.cleans {
            true => Cleaned::need_of_windows(job, reading, WINDOW),
            false => Need { per_thread_bytes: reading, ..Need::default() },
        };
        let images = Blocks::images_need_bytes(job.shape, self.windows.concat().len());
        let fixed_bytes = PROGRAM_BYTES + self.needs_bytes() + images + cleaning.fixed_bytes;
        let need = Need { fixed_bytes, ..cleaning };
        let threads = Threads::new(need.threads_within("measuring the error", memory_bytes)?)?;
        let source = Blocks { source: matrix, job, windows: &self.windows };
        Ok(self.reached(&source.images(self.cleans, &threads, "measuring the error", watch)?.shown))
    }
}

/// Bytes that a thread takes to read a block of a stored matrix, with the block.
pub(super) fn reading_need_bytes(matrix: &StoreReader) -> u64 {
    let (job, shape) = (matrix.job(), BlockSource::shape(matrix));
    let block = size_of::<f32>() as u64 * shape.max_block_rows() as u64 * shape.columns() as u64;
    store::requirements(job, &matrix.options()).memory_bytes + block
}

/// Blocks of windows of a matrix, from wherever it comes.
pub(super) struct Blocks<'a> {
    pub(super) source: &'a dyn BlockSource,
    pub(super) job: &'a Job,
    pub(super) windows: &'a [Vec<BlockId>],
}

/// Images of windows.
pub(super) struct WindowImages {
    /// As the samples have them.
    pub(super) sampled: Images,
    /// As they are looked at: cleaned where that is asked for.
    pub(super) shown: Images,
    /// Seconds that cleaning took.
    pub(super) cleaning_seconds: f64,
}

impl Blocks<'_> {
    /// Bytes that images of so many blocks take, of three runs, each with its noise.
    pub(super) fn images_need_bytes(shape: MatrixShape, blocks: usize) -> u64 {
        6 * 4 * PROBES as u64 * shape.max_block_rows() as u64 * blocks as u64
    }

    /// Reads or makes the blocks and shows their images.
    ///
    /// # Errors
    /// Those of the source and of the disk; [`Error::Interrupted`].
    pub(super) fn images(
        &self,
        cleans: bool,
        threads: &Threads,
        stage: &str,
        watch: &dyn Watch,
    ) -> Result<WindowImages> {
        let (probes, scales) = (probe_lightings(&self.job.basis), self.job.basis.column_scales());
        let sampled = Mutex::new(Images::new());
        let make = |id: BlockId, block: &mut TracedBlock| -> Result<u64> {
            self.source.read_block(id, block)?;
            block.divide_columns(scales);
            let probed = ProbedBlock::of(block, &probes);
            sampled.lock().unwrap_or_else(PoisonError::into_inner).insert(id, probed);
            Ok(0)
        };
        if !cleans {
            let blocks = self.windows.concat();
            watch.begin(stage, blocks.len() as u64, "blocks");
            let one = |block: &mut TracedBlock, &id: &BlockId| -> Result<()> {
                if watch.interrupted() {
                    return Err(Error::Interrupted("nothing was begun".to_owned()));
                }
                make(id, block)?;
                watch.advance(1, 0, "blocks");
                Ok(())
            };
            let done: Result<()> = threads.run(|| blocks.par_iter().map_init(TracedBlock::default, one).collect());
            watch.end();
            done?;
            let sampled = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
            return Ok(WindowImages { shown: sampled.clone(), sampled, cleaning_seconds: 0.0 });
        }
        let mut cleaned = Cleaned::of_windows(self.job, self.windows.to_vec())?;
        cleaned.gather(threads, PackStage { name: stage, work_unit: "blocks" }, watch, make)?;
        let begun = Instant::now();
        cleaned.filter(threads, watch)?;
        cleaned.fit(watch)?;
        let cleaning_seconds = begun.elapsed().as_secs_f64();
        let mut shown = Images::new();
        let mut block = TracedBlock::default();
        for &id in self.windows.iter().flatten() {
            cleaned.read_block(id, &mut block)?;
            shown.insert(id, ProbedBlock::of(&block, &probes));
        }
        let sampled = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(WindowImages { sampled, shown, cleaning_seconds })
    }
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

    /// Noise that the samples' halves share with nothing leaves the mean of the products alone.
    #[test]
    fn the_error_is_seen_through_the_noise_of_the_samples() {
        let rows = 30_000;
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let grain: Vec<f32> = (0..2 * PROBES * rows).map(|_| random.random::<f32>() - 0.5).collect();
        let truth = |row: usize| 1.0 + (row % 100) as f32 / 100.0;
        let image = |value: &dyn Fn(usize) -> f32, noise: &dyn Fn(usize) -> f32| {
            let all = |each: &dyn Fn(usize) -> f32| (0..PROBES * rows).map(each).collect::<Vec<_>>();
            Images::from([(BlockId(0), ProbedBlock { values: all(value), noise: all(noise) })])
        };
        // An error of 0.05 up and down, of an image whose white is near 2; samples with noise of twice its size.
        let shown = image(&|i| truth(i % rows) + if i % 2 == 0 { 0.05 } else { -0.05 }, &|_| 0.0);
        let (a, b) = (|i: usize| 0.4 * grain[2 * i], |i: usize| 0.4 * grain[2 * i + 1]);
        let samples = image(&|i| truth(i % rows) + 0.5 * (a(i) + b(i)), &|i| 0.5 * (a(i) - b(i)));
        let error = worst(&error_squares(&shown, [&samples])).sqrt();
        // Of the 95 % that are not beyond white.
        assert!((error / (0.05 * 0.95f64.sqrt() / 1.99) - 1.0).abs() < 0.15, "{error}");
    }
}
