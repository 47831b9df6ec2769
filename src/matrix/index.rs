//! Indices as types of their own, so that a block is never taken for a column.

use std::fmt;

use crate::encoding::{Decode, Encode};

/// Index of a block in its grid, row by row from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct BlockId(pub u32);

/// Index of a column of `T`, that is of a basis light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Encode, Decode)]
pub struct ColumnIndex(pub u32);

impl BlockId {
    /// For indexing a slice with one item per block.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl ColumnIndex {
    /// For indexing a slice with one item per column.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for BlockId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "block {}", self.0)
    }
}

impl fmt::Display for ColumnIndex {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "column {}", self.0)
    }
}
