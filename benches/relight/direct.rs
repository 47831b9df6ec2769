//! The direct product with a raw matrix that is in memory already, or in a file of its entries alone: the fastest that can be
//! done without factors.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Mutex;

use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, MatrixShape, TracedBlock};
use ltm::resources::budget_bytes;
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

/// A file of [`InMemory`]'s entries, block after block.
pub(crate) struct OnDisk<'a> {
    file: File,
    of: &'a InMemory,
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
            let Entries { columns, values, .. } = block;
            rows.fill(0.0);
            pulp::Arch::new().dispatch(AddColumns { columns, values, weights: lighting.weights(), rows });
        });
    }

    /// Adds a change of one light to the rows of all blocks, on all threads.
    pub(crate) fn add_column(&self, column: ColumnIndex, weight: [f32; CHANNELS], target: &[Mutex<Vec<f32>>]) {
        self.blocks.par_iter().zip(target).for_each(|(block, rows)| {
            if let Ok(at) = block.columns.binary_search(&column.0) {
                let rows = &mut *rows.lock().expect("no thread panics with it");
                let values = &block.values[at * block.rows..][..block.rows];
                pulp::Arch::new().dispatch(AddColumns { columns: &[0], values, weights: &[weight], rows });
            }
        });
    }

    /// Writes the entries into a file of their own.
    pub(crate) fn write(&self, path: &Path) -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        for block in &self.blocks {
            file.write_all(bytemuck::cast_slice(&block.values))?;
        }
        file.into_inner()?.sync_all()
    }

    /// Opens such a file.
    pub(crate) fn opened(&self, path: &Path) -> std::io::Result<OnDisk<'_>> {
        Ok(OnDisk { file: File::open(path)?, of: self })
    }

    /// The image of the rows of all blocks.
    pub(crate) fn image(&self, target: &[Mutex<Vec<f32>>]) -> LinearImage {
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        for (id, rows) in self.shape.blocks().zip(target) {
            let (rect, rows) = (self.shape.rect(id), rows.lock().expect("no thread panics with it"));
            let pixels = rect.pixels();
            for i in 0..pixels {
                let (x, y) = (i as u32 % rect.width, i as u32 / rect.width);
                let at = (rect.y + y) * self.shape.width() + rect.x + x;
                image.pixels[at as usize] = std::array::from_fn(|channel| rows[channel * pixels + i]);
            }
        }
        image
    }
}

impl OnDisk<'_> {
    /// The image under a lighting: reads no more than the entries, block by block on all threads.
    pub(crate) fn relit(&self, lighting: &Lighting) -> std::io::Result<LinearImage> {
        let target = self.of.target();
        let sizes = self.of.blocks.iter().map(|block| 4 * block.values.len() as u64);
        let begins: Vec<u64> = sizes.scan(0, |end, size| Some(std::mem::replace(end, *end + size))).collect();
        let blocks = self.of.blocks.par_iter().zip(&target).zip(begins);
        blocks.try_for_each_init(Vec::new, |values, ((block, rows), begin)| {
            values.resize(block.values.len(), 0.0);
            self.file.read_exact_at(bytemuck::cast_slice_mut(values), begin)?;
            let rows = &mut *rows.lock().expect("no thread panics with it");
            rows.fill(0.0);
            pulp::Arch::new().dispatch(AddColumns {
                columns: &block.columns,
                values,
                weights: lighting.weights(),
                rows,
            });
            Ok::<_, std::io::Error>(())
        })?;
        Ok(self.of.image(&target))
    }
}

/// Columns times their weights, added to the rows of a block; compiled for the vectors that the machine has. Not a closure: what
/// wraps one is compiled without them.
struct AddColumns<'a> {
    /// Which of the weights are theirs.
    columns: &'a [u32],
    /// Column after column.
    values: &'a [f32],
    weights: &'a [[f32; CHANNELS]],
    rows: &'a mut [f32],
}

impl pulp::NullaryFnOnce for AddColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { columns, values, weights, rows } = self;
        let (all, pixels) = (rows.len(), rows.len() / CHANNELS);
        for (values, columns) in values.chunks(AT_ONCE * all).zip(columns.chunks(AT_ONCE)) {
            for (channel, rows) in rows.chunks_exact_mut(pixels).enumerate() {
                let plane = |column: usize| &values[column * all + channel * pixels..][..pixels];
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
