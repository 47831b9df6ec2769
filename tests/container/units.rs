//! Columns of any unit.

use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter};
use ltm::matrix::BlockId;

use super::{block, job, report};

/// Each light by itself comes back as it was written, also one whose unit makes it 10⁻¹⁸ of another.
#[test]
fn lights_of_any_unit_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("units.ltc");
    let mut job = job();
    // The panel, then the lamps.
    let scales = [vec![1e9; 64], vec![1e-9, 1.0, 1e-3]].concat();
    job.basis.set_column_scales(scales.clone()).unwrap();
    let scaled = |id: BlockId| {
        let mut block = block(&job, id);
        block.scale_columns(&scales);
        block
    };
    let writer = ContainerWriter::create(&path, &job, ContainerOptions::default()).unwrap();
    for id in job.shape.blocks() {
        writer.write_block(id, &scaled(id), &report(id)).unwrap();
    }
    writer.finish().unwrap();
    let reader = ContainerReader::open(&path).unwrap();
    for id in job.shape.blocks() {
        let (read, wrote) = (reader.read_block(id).unwrap().expand(), block(&job, id).expand());
        let (rows, norm) = (wrote.rows(), wrote.entries().iter().map(|b| b * b).sum::<f32>().sqrt());
        for (column, (a, b)) in read.entries().chunks(rows).zip(wrote.entries().chunks(rows)).enumerate() {
            let error: f32 = a.iter().zip(b).map(|(a, b)| (a / scales[column] - b).powi(2)).sum();
            // The file keeps what a 16-bit float keeps of each component.
            assert!(error.sqrt() <= 2e-3 * norm, "{id}, column {column}: {} of {norm}", error.sqrt());
        }
    }
}
