//! Replaces unusable entries (NaN, infinite, huge) before anything else reads them.

use std::borrow::Cow;

use crate::matrix::{BlockView, ColumnIndex};
use crate::simd::dispatch;

/// Largest usable magnitude: the squares of 3.4e8 such entries still sum up within an f32. Sums over more entries, and
/// all sums of squares over a block, use f64.
const LARGEST: f32 = 1e15;

/// Counts of the entries that were replaced in a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replaced {
    /// NaN entries, now 0.
    pub nan: u32,
    /// Entries that were infinite or above 1e15 in magnitude, now the largest usable magnitude of the block with their
    /// sign.
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

/// Sums over a block without unusable entries, from one pass over it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockSums {
    /// Sum of each row: the image with all lights on.
    pub all_on: Vec<f32>,
    /// Squared norm of each column.
    pub column_norms: Vec<f64>,
}

/// Number of running sums of squares. It is the same on every machine, so that the order of additions and the bits are.
const LANES: usize = 16;

/// The results of one pass over a block.
pub(super) struct BlockSurvey {
    /// Sum of each row, and squared norm of each column.
    pub(super) sums_of: BlockSums,
    /// Sum of the magnitudes of each row.
    pub(super) sums: Vec<f32>,
    /// Whether every entry is usable.
    pub(super) usable: bool,
}

#[inline(always)]
fn square(value: f32) -> f64 {
    f64::from(value) * f64::from(value)
}

/// Sums the rows of a block and looks for unusable entries.
pub(super) fn survey(block: BlockView<'_>) -> BlockSurvey {
    let sums_of = BlockSums { all_on: vec![0.0; block.rows()], column_norms: Vec::with_capacity(block.columns()) };
    let mut survey = BlockSurvey { sums_of, sums: vec![0.0; block.rows()], usable: true };
    dispatch(
        #[inline(always)]
        || {
            let BlockSurvey { sums_of: BlockSums { all_on: lit, column_norms }, sums, usable } = &mut survey;
            for column in block.entries().chunks_exact(block.rows()) {
                let mut squares = [0.0f64; LANES];
                for ((values, lit), sums) in column.chunks(512).zip(lit.chunks_mut(512)).zip(sums.chunks_mut(512)) {
                    lit.iter_mut().zip(values).for_each(|(sum, v)| *sum += v);
                    sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += v.abs());
                    *usable &= values.iter().fold(true, |all, v| all & (v.abs() <= LARGEST));
                    // Fixed-size arrays keep the sums in registers.
                    let (arrays, rest) = values.as_chunks::<LANES>();
                    for values in arrays {
                        squares.iter_mut().zip(values).for_each(|(sum, v)| *sum += square(*v));
                    }
                    squares.iter_mut().zip(rest).for_each(|(sum, v)| *sum += square(*v));
                }
                column_norms.push(squares.iter().sum());
            }
        },
    );
    survey
}

/// The entries of a block with every unusable one replaced, borrowed if there are none, and their sums.
pub(super) fn sanitise(block: BlockView<'_>) -> (Cow<'_, [f32]>, BlockSurvey, Replaced) {
    let found = survey(block);
    let mut replaced = Replaced::default();
    if found.usable {
        return (Cow::Borrowed(block.entries()), found, replaced);
    }
    let usable = |v: f32| v.abs() <= LARGEST;
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
    let found = survey(BlockView::new(block.rows(), block.columns(), &entries));
    (Cow::Owned(entries), found, replaced)
}
