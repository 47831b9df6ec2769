//! What every machine of a farm must agree on.

use crate::block_records::ShardHead;
use crate::light::Job;
use crate::pipeline::PackOptions;

/// A job and its pack options, without the scene.
pub(super) struct Terms {
    pub(super) job: Job,
    /// The options after [`PackOptions::for_source`].
    pub(super) options: PackOptions,
    pub(super) fingerprint: [u8; 32],
}

impl Terms {
    /// Checks that a shard belongs to this job; the error says what it belongs to.
    pub(super) fn accept(&self, head: &ShardHead) -> Result<(), String> {
        if head.job != self.job.hash().0 {
            return Err("it is of another job".to_owned());
        }
        if head.fingerprint != self.fingerprint {
            return Err("it was built with other settings, or by another version of the program".to_owned());
        }
        match head.blocks.end <= self.job.shape.block_count() {
            true => Ok(()),
            false => Err("it has blocks that the matrix has not".to_owned()),
        }
    }
}
