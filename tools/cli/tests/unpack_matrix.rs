//! `ltm-unpack` of a stored matrix: what it says and refuses.

mod outcome;
mod program;
mod room;

/// Runs a program in a folder and gives the exit code and both outputs.
fn run(folder: &std::path::Path, program: &str, arguments: &[&str]) -> (i32, String, String) {
    outcome::outcome(&mut program::command(folder, program, arguments))
}

#[test]
fn a_stored_matrix_is_taken_apart_like_a_container() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    room::write_room(at, "[render]\nsamples_per_pixel = 2\n");
    assert_eq!(run(at, "ltm", &["render", "room.toml"]).0, 0);
    let (code, said, _) = run(at, "ltm-unpack", &["room.ltm", "-o", "a.npy", "--crop", "0,0,40x12"]);
    assert!(code == 0 && said.contains("a.npy: written") && said.contains("peak memory"), "{code} {said}");
    let bytes = std::fs::read(at.join("a.npy")).unwrap();
    assert!(String::from_utf8_lossy(&bytes[..128]).contains("(1, 12, 40, 3)"));
    assert_eq!(run(at, "ltm-unpack", &["room.ltm", "-o", "a.exr", "--blocks", "0..1"]).0, 0);
    assert_eq!(run(at, "ltm-unpack", &["room.ltm", "-o", "one.exr", "--relit", "--memory", "64MiB"]).0, 0);
    let (code, said, _) = run(at, "ltm-unpack", &["room.ltm", "-o", "part.ltm", "--crop", "8,0,32x24"]);
    assert!(code == 0 && said.contains("part.ltm: 1 blocks written, without"), "{code} {said}");
    let (code, _, problem) = run(at, "ltm-unpack", &["room.ltm", "-o", "copy.ltm"]);
    assert!(code == 3 && problem.contains("--lights") && !at.join("copy.ltm").exists(), "{code} {problem}");
    let (code, _, problem) = run(at, "ltm-unpack", &["room.ltm", "-o", "b.npy", "--memory", "1KiB"]);
    assert!(code != 0 && problem.lines().count() == 1 && !at.join("b.npy").exists(), "{code} {problem}");
}
