//! Blocks as factors: the one shape that every compressor makes and every relighter uses.

use super::{Block, ColumnIndex};

/// One large entry kept outside the low-rank part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseEntry {
    /// Column of the entry.
    pub column: ColumnIndex,
    /// Row of the entry inside its block.
    pub row: u32,
    /// What is added to the low-rank part there.
    pub value: f32,
}

/// A block as `L R + S`: `left` is rows × rank, `right` is rank × columns, `sparse` holds single entries.
///
/// The rank's components stand in the order of what they bring, so that a prefix of them is the best smaller block.
/// CUR (the paper, §3.2) fits this shape with `L = C` and `R = U · R`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FactoredBlock {
    /// Rows of the block: pixels × channels.
    pub rows: usize,
    /// Columns: basis lights.
    pub columns: usize,
    /// `L`, column-major: component `k` is `left[k · rows ..][.. rows]`.
    pub left: Vec<f32>,
    /// `R`, row-major: component `k` is `right[k · columns ..][.. columns]`.
    pub right: Vec<f32>,
    /// For each component, the quantisation step that the rate–distortion slope allows for an entry of `left`;
    /// empty: unknown, keep what a 16-bit float keeps.
    pub left_step: Vec<f32>,
    /// As `left_step`, for `right`.
    pub right_step: Vec<f32>,
    /// `S`, sorted by column, then row, without duplicates.
    pub sparse: Vec<SparseEntry>,
}

impl FactoredBlock {
    /// Number of components: the inner width of the factors.
    pub fn rank(&self) -> usize {
        self.left.len().checked_div(self.rows).unwrap_or(0)
    }

    /// Component `k` of `L`: one value per row.
    pub fn left_component(&self, k: usize) -> &[f32] {
        &self.left[k * self.rows..][..self.rows]
    }

    /// Component `k` of `R`: one value per column.
    pub fn right_component(&self, k: usize) -> &[f32] {
        &self.right[k * self.columns..][..self.columns]
    }

    /// Whether the parts fit each other: lengths, steps, and sparse entries inside the block and in order.
    pub fn is_consistent(&self) -> bool {
        let rank = self.rank();
        let steps = |steps: &[f32]| steps.is_empty() || steps.len() == rank;
        self.left.len() == rank * self.rows
            && self.right.len() == rank * self.columns
            && steps(&self.left_step)
            && steps(&self.right_step)
            && self.sparse.iter().all(|e| (e.row as usize) < self.rows && e.column.index() < self.columns)
            && self.sparse.windows(2).all(|w| (w[0].column, w[0].row) < (w[1].column, w[1].row))
    }

    /// Multiplies out: `L R + S`, accumulated in f32.
    pub fn expand(&self) -> Block {
        let mut block = Block::zeros(self.rows, self.columns);
        for (j, column) in block.entries_mut().chunks_exact_mut(self.rows.max(1)).enumerate() {
            for k in 0..self.rank() {
                let weight = self.right[k * self.columns + j];
                for (entry, left) in column.iter_mut().zip(self.left_component(k)) {
                    *entry += left * weight;
                }
            }
        }
        for entry in &self.sparse {
            block.column_mut(entry.column)[entry.row as usize] += entry.value;
        }
        block
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expanding_adds_the_low_rank_part_and_the_sparse_entries() {
        let block = FactoredBlock {
            rows: 3,
            columns: 2,
            left: vec![1.0, 2.0, 3.0],
            right: vec![10.0, 20.0],
            sparse: vec![SparseEntry { column: ColumnIndex(1), row: 0, value: 0.5 }],
            ..Default::default()
        };
        assert!(block.is_consistent());
        assert_eq!(block.rank(), 1);
        assert_eq!(block.expand().entries(), [10.0, 20.0, 30.0, 20.5, 40.0, 60.0]);
    }

    #[test]
    fn parts_that_do_not_fit_are_noticed() {
        let entry = |row, column| SparseEntry { row, column: ColumnIndex(column), value: 1.0 };
        let with = |sparse| FactoredBlock { rows: 2, columns: 2, sparse, ..Default::default() };
        assert!(with(vec![entry(0, 0), entry(1, 0), entry(0, 1)]).is_consistent());
        assert!(!with(vec![entry(2, 0)]).is_consistent());
        assert!(!with(vec![entry(0, 2)]).is_consistent());
        assert!(!with(vec![entry(0, 1), entry(1, 0)]).is_consistent());
        assert!(!with(vec![entry(0, 1), entry(0, 1)]).is_consistent());
    }
}
