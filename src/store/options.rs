//! How a matrix is stored.

use super::Precision;

/// Options of a stored matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreOptions {
    /// How entries are stored.
    pub precision: Precision,
    /// Whether a file of that name, finished or partial, is replaced.
    pub overwrite: bool,
    /// Most probe lightings that a block's noise may hold; room for them is kept in each slot.
    pub max_probes: u32,
    /// Whether there is room in each slot for what the block's samples are; without it, planes are left out.
    pub planes: bool,
    /// Whether disk space for every block is reserved up front. Without it a sparse matrix may grow on a disk that could not hold a
    /// full one, and may find the disk full later.
    pub reserve: bool,
    /// Where the blocks come from, if not from what the job says: of the same job a renderer's blocks and those of a container differ.
    /// A partial file is continued only by a writer of its origin.
    pub origin: Option<[u8; 32]>,
}

impl Default for StoreOptions {
    fn default() -> Self {
        Self { precision: Precision::F32, overwrite: false, max_probes: 16, planes: false, reserve: true, origin: None }
    }
}
