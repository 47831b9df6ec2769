//! The first pass of a pack: each block becomes a candidate, of which the second pass keeps what the common slope allows.

use crate::block_records::Records;
use crate::compress::{Candidate, CandidateSummary, Compressor, CompressorPlan, Method, Residual};
use crate::error::Result;
use crate::matrix::{BlockId, TracedBlock};

/// What the first pass does.
pub(crate) enum FirstPass {
    /// Analyses the blocks that are not analysed yet.
    Analyse(Compressor),
    /// Reads what an earlier run has made of all blocks.
    Read(CompressorPlan),
}

impl FirstPass {
    pub(crate) fn plan(&self) -> &CompressorPlan {
        match self {
            Self::Analyse(compressor) => compressor.plan(),
            Self::Read(plan) => plan,
        }
    }

    pub(crate) fn into_plan(self) -> CompressorPlan {
        match self {
            Self::Analyse(compressor) => compressor.into_plan(),
            Self::Read(plan) => plan,
        }
    }
}

/// Analysed blocks.
pub(crate) struct Analysed {
    /// Candidates with what they lack of their blocks.
    pub(crate) records: Records,
}

impl Analysed {
    /// The first pass over a block: its candidate and what that lacks of it go to the records, if they are not there. Gives the
    /// work that making the block was, 0 where it was not made.
    pub(crate) fn take(
        &self,
        compressor: &Compressor,
        id: BlockId,
        block: &mut TracedBlock,
        make: &(impl Fn(BlockId, &mut TracedBlock) -> Result<u64> + Sync),
    ) -> Result<(CandidateSummary, u64)> {
        if self.records.has(id.0) {
            return Ok((self.summary(id)?, 0));
        }
        let work = make(id, block)?;
        let seen = block.planes.as_ref().map_or(&[][..], |planes| &planes.emission);
        let (candidate, sums) = compressor.analyse_in_place(id, &mut block.block, block.noise.as_ref(), seen);
        let mut bytes = candidate.to_bytes();
        let candidate_bytes = bytes.len() as u64;
        let projected = compressor.settings().method == Method::Auto && candidate.summary().replaced.count() == 0;
        Residual::measure(block, &candidate.whole(), projected, sums).append_to(&mut bytes);
        bytes.extend(candidate_bytes.to_le_bytes());
        self.records.append(id.0, &[&bytes])?;
        Ok((candidate.summary().clone(), work))
    }

    /// What is known of an analysed block.
    pub(crate) fn summary(&self, id: BlockId) -> Result<CandidateSummary> {
        Ok(self.read(id)?.0.summary().clone())
    }

    /// A candidate and its residual, back from the records.
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
