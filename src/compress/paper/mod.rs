//! The paper's Algorithms 1–4 and the CUR decompositions over them, for single blocks or the whole matrix. For
//! comparison only: the default method uses none of it.

mod cur;
pub(in crate::compress) mod global;
mod kmeans;

pub use cur::{CurSelection, cur};
pub(in crate::compress) use cur::{SEED, decompose, select};
pub(in crate::compress) use global::GlobalCur;
