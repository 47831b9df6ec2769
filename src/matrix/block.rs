//! Blocks of entries of `T`, owned and borrowed.

use super::{BlockNoise, BlockPlanes, ColumnIndex};

/// The entries of one block: `rows × columns`, column-major (see the module's layout).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    rows: usize,
    columns: usize,
    entries: Vec<f32>,
}

/// A borrowed block of entries: `rows × columns`, column-major.
#[derive(Clone, Copy, Debug)]
pub struct BlockView<'a> {
    rows: usize,
    columns: usize,
    entries: &'a [f32],
}

/// A block with the noise and the features that tracing measured.
///
/// Entries, and the emission in the planes, are those of a weight 1 on each column. Noise and the light of clusters are
/// of columns divided by their scales, if the light basis has them: otherwise sums over columns of different units
/// would be dominated by one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TracedBlock {
    /// The entries: the mean of the two half-sample estimates.
    pub block: Block,
    /// The noise that the two halves show; none where the source cannot know it (imported renders).
    pub noise: Option<BlockNoise>,
    /// What its samples are; none where the source cannot know it (imported renders, one sample a pixel).
    pub planes: Option<BlockPlanes>,
}

impl TracedBlock {
    /// Divides entries and emission by the scales of their columns, which noise and light are divided by already. Of no scales all
    /// are 1.
    pub fn divide_columns(&mut self, scales: &[f32]) {
        self.block.divide_columns(scales);
        let emission = self.planes.iter_mut().flat_map(|planes| &mut planes.emission);
        for seen in emission.filter(|_| !scales.is_empty()) {
            let inverse = scales[seen.column as usize].recip();
            seen.value.iter_mut().for_each(|value| *value *= inverse);
        }
    }
}

impl Block {
    /// A block of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self { rows, columns, entries: vec![0.0; rows * columns] }
    }

    /// A block over `entries`, column-major.
    ///
    /// # Panics
    /// If there are not `rows · columns` of them.
    pub fn from_entries(rows: usize, columns: usize, entries: Vec<f32>) -> Self {
        assert_eq!(entries.len(), rows * columns);
        Self { rows, columns, entries }
    }

    /// Makes this a block of zeros of the given shape, keeping its allocation.
    pub fn reset(&mut self, rows: usize, columns: usize) {
        self.rows = rows;
        self.columns = columns;
        self.entries.clear();
        self.entries.resize(rows * columns, 0.0);
    }

    /// Makes this a copy of a block, keeping its allocation.
    pub fn copy_from(&mut self, block: BlockView<'_>) {
        (self.rows, self.columns) = (block.rows, block.columns);
        self.entries.clear();
        self.entries.extend_from_slice(block.entries);
    }

    /// Rows: pixels × channels.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns: basis lights.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// All entries, column-major.
    pub fn entries(&self) -> &[f32] {
        &self.entries
    }

    /// Divides each column by its scale. Of no scales all are 1.
    pub fn divide_columns(&mut self, scales: &[f32]) {
        for (column, scale) in self.entries.chunks_exact_mut(self.rows.max(1)).zip(scales) {
            let inverse = scale.recip();
            column.iter_mut().for_each(|entry| *entry *= inverse);
        }
    }

    /// All entries, column-major.
    pub fn entries_mut(&mut self) -> &mut [f32] {
        &mut self.entries
    }

    /// The rows of one column.
    pub fn column_mut(&mut self, column: ColumnIndex) -> &mut [f32] {
        &mut self.entries[column.index() * self.rows..][..self.rows]
    }

    /// Borrows the block.
    pub fn view(&self) -> BlockView<'_> {
        BlockView { rows: self.rows, columns: self.columns, entries: &self.entries }
    }
}

impl<'a> BlockView<'a> {
    /// A view of `entries`, column-major.
    ///
    /// # Panics
    /// If there are not `rows · columns` of them.
    pub fn new(rows: usize, columns: usize, entries: &'a [f32]) -> Self {
        assert_eq!(entries.len(), rows * columns);
        Self { rows, columns, entries }
    }

    /// Rows: pixels × channels.
    pub fn rows(self) -> usize {
        self.rows
    }

    /// Columns: basis lights.
    pub fn columns(self) -> usize {
        self.columns
    }

    /// All entries, column-major.
    pub fn entries(self) -> &'a [f32] {
        self.entries
    }

    /// The rows of one column.
    pub fn column(self, column: ColumnIndex) -> &'a [f32] {
        &self.entries[column.index() * self.rows..][..self.rows]
    }

    /// The entry at (`row`, `column`).
    pub fn at(self, row: usize, column: usize) -> f32 {
        self.entries[column * self.rows + row]
    }
}
