//! `ltm share`: what it says, what it refuses, its exit codes.

mod outcome;

use std::path::PathBuf;
use std::process::Command;

use outcome::outcome;

fn ltm() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("ltm"))
}

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../formats/golden").join(name)
}

#[test]
fn a_page_is_written_once_and_again_only_by_force() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("site");
    let share = || {
        let mut command = ltm();
        command.arg("share").arg(golden("v1-coding-3.ltc")).arg("-o").arg(&site);
        command
    };
    let (code, said, _) = outcome(&mut share());
    assert!(code == 0 && said.contains("index.html") && said.contains("a first picture after"), "{code} {said}");
    assert!(site.join("index.html").is_file() && site.join("picture.lts").is_file());
    let (code, _, problem) = outcome(&mut share());
    assert!(code == 3 && problem.lines().count() == 1 && problem.contains("--force"), "{code} {problem}");
    assert_eq!(outcome(share().arg("--force")).0, 0);

    let single = folder.path().join("room.html");
    let (code, ..) = outcome(ltm().arg("share").arg(golden("v1-coding-3.ltc")).arg("--single").arg("-o").arg(&single));
    assert!(code == 0 && std::fs::read_to_string(single).unwrap().contains("type=\"application/vnd.ltm.share\""));
}

#[test]
fn what_cannot_be_shared_is_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("site");
    let share = |input: PathBuf| {
        let mut command = ltm();
        command.arg("share").arg(input).arg("-o").arg(&site);
        command
    };
    let (code, _, problem) = outcome(&mut share(golden("v1.ltc")));
    assert!(
        code == 3 && problem.contains("that the page does not read") && problem.lines().count() == 1,
        "{code} {problem}"
    );
    assert_eq!(outcome(&mut share(folder.path().join("none.ltc"))).0, 5);
    assert_eq!(outcome(&mut share(golden("v1-f32.ltm"))).0, 3);
    assert_eq!(outcome(share(golden("v1-coding-3.ltc")).args(["--exposure", "100"])).0, 3);
    assert_eq!(outcome(share(golden("v1-coding-3.ltc")).args(["--memory", "1MiB"])).0, 6);
    let mut damaged = std::fs::read(golden("v1-coding-3.ltc")).unwrap();
    damaged[70] ^= 1;
    let path = folder.path().join("damaged.ltc");
    std::fs::write(&path, damaged).unwrap();
    assert_eq!(outcome(&mut share(path)).0, 4);
    assert!(!site.exists());
}
