//! Reads a container back as arrays, block by block, in memory of one block: prints the mean of each light's column.
//!
//! `cargo run --release --example read_blocks -- room.ltc`

use std::path::Path;

use ltm::container::ContainerReader;
use ltm::light::column_name;
use ltm::matrix::ColumnIndex;

fn main() -> ltm::Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "room.ltc".into());
    let container = ContainerReader::open(Path::new(&path))?;
    let job = container.job();

    let mut sums = vec![0.0; job.shape.columns()];
    for id in job.shape.blocks() {
        // rows × columns, column by column.
        let block = container.read_block(id)?.expand();
        for (sum, column) in sums.iter_mut().zip(block.entries().chunks_exact(block.rows())) {
            *sum += column.iter().map(|&entry| f64::from(entry)).sum::<f64>();
        }
    }
    for (column, sum) in sums.iter().enumerate() {
        eprintln!("{}: {:.6}", column_name(ColumnIndex(column as u32), &job.basis), sum / job.shape.rows() as f64);
    }
    Ok(())
}
