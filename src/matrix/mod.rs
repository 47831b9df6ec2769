//! Types of `T`: its shape and block grid, indices, blocks of entries, blocks of factors, and the traits between
//! stages.
//!
//! # Layout of a block
//!
//! A block covers a square of pixels (smaller at the right and bottom edges) with three channels and all columns. Its
//! rows are channel-planar: row `channel · pixels + y · width + x`, with `x, y` counted inside the block. So the rows
//! of one colour channel are contiguous, as a product with an RGB lighting needs them. Its entries are column-major:
//! each column's rows are contiguous.
//!
//! ```
//! use ltm::matrix::{BlockId, ColumnIndex, MatrixShape};
//!
//! let shape = MatrixShape::new(64, 48, 8, 32)?;
//! assert_eq!((shape.rows(), shape.columns(), shape.block_count()), (64 * 48 * 3, 8, 4));
//! let rect = shape.rect(BlockId(3));
//! assert_eq!((rect.x, rect.y, rect.width, rect.height), (32, 32, 32, 16));
//! # Ok::<(), ltm::Error>(())
//! ```

mod block;
mod coded;
mod column_transform;
pub(crate) mod cosines;
mod factors;
mod index;
mod noise;
mod planes;
mod report;
mod shape;
mod source;

pub use block::{Block, BlockView, TracedBlock};
pub use coded::{CodedBlock, CodedRow};
pub use column_transform::ColumnTransform;
pub(crate) use column_transform::{ColumnTile, TILE_COEFFICIENTS};
pub use factors::{FactoredBlock, SparseEntry};
pub use index::{BlockId, ColumnIndex};
pub use noise::BlockNoise;
pub use planes::{BlockPlanes, FEATURE_PLANES, Feature, SeenEmission, decode_unsigned, encode_unsigned};
pub use report::BlockReport;
pub use shape::{CHANNELS, MatrixShape, PixelRect};
pub use source::{BlockSink, BlockSource, FactorSource, LentBlock};
