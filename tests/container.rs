//! Behaviour of the container from outside.

use std::path::Path;

use ltm::container::codec::CodecSettings;
use ltm::container::{BlockReport, ContainerOptions, ContainerReader, ContainerWriter, merge, verify};
use ltm::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance};
use ltm::matrix::{BlockId, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, SparseEntry};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn light(name: &str, kind: LightKind) -> Light {
    let (across, down) = kind.layout();
    let texels = (0..down).flat_map(|v| (0..across).map(move |u| (u, v)));
    let places: Vec<[f32; 3]> = texels.map(|(u, v)| [u as f32 * 0.1, 2.0, v as f32 * 0.1]).collect();
    Light {
        name: name.into(),
        kind,
        unit: LightUnit::Radiance,
        emission: [1.0; 3],
        first_column: 0,
        extents: vec![0.01; places.len()],
        places,
    }
}

/// 40 × 24 pixels in blocks of 16 (so with narrow ones), an 8 × 8 area light and three lamps.
fn job() -> Job {
    let mut basis = LightBasis::new();
    basis.push(light("panel", LightKind::AreaTexels { across: 8, down: 8 })).unwrap();
    for name in ["a", "b", "c"] {
        basis.push(light(name, LightKind::Lamp)).unwrap();
    }
    let provenance = Provenance { source: "test".into(), ..Default::default() };
    Job { shape: MatrixShape::new(40, 24, 67, 16).unwrap(), basis, provenance }
}

/// Smooth factors with a little noise, of falling weight; every fourth block has sparse entries, every fifth is black.
fn block(job: &Job, id: BlockId) -> FactoredBlock {
    let rect = job.shape.rect(id);
    let (rows, columns) = (rect.rows(), job.shape.columns());
    let mut random = Pcg64Mcg::seed_from_u64(u64::from(id.0));
    let mut block = FactoredBlock { rows, columns, ..Default::default() };
    if id.0 % 5 == 4 {
        return block;
    }
    for k in 0..1 + id.index() % 4 {
        let (a, b): (f32, f32) = (random.random(), random.random());
        let size = 0.25f32.powi(k as i32);
        let width = rect.width as usize;
        block.left.extend((0..rows).map(|row| {
            let (x, y) = ((row % rect.pixels()) % width, (row % rect.pixels()) / width);
            size * ((a * x as f32 * 0.3 + b * y as f32 * 0.2).cos() + 0.01 * (random.random::<f32>() - 0.5))
        }));
        block.right.extend((0..columns).map(|j| (a + 0.1 * (j % 8) as f32 + b * 0.1 * (j / 8) as f32).sin()));
    }
    if id.0 % 4 == 1 {
        block.sparse = (0..20u32)
            .map(|i| SparseEntry { column: ColumnIndex(i * 3), row: i * 5 + i % 3, value: 1.0 + i as f32 })
            .collect();
    }
    block
}

fn report(id: BlockId) -> BlockReport {
    BlockReport {
        squared_error: f64::from(id.0) * 0.25,
        squared_norm: 100.0,
        noise_variance: 0.5,
        uniform_error: 0.125,
    }
}

/// Blocks are small here, so their base layers need a larger share.
fn options() -> ContainerOptions {
    ContainerOptions { codec: CodecSettings { base_share: 0.5, ..Default::default() }, ..Default::default() }
}

fn pack(path: &Path, job: &Job, ids: impl Iterator<Item = BlockId>, partial: bool) {
    let writer = ContainerWriter::create(path, job, ContainerOptions { partial, ..options() }).unwrap();
    for id in ids {
        writer.write_block(id, &block(job, id), &report(id)).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let job = job();
    pack(&path, &job, job.shape.blocks(), false);
    let reader = ContainerReader::open(&path).unwrap();
    assert_eq!(reader.job(), &job);
    for id in job.shape.blocks() {
        let (read, wrote) = (reader.read_block(id).unwrap(), block(&job, id));
        assert_eq!(read.rank(), wrote.rank());
        assert_eq!(reader.rank(id), wrote.rank());
        assert_eq!(read.sparse.len(), wrote.sparse.len());
        assert_eq!(reader.block_report(id), report(id));
        let (read, wrote) = (read.expand(), wrote.expand());
        let error: f32 = read.entries().iter().zip(wrote.entries()).map(|(a, b)| (a - b).powi(2)).sum();
        let norm: f32 = wrote.entries().iter().map(|b| b * b).sum();
        // Factors without steps keep what a 16-bit float keeps: 2^-11 of the largest value, in both factors.
        assert!(error.sqrt() <= 2e-3 * norm.sqrt(), "{id}: {error} of {norm}");
    }
    assert_eq!(verify(&path).unwrap().faults, []);
}

#[test]
fn the_order_of_writing_does_not_show_in_the_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let job = job();
    let (a, b) = (folder.path().join("a.ltc"), folder.path().join("b.ltc"));
    pack(&a, &job, job.shape.blocks(), false);
    let ids: Vec<_> = job.shape.blocks().collect();
    pack(&b, &job, ids.into_iter().rev(), false);
    assert_eq!(std::fs::read(a).unwrap(), std::fs::read(b).unwrap());
}

