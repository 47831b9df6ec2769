//! A real process, killed at random instants.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ltm::light::Job;
use ltm::matrix::{BlockSink, BlockSource};
use ltm::store::{Precision, StoreOptions, StoreReader, StoreWriter, partial_path, verify};

use crate::blocks::{block, job_of, read};

const CHILD: &str = "LTM_TEST_STORE_CHILD";
const KILLS: u32 = 100;

fn job() -> Job {
    job_of(64, 48, 60, 8)
}

fn options() -> StoreOptions {
    StoreOptions { precision: Precision::F16, ..crate::blocks::options() }
}

/// Writes what is missing, from two threads, as a render that is run again does.
fn fill(path: &Path) {
    let job = job();
    let writer = StoreWriter::create_or_resume(path, &job, options()).unwrap();
    std::thread::scope(|scope| {
        for thread in 0..2 {
            let (writer, job) = (&writer, &job);
            scope.spawn(move || {
                for id in job.shape.blocks().filter(|id| id.0 % 2 == thread && !writer.is_committed(*id)) {
                    writer.write_block(id, &block(job, id)).unwrap();
                }
            });
        }
    });
    writer.finish().unwrap();
}

/// Does nothing unless it is the child that the test below starts.
#[test]
fn the_child() {
    if let Some(path) = std::env::var_os(CHILD) {
        fill(&PathBuf::from(path));
    }
}

#[test]
fn a_process_killed_a_hundred_times_loses_nothing_and_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (reference, path) = (folder.path().join("reference.ltm"), folder.path().join("killed.ltm"));
    let started = Instant::now();
    fill(&reference);
    let whole_run = started.elapsed();
    let whole = fs::read(&reference).unwrap();

    let (mut kills, mut finishes, mut partial_files, mut seen) = (0, 0, 0, 0);
    let mut state = 1u64;
    while kills < KILLS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["kill::the_child", "--exact", "--test-threads=1"])
            .env(CHILD, &path)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // Anywhere from before it began to, often enough, after it ended.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let share = (state >> 40) as f64 / (1u64 << 24) as f64;
        std::thread::sleep(Duration::from_millis(2).max(whole_run).mul_f64(share * 0.5));
        child.kill().unwrap();
        let status = child.wait().unwrap();
        if status.code().is_none() {
            kills += 1;
        } else {
            assert!(status.success(), "the child failed");
        }

        let partial = partial_path(&path);
        if path.exists() {
            assert!(!partial.exists());
            assert!(fs::read(&path).unwrap() == whole, "differs after {kills} kills");
            fs::remove_file(&path).unwrap();
            (finishes, seen) = (finishes + 1, 0);
        } else if let Ok(reader) = StoreReader::open(&partial) {
            partial_files += 1;
            let committed: Vec<_> = reader.shape().blocks().filter(|&id| reader.is_committed(id)).collect();
            assert!(committed.len() >= seen, "blocks were lost");
            seen = committed.len();
            assert!(verify(&partial, |_, _| true).unwrap().damaged.is_empty());
            for id in committed.into_iter().take(3) {
                read(&reader, id).unwrap();
            }
        }
    }
    fill(&path);
    assert!(fs::read(&path).unwrap() == whole);
    assert!(partial_files > KILLS / 4, "only {partial_files} kills fell into the writing ({finishes} runs ended)");
}
