//! One job on many machines: a plan of ranges of blocks, workers that build shards of them, and the merge.

mod job;
mod terms;
mod worker;

pub use job::{BuildReport, FarmJob, Probe, RefusedShard, Shards, TimedBlock};
