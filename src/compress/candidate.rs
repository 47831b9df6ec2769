//! A block after analysis: more components and sparse entries than will be kept, each with its gain. Small enough to
//! spill.

use super::Replaced;
use crate::matrix::{BlockId, ColumnIndex, FactoredBlock, SparseEntry};

/// Magic bytes of an encoded candidate, with the version of the layout. Spill files live as long as one run.
const MAGIC: [u8; 4] = *b"cnd5";

/// Number of bins of [`CandidateSummary::sparse_gains`]: powers of two of the gain, from `2^-80`.
pub(super) const GAIN_BINS: usize = 160;
const LOWEST_EXPONENT: f64 = -80.0;

/// A block as components and sparse entries, more of each than will be kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Index of the block.
    pub id: BlockId,
    pub(super) summary: CandidateSummary,
    /// `U`: rows × rank, column-major.
    pub(super) left: Vec<f32>,
    /// `Uᵀ A`: rank × columns, row-major.
    pub(super) right: Vec<f32>,
    /// Ordered by column, then row.
    pub(super) sparse: Vec<SparseEntry>,
    /// Distortion that each entry saves.
    pub(super) sparse_gain: Vec<f32>,
}

/// Statistics of a candidate from which the common slope is chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CandidateSummary {
    /// Rows of the block.
    pub rows: u32,
    /// Columns of the block.
    pub columns: u32,
    /// Whether all components are kept whatever their gain (methods with a fixed rank).
    pub fixed: bool,
    /// Weighted energy `uᵀ A K Aᵀ u` of each component: the distortion that it saves.
    pub gains: Vec<f32>,
    /// Noise projected on each component's right factor: the mean square that it adds to an image; 0 if unknown.
    pub noise: Vec<f32>,
    /// Part of each gain that is noise the left factor was fitted to; 0 if unknown.
    pub fitted_noise: Vec<f32>,
    /// 75th percentile of the noise of rows over its mean, at most 1. It is small if few rows have nearly all of the
    /// noise.
    pub noise_quartile_ratio: f32,
    /// Energy of the noise of the whole block, in the units of `gains`; 0 if unknown.
    pub noise_energy: f32,
    /// Mean square of each component's row of `R`, each column weighed by the diagonal of `K`.
    pub right_mean_square: Vec<f32>,
    /// Weighted energy outside all components.
    pub tail: f32,
    /// Sum of the gains of the sparse entries and their number, by powers of two of the gain.
    pub sparse_gains: Vec<(f32, u32)>,
    /// Root mean square of the all-on image.
    pub brightness: f32,
    /// Histogram of the all-on image by half powers of two from `2^-40`. The first bin has all smaller values.
    pub histogram: Vec<u32>,
    /// Number of entries that were replaced because they were not usable.
    pub replaced: Replaced,
}

impl CandidateSummary {
    /// Weighted energy of the whole block.
    pub fn energy(&self) -> f64 {
        let sparse: f64 = self.sparse_gains.iter().map(|(sum, _)| f64::from(*sum)).sum();
        self.gains.iter().map(|&g| f64::from(g)).sum::<f64>() + f64::from(self.tail) + sparse
    }

    /// Whether the noise of its samples is known.
    pub(super) fn knows_noise(&self) -> bool {
        self.fitted_noise.iter().chain(&self.noise).any(|&noise| noise > 0.0)
    }

    pub(super) fn sparse_bin(gain: f32) -> usize {
        let exponent = f64::from(gain).max(1e-60).log2().floor();
        (exponent - LOWEST_EXPONENT).clamp(0.0, (GAIN_BINS - 1) as f64) as usize
    }

    /// Least gain of a bin.
    pub(super) fn bin_floor(bin: usize) -> f64 {
        (bin as f64 + LOWEST_EXPONENT).exp2()
    }
}

impl Candidate {
    /// The statistics from which the common slope is chosen.
    pub fn summary(&self) -> &CandidateSummary {
        &self.summary
    }

