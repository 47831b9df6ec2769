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
//! One block is worked on by one thread, without parallelism inside: the bytes do not depend on the number of threads.

mod alike;
mod candidate;
mod compressor;
mod cur;
mod cut;
mod dense;
mod global;
mod kmeans;
mod noise;
mod range;
mod remainder;
mod sanitise;
mod settings;

pub use candidate::{Candidate, CandidateSummary};
pub use compressor::Compressor;
pub use cur::{Selection, cur};
pub use cut::Cut;
pub use global::GlobalCur;
pub use sanitise::{BlockSums, Replaced};
pub use settings::{AUTOMATIC_DB, AUTOMATIC_MOST_DB, CompressSettings, Core, Method, PriorChoice, Scope, Target};
