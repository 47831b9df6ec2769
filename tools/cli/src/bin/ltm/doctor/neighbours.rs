//! Programs that this one works with.

use std::path::Path;
use std::process::{Command, Stdio};

use super::Finding;
use crate::sibling;

/// What Python is asked: its version, and that of the package; what lies in this folder is no package.
const PYTHON: &str = "import sys
del sys.path[0]
version = sys.version.split()[0]
try:
    import ltm
    print(version, 'with ltm', ltm.__version__)
except Exception as problem:
    print(version, 'without ltm:', type(problem).__name__)";

/// The other programs of ltm, by their own word.
pub(super) fn programs() -> Vec<Finding> {
    sibling::PROGRAMS
        .into_iter()
        .map(|(program, purpose)| match said(&sibling::place_of(program), &["--version"]) {
            Some(version) => {
                let version = version.rsplit(' ').next().unwrap_or_default().to_owned();
                let own = env!("CARGO_PKG_VERSION");
                match version == own {
                    true => Finding::of(program, version),
                    false => {
                        let missing = format!("{purpose}: {program} is of version {version}, this program of {own}");
                        Finding::without(program, version, missing)
                    }
                }
            }
            None => Finding::without(program, "not found", format!("{purpose}: {}", sibling::how_to_install(program))),
        })
        .collect()
}

/// Python and its package.
pub(super) fn python() -> Finding {
    match said(Path::new("python3"), &["-c", PYTHON]) {
        Some(found) if found.contains("with ltm") => Finding::of("python", found),
        Some(found) => Finding::without("python", found, "import ltm: install the wheel into this Python"),
        None => Finding::without("python", "not found", "import ltm: Python 3.10 or newer"),
    }
}

/// Blender, which is needed for .blend files alone.
pub(super) fn blender() -> Finding {
    match said(Path::new("blender"), &["--version"]) {
        Some(version) => Finding::of("blender", version),
        None => Finding::without("blender", "not found", ".blend files: Blender 4.2 or newer on the path"),
    }
}

/// The first line that a program prints; none where it is not there or fails.
fn said(program: &Path, arguments: &[&str]) -> Option<String> {
    let mut command = Command::new(program);
    let output = command.args(arguments).stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines().next().filter(|_| output.status.success()).map(|line| line.trim().to_owned())
}
