//! Containers without loss, straight from the tracer: `L` is the traced block, `R` the unit matrix.

use std::path::Path;
use std::sync::Mutex;

use ltm::container::{ContainerOptions, ContainerWriter};
use ltm::light::{Job, Light, LightBasis, LightKind, Provenance};
use ltm::matrix::BlockReport;
use ltm::matrix::{Block, BlockId, FactoredBlock, MatrixShape, TracedBlock};
use ltm::scene::LoadedScene;
use ltm::trace::{TraceSettings, Tracer};

/// Traces a scene into a container.
pub(crate) fn write(path: &Path, scene: LoadedScene, samples_per_pixel: u32) {
    let camera = &scene.scene.camera;
    let columns = scene.scene.basis.column_count();
    let shape = MatrixShape::new(camera.width, camera.height, columns as u32, 32).unwrap();
    let provenance = Provenance {
        source: scene.scene.name.clone(),
        samples_per_pixel,
        metres_per_unit: scene.scene.metres_per_unit,
        settings: camera.in_words(glam::DVec3::ZERO),
        ..Default::default()
    };
    let job = Job { shape, basis: scene.scene.basis.clone(), provenance };
    let settings = TraceSettings { samples_per_pixel, seed: 1, max_depth: 6 };
    let tracer = Tracer::new(scene.scene, shape, settings).unwrap();
    let writer =
        ContainerWriter::create(path, &job, ContainerOptions { overwrite: true, ..Default::default() }).unwrap();
    let next = Mutex::new(shape.blocks());
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                let mut traced = TracedBlock::default();
                loop {
                    let Some(id) = next.lock().unwrap().next() else { return };
                    tracer.trace_block(id, &mut traced);
                    write_block(&writer, id, &traced, columns);
                }
            });
        }
    });
    writer.finish().unwrap();
}

fn write_block(writer: &ContainerWriter, id: BlockId, traced: &TracedBlock, columns: usize) {
    let mut right = vec![0.0; columns * columns];
    (0..columns).for_each(|column| right[column * columns + column] = 1.0);
    let block = FactoredBlock {
        rows: traced.block.rows(),
        columns,
        left: traced.block.entries().to_vec(),
        right,
        ..Default::default()
    };
    let encoded = writer.encode(id, &block).unwrap();
    let decoded = writer.encoder().decode(id, &encoded).unwrap().expand();
    let (mut squared_error, mut squared_norm) = (0.0, 0.0);
    for (&kept, &stored) in decoded.entries().iter().zip(traced.block.entries()) {
        squared_error += f64::from(kept - stored).powi(2);
        squared_norm += f64::from(stored).powi(2);
    }
    let report = BlockReport { squared_error, squared_norm, ..Default::default() };
    writer.write_encoded(id, &encoded, &report).unwrap();
}

/// Width and height of the stage's picture.
pub(crate) const STAGE: [u32; 2] = [160, 120];

/// Writes a container of `count` lamps in groups of ten, each of which lights a vertical strip of a grey picture, the
/// first at the left edge.
pub(crate) fn write_stage(path: &Path, count: usize) {
    let names: Vec<String> = (0..count).map(|lamp| format!("row {}/{}", lamp / 10 + 1, lamp % 10 + 1)).collect();
    write_lamps(path, &names.iter().map(String::as_str).collect::<Vec<_>>());
}

/// Writes a container of these lamps, each of which lights a vertical strip of a grey picture, the first at the left edge.
pub(crate) fn write_lamps(path: &Path, lamps: &[&str]) {
    write_sized_lamps(path, STAGE, lamps);
}

/// As [`write_lamps`], with a picture of this size. The container states no camera.
pub(crate) fn write_sized_lamps(path: &Path, [width, height]: [u32; 2], lamps: &[&str]) {
    let (mut basis, count) = (LightBasis::new(), lamps.len());
    for name in lamps {
        basis.push(Light::unplaced(*name, LightKind::Lamp)).unwrap();
    }
    let shape = MatrixShape::new(width, height, count as u32, 32).unwrap();
    let job = Job { shape, basis, provenance: Provenance { source: "stage".into(), ..Default::default() } };
    let writer =
        ContainerWriter::create(path, &job, ContainerOptions { overwrite: true, ..Default::default() }).unwrap();
    for id in shape.blocks() {
        let rect = shape.rect(id);
        let mut block = Block::zeros(rect.pixels() * 3, count);
        for row in 0..block.rows() {
            let x = rect.x as usize + row % rect.pixels() % rect.width as usize;
            let lamp = x * count / width as usize;
            block.entries_mut()[lamp * rect.pixels() * 3 + row] = 0.5;
        }
        write_block(&writer, id, &TracedBlock { block, noise: None, planes: None }, count);
    }
    writer.finish().unwrap();
}
