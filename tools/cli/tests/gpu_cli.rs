//! `ltm relight` on a GPU from outside: the picture is the processor's, whatever memory it may use there.

mod program;
mod room;

use std::path::Path;

use libtest_mimic::{Arguments, Trial};
use ltm::image::{compare, read_image};
use ltm::relight::GpuAdapter;
use room::write_room;

/// Runs `ltm relight` and returns its exit code and what it said.
fn relight(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = program::command(folder, "ltm", &[&["relight", "room.ltc"], arguments].concat()).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
}

fn a_budget_of_its_memory_is_kept_and_shows_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_room(
        at,
        "[render]\nsamples_per_pixel = 4\nblock_side = 8\n[[light]]\nmaterial = \"lamp\"\ntexels = [8, 8]\n",
    );
    for (name, arguments) in [("ltm", &["render", "room.toml"][..]), ("ltm-pack", &["room.ltm"])] {
        assert!(program::command(at, name, arguments).output().unwrap().status.success(), "{name}");
    }
    let show = |name: &str, arguments: &[&str]| {
        let (code, said) = relight(at, &[&["-o", name], arguments].concat());
        assert_eq!(code, Some(0), "{said}");
        (read_image(&at.join(name)).unwrap(), said)
    };
    let (cpu, _) = show("cpu.exr", &["--device", "cpu"]);
    let (gpu, said) = show("gpu.exr", &["--device", "gpu"]);
    assert!(said.contains("GPU ("), "{said}");
    // The same formula in another order of sums: f32 rounds at 1e-7.
    assert!(compare(&gpu, &cpu).relative_l2 < 1e-5);
    let (paged, said) = show("paged.exr", &["--device", "gpu", "--gpu-memory", "16KiB"]);
    assert!(compare(&paged, &cpu).relative_l2 < 1e-5);
    let used = said.split("at most ").nth(1).and_then(|rest| rest.split(" of its memory").next()).expect(&said);
    let (number, unit) = used.split_once(' ').expect(used);
    let bytes = number.parse::<f64>().expect(used) * if unit == "KiB" { 1024.0 } else { 1.0 };
    assert!(["B", "KiB"].contains(&unit) && bytes <= 16_384.0, "{said}");
    // What cannot hold even a lighting is refused in one line that says so.
    let (code, said) = relight(at, &["-o", "none.exr", "--device", "gpu", "--gpu-memory", "100"]);
    assert!(code == Some(6) && said.contains("GPU") && !at.join("none.exr").exists(), "{said}");
}

fn main() {
    let arguments = Arguments::from_args();
    let missing = GpuAdapter::find().err();
    if let Some(problem) = &missing {
        eprintln!("{problem}");
    }
    let required = std::env::var("LTM_REQUIRE_GPU").is_ok_and(|value| value == "1");
    let test = || {
        a_budget_of_its_memory_is_kept_and_shows_the_same_picture();
        Ok(())
    };
    let trial = Trial::test("a_budget_of_its_memory_is_kept_and_shows_the_same_picture", test);
    libtest_mimic::run(&arguments, vec![trial.with_ignored_flag(missing.is_some() && !required)]).exit();
}
