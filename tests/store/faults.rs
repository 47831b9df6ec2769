//! Disks that fill up, writes that tear, power that goes.

use std::path::Path;
use std::sync::atomic::Ordering;

use ltm::Error;
use ltm::light::Job;
use ltm::matrix::{BlockId, BlockSink, TracedBlock};
use ltm::store::{Precision, StoreOptions, StoreReader, StoreWriter, verify_storage};

use crate::blocks::{block, job, options, read, write_all};
use crate::storages::{Memory, Operation, Watched, apply};

fn finished(job: &Job, options: StoreOptions) -> Memory {
    let memory = Memory::default();
    let writer = StoreWriter::create_over(&memory, job, options).unwrap();
    write_all(job, &writer);
    writer.finish().unwrap();
    memory
}

fn reader(memory: &Memory) -> StoreReader<&Memory> {
    StoreReader::over(memory, Path::new("in memory")).unwrap()
}

#[test]
fn reads_and_writes_of_a_few_bytes_at_a_time_make_no_difference() {
    let job = job(5);
    let short = Watched { at_most: 7, ..Watched::default() };
    let writer = StoreWriter::create_over(&short, &job, options()).unwrap();
    write_all(&job, &writer);
    writer.finish().unwrap();
    assert!(short.inner.content() == finished(&job, options()).content());
    let reader = StoreReader::over(&short, Path::new("in memory")).unwrap();
    for id in job.shape.blocks() {
        assert_eq!(read(&reader, id).unwrap(), block(&job, id));
    }
}

#[test]
fn a_disk_that_fills_up_at_any_instant_keeps_what_is_committed() {
    let job = job(40);
    let whole = finished(&job, options()).content();
    let mut instants = 0;
    for freezes_after in 1.. {
        let disk = Watched { freezes_after, ..Watched::default() };
        let mut committed = Vec::new();
        let written = StoreWriter::create_over(&disk, &job, options()).and_then(|writer| {
            for id in job.shape.blocks() {
                writer.write_block(id, &block(&job, id))?;
                committed.push(id);
            }
            writer.finish()
        });
        match written {
            Ok(_) => break,
            Err(error) => assert!(matches!(error, Error::Io { .. }), "{error}"),
        }
        instants += 1;
        // Room was made: the same command again.
        let disk = disk.inner;
        if disk.content().iter().take(4096).all(|&byte| byte == 0) {
            assert!(committed.is_empty());
            continue;
        }
        let writer = StoreWriter::resume_over(&disk, &job, options()).unwrap();
        assert!(committed.iter().all(|&id| writer.is_committed(id)), "lost after {freezes_after} operations");
        for id in job.shape.blocks().filter(|&id| !writer.is_committed(id)) {
            writer.write_block(id, &block(&job, id)).unwrap();
        }
        writer.finish().unwrap();
        assert!(disk.content() == whole, "differs after {freezes_after} operations");
    }
    assert!(instants > 20, "only {instants} instants were tried");
}

/// What a disk may hold when the power goes after `count` operations: everything before the last sync, and of what
/// came later any set of sectors.
fn image_after(operations: &[Operation], count: usize, random: &mut impl FnMut() -> u64) -> Vec<u8> {
    let done = &operations[..count];
    let synced = done.iter().rposition(|operation| matches!(operation, Operation::Sync)).unwrap_or(0);
    let mut image = Vec::new();
    done[..synced].iter().for_each(|operation| apply(&mut image, operation));
    for operation in &done[synced..] {
        match operation {
            Operation::Write(offset, bytes) => {
                let mut at = 0;
                while at < bytes.len() {
                    let sector_end = (offset + at as u64 + 1).next_multiple_of(512) - offset;
                    let end = (sector_end as usize).min(bytes.len());
                    if random().is_multiple_of(2) {
                        apply(&mut image, &Operation::Write(offset + at as u64, bytes[at..end].to_vec()));
                    }
                    at = end;
                }
            }
            Operation::Clear(..) if random().is_multiple_of(2) => {}
            other => apply(&mut image, other),
        }
    }
    image
}

fn generator(mut state: u64) -> impl FnMut() -> u64 {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    }
}

#[test]
fn a_commit_record_never_outlives_its_data_when_the_power_goes() {
    let job = job(40);
    let made = finished(&job, options());
    let operations = made.operations.lock().unwrap().clone();
    let whole = made.content();
    let mut random = generator(1);
    let mut committed = 0;
    for count in 0..=operations.len() {
        for _ in 0..8 {
            let image = image_after(&operations, count, &mut random);
            if image.iter().take(4096).all(|&byte| byte == 0) {
                continue;
            }
            let disk = Memory::holding(image);
            for id in job.shape.blocks().filter(|&id| reader(&disk).is_committed(id)) {
                assert_eq!(read(&reader(&disk), id).unwrap(), block(&job, id), "after {count} operations");
                committed += 1;
            }
            let writer = StoreWriter::resume_over(&disk, &job, options()).unwrap();
            for id in job.shape.blocks().filter(|&id| !writer.is_committed(id)) {
                writer.write_block(id, &block(&job, id)).unwrap();
            }
            writer.finish().unwrap();
            assert!(disk.content() == whole, "after {count} operations");
        }
    }
    assert!(committed > 100, "only {committed} blocks were looked at");
}

