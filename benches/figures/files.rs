//! Files that benchmarks are given by name.

use std::fs::File;
use std::path::Path;

/// Lets the system forget what it holds of a file, as far as it does on request.
pub(crate) fn forget(path: &Path) {
    let file = File::open(path).expect("the file is there");
    file.sync_all().expect("the disk takes it");
    rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed).expect("it is a file");
}
