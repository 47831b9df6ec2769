//! The worker of a farm: for each block it writes the record that the merge needs to an unlinked temporary file.

use std::path::Path;

use super::terms::Terms;
use crate::blob_store::BlobStore;
use crate::block_records::{Records, ShardHead, open_spill};
use crate::compress::{Compressor, CompressorPlan};
use crate::denoise::DenoiseInputs;
use crate::error::{Error, Result};
use crate::files::ContinuationFile;
use crate::matrix::{BlockId, TracedBlock};
use crate::pipeline::{Analysed, need_of};
use crate::resources::{Held, PerThread, Progress, ResourceEstimate};

/// Makes the records of a shard.
pub(super) enum Worker {
    /// For a matrix that is denoised, which the merge then analyses.
    Gathers(Box<DenoiseInputs>),
    /// Of one that is packed as it is.
    Analyses {
        /// What analyses.
        compressor: Box<Compressor>,
        /// What it has analysed.
        analysed: Analysed,
    },
}

impl Worker {
    /// A worker whose file is in `scratch`, or in the system's temporary folder. The file vanishes with the process,
    /// however that ends.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub(super) fn new(terms: &Terms, plan: CompressorPlan, scratch: Option<&Path>) -> Result<Self> {
        let folder = match scratch {
            Some(scratch) => tempfile::tempdir_in(scratch).map_err(Error::io(scratch, "create a folder in"))?,
            None => {
                tempfile::tempdir().map_err(Error::io("the system's temporary files", "create a folder for them"))?
            }
        };
        let (path, shape) = (folder.path().join("shard"), terms.job.shape);
        let records = Records::File(open_spill(&path, terms.fingerprint, shape.block_count(), false)?);
        // An unlinked file lives as long as it is open.
        folder.close().map_err(Error::io(&path, "take the name of"))?;
        Ok(if terms.options.denoise {
            Self::Gathers(Box::new(DenoiseInputs::new(&terms.job, path, records)?))
        } else {
            Self::Analyses { compressor: Box::new(plan.for_blocks()?), analysed: Analysed { records } }
        })
    }

    /// What working takes, where making a block takes `source`.
    pub(super) fn need(terms: &Terms, plan: &CompressorPlan, source: ResourceEstimate) -> ResourceEstimate {
        let shape = terms.job.shape;
        // The positions of all records.
        let places = Held(64 * u64::from(shape.block_count()));
        match terms.options.denoise {
            true => source.and(&[&places, &PerThread(DenoiseInputs::takes_bytes(&terms.job))]),
            false => need_of(plan, shape, source, None).and(&[&places]),
        }
    }

    /// Makes a block's record, unless it exists; returns the amount of work.
    ///
    /// # Errors
    /// Those of `make` and of the disk; [`Error::Interrupted`].
    pub(super) fn build(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        watch: &dyn Progress,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
    ) -> Result<u64> {
        if watch.interrupted() {
            return Err(Error::interrupted("nothing is kept of the range"));
        }
        match self {
            Self::Gathers(gathering) => gathering.take(id, block, watch, make, None),
            Self::Analyses { compressor, analysed } => analysed.take(compressor, id, block, make).map(|(_, work)| work),
        }
    }

    /// Bytes of a block's record.
    ///
    /// # Errors
    /// There is none.
    pub(super) fn bytes_of(&self, id: BlockId) -> Result<u64> {
        self.file()?.length_and_checksum(id.0).map(|(bytes, _)| bytes)
    }

    /// Writes the records of a range into a depot, as a shard. Returns its name.
    ///
    /// # Errors
    /// A record is missing; those of the disk and of the depot.
    pub(super) fn publish(&self, head: &ShardHead, depot: &BlobStore) -> Result<String> {
        let records = self.file()?;
        let name = head.name(records)?;
        depot.put(&name, &|out| head.write(records, &name, out))?;
        Ok(name)
    }

    fn file(&self) -> Result<&ContinuationFile> {
        let records = match self {
            Self::Gathers(gathering) => &gathering.records,
            Self::Analyses { analysed, .. } => &analysed.records,
        };
        match records {
            Records::File(file) => Ok(file),
            Records::Shards(shards) => Err(shards.damaged(0, "it was built elsewhere")),
        }
    }
}
