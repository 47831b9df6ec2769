//! A disk that is really full: a small file system in memory, mounted where the system lets a user do that (a name space
//! of its own, by `unshare`); elsewhere these tests are listed as ignored.

#[path = "store/blocks.rs"]
#[expect(dead_code, reason = "the store's own tests use the rest")]
mod blocks;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use blocks::{block, job_of, options};
use libtest_mimic::{Arguments, Failed, Trial};
use ltm::Error;
use ltm::image::{self, ImageSize, LinearImage, ToneMapping};
use ltm::light::Job;
use ltm::matrix::{BlockId, BlockSink, BlockSource, TracedBlock};
use ltm::pipeline::{self, PackOptions};
use ltm::resources::NoProgress;
use ltm::scene::BuiltIn;
use ltm::store::{StoreOptions, StoreReader, StoreWriter, partial_path};

/// Set in the child that runs a test on the small disk.
const DISK: &str = "LTM_TEST_FULL_DISK";
const DISK_BYTES: u64 = 32 << 20;

/// A test, given the folder at which the small disk is mounted.
type OnDisk = fn(&Path);

const TESTS: [(&str, OnDisk); 4] = [
    ("a_full_disk_is_an_error_that_keeps_the_committed_blocks", sparse_file),
    ("reserved_space_is_there_when_the_disk_is_full", reserved_file),
    ("a_pack_without_room_is_refused_and_leaves_nothing", packing),
    ("an_image_without_room_is_an_error_and_leaves_the_old_one", images),
];

