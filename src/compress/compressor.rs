//! The compressor: analyses blocks one by one, and chooses one cut for all of them.

use faer::{Mat, MatRef};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::candidate::{Candidate, CandidateSummary, gain_bins, histogram};
use super::dense::{eigen, orthonormal, product, thin_svd, to_f32, to_f64, to_vec};
use super::nlm::{SimilarPixels, Smoothed, joined};
use super::noise::NoiseModel;
use super::outliers::{find_outliers, without};
use super::paper::{GlobalCur, SEED, decompose, global, select};
use super::range::{PriorWeights, Range, SKETCH_ROWS, exact_range, find_range, range_of};
use super::sanitise::{BlockSurvey, sanitise, survey};
use super::{
    BlockSums, CompressSettings, Core, CurSelection, Cut, Method, PriorChoice, Replaced, Scope, column_similarity, cut,
};
use crate::error::{Error, Result};
use crate::light::{LightBasis, LightingPrior, probe_lightings};
use crate::matrix::{
    Block, BlockId, BlockNoise, BlockSource, BlockView, CHANNELS, ColumnIndex, MatrixShape, SeenEmission, SparseEntry,
    TracedBlock,
};

/// Ratio of noise to image energy above which a direction of a block is not looked for. It is above 1 because the model
/// of the noise is only a bound for columns that are not independent. Tuned: decision 28.
const NOISE_ALONE: f64 = 16.0;

/// Compresses the blocks of one matrix. It is shared by threads; analysis changes nothing in it.
pub struct Compressor {
    settings: CompressSettings,
    shape: MatrixShape,
    weights: PriorWeights,
    /// Diagonal of `K`.
    variances: Vec<f32>,
    /// The probe lightings of the noise: columns × probes, column-major.
    probes: Vec<f32>,
    global: Option<GlobalCur>,
}

impl Compressor {
    /// Upper bound of the values held for each column: the prior's factor, the lightings of the sketch and the probes.
    pub const COLUMN_VALUES: u64 = 256;

    /// A compressor for matrices of this shape over this basis.
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

    /// Adds lightings with one light alone: see [`LightingPrior::of_lights_alone`].
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

    /// Estimates the proximity of lights from the similarity of their images, for matrices without light positions. It
    /// takes at most one pass over the blocks, on the current thread pool, with the same result for any number of
    /// threads. Does nothing if [`asks_images`](Self::asks_images) is false.
    ///
    /// # Errors
    /// Those of reading.
    pub fn ask_images(&mut self, basis: &LightBasis, source: &dyn BlockSource) -> Result<()> {
        if !self.asks_images(basis) {
            return Ok(());
        }
        let blocks = column_similarity::looked_at(self.shape);
        let coarse = blocks.par_iter().map_init(TracedBlock::default, |traced, &id| {
            source.read_block(id, traced)?;
            Ok(column_similarity::coarse(traced.block.view(), self.shape.rect(id), blocks.len()))
        });
        let cells = coarse.collect::<Result<Vec<_>>>()?.concat();
        let prior = LightingPrior::of_places(&column_similarity::places(&cells, self.shape.columns()));
        let made = Self::with_prior(basis, self.shape, self.settings.clone(), prior);
        *self = Self { global: self.global.take(), ..made };
        Ok(())
    }

    /// Blocks that [`ask_images`](Self::ask_images) reads.
    pub fn blocks_asked(&self, basis: &LightBasis) -> u64 {
        if self.asks_images(basis) { column_similarity::looked_at(self.shape).len() as u64 } else { 0 }
    }

