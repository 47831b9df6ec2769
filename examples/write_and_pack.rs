//! Writes a matrix block by block, as another renderer would, and packs it: a wall of 64 × 48 pixels under a row of eight
//! lamps, each of which lights it by the inverse square of the distance.
//!
//! `cargo run --release --example write_and_pack -- out`, where `out` is a folder; it gets `wall.ltm` and `wall.ltc`.

use std::path::Path;

use ltm::light::{Job, Light, LightBasis, LightKind, Provenance};
use ltm::matrix::{Block, BlockSink, ColumnIndex, MatrixShape, TracedBlock};
use ltm::store::{StoreOptions, StoreReader, StoreWriter};
use ltm::{PackOptions, PackReport};

const LAMPS: u32 = 8;

fn main() -> ltm::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    eprintln!("{}", write_and_pack(Path::new(&folder))?);
    Ok(())
}

/// Writes `wall.ltm` into a folder, and packs it into `wall.ltc`.
pub(crate) fn write_and_pack(folder: &Path) -> ltm::Result<PackReport> {
    let (matrix, container) = (folder.join("wall.ltm"), folder.join("wall.ltc"));

    // What the columns are: names, kinds and units travel with the file.
    let mut basis = LightBasis::new();
    for lamp in 0..LAMPS {
        basis.push(Light::unplaced(format!("lamp {lamp}"), LightKind::Image))?;
    }
    let shape = MatrixShape::new(64, 48, LAMPS, MatrixShape::DEFAULT_BLOCK_SIDE)?;
    let provenance = Provenance { source: "a wall".into(), program: "write_and_pack".into(), ..Default::default() };
    let job = Job { shape, basis, provenance };

    // Blocks in any order, from any thread; each is durable when `write_block` returns.
    let writer = StoreWriter::create(&matrix, &job, StoreOptions { overwrite: true, ..Default::default() })?;
    for id in shape.blocks() {
        let rect = shape.rect(id);
        let mut block = Block::zeros(rect.rows(), shape.columns());
        for lamp in 0..LAMPS {
            // Rows: all pixels of red, then of green, then of blue; pixels row by row.
            let column = block.column_mut(ColumnIndex(lamp));
            for (row, entry) in column.iter_mut().enumerate() {
                let pixel = row % rect.pixels();
                let x = (rect.x as usize + pixel % rect.width as usize) as f32 + 0.5;
                let y = (rect.y as usize + pixel / rect.width as usize) as f32 + 0.5;
                let across = x - (lamp as f32 + 0.5) * 8.0;
                *entry = 100.0 / (across * across + y * y + 25.0);
            }
        }
        // Other renders know nothing of their noise.
        writer.write_block(id, &TracedBlock { block, ..Default::default() })?;
    }
    writer.finish()?;

    ltm::pack(&StoreReader::open(&matrix)?, &container, &PackOptions::default())
}