fn main() -> ExitCode {
    if let (Some(disk), Some(name)) = (std::env::var_os(DISK), std::env::args().nth(1)) {
        let (_, test) = TESTS.iter().find(|(known, _)| *known == name).expect("the parent names a test");
        test(&PathBuf::from(disk));
        return ExitCode::SUCCESS;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let can_mount = on_small_disk(folder.path(), "true", "").is_ok();
    let trials = TESTS.iter().map(|&(name, _)| {
        let program = std::env::current_exe().expect("this program has a path").display().to_string();
        let disk = folder.path().join(name);
        let run = move || -> Result<(), Failed> {
            fs::create_dir(&disk)?;
            on_small_disk(&disk, &program, name).map_err(Failed::from)
        };
        Trial::test(name, run).with_ignored_flag(!can_mount)
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit_code()
}

/// Runs a program while a file system of [`DISK_BYTES`] is mounted at `disk`, for it alone.
fn on_small_disk(disk: &Path, program: &str, argument: &str) -> Result<(), String> {
    let script = format!("mount -t tmpfs -o size={DISK_BYTES} tmpfs \"$0\" && exec \"$1\" $2");
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", &script])
        .arg(disk)
        .args([program, argument])
        .env(DISK, disk)
        .output()
        .map_err(|e| e.to_string())?;
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

/// 16 blocks of 1.5 MiB.
fn job() -> Job {
    job_of(128, 128, 128, 32)
}

/// Takes all that is left, but `spare_bytes`.
fn fill(disk: &Path, spare_bytes: u64) -> PathBuf {
    let path = disk.join("ballast");
    let mut file = fs::File::create(&path).unwrap();
    let free = ltm::files::free_bytes(disk).unwrap();
    file.write_all(&vec![1; (free - spare_bytes) as usize]).unwrap();
    path
}

fn write_missing(writer: &StoreWriter, job: &Job) -> ltm::Result<()> {
    let missing = job.shape.blocks().filter(|&id| !writer.is_committed(id));
    missing.into_iter().try_for_each(|id| writer.write_block(id, &block(job, id)))
}

fn is_whole(path: &Path, job: &Job) {
    let reader = StoreReader::open(path).unwrap();
    let mut target = TracedBlock::default();
    for id in job.shape.blocks() {
        reader.read_block(id, &mut target).unwrap();
        assert!(target == block(job, id), "{id}");
    }
}

fn sparse_file(disk: &Path) {
    let (job, path) = (job(), disk.join("a.ltm"));
    let sparse = StoreOptions { reserve: false, ..options() };
    let ballast = fill(disk, 6 << 20);
    let writer = StoreWriter::create(&path, &job, sparse).unwrap();
    let error = write_missing(&writer, &job).unwrap_err();
    assert!(matches!(error, Error::Io { .. }) && error.to_string().contains("No space left"), "{error}");
    let committed: Vec<_> = job.shape.blocks().filter(|&id| writer.is_committed(id)).collect();
    assert!(!committed.is_empty() && committed.len() < 16, "{committed:?}");
    drop(writer);
    let reader = StoreReader::open(&partial_path(&path)).unwrap();
    let mut target = TracedBlock::default();
    for &id in &committed {
        reader.read_block(id, &mut target).unwrap();
        assert!(target == block(&job, id), "{id}");
    }
    // Room is made: the same command goes on.
    fs::remove_file(ballast).unwrap();
    let writer = StoreWriter::create_or_resume(&path, &job, sparse).unwrap();
    assert!(committed.iter().all(|&id| writer.is_committed(id)));
    write_missing(&writer, &job).unwrap();
    writer.finish().unwrap();
    is_whole(&path, &job);
}

fn reserved_file(disk: &Path) {
    let (job, path) = (job(), disk.join("a.ltm"));
    let large = job_of(256, 128, 128, 32);
    let error = StoreWriter::create(&path, &large, options()).err().unwrap();
    assert!(matches!(error, Error::Resources { .. }), "{error}");
    // Four blocks fit beside the ballast, sixteen do not.
    let ballast = fill(disk, 8 << 20);
    let writer = StoreWriter::create(&path, &job, StoreOptions { reserve: false, ..options() }).unwrap();
    let error = writer.reserve(0..16).unwrap_err();
    assert!(error.to_string().contains("No space left"), "{error}");
    drop(writer);
    assert_eq!(fs::read_dir(disk).unwrap().count(), 1, "a file without blocks is not kept");
    fs::remove_file(ballast).unwrap();
    let writer = StoreWriter::create(&path, &job, StoreOptions { reserve: false, ..options() }).unwrap();
    writer.reserve(2..6).unwrap();
    fill(disk, 0);
    let error = writer.write_block(BlockId(0), &block(&job, BlockId(0))).unwrap_err();
    assert!(error.to_string().contains("No space left"), "{error}");
    for id in (2..6).map(BlockId) {
        writer.write_block(id, &block(&job, id)).unwrap();
    }
    assert_eq!(writer.committed_count(), 4);
}

fn packing(disk: &Path) {
    let path = disk.join("a.ltc");
    let mut room = BuiltIn { width: 64, height: 64, texels: 16 }.named("diffuse").unwrap();
    room.settings.samples_per_pixel = 2;
    let ballast = fill(disk, 1 << 20);
    let error = pipeline::render_packed(room.clone(), &path, &PackOptions::default(), &NoProgress).unwrap_err();
    assert!(matches!(error, Error::Resources { .. }) && error.to_string().contains("of disk"), "{error}");
    assert_eq!(fs::read_dir(disk).unwrap().count(), 1);
    fs::remove_file(ballast).unwrap();
    pipeline::render_packed(room, &path, &PackOptions::default(), &NoProgress).unwrap();
}

fn images(disk: &Path) {
    let image = LinearImage { width: 20, height: 12, pixels: vec![[0.1, 0.2, 0.3]; 240] };
    let large = LinearImage { width: 500, height: 300, pixels: (0..150_000).map(|i| [i as f32; 3]).collect() };
    let row = &mut |_, _, _, row: &mut [f32]| {
        row.fill(0.5);
        Ok(())
    };
    let size = ImageSize { width: 20, height: 12 };
    let (png, exr, npy) = (disk.join("a.png"), disk.join("a.exr"), disk.join("a.npy"));
    image::write_png(&png, &image, 0.9).unwrap();
    let old = fs::read(&png).unwrap();
    fill(disk, 0);
    for picture in [&image, &large] {
        let errors = [
            image::write_png(&png, picture, 0.9),
            image::write_toned_png(&disk.join("b.png"), picture, ToneMapping::default()),
            image::write_exr(&exr, picture),
            image::write_npy(&npy, true, 3, size, row),
        ];
        for error in errors.map(|result| result.unwrap_err().to_string()) {
            assert!(error.contains("No space left"), "{error}");
        }
    }
    assert_eq!(fs::read(&png).unwrap(), old);
    let mut names: Vec<_> = fs::read_dir(disk).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.png", "ballast"]);
}
