//! One job on many machines: a plan of ranges of blocks, rounds of units that workers do, and the merge.

mod job;
mod publish;
mod round;
mod rounds;
mod terms;
mod units;
mod worker;

pub use job::{FarmJob, Probe, RefusedShard, Shards, TimedBlock};
pub use publish::BuildReport;
pub use round::{Round, windows};
pub use rounds::{CodedShards, Next, find_unit};
pub use units::WorkFolders;
