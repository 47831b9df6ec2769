//! Tells the program the commit that it is built from, which every table names.

use std::process::Command;

fn git(arguments: &[&str]) -> Option<String> {
    let done = Command::new("git").args(arguments).output().ok().filter(|done| done.status.success())?;
    Some(String::from_utf8_lossy(&done.stdout).trim().to_owned())
}

fn main() {
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).unwrap_or_default();
    println!("cargo:rustc-env=LTM_COMMIT={commit}");
    // What changes with every commit: where HEAD points, and what it points to.
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD".to_owned()].into_iter().chain(branch) {
        git(&["rev-parse", "--path-format=absolute", "--git-path", &name])
            .iter()
            .for_each(|path| println!("cargo:rerun-if-changed={path}"));
    }
    println!("cargo:rerun-if-changed=build.rs");
}
