//! Blocks of factors made by hand, in memory, that count what is read of them.

#![allow(dead_code, reason = "each test takes what it needs of this")]

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ltm::error::{Error, Result};
use ltm::light::Lighting;
use ltm::matrix::{
    BlockId, BlockSource, CHANNELS, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, SparseEntry, TracedBlock,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Layers of each block, the base first.
pub(crate) struct MemoryFactors {
    pub(crate) shape: MatrixShape,
    pub(crate) layers: Vec<Vec<FactoredBlock>>,
    /// (block, layer) that are damaged.
    pub(crate) damaged: BTreeSet<(u32, u32)>,
    pub(crate) reads: AtomicU64,
    pub(crate) bytes: AtomicU64,
    /// Each (block, layer) as it was read.
    pub(crate) log: Mutex<Vec<(u32, u32)>>,
}

/// How to make a matrix of factors.
#[derive(Clone)]
pub(crate) struct Recipe {
    pub(crate) size: (u32, u32),
    pub(crate) block_side: u32,
    pub(crate) columns: u32,
    /// Components of each layer.
    pub(crate) ranks: Vec<usize>,
    /// Sparse entries of each layer.
    pub(crate) sparse: usize,
    /// Whether steps allow 8 bits.
    pub(crate) narrow: bool,
}

impl Recipe {
    pub(crate) fn new(size: (u32, u32), block_side: u32, columns: u32, ranks: &[usize]) -> Self {
        Self { size, block_side, columns, ranks: ranks.to_vec(), sparse: 0, narrow: false }
    }

    pub(crate) fn sparse(self, sparse: usize) -> Self {
        Self { sparse, ..self }
    }

    pub(crate) fn narrow(self) -> Self {
        Self { narrow: true, ..self }
    }

    pub(crate) fn make(&self) -> MemoryFactors {
        let shape = MatrixShape::new(self.size.0, self.size.1, self.columns, self.block_side).unwrap();
        let layers = shape.blocks().map(|id| {
            let layer = |(l, &rank): (usize, &usize)| random_block(shape, id, rank, self, l);
            self.ranks.iter().enumerate().map(layer).collect()
        });
        MemoryFactors {
            shape,
            layers: layers.collect(),
            damaged: BTreeSet::new(),
            reads: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
            log: Mutex::new(Vec::new()),
        }
    }
}

/// Matrices at the edges of what there is.
pub(crate) fn hard_shapes() -> Vec<(&'static str, Recipe)> {
    vec![
        ("rank 0", Recipe::new((40, 20), 16, 5, &[0])),
        ("no layers", Recipe::new((40, 20), 16, 5, &[])),
        ("rank 1", Recipe::new((40, 20), 16, 5, &[1])),
        ("ragged edges", Recipe::new((37, 53), 16, 70, &[5, 3]).sparse(40)),
        ("one pixel", Recipe::new((1, 1), 32, 9, &[2]).sparse(5)),
        ("one column", Recipe::new((33, 31), 32, 1, &[1]).sparse(9)),
        ("4,096 columns", Recipe::new((32, 16), 16, 4096, &[7]).sparse(500)),
        ("largest rank", Recipe::new((8, 8), 8, 192, &[192])),
        ("sparse only", Recipe::new((20, 20), 8, 33, &[0]).sparse(100)),
        ("largest blocks", Recipe::new((300, 260), 256, 12, &[3])),
    ]
}

/// Values of falling size from component to component, of both signs, with steps that 8 bits meet exactly or not.
fn random_block(shape: MatrixShape, id: BlockId, rank: usize, recipe: &Recipe, layer: usize) -> FactoredBlock {
    let seed = 1000 * u64::from(id.0) + layer as u64;
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (rows, columns) = (shape.rect(id).rows(), shape.columns());
    let mut factor = |length: usize| {
        let mut values = Vec::with_capacity(length * rank);
        let mut steps = Vec::new();
        for k in 0..rank {
            let size = 0.9f32.powi(k as i32) * (layer as f32 * -1.5).exp();
            // Every other component holds multiples of its step, as a decoded one does.
            let step = size / 100.0;
            for _ in 0..length {
                let value = size * (random.random::<f32>() * 2.0 - 0.8) / 1.2;
                values.push(if k % 2 == 0 && recipe.narrow { (value / step).round() * step } else { value });
            }
            steps.push(step);
        }
        (values, if recipe.narrow { steps } else { Vec::new() })
    };
    let ((left, left_step), (right, right_step)) = (factor(rows), factor(columns));
    let places: BTreeSet<(u32, u32)> = (0..recipe.sparse)
        .map(|_| (random.random_range(0..columns as u32), random.random_range(0..rows as u32)))
        // Layers must not hold the same entry twice: each takes the rows of its own residue.
        .filter(|(_, row)| *row as usize % recipe.ranks.len() == layer)
        .collect();
    let entry = |(column, row): (u32, u32)| SparseEntry {
        column: ColumnIndex(column),
        row,
        value: 3.0 + (column % 7) as f32 - (row % 11) as f32,
    };
    let sparse = places.into_iter().map(entry).collect();
    FactoredBlock { rows, columns, left, right, left_step, right_step, sparse, ..Default::default() }
}

impl MemoryFactors {
    /// A range of layers as one block, without counting.
    pub(crate) fn join(&self, id: BlockId, layers: Range<u32>) -> FactoredBlock {
        let mut block =
            FactoredBlock { rows: self.shape.rect(id).rows(), columns: self.shape.columns(), ..Default::default() };
        for layer in &self.layers[id.index()][layers.start as usize..layers.end as usize] {
            block.left.extend(&layer.left);
            block.right.extend(&layer.right);
            block.left_step.extend(&layer.left_step);
            block.right_step.extend(&layer.right_step);
            block.sparse.extend(&layer.sparse);
        }
        block.sparse.sort_by_key(|e| (e.column, e.row));
        block
    }

    /// Each (block, layer) read since the last call, in the order of blocks.
    pub(crate) fn take_log(&self) -> Vec<(u32, u32)> {
        let mut log = std::mem::take(&mut *self.log.lock().unwrap());
        log.sort_unstable();
        log
    }

    /// Every (block, layer) there is, of some layers.
    pub(crate) fn chunks(&self, blocks: Range<u32>, layers: Range<u32>) -> Vec<(u32, u32)> {
        blocks.flat_map(|block| layers.clone().map(move |layer| (block, layer))).collect()
    }

    /// A copy whose log is empty and of which nothing is damaged, with only the first layers.
    pub(crate) fn first_layers(&self, count: usize) -> Self {
        let layers = self.layers.iter().map(|layers| layers[..layers.len().min(count)].to_vec()).collect();
        Self {
            shape: self.shape,
            layers,
            damaged: BTreeSet::new(),
            reads: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
            log: Mutex::default(),
        }
    }

    pub(crate) fn total_bytes(&self) -> u64 {
        self.shape.blocks().map(|id| self.encoded_bytes(id, 0..self.layer_count(id))).sum()
    }
}

impl FactorSource for MemoryFactors {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn layer_count(&self, id: BlockId) -> u32 {
        self.layers[id.index()].len() as u32
    }

    fn encoded_bytes(&self, id: BlockId, layers: Range<u32>) -> u64 {
        let layers = &self.layers[id.index()][layers.start as usize..layers.end as usize];
        let size = |b: &FactoredBlock| b.left.len() + b.right.len() + 12 * b.sparse.len();
        layers.iter().map(|block| size(block) as u64).sum()
    }

    fn stored_layer(&self, id: BlockId, layer: u32) -> Result<Vec<u8>> {
        self.read_layers(id, layer..layer + 1)?;
        Ok(vec![layer as u8; self.encoded_bytes(id, layer..layer + 1).max(1) as usize])
    }

    /// Counts nothing: what it needs was read.
    fn decode_layers(&self, id: BlockId, stored: &[Vec<u8>]) -> Result<FactoredBlock> {
        assert!(stored.iter().enumerate().all(|(layer, bytes)| bytes[0] == layer as u8));
        Ok(self.join(id, 0..stored.len() as u32))
    }

    fn read_layers(&self, id: BlockId, layers: Range<u32>) -> Result<FactoredBlock> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(self.encoded_bytes(id, layers.clone()), Ordering::Relaxed);
        self.log.lock().unwrap().extend(layers.clone().map(|layer| (id.0, layer)));
        if let Some(layer) = layers.clone().find(|&layer| self.damaged.contains(&(id.0, layer))) {
            return Err(Error::damaged("memory.ltc", format!("{id}, layer {layer}: bytes differ"), "pack it again"));
        }
        Ok(self.join(id, layers))
    }
}

impl BlockSource for MemoryFactors {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// The factors multiplied out.
    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        target.block = self.join(id, 0..self.layers[id.index()].len() as u32).expand();
        target.noise = None;
        Ok(())
    }
}

/// A lighting of uneven positive and negative weights, the same for the same seed.
pub(crate) fn random_lighting(columns: usize, seed: u64) -> Lighting {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let weights = (0..columns).map(|_| [0; CHANNELS].map(|_| random.random::<f32>() * 2.0 - 0.3));
    Lighting::new(weights.collect()).unwrap()
}

/// The largest difference of two images over the largest value that rounding could be measured by: for each pixel the
/// sum of `|L| |R| |ℓ|` would do; the largest pixel of a matrix of random signs is of that order.
pub(crate) fn largest_difference(a: &ltm::image::LinearImage, b: &ltm::image::LinearImage) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let peak = b.values().iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
    let difference = a.values().iter().zip(b.values()).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
    if difference == 0.0 { 0.0 } else { difference / peak }
}
