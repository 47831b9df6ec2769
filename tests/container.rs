//! Behaviour of the container from outside.

#[path = "container/documented.rs"]
mod documented;
#[path = "container/files.rs"]
mod files;
#[path = "container/units.rs"]
mod units;

use std::path::{Path, PathBuf};

use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, ContainerOptions, ContainerReader, ContainerWriter, merge, verify};
use ltm::light::{
    DenoiseErrors, DenoisedLight, ExposedError, Job, Light, LightBasis, LightErrors, LightKind, LightUnit, Provenance,
    StatedErrors,
};
use ltm::matrix::BlockReport;
use ltm::matrix::{BlockId, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, SparseEntry};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub(crate) fn light(name: &str, kind: LightKind) -> Light {
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
pub(crate) fn job() -> Job {
    let mut basis = LightBasis::new();
    basis.push(light("panel", LightKind::AreaTexels { across: 8, down: 8 })).unwrap();
    for name in ["a", "b", "c"] {
        basis.push(light(name, LightKind::Lamp)).unwrap();
    }
    let provenance = Provenance { source: "test".into(), ..Default::default() };
    Job { shape: MatrixShape::new(40, 24, 67, 16).unwrap(), basis, provenance }
}

/// Smooth factors with a little noise, of falling weight; every fourth block has sparse entries, every fifth is black.
pub(crate) fn block(job: &Job, id: BlockId) -> FactoredBlock {
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

pub(crate) fn report(id: BlockId) -> BlockReport {
    BlockReport {
        squared_error: f64::from(id.0) * 0.25,
        squared_norm: 100.0,
        noise_variance: 0.5,
        uniform_error: 0.125,
    }
}

pub(crate) fn pack(path: &Path, job: &Job, ids: impl Iterator<Item = BlockId>, partial: bool) {
    pack_finer(path, job, ids, partial, &[]);
}

/// With bands of right sides so much finer.
pub(crate) fn pack_finer(path: &Path, job: &Job, ids: impl Iterator<Item = BlockId>, partial: bool, band_steps: &[i8]) {
    let writer = ContainerWriter::create(path, job, ContainerOptions { partial, ..Default::default() }).unwrap();
    for id in ids {
        let factors = FactoredBlock { right_band_steps: band_steps.into(), ..block(job, id) };
        writer.write_block(id, &factors, &report(id)).unwrap();
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
    merge(&[&path("a"), &path("b")], &path("merged"), false, |_, _| true).unwrap();
    assert_eq!(std::fs::read(path("merged")).unwrap(), std::fs::read(path("whole")).unwrap());
    assert!(merge(&[&path("a")], &path("merged"), false, |_, _| true).is_err());
}

#[test]
fn a_killed_pack_continues_where_it_stood() {
    let folder = tempfile::tempdir().unwrap();
    let job = job();
    let (whole, killed) = (folder.path().join("whole.ltc"), folder.path().join("killed.ltc"));
    pack(&whole, &job, job.shape.blocks(), false);
    let writer = ContainerWriter::create(&killed, &job, ContainerOptions::default()).unwrap();
    for id in job.shape.blocks().take(4) {
        writer.write_block(id, &block(&job, id), &report(id)).unwrap();
    }
    drop(writer);
    // The last record is torn, as after a power cut.
    let part = folder.path().join("killed.ltc.part");
    let bytes = std::fs::read(&part).unwrap();
    std::fs::write(&part, &bytes[..bytes.len() - 7]).unwrap();
    let writer = ContainerWriter::create(&killed, &job, ContainerOptions::default()).unwrap();
    assert_eq!(job.shape.blocks().filter(|&id| writer.written(id).is_some()).count(), 3);
    for id in job.shape.blocks() {
        if writer.written(id).is_none() {
            writer.write_block(id, &block(&job, id), &report(id)).unwrap();
        }
    }
    writer.finish().unwrap();
    assert_eq!(std::fs::read(whole).unwrap(), std::fs::read(killed).unwrap());
    assert!(!part.exists());
}

/// One block of 16 × 8 pixels, so that every byte can be tried.
pub(crate) fn small_job() -> Job {
    Job { shape: MatrixShape::new(16, 8, 67, 16).unwrap(), ..job() }
}

pub(crate) fn small_file(path: &Path) -> Vec<u8> {
    let job = small_job();
    let writer = ContainerWriter::create(path, &job, ContainerOptions::default()).unwrap();
    let factors = FactoredBlock {
        sparse: (0..20).map(|i| SparseEntry { column: ColumnIndex(i), row: i, value: i as f32 + 1.0 }).collect(),
        left_step: vec![0.01],
        right_step: vec![0.01],
        ..block(&job, BlockId(0))
    };
    writer.write_block(BlockId(0), &factors, &report(BlockId(0))).unwrap();
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn every_truncation_and_every_flipped_byte_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.ltc");
    let bytes = small_file(&folder.path().join("a.ltc"));
    for length in 0..bytes.len() {
        std::fs::write(&bad, &bytes[..length]).unwrap();
        assert!(ContainerReader::open(&bad).is_err(), "cut at {length}");
    }
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x41;
        std::fs::write(&bad, &flipped).unwrap();
        let noticed = verify(&bad).map_or(true, |found| found.faults.len() == 1);
        assert!(noticed, "flipped at {at}");
    }
}

#[test]
fn chunks_that_lie_are_errors_and_earn_no_memory() {
    let layout = BlockLayout::of(&small_job(), BlockId(0));
    let even = block(&small_job(), BlockId(0));
    let finer = FactoredBlock { right_band_steps: BAND_STEPS.into(), ..even.clone() };
    let by_eye = FactoredBlock { by_eye: true, ..even.clone() };
    for factors in [even, finer, by_eye] {
        let bytes = encode_layer(&layout, &factors, LayerPart::default(), &CodecSettings::default()).unwrap();
        for length in 0..bytes.len() {
            assert!(decode_layer(&layout, &bytes[..length], None).is_err(), "cut at {length}");
        }
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for _ in 0..20_000 {
            let mut bad = bytes.clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bad.len());
                bad[at] = random.random();
            }
            if let Ok(block) = decode_layer(&layout, &bad, None) {
                assert!(block.is_consistent());
                assert!(block.left.iter().chain(&block.right).all(|v| v.is_finite()));
            }
        }
        // A rank of 65,535 in a block of 256 × 256 pixels would be 51 GB.
        let wide = Job { shape: MatrixShape::new(256, 256, 67, 256).unwrap(), ..job() };
        let mut bad = bytes;
        bad[2..4].copy_from_slice(&[255, 255]);
        assert!(decode_layer(&BlockLayout::of(&wide, BlockId(0)), &bad, None).is_err());
    }
}