#[test]
fn merged_parts_are_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let job = job();
    let path = |name: &str| folder.path().join(name);
    pack(&path("whole"), &job, job.shape.blocks(), false);
    pack(&path("a"), &job, job.shape.blocks().filter(|id| id.0 < 3), true);
    pack(&path("b"), &job, job.shape.blocks().filter(|id| id.0 >= 3), true);
    let part = ContainerReader::open(&path("a")).unwrap();
    assert!(part.read_block(BlockId(5)).is_err());
    merge(&[&path("a"), &path("b")], &path("merged"), false).unwrap();
    assert_eq!(std::fs::read(path("merged")).unwrap(), std::fs::read(path("whole")).unwrap());
    assert!(merge(&[&path("a")], &path("merged"), false).is_err());
}

#[test]
fn a_killed_pack_continues_where_it_stood() {
    let folder = tempfile::tempdir().unwrap();
    let job = job();
    let (whole, killed) = (folder.path().join("whole.ltc"), folder.path().join("killed.ltc"));
    pack(&whole, &job, job.shape.blocks(), false);
    let writer = ContainerWriter::create(&killed, &job, options()).unwrap();
    for id in job.shape.blocks().take(4) {
        writer.write_block(id, &block(&job, id), &report(id)).unwrap();
    }
    drop(writer);
    // The last record is torn, as after a power cut.
    let part = folder.path().join("killed.ltc.part");
    let bytes = std::fs::read(&part).unwrap();
    std::fs::write(&part, &bytes[..bytes.len() - 7]).unwrap();
    let writer = ContainerWriter::create(&killed, &job, options()).unwrap();
    assert_eq!(job.shape.blocks().filter(|&id| writer.is_written(id)).count(), 3);
    for id in job.shape.blocks() {
        if !writer.is_written(id) {
            writer.write_block(id, &block(&job, id), &report(id)).unwrap();
        }
    }
    writer.finish().unwrap();
    assert_eq!(std::fs::read(whole).unwrap(), std::fs::read(killed).unwrap());
    assert!(!part.exists());
}

#[test]
fn every_truncation_and_every_flipped_byte_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bad) = (folder.path().join("a.ltc"), folder.path().join("bad.ltc"));
    let job = job();
    pack(&path, &job, job.shape.blocks(), false);
    let bytes = std::fs::read(&path).unwrap();
    for length in (0..bytes.len()).step_by(7).chain(bytes.len() - 200..bytes.len()) {
        std::fs::write(&bad, &bytes[..length]).unwrap();
        assert!(ContainerReader::open(&bad).is_err(), "cut at {length}");
    }
    let stride = if bytes.len() > 20_000 { 13 } else { 1 };
    for at in (0..bytes.len()).step_by(stride).chain(0..64).chain(bytes.len() - 600..bytes.len()) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x41;
        std::fs::write(&bad, &flipped).unwrap();
        let noticed = verify(&bad).map_or(true, |found| found.faults.len() == 1);
        assert!(noticed, "flipped at {at}");
    }
}

#[test]
fn a_bad_block_is_named_and_the_rest_stays_readable() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let job = job();
    pack(&path, &job, job.shape.blocks(), false);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[70] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let reader = ContainerReader::open(&path).unwrap();
    let error = reader.read_block(BlockId(0)).unwrap_err().to_string();
    assert!(error.contains("block 0") && error.contains("checksum"), "{error}");
    assert!(reader.read_block(BlockId(1)).is_ok());
    assert_eq!(verify(&path).unwrap().faults.len(), 1);
}

#[test]
fn a_file_that_exists_is_not_replaced_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    std::fs::write(&path, "precious").unwrap();
    assert!(ContainerWriter::create(&path, &job(), ContainerOptions::default()).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn layers_add_up_to_the_block_and_the_base_layers_come_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let job = job();
    pack(&path, &job, job.shape.blocks(), false);
    let reader = ContainerReader::open(&path).unwrap();
    let mut split = 0;
    for id in job.shape.blocks() {
        let layers = reader.layer_count(id);
        if layers < 2 {
            continue;
        }
        split += 1;
        let base = reader.read_layers(id, 0..1).unwrap();
        let rest = reader.read_layers(id, 1..layers).unwrap();
        let whole = reader.read_block(id).unwrap().expand();
        assert!(base.is_consistent() && rest.is_consistent());
        let (base, rest) = (base.expand(), rest.expand());
        for ((a, b), whole) in base.entries().iter().zip(rest.entries()).zip(whole.entries()) {
            // Sums of a few products in f32, in another order.
            assert!((a + b - whole).abs() <= 1e-5 * (a.abs() + b.abs() + 1.0), "{id}: {a} + {b} is not {whole}");
        }
    }
    assert!(split >= 2, "the test's blocks are too small to be split");
    assert!(reader.base_bytes() < reader.file_bytes() * 2 / 3);
}
