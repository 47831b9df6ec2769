//! Compression: each block of `T` as two thin factors and a few single entries.
//!
//! Two passes, so that one rate–distortion slope holds for every block and yet only one block is held at a time:
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
//! `‖(A − L R − S) K^½‖²`. Every method ends in the same shape: `L` with orthonormal columns, `R = Lᵀ A`, and the
//! components in the order of what they bring, so that leaving out a component costs exactly its gain.
//!
//! Algorithms 1–4 may choose their rows and columns once for all blocks ([`Scope::Global`]), in passes before the first.
//!
//! Each block has its own `R`. A basis of columns shared by 2 × 2 or 4 × 4 neighbours, or by groups of alike row spaces, and
//! coordinates in it (`ltm study shared`: 128 × 128 pixels, 4,096 columns, blocks of 32, 256 samples) does not pay: right
//! sides are 2 to 6 % of the bytes up to 35 dB below the panels of "diffuse" and the Conference Room, and 33 to 66 % where
//! the noise stops the target; there a shared basis takes 2 to 16 % more bytes for 0.01 to 0.08 dB, as what is left in a right
//! side is the block's own noise. Only on "diffuse" at 30 to 35 dB is it 20 to 38 % smaller at equal PSNR, 1.2 to 1.9 dB for
//! 5 to 10 % more bytes; about half of that comes of the finer steps that a basis has, which `R` alone can have as well but
//! then loses up to 0.8 dB in the Conference Room.
//!
//! One block is worked on by one thread, without parallelism inside: the bytes do not depend on the number of threads.

mod alike;
mod candidate;
mod compressor;
mod contrasts;
mod cut;
mod dense;
mod identity;
mod light_sums;
mod likeness;
mod noise;
mod paper;
mod plan;
mod range;
mod remainder;
mod residual;
mod sanitise;
mod settings;
mod size;

pub use candidate::{Candidate, CandidateSummary};
pub use compressor::Compressor;
pub use contrasts::{ClusterMap, Contrasts};
pub use cut::{Cut, component_bits};
pub use light_sums::{ColumnErrors, LightErrorSums};
pub use paper::{Selection, cur};
pub use plan::CompressorPlan;
pub use residual::Residual;
pub use sanitise::{BlockSums, Replaced};
pub use settings::{
    AUTOMATIC_DB, AUTOMATIC_MOST_DB, CompressSettings, Core, Method, PriorChoice, Ranks, Scope, SparseRule, Target,
};
pub use size::cut_of_size;

/// Version of what the compressor makes of a block, the bytes that its factors are encoded to among it; every container and
/// every interrupted pack names it. To be raised with every change of either, so that blocks of two versions are never mixed in
/// one container.
pub const COMPRESSOR_VERSION: u32 = 4;
