//! Files that are not what they were: cut, flipped, shrinking, absurd.

use std::path::Path;

use ltm::Error;
use ltm::matrix::{BlockId, BlockSink, TracedBlock};
use ltm::store::{Storage, StoreReader, StoreWriter, verify_storage};

use crate::blocks::{block, job, options, read, write_all};
use crate::storages::Memory;

fn small_file() -> Vec<u8> {
    let memory = Memory::default();
    let writer = StoreWriter::create_over(&memory, &job(3), options()).unwrap();
    write_all(&job(3), &writer);
    writer.finish().unwrap();
    memory.content()
}

fn open(bytes: &Memory) -> ltm::Result<StoreReader<&Memory>> {
    StoreReader::over(bytes, Path::new("in memory"))
}

/// Reads every block: what comes is right, what does not come is an error that names the block. Returns the bad ones.
fn bad_blocks(reader: &StoreReader<impl Storage>) -> Vec<BlockId> {
    let job = job(3);
    let mut bad = Vec::new();
    for id in job.shape.blocks() {
        match read(reader, id) {
            Ok(found) => assert!(found == block(&job, id), "{id} is silently wrong"),
            Err(Error::Damaged { problem, .. }) => {
                assert!(problem.contains(&id.to_string()), "{problem}");
                bad.push(id);
            }
            Err(other) => panic!("{other}"),
        }
    }
    bad
}

#[test]
fn a_file_cut_at_any_length_is_an_error_that_says_where_and_leaves_whole_blocks_readable() {
    let bytes = small_file();
    let memory = Memory::holding(bytes.clone());
    let layout = *open(&memory).unwrap().layout();
    for length in (0..bytes.len()).rev() {
        memory.set_length(length as u64).unwrap();
        let reader = match open(&memory) {
            Ok(reader) => reader,
            Err(error) => {
                let message = error.to_string();
                let says = message.contains("cut short") || (length == 0 && message.contains("not an .ltm"));
                assert!(says, "{length}: {message}");
                assert!((length as u64) < layout.slots_offset());
                continue;
            }
        };
        assert!(length as u64 >= layout.slots_offset());
        let report = verify_storage(&reader, |_, _| true).unwrap();
        assert!(!report.is_sound(), "cut to {length} bytes unnoticed");
        let bad = bad_blocks(&reader);
        assert_eq!(report.damaged.iter().map(|d| d.block).collect::<Vec<_>>(), bad);
        for id in job(3).shape.blocks() {
            // A block whose slot is whole is readable.
            let end = layout.slot_offset(id) + layout.slot_bytes(id);
            assert!(end > length as u64 || !bad.contains(&id), "{id} lost at {length}");
        }
    }
}

#[test]
fn every_flipped_byte_is_noticed_and_harms_one_block_at_most() {
    let bytes = small_file();
    let memory = Memory::holding(bytes.clone());
    let layout = *open(&memory).unwrap().layout();
    for at in 0..bytes.len() {
        for flip in [0x01, 0xff] {
            memory.bytes.lock().unwrap()[at] ^= flip;
            match open(&memory) {
                Ok(reader) => {
                    assert!(at as u64 >= layout.table_offset(), "byte {at} of the header flipped unnoticed");
                    let report = verify_storage(&reader, |_, _| true).unwrap();
                    assert!(!report.is_sound(), "byte {at} flipped unnoticed");
                    let bad = bad_blocks(&reader);
                    assert!(bad.len() <= 1);
                    assert_eq!(report.damaged.iter().map(|d| d.block).collect::<Vec<_>>(), bad);
                }
                Err(_) => assert!((at as u64) < layout.table_offset(), "byte {at} made everything unreadable"),
            }
            memory.bytes.lock().unwrap()[at] ^= flip;
        }
    }
    assert!(memory.content() == bytes);
}

fn shrinks<S: Storage>(path: &Path, reader: &StoreReader<S>) {
    assert_eq!(bad_blocks(reader), []);
    let file = std::fs::File::options().write(true).open(path).unwrap();
    let layout = *reader.layout();
    file.set_len(layout.slot_offset(BlockId(4)) + 10).unwrap();
    assert_eq!(bad_blocks(reader), [BlockId(4), BlockId(5)]);
    file.set_len(100).unwrap();
    let mut target = TracedBlock::default();
    let error = ltm::matrix::BlockSource::read_block(reader, BlockId(0), &mut target).unwrap_err();
    assert!(error.to_string().contains("block 0"), "{error}");
}

#[test]
fn a_file_that_shrinks_while_it_is_read_gives_errors_and_keeps_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    std::fs::write(&path, small_file()).unwrap();
    shrinks(&path, &StoreReader::open(&path).unwrap());
    std::fs::write(&path, small_file()).unwrap();
    shrinks(&path, &StoreReader::open_positioned(&path).unwrap());
}

