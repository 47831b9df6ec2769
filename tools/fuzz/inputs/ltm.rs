//! `.ltm`: whatever the bytes are, reading them ends, without a panic and without memory that they have not earned.
//!
//! An input is a list of changes to a sound file, (offset, byte) in three bytes each, whose checksums are then made to
//! hold, so that changes get past them; its first byte chooses the file. An input that begins with an odd byte is taken
//! as the file itself. Shared by the fuzz target and by `tests/fuzz.rs`, which needs no fuzzer.

use std::io;
use std::path::Path;

use ltm::matrix::{BlockSource, TracedBlock};
use ltm::store::{Storage, StoreReader, verify_storage};

/// A file of each precision, of the same job, one with planes of each version, and one with column scales.
pub(crate) const SOUND: [&[u8]; 7] = [
    include_bytes!("../../../formats/golden/v1-f16.ltm"),
    include_bytes!("../../../formats/golden/v1-f32.ltm"),
    include_bytes!("../../../formats/golden/v1-bf16.ltm"),
    include_bytes!("../../../formats/golden/v2-f16.ltm"),
    include_bytes!("../../../formats/golden/v3-f16.ltm"),
    include_bytes!("../../../formats/golden/v4-f16-planes.ltm"),
    include_bytes!("../../../formats/golden/v4-f16-column-scales.ltm"),
];
/// Offset of the commit table of these files, and blocks in them.
pub(crate) const TABLE: usize = 8192;
pub(crate) const BLOCKS: usize = 6;

/// Reads what an input stands for, all of it. Returns whether it opened.
pub(crate) fn look(input: &[u8]) -> bool {
    let bytes = match input.split_first() {
        Some((kind, rest)) if kind % 2 == 1 => rest.to_vec(),
        Some((kind, rest)) => {
            let mut bytes = SOUND[usize::from(kind / 2) % SOUND.len()].to_vec();
            for change in rest.chunks_exact(3) {
                let offset = u16::from_le_bytes([change[0], change[1]]) as usize;
                if let Some(byte) = bytes.get_mut(offset) {
                    *byte = change[2];
                }
            }
            seal(&mut bytes);
            bytes
        }
        None => return false,
    };
    let Ok(reader) = StoreReader::over(Bytes(bytes), Path::new("input")) else { return false };
    // More blocks than the file has bytes to commit cannot be.
    let mut target = TracedBlock::default();
    for id in reader.shape().blocks().take(2 * BLOCKS) {
        let committed = reader.is_committed(id);
        let read = reader.read_block(id, &mut target);
        assert!(committed || read.is_err());
        if read.is_ok() {
            let rect = reader.shape().rect(id);
            assert_eq!((target.block.rows(), target.block.columns()), (rect.rows(), reader.shape().columns()));
        }
    }
    let _ = reader.tally();
    let _ = verify_storage(&reader, |_, _| true);
    true
}

/// Makes the checksums of the description, the header, the records and all that the tiles hold fit their bytes.
fn seal(bytes: &mut [u8]) {
    for block in 0..BLOCKS {
        let _ = seal_tile(bytes, block);
    }
    let job = crc32fast::hash(&bytes[4096..TABLE]);
    bytes[40..44].copy_from_slice(&job.to_le_bytes());
    let header = crc32fast::hash(&bytes[12..4096]);
    bytes[8..12].copy_from_slice(&header.to_le_bytes());
    for record in bytes[TABLE..TABLE + 64 * BLOCKS].chunks_exact_mut(64) {
        let checksum = crc32fast::hash(&record[4..]);
        record[..4].copy_from_slice(&checksum.to_le_bytes());
    }
}

/// Makes the checksums of a tile hold, as far as its record says where they are; none where it does not.
fn seal_tile(bytes: &mut [u8], block: usize) -> Option<()> {
    // Blocks of 8 × 8 pixels, 3 × 2 of them, over 20 × 11 pixels; entries of 4 bytes, else of 2.
    let pixels = (if block % 3 == 2 { 4 } else { 8 }) * (if block / 3 == 1 { 3 } else { 8 });
    let entry = if number(bytes, 16)? == 0 { 4 } else { 2 };
    let clusters = number(bytes, 44)?;
    let record = TABLE + 64 * block;
    let field = |bytes: &[u8], at: usize| number(bytes, record + at);
    let tile = field(bytes, 16)?..field(bytes, 16)?.checked_add(field(bytes, 24)?)?;
    let probes = if field(bytes, 12)? == 1 { field(bytes, 36)? } else { 0 };
    let stored = field(bytes, 32)?.checked_add(probes)?;
    let planes_bytes = match field(bytes, 44)? {
        0 => 0,
        _ => {
            (60 * pixels + clusters.checked_mul(24 * pixels)?).next_multiple_of(4)
                + field(bytes, 48)?.checked_mul(20)?
        }
    };
    let column_bytes = 3 * pixels * entry;
    let side = tile.start + stored.checked_mul(column_bytes)?.next_multiple_of(8);
    let planes = tile.end.checked_sub(planes_bytes)?;
    bytes.get(side..planes)?;
    bytes.get(planes..tile.end)?;
    let checksums = side + 4 * number(bytes, 32)?.div_ceil(32);
    for column in 0..stored {
        let start = tile.start + column * column_bytes;
        let checksum = crc32fast::hash(bytes.get(start..start + column_bytes)?);
        bytes.get_mut(checksums + 4 * column..)?.get_mut(..4)?.copy_from_slice(&checksum.to_le_bytes());
    }
    for (at, part) in [(40, side..planes), (52, planes..tile.end)] {
        let checksum = if part.is_empty() { 0 } else { crc32fast::hash(&bytes[part]) };
        bytes[record + at..record + at + 4].copy_from_slice(&checksum.to_le_bytes());
    }
    Some(())
}

fn number(bytes: &[u8], at: usize) -> Option<usize> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize)
}

/// A file that cannot be written.
struct Bytes(Vec<u8>);

impl Storage for Bytes {
    fn length(&self) -> io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn read_at(&self, offset: u64, bytes: &mut [u8]) -> io::Result<usize> {
        let there = self.0.get(offset as usize..).unwrap_or_default();
        let read = there.len().min(bytes.len());
        bytes[..read].copy_from_slice(&there[..read]);
        Ok(read)
    }

    fn set_length(&self, _: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn write_at(&self, _: u64, _: &[u8]) -> io::Result<usize> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn sync(&self) -> io::Result<()> {
        Ok(())
    }

    fn reserve(&self, _: u64, _: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }

    fn clear(&self, _: u64, _: u64) -> io::Result<()> {
        Err(io::ErrorKind::ReadOnlyFilesystem.into())
    }
}
