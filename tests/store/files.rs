//! Files as a user meets them.

use std::fs;
use std::path::Path;

use ltm::Error;
use ltm::matrix::{BlockId, BlockSink, BlockSource, TracedBlock};
use ltm::store::{
    Mending, Precision, StoreOptions, StoreReader, StoreWriter, mend, merge, partial_path, requirements, verify,
};

use crate::blocks::{block, job, job_of, options, read, write_all};

fn written(path: &Path, columns: u32, ids: impl IntoIterator<Item = u32>) {
    let job = job(columns);
    let writer = StoreWriter::create(path, &job, options()).unwrap();
    for id in ids {
        writer.write_block(BlockId(id), &block(&job, BlockId(id))).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn what_is_written_comes_back_bit_for_bit_in_f32() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    for columns in [1, 5, 33, 200] {
        let job = job(columns);
        let writer = StoreWriter::create(&path, &job, StoreOptions { overwrite: true, ..options() }).unwrap();
        write_all(&job, &writer);
        assert!(partial_path(&path).exists());
        let summary = writer.finish().unwrap();
        assert!(summary.missing.is_empty() && !partial_path(&path).exists());
        let reader = StoreReader::open(&path).unwrap();
        let positioned = StoreReader::open_positioned(&path).unwrap();
        assert_eq!(*reader.job(), job);
        assert_eq!(reader.tally().unwrap().stored_bytes, summary.stored_bytes);
        // One target for all: what an earlier block left in it must not show.
        let mut target = TracedBlock::default();
        for id in job.shape.blocks() {
            reader.read_block(id, &mut target).unwrap();
            assert!(target == block(&job, id), "{columns} columns, {id}");
            positioned.read_block(id, &mut target).unwrap();
            assert!(target == block(&job, id), "positioned, {columns} columns, {id}");
        }
        assert!(verify(&path, |_, _| true).unwrap().is_complete());
    }
}

#[test]
fn sixteen_bit_precisions_keep_their_stated_error() {
    let folder = tempfile::tempdir().unwrap();
    let job = job(40);
    for precision in [Precision::F16, Precision::Bf16] {
        let path = folder.path().join(format!("{precision}.ltm"));
        let writer = StoreWriter::create(&path, &job, StoreOptions { precision, ..options() }).unwrap();
        write_all(&job, &writer);
        writer.finish().unwrap();
        let reader = StoreReader::open(&path).unwrap();
        assert_eq!(reader.precision(), precision);
        for id in job.shape.blocks() {
            let (stored, original) = (read(&reader, id).unwrap(), block(&job, id));
            for (stored, original) in stored.block.entries().iter().zip(original.block.entries()) {
                // All entries are below 1, so the floor of f16 is 2⁻³⁹.
                let bound = precision.relative_error() * f64::from(original.abs()) + 2f64.powi(-39);
                assert!(f64::from((stored - original).abs()) <= bound, "{precision}: {original} became {stored}");
            }
            // Variances are kept in f32 at every precision.
            let variances = |noise: TracedBlock| noise.noise.map(|n| (n.row_variance, n.column_variance));
            assert_eq!(variances(stored), variances(original));
        }
        assert!(verify(&path, |_, _| true).unwrap().is_complete());
    }
}

#[test]
fn columns_are_read_without_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    written(&path, 40, 0..6);
    let reader = StoreReader::open(&path).unwrap();
    for id in 0..6 {
        let id = BlockId(id);
        let whole = read(&reader, id).unwrap().block;
        for range in [0..40, 0..1, 7..23, 39..40, 5..5] {
            let part = reader.read_columns(id, range.clone()).unwrap();
            let rows = whole.rows();
            assert_eq!(part.entries(), &whole.entries()[range.start as usize * rows..range.end as usize * rows]);
        }
    }
    assert!(reader.read_columns(BlockId(0), 30..41).is_err());
    assert!(reader.read_columns(BlockId(6), 0..1).is_err());
}

