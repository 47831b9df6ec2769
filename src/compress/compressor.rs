//! The compressor: analyses blocks one by one, and chooses one cut for all of them.

use faer::{Mat, MatRef};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::candidate::{Candidate, CandidateSummary, gain_bins, histogram};
use super::dense::{eigen, orthonormal, product, thin_svd, to_f32, to_f64, to_vec};
use super::nlm::{SimilarPixels, Smoothed, joined};
use super::noise::NoiseModel;
use super::outliers::{find_outliers, without};
use super::paper::{GlobalCur, SEED, decompose, global, select};
use super::plan::CompressorPlan;
use super::range::{Range, exact_range, find_range, range_of};
use super::sanitise::{BlockSurvey, sanitise, survey};
use super::{BlockSums, CompressSettings, Core, CurSelection, Cut, Method, Replaced, Scope};
use crate::error::{Error, Result};
use crate::light::LightBasis;
use crate::matrix::{
    Block, BlockId, BlockNoise, BlockSource, BlockView, CHANNELS, ColumnIndex, MatrixShape, SeenEmission, SparseEntry,
};

/// Ratio of noise to image energy above which a direction of a block is not looked for. It is above 1 because the model
/// of the noise is only a bound for columns that are not independent. Tuned: decision 28.
const NOISE_ALONE: f64 = 16.0;

/// The rows and columns that factors are made of, where a method chooses some.
enum Chosen {
    /// Each block has its own.
    ForEachBlock,
    /// All blocks have these.
    ForMatrix(GlobalCur),
}

/// Compresses the blocks of one matrix. Shared by threads: analysing changes nothing in it.
pub struct Compressor {
    plan: CompressorPlan,
    chosen: Chosen,
}

impl CompressorPlan {
    /// The compressor, where each block is analysed by itself.
    ///
    /// # Errors
    /// The scope is global: rows and columns have to be [chosen](Self::choose_globally).
    pub fn for_blocks(self) -> Result<Compressor> {
        match self.settings.scope {
            Scope::Block => Ok(Compressor { plan: self, chosen: Chosen::ForEachBlock }),
            Scope::Global => {
                let problem = "rows and columns have to be chosen from the whole matrix";
                Err(Error::input("global scope", problem, "give the matrix, or choose them in each block"))
            }
        }
    }

    /// The compressor, for [`Scope::Global`] with rows and columns of the whole matrix, which are chosen here: at most three
    /// passes over the blocks and one over those that hold chosen rows, on the current thread pool. The same for any
    /// number of threads. Reads nothing for [`Scope::Block`].
    ///
    /// # Errors
    /// Those of reading, and a source of another shape.
    pub fn choose_globally(self, source: &dyn BlockSource) -> Result<Compressor> {
        if self.settings.scope == Scope::Block {
            return self.for_blocks();
        }
        if source.shape() != self.shape {
            return Err(Error::input("matrix", "has another shape than its blocks", "take the matrix of this job"));
        }
        let chosen = Chosen::ForMatrix(global::choose(source, &self.settings)?);
        Ok(Compressor { plan: self, chosen })
    }
}

impl Compressor {
    /// A compressor for matrices of this shape over this basis, which analyses each block by itself.
    ///
    /// # Errors
    /// Those of [`CompressorPlan::new`]; a global scope.
    pub fn new(basis: &LightBasis, shape: MatrixShape, settings: CompressSettings) -> Result<Self> {
        CompressorPlan::new(basis, shape, settings)?.for_blocks()
    }

    /// What was decided before any block was analysed.
    pub fn plan(&self) -> &CompressorPlan {
        &self.plan
    }

    /// [`plan`](Self::plan), to decide anew.
    pub fn into_plan(self) -> CompressorPlan {
        self.plan
    }

    /// As [`CompressorPlan::settings`].
    pub fn settings(&self) -> &CompressSettings {
        self.plan.settings()
    }

