//! `.ltc`: the block-indexed container of factors. `formats/ltc.md` says what each byte means.
//!
//! A container holds, for each block of `T`, one or more *layers* of components and sparse entries ([`codec`] makes
//! their bytes), the base layers of all blocks first, so that the beginning of the file already gives a whole image.
//! The index stands at the end: one read opens the file, a second one fetches a block.
//!
//! [`ContainerWriter`] takes blocks in any order from any thread and gives the same bytes for the same blocks;
//! [`ContainerReader`] trusts nothing it has not checked; [`merge()`] joins containers of the same job.
//!
//! # Example
//!
//! ```
//! use ltm::container::ContainerReader;
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("room.ltc");
//! # let matrix = ltm::MemoryMatrix::from_images([("desk", ltm::LinearImage::black(40, 40))])?;
//! # ltm::pack(&matrix, &path, &ltm::PackOptions::default())?;
//!
//! let container = ContainerReader::open(&path)?;
//! for id in container.job().shape.blocks() {
//!     let factors = container.read_block(id)?;
//!     assert_eq!((factors.rank(), container.rank(id)), (0, 0), "all black");
//! }
//! # Ok::<(), ltm::Error>(())
//! ```

#[doc(hidden)]
pub mod codec;
mod encoder;
mod format;
mod index;
mod layers;
mod layout;
mod merge;
mod metadata;
mod reader;
mod report;
mod spill;
mod writer;

pub use encoder::{BlockEncoder, EncodedBlock, EncodedSize};
pub use format::FORMAT_VERSION;
#[cfg(feature = "scene")]
pub(crate) use format::MAX_LAYERS;
pub use layout::{BlockLayout, LightLayout, LightPlane};
pub use merge::merge;
pub use reader::{BlockFault, ContainerReader, Verification, verify};
pub use report::ContainerReport;
pub use writer::{
    ContainerOptions, ContainerSummary, ContainerWriter, WrittenBlock, overhead_bytes, write_encoded_blocks,
};
