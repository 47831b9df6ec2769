//! Any bytes, read as a whole `.ltc`; what they stand for is said in `../inputs/ltc_file.rs`.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

#[path = "../inputs/ltc_file.rs"]
mod input;

static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

fuzz_target!(|bytes: &[u8]| {
    input::look(bytes, &FOLDER.path().join("input.ltc"));
});
