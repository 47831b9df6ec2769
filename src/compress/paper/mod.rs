//! What the paper describes, and the rivals that it names: Algorithms 1–4 and the CUR decompositions over them, per block or
//! for the whole matrix. For comparison: the product's method uses nothing of it.

mod cur;
pub(in crate::compress) mod global;
mod kmeans;

pub use cur::{CurSelection, cur};
pub(in crate::compress) use cur::{SEED, decompose, select};
pub(in crate::compress) use global::GlobalCur;
