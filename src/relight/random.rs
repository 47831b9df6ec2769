//! A matrix of random factors for the tests of products.

use std::ops::Range;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::error::Result;
use crate::light::Lighting;
use crate::matrix::{
    BlockId, BlockSource, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, SparseEntry, TracedBlock,
};

/// Numbers between -1 and 1.
pub(super) fn numbers(seed: u64) -> impl FnMut() -> f32 {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    move || random.random_range(-1.0..1.0)
}

/// Blocks of random factors, some in 8 bits, with sparse entries; one block is black.
pub(super) struct Random(pub(super) MatrixShape);

impl FactorSource for Random {
    fn shape(&self) -> MatrixShape {
        self.0
    }

    fn layer_count(&self, id: BlockId) -> u32 {
        u32::from(id.0 != 1)
    }

    fn encoded_bytes(&self, _: BlockId, _: Range<u32>) -> u64 {
        0
    }

    fn read_layers(&self, id: BlockId, _: Range<u32>) -> Result<FactoredBlock> {
        let (rows, columns, rank) = (self.0.rect(id).rows(), self.0.columns(), 5);
        if id.0 == 1 {
            return Ok(FactoredBlock { rows, columns, ..Default::default() });
        }
        let mut random = numbers(u64::from(id.0));
        let mut values = |count: usize| (0..count).map(|_| random()).collect::<Vec<_>>();
        let (left, right) = (values(rows * rank), values(columns * rank));
        let sparse = [(0, 3), (2, 0), (2, rows as u32 - 1)].map(|(column, row)| SparseEntry {
            column: ColumnIndex(column),
            row,
            value: 4.0,
        });
        let step = vec![0.05, 0.0, 0.1, 0.0, 0.05];
        let (left_step, right_step) = (step.clone(), step);
        Ok(FactoredBlock {
            rows,
            columns,
            left,
            right,
            left_step,
            right_step,
            sparse: sparse.to_vec(),
            ..Default::default()
        })
    }
}

impl BlockSource for Random {
    fn shape(&self) -> MatrixShape {
        self.0
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        target.block = self.read_layers(id, 0..1)?.expand();
        Ok(())
    }
}

/// Weights between -1 and 1.
pub(super) fn random_lighting(shape: MatrixShape, seed: u64) -> Lighting {
    let mut random = numbers(seed);
    Lighting::new((0..shape.columns()).map(|_| [0; 3].map(|_| random())).collect()).unwrap()
}
