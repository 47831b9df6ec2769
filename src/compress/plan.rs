//! What is decided before blocks are analysed.

use faer::MatRef;
use rayon::prelude::*;

use super::candidate::CandidateSummary;
use super::nlm::WINDOW_PIXELS;
use super::paper::global;
use super::range::{PriorWeights, SKETCH_ROWS};
use super::{CompressSettings, Cut, Method, PriorChoice, Scope, column_similarity, cut};
use crate::error::{Error, Result};
use crate::light::{LightBasis, LightingPrior, probe_lightings};
use crate::matrix::{BlockSource, MatrixShape, TracedBlock};
use crate::resources::MemoryNeed;

/// A compressor before blocks are analysed: its settings, the lightings that errors are weighed by, what it takes, and how a cut is
/// chosen. It becomes a [`Compressor`](super::Compressor) by [`for_blocks`](Self::for_blocks) or
/// [`choose_globally`](Self::choose_globally).
pub struct CompressorPlan {
    pub(super) settings: CompressSettings,
    pub(super) shape: MatrixShape,
    pub(super) weights: PriorWeights,
    /// Diagonal of `K`.
    pub(super) variances: Vec<f32>,
    /// The probe lightings that noise is kept under: columns × probes, column-major.
    pub(super) probes: Vec<f32>,
}

impl MemoryNeed for CompressorPlan {
    /// What [`choose_globally`](Self::choose_globally) holds beside the blocks at hand, and what it keeps.
    fn fixed_bytes(&self) -> u64 {
        if self.settings.scope == Scope::Global { global::needs_bytes(self.shape, &self.settings) } else { 0 }
    }

    /// One call of [`analyse`](super::Compressor::analyse) beside the block itself, the compressor and a candidate.
    fn thread_bytes(&self) -> u64 {
        Self::needs_bytes_for(self.shape, &self.settings)
    }
}

impl CompressorPlan {
    /// Values that it holds for each column at most: the prior's factor, the lightings of the sketch and the probes.
    pub const COLUMN_VALUES: u64 = 256;

    /// For matrices of this shape over this basis.
    ///
    /// # Errors
    /// Settings out of range, or a basis with another number of columns than the matrix.
    pub fn new(basis: &LightBasis, shape: MatrixShape, settings: CompressSettings) -> Result<Self> {
        settings.check()?;
        let n = shape.columns();
        if basis.column_count() != n {
            let problem = format!("describes {} columns, the matrix has {n}", basis.column_count());
            return Err(Error::input("light basis", problem, "take the basis that the matrix was made with"));
        }
        let prior = match settings.prior {
            PriorChoice::Lighting => LightingPrior::of_basis(basis),
            PriorChoice::Flat => LightingPrior::flat(n),
        };
        Ok(Self::with_prior(basis, shape, settings, prior))
    }

    /// This, for lightings of one light alone as well: see [`LightingPrior::of_lights_alone`].
    #[must_use]
    pub fn for_lights_alone(self, basis: &LightBasis, shares: &[f64]) -> Self {
        match self.settings.prior {
            PriorChoice::Flat => self,
            PriorChoice::Lighting => {
                let prior = LightingPrior::of_lights_alone(basis, shares);
                Self::with_prior(basis, self.shape, self.settings, prior)
            }
        }
    }