/// Stated errors that differ in every number; column 66 is the last of [`job`]. The golden file with column scales has them.
pub(crate) const STATED: StatedErrors = StatedErrors {
    lights: Some(LightErrors {
        prior: 0.5,
        all_on: 0.25,
        random: 0.125,
        single_mean: 2.0,
        single_worst: 3.0,
        worst_column: 66,
        noise_mean: 4.0,
        noise_worst: 5.0,
    }),
    denoising: Some(DenoiseErrors { noise_before: 1.5, noise_after: 0.75, bias: 0.0625 }),
    denoised_lights: Vec::new(),
    exposed: Some(ExposedError { asked: 0.75, reached: 0.5 }),
};

/// What a file says of a denoised light.
pub(crate) const DENOISED_LIGHT: DenoisedLight =
    DenoisedLight { errors: DenoiseErrors { noise_before: 2.5, noise_after: 0.375, bias: 0.03125 }, light_kept: 0.875 };

/// For each of the ten zones of the panel, and for the three lamps.
pub(crate) const BAND_STEPS: [i8; 13] = [8, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 5, -2];

pub(crate) fn formats(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats").join(name)
}

/// Base layers are a small part of their file, and already near the whole.
#[test]
fn the_beginning_of_a_file_is_a_whole_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let mut basis = LightBasis::new();
    basis.push(light("panel", LightKind::AreaTexels { across: 32, down: 32 })).unwrap();
    let job = Job { shape: MatrixShape::new(64, 64, 1024, 32).unwrap(), basis, provenance: Provenance::default() };
    let writer = ContainerWriter::create(&path, &job, ContainerOptions::default()).unwrap();
    for id in job.shape.blocks() {
        let mut factors = FactoredBlock { rows: 3072, columns: 1024, ..Default::default() };
        for k in 0..4 {
            let size = 0.3f32.powi(k);
            let wave = |i: usize, a: f32| (a * (i % 32) as f32 + 0.17 * ((i / 32) % 32) as f32 + id.0 as f32).sin();
            let noise = |i: usize| ((i * 7919 + k as usize * 104_729) % 1000) as f32 / 1000.0 - 0.5;
            factors.left.extend((0..3072).map(|i| size * (wave(i, 0.1 + 0.1 * k as f32) + 0.05 * noise(i))));
            factors.right.extend((0..1024).map(|i| wave(i, 0.2 - 0.03 * k as f32) + 0.05 * noise(i)));
            factors.left_step.push(0.02);
            factors.right_step.push(0.02);
        }
        writer.write_block(id, &factors, &report(id)).unwrap();
    }
    let summary = writer.finish().unwrap();
    // One component of four, its steps 2.2 times as large at the left and 8 times at the right. Rounded normal noise of deviation 0.0144
    // has 1.68 bits an entry at steps of 0.02, 0.68 at 0.044 and none at 0.16; at the left it is 0.3 as large in the next component
    // (0.16 bits) and none in those behind. So the base has 0.68 · 3072 of 1.68 · (3072 + 4 · 1024) + 0.16 · 3072 bits, a sixth, and waves
    // and headers are a hundredth of either.
    let (base, whole) = (summary.base_bytes, summary.file_bytes);
    assert!(6 * base < whole && whole < 8 * base, "{base} of {whole}");
    let reader = ContainerReader::open(&path).unwrap();
    for id in job.shape.blocks() {
        assert_eq!(reader.rank(id), 4, "refining adds no components");
        let (base, whole) = (reader.read_layers(id, 0..1).unwrap().expand(), reader.read_block(id).unwrap().expand());
        let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>();
        let pairs = base.entries().iter().zip(whole.entries());
        let relative = squares(&mut pairs.map(|(a, b)| a - b)) / squares(&mut whole.entries().iter().copied());
        // It has one component of four; the next one is 0.3 as large.
        assert!(relative.sqrt() < 0.35, "{id}: {}", relative.sqrt());
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
