//! Any bytes, read as a EULUMDAT file of a scene.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

#[path = "../inputs/files.rs"]
#[expect(dead_code, reason = "the tests make changed files of sound ones by themselves")]
mod files;
#[path = "../inputs/limit.rs"]
mod limit;

#[global_allocator]
static ALLOCATOR: limit::Counted = limit::Counted;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

fuzz_target!(|bytes: &[u8]| {
    let target = files::TARGETS.iter().find(|target| target.name == "ldt").expect("it is one of them");
    (target.look)(bytes, FOLDER.path());
});
