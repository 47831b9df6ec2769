//! Sources of unpacking: a container, or a stored matrix.

use crate::container::ContainerReader;
use crate::error::Result;
use crate::light::Job;
use crate::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, FactorSource, TracedBlock};
use crate::resources::MemoryNeed;
use crate::store::StoreReader;

/// Columns with their weights, ascending.
pub type ColumnWeights = Vec<(ColumnIndex, [f32; CHANNELS])>;

/// A matrix in a file, block by block.
pub trait UnpackSource: MemoryNeed + Sync {
    /// The job of the matrix.
    fn job(&self) -> &Job;

    /// Identifies the matrix: an unpack continues only over the same one.
    ///
    /// # Errors
    /// The system refuses to read.
    fn fingerprint(&self) -> Result<[u8; 32]>;

    /// Upper bound of the memory for reading a block, in bytes.
    fn reading_bytes(&self) -> u64 {
        self.thread_bytes()
    }

    /// Calls `work` for each column in `columns` (ascending) that is not black in a block, with its position there and
    /// its rows.
    ///
    /// # Errors
    /// Those of reading: the block is missing or damaged.
    fn visit(&self, id: BlockId, columns: &[ColumnIndex], work: &mut dyn FnMut(usize, &[f32])) -> Result<()>;

    /// Calls `each` with the index of every lighting and the rows of a block under it, channel by channel.
    ///
    /// # Errors
    /// Those of reading, and of `each`.
    fn relight(
        &self,
        id: BlockId,
        lightings: &[ColumnWeights],
        each: &mut dyn FnMut(usize, Vec<f64>) -> Result<()>,
    ) -> Result<()>;
}

impl UnpackSource for ContainerReader {
    fn job(&self) -> &Job {
        Self::job(self)
    }

    fn fingerprint(&self) -> Result<[u8; 32]> {
        Ok(Self::fingerprint(self))
    }

    /// The factors of a block while they are decoded and joined.
    fn reading_bytes(&self) -> u64 {
        let shape = FactorSource::shape(self);
        let largest = shape.blocks().map(|id| self.rank(id) * 4 + self.sparse_entries(id) / 64).max().unwrap_or(0);
        3 * largest as u64 * (shape.max_block_rows() + shape.columns()) as u64
    }

    fn visit(&self, id: BlockId, columns: &[ColumnIndex], work: &mut dyn FnMut(usize, &[f32])) -> Result<()> {
        let block = self.read_block(id)?;
        let mut rows = vec![0.0; FactorSource::shape(self).rect(id).rows()];
        for (place, &column) in columns.iter().enumerate() {
            rows.fill(0.0);
            block.add_column(column, &mut rows);
            work(place, &rows);
        }
        Ok(())
    }

    fn relight(
        &self,
        id: BlockId,
        lightings: &[ColumnWeights],
        each: &mut dyn FnMut(usize, Vec<f64>) -> Result<()>,
    ) -> Result<()> {
        let block = self.read_block(id)?;
        lightings.iter().enumerate().try_for_each(|(i, weights)| each(i, block.relight(weights.iter().copied())))
    }
}

impl UnpackSource for StoreReader {
    fn job(&self) -> &Job {
        Self::job(self)
    }

    fn fingerprint(&self) -> Result<[u8; 32]> {
        Self::fingerprint(self)
    }

    fn visit(&self, id: BlockId, columns: &[ColumnIndex], work: &mut dyn FnMut(usize, &[f32])) -> Result<()> {
        let mut place = 0;
        for run in columns.chunk_by(|a, b| a.0 + 1 == b.0) {
            let range = run[0].0..run[run.len() - 1].0 + 1;
            self.visit_columns(id, range, &mut TracedBlock::default(), &mut |column, entries| {
                work(place + (column.0 - run[0].0) as usize, entries);
            })?;
            place += run.len();
        }
        Ok(())
    }

    /// Reads the columns of one lighting after those of another, so that memory holds one image of the block.
    fn relight(
        &self,
        id: BlockId,
        lightings: &[ColumnWeights],
        each: &mut dyn FnMut(usize, Vec<f64>) -> Result<()>,
    ) -> Result<()> {
        let rect = Self::job(self).shape.rect(id);
        for (i, weights) in lightings.iter().enumerate() {
            let columns: Vec<ColumnIndex> = weights.iter().map(|&(column, _)| column).collect();
            let mut sums = vec![0.0f64; rect.rows()];
            self.visit(id, &columns, &mut |place, entries| {
                let planes = sums.chunks_exact_mut(rect.pixels()).zip(entries.chunks_exact(rect.pixels()));
                for ((sums, entries), weight) in planes.zip(weights[place].1) {
                    let values = sums.iter_mut().zip(entries);
                    values.for_each(|(sum, &entry)| *sum += f64::from(entry) * f64::from(weight));
                }
            })?;
            each(i, sums)?;
        }
        Ok(())
    }
}
