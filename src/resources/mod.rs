//! The machine that a job runs on: the memory and the disk that it may take, the memory that it took, and the program that
//! watches it.

mod budget;
mod memory;
mod peak;
mod progress;
mod threads;

pub(crate) use budget::{PROGRAM_BYTES, ResourceEstimate};
pub use budget::{budget_bytes, hold_to_memory, human_bytes, parse_bytes};
pub use peak::PeakMemory;
pub use progress::{NoProgress, Progress};
pub(crate) use threads::Threads;