#[test]
fn the_bytes_do_not_depend_on_the_order_nor_on_interruptions() {
    let folder = tempfile::tempdir().unwrap();
    let (once, broken) = (folder.path().join("once.ltm"), folder.path().join("broken.ltm"));
    written(&once, 40, 0..6);
    let job = job(40);
    for id in [4, 1, 3, 0, 5, 2] {
        // A new writer for each block, as if stopped after each.
        let writer = StoreWriter::create_or_resume(&broken, &job, options()).unwrap();
        assert!(!writer.is_committed(BlockId(id)));
        writer.write_block(BlockId(id), &block(&job, BlockId(id))).unwrap();
    }
    StoreWriter::resume(&broken, &job, options()).unwrap().finish().unwrap();
    assert!(fs::read(&once).unwrap() == fs::read(&broken).unwrap());
}

#[test]
fn a_growing_file_shows_exactly_the_committed_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    let job = job(40);
    let writer = StoreWriter::create(&path, &job, options()).unwrap();
    let reader = StoreReader::open(&partial_path(&path)).unwrap();
    for id in job.shape.blocks() {
        assert!(!reader.is_committed(id));
        assert!(matches!(read(&reader, id), Err(Error::Input { .. })));
        writer.write_block(id, &block(&job, id)).unwrap();
        assert!(reader.is_committed(id));
        assert_eq!(read(&reader, id).unwrap(), block(&job, id));
    }
    let hint = StoreReader::open(&path).err().unwrap().to_string();
    assert!(hint.contains("is not finished") && hint.contains(".part"), "{hint}");
    writer.finish().unwrap();
    // A reader opened before the file got its name goes on.
    assert_eq!(read(&reader, BlockId(0)).unwrap(), block(&job, BlockId(0)));
}

#[test]
fn zero_columns_and_blocks_take_no_disk() {
    use std::os::unix::fs::MetadataExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    // 16 blocks of 3,072 rows × 256 columns: 48 MiB if they were full.
    let job = job_of(128, 128, 256, 32);
    let writer = StoreWriter::create(&path, &job, options()).unwrap();
    for id in job.shape.blocks() {
        let mut traced = TracedBlock::default();
        traced.block.reset(3072, 256);
        if id.0 == 5 {
            traced.block.entries_mut()[3072 * 17] = 1.0;
        }
        writer.write_block(id, &traced).unwrap();
    }
    let summary = writer.finish().unwrap();
    // One column of 12 KiB and 36 bytes beside it.
    assert!(summary.stored_bytes < 13_000, "{}", summary.stored_bytes);
    let on_disk = fs::metadata(&path).unwrap().blocks() * 512;
    // Header, description, table and the one column, by pages; the file system may add some of its own.
    assert!(on_disk < 200_000, "{on_disk} bytes on disk");
    let reader = StoreReader::open(&path).unwrap();
    assert_eq!(read(&reader, BlockId(5)).unwrap().block.entries()[3072 * 17], 1.0);
    assert!(verify(&path, |_, _| true).unwrap().is_complete());
}

#[test]
fn another_job_or_precision_or_name_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    drop(StoreWriter::create(&path, &job(5), options()).unwrap());
    assert!(!partial_path(&path).exists(), "a file without blocks is not worth continuing");
    let writer = StoreWriter::create(&path, &job(5), options()).unwrap();
    let busy = StoreWriter::resume(&path, &job(5), options()).err().unwrap().to_string();
    assert!(busy.contains("another process is writing it"), "{busy}");
    writer.write_block(BlockId(0), &block(&job(5), BlockId(0))).unwrap();
    let twice = writer.write_block(BlockId(0), &block(&job(5), BlockId(0)));
    assert!(twice.is_err());
    assert!(writer.write_block(BlockId(1), &block(&job(5), BlockId(2))).is_err(), "a block of another shape");
    assert!(writer.write_block(BlockId(6), &block(&job(5), BlockId(0))).is_err(), "there is no such block");
    drop(writer);
    let message = |result: ltm::Result<StoreWriter>| result.err().unwrap().to_string();
    assert!(message(StoreWriter::create(&path, &job(5), options())).contains("exists already"));
    assert!(message(StoreWriter::resume(&path, &job(6), options())).contains("another job"));
    let f16 = StoreOptions { precision: Precision::F16, ..options() };
    assert!(message(StoreWriter::resume(&path, &job(5), f16)).contains("stored as f32, not f16"));
    StoreWriter::resume(&path, &job(5), options()).unwrap().finish().unwrap();
    assert!(message(StoreWriter::create(&path, &job(5), options())).contains("exists already"));
    assert!(StoreWriter::resume(&path, &job(5), options()).is_err());
}

