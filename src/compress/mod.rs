//! Compression: each block of `T` as two thin factors and a few sparse entries.
//!
//! There are two passes, so that one rate–distortion slope holds for every block while only one block is held at a
//! time:
//!
//! ```text
//! block ──► Compressor::analyse ──► Candidate ──► CandidateSummary ──┐
//!           sanitise, sparse entries, (spill file)                    ▼
//!           weighted range, like pixels    │            Compressor::choose ──► Cut
//!           averaged within the noise      │
//!                                          └──────► Candidate::cut(&Cut) ──► FactoredBlock
//! ```
//!
//! The distortion is that of relit images: with the covariance `K` of [`LightingPrior`](crate::light::LightingPrior),
//! `‖(A − L R − S) K^½‖²`. Every method ends in the same form: `L` with orthonormal columns, `R = Lᵀ A`, and components
//! ordered by gain, so that dropping a component costs exactly its gain.
//!
//! Algorithms 1–4 may choose their rows and columns once for all blocks ([`Scope::Global`]), in passes before the
//! first.
//!
//! Each block has its own `R`. A basis of columns shared by several blocks was rejected: decision 26.
//!
//! One block is processed by one thread, without parallelism inside, so the bytes do not depend on the number of
//! threads.

mod candidate;
mod cluster_residual;
mod column_similarity;
mod compressor;
mod cut;
mod dense;
mod identity;
mod light_sums;
mod nlm;
mod noise;
mod outliers;
mod paper;
mod plan;
mod range;
mod residual;
mod sanitise;
mod settings;
mod size;

pub use candidate::{Candidate, CandidateSummary};
pub use cluster_residual::{ClusterMap, ClusterResidual};
pub use compressor::Compressor;
pub use cut::{Cut, component_bits};
pub use light_sums::{ColumnErrors, LightErrorSums};
// What studies and tests compare with.
#[doc(hidden)]
pub use paper::{CurSelection, cur};
pub use plan::CompressorPlan;
pub use residual::Residual;
pub use sanitise::{BlockSums, Replaced};
pub use settings::{
    AUTOMATIC_DB, AUTOMATIC_MAX_DB, CompressSettings, Core, Method, PriorChoice, Ranks, Scope, SparseRule, Target,
};
pub use size::cut_of_size;

/// Version of the compressor's results and of the encoding of factors. Every container and every interrupted pack names
/// it, so that blocks of two versions are never mixed. Raise it with every change of either.
pub const COMPRESSOR_VERSION: u32 = 8;