#[test]
fn mending_a_block_never_shows_half_of_it_when_the_power_goes() {
    let job = job(40);
    let whole = finished(&job, options()).content();
    let mut broken = whole.clone();
    let slot = reader(&Memory::holding(whole.clone())).layout().slot_offset(BlockId(2)) as usize;
    broken[slot..slot + 1000].fill(0x55);
    let disk = Memory::holding(broken.clone());
    let writer = StoreWriter::resume_over(&disk, &job, options()).unwrap();
    writer.discard(BlockId(2)).unwrap();
    writer.write_block(BlockId(2), &block(&job, BlockId(2))).unwrap();
    writer.finish().unwrap();
    assert!(disk.content() == whole);
    let mut operations = vec![Operation::Write(0, broken), Operation::Sync];
    operations.extend(disk.operations.lock().unwrap().clone());
    let mut random = generator(2);
    for count in 2..=operations.len() {
        for _ in 0..20 {
            let disk = Memory::holding(image_after(&operations, count, &mut random));
            for id in job.shape.blocks().filter(|&id| reader(&disk).is_committed(id)) {
                match read(&reader(&disk), id) {
                    Ok(found) => assert_eq!(found, block(&job, id)),
                    // Until the record is gone the old damage shows.
                    Err(error) => assert!(id == BlockId(2) && matches!(error, Error::Damaged { .. }), "{error}"),
                }
            }
        }
    }
}

#[test]
fn a_block_costs_its_own_bytes_and_one_sync() {
    let job = job(40);
    for (precision, planes) in Precision::ALL.into_iter().flat_map(|precision| [(precision, false), (precision, true)])
    {
        let counted = Watched::default();
        let options = StoreOptions { precision, planes, ..options() };
        let writer = StoreWriter::create_over(&counted, &job, options).unwrap();
        let of = |count: &std::sync::atomic::AtomicU64| count.load(Ordering::Relaxed);
        for id in job.shape.blocks() {
            counted.restart();
            let traced = block(&job, id);
            writer.write_block(id, &traced).unwrap();
            let (writes, bytes, syncs) = (of(&counted.writes), of(&counted.written_bytes), of(&counted.syncs));
            counted.restart();
            let reader = StoreReader::over(&counted, Path::new("in memory")).unwrap();
            let opening = of(&counted.reads);
            counted.restart();
            let mut target = TracedBlock::default();
            ltm::matrix::BlockSource::read_block(&reader, id, &mut target).unwrap();
            assert_eq!(of(&counted.read_bytes), bytes, "{id}: reading takes what was written");
            assert_eq!(opening, 2, "opening reads the header and the description, not the table");
            let planes = u64::from(planes && traced.planes.is_some());
            if id.0 == 3 {
                // All zero: the record alone, and planes where there are any.
                assert_eq!((writes, syncs, of(&counted.reads)), (1 + planes, planes, 1 + planes));
                assert!(planes > 0 || bytes == 64);
            } else {
                // Planes, runs of columns, probes, side data, record.
                let runs = if id.0 % 4 == 1 { 14 } else { 1 };
                let probes = u64::from(traced.noise.is_some());
                assert_eq!((writes, syncs), (planes + runs + probes + 2, 1), "{id}");
                // Stored columns lie together: one read.
                assert_eq!(of(&counted.reads), planes + 1 + probes + 2, "{id}");
            }
        }
    }
}

#[test]
fn a_few_columns_cost_a_few_columns() {
    let job = job(40);
    let counted = Watched::default();
    let writer = StoreWriter::create_over(&counted, &job, options()).unwrap();
    write_all(&job, &writer);
    drop(writer);
    let reader = StoreReader::over(&counted, Path::new("in memory")).unwrap();
    counted.restart();
    let rows = job.shape.rect(BlockId(0)).rows() as u64;
    reader.read_columns(BlockId(0), 10..13).unwrap();
    // The record; which columns, 42 checksums and the variances; three columns.
    let side = 8 + 42 * 4 + (rows + 40) * 4;
    assert_eq!(counted.reads.load(Ordering::Relaxed), 3);
    assert_eq!(counted.read_bytes.load(Ordering::Relaxed), 64 + side + 3 * rows * 4);
}

#[test]
fn blocks_may_come_from_many_threads_at_once() {
    let job = crate::blocks::job_of(200, 200, 9, 8);
    let memory = Memory::default();
    let writer = StoreWriter::create_over(&memory, &job, options()).unwrap();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (writer, job) = (&writer, &job);
            scope.spawn(move || {
                for id in job.shape.blocks().filter(|id| id.0 % 4 == thread) {
                    writer.write_block(id, &block(job, id)).unwrap();
                }
            });
        }
    });
    writer.finish().unwrap();
    assert!(verify_storage(&reader(&memory), |_, _| true).unwrap().is_complete());
    assert!(memory.content() == finished(&job, options()).content());
}
