//! The first pass of a pack: each block becomes a candidate, of which the second pass keeps what the common slope allows.

use std::path::PathBuf;

use crate::block_records::{Records, stop_if_interrupted};
use crate::compress::{Candidate, CandidateSummary, Compressor, Method, Residual};
use crate::error::Result;
use crate::matrix::{BlockId, TracedBlock};
use crate::resources::Progress;

/// Analyses blocks into records.
pub(crate) struct Analysis {
    pub(crate) compressor: Compressor,
    /// Candidates with the residuals of their blocks.
    pub(crate) records: Records,
    /// Path of the result, for messages.
    pub(crate) path: PathBuf,
}

impl Analysis {
    /// The first pass over a block: its candidate and residual go to the records, unless they are there already.
    pub(crate) fn analyse(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        (make, work_unit): (&(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync), &str),
        watch: &dyn Progress,
    ) -> Result<CandidateSummary> {
        stop_if_interrupted(&self.path, watch)?;
        let (summary, work) = self.take(id, block, make)?;
        watch.advance(1, work, work_unit);
        Ok(summary)
    }

    /// [`analyse`](Self::analyse), which also returns the amount of work.
    pub(crate) fn take(
        &self,
        id: BlockId,
        block: &mut TracedBlock,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
    ) -> Result<(CandidateSummary, u64)> {
        if self.records.has(id.0) {
            return Ok((self.read(id)?.0.summary().clone(), 0));
        }
        let work = make(id, block)?;
        let seen = block.planes.as_ref().map_or(&[][..], |planes| &planes.emission);
        let (candidate, sums) = self.compressor.analyse_in_place(id, &mut block.block, block.noise.as_ref(), seen);
        let mut bytes = candidate.to_bytes();
        let candidate_bytes = bytes.len() as u64;
        let projected = self.compressor.settings().method == Method::Auto && candidate.summary().replaced.count() == 0;
        Residual::measure(block, &candidate.whole(), projected, sums).append_to(&mut bytes);
        bytes.extend(candidate_bytes.to_le_bytes());
        self.records.append(id.0, &[&bytes])?;
        Ok((candidate.summary().clone(), work))
    }

    /// Reads a candidate and its residual from the records.
    pub(crate) fn read(&self, id: BlockId) -> Result<(Candidate, Residual)> {
        let bytes = self.records.read(id.0)?;
        let parts = || -> Result<_, String> {
            let short = || "it is cut short".to_owned();
            let (bytes, length) = bytes.split_last_chunk::<8>().ok_or_else(short)?;
            let (candidate, residual) =
                bytes.split_at_checked(u64::from_le_bytes(*length) as usize).ok_or_else(short)?;
            Ok((Candidate::from_bytes(candidate)?, Residual::from_bytes(residual).ok_or_else(short)?))
        };
        parts().map_err(|problem| self.records.damaged(id.0, &problem))
    }
}
