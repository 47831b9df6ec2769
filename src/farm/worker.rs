//! The worker of a farm's first round: for each block it writes the records that later rounds need to an unlinked temporary file.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::publish::{go_on, publish, scratch_file};
use super::round::Round;
use super::terms::Terms;
use crate::blob_store::BlobStore;
use crate::block_records::{GATHERED_PARTS, Records, ShardContent, ShardHead};
use crate::compress::{Compressor, CompressorPlan};
use crate::denoise::{DenoiseInputs, GuideStatistics};
use crate::error::Result;
use crate::files::ContinuationFile;
use crate::matrix::{BlockId, TracedBlock};
use crate::pipeline::{Analysed, need_of};
use crate::resources::{Held, PerThread, Progress, ResourceEstimate};

/// Makes the records of a shard.
pub(super) enum Worker {
    /// For a matrix that is denoised before it is analysed.
    Gathers {
        /// What gathers.
        inputs: Box<DenoiseInputs>,
        /// Of the blocks that were gathered.
        tally: Mutex<GuideStatistics>,
    },
    /// Of one that is packed as it is.
    Analyses {
        /// What analyses.
        compressor: Box<Compressor>,
        /// What it has analysed: the candidate of each block, and its summary by itself.
        analysed: Analysed,
    },
}

/// Records of each block that is analysed.
const ANALYSED_PARTS: u32 = 2;

impl Worker {
    /// A worker whose file is in `scratch`, or in the system's temporary folder. The file vanishes with the process,
    /// however that ends.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub(super) fn new(terms: &Terms, plan: CompressorPlan, scratch: Option<&Path>) -> Result<Self> {
        let blocks = terms.job.shape.block_count();
        Ok(if terms.options.denoise {
            let (path, file) = scratch_file(scratch, GATHERED_PARTS * blocks)?;
            let inputs = DenoiseInputs::new(&terms.job, path, Records::File(file))?;
            let tally = Mutex::new(GuideStatistics::new(inputs.clusters));
            Self::Gathers { inputs: Box::new(inputs), tally }
        } else {
            let (_, file) = scratch_file(scratch, ANALYSED_PARTS * blocks)?;
            let analysed = Analysed { records: Records::File(file) };
            Self::Analyses { compressor: Box::new(plan.for_blocks()?), analysed }
        })
    }

    /// What working takes, where making a block takes `source`.
    pub(super) fn need(terms: &Terms, plan: &CompressorPlan, source: ResourceEstimate) -> ResourceEstimate {
        let shape = terms.job.shape;
        // The positions of all records.
        let places = Held(64 * u64::from(GATHERED_PARTS) * u64::from(shape.block_count()));
        match terms.options.denoise {
            true => source.and(&[&places, &PerThread(DenoiseInputs::takes_bytes(&terms.job))]),
            false => need_of(plan, shape, source, None).and(&[&places]),
        }
    }

    /// Makes a block's record, unless it exists; returns the amount of work.
    ///
    /// # Errors
    /// Those of `make` and of the disk; [`crate::Error::Interrupted`].
    pub(super) fn build(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        watch: &dyn Progress,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
    ) -> Result<u64> {
        go_on(watch, "nothing is kept of the range")?;
        match self {
            Self::Gathers { inputs, tally } => {
                let mut own = GuideStatistics::new(inputs.clusters);
                let work = inputs.take(id, block, watch, make, Some(&mut own))?;
                tally.lock().unwrap_or_else(PoisonError::into_inner).merge(&own);
                Ok(work)
            }
            Self::Analyses { compressor, analysed } => {
                let (summary, work) = analysed.take(compressor, id, block, make)?;
                let key = compressor.plan().shape().block_count() + id.0;
                analysed.records.append(key, &[&summary.to_bytes()])?;
                Ok(work)
            }
        }
    }

    /// Bytes of a block's records.
    ///
    /// # Errors
    /// They are not there.
    pub(super) fn bytes_of(&self, id: BlockId, blocks: u32) -> Result<u64> {
        let file = self.file()?;
        (0..self.parts()).map(|part| Ok(file.length_and_checksum(part * blocks + id.0)?.0)).sum()
    }

    /// Records of each block.
    pub(super) fn parts(&self) -> u32 {
        match self {
            Self::Gathers { .. } => GATHERED_PARTS,
            Self::Analyses { .. } => ANALYSED_PARTS,
        }
    }

    /// Writes the records of a range of the `blocks` blocks into a depot, as a shard. Returns its name.
    ///
    /// # Errors
    /// A record is missing; those of the disk and of the depot.
    pub(super) fn publish(&self, head: &ShardHead, blocks: u32, depot: &BlobStore) -> Result<String> {
        let summary = match self {
            // What the denoiser compares pixels by is summed over all blocks; and so is their light.
            Self::Gathers { inputs, tally } => {
                let mut bytes = tally.lock().unwrap_or_else(PoisonError::into_inner).to_bytes();
                for id in head.blocks.clone().map(BlockId) {
                    bytes.extend(inputs.light(id)?.to_ne_bytes());
                }
                bytes
            }
            Self::Analyses { .. } => Vec::new(),
        };
        let (records, extension) = (self.file()?, Round::Trace.extension());
        publish(head, &ShardContent { records, stride: blocks, first: 0, summary: &summary, extension }, depot)
    }

    fn file(&self) -> Result<&ContinuationFile> {
        let records = match self {
            Self::Gathers { inputs, .. } => &inputs.records,
            Self::Analyses { analysed, .. } => &analysed.records,
        };
        match records {
            Records::File(file) => Ok(file),
            Records::Shards(shards) => Err(shards.damaged(0, "it was built elsewhere")),
        }
    }
}
