//! Entries of chosen pixels, channels and columns, from the blocks that they touch.

use std::ops::Range;

use ltm::matrix::{BlockId, CHANNELS, FactorSource, FactoredBlock, MatrixShape, PixelRect};
use ltm::{Error, Result};
use rayon::prelude::*;

use crate::matrix::Source;

/// Which entries: each list ascending and without repetition.
pub(crate) struct Wanted {
    pub rows: Vec<u32>,
    pub across: Vec<u32>,
    pub channels: Vec<u32>,
    pub columns: Vec<u32>,
}

impl Wanted {
    fn entries_of_row(&self) -> usize {
        self.across.len() * self.channels.len() * self.columns.len()
    }

    /// The number of entries. Errors: an index outside the matrix, or lists that are not ascending.
    pub(crate) fn check(&self, shape: MatrixShape) -> Result<usize> {
        let lists = [
            ("rows", &self.rows, shape.height() as usize),
            ("pixels across", &self.across, shape.width() as usize),
            ("channels", &self.channels, CHANNELS),
            ("columns", &self.columns, shape.columns()),
        ];
        for (name, list, limit) in lists {
            if !list.is_sorted_by(|a, b| a < b) || list.last().is_some_and(|&last| last as usize >= limit) {
                return Err(Error::input(name, format!("are not ascending indices below {limit}"), ""));
            }
        }
        let all = self.rows.len().checked_mul(self.entries_of_row());
        all.ok_or_else(|| Error::input("slice", "has more entries than can be counted", "ask for less"))
    }
}

/// The entries, ordered as rows × across × channels × columns.
///
/// Errors: those of [`Wanted::check`] and of reading.
pub(crate) fn read(source: &Source, wanted: &Wanted) -> Result<Vec<f32>> {
    let shape = source.shape();
    let mut entries = vec![0.0f32; wanted.check(shape)?];
    if entries.is_empty() {
        return Ok(entries);
    }
    // Bands of rows that lie in the same blocks: each is a piece of the target.
    let side = shape.block_side();
    let (mut bands, mut rest) = (Vec::new(), entries.as_mut_slice());
    for rows in wanted.rows.chunk_by(|a, b| a / side == b / side) {
        let (band, others) = rest.split_at_mut(rows.len() * wanted.entries_of_row());
        bands.push((rows, band));
        rest = others;
    }
    bands.into_par_iter().try_for_each(|(rows, band)| {
        let mut first = 0;
        for across in wanted.across.chunk_by(|a, b| a / side == b / side) {
            let id = BlockId(rows[0] / side * shape.blocks_across() + across[0] / side);
            let part = Part { rect: shape.rect(id), rows, across, first, wanted };
            part.fill(source, id, band)?;
            first += across.len();
        }
        Ok(())
    })?;
    Ok(entries)
}

/// What is wanted of one block.
struct Part<'a> {
    rect: PixelRect,
    rows: &'a [u32],
    across: &'a [u32],
    /// Place of the first of `across` among all that are wanted.
    first: usize,
    wanted: &'a Wanted,
}

impl Part<'_> {
    /// Each wanted row of the block, with where its columns begin in the band.
    fn places(&self) -> Vec<(usize, usize)> {
        let Wanted { across, channels, columns, .. } = self.wanted;
        let mut places = Vec::with_capacity(self.rows.len() * self.across.len() * channels.len());
        for (j, y) in self.rows.iter().enumerate() {
            for (i, x) in self.across.iter().enumerate() {
                for (c, &channel) in channels.iter().enumerate() {
                    let pixel = (y - self.rect.y) as usize * self.rect.width as usize + (x - self.rect.x) as usize;
                    let row = channel as usize * self.rect.pixels() + pixel;
                    let place = (j * across.len() + self.first + i) * channels.len() + c;
                    places.push((row, place * columns.len()));
                }
            }
        }
        places
    }

    fn fill(&self, source: &Source, id: BlockId, band: &mut [f32]) -> Result<()> {
        let places = self.places();
        let columns = &self.wanted.columns;
        match source {
            Source::Container(container) => {
                let block = container.read_layers(id, 0..container.layer_count(id))?;
                self.expand(&block, &places, band);
            }
            Source::Matrix(matrix) => {
                let mut at = 0;
                for run in runs(columns) {
                    let count = run.len();
                    let block = matrix.read_columns(id, run)?;
                    for (i, column) in block.entries().chunks_exact(block.rows()).enumerate() {
                        places.iter().for_each(|&(row, place)| band[place + at + i] = column[row]);
                    }
                    at += count;
                }
            }
        }
        Ok(())
    }

    /// The wanted entries of `L R + S`.
    fn expand(&self, block: &FactoredBlock, places: &[(usize, usize)], band: &mut [f32]) {
        let columns = &self.wanted.columns;
        let mut right = Vec::with_capacity(columns.len());
        for k in 0..block.rank() {
            let (left, all) = (block.left_component(k), block.right_component(k));
            right.clear();
            right.extend(columns.iter().map(|&column| all[column as usize]));
            for &(row, place) in places {
                let values = band[place..][..right.len()].iter_mut().zip(&right);
                values.for_each(|(value, right)| *value += left[row] * right);
            }
        }
        if block.sparse.is_empty() {
            return;
        }
        let mut place_of = vec![None; block.rows];
        places.iter().for_each(|&(row, place)| place_of[row] = Some(place));
        for entry in &block.sparse {
            let found = (place_of[entry.row as usize], columns.binary_search(&entry.column.0));
            if let (Some(place), Ok(column)) = found {
                band[place + column] += entry.value;
            }
        }
    }
}

/// Ascending indices as ranges without gaps.
fn runs(indices: &[u32]) -> impl Iterator<Item = Range<u32>> + '_ {
    indices.chunk_by(|a, b| a + 1 == *b).map(|run| run[0]..run[run.len() - 1] + 1)
}