    /// Number of components.
    pub fn rank(&self) -> usize {
        self.summary.gains.len()
    }

    /// All of it before any cut: `L R + S`. The residual of the block is orthogonal to the components.
    pub fn whole(&self) -> FactoredBlock {
        FactoredBlock {
            rows: self.summary.rows as usize,
            columns: self.summary.columns as usize,
            left: self.left.clone(),
            right: self.right.clone(),
            sparse: self.sparse.clone(),
            ..Default::default()
        }
    }

    /// Encodes it, in the machine's byte order, for a spill file that the same program reads back.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(1024 + 4 * (self.left.len() + self.right.len()) + 16 * self.sparse.len());
        out.extend(MAGIC);
        out.extend_from_slice(bytemuck::cast_slice(&[self.id.0, self.sparse.len() as u32]));
        self.summary.append_to(&mut out);
        for list in [&self.left, &self.right, &self.sparse_gain] {
            out.extend_from_slice(bytemuck::cast_slice(list));
        }
        for entry in &self.sparse {
            out.extend_from_slice(bytemuck::cast_slice(&[entry.column.0, entry.row, entry.value.to_bits()]));
        }
        out
    }

    /// Decodes what [`to_bytes`](Self::to_bytes) wrote.
    ///
    /// # Errors
    /// As text for the caller to place: bytes that are not a candidate, cut short, or too many.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let rest = bytes.strip_prefix(&MAGIC).ok_or("this is not a spilled candidate")?;
        let mut words = Words::of(rest)?;
        let &[id, sparse_count] = words.take(2)? else { return Err(Words::short()) };
        let summary = CandidateSummary::of_words(&mut words)?;
        let size = |a: u32, b: usize| (a as usize).checked_mul(b).ok_or_else(Words::short);
        let rank = summary.gains.len();
        let left = words.floats(size(summary.rows, rank)?)?;
        let right = words.floats(size(summary.columns, rank)?)?;
        let sparse_gain = words.floats(sparse_count as usize)?;
        let entries = words.take(size(sparse_count, 3)?)?.chunks_exact(3);
        let sparse = entries
            .map(|e| SparseEntry { column: ColumnIndex(e[0]), row: e[1], value: f32::from_bits(e[2]) })
            .collect();
        words.end()?;
        Ok(Self { id: BlockId(id), summary, left, right, sparse, sparse_gain })
    }
}

impl CandidateSummary {
    /// Encodes it, in the machine's byte order, for the same program on another machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.append_to(&mut out);
        out
    }

    /// Decodes what [`to_bytes`](Self::to_bytes) wrote.
    ///
    /// # Errors
    /// As text for the caller to place: bytes that are not a summary, cut short, or too many.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let mut words = Words::of(bytes)?;
        let summary = Self::of_words(&mut words)?;
        words.end()?;
        Ok(summary)
    }

    fn append_to(&self, out: &mut Vec<u8>) {
        let first = self.replaced.first.map_or([u32::MAX; 2], |(c, r)| [c.0, r]);
        let [rank, bins, gains] = [self.gains.len(), self.histogram.len(), self.sparse_gains.len()].map(|n| n as u32);
        let numbers = [self.rows, self.columns, u32::from(self.fixed), self.replaced.nan, self.replaced.huge];
        for numbers in [&numbers[..], &first, &[rank, bins, gains], &self.histogram] {
            out.extend_from_slice(bytemuck::cast_slice(numbers));
        }
        let scalars = [self.tail, self.brightness, self.noise_quartile_ratio, self.noise_energy];
        for list in [&scalars[..], &self.gains, &self.noise, &self.fitted_noise, &self.right_mean_square] {
            out.extend_from_slice(bytemuck::cast_slice(list));
        }
        for (sum, count) in &self.sparse_gains {
            out.extend_from_slice(bytemuck::cast_slice(&[sum.to_bits(), *count]));
        }
    }

    fn of_words(words: &mut Words) -> Result<Self, String> {
        let &[rows, columns, fixed, nan, huge, first_column, first_row, rank, bins, gains] = words.take(10)? else {
            return Err(Words::short());
        };
        let (rank, first) = (rank as usize, (ColumnIndex(first_column), first_row));
        let histogram = words.take(bins as usize)?.to_vec();
        let scalars = words.floats(4)?;
        let mut list = || words.floats(rank);
        let (gain_list, noise, fitted_noise, right_mean_square) = (list()?, list()?, list()?, list()?);
        let pairs = words.take((gains as usize).checked_mul(2).ok_or_else(Words::short)?)?.chunks_exact(2);
        Ok(Self {
            rows,
            columns,
            fixed: fixed != 0,
            gains: gain_list,
            noise,
            fitted_noise,
            right_mean_square,
            tail: scalars[0],
            sparse_gains: pairs.map(|pair| (f32::from_bits(pair[0]), pair[1])).collect(),
            brightness: scalars[1],
            noise_quartile_ratio: scalars[2],
            noise_energy: scalars[3],
            histogram,
            replaced: Replaced { nan, huge, first: (first_column != u32::MAX).then_some(first) },
        })
    }
}

