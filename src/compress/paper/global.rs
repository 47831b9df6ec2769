//! Algorithms 1–4 of the paper (§3.2) over the whole matrix: one choice of rows and columns for all blocks.
//!
//! The matrix is larger than memory, so it is read in passes, block by block:
//!
//! 1. k-means over columns (Algorithm 1) needs the sampled rows alone: the blocks that hold them are read.
//!    k-means over rows (Algorithms 2 and 4) begins with a sample of rows, k-means++ and Lloyd's iteration on it,
//! 2. then takes every block once as part of a mini-batch (Sculley 2010, each centre the running mean of its members),
//! 3. and looks for the row nearest to each centre. Where the sample holds all rows, 2 and 3 need no pass.
//! 4. The blocks that hold chosen rows are read for them: `R`, and in it the crossing `W`.
//!
//! `U R = W⁺ R` is kept; `C` is never held as a whole: each block brings its own rows of it when it is analysed.

use faer::{Mat, MatRef};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::cur::{CurSelection, Plan, at_random, plan, through_core};
use super::kmeans::{Centres, nearest_to_centres};
use crate::compress::CompressSettings;
use crate::compress::sanitise::sanitise;
use crate::error::Result;
use crate::matrix::{BlockId, BlockSource, BlockView, MatrixShape, TracedBlock};

/// Blocks of a mini-batch: read together, by as many threads as there are, and added up in their order.
const BATCH_BLOCKS: usize = 32;

/// A choice of rows and columns for the whole matrix, with what every block has in common.
#[derive(Clone, Debug)]
pub(in crate::compress) struct GlobalCur {
    /// Chosen columns and rows; rows are numbered through all blocks in order.
    pub(in crate::compress) chosen: CurSelection,
    /// `U R`: chosen columns × columns.
    pub(in crate::compress) right: Mat<f32>,
}

/// Bytes that [`choose`] holds at most, beside the blocks at hand.
pub(in crate::compress) fn needs_bytes(shape: MatrixShape, settings: &CompressSettings) -> u64 {
    let (n, k) = (shape.columns() as u64, (settings.rank as u64).min(shape.columns() as u64));
    let rows = (k as f64 * settings.rows_per_column).ceil() as u64 + settings.rounds as u64;
    let sample = (settings.sample_rows as u64).min(shape.rows());
    // The sample twice, by all columns and by a round's; its distances; sums of a batch; R and its solution in f64.
    let kmeans = 4 * sample * (2 * k + rows) + BATCH_BLOCKS as u64 * rows * (8 * k + 32);
    kmeans + rows * (20 * n + 16 * k) + k * 24 * n + 24 * u64::from(shape.block_count())
}

/// Chooses rows and columns of the whole matrix; on the current thread pool, the same for any number of threads. A
/// matrix of one block gives what [`Compressor`](crate::compress::Compressor) chooses for that block.
///
/// # Errors
/// Those of reading; a method without a global form.
pub(in crate::compress) fn choose(source: &dyn BlockSource, settings: &CompressSettings) -> Result<GlobalCur> {
    crate::compress::settings::check_global(settings)?;
    let matrix = Matrix::new(source);
    let mut random = Pcg64Mcg::seed_from_u64(settings.seed ^ super::cur::SEED);
    let iterations = settings.kmeans_iterations;
    let chosen = match plan(matrix.rows(), matrix.shape.columns(), settings, &mut random) {
        Plan::Both(chosen) => chosen,
        Plan::ByRows { rows, columns } => {
            let points = matrix.rows_of(&rows, None)?.transpose().to_owned();
            CurSelection { columns: nearest_to_centres(points.as_ref(), columns, iterations, &mut random), rows }
        }
        Plan::ByColumns { rounds } => matrix.rows_by_kmeans(rounds, settings, &mut random)?,
    };
    let r = matrix.rows_of(&chosen.rows, None)?;
    let r = r.transpose();
    let w = Mat::from_fn(chosen.rows.len(), chosen.columns.len(), |i, k| f64::from(r[(i, chosen.columns[k])]));
    let right = through_core(w.as_ref(), r, settings.core, settings.truncation);
    Ok(GlobalCur { chosen, right })
}

impl GlobalCur {
    /// A block's rows of `C`: rows × chosen columns.
    pub(in crate::compress) fn left(&self, a: MatRef<'_, f32>) -> Mat<f32> {
        Mat::from_fn(a.nrows(), self.chosen.columns.len(), |i, k| a[(i, self.chosen.columns[k])])
    }
}

/// A matrix that is read block by block, with rows numbered through all blocks.
struct Matrix<'a> {
    source: &'a dyn BlockSource,
    shape: MatrixShape,
    /// First row of each block, and the number of rows.
    first: Vec<usize>,
}

impl<'a> Matrix<'a> {
    fn new(source: &'a dyn BlockSource) -> Self {
        let shape = source.shape();
        let mut first = vec![0];
        first.extend(shape.blocks().scan(0, |end, id| {
            *end += shape.rect(id).rows();
            Some(*end)
        }));
        Self { source, shape, first }
    }

    fn rows(&self) -> usize {
        self.first[self.first.len() - 1]
    }

