//! Room in the page cache.

use crate::resources::machine_memory;

/// Whether a file of this size should leave the page cache as soon as a block is written or read. One larger than half
/// the memory would evict everything else, and itself before it is used again.
pub(super) fn crowds_out(file_bytes: u64) -> bool {
    machine_memory().total_bytes.is_some_and(|memory| file_bytes > memory / 2)
}