    /// Where nothing tells how lights stand to each other: takes those for near that make images which are alike. At most one
    /// pass over the blocks, on the current thread pool; the same for any number of threads. Does nothing where
    /// [`asks_images`](Self::asks_images) does not.
    ///
    /// # Errors
    /// Those of reading.
    pub fn ask_images(self, basis: &LightBasis, source: &dyn BlockSource) -> Result<Self> {
        if !self.asks_images(basis) {
            return Ok(self);
        }
        let blocks = column_similarity::looked_at(self.shape);
        let coarse = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
            source.read_block(id, traced)?;
            Ok(column_similarity::coarse(traced.block.view(), self.shape.rect(id), blocks.len()))
        });
        let cells = coarse.collect::<Result<Vec<_>>>()?.concat();
        let prior = LightingPrior::of_places(&column_similarity::places(&cells, self.shape.columns()));
        Ok(Self::with_prior(basis, self.shape, self.settings, prior))
    }

    /// Blocks that [`ask_images`](Self::ask_images) reads.
    pub fn blocks_asked(&self, basis: &LightBasis) -> u64 {
        if self.asks_images(basis) { column_similarity::looked_at(self.shape).len() as u64 } else { 0 }
    }

    /// Whether the prior of a basis wants to know which lights are alike.
    pub fn asks_images(&self, basis: &LightBasis) -> bool {
        let by_lighting = self.settings.prior == PriorChoice::Lighting && !self.settings.has_fixed_rank();
        by_lighting && basis.is_unplaced() && column_similarity::can_tell(self.shape.columns())
    }

    fn with_prior(basis: &LightBasis, shape: MatrixShape, settings: CompressSettings, prior: LightingPrior) -> Self {
        let n = shape.columns();
        let sketch_columns = (settings.rank + settings.oversampling).min(n);
        let variances = prior.variances();
        let weights = PriorWeights::new(prior, sketch_columns, settings.seed ^ 0x736b_6574_6368);
        let probes = probe_lightings(basis);
        Self { shape, weights, variances, probes, settings }
    }

    /// Times that [`choose_globally`](Self::choose_globally) reads a block at most; 0 for [`Scope::Block`].
    pub fn global_passes(&self) -> u32 {
        match (self.settings.scope, self.settings.method) {
            (Scope::Block, _) => 0,
            (_, Method::Algorithm3) => 1,
            (_, Method::Algorithm1) => 2,
            _ if self.shape.rows() <= self.settings.sample_rows as u64 => 2,
            _ => 4,
        }
    }

    /// Bytes that [`ask_images`](Self::ask_images) holds at most beside the blocks at hand.
    pub fn asking_needs_bytes(&self, basis: &LightBasis) -> u64 {
        if self.asks_images(basis) { column_similarity::needs_bytes(self.shape.columns()) } else { 0 }
    }

    /// Energy under the prior of some rows of `R`, row-major.
    pub(super) fn energies(&self, rows: &[f32], count: usize) -> Vec<f64> {
        let rows = MatRef::from_row_major_slice(rows, count, self.shape.columns());
        let gram = self.weights.gram(rows);
        (0..count).map(|k| gram[(k, k)]).collect()
    }

    /// The lightings that it weighs errors by.
    pub fn prior(&self) -> &LightingPrior {
        self.weights.prior()
    }

    /// The shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &CompressSettings {
        &self.settings
    }

    /// [`thread_bytes`](MemoryNeed::thread_bytes) of a compressor for matrices of this shape with these settings.
    pub fn needs_bytes_for(shape: MatrixShape, settings: &CompressSettings) -> u64 {
        let (m, n) = (shape.max_block_rows() as u64, shape.columns() as u64);
        let q = (settings.rank + settings.oversampling + 1) as u64;
        let dense = match settings.method {
            // The block, both sides of its SVD and what the SVD works in, in f64.
            Method::BlockSvd | Method::BlockPca => 8 * (3 * m * n + (m + n) * m.min(n)),
            _ => 0,
        };
        // A copy of the block where it has entries that cannot be used; factors in f32 and f64; the sketch of its rows,
        // the prior's factor and the sketch's lightings.
        let factors = 4 * m * n + dense + 56 * (m + n) * q + 4 * n * (2 * SKETCH_ROWS as u64 + Self::COLUMN_VALUES);
        // The images under the probes, their comparison, and the candidates of one component.
        factors + 4 * m * (3 * WINDOW_PIXELS + 64)
    }

    /// Bytes of an encoded candidate's factors at most.
    pub fn factor_bytes(&self) -> u64 {
        let (m, n) = (self.shape.max_block_rows() as u64, self.shape.columns() as u64);
        let rank = (self.settings.rank as u64 + 1).min(m).min(n);
        1024 + 4 * rank * (m + n + 4)
    }

    /// Bytes of an encoded candidate at most.
    pub fn candidate_bytes(&self) -> u64 {
        let (m, n) = (self.shape.max_block_rows() as u64, self.shape.columns() as u64);
        // A tenth of a row's entries may stand above its 90th percentile, and so many may carry their share of its sum.
        let share = self.settings.sparse.map_or(0, |rule| (1.0 / rule.fraction) as u64);
        let sparse = if self.settings.method == Method::Auto { m * share.min(n / 10 + 1) } else { 0 };
        self.factor_bytes() + 16 * sparse
    }

    /// Chooses the slope for all blocks from their summaries, in any order.
    pub fn choose<'a>(&self, summaries: impl Iterator<Item = &'a CandidateSummary> + Clone) -> Cut {
        cut::choose(&self.settings, self.prior().white_square(), summaries)
    }
}
