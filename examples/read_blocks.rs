//! Reads a matrix back as arrays, block by block, in memory of one block: prints the mean of each light's column.
//!
//! `cargo run --release --example read_blocks -- room.ltc`

use std::path::Path;

use ltm::light::column_name;
use ltm::matrix::ColumnIndex;

fn main() -> ltm::Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "room.ltc".into());
    means(Path::new(&path))?.iter().for_each(|(name, mean)| eprintln!("{name}: {mean:.6}"));
    Ok(())
}

/// Each column's name and the mean of its entries.
pub(crate) fn means(path: &Path) -> ltm::Result<Vec<(String, f64)>> {
    let matrix = ltm::open(path)?;
    let shape = matrix.shape();
    let mut sums = vec![0.0; shape.columns()];
    for id in shape.blocks() {
        // rows × columns, column by column.
        let block = matrix.read_block(id)?;
        for (sum, column) in sums.iter_mut().zip(block.entries().chunks_exact(block.rows())) {
            *sum += column.iter().map(|&entry| f64::from(entry)).sum::<f64>();
        }
    }
    let name = |column: usize| column_name(ColumnIndex(column as u32), matrix.basis());
    Ok(sums.iter().enumerate().map(|(column, sum)| (name(column), sum / shape.rows() as f64)).collect())
}