/// A header whose fields are changed and whose checksum is made to hold: what a program with a fault, or with bad
/// intent, would write.
/// What a killed write left where no block is committed: nobody sees it, and finishing the file clears it.
#[test]
fn what_lies_in_the_slot_of_a_block_that_is_not_committed_is_never_seen() {
    let job = job(3);
    let begun = Memory::default();
    let writer = StoreWriter::create_over(&begun, &job, options()).unwrap();
    writer.write_block(BlockId(0), &block(&job, BlockId(0))).unwrap();
    drop(writer);
    let layout = *open(&begun).unwrap().layout();
    let mut bytes = begun.content();
    for id in job.shape.blocks().skip(1) {
        let slot = layout.slot_offset(id) as usize..(layout.slot_offset(id) + layout.slot_bytes(id)) as usize;
        bytes[slot].fill(0xa5);
    }
    let left = Memory::holding(bytes);
    let report = verify_storage(&open(&left).unwrap(), |_, _| true).unwrap();
    assert_eq!((report.missing.len(), report.damaged.len(), report.stray.len()), (5, 0, 0), "{report:?}");
    assert!(read(&open(&left).unwrap(), BlockId(1)).is_err());
    // As it is, and with all blocks.
    let finished = |memory: Memory, all: bool| {
        let writer = StoreWriter::resume_over(&memory, &job, options()).unwrap();
        for id in job.shape.blocks().filter(|_| all).filter(|&id| !writer.is_committed(id)).collect::<Vec<_>>() {
            writer.write_block(id, &block(&job, id)).unwrap();
        }
        writer.finish().unwrap();
        memory.content()
    };
    assert!(finished(Memory::holding(left.content()), true) == small_file());
    let bytes = finished(left, false);
    for id in job.shape.blocks().skip(1) {
        let slot = layout.slot_offset(id) as usize..(layout.slot_offset(id) + layout.slot_bytes(id)) as usize;
        assert!(bytes[slot].iter().all(|&byte| byte == 0), "{id}");
    }
}

fn with_header_field(bytes: &[u8], name: &str, value: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let (_, offset, size) = *ltm::store::HEADER_FIELDS.iter().find(|field| field.0 == name).unwrap();
    assert_eq!(size, value.len());
    bytes[offset..offset + size].copy_from_slice(value);
    let checksum = crc32fast::hash(&bytes[12..4096]);
    bytes[8..12].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

#[test]
fn absurd_sizes_with_good_checksums_are_refused_without_allocating_for_them() {
    let bytes = small_file();
    let huge = u32::MAX.to_le_bytes();
    for name in ["precision", "max_probes", "width", "height", "columns", "block_side", "clusters"] {
        assert!(open(&Memory::holding(with_header_field(&bytes, name, &huge))).is_err(), "{name}");
    }
    for name in ["width", "height"] {
        let most = Memory::holding(with_header_field(&bytes, name, &65_536u32.to_le_bytes()));
        assert!(open(&most).is_err(), "{name}");
    }
    for name in ["job_bytes", "table_offset", "slots_offset", "file_bytes"] {
        for value in [0, u64::MAX, u64::MAX - 4095, 1 << 40] {
            let absurd = Memory::holding(with_header_field(&bytes, name, &value.to_le_bytes()));
            assert!(open(&absurd).is_err(), "{name} = {value}");
        }
    }
    let newer = Memory::holding(with_header_field(&bytes, "version", &255u32.to_le_bytes()));
    let message = open(&newer).err().unwrap().to_string();
    assert!(message.contains("format version 255"), "{message}");
}

#[test]
fn records_with_good_checksums_cannot_point_elsewhere() {
    let bytes = small_file();
    let layout = *open(&Memory::holding(bytes.clone())).unwrap().layout();
    for &(name, offset, _) in &ltm::store::RECORD_FIELDS[1..] {
        for value in [0xffu8, 0x02] {
            let mut changed = bytes.clone();
            let record = &mut changed[layout.record_offset(BlockId(1)) as usize..][..64];
            // Unchanged, or another thing that is possible: block 1 stores no noise, and 2 would say that it is zero.
            if record[offset] == value || (name, value) == ("noise", 2) {
                continue;
            }
            record[offset] = value;
            let checksum = crc32fast::hash(&record[4..]);
            record[..4].copy_from_slice(&checksum.to_le_bytes());
            let memory = Memory::holding(changed);
            assert_eq!(bad_blocks(&open(&memory).unwrap()), [BlockId(1)], "{name}");
        }
    }
}
