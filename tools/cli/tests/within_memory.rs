//! Packing matrices larger than the memory that `ltm-pack` is given: by Algorithms 2 and 4 over all of it, and denoised.

use std::path::Path;

use assert_cmd::Command;
use ltm::pipeline::{self, RenderOptions};
use ltm::resources::NoProgress;
use ltm::scene::BuiltIn;

/// The first number of MiB after `word`.
fn mebibytes(said: &str, word: &str) -> f64 {
    let after = said.split(word).nth(1).unwrap_or_else(|| panic!("no '{word}' in {said}"));
    let (number, unit) = after.trim().split_once(' ').unwrap();
    assert!(unit.starts_with("MiB"), "{said}");
    number.parse().unwrap()
}

/// Packs a matrix and gives the peak of memory and what was stated of it, in MiB.
fn pack(matrix: &Path, arguments: &[&str]) -> (f64, f64) {
    let output = Command::new(env!("CARGO_BIN_EXE_ltm-pack"))
        .arg(matrix)
        .args(arguments)
        .current_dir(matrix.parent().unwrap())
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    assert!(output.status.success(), "{said}");
    (mebibytes(&said, "peak memory"), mebibytes(&said, "needs up to"))
}

#[test]
fn a_matrix_larger_than_the_memory_allowed_is_clustered_within_what_was_stated() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = folder.path().join("room.ltm");
    // 69,120 rows, more than are looked at together; 256 columns: 67.5 MiB.
    let mut room = BuiltIn { width: 160, height: 144, texels: 16 }.named("diffuse").unwrap();
    room.settings.samples_per_pixel = 1;
    pipeline::render(room, &matrix, &RenderOptions::default(), &NoProgress).unwrap();
    for method in ["algorithm2", "algorithm4"] {
        let arguments = ["--method", method, "--scope", "global", "--rank", "16", "--memory", "60MiB", "--force"];
        let (peak, need) = pack(&matrix, &arguments);
        assert!(peak <= need && need <= 60.0, "{method}: {peak} MiB of {need} MiB");
    }
}

/// Its stages follow one another: blocks by all threads, then windows of the picture, then blocks again.
#[test]
fn a_matrix_is_denoised_within_what_was_stated() {
    let folder = tempfile::tempdir().unwrap();
    // Many columns, where the blocks take most; few, where the windows do.
    for (width, texels, allowed) in [(96, 32, 200.0), (512, 8, 400.0)] {
        let mut room = BuiltIn { width, height: 64, texels }.named("diffuse").unwrap();
        room.settings.samples_per_pixel = 4;
        let matrix = folder.path().join(format!("{texels}.ltm"));
        pipeline::render(room, &matrix, &RenderOptions::default(), &NoProgress).unwrap();
        let (peak, need) = pack(&matrix, &["--memory", &format!("{allowed}MiB")]);
        assert!(peak <= need && need <= allowed, "{texels} texels: {peak} MiB of {need} MiB");
    }
}