    /// Processes blocks in parallel; results come in the order of `blocks`.
    fn each<T: Send>(&self, blocks: &[BlockId], work: impl Fn(BlockId, BlockView<'_>) -> T + Sync) -> Result<Vec<T>> {
        let one = |block: &mut TracedBlock, &id: &BlockId| {
            let mut done = None;
            self.source.visit_block(id, block, &mut |lent| {
                let view = lent.view();
                let (entries, ..) = sanitise(view);
                done = Some(work(id, BlockView::new(view.rows(), view.columns(), &entries)));
                Ok(())
            })?;
            Ok(done.expect("a source that has no error to report gives the block"))
        };
        blocks.par_iter().map_init(TracedBlock::default, one).collect()
    }

    /// Rows (rising), each as a column: columns (all where none are named) × rows.
    fn rows_of(&self, rows: &[usize], columns: Option<&[usize]>) -> Result<Mat<f32>> {
        let span = |id: BlockId| {
            let at = |row: usize| rows.partition_point(|&r| r < row);
            at(self.first[id.index()])..at(self.first[id.index() + 1])
        };
        let blocks: Vec<BlockId> = self.shape.blocks().filter(|&id| !span(id).is_empty()).collect();
        let parts = self.each(&blocks, |id, block| {
            let inside = rows[span(id)].iter().map(|row| row - self.first[id.index()]);
            let mut part = Vec::new();
            for row in inside {
                match columns {
                    Some(columns) => part.extend(columns.iter().map(|&j| block.at(row, j))),
                    None => part.extend((0..block.columns()).map(|j| block.at(row, j))),
                }
            }
            part
        })?;
        let height = columns.map_or(self.shape.columns(), <[usize]>::len);
        let mut found = Mat::zeros(height, rows.len());
        let values = parts.into_iter().flatten();
        for (at, value) in values.enumerate() {
            found[(at % height, at / height)] = value;
        }
        Ok(found)
    }

    /// Algorithms 2 and 4: for each round, k-means over the rows as its columns show them.
    fn rows_by_kmeans(
        &self,
        rounds: Vec<(Vec<usize>, usize)>,
        settings: &CompressSettings,
        random: &mut Pcg64Mcg,
    ) -> Result<CurSelection> {
        let columns: Vec<usize> = rounds.iter().flat_map(|(columns, _)| columns.iter().copied()).collect();
        let whole = self.rows() <= settings.sample_rows;
        let sample =
            if whole { (0..self.rows()).collect() } else { at_random(self.rows(), settings.sample_rows, random) };
        let points = self.rows_of(&sample, Some(&columns))?;
        let mut clusters = Vec::new();
        let mut rows = Vec::new();
        let mut above = 0;
        for (columns, count) in &rounds {
            let points = points.as_ref().subrows(above, columns.len()).to_owned();
            above += columns.len();
            if whole {
                rows.extend(nearest_to_centres(points.as_ref(), *count, settings.kmeans_iterations, random));
            } else {
                clusters.push(Centres::new(points.as_ref(), *count, settings.kmeans_iterations, random));
            }
        }
        drop(points);
        if !whole {
            rows = self.nearest_rows(&rounds, clusters)?;
        }
        rows.sort_unstable();
        rows.dedup();
        let mut columns = columns;
        columns.sort_unstable();
        Ok(CurSelection { columns, rows })
    }

    /// One pass of mini-batches over all blocks, and one for the row nearest to each centre.
    fn nearest_rows(&self, rounds: &[(Vec<usize>, usize)], mut clusters: Vec<Centres>) -> Result<Vec<usize>> {
        let points = |block: BlockView<'_>, columns: &[usize]| {
            Mat::from_fn(columns.len(), block.rows(), |d, row| block.at(row, columns[d]))
        };
        let blocks: Vec<BlockId> = self.shape.blocks().collect();
        for batch in blocks.chunks(BATCH_BLOCKS) {
            let sums = self.each(batch, |_, block| {
                let of = |((columns, _), clusters): (&(Vec<usize>, usize), &Centres)| {
                    clusters.sums(points(block, columns).as_ref())
                };
                rounds.iter().zip(&clusters).map(of).collect::<Vec<_>>()
            })?;
            for (r, clusters) in clusters.iter_mut().enumerate() {
                clusters.follow(sums.iter().map(|sums| &sums[r]));
            }
        }
        let mut nearest: Vec<Vec<(f32, usize)>> =
            clusters.iter().map(|clusters| vec![(f32::INFINITY, usize::MAX); clusters.count()]).collect();
        for batch in blocks.chunks(BATCH_BLOCKS) {
            let found = self.each(batch, |id, block| {
                let of = |((columns, _), clusters): (&(Vec<usize>, usize), &Centres)| {
                    clusters.nearest(points(block, columns).as_ref())
                };
                (id, rounds.iter().zip(&clusters).map(of).collect::<Vec<_>>())
            })?;
            for (id, found) in found {
                for (best, found) in nearest.iter_mut().flatten().zip(found.into_iter().flatten()) {
                    if found.0 < best.0 {
                        *best = (found.0, self.first[id.index()] + found.1);
                    }
                }
            }
        }
        Ok(nearest.into_iter().flatten().map(|(_, row)| row).filter(|&row| row != usize::MAX).collect())
    }
}