    /// Whether the prior of a basis needs the similarity of lights.
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
        Self { shape, weights, variances, probes, global: None, settings }
    }

    /// For [`Scope::Global`]: chooses rows and columns of the whole matrix before any block is analysed. It takes at
    /// most three passes over the blocks and one over those with chosen rows, on the current thread pool. The result is
    /// the same for any number of threads. Does nothing for [`Scope::Block`].
    ///
    /// # Errors
    /// Those of reading, and a source of another shape.
    pub fn choose_globally(&mut self, source: &dyn BlockSource) -> Result<()> {
        if self.settings.scope == Scope::Global {
            if source.shape() != self.shape {
                return Err(Error::input("matrix", "has another shape than its blocks", "take the matrix of this job"));
            }
            self.global = Some(global::choose(source, &self.settings)?);
        }
        Ok(())
    }

    /// Upper bound of how often [`choose_globally`](Self::choose_globally) reads a block; 0 for [`Scope::Block`].
    pub fn global_passes(&self) -> u32 {
        match (self.settings.scope, self.settings.method) {
            (Scope::Block, _) => 0,
            (_, Method::Algorithm3) => 1,
            (_, Method::Algorithm1) => 2,
            _ if self.shape.rows() <= self.settings.sample_rows as u64 => 2,
            _ => 4,
        }
    }

    /// The result of [`choose_globally`](Self::choose_globally).
    pub fn chosen_globally(&self) -> Option<&CurSelection> {
        self.global.as_ref().map(|global| &global.chosen)
    }

    /// Upper bound of the bytes that [`choose_globally`](Self::choose_globally) holds beside the current blocks, with
    /// its result.
    pub fn global_needs_bytes(&self) -> u64 {
        if self.settings.scope == Scope::Global { global::needs_bytes(self.shape, &self.settings) } else { 0 }
    }

    /// Upper bound of the bytes that [`ask_images`](Self::ask_images) holds beside the current blocks.
    pub fn asking_needs_bytes(&self, basis: &LightBasis) -> u64 {
        if self.asks_images(basis) { column_similarity::needs_bytes(self.shape.columns()) } else { 0 }
    }

    /// Energy under the prior of `count` rows of `R`, row-major.
    pub(super) fn energies(&self, rows: &[f32], count: usize) -> Vec<f64> {
        let rows = MatRef::from_row_major_slice(rows, count, self.shape.columns());
        let gram = self.weights.gram(rows);
        (0..count).map(|k| gram[(k, k)]).collect()
    }

    /// The prior over lightings that weighs errors.
    pub fn prior(&self) -> &LightingPrior {
        self.weights.prior()
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &CompressSettings {
        &self.settings
    }

    /// Upper bound of the bytes that one call of [`analyse`](Self::analyse) takes beside the block, including the
    /// compressor and the candidate.
    pub fn needs_bytes(&self) -> u64 {
        Self::needs_bytes_for(self.shape, &self.settings)
    }

    /// [`needs_bytes`](Self::needs_bytes) of a compressor for matrices of this shape with these settings.
    pub fn needs_bytes_for(shape: MatrixShape, settings: &CompressSettings) -> u64 {
        let (m, n) = (shape.max_block_rows() as u64, shape.columns() as u64);
        let q = (settings.rank + settings.oversampling + 1) as u64;
        let dense = match settings.method {
            // The block, both factors of its SVD, and the SVD's working memory, in f64.
            Method::BlockSvd | Method::BlockPca => 8 * (3 * m * n + (m + n) * m.min(n)),
            _ => 0,
        };
        // A copy of the block if it has unusable entries; factors in f32 and f64; the sketch of its rows, the prior's
        // factor and the sketch's lightings.
        let factors = 4 * m * n + dense + 56 * (m + n) * q + 4 * n * (2 * SKETCH_ROWS as u64 + Self::COLUMN_VALUES);
        // The images under the probes, their comparison, and the smoothed candidates of one component.
        factors + 4 * m * (3 * super::nlm::WINDOW_PIXELS + 64)
    }

    /// Upper bound of the bytes of an encoded candidate's factors.
    pub fn factor_bytes(&self) -> u64 {
        let (m, n) = (self.shape.max_block_rows() as u64, self.shape.columns() as u64);
        let rank = (self.settings.rank as u64 + 1).min(m).min(n);
        1024 + 4 * rank * (m + n + 4)
    }

    /// Upper bound of the bytes of an encoded candidate.
    pub fn candidate_bytes(&self) -> u64 {
        let (m, n) = (self.shape.max_block_rows() as u64, self.shape.columns() as u64);
        // At most a tenth of a row's entries are above its 90th percentile, and at most 1 / `fraction` of them exceed
        // their share.
        let share = self.settings.sparse.map_or(0, |rule| (1.0 / rule.fraction) as u64);
        let sparse = if self.settings.method == Method::Auto { m * share.min(n / 10 + 1) } else { 0 };
        self.factor_bytes() + 16 * sparse
    }

    /// Analyses one block: replaces unusable entries, takes out outliers, finds the range, and records the gain and the
    /// noise of each part.
    ///
    /// # Panics
    /// If the block has another number of columns than the matrix, or the scope is global and
    /// [`choose_globally`](Self::choose_globally) has not been called.
    pub fn analyse(&self, id: BlockId, block: BlockView<'_>, noise: Option<&BlockNoise>) -> Candidate {
        let (entries, survey, replaced) = sanitise(block);
        let usable = BlockView::new(block.rows(), block.columns(), &entries);
        let split = self.split(id, usable, &survey, noise, &[]);
        let smooth = without(entries, split.entries(), block.rows());
        let smooth = BlockView::new(block.rows(), block.columns(), &smooth);
        self.analyse_smooth(id, smooth, split, (&survey.sums_of.all_on, replaced))
    }

    /// [`analyse`](Self::analyse) without a copy of the block: outliers are taken out of it while its range is found,
    /// and put back afterwards. It also returns the sums of the block if all its entries are usable. Entries of
    /// emission `seen` by the camera always count as outliers.
    pub fn analyse_in_place(
        &self,
        id: BlockId,
        block: &mut Block,
        noise: Option<&BlockNoise>,
        seen: &[SeenEmission],
    ) -> (Candidate, Option<BlockSums>) {
        let survey = survey(block.view());
        if !survey.usable {
            return (self.analyse(id, block.view(), noise), None);
        }
        let split = self.split(id, block.view(), &survey, noise, seen);
        let taken: Vec<SparseEntry> = split.entries().copied().collect();
        let put = |block: &mut Block, value: &dyn Fn(&SparseEntry) -> f32| {
            let rows = block.rows();
            for entry in &taken {
                block.entries_mut()[entry.column.index() * rows + entry.row as usize] = value(entry);
            }
        };
        put(block, &|_| 0.0);
        let seen = (&*survey.sums_of.all_on, Replaced::default());
        let candidate = self.analyse_smooth(id, block.view(), split, seen);
        put(block, &|entry| entry.value);
        (candidate, Some(survey.sums_of))
    }

    /// The outliers of a block, classified by its noise.
    fn split<'a>(
        &'a self,
        id: BlockId,
        usable: BlockView<'_>,
        survey: &BlockSurvey,
        noise: Option<&'a BlockNoise>,
        seen: &[SeenEmission],
    ) -> SplitBlock<'a> {
        let heeded = self.settings.noise_factor.is_some();
        let shape = (usable.rows(), usable.columns());
        let mut noise = noise.filter(|_| heeded).and_then(|noise| NoiseModel::new(noise, &self.probes, shape));
        let standing = match (self.settings.method, self.settings.sparse) {
            (Method::Auto, Some(rule)) => find_outliers(usable, &survey.sums, rule.fraction, rule.contrast),
            _ => Vec::new(),
        };
        let rect = self.shape.rect(id);
        let (sparse, stray) = match &mut noise {
            Some(noise) => noise.split(standing, (rect.width as usize, rect.height as usize)),
            None => (standing, Vec::new()),
        };
        let sparse = with_seen(sparse, usable, seen);
        SplitBlock { sparse, stray, noise }
    }

    /// Analyses a block whose entries are usable and from which the entries of `split` have been taken out.
    fn analyse_smooth(
        &self,
        id: BlockId,
        smooth: BlockView<'_>,
        SplitBlock { sparse, stray, noise }: SplitBlock<'_>,
        (lit, replaced): (&[f32], Replaced),
    ) -> Candidate {
        assert_eq!(smooth.columns(), self.shape.columns(), "{id}");
        let (m, n) = (smooth.rows(), smooth.columns());
        let a = MatRef::from_column_major_slice(smooth.entries(), m, n);
        let probes = MatRef::from_column_major_slice(&self.probes, n, self.probes.len() / n);
        let probes = probes.subcols(0, if noise.is_some() { probes.ncols() } else { 0 });
        let mut seen = None;
        let range = match self.settings.method {
            _ if lit.iter().all(|&v| v == 0.0) && smooth.entries().iter().all(|&v| v == 0.0) => {
                Range { left: Vec::new(), right: Vec::new(), gains: Vec::new(), tail: 0.0 }
            }
            Method::Auto if self.weights.holds_all_columns() => {
                exact_range(a, &stray, &self.weights, self.settings.rank.min(m).min(n))
            }
            Method::Auto => {
                let size = (self.settings.rank.min(m).min(n), self.settings.power_iterations);
                // A factor below 1 also asks for components that are less certain.
                let heeded = self.settings.noise_factor.unwrap_or(0.0).min(1.0);
                let wanted = |lightings: MatRef<'_, f32>, energies: &[f64]| match &noise {
                    Some(noise) => {
                        let of_noise = noise.energies_of_images(lightings, &stray);
                        let is_wanted = |(noise, energy): (&f64, &f64)| heeded * noise < NOISE_ALONE * energy;
                        of_noise.iter().zip(energies).map(is_wanted).collect()
                    }
                    None => vec![true; energies.len()],
                };
                let (range, images) = find_range(a, &stray, &self.weights, size, probes, &wanted);
                seen = Some(images);
                range
            }
            _ => self.by_rank(a, id),
        };
        let (range, noise_left) = match &noise {
            Some(noise) if self.settings.method == Method::Auto && !range.gains.is_empty() => {
                let seen = seen.unwrap_or_else(|| product(a, probes));
                self.smoothed(id, (a, seen.as_ref()), &stray, range, noise)
            }
            _ => (range, 1.0),
        };
        self.candidate(id, range, sparse, noise.map(|noise| (noise, noise_left)), (lit, replaced))
    }

    /// Chooses the slope for all blocks from their summaries, in any order.
    pub fn choose<'a>(&self, summaries: impl Iterator<Item = &'a CandidateSummary> + Clone) -> Cut {
        cut::choose(&self.settings, self.prior().white_square(), summaries)
    }

    /// Methods with a fixed rank, turned into orthonormal factors.
    fn by_rank(&self, a: MatRef<'_, f32>, id: BlockId) -> Range {
        let (m, n) = a.shape();
        let rank = self.settings.rank.min(m).min(n);
        let (left, right) = match self.settings.method {
            Method::BlockSvd => best_rank(a, rank),
            Method::BlockPca => {
                // Rows about their mean: A = 1 μᵀ + (A − 1 μᵀ); the mean counts as one component.
                let mean = product(Mat::from_fn(1, m, |_, _| 1.0 / m as f32).as_ref(), a);
                let centred = Mat::from_fn(m, n, |i, j| a[(i, j)] - mean[(0, j)]);
                let (left, right) = best_rank(centred.as_ref(), rank.saturating_sub(1));
                let ones = |i, k| if k == 0 { 1.0 } else { left[(i, k - 1)] };
                let over = |k: usize, j| if k == 0 { mean[(0, j)] } else { right[(k - 1, j)] };
                (Mat::from_fn(m, left.ncols() + 1, ones), Mat::from_fn(right.nrows() + 1, n, over))
            }
            _ if self.settings.scope == Scope::Global => {
                let global = self.global.as_ref().expect("`choose_globally` comes before `analyse`");
                return self.ordered(global.left(a).as_ref(), global.right.as_ref());
            }
            method => {
                let mut settings = self.settings.clone();
                if method == Method::Proposed && settings.core == Core::Textbook {
                    settings.core = Core::LeastSquares;
                }
                let mut random = Pcg64Mcg::seed_from_u64(settings.seed ^ (u64::from(id.0) << 20) ^ SEED);
                let chosen = select(a, &settings, &mut random);
                decompose(a, &chosen, settings.core, settings.truncation)
            }
        };
        self.ordered(left.as_ref(), right.as_ref())
    }

    /// `left · right` over an orthonormal basis, ordered by gain.
    fn ordered(&self, left: MatRef<'_, f32>, right: MatRef<'_, f32>) -> Range {
        let q = orthonormal(left);
        let through = product(product(q.transpose(), left).as_ref(), right);
        let (values, vectors) = eigen(self.weights.gram(through.as_ref()).as_ref());
        let kept = values.iter().take_while(|&&v| v > 0.0).count();
        let turn = to_f32(vectors.as_ref().subcols(0, kept));
        Range {
            left: to_vec(product(q.as_ref(), turn.as_ref()).as_ref()),
            right: to_vec(product(through.transpose(), turn.as_ref()).as_ref()),
            gains: values[..kept].to_vec(),
            tail: 0.0,
        }
    }

    /// The range after similar pixels are averaged in its components, and the share of the noise that is left. `seen`
    /// are the block's images under the probes.
    fn smoothed(
        &self,
        id: BlockId,
        (a, seen): (MatRef<'_, f32>, MatRef<'_, f32>),
        stray: &[SparseEntry],
        range: Range,
        noise: &NoiseModel<'_>,
    ) -> (Range, f32) {
        let ((m, n), rank) = (a.shape(), range.gains.len());
        // Each component is an image: `u = A w` with `w = K Rᵀ / g`; the first is all-on, scaled.
        let mut lightings = self.weights.weigh(MatRef::from_row_major_slice(&range.right, rank, n));
        let length: f32 = range.right[..n].iter().sum();
        for (k, &gain) in range.gains.iter().enumerate() {
            let all_on = k == 0 && length != 0.0;
            let scaled = |w: f32| match gain as f32 {
                _ if all_on => 1.0 / length,
                narrow if narrow.is_normal() => w / narrow,
                // A very dark block.
                _ => (f64::from(w) / gain) as f32,
            };
            lightings.col_mut(k).iter_mut().for_each(|w| *w = scaled(*w));
        }
        let variances = noise.of_images(lightings.as_ref());
        let rect = self.shape.rect(id);
        let size = (rect.width as usize, rect.height as usize);
        let alike = SimilarPixels::new(seen, noise.under_probes(), size);
        let left = MatRef::from_column_major_slice(&range.left, m, rank);
        let images: Vec<Smoothed> = (0..rank).map(|k| alike.smooth(left.col(k), &variances[k])).collect();
        let sum = |noise: &dyn Fn(usize) -> f64| (1..rank).map(|k| range.gains[k] * noise(k)).sum::<f64>();
        let (before, after) = (sum(&|k| variances[k].iter().sum()), sum(&|k| images[k].noise));
        // Drops components below their own noise before the block is projected on them. Each knows its own noise better
        // than the common share that the cut uses. Tuned: decision 29.
        let least = 0.5 * self.settings.noise_factor.unwrap_or(0.0);
        let is_seen = |k: usize, image: &Smoothed| k == 0 || image.squared_norm() > least * image.noise;
        let scaled: Vec<(&Smoothed, f64)> = (images.iter().enumerate().zip(&range.gains))
            .filter_map(|((k, image), gain)| is_seen(k, image).then_some((image, gain.sqrt())))
            .collect();
        let mut smooth = range_of(joined(&scaled), a, stray, &self.weights);
        let energy = |range: &Range| range.gains.iter().sum::<f64>();
        smooth.tail = (energy(&range) + range.tail - energy(&smooth)).max(0.0);
        (smooth, if before > 0.0 { (after / before) as f32 } else { 1.0 })
    }

    fn candidate(
        &self,
        id: BlockId,
        range: Range,
        sparse: Vec<SparseEntry>,
        noise: Option<(NoiseModel<'_>, f32)>,
        (lit, replaced): (&[f32], Replaced),
    ) -> Candidate {
        let (m, n) = (self.shape.rect(id).rows(), self.shape.columns());
        let sparse_gain: Vec<f32> =
            sparse.iter().map(|e| e.value * e.value * self.variances[e.column.index()]).collect();
        let mean_square = |k: usize| {
            let row = &range.right[k * n..][..n];
            row.iter().map(|v| v * v).sum::<f32>() / n as f32
        };
        let rank = range.gains.len();
        let unknown = || vec![0.0; rank];
        let summary = CandidateSummary {
            rows: m as u32,
            columns: n as u32,
            fixed: self.settings.has_fixed_rank(),
            noise: noise.as_ref().map_or(unknown(), |(noise, _)| noise.fallen(&range.left, rank)),
            noise_energy: noise.as_ref().map_or(0.0, |(noise, _)| noise.energy()),
            noise_quartile_ratio: noise.as_ref().map_or(1.0, |(noise, _)| noise.quartile_ratio()),
            fitted_noise: noise.map_or(unknown(), |(noise, left)| {
                let fitted = noise.fitted(&self.weights, &range.right, &range.gains);
                fitted.into_iter().map(|f| f * left).collect()
            }),
            right_mean_square: (0..rank).map(mean_square).collect(),
            gains: range.gains.iter().map(|&g| g as f32).collect(),
            tail: range.tail as f32,
            sparse_gains: gain_bins(&sparse_gain),
            brightness: root_mean_square(lit),
            histogram: histogram(lit),
            replaced,
        };
        Candidate { id, summary, left: range.left, right: range.right, sparse, sparse_gain }
    }
}