#[test]
fn what_does_not_fit_the_disk_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    let job = job_of(65_536, 65_536, 65_536, 256);
    assert!(requirements(&job, &options()).disk_bytes > job.shape.raw_bytes());
    let error = StoreWriter::create(&path, &job, options()).err().unwrap();
    assert!(matches!(error, Error::Resources { .. }), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "something was left behind");
}

#[test]
fn merging_joins_block_ranges_and_again_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    written(&at("whole.ltm"), 40, 0..6);
    written(&at("a.ltm"), 40, 0..3);
    written(&at("b.ltm"), 40, 2..5);
    written(&at("c.ltm"), 40, 5..6);
    let report = merge(&[at("a.ltm"), at("b.ltm")], &at("all.ltm"), |_, _| true).unwrap();
    assert_eq!((report.copied, report.present, report.missing), (5, 0, vec![BlockId(5)]));
    let again = merge(&[at("a.ltm"), at("b.ltm")], &at("all.ltm"), |_, _| true).unwrap();
    assert_eq!((again.copied, again.present, again.missing), (0, 5, vec![BlockId(5)]));
    assert!(merge(&[at("c.ltm")], &at("all.ltm"), |_, _| true).unwrap().missing.is_empty());
    assert!(fs::read(at("all.ltm")).unwrap() == fs::read(at("whole.ltm")).unwrap());
    written(&at("other.ltm"), 41, 0..6);
    assert!(merge(&[at("a.ltm"), at("other.ltm")], &at("no.ltm"), |_, _| true).is_err());
    assert!(!at("no.ltm").exists());
}

#[test]
fn damaged_blocks_are_listed_and_can_be_mended() {
    use std::os::unix::fs::FileExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    written(&path, 40, 0..6);
    let sound = fs::read(&path).unwrap();
    let reader = StoreReader::open(&path).unwrap();
    let at = reader.layout().slot_offset(BlockId(2)) + 100;
    fs::File::options().write(true).open(&path).unwrap().write_at(&[0xff], at).unwrap();
    let report = verify(&path, |_, _| true).unwrap();
    assert_eq!(report.damaged.iter().map(|d| d.block).collect::<Vec<_>>(), [BlockId(2)]);
    assert!(report.damaged[0].problem.contains("column 1 "), "{:?}", report.damaged);
    for id in reader.shape().blocks() {
        assert_eq!(read(&reader, id).is_ok(), id != BlockId(2));
    }
    // Bytes where none should be, too.
    let last = reader.layout().slot_offset(BlockId(1)) + reader.layout().slot_bytes(BlockId(1)) - 1;
    fs::File::options().write(true).open(&path).unwrap().write_at(&[0xff], last).unwrap();
    assert_eq!(verify(&path, |_, _| true).unwrap().stray.len(), 1);
    let Mending { writer, again, job } = mend(&path, |_, _| true).unwrap();
    assert_eq!((again.as_slice(), &job), (&[BlockId(2)][..], reader.job()));
    assert!(!reader.is_committed(BlockId(2)), "a file under repair lacks the block, it does not show half of it");
    for id in again {
        writer.write_block(id, &block(&job, id)).unwrap();
    }
    writer.finish().unwrap();
    assert!(fs::read(&path).unwrap() == sound);
}

