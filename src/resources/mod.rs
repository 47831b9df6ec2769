//! The machine that a job runs on: the memory and the disk that it may take, the memory that it took, and the program that
//! watches it.
//!
//! # Example
//!
//! ```
//! use ltm::resources::Progress;
//!
//! /// Prints what a job says, and never stops it.
//! struct Printer;
//!
//! impl Progress for Printer {
//!     fn begin(&self, stage: &str, total: u64, unit: &str) {
//!         println!("{stage}: {total} {unit}");
//!     }
//!     fn advance(&self, _steps: u64, _work: u64, _work_unit: &str) {}
//!     fn end(&self) {}
//!     fn note(&self, line: &str) {
//!         println!("{line}");
//!     }
//!     fn interrupted(&self) -> bool {
//!         false
//!     }
//! }
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! # let matrix = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(8, 8))])?;
//!
//! use ltm::light::DescribedSource;
//! ltm::pipeline::pack(&matrix, matrix.job(), &path, &ltm::PackOptions::default(), &Printer)?;
//! # Ok::<(), ltm::Error>(())
//! ```

mod budget;
mod memory;
mod memory_need;
mod peak;
mod progress;
mod threads;

#[cfg(feature = "scene")]
pub(crate) use budget::PROGRAM_BYTES;
pub(crate) use budget::ResourceEstimate;
pub use budget::{budget_bytes, hold_to_memory, human_bytes, parse_bytes};
pub use memory::{MachineMemory, machine_memory};
pub use memory_need::MemoryNeed;
pub(crate) use memory_need::{Held, PerThread};
pub use peak::PeakMemory;
pub(crate) use progress::JobStage;
pub use progress::{NoProgress, Progress, SilentProgress};
pub(crate) use threads::Threads;
