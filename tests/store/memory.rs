//! What the store takes in memory does not depend on the size of the matrix.

use std::path::{Path, PathBuf};
use std::process::Command;

use ltm::light::{Clusters, Job};
use ltm::matrix::{BlockPlanes, BlockSink, BlockSource, CHANNELS, SeenEmission, TracedBlock};
use ltm::store::{Precision, StoreOptions, StoreReader, StoreWriter, merge, requirements, verify};

use crate::blocks::job_of;

const CHILD: &str = "LTM_TEST_STORE_MEMORY";

/// Peak resident memory of this process, in bytes.
fn peak_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

/// Does nothing unless it is the child that the test below starts.
#[test]
fn the_memory_child() {
    let Some(folder) = std::env::var_os(CHILD).map(PathBuf::from) else { return };
    let small = job_of(4, 8, 3, 4);
    // 24 blocks of 3,072 rows × 512 columns: 6 MiB each, 144 MiB in all.
    let large = job_of(32, 32 * 24, 512, 32);
    for precision in Precision::ALL {
        let options = StoreOptions { precision, planes: true, ..StoreOptions::default() };
        // The program's own pages count as they are touched: touch them first.
        through(&folder, &small, options);
        let taken = through(&folder, &large, options);
        // The allocator rounds up and keeps what is freed: a quarter more, and a few pages.
        let stated = requirements(&large, &options).memory_bytes;
        assert!(taken <= stated + stated / 4 + 65_536, "{precision}: took {taken} bytes, said {stated}");
        // Pages that a map shows count as resident while a block of them is lent, and what is around it.
        let block = (large.shape.max_block_rows() * large.shape.columns() * 4) as u64;
        let lent = lending(&folder, &large, options);
        assert!(lent <= stated + stated / 4 + block + 262_144, "{precision}: took {lent} bytes, said {stated}");
    }
    // The parent waits for it: a name that no test has ends without an error.
    std::fs::write(folder.join("done"), "").unwrap();
}

/// Planes of a whole block that list as many emitters as there may be.
fn planes(job: &Job) -> BlockPlanes {
    let (pixels, columns) = (job.shape.max_block_rows() / CHANNELS, job.shape.columns());
    let mut planes = BlockPlanes::default();
    planes.reset(pixels, Clusters::of_basis(&job.basis).count());
    let most = BlockPlanes::most_seen(pixels as u64, columns as u64) as usize;
    let in_pixel = most / pixels;
    let seen = |i: usize| SeenEmission { pixel: (i / in_pixel) as u32, column: (i % in_pixel) as u32, value: [1.0; 3] };
    planes.emission = (0..most).map(seen).collect();
    planes
}

/// Everything that the store does with a matrix, once; returns by how much the peak rose beside the blocks.
fn through(folder: &Path, job: &Job, options: StoreOptions) -> u64 {
    let (path, merged) = (folder.join("a.ltm"), folder.join("merged.ltm"));
    let mut traced = TracedBlock::default();
    traced.block.reset(job.shape.max_block_rows(), job.shape.columns());
    traced.block.entries_mut().fill(0.5);
    traced.planes = Some(planes(job));
    let mut target = traced.clone();
    let before = peak_bytes();
    let writer = StoreWriter::create(&path, job, options).unwrap();
    job.shape.blocks().for_each(|id| writer.write_block(id, &traced).unwrap());
    writer.finish().unwrap();
    verify(&path, |_, _| true).unwrap();
    let reader = StoreReader::open(&path).unwrap();
    job.shape.blocks().for_each(|id| reader.read_block(id, &mut target).unwrap());
    merge(std::slice::from_ref(&path), &merged, |_, _| true).unwrap();
    std::fs::remove_file(&merged).unwrap();
    std::fs::remove_file(&path).unwrap();
    peak_bytes() - before
}

/// Every block and every column borrowed from the map; returns by how much the peak rose, mapped pages included.
fn lending(folder: &Path, job: &Job, options: StoreOptions) -> u64 {
    let path = folder.join("lent.ltm");
    let mut traced = TracedBlock::default();
    traced.block.reset(job.shape.max_block_rows(), job.shape.columns());
    traced.block.entries_mut().fill(0.5);
    let writer = StoreWriter::create(&path, job, options).unwrap();
    job.shape.blocks().for_each(|id| writer.write_block(id, &traced).unwrap());
    writer.finish().unwrap();
    // The scratch block is there; it is what blocks that cannot be lent are read into.
    let mut sum = 0.0;
    let before = peak_bytes();
    let reader = StoreReader::open(&path).unwrap();
    for id in job.shape.blocks() {
        reader
            .visit_block(id, &mut traced, &mut |lent| {
                sum += lent.view().entries().iter().sum::<f32>();
                Ok(())
            })
            .unwrap();
        let columns = 0..job.shape.columns() as u32;
        reader.visit_columns(id, columns, &mut traced, &mut |_, entries| sum += entries.iter().sum::<f32>()).unwrap();
    }
    assert!(sum > 0.0);
    std::fs::remove_file(&path).unwrap();
    peak_bytes() - before
}

#[test]
fn writing_reading_checking_and_merging_stay_within_the_stated_memory() {
    let folder = tempfile::tempdir().unwrap();
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["memory::the_memory_child", "--exact", "--test-threads=1"])
        .env(CHILD, folder.path())
        .output()
        .unwrap();
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    assert!(folder.path().join("done").exists(), "the child did nothing");
}
