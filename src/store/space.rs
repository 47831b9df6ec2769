//! Room in the page cache.

/// Whether a file of this size should leave the page cache as soon as a block is written or read. One larger than half
/// the memory would evict everything else, and itself before it is used again.
pub(super) fn crowds_out(file_bytes: u64) -> bool {
    let system = rustix::system::sysinfo();
    let memory = (system.totalram as u64).saturating_mul(u64::from(system.mem_unit));
    file_bytes > memory / 2
}
