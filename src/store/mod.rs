//! `.ltm`: the stored matrix, larger than memory, crash-safe and checksummed. `formats/ltm.md` defines every byte.
//!
//! ```text
//! header page │ job description │ commit table │ slot of block 0 │ slot of block 1 │ …
//!                                 64 bytes a      columns, probes,   unused rest: a hole
//!                                 block           side data
//! ```
//!
//! # Crash safety
//!
//! Every block has a slot of its own, whose position follows from the shape alone. So the file's bytes do not depend on
//! the order of commits: an interrupted and continued file is byte-identical to one made in one go. A block is written
//! into its slot and made durable (`fdatasync`), and only then its commit record is written. A record is 64 bytes
//! inside one sector, with a checksum of its own, so it is written completely or not at all. A file may therefore be
//! read while it is written, and shows exactly the committed blocks.
//!
//! A file grows under `NAME.ltm.part` and gets its name when it is finished.
//!
//! # Integrity
//!
//! Each step of reading has a type for what is not yet verified: bytes of a header cannot be used as a header, nor
//! bytes of a record as a record. Checksums cover the header page, the description, each record, the side data, and
//! each stored column, so that a few columns can be read and verified without the rest.
//!
//! # Positioned writes, memory-mapped reads
//!
//! Writing is positioned (`pwrite`), which is faster than through a map. A full disk is then an error and does not end
//! the process by SIGBUS; space is also reserved up front.
//!
//! Reading borrows from a map where a view suffices. [`visit_columns`](crate::matrix::BlockSource::visit_columns) lends
//! any column in f32 without a copy, and decodes others one by one (raw relighting, slices).
//! [`visit_block`](crate::matrix::BlockSource::visit_block) lends a block that stores every column in f32 (global
//! choice of rows and columns). Packing takes outliers out of each block in place, so it reads blocks into its own
//! memory by `pread`, which is faster than copying from a map. Measurements: decision 41.
//!
//! * Checksums are checked as columns are touched; those of a block that is lent as a whole once for each opening.
//! * The kernel is told the access pattern ([`Access`]): whole blocks, with read-ahead, or single columns.
//! * Pages are released when a loan ends, so resident memory is that of the current blocks. A file larger than half the
//!   memory also leaves the page cache, block by block as it is written and read, so that it does not evict everything
//!   else and then itself.
//! * If a file is cut or written to while a block of it is lent, that is an error; no signal ends the process (see
//!   `guard`). From then on that file is read positioned.
//! * A file that is still growing, one on a network file system, and one that cannot be mapped are read positioned.
//!
//! All access goes through [`Storage`], so that tests can inject a storage that fails, tears and counts.
//!
//! # Example
//!
//! ```
//! use ltm::matrix::{Block, BlockSink, BlockSource, TracedBlock};
//! use ltm::store::{StoreOptions, StoreReader, StoreWriter};
//! # use ltm::light::DescribedSource;
//! # let job = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(40, 8))])?.job().clone();
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltm");
//!
//! let writer = StoreWriter::create(&path, &job, StoreOptions::default())?;
//! for id in job.shape.blocks() {
//!     let block = Block::zeros(job.shape.rect(id).rows(), job.shape.columns());
//!     writer.write_block(id, &TracedBlock { block, ..Default::default() })?;
//! }
//! writer.finish()?;
//! assert_eq!(StoreReader::open(&path)?.job().hash(), job.hash());
//! # Ok::<(), ltm::Error>(())
//! ```

mod access;
mod header;
mod layout;
mod mapped;
mod merge;
mod options;
mod place;
mod planes;
mod precision;
mod reader;
mod record;
mod space;
mod storage;
mod system;
mod tile;
mod tile_writer;
mod verify;
mod writer;

pub use access::Access;
pub use header::{HEADER_FIELDS, MAGIC, VERSION};
pub use layout::{PAGE_BYTES, RECORD_BYTES, Requirements, StoreLayout, requirements, requirements_of};
pub use mapped::MappedStorage;
pub use merge::{MergeReport, merge};
pub use options::StoreOptions;
pub use place::{check_output, partial_path};
pub use precision::Precision;
pub use reader::{StoreCounts, StoreReader};
pub use record::{COMMITTED, NOISE_NONE, NOISE_STORED, NOISE_ZERO, PLANES_STORED, RECORD_FIELDS};
pub use storage::{FileStorage, Storage};
pub use verify::{BlockDamage, Mending, VerifyReport, mend, verify, verify_storage};
pub use writer::{StoreSummary, StoreWriter};

/// Where a field stands in a fixed structure: name, offset and size in bytes. `formats/ltm.md` repeats these tables and
/// a test compares.
pub type FieldPlace = (&'static str, usize, usize);

// The structures are written as they lie in memory.
const _: () = assert!(cfg!(target_endian = "little"), "`.ltm` files are little-endian; this target is not");

/// Declares a structure as it lies on disk, and the table of its fields.
macro_rules! disk_structure {
    ($(#[$meta:meta])* $name:ident, $(#[$table_meta:meta])* $table:ident { $($field:ident: $kind:ty),* $(,)? }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub(super) struct $name { $(pub(super) $field: $kind),* }

        $(#[$table_meta])*
        pub const $table: &[super::FieldPlace] =
            &[$((stringify!($field), std::mem::offset_of!($name, $field), size_of::<$kind>())),*];
    };
}
use disk_structure;
