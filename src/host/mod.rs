//! The machine that a job runs on: the memory and the disk that it may take, the memory that it took, and the program that
//! watches it.

mod budget;
mod peak;
mod watch;

pub(crate) use budget::{Need, on_threads};
pub use budget::{human_bytes, parse_bytes};
pub use peak::PeakMemory;
pub use watch::{Quiet, Watch};
