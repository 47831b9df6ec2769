//! Reading where the file lies: the same blocks, damage and cuts as errors, and no more memory than what is being read.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use ltm::Error;
use ltm::matrix::{BlockId, BlockSource, ColumnIndex, LentBlock, TracedBlock};
use ltm::store::{Access, Precision, Storage, StoreOptions, StoreReader, StoreWriter};

use crate::blocks::{block, job, options, read, write_all};

fn written(folder: &Path, precision: Precision) -> std::path::PathBuf {
    let path = folder.join(format!("{precision}.ltm"));
    let writer = StoreWriter::create(&path, &job(40), StoreOptions { precision, ..options() }).unwrap();
    write_all(&job(40), &writer);
    writer.finish().unwrap();
    path
}

/// A block as `visit_block` gives it, and whether it came from where it is stored.
fn visited<S: Storage>(reader: &StoreReader<S>, id: BlockId) -> ltm::Result<(TracedBlock, bool)> {
    let mut found = None;
    reader.visit_block(id, &mut TracedBlock::default(), &mut |lent| {
        let mut copy =
            TracedBlock { noise: lent.noise().cloned(), planes: lent.planes().cloned(), ..TracedBlock::default() };
        copy.block.copy_from(lent.view());
        found = Some((copy, matches!(lent, LentBlock::Source { .. })));
        Ok(())
    })?;
    Ok(found.unwrap())
}

#[test]
fn what_is_lent_is_what_is_read_in_every_precision() {
    let folder = tempfile::tempdir().unwrap();
    for precision in Precision::ALL {
        let path = written(folder.path(), precision);
        let (mapped, positioned) = (StoreReader::open(&path).unwrap(), StoreReader::open_positioned(&path).unwrap());
        let mut borrowed = 0;
        for id in job(40).shape.blocks() {
            let whole = read(&positioned, id).unwrap();
            for reader in [&mapped as &dyn BlockSource, &positioned] {
                let mut columns = whole.block.clone();
                columns.entries_mut().fill(0.0);
                let give = &mut |column, entries: &[f32]| columns.column_mut(column).copy_from_slice(entries);
                reader.visit_columns(id, 0..40, &mut TracedBlock::default(), give).unwrap();
                assert_eq!(columns, whole.block, "{precision}, {id}");
            }
            // Twice: the second time its checksums are not looked at again.
            for _ in 0..2 {
                let (lent, from_source) = visited(&mapped, id).unwrap();
                assert!(lent == whole, "{precision}, {id}");
                borrowed += usize::from(from_source);
            }
            assert!(visited(&positioned, id).unwrap() == (whole, false));
        }
        // Blocks 0 and 4 hold every column; only as f32 is a block what it is in memory.
        assert_eq!(borrowed, if precision == Precision::F32 { 4 } else { 0 });
    }
}

#[test]
fn two_readers_and_two_threads_read_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::F32);
    let readers = [Access::Blocks, Access::Columns].map(|access| StoreReader::open_for(&path, access).unwrap());
    std::thread::scope(|scope| {
        for reader in readers.iter().chain(&readers) {
            scope.spawn(|| {
                for id in (0..20).flat_map(|_| job(40).shape.blocks()) {
                    assert!(visited(reader, id).unwrap().0 == block(&job(40), id));
                    let part = reader.read_columns(id, 7..23).unwrap();
                    assert_eq!(part.entries(), &block(&job(40), id).block.entries()[7 * part.rows()..23 * part.rows()]);
                }
            });
        }
    });
}

#[test]
fn damage_is_found_where_it_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::F32);
    let slot = StoreReader::open(&path).unwrap().layout().slot_offset(BlockId(0));
    let rows = job(40).shape.rect(BlockId(0)).rows() as u64;
    let file = File::options().write(true).open(&path).unwrap();
    file.write_all_at(&[0xff], slot + 12 * rows * 4 + 7).unwrap();
    let reader = StoreReader::open(&path).unwrap();
    let says = |result: ltm::Result<()>| {
        let error = result.unwrap_err();
        assert!(matches!(error, Error::Damaged { .. }), "{error}");
        assert!(error.to_string().contains("block 0: the checksum of column 12 does not hold"), "{error}");
    };
    for _ in 0..2 {
        says(visited(&reader, BlockId(0)).map(drop));
        says(reader.read_columns(BlockId(0), 3..13).map(drop));
        assert!(reader.read_columns(BlockId(0), 13..40).is_ok() && reader.read_columns(BlockId(0), 0..12).is_ok());
        assert!(visited(&reader, BlockId(4)).unwrap().1);
    }
}

#[test]
fn a_file_cut_while_a_block_is_lent_is_an_error_and_no_signal() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), Precision::F32);
    let reader = StoreReader::open(&path).unwrap();
    let layout = *reader.layout();
    let file = File::options().write(true).open(&path).unwrap();
    let mut touched = 0;
    let error = reader.visit_block(BlockId(4), &mut TracedBlock::default(), &mut |lent| {
        assert!(matches!(lent, LentBlock::Source { .. }));
        file.set_len(layout.slot_offset(BlockId(4)) + 10).unwrap();
        // Every page of it, those that are gone too.
        for entry in lent.view().entries() {
            std::hint::black_box(entry.to_bits());
            touched += 1;
        }
        Ok(())
    });
    assert_eq!(touched, job(40).shape.rect(BlockId(4)).rows() * 40);
    let message = error.unwrap_err().to_string();
    assert!(message.contains("block 4") && message.contains("changed while it was read"), "{message}");
    // From then on it is read positioned: what is there is right, what is not is an error.
    for id in job(40).shape.blocks() {
        match visited(&reader, id) {
            Ok(found) => assert!(found == (block(&job(40), id), false)),
            Err(error) => assert!(id.0 >= 4 && error.to_string().contains(&id.to_string()), "{error}"),
        }
    }
    let mut columns = 0;
    let error =
        reader.visit_columns(BlockId(4), 0..40, &mut TracedBlock::default(), &mut |_: ColumnIndex, _| columns += 1);
    assert!(error.is_err());
}
