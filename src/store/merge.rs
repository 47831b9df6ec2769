//! Joining files that hold different blocks of the same matrix.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::matrix::{BlockId, BlockSource};

use super::{BlockDamage, StoreReader, StoreWriter};

/// What merging found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MergeReport {
    /// Blocks of the matrix.
    pub blocks: u32,
    /// Blocks that were copied from an input.
    pub copied: u32,
    /// Blocks that were there before.
    pub present: u32,
    /// Blocks that no input holds.
    pub missing: Vec<BlockId>,
    /// Blocks of an input that could not be trusted, and were not used.
    pub damaged: Vec<(PathBuf, BlockDamage)>,
}

/// Joins the blocks of `inputs` (finished or partial files of the same job and precision) into `output`.
///
/// Merging is idempotent: an output that exists already is kept and given what it lacks, so the same merge again
/// changes nothing, and inputs may come one after the other. Damaged blocks are left out, and listed unless another
/// input has them.
///
/// Errors: inputs of different jobs or precisions, two inputs that hold different bytes for the same block, an output
/// of another job.
pub fn merge(inputs: &[PathBuf], output: &Path, mut progress: impl FnMut(u32, u32)) -> Result<MergeReport> {
    let readers: Vec<_> = inputs.iter().map(|path| StoreReader::open(path)).collect::<Result<_>>()?;
    let Some(first) = readers.first() else {
        return Err(Error::input("merge", "there is nothing to merge", "name the files to join"));
    };
    for reader in &readers[1..] {
        if reader.job().hash() != first.job().hash() || reader.layout() != first.layout() {
            let problem = format!("is of another job or precision than {}", first.path().display());
            return Err(Error::input(reader.path().display().to_string(), problem, "merge files of one job only"));
        }
    }
    let options = first.options();
    let writer = if output.exists() {
        StoreWriter::reopen(output, first.job(), options)?
    } else {
        StoreWriter::create_or_resume(output, first.job(), options)?
    };
    let blocks = first.shape().block_count();
    let mut report = MergeReport { blocks, present: writer.committed_count(), ..MergeReport::default() };
    let mut scratch = Vec::with_capacity(first.layout().staging_bytes());
    for id in first.shape().blocks() {
        let mut damaged = Vec::new();
        let mut source: Option<&StoreReader> = None;
        for reader in &readers {
            let found = reader.record(id).and_then(|record| match record {
                None => Ok(None),
                Some(record) => reader.check_block(id, &record, &mut scratch).map(|()| Some(record)),
            });
            match found {
                Ok(None) => {}
                Ok(Some(record)) => match source {
                    None => {
                        if !writer.is_committed(id) {
                            writer.copy_tile(id, &record, reader.storage(), &mut scratch)?;
                            report.copied += 1;
                        }
                        source = Some(reader);
                    }
                    Some(other) if other.record(id)? == Some(record) => {}
                    Some(other) => {
                        let problem = format!("{id} differs from that in {}", other.path().display());
                        let hint = "one of them was made by another program; merge without it";
                        return Err(Error::input(reader.path().display().to_string(), problem, hint));
                    }
                },
                Err(Error::Damaged { problem, path, .. }) => {
                    damaged.push((path, BlockDamage { block: id, problem }));
                }
                Err(other) => return Err(other),
            }
        }
        if !writer.is_committed(id) {
            report.damaged.append(&mut damaged);
        }
        progress(id.0 + 1, blocks);
    }
    report.missing = writer.finish()?.missing;
    Ok(report)
}