/// Words of encoded bytes, taken from the front.
struct Words {
    words: Vec<u32>,
    taken: usize,
}

impl Words {
    fn of(bytes: &[u8]) -> Result<Self, String> {
        match bytes.len() % 4 {
            0 => Ok(Self { words: bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect(), taken: 0 }),
            _ => Err(Self::short()),
        }
    }

    fn short() -> String {
        "a spilled candidate is cut short".to_owned()
    }

    fn take(&mut self, count: usize) -> Result<&[u32], String> {
        let taken = self.words[self.taken..].get(..count).ok_or_else(Self::short)?;
        self.taken += count;
        Ok(taken)
    }

    fn floats(&mut self, count: usize) -> Result<Vec<f32>, String> {
        Ok(self.take(count)?.iter().map(|&word| f32::from_bits(word)).collect())
    }

    fn end(&self) -> Result<(), String> {
        match self.taken == self.words.len() {
            true => Ok(()),
            false => Err("a spilled candidate has trailing bytes".to_owned()),
        }
    }
}

/// Number of bins of [`CandidateSummary::histogram`]: half powers of two from `2^-40`.
const VALUE_BINS: usize = 160;

/// Counts of values by half powers of two, up to the last bin in use.
pub(super) fn histogram(values: &[f32]) -> Vec<u32> {
    let mut counts = vec![0u32; VALUE_BINS];
    for value in values {
        let bin = (value.abs().max(f32::MIN_POSITIVE).log2() * 2.0).floor() as i32 + 80;
        counts[bin.clamp(0, VALUE_BINS as i32 - 1) as usize] += 1;
    }
    counts.truncate(counts.iter().rposition(|&c| c > 0).map_or(0, |last| last + 1));
    counts
}

/// The value below which a share `p` of the counted values lies, interpolated within its bin; 0 for the first bin.
pub(super) fn percentile(counts: &[u64], p: f64) -> f64 {
    let total: u64 = counts.iter().sum();
    let mut left = total as f64 * p;
    for (bin, &count) in counts.iter().enumerate() {
        if left <= count as f64 && count > 0 {
            let exponent = (bin as f64 - 80.0 + left / count as f64) / 2.0;
            return if bin == 0 { 0.0 } else { exponent.exp2() };
        }
        left -= count as f64;
    }
    0.0
}

/// Sums and counts of gains by powers of two, up to the last bin used.
pub(super) fn gain_bins(gains: &[f32]) -> Vec<(f32, u32)> {
    let mut bins = vec![(0.0f32, 0u32); GAIN_BINS];
    for &gain in gains {
        let bin = &mut bins[CandidateSummary::sparse_bin(gain)];
        bin.0 += gain;
        bin.1 += 1;
    }
    bins.truncate(bins.iter().rposition(|b| b.1 > 0).map_or(0, |last| last + 1));
    bins
}
