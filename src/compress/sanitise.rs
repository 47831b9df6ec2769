//! Entries that cannot be computed with are found before anything else sees them.

use std::borrow::Cow;

use crate::matrix::{BlockView, ColumnIndex};
use crate::simd::dispatch;

/// Largest magnitude that is computed with: the squares of 3.4e8 such entries still sum up within an f32. Sums over more, and
/// all sums of squares over a block, are taken in f64.
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

/// Sums over a block that is all finite, which a pass over it makes on the way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockSums {
    /// Sum of each row: the image with all lights on.
    pub all_on: Vec<f32>,
    /// Squared norm of each column.
    pub column_norms: Vec<f64>,
}

/// Running sums of squares: as many for every machine, so that the order of adding, and with it the bits, is the same.
const LANES: usize = 16;

/// What one pass over a block tells.
pub(super) struct BlockSurvey {
    /// Sum of each row, and squared norm of each column.
    pub(super) sums_of: BlockSums,
    /// Sum of the magnitudes of each row.
    pub(super) sums: Vec<f32>,
    /// Whether every entry can be computed with.
    pub(super) usable: bool,
}

#[inline(always)]
fn square(value: f32) -> f64 {
    f64::from(value) * f64::from(value)
}

/// Sums the rows of a block and looks for entries that cannot be computed with.
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
                    // Of arrays, or the sums would not stay in registers.
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

/// The entries of a block with every unusable one replaced, borrowed where there is none, and their sums.
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