fn flip(path: &Path, at: u64) {
    use std::os::unix::fs::FileExt;
    let file = fs::File::options().read(true).write(true).open(path).unwrap();
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).unwrap();
    file.write_all_at(&[!byte[0]], at).unwrap();
}

#[test]
fn merging_replaces_a_damaged_block_of_the_output_and_tells_of_one_that_nobody_has_whole() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    written(&at("good.ltm"), 40, 0..6);
    written(&at("out.ltm"), 40, 0..6);
    let whole = fs::read(at("good.ltm")).unwrap();
    let slot = StoreReader::open(&at("out.ltm")).unwrap().layout().slot_offset(BlockId(2));
    flip(&at("out.ltm"), slot + 100);
    fs::copy(at("out.ltm"), at("bad.ltm")).unwrap();
    let merged = |inputs: &[&str]| {
        let inputs: Vec<_> = inputs.iter().map(|name| at(name)).collect();
        merge(&inputs, &at("out.ltm"), |_, _| true)
    };
    let report = merged(&["bad.ltm"]).unwrap();
    assert_eq!((report.copied, report.mended, report.present), (0, 0, 6));
    assert!(report.damaged.iter().all(|(_, damage)| damage.block == BlockId(2)) && report.damaged.len() == 2);
    let report = merged(&["bad.ltm", "good.ltm"]).unwrap();
    assert_eq!((report.copied, report.mended, report.present), (1, 1, 5));
    assert!(report.damaged.is_empty() && fs::read(at("out.ltm")).unwrap() == whole);
}

#[test]
fn merging_refuses_an_input_that_contradicts_the_output_and_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    written(&at("a.ltm"), 40, 0..6);
    let job = job(40);
    let writer = StoreWriter::create(&at("b.ltm"), &job, options()).unwrap();
    let mut other = block(&job, BlockId(1));
    other.block.entries_mut()[0] += 1.0;
    writer.write_block(BlockId(1), &other).unwrap();
    writer.finish().unwrap();
    written(&at("out.ltm"), 40, 0..6);
    let before = fs::read(at("out.ltm")).unwrap();
    let error = merge(&[at("b.ltm")], &at("out.ltm"), |_, _| true).unwrap_err().to_string();
    assert!(error.contains("block 1 differs from that in"), "{error}");
    assert!(fs::read(at("out.ltm")).unwrap() == before);
    let stopped = merge(&[at("a.ltm")], &at("new.ltm"), |done, _| done < 3);
    assert!(matches!(stopped, Err(Error::Interrupted { .. })));
    let report = merge(&[at("a.ltm")], &at("new.ltm"), |_, _| true).unwrap();
    assert_eq!((report.copied, report.present), (3, 3));
    assert!(fs::read(at("new.ltm")).unwrap() == before);
}

#[test]
fn merging_refuses_an_output_whose_blocks_have_other_places() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    written(&at("a.ltm"), 40, 0..3);
    for (name, other) in [
        ("bare.ltm", StoreOptions { planes: false, ..options() }),
        ("noise.ltm", StoreOptions { max_probes: options().max_probes + 1, ..options() }),
    ] {
        let job = job(40);
        let writer = StoreWriter::create(&at(name), &job, other).unwrap();
        writer.write_block(BlockId(5), &block(&job, BlockId(5))).unwrap();
        writer.finish().unwrap();
        let before = fs::read(at(name)).unwrap();
        let error = merge(&[at("a.ltm")], &at(name), |_, _| true).unwrap_err().to_string();
        assert!(error.contains("other room for planes or noise"), "{error}");
        assert!(fs::read(at(name)).unwrap() == before);
    }
}

#[test]
fn a_file_that_appears_while_another_is_finished_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltm");
    let writer = StoreWriter::create(&path, &job(5), options()).unwrap();
    write_all(&job(5), &writer);
    fs::write(&path, "another's").unwrap();
    let error = writer.finish().unwrap_err().to_string();
    assert!(error.contains("meanwhile"), "{error}");
    assert_eq!(fs::read_to_string(&path).unwrap(), "another's");
    assert!(partial_path(&path).exists());
}