/// `sparse` with the entries of emission seen by the camera, ordered by column, then row.
fn with_seen(mut sparse: Vec<SparseEntry>, block: BlockView<'_>, seen: &[SeenEmission]) -> Vec<SparseEntry> {
    let pixels = block.rows() / CHANNELS;
    for seen in seen {
        for row in (0..CHANNELS).map(|channel| channel * pixels + seen.pixel as usize) {
            let value = block.at(row, seen.column as usize);
            if value != 0.0 {
                sparse.push(SparseEntry { column: ColumnIndex(seen.column), row: row as u32, value });
            }
        }
    }
    if !seen.is_empty() {
        sparse.sort_by_key(|entry| (entry.column, entry.row));
        sparse.dedup_by_key(|entry| (entry.column, entry.row));
    }
    sparse
}

/// The entries taken out of a block before its range is found.
struct SplitBlock<'a> {
    /// Entries to be stored as they are, ordered by column, then row.
    sparse: Vec<SparseEntry>,
    /// Fireflies: they count in sums, but do not shape a component.
    stray: Vec<SparseEntry>,
    noise: Option<NoiseModel<'a>>,
}

impl SplitBlock<'_> {
    fn entries(&self) -> impl Iterator<Item = &SparseEntry> {
        self.sparse.iter().chain(&self.stray)
    }
}

fn root_mean_square(values: &[f32]) -> f32 {
    let squares: f64 = values.iter().map(|&v| f64::from(v).powi(2)).sum();
    (squares / values.len() as f64).sqrt() as f32
}

/// The best approximation of rank `rank` (Eckart and Young 1936), by an f64 SVD.
fn best_rank(a: MatRef<'_, f32>, rank: usize) -> (Mat<f32>, Mat<f32>) {
    let (u, s, v) = thin_svd(to_f64(a).as_ref());
    let rank = rank.min(s.len());
    let right = Mat::from_fn(rank, a.ncols(), |k, j| (s[k] * v[(j, k)]) as f32);
    (to_f32(u.as_ref().subcols(0, rank)), right)
}
