//! Blocks as factors: the one shape that every compressor makes and every relighter uses.

use std::sync::Arc;

use super::{Block, CHANNELS, ColumnIndex};

/// One large entry kept outside the low-rank part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseEntry {
    /// Column of the entry.
    pub column: ColumnIndex,
    /// Row of the entry inside its block.
    pub row: u32,
    /// The value added to the low-rank part.
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
    /// How much finer than `right_step` each band of a right side is stored, in half octaves, as
    /// [`band_steps`](crate::container::codec::band_steps) weighs them; empty: all bands alike.
    pub right_band_steps: Arc<[i8]>,
    /// Whether left sides are stored as finely as the eye resolves their frequencies, and not all of them alike.
    pub by_eye: bool,
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
        self.right.len() == self.rank() * self.columns && self.is_consistent_beside_right()
    }

    /// The same of all parts but the right sides themselves.
    pub(super) fn is_consistent_beside_right(&self) -> bool {
        let rank = self.rank();
        let steps = |steps: &[f32]| steps.is_empty() || steps.len() == rank;
        self.left.len() == rank * self.rows
            && steps(&self.left_step)
            && steps(&self.right_step)
            && self.sparse.iter().all(|e| (e.row as usize) < self.rows && e.column.index() < self.columns)
            && self.sparse.windows(2).all(|w| (w[0].column, w[0].row) < (w[1].column, w[1].row))
    }

    /// Multiplies each column by its scale. Of no scales all are 1.
    pub fn scale_columns(&mut self, scales: &[f32]) {
        if scales.is_empty() {
            return;
        }
        for component in self.right.chunks_exact_mut(self.columns.max(1)) {
            component.iter_mut().zip(scales).for_each(|(value, scale)| *value *= scale);
        }
        self.sparse.iter_mut().for_each(|entry| entry.value *= scales[entry.column.index()]);
    }

    /// Multiplies out: `L R + S`, accumulated in f32.
    pub fn expand(&self) -> Block {
        let mut block = Block::zeros(self.rows, self.columns);
        for (j, column) in block.entries_mut().chunks_exact_mut(self.rows.max(1)).enumerate() {
            self.add_column(ColumnIndex(j as u32), column);
        }
        block
    }

    /// Adds one column of `L R + S` to `values`, one a row, in f32.
    ///
    /// # Panics
    /// If there is no such column.
    pub fn add_column(&self, column: ColumnIndex, values: &mut [f32]) {
        for k in 0..self.rank() {
            let weight = self.right_component(k)[column.index()];
            values.iter_mut().zip(self.left_component(k)).for_each(|(value, left)| *value += left * weight);
        }
        for entry in self.sparse_of(column) {
            values[entry.row as usize] += entry.value;
        }
    }

    /// The rows of the block under columns with their weights, channel by channel: `L (R ℓ) + S ℓ`, in f64. Columns that are
    /// not named are off.
    ///
    /// # Panics
    /// If there is no such column, or the rows are not [`CHANNELS`] planes of pixels.
    pub fn relight(&self, weights: impl Iterator<Item = (ColumnIndex, [f32; CHANNELS])> + Clone) -> Vec<f64> {
        assert_eq!(self.rows % CHANNELS, 0, "rows are channels × pixels");
        let pixels = self.rows / CHANNELS;
        let mut rows = vec![0.0f64; self.rows];
        for k in 0..self.rank() {
            let right = self.right_component(k);
            let mut sums = [0.0f64; CHANNELS];
            for (column, weight) in weights.clone() {
                let right = f64::from(right[column.index()]);
                (0..CHANNELS).for_each(|channel| sums[channel] += right * f64::from(weight[channel]));
            }
            let planes = rows.chunks_exact_mut(pixels).zip(self.left_component(k).chunks_exact(pixels));
            for ((rows, left), sum) in planes.zip(sums) {
                rows.iter_mut().zip(left).for_each(|(row, &left)| *row += f64::from(left) * sum);
            }
        }
        if !self.sparse.is_empty() {
            for (column, weight) in weights {
                for entry in self.sparse_of(column) {
                    let row = entry.row as usize;
                    rows[row] += f64::from(entry.value) * f64::from(weight[row / pixels]);
                }
            }
        }
        rows
    }

    fn sparse_of(&self, column: ColumnIndex) -> impl Iterator<Item = &SparseEntry> {
        let start = self.sparse.partition_point(|entry| entry.column < column);
        self.sparse[start..].iter().take_while(move |entry| entry.column == column)
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
    fn relighting_is_the_product_of_what_is_multiplied_out() {
        let block = FactoredBlock {
            rows: 6,
            columns: 3,
            left: (0..12).map(|i| i as f32 * 0.5 - 2.0).collect(),
            right: vec![1.0, -2.0, 0.5, 3.0, 0.25, 1.0],
            sparse: vec![SparseEntry { column: ColumnIndex(2), row: 5, value: 7.0 }],
            ..Default::default()
        };
        let whole = block.expand();
        // The column in the middle is off.
        let lighting = [(ColumnIndex(0), [1.0, 0.5, 2.0]), (ColumnIndex(2), [0.25, 1.0, 3.0])];
        let lit = block.relight(lighting.into_iter());
        for (row, lit) in lit.iter().enumerate() {
            let sum: f32 =
                lighting.iter().map(|(column, weight)| whole.view().column(*column)[row] * weight[row / 2]).sum();
            // The block is multiplied out in f32.
            assert!((lit - f64::from(sum)).abs() < 1e-5, "{lit} {sum}");
        }
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