    /// As [`CompressorPlan::choose`].
    pub fn choose<'a>(&self, summaries: impl Iterator<Item = &'a CandidateSummary> + Clone) -> Cut {
        self.plan.choose(summaries)
    }

    /// The rows and columns that all blocks have, for [`Scope::Global`].
    pub fn chosen_globally(&self) -> Option<&CurSelection> {
        match &self.chosen {
            Chosen::ForEachBlock => None,
            Chosen::ForMatrix(global) => Some(&global.chosen),
        }
    }

    /// Analyses one block: replaces unusable entries, takes out outliers, finds the range, and records the gain and the
    /// noise of each part.
    ///
    /// # Panics
    /// If the block has another number of columns than the matrix.
    pub fn analyse(&self, id: BlockId, block: BlockView<'_>, noise: Option<&BlockNoise>) -> Candidate {
        let (entries, survey, replaced) = sanitise(block);
        let usable = BlockView::new(block.rows(), block.columns(), &entries);
        let split = self.split(id, usable, &survey, noise, &[]);
        let smooth = without(entries, split.entries(), block.rows());
        let smooth = BlockView::new(block.rows(), block.columns(), &smooth);
        self.analyse_smooth(id, smooth, split, Unsplit { all_on: &survey.sums_of.all_on, replaced })
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
        let unsplit = Unsplit { all_on: &survey.sums_of.all_on, replaced: Replaced::default() };
        let candidate = self.analyse_smooth(id, block.view(), split, unsplit);
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
        let heeded = self.plan.settings.noise_factor.is_some();
        let shape = (usable.rows(), usable.columns());
        let mut noise = noise.filter(|_| heeded).and_then(|noise| NoiseModel::new(noise, &self.plan.probes, shape));
        let standing = match (self.plan.settings.method, self.plan.settings.sparse) {
            (Method::Auto, Some(rule)) => find_outliers(usable, &survey.sums, rule.fraction, rule.contrast),
            _ => Vec::new(),
        };
        let rect = self.plan.shape.rect(id);
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
        unsplit: Unsplit<'_>,
    ) -> Candidate {
        assert_eq!(smooth.columns(), self.plan.shape.columns(), "{id}");
        let (m, n) = (smooth.rows(), smooth.columns());
        let a = MatRef::from_column_major_slice(smooth.entries(), m, n);
        let probes = MatRef::from_column_major_slice(&self.plan.probes, n, self.plan.probes.len() / n);
        let probes = probes.subcols(0, if noise.is_some() { probes.ncols() } else { 0 });
        let mut seen = None;
        let range = match self.plan.settings.method {
            _ if unsplit.all_on.iter().all(|&v| v == 0.0) && smooth.entries().iter().all(|&v| v == 0.0) => {
                Range { left: Vec::new(), right: Vec::new(), gains: Vec::new(), tail: 0.0 }
            }
            Method::Auto if self.plan.weights.holds_all_columns() => {
                exact_range(a, &stray, &self.plan.weights, self.plan.settings.rank.min(m).min(n))
            }
            Method::Auto => {
                let CompressSettings { rank, power_iterations, .. } = self.plan.settings;
                // A factor below 1 asks for what is less sure.
                let heeded = self.plan.settings.noise_factor.unwrap_or(0.0).min(1.0);
                let wanted = |lightings: MatRef<'_, f32>, energies: &[f64]| match &noise {
                    Some(noise) => {
                        let of_noise = noise.energies_of_images(lightings, &stray);
                        let is_wanted = |(noise, energy): (&f64, &f64)| heeded * noise < NOISE_ALONE * energy;
                        of_noise.iter().zip(energies).map(is_wanted).collect()
                    }
                    None => vec![true; energies.len()],
                };
                let (range, images) =
                    find_range(a, &stray, &self.plan.weights, rank.min(m).min(n), power_iterations, probes, &wanted);
                seen = Some(images);
                range
            }
            _ => self.by_rank(a, id),
        };
        let (range, left) = match &noise {
            Some(noise) if self.plan.settings.method == Method::Auto && !range.gains.is_empty() => {
                let seen = seen.unwrap_or_else(|| product(a, probes));
                self.smoothed(id, a, seen.as_ref(), &stray, range, noise)
            }
            _ => (range, 1.0),
        };
        self.candidate(id, range, sparse, noise.map(|model| BlockNoiseLeft { model, left }), unsplit)
    }

    /// Methods with a fixed rank, turned into orthonormal factors.
    fn by_rank(&self, a: MatRef<'_, f32>, id: BlockId) -> Range {
        let (m, n) = a.shape();
        if let Chosen::ForMatrix(global) = &self.chosen {
            return self.ordered(global.left(a).as_ref(), global.right.as_ref());
        }
        let rank = self.plan.settings.rank.min(m).min(n);
        let (left, right) = match self.plan.settings.method {
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
            method => {
                let mut settings = self.plan.settings.clone();
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
        let (values, vectors) = eigen(self.plan.weights.gram(through.as_ref()).as_ref());
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
        a: MatRef<'_, f32>,
        seen: MatRef<'_, f32>,
        stray: &[SparseEntry],
        range: Range,
        noise: &NoiseModel<'_>,
    ) -> (Range, f32) {
        let ((m, n), rank) = (a.shape(), range.gains.len());
        // Each component is an image: `u = A w` with `w = K Rᵀ / g`; the first is all-on, scaled.
        let mut lightings = self.plan.weights.weigh(MatRef::from_row_major_slice(&range.right, rank, n));
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
        let rect = self.plan.shape.rect(id);
        let size = (rect.width as usize, rect.height as usize);
        let alike = SimilarPixels::new(seen, noise.under_probes(), size);
        let left = MatRef::from_column_major_slice(&range.left, m, rank);
        let images: Vec<Smoothed> = (0..rank).map(|k| alike.smooth(left.col(k), &variances[k])).collect();
        let sum = |noise: &dyn Fn(usize) -> f64| (1..rank).map(|k| range.gains[k] * noise(k)).sum::<f64>();
        let (before, after) = (sum(&|k| variances[k].iter().sum()), sum(&|k| images[k].noise));
        // Drops components below their own noise before the block is projected on them. Each knows its own noise better
        // than the common share that the cut uses. Tuned: decision 29.
        let least = 0.5 * self.plan.settings.noise_factor.unwrap_or(0.0);
        let is_seen = |k: usize, image: &Smoothed| k == 0 || image.squared_norm() > least * image.noise;
        let scaled: Vec<(&Smoothed, f64)> = (images.iter().enumerate().zip(&range.gains))
            .filter_map(|((k, image), gain)| is_seen(k, image).then_some((image, gain.sqrt())))
            .collect();
        let mut smooth = range_of(joined(&scaled), a, stray, &self.plan.weights);
        let energy = |range: &Range| range.gains.iter().sum::<f64>();
        smooth.tail = (energy(&range) + range.tail - energy(&smooth)).max(0.0);
        (smooth, if before > 0.0 { (after / before) as f32 } else { 1.0 })
    }

    fn candidate(
        &self,
        id: BlockId,
        range: Range,
        sparse: Vec<SparseEntry>,
        noise: Option<BlockNoiseLeft<'_>>,
        Unsplit { all_on, replaced }: Unsplit<'_>,
    ) -> Candidate {
        let (m, n) = (self.plan.shape.rect(id).rows(), self.plan.shape.columns());
        let sparse_gain: Vec<f32> =
            sparse.iter().map(|e| e.value * e.value * self.plan.variances[e.column.index()]).collect();
        let mean_square = |k: usize| {
            let row = range.right[k * n..][..n].iter().zip(&self.plan.variances);
            row.map(|(v, weight)| v * v * weight).sum::<f32>() / n as f32
        };
        let rank = range.gains.len();
        let unknown = || vec![0.0; rank];
        let summary = CandidateSummary {
            rows: m as u32,
            columns: n as u32,
            fixed: self.plan.settings.has_fixed_rank(),
            noise: noise.as_ref().map_or(unknown(), |noise| noise.model.fallen(&range.left, rank)),
            noise_energy: noise.as_ref().map_or(0.0, |noise| noise.model.energy()),
            noise_quartile_ratio: noise.as_ref().map_or(1.0, |noise| noise.model.quartile_ratio()),
            fitted_noise: noise.map_or(unknown(), |BlockNoiseLeft { model, left }| {
                let fitted = model.fitted(&self.plan.weights, &range.right, &range.gains);
                fitted.into_iter().map(|f| f * left).collect()
            }),
            right_mean_square: (0..rank).map(mean_square).collect(),
            gains: range.gains.iter().map(|&g| g as f32).collect(),
            tail: range.tail as f32,
            sparse_gains: gain_bins(&sparse_gain),
            brightness: root_mean_square(all_on),
            histogram: histogram(all_on),
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

/// What is known of a whole block, whatever is taken out of it.
struct Unsplit<'a> {
    /// Its image with all lights on.
    all_on: &'a [f32],
    replaced: Replaced,
}

/// The noise of a block, and the share of it that is left in its components.
struct BlockNoiseLeft<'a> {
    model: NoiseModel<'a>,
    left: f32,
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
