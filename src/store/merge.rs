//! Joining files that hold different blocks of the same matrix.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::matrix::{BlockId, BlockSource};

use super::record::TileRecord;
use super::{BlockDamage, FileStorage, StoreReader, StoreWriter, partial_path};

/// Result of a merge.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MergeReport {
    /// Blocks of the matrix.
    pub blocks: u32,
    /// Blocks that were copied from an input.
    pub copied: u32,
    /// Of these, blocks that were damaged in the output.
    pub mended: u32,
    /// Blocks that were there before, and were kept.
    pub present: u32,
    /// Blocks that neither the output nor an input holds.
    pub missing: Vec<BlockId>,
    /// Blocks of an input or of the output that cannot be trusted, and of which no other file holds a good copy.
    pub damaged: Vec<(PathBuf, BlockDamage)>,
}

/// Joins the blocks of `inputs` (finished or partial files of the same job and precision) into `output`. `progress`
/// gets (blocks done, blocks) and returns whether to continue.
///
/// Merging is idempotent: an existing output is kept and completed, so the same merge again changes nothing, and inputs
/// may come one after the other. Blocks that the output and an input both hold are compared; a damaged one of the
/// output is replaced by a good one. Other damaged blocks are left as they are, and listed unless another file has
/// them.
///
/// # Errors
/// Inputs of different jobs or precisions; two files that hold different bytes for the same block; an output of another job or
/// with other room for planes and noise; [`Error::Interrupted`], then the same merge goes on.
pub fn merge(inputs: &[PathBuf], output: &Path, mut progress: impl FnMut(u32, u32) -> bool) -> Result<MergeReport> {
    let readers: Vec<_> = inputs.iter().map(|path| StoreReader::open_positioned(path)).collect::<Result<_>>()?;
    let Some(first) = readers.first() else {
        return Err(Error::input("merge", "there is nothing to merge", "name the files to join"));
    };
    for reader in &readers[1..] {
        if reader.job().hash() != first.job().hash() || !tiles_fit(reader, first) {
            let problem = format!("is of another job, precision or version than {}", first.path().display());
            return Err(Error::input(reader.path().display().to_string(), problem, "merge files of one job only"));
        }
    }
    let (options, is_new) = (first.options(), !output.exists() && !partial_path(output).exists());
    let (writer, before) = if output.exists() {
        (StoreWriter::reopen(output, first.job(), options)?, StoreReader::open_positioned(output)?)
    } else {
        let writer = StoreWriter::create_or_resume(output, first.job(), options)?;
        (writer, StoreReader::open_positioned(&partial_path(output))?)
    };
    if !tiles_fit(&before, first) {
        let (place, problem, hint) = match is_new {
            true => (
                first.path(),
                "is of an earlier version of the format, which is not written any more".to_owned(),
                "render it again",
            ),
            false => {
                let problem = format!(
                    "has other room for planes or noise than {}, or is of another version",
                    first.path().display()
                );
                (output, problem, "join them under another name, or render the missing blocks into one of them")
            }
        };
        return Err(Error::input(place.display().to_string(), problem, hint));
    }
    let blocks = first.shape().block_count();
    let mut report = MergeReport { blocks, ..MergeReport::default() };
    let mut scratch = Vec::with_capacity(first.layout().staging_bytes());
    for id in first.shape().blocks() {
        let found = look_for(id, &readers, &before, &mut scratch)?;
        match found.source {
            // What is there is good, or nothing better is.
            None if writer.is_committed(id) => report.present += 1,
            None => {}
            Some((reader, record)) => {
                if writer.is_committed(id) {
                    writer.discard(id)?;
                    report.mended += 1;
                }
                writer.copy_tile(id, &record, reader, &mut scratch)?;
                report.copied += 1;
            }
        }
        report.damaged.extend(found.damaged);
        if !progress(id.0 + 1, blocks) {
            return Err(Error::interrupted_keeping(format!("{} keeps the joined blocks", output.display())));
        }
    }
    report.missing = writer.finish()?.missing;
    Ok(report)
}

/// Whether the tiles of two files of one job mean the same, so that they can be copied as they are: planes and noise have the same
/// places, and are of divided columns in both files or in none.
fn tiles_fit(one: &StoreReader<FileStorage>, other: &StoreReader<FileStorage>) -> bool {
    let scales = |reader: &StoreReader<FileStorage>| reader.job().basis.column_scales().len();
    one.layout().has_same_tiles(other.layout()) && scales(one) == scales(other)
}

/// A block, as the files hold it.
#[derive(Default)]
struct MergedBlock<'a> {
    /// The input to copy it from; none if the output has it already, or nobody does.
    source: Option<(&'a StoreReader<FileStorage>, TileRecord)>,
    /// Where it is damaged, if nobody has a good copy.
    damaged: Vec<(PathBuf, BlockDamage)>,
}

/// Reads and compares every copy of a block. The output's own is read only where an input has one to compare.
fn look_for<'a>(
    id: BlockId,
    readers: &'a [StoreReader<FileStorage>],
    before: &'a StoreReader<FileStorage>,
    scratch: &mut Vec<u8>,
) -> Result<MergedBlock<'a>> {
    let mut good: Option<(&StoreReader<FileStorage>, TileRecord)> = None;
    let mut found = MergedBlock::default();
    let mut take = |reader: &'a StoreReader<FileStorage>| -> Result<()> {
        let record = reader.record(id).and_then(|record| match record {
            None => Ok(None),
            Some(record) => reader.check_block(id, &record, scratch).map(|()| Some(record)),
        });
        match record {
            Ok(None) => {}
            Ok(Some(record)) => match &good {
                None => good = Some((reader, record)),
                Some((_, other)) if *other == record => {}
                Some((other, _)) => {
                    let problem = format!("{id} differs from that in {}", other.path().display());
                    let hint = "one of them was made by another program; merge without it";
                    return Err(Error::input(reader.path().display().to_string(), problem, hint));
                }
            },
            Err(Error::Damaged { problem, path, .. }) => {
                found.damaged.push((path, BlockDamage { block: id, problem }));
            }
            Err(other) => return Err(other),
        }
        Ok(())
    };
    if before.is_committed(id) && readers.iter().any(|reader| reader.is_committed(id)) {
        take(before)?;
    }
    readers.iter().try_for_each(take)?;
    if good.is_some() {
        found.damaged.clear();
    }
    found.source = good.filter(|(reader, _)| !std::ptr::eq(*reader, before));
    Ok(found)
}
