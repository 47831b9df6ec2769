//! Settings of the compressor.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};

/// How a block is turned into factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// Takes out sparse entries, then projects the block on its range weighted by the lighting prior.
    Auto,
    /// The paper, §3.2, Algorithm 1: columns by k-means over a random set of rows.
    Algorithm1,
    /// Algorithm 2: rows by k-means over a random set of columns.
    Algorithm2,
    /// Algorithm 3: columns and rows at random.
    Algorithm3,
    /// Algorithm 4: rounds of Algorithm 2 with fresh columns; the union of all rows and columns.
    Algorithm4,
    /// The paper, §3.4: blocks, Algorithm 4 and Nyström, with twice as many rows for a stable core.
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

/// The unit for which rows and columns are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scope {
    /// Each block on its own (the paper, §3.3).
    #[default]
    Block,
    /// The whole matrix, by [`CompressorPlan::choose_globally`](super::CompressorPlan::choose_globally) (the paper, §3.2);
    /// Algorithms 1–4 only. Every block still stores its own right factor: `U R` rotated to the block's components.
    Global,
}

/// Largest PSNR that [`Target::Automatic`] aims at, as [`Target::PsnrDb`]: an error below one step of an 8-bit display
/// (48.1 dB below white).
pub const AUTOMATIC_MAX_DB: f64 = 50.0;
/// The PSNR of [`Target::Automatic`] if the noise is unknown or ignored.
pub const AUTOMATIC_DB: f64 = 45.0;

/// What the result must reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// As near to the matrix as the noise of its samples makes useful, up to [`AUTOMATIC_MAX_DB`], so that the packed
    /// matrix is no farther from the truth than the matrix. It stops where further bytes would save a 500th of the
    /// energy of the noise. If the noise is unknown or ignored, it is [`AUTOMATIC_DB`].
    Automatic,
    /// Mean PSNR in dB over the prior's lightings, of images exposed so that the 95th percentile of their values is
    /// white, with the peak at white. A lamp in view is far above white. It does not loosen the target for what it
    /// lights, and its invisible error does not count.
    PsnrDb(f64),
    /// Error of images over their norm, over the prior's lightings.
    RelativeL2(f64),
    /// Bytes of all factors, estimated from their entropy. A pack calibrates the estimate by encoding up to 48 blocks,
    /// and reports if the file has become larger.
    Bytes(u64),
    /// The slope itself: squared radiance per bit.
    Slope(f64),
}

/// The covariance of lightings that weighs errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorChoice {
    /// How people light, see [`LightingPrior::of_basis`](crate::light::LightingPrior::of_basis).
    Lighting,
    /// All columns equal and independent: plain least squares.
    Flat,
}

/// How many components a block keeps by a method with a fixed rank; [`Method::Auto`] always chooses by rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ranks {
    /// All [`rank`](CompressSettings::rank) of them whatever their gain, as 16-bit floats.
    #[default]
    Fixed,
    /// Those of the first [`rank`](CompressSettings::rank) that are worth their bits at the common slope, each with its
    /// own steps. This is the product's choice and codec applied to the components of another method.
    ByRate,
}

/// Which entries of a block may be stored as sparse ones: both conditions must hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseRule {
    /// Least share of the row's absolute sum.
    pub fraction: f64,
    /// Least ratio to the 90th percentile of the row.
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
    /// Largest number of components of a candidate; for the paper's methods, PCA and SVD the rank itself.
    pub rank: usize,
    /// For all but [`Method::Auto`]: how many of the `rank` components a block keeps.
    pub ranks: Ranks,
    /// `Auto`: columns of the sketch beyond `rank`.
    pub oversampling: usize,
    /// `Auto`: power iterations. Tuned: decision 34.
    pub power_iterations: usize,
    /// Algorithm 4: columns of each round (`c₀`); `None` for `rank / rounds`.
    pub columns_per_round: Option<usize>,
    /// Algorithms 1–4: rows per column, at least 1. 2 makes the core stable.
    pub rows_per_column: f64,
    /// Algorithm 4: rounds.
    pub rounds: usize,
    /// Iterations of k-means.
    pub kmeans_iterations: usize,
    /// Algorithms 1–4: whether rows and columns are chosen for each block or once for all.
    pub scope: Scope,
    /// Global scope: rows that k-means starts from, at least as many as are chosen. A matrix with no more rows is
    /// clustered in memory.
    pub sample_rows: usize,
    /// Algorithms 1–4: the core.
    pub core: Core,
    /// Singular values of the core below this fraction of its largest are dropped.
    pub truncation: f64,
    /// `Auto`: which entries are stored as sparse ones; `None` for no entry.
    pub sparse: Option<SparseRule>,
    /// Whether left factors are stored as finely as the eye resolves their frequencies. At equal bytes images look nearer
    /// and have no borders of blocks, but are farther in squared error. Targets count as without it. Tuned: decision 70.
    pub by_eye: bool,
    /// Exponent that favours dark blocks: a block's squared error has the weight `1 / brightness^(2 · exponent)`. 0
    /// turns it off. Brightness is that with all on; that of each light by itself was no better: decision 71.
    pub exposure_exponent: f64,
    /// A component is kept if its energy `g` is above this many times its noise `f`. `None` ignores the noise.
    ///
    /// Keeping a component gains its signal `g − f` and costs `f`, so that 2 would be right for a correct `f`. The
    /// default is 4, because `f` is what is left after pixels were averaged by weights with the same noise, and so too
    /// low. Directions that are clearly noise are not even looked for, unless the factor is far below 1. With a factor,
    /// similar pixels are averaged too, outliers are kept only if the samples agree on them, and nothing is quantised
    /// much finer than its noise.
    pub noise_factor: Option<f64>,
    /// Seed of the sketch's lightings, and of every random choice of Algorithms 1–4. The sketch of rows and the probe
    /// lightings of noise do not depend on it.
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
            by_eye: false,
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

    /// Checks every parameter against its range.
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
            check_global(self)?;
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

    /// Whether each block keeps a fixed rank, whatever the gains of its components.
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

/// Errors: a method or a core that has no global form.
pub(super) fn check_global(settings: &CompressSettings) -> Result<()> {
    let refuse = |what: String, hint: &str| Err(Error::input("global scope", what, hint));
    match settings.method {
        Method::Algorithm1 | Method::Algorithm2 | Method::Algorithm3 | Method::Algorithm4 => {}
        method => return refuse(format!("the method {method} works block by block"), "take algorithm1 … algorithm4"),
    }
    if settings.core == Core::Projection {
        return refuse("projecting needs the whole matrix at hand".into(), "take the least-squares core");
    }
    Ok(())
}
