//! What a machine of a farm does with each block: what the merge needs of it goes to a file without a name.

use std::path::Path;

use super::analysis::Analysed;
use super::farm::Terms;
use super::gather::Gathering;
use super::pack::need_of;
use super::records::Records;
use super::shard::ShardHead;
use super::spill::open_spill;
use crate::compress::{Compressor, CompressorPlan};
use crate::depot::Depot;
use crate::error::{Error, Result};
use crate::files::ContinuationFile;
use crate::host::{Need, Watch};
use crate::matrix::{BlockId, TracedBlock};

/// Makes the records of a shard.
pub(super) enum Worker {
    /// Of a matrix that is cleaned: the merge analyses it.
    Gathers(Box<Gathering>),
    /// Of one that is packed as it is.
    Analyses {
        /// What analyses.
        compressor: Box<Compressor>,
        /// What it has analysed.
        analysed: Analysed,
    },
}

impl Worker {
    /// With its file in `scratch`, or where the system has such files. The file is gone with the process, however that ends.
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
        // Without its name the file lives as long as it is open.
        folder.close().map_err(Error::io(&path, "take the name of"))?;
        Ok(if terms.options.denoise {
            Self::Gathers(Box::new(Gathering::new(&terms.job, path, records)?))
        } else {
            Self::Analyses { compressor: Box::new(plan.for_blocks()?), analysed: Analysed { records } }
        })
    }

    /// What working takes, where making a block takes `source`.
    pub(super) fn need(terms: &Terms, plan: &CompressorPlan, source: Need) -> Need {
        let shape = terms.job.shape;
        // Where each record is.
        let places = 64 * u64::from(shape.block_count());
        if !terms.options.denoise {
            let need = need_of(plan, shape, source, None);
            return Need { fixed_bytes: need.fixed_bytes + places, ..need };
        }
        let per_thread_bytes = source.per_thread_bytes + Gathering::takes_bytes(&terms.job);
        Need { fixed_bytes: source.fixed_bytes + places, per_thread_bytes, ..source }
    }

    /// Makes a block's record, unless it is there; gives the work that it was.
    ///
    /// # Errors
    /// Those of `make` and of the disk; [`Error::Interrupted`].
    pub(super) fn build(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        watch: &dyn Watch,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
    ) -> Result<u64> {
        if watch.interrupted() {
            return Err(Error::Interrupted("nothing is kept of the range".to_owned()));
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

    /// Puts the records of a range into a depot, as a shard. Gives its name.
    ///
    /// # Errors
    /// A record is missing; those of the disk and of the depot.
    pub(super) fn publish(&self, head: &ShardHead, depot: &Depot) -> Result<String> {
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
