//! The direct product with a raw matrix that is in memory already: the fastest that can be done without factors.

use std::sync::Mutex;

use ltm::host::budget_bytes;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, BlockSource, CHANNELS, MatrixShape, TracedBlock};
use rayon::prelude::*;

/// Columns that are added to the rows in one pass over them.
const AT_ONCE: usize = 4;

/// All raw entries in f32, without noise statistics, checksums and what else a file has, and without the columns of a
/// block that are zero throughout.
pub(crate) struct InMemory {
    shape: MatrixShape,
    blocks: Vec<Entries>,
}

struct Entries {
    rows: usize,
    columns: Vec<u32>,
    /// Column after column.
    values: Vec<f32>,
}

impl InMemory {
    /// Reads everything; none where the machine has not enough memory to spare.
    pub(crate) fn load(source: &dyn BlockSource) -> Option<Self> {
        let shape = source.shape();
        // The system's own cache and the factors need some as well.
        if budget_bytes(None) < shape.raw_bytes() + (2 << 30) {
            return None;
        }
        let read = |scratch: &mut TracedBlock, id: u32| {
            let rows = shape.rect(BlockId(id)).rows();
            let mut block = Entries { rows, columns: Vec::new(), values: Vec::new() };
            let columns = 0..shape.columns() as u32;
            block.values.reserve_exact(columns.len() * rows);
            source
                .visit_columns(BlockId(id), columns, scratch, &mut |column, entries| {
                    if entries.iter().any(|entry| *entry != 0.0) {
                        block.columns.push(column.0);
                        block.values.extend_from_slice(entries);
                    }
                })
                .expect("the matrix can be read");
            block.values.shrink_to_fit();
            block
        };
        let blocks = (0..shape.block_count()).into_par_iter().map_init(TracedBlock::default, read).collect();
        Some(Self { shape, blocks })
    }

    /// Bytes that a product reads.
    pub(crate) fn bytes(&self) -> u64 {
        self.blocks.iter().map(|block| 4 * block.values.len() as u64).sum()
    }

    /// Room for what a product makes.
    pub(crate) fn target(&self) -> Vec<Mutex<Vec<f32>>> {
        self.blocks.iter().map(|block| Mutex::new(vec![0.0; block.rows])).collect()
    }

    /// The rows of all blocks under a lighting, on all threads.
    pub(crate) fn product(&self, lighting: &Lighting, target: &[Mutex<Vec<f32>>]) {
        self.blocks.par_iter().zip(target).for_each(|(block, rows)| {
            let rows = &mut *rows.lock().expect("no thread panics with it");
            pulp::Arch::new().dispatch(Product { block, weights: lighting.weights(), rows });
        });
    }

    /// Rows of blocks as pixels, block after block, each of `pixels` where it belongs.
    pub(crate) fn each_pixel(&self, target: &[Mutex<Vec<f32>>], mut work: impl FnMut(u32, u32, [f32; CHANNELS])) {
        for (id, rows) in self.shape.blocks().zip(target) {
            let (rect, rows) = (self.shape.rect(id), rows.lock().expect("no thread panics with it"));
            let pixels = rect.pixels();
            for i in 0..pixels {
                let (x, y) = (i as u32 % rect.width, i as u32 / rect.width);
                work(rect.x + x, rect.y + y, std::array::from_fn(|channel| rows[channel * pixels + i]));
            }
        }
    }
}

/// A block's product, compiled for the vectors that the machine has. Not a closure: what wraps one is compiled without
/// them.
struct Product<'a> {
    block: &'a Entries,
    weights: &'a [[f32; CHANNELS]],
    rows: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { block, weights, rows } = self;
        rows.fill(0.0);
        let pixels = block.rows / CHANNELS;
        let some = block.values.chunks(AT_ONCE * block.rows).zip(block.columns.chunks(AT_ONCE));
        for (values, columns) in some {
            for (channel, rows) in rows.chunks_exact_mut(pixels).enumerate() {
                let plane = |column: usize| &values[column * block.rows + channel * pixels..][..pixels];
                let weight = |column: usize| weights[columns[column] as usize][channel];
                if columns.len() == AT_ONCE {
                    let (planes, weight) = ([0, 1, 2, 3].map(plane), [0, 1, 2, 3].map(weight));
                    for (i, row) in rows.iter_mut().enumerate() {
                        *row += weight[0] * planes[0][i]
                            + weight[1] * planes[1][i]
                            + weight[2] * planes[2][i]
                            + weight[3] * planes[3][i];
                    }
                } else {
                    for column in 0..columns.len() {
                        let weight = weight(column);
                        rows.iter_mut().zip(plane(column)).for_each(|(row, value)| *row += weight * value);
                    }
                }
            }
        }
    }
}
