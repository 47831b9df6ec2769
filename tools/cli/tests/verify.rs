//! Checking and mending: every flipped byte is found and named once, and what is repaired is what was there.

use std::fs;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use ltm::matrix::{BlockId, BlockSource};
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::resources::NoProgress;
use ltm::scene::{BuiltIn, LoadedScene};
use ltm::store::StoreReader;

/// A room of 3 × 2 blocks, those at the edges not full.
fn room(samples_per_pixel: u32) -> LoadedScene {
    let mut loaded = BuiltIn { width: 72, height: 40, texels: 4 }.named("diffuse").unwrap();
    loaded.settings.samples_per_pixel = samples_per_pixel;
    loaded
}

fn render(folder: &Path) -> PathBuf {
    let path = folder.join("room.ltm");
    pipeline::render(room(4), &path, &RenderOptions::default(), &NoProgress).unwrap();
    path
}

fn flip(path: &Path, at: u64) {
    let file = fs::File::options().read(true).write(true).open(path).unwrap();
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).unwrap();
    file.write_all_at(&[byte[0] ^ 0x10], at).unwrap();
}

/// Exit code and standard output of `ltm verify`.
fn said_of(path: &Path) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_ltm")).arg("verify").arg(path).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn a_repaired_matrix_has_the_bytes_that_it_had() {
    let folder = tempfile::tempdir().unwrap();
    let path = render(folder.path());
    let sound = fs::read(&path).unwrap();
    let reader = StoreReader::open(&path).unwrap();
    // A value of one block, the last byte of another's slot, which nothing is stored in or a checksum is, and a record.
    let layout = reader.layout();
    flip(&path, layout.slot_offset(BlockId(1)) + 40);
    flip(&path, layout.slot_offset(BlockId(4)) + layout.slot_bytes(BlockId(4)) - 1);
    flip(&path, layout.record_offset(BlockId(5)) + 8);
    drop(reader);
    assert!(fs::read(&path).unwrap() != sound);
    let (code, said) = said_of(&path);
    assert_eq!(code, Some(4), "{said}");
    for block in ["block 1", "block 4", "block 5"] {
        let lines: Vec<_> = said.lines().filter(|line| line.starts_with("damaged: ") && line.contains(block)).collect();
        assert_eq!(lines.len(), 1, "{said}");
        assert_eq!(lines[0].matches(block).count(), 1, "{}", lines[0]);
    }
    // Another scene's light does not belong there.
    assert!(pipeline::repair(room(8), &path, None, &NoProgress).is_err());
    let repaired = pipeline::repair(room(4), &path, None, &NoProgress).unwrap();
    assert_eq!(repaired, [BlockId(1), BlockId(5)]);
    assert!(fs::read(&path).unwrap() == sound);
    assert_eq!(said_of(&path).0, Some(0));
    assert_eq!(pipeline::repair(room(4), &path, None, &NoProgress).unwrap(), []);
    assert!(fs::read(&path).unwrap() == sound);
}

#[test]
fn what_is_damaged_in_a_container_is_named_once_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = StoreReader::open(&render(folder.path())).unwrap();
    let path = folder.path().join("room.ltc");
    pipeline::pack(&matrix, matrix.job(), &path, &PackOptions::default(), &NoProgress).unwrap();
    let (code, said) = said_of(&path);
    assert_eq!(code, Some(0));
    assert!(
        said.contains(&format!("{} blocks, ", matrix.shape().block_count())) && said.ends_with("sound\n"),
        "{said}"
    );
    // The first chunk belongs to the first block; the header's own checksum is checked too.
    flip(&path, 20);
    flip(&path, 70);
    let (code, said) = said_of(&path);
    assert_eq!(code, Some(4));
    let damaged: Vec<_> = said.lines().filter(|line| line.starts_with("damaged: ")).collect();
    assert_eq!(damaged.len(), 2, "{said}");
    assert!(damaged[0].contains("header") && damaged[1].contains("(pixels from 0, 0), layer 0"), "{said}");
    assert_eq!(damaged[1].matches("block 0").count(), 1, "{said}");
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let checked = |threads: &rayon::ThreadPool| {
        threads.install(|| pipeline::verify_container(&path, None, &NoProgress)).unwrap().faults
    };
    let together = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    assert_eq!(checked(&alone), checked(&together));
}
