//! Entries that cannot be computed with are found before anything else sees them.

use std::borrow::Cow;

use crate::matrix::{BlockView, ColumnIndex};

/// Largest magnitude that is computed with: its square times any block's size still fits an f32.
const LARGEST: f32 = 1e15;

/// What had to be replaced in a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replaced {
    /// Entries that were not a number, now 0.
    pub nan: u32,
    /// Entries that were infinite or above 1e15 in magnitude, now at the block's largest usable magnitude of their sign.
    pub huge: u32,
    /// Column and row of the first.
    pub first: Option<(ColumnIndex, u32)>,
}

impl Replaced {
    /// Number of replaced entries.
    pub fn count(self) -> u32 {
        self.nan + self.huge
    }
}

/// The entries of a block with every unusable one replaced; borrowed where there is none.
pub(super) fn sanitise(block: BlockView<'_>) -> (Cow<'_, [f32]>, Replaced) {
    let usable = |v: f32| v.abs() <= LARGEST;
    let mut replaced = Replaced::default();
    if block.entries().chunks(4096).all(|chunk| chunk.iter().fold(true, |all, &v| all & usable(v))) {
        return (Cow::Borrowed(block.entries()), replaced);
    }
    let largest = block.entries().iter().map(|v| v.abs()).filter(|&v| usable(v)).fold(0.0f32, f32::max);
    let mut entries = block.entries().to_vec();
    for (i, v) in entries.iter_mut().enumerate().filter(|(_, v)| !usable(**v)) {
        replaced.first.get_or_insert((ColumnIndex((i / block.rows()) as u32), (i % block.rows()) as u32));
        if v.is_nan() {
            replaced.nan += 1;
            *v = 0.0;
        } else {
            replaced.huge += 1;
            *v = largest.copysign(*v);
        }
    }
    (Cow::Owned(entries), replaced)
}
