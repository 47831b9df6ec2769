//! What can be asked of the compressor.

use std::fmt;
use std::str::FromStr;

use super::paper::global;
use crate::error::{Error, Result};

/// How a block is turned into factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// Sparse entries out, then the range weighted by the lighting prior, projected with the whole block.
    Auto,
    /// The paper, §3.2, Algorithm 1: columns by k-means over a random set of rows.
    Algorithm1,
    /// Algorithm 2: rows by k-means over a random set of columns.
    Algorithm2,
    /// Algorithm 3: columns and rows at random.
    Algorithm3,
    /// Algorithm 4: rounds of Algorithm 2 with fresh columns; the union of all rows and columns.
    Algorithm4,
    /// The paper, §3.4: blocks, Algorithm 4 and Nyström, with as many rows again for a stable core.
    Proposed,
    /// Principal components of a block's rows about their mean (Mahajan et al. 2007); the mean is one component.
    BlockPca,
    /// Truncated singular value decomposition of a block: the best matrix approximation of its rank.
    BlockSvd,
}

/// How the middle of a CUR decomposition is made from the chosen columns `C`, rows `R` and their crossing `W`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Core {
    /// `C W⁻¹ R` as in the textbook, with `W` square and its inverse not truncated: unstable, kept for comparison.
    Textbook,
    /// `C (W⁺ R)` with `W` over-sampled in rows and solved by least squares with truncation.
    LeastSquares,
    /// `C (C⁺ A)`: projection with the whole block at hand.
    Projection,
}

/// What rows and columns are chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scope {
    /// Each block on its own (the paper, §3.3).
    #[default]
    Block,
    /// The whole matrix, by [`CompressorPlan::choose_globally`](super::CompressorPlan::choose_globally) (the paper, §3.2);
    /// Algorithms 1–4 only. Every block still stores its own right factor: `U R` turned to the block's components.
    Global,
}

/// What [`Target::Automatic`] reaches at most, as [`Target::PsnrDb`]: an error of less than one step of an 8-bit display
/// (48.1 dB below white).
pub const AUTOMATIC_MOST_DB: f64 = 50.0;
/// What [`Target::Automatic`] is where the noise is not known or not heeded.
pub const AUTOMATIC_DB: f64 = 45.0;

/// What the result is to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// As near to the matrix as the noise of its samples lets it be of use, so that what is packed is not farther from the
    /// truth than the matrix, up to [`AUTOMATIC_MOST_DB`]: it stops where further bytes would save a 500th of the energy
    /// that the noise has. Where the noise is not known or not heeded, [`AUTOMATIC_DB`].
    Automatic,
    /// Mean PSNR in dB over the prior's lightings of images exposed so that the 95th percentile of their values is white,
    /// peak = white. A lamp in view is far above white: it neither loosens the target for what it lights, nor is what
    /// cannot be seen of it counted.
    PsnrDb(f64),
    /// Error of images over their norm, over the prior's lightings.
    RelativeL2(f64),
    /// Bytes of all factors, estimated from their entropy. A pack scales to the whole file by encoding a sample of up to 48
    /// blocks, and says so where the file has become larger.
    Bytes(u64),
    /// The slope itself: squared radiance per bit.
    Slope(f64),
}

/// The covariance of lightings that the error is weighed by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorChoice {
    /// How people light, see [`LightingPrior::of_basis`](crate::light::LightingPrior::of_basis).
    Lighting,
    /// Every column alike and independent: plain least squares.
    Flat,
}

/// How many components a block keeps by a method that has a rank of its own; [`Method::Auto`] always goes by rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ranks {
    /// All [`rank`](CompressSettings::rank) of them whatever they bring, as 16-bit floats.
    #[default]
    Fixed,
    /// Those of the first [`rank`](CompressSettings::rank) that are worth their bits at the slope of all blocks, each with steps
    /// of its own: the codec and the choice of the product over another method's components.
    ByRate,
}

/// Which entries of a block are looked at as sparse ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseRule {
    /// They carry more than this fraction of their row's sum,
    pub fraction: f64,
    /// and stand this many times above the 90th percentile of their row.
    pub contrast: f64,
}

