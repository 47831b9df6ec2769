//! The picture cut into windows of blocks.

use std::ops::Range;

use crate::matrix::{BlockId, MatrixShape};

/// Side in pixels of the windows in which columns are fitted, at most; a window has one block at least. It decides in which order sums over the
/// picture are added up, and so the last bits of the result.
const SIDE: u32 = 256;

/// The picture in windows, the same on every machine: sums over the picture are those of the windows, added up in their order. Blocks
/// are ordered window by window, and have a *place* in that order.
#[derive(Clone, Debug)]
pub(crate) struct PictureWindows {
    blocks: Vec<BlockId>,
    /// Where each window ends.
    ends: Vec<u32>,
    /// By block.
    places: Vec<u32>,
}

impl PictureWindows {
    pub(crate) fn of(shape: MatrixShape) -> Self {
        let side = (SIDE / shape.block_side()).max(1);
        let windows = windows_of(shape, (side, side));
        let mut end = 0;
        let ends = windows.iter().map(|window| {
            end += window.len() as u32;
            end
        });
        let (ends, blocks) = (ends.collect(), windows.concat());
        let mut places = vec![0; blocks.len()];
        blocks.iter().zip(0..).for_each(|(block, place)| places[block.index()] = place);
        Self { blocks, ends, places }
    }

    /// Places of each window.
    pub(crate) fn ranges(&self) -> Vec<Range<u32>> {
        let begins = std::iter::once(0).chain(self.ends.iter().copied());
        begins.zip(&self.ends).map(|(begin, &end)| begin..end).collect()
    }

    /// The blocks at some places.
    pub(crate) fn blocks(&self, places: &Range<u32>) -> &[BlockId] {
        &self.blocks[places.start as usize..places.end as usize]
    }

    /// The place of a block.
    pub(crate) fn place(&self, id: BlockId) -> u32 {
        self.places[id.index()]
    }
}

/// The windows of an image, at most so many blocks wide and high.
pub(crate) fn windows_of(shape: MatrixShape, (most_across, most_down): (u32, u32)) -> Vec<Vec<BlockId>> {
    let (across, down) = (shape.blocks_across(), shape.blocks_down());
    let window = |rows: Range<u32>, columns: Range<u32>| -> Vec<BlockId> {
        rows.flat_map(|y| columns.clone().map(move |x| BlockId(y * across + x))).collect()
    };
    let in_row = |rows: Range<u32>| equal_parts(across, most_across).map(move |columns| window(rows.clone(), columns));
    equal_parts(down, most_down).flat_map(in_row).collect()
}

/// The fewest parts of nearly equal length that have at most `most` each.
fn equal_parts(length: u32, most: u32) -> impl Iterator<Item = Range<u32>> {
    let count = length.div_ceil(most.max(1));
    let border = move |part: u32| (u64::from(part) * u64::from(length) / u64::from(count)) as u32;
    (0..count).map(move |part| border(part)..border(part + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_block_is_in_one_window_and_has_one_place() {
        let shape = MatrixShape::new(550, 290, 3, 16).unwrap();
        let windows = PictureWindows::of(shape);
        let ranges = windows.ranges();
        assert_eq!((ranges.len(), ranges[0].start), (6, 0));
        assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start));
        assert_eq!(ranges.last().unwrap().end, shape.block_count());
        for range in ranges {
            let rects = windows.blocks(&range).iter().map(|&id| shape.rect(id));
            let across = rects.clone().map(|rect| rect.x).min().unwrap()..rects.map(|r| r.x + r.width).max().unwrap();
            assert!(across.len() <= SIDE as usize);
            range.clone().for_each(|place| assert_eq!(windows.place(windows.blocks(&(place..place + 1))[0]), place));
        }
    }
}
