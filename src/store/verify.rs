//! Checking a whole file.

use std::io;
use std::path::Path;

use crate::error::{Error, Result};
use crate::light::Job;
use crate::matrix::{BlockId, BlockSource};

use super::storage::{Storage, read_exact};
use super::{PAGE_BYTES, StoreReader, StoreWriter};

/// A block that cannot be trusted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockDamage {
    /// The block.
    pub block: BlockId,
    /// The fault.
    pub problem: String,
}

/// Result of checking a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VerifyReport {
    /// Blocks of the matrix.
    pub blocks: u32,
    /// Blocks that were never committed.
    pub missing: Vec<BlockId>,
    /// Committed blocks that cannot be trusted; all others can be read.
    pub damaged: Vec<BlockDamage>,
    /// Bytes where none should be, or a wrong length: no block is harmed.
    pub stray: Vec<String>,
    /// Bytes of the tiles that were read and found good.
    pub verified_bytes: u64,
}

impl VerifyReport {
    /// Whether every byte is as it was written.
    pub fn is_sound(&self) -> bool {
        self.damaged.is_empty() && self.stray.is_empty()
    }

    /// Whether every block is present and sound.
    pub fn is_complete(&self) -> bool {
        self.is_sound() && self.missing.is_empty()
    }
}

/// Reads and checks every byte of a file. `progress` gets (blocks done, bytes found good) and returns whether to
/// continue.
///
/// # Errors
/// The header or the job description is damaged, so that nothing can be read; the system refuses;
/// [`Error::Interrupted`]. Damaged blocks are listed, and are no error.
pub fn verify(path: &Path, progress: impl FnMut(u32, u64) -> bool) -> Result<VerifyReport> {
    verify_storage(&StoreReader::open_positioned(path)?, progress)
}

/// A file under repair.
pub struct Mending {
    /// Writes the blocks that are made again.
    pub writer: StoreWriter,
    /// The blocks to be made again: damaged ones, then missing ones.
    pub again: Vec<BlockId>,
    /// Their job.
    pub job: Job,
}

/// Opens a finished file to be repaired in place: checks it, and discards what is damaged.
///
/// The file is valid at every instant. If the repair stops half way, the file lacks blocks, and repairing it again
/// continues.
///
/// # Errors
/// Those of [`verify`]; a file whose header or description is damaged cannot be mended.
pub fn mend(path: &Path, progress: impl FnMut(u32, u64) -> bool) -> Result<Mending> {
    let reader = StoreReader::open_positioned(path)?;
    let report = verify_storage(&reader, progress)?;
    let options = reader.options();
    let writer = StoreWriter::reopen(path, reader.job(), options)?;
    let mut again: Vec<_> = report.damaged.iter().map(|damage| damage.block).collect();
    for &id in &again {
        writer.discard(id)?;
    }
    if !report.stray.is_empty() {
        writer.clear_unused(|id| reader.record(id))?;
    }
    again.extend(report.missing);
    Ok(Mending { writer, again, job: reader.job().clone() })
}

/// As [`verify`], over any storage.
///
/// # Errors
/// As [`verify`].
pub fn verify_storage<S: Storage>(
    reader: &StoreReader<S>,
    mut progress: impl FnMut(u32, u64) -> bool,
) -> Result<VerifyReport> {
    let layout = reader.layout();
    let blocks = reader.shape().block_count();
    let mut report = VerifyReport { blocks, ..VerifyReport::default() };
    // As large as it gets, once: a vector that grows holds two buffers while it does.
    let mut scratch = Vec::with_capacity(layout.staging_bytes());
    let io = Error::io(reader.path(), "ask for the length");
    let length = reader.storage().length().map_err(io)?;
    if length != layout.file_bytes() {
        report.stray.push(format!("the file has {length} bytes, but {} belong there", layout.file_bytes()));
    }
    let table_end = layout.record_offset(BlockId(blocks - 1)) + super::RECORD_BYTES;
    check_blank(reader, table_end..layout.slots_offset(), "after the commit table", &mut scratch, &mut report)?;
    for id in reader.shape().blocks() {
        // The next block comes from the disk while this one is checked.
        if id.0 + 1 < blocks {
            let next = BlockId(id.0 + 1);
            reader.storage().expect(layout.slot_offset(next), layout.slot_bytes(next));
        }
        match reader.record(id).and_then(|record| match record {
            None => Ok(None),
            Some(record) => reader.check_block(id, &record, &mut scratch).map(|()| Some(record)),
        }) {
            Ok(None) => report.missing.push(id),
            Ok(Some(record)) => {
                let slot = layout.slot_offset(id);
                let rest = slot + record.length..(slot + layout.slot_bytes(id)).min(length);
                check_blank(reader, rest, &format!("behind {id}"), &mut scratch, &mut report)?;
                report.verified_bytes += record.length;
                reader.storage().release(slot, record.length);
            }
            Err(Error::Damaged { problem, .. }) => report.damaged.push(BlockDamage { block: id, problem }),
            Err(other) => return Err(other),
        }
        if !progress(id.0 + 1, report.verified_bytes) {
            return Err(Error::interrupted(format!("{} of {blocks} blocks were checked", id.0 + 1)));
        }
    }
    Ok(report)
}

/// Notes bytes that are not zero in a range that nothing is stored in. Holes are not read.
fn check_blank<S: Storage>(
    reader: &StoreReader<S>,
    range: std::ops::Range<u64>,
    where_it_is: &str,
    scratch: &mut Vec<u8>,
    report: &mut VerifyReport,
) -> Result<()> {
    let mut look = || -> io::Result<Option<u64>> {
        let mut at = range.start;
        while at < range.end {
            let page_end = (at + 1).next_multiple_of(PAGE_BYTES);
            let part = (range.end - at).min(page_end + 15 * PAGE_BYTES - at) as usize;
            // Whether a page is a hole is asked for whole pages only; the start of the range may lie inside one.
            match reader.storage().next_data(at)? {
                Some(data) if data < at + part as u64 => {}
                Some(data) => {
                    at = data;
                    continue;
                }
                None => return Ok(None),
            }
            scratch.resize(part, 0);
            read_exact(reader.storage(), at, scratch)?;
            if let Some(found) = scratch.iter().position(|&byte| byte != 0) {
                return Ok(Some(at + found as u64));
            }
            at += part as u64;
        }
        Ok(None)
    };
    match look() {
        Ok(None) => Ok(()),
        Ok(Some(at)) => {
            report.stray.push(format!("bytes {where_it_is} are not zero, from offset {at}"));
            Ok(())
        }
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(()),
        Err(error) => Err(Error::io(reader.path(), format!("read the bytes {where_it_is}"))(error)),
    }
}