/// Parameters of compression. The default is the product's: [`Method::Auto`].
#[derive(Clone, Debug, PartialEq)]
pub struct CompressSettings {
    /// How a block is turned into factors.
    pub method: Method,
    /// What the result is to reach.
    pub target: Target,
    /// What the error is weighed by.
    pub prior: PriorChoice,
    /// Components kept in a candidate at most; for the methods of the paper, for PCA and for SVD: the rank itself.
    pub rank: usize,
    /// For all but [`Method::Auto`]: how many of the `rank` components a block keeps.
    pub ranks: Ranks,
    /// `Auto`: columns of the sketch beyond `rank`.
    pub oversampling: usize,
    /// `Auto`: power iterations; 0 loses about 10 dB, 2 gain little.
    pub power_iterations: usize,
    /// Algorithm 4: columns looked at in each round (`c₀`); none: `rank / rounds`.
    pub columns_per_round: Option<usize>,
    /// Algorithms 1–4: rows per column, at least 1. 2 makes the core stable.
    pub rows_per_column: f64,
    /// Algorithm 4: rounds.
    pub rounds: usize,
    /// Iterations of k-means.
    pub kmeans_iterations: usize,
    /// Algorithms 1–4: whether rows and columns are chosen for each block or once for all.
    pub scope: Scope,
    /// Global scope: rows looked at together when k-means begins, at least as many as rows are chosen; a matrix of no
    /// more rows is clustered in memory.
    pub sample_rows: usize,
    /// Algorithms 1–4: the core.
    pub core: Core,
    /// Singular values of the core below this fraction of its largest are dropped.
    pub truncation: f64,
    /// `Auto`: entries that are stored by themselves; none: no entry is.
    pub sparse: Option<SparseRule>,
    /// How strongly dark blocks are favoured: a block's squared error weighs `1 / brightness^(2 · exponent)`. 0: not.
    pub exposure_exponent: f64,
    /// A component is kept if its energy `g` is above this many times its noise `f`. Keeping it brings its signal `g − f`
    /// and costs `f`, so 2 where `f` is right; 4, because `f` is what is left after pixels were averaged that were chosen
    /// by the same noise, and so too low. What seems to be noise many times over is not even looked for, unless the factor is
    /// far below one. Where there is a factor, pixels that are lit alike are averaged too, an entry that stands out is kept if
    /// samples agree on it, and nothing is quantised much finer than its noise. None: noise is not looked at, the matrix is
    /// followed as it is.
    pub noise_factor: Option<f64>,
    /// Seed of the lightings that the range is sketched with, and of every choice of Algorithms 1–4. The sketch of rows and the
    /// probe lightings of noise are the same for every seed.
    pub seed: u64,
}

impl Default for CompressSettings {
    fn default() -> Self {
        Self {
            method: Method::Auto,
            target: Target::Automatic,
            prior: PriorChoice::Lighting,
            rank: 24,
            ranks: Ranks::Fixed,
            oversampling: 8,
            power_iterations: 1,
            columns_per_round: None,
            rows_per_column: 2.0,
            rounds: 4,
            kmeans_iterations: 8,
            scope: Scope::Block,
            sample_rows: 1 << 16,
            core: Core::LeastSquares,
            truncation: 1e-2,
            sparse: Some(SparseRule { fraction: 0.02, contrast: 16.0 }),
            exposure_exponent: 0.25,
            noise_factor: Some(4.0),
            seed: 0,
        }
    }
}

impl CompressSettings {
    /// The defaults for a method: the target's slope for `Auto`, a fixed rank of 32 for the others.
    pub fn of_method(method: Method) -> Self {
        let rank = if method == Method::Auto { Self::default().rank } else { 32 };
        Self { method, rank, ..Self::default() }
    }

    /// Errors: a parameter out of its range.
    pub(super) fn check(&self) -> Result<()> {
        let refuse = |what: &str, hint: &str| Err(Error::input("compression settings", what, hint));
        if self.rank == 0 || self.rank > 4096 {
            return refuse("the rank is not between 1 and 4096", "");
        }
        if !(self.rows_per_column >= 1.0 && self.rows_per_column <= 64.0) {
            return refuse("rows per column are not between 1 and 64", "2 is stable");
        }
        if self.rounds == 0 {
            return refuse("Algorithm 4 needs at least one round", "");
        }
        if self.scope == Scope::Global {
            global::check(self)?;
            if (self.sample_rows as f64) < self.rank as f64 * self.rows_per_column {
                return refuse("the sample of rows is smaller than the rows to choose", "65536 is usual");
            }
        }
        if !(0.0..1.0).contains(&self.truncation) {
            return refuse("the truncation is not between 0 and 1", "0.01 is usual");
        }
        let fine = match self.target {
            Target::PsnrDb(db) => (0.0..=200.0).contains(&db),
            Target::RelativeL2(e) => e > 0.0 && e <= 1.0,
            Target::Bytes(b) => b > 0,
            Target::Slope(s) => s >= 0.0 && s.is_finite(),
            Target::Automatic => true,
        };
        if !fine {
            return refuse("the target cannot be reached", "PSNR is 0 to 200 dB, relative L2 above 0 and at most 1");
        }
        let sparse = self.sparse.iter().flat_map(|rule| [rule.fraction, rule.contrast]);
        if sparse.chain(self.noise_factor).chain([self.exposure_exponent]).any(|w| !(w.is_finite() && w >= 0.0)) {
            return refuse("a threshold is negative or not finite", "");
        }
        if self.noise_factor == Some(0.0) || self.columns_per_round == Some(0) {
            return refuse("a factor or a number of columns is 0", "leave it out to do without");
        }
        Ok(())
    }

    /// Whether each block keeps a rank that is given, whatever its components bring.
    pub fn has_fixed_rank(&self) -> bool {
        self.method != Method::Auto && self.ranks == Ranks::Fixed
    }
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 8] = [
        Self::Auto,
        Self::Algorithm1,
        Self::Algorithm2,
        Self::Algorithm3,
        Self::Algorithm4,
        Self::Proposed,
        Self::BlockPca,
        Self::BlockSvd,
    ];

    /// Its name in arguments and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Algorithm1 => "algorithm1",
            Self::Algorithm2 => "algorithm2",
            Self::Algorithm3 => "algorithm3",
            Self::Algorithm4 => "algorithm4",
            Self::Proposed => "proposed",
            Self::BlockPca => "pca",
            Self::BlockSvd => "svd",
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|method| method.name() == text).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|method| method.name()).collect();
            Error::input("method", format!("'{text}' is unknown"), format!("take one of {}", names.join(", ")))
        })
    }
}
