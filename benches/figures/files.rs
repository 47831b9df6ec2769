//! Files that benchmarks are given by name.

use std::fs::File;
use std::path::{Path, PathBuf};

/// Lets the system forget what it holds of a file, as far as it does on request.
pub(crate) fn forget(path: &Path) {
    let file = File::open(path).expect("the file is there");
    file.sync_all().expect("the disk takes it");
    rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed).expect("it is a file");
}

/// Files of one folder as they are typed there, with `:` between them.
pub(crate) fn typed(paths: &[PathBuf]) -> String {
    let name = |path: &PathBuf| format!("$PWD/{}", path.file_name().unwrap_or_default().display());
    paths.iter().map(name).collect::<Vec<_>>().join(":")
}
