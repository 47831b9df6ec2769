//! Behaviour of the container from outside.

#[path = "container/units.rs"]
mod units;

use std::path::{Path, PathBuf};

use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, ContainerOptions, ContainerReader, ContainerWriter, merge, verify};
use ltm::light::{
    DenoiseErrors, ExposedError, Job, Light, LightBasis, LightErrors, LightKind, LightUnit, Provenance, StatedErrors,
};
use ltm::matrix::BlockReport;
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

fn pack(path: &Path, job: &Job, ids: impl Iterator<Item = BlockId>, partial: bool) {
    pack_finer(path, job, ids, partial, &[]);
}

/// With bands of right sides so much finer.
fn pack_finer(path: &Path, job: &Job, ids: impl Iterator<Item = BlockId>, partial: bool, band_steps: &[i8]) {
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
fn small_job() -> Job {
    Job { shape: MatrixShape::new(16, 8, 67, 16).unwrap(), ..job() }
}

fn small_file(path: &Path) -> Vec<u8> {
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
    let finer = FactoredBlock { right_band_steps: FINENESS.into(), ..even.clone() };
    for factors in [even, finer] {
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

/// For each of the ten zones of the panel, and for the three lamps.
const FINENESS: [i8; 13] = [8, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 5, -2];

fn formats(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats").join(name)
}

/// The golden files, with the codings of their base layers and of their refinements.
const GOLDEN: [(&str, u8, u8); 4] = [("v1", 1, 1), ("v1-coding-2", 1, 2), ("v1-coding-3", 3, 3), ("v1-coding-4", 4, 4)];

#[test]
fn the_golden_file_of_each_version_and_coding_is_read_as_it_was_written() {
    for (name, base, coding) in GOLDEN {
        let path = formats(&format!("golden/{name}.ltc"));
        assert_eq!(verify(&path).unwrap().faults, [], "{name}");
        let reader = ContainerReader::open(&path).unwrap();
        let job = job();
        assert_eq!(reader.job(), &job, "{name}");
        let mut refined = 0;
        for id in job.shape.blocks() {
            let (read, wrote) = (reader.read_block(id).unwrap().expand(), block(&job, id).expand());
            let error: f32 = read.entries().iter().zip(wrote.entries()).map(|(a, b)| (a - b).powi(2)).sum();
            let norm: f32 = wrote.entries().iter().map(|b| b * b).sum();
            // The file keeps what a 16-bit float keeps.
            assert!(error.sqrt() <= 2e-3 * norm.sqrt(), "{name}, {id}");
            assert_eq!(reader.block_report(id), report(id), "{name}");
            for layer in 0..reader.layer_count(id) {
                let wanted = if layer == 0 { base } else { coding };
                assert_eq!(reader.stored_layer(id, layer).unwrap()[0], wanted, "{name}, {id}, layer {layer}");
                refined += usize::from(layer > 0);
            }
        }
        assert!(refined >= 2, "{name}");
    }
    let documented = std::fs::read_to_string(formats("ltc.md")).unwrap();
    for (name, _, coding) in GOLDEN {
        let row = documented.lines().find(|line| line.contains(&format!("`golden/{name}.ltc`")));
        assert!(row.is_some_and(|row| row.starts_with(&format!("| 1 | {coding} |"))), "{name}: {row:?}");
    }
}

#[test]
fn every_bad_file_is_refused_for_what_is_wrong_with_it() {
    let cases = [
        ("cut-short", "cut short"),
        ("not-ours", "is not a container"),
        ("newer-version", "format version 2"),
        ("bad-index", "checksum of metadata and index"),
        ("tail-lies", "do not fill the end"),
        ("metadata-bomb", "claims more than its bytes can hold"),
        ("bad-header", "header"),
        ("bad-chunk", "block 0"),
        ("rank-lies", "claims rank"),
        ("gap", "one after the other"),
        ("newer-coding", "coded in an unknown way (255)"),
    ];
    for (name, wanted) in cases {
        let path = formats(&format!("bad/ltc-{name}.ltc"));
        let found = match verify(&path) {
            Ok(found) => found.faults.first().map_or(String::new(), |fault| format!("header {}", fault.problem)),
            Err(error) => error.to_string(),
        };
        assert!(found.contains(wanted), "{name}: {found}");
    }
    let files = std::fs::read_dir(formats("bad")).unwrap();
    let ours = files.filter(|f| f.as_ref().unwrap().file_name().to_string_lossy().starts_with("ltc-")).count();
    assert_eq!(ours, cases.len(), "a bad file without a case");
}

/// Makes the golden file and the bad files where they do not exist yet.
#[test]
#[ignore = "makes files that are never rewritten"]
fn make_golden_and_bad_files() {
    let golden = formats("golden/v1-coding-4.ltc");
    if !golden.exists() {
        let job = job();
        pack_finer(&golden, &job, job.shape.blocks(), false, &FINENESS);
    }
    let folder = tempfile::tempdir().unwrap();
    let good = small_file(&folder.path().join("a.ltc"));
    let end = good.len() - 64;
    let at = |offset: usize| u32::from_le_bytes(good[end + offset..end + offset + 4].try_into().unwrap()) as usize;
    let metadata = at(24);
    let records = metadata + at(20);
    let write = |name: &str, bytes: &[u8]| {
        let path = formats(&format!("bad/ltc-{name}.ltc"));
        if !path.exists() {
            std::fs::write(path, bytes).unwrap();
        }
    };
    let seal = |bytes: &mut Vec<u8>| {
        let crc = crc32fast::hash(&bytes[metadata..end]);
        bytes[end + 40..end + 44].copy_from_slice(&crc.to_le_bytes());
        let crc = crc32fast::hash(&bytes[end..end + 60]);
        bytes[end + 60..].copy_from_slice(&crc.to_le_bytes());
    };
    let changed = |at: usize, value: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    write("cut-short", &good[..good.len() * 2 / 3]);
    write("not-ours", &[b'x'; 300]);
    let mut newer = changed(8, &[2]);
    newer[end + 8] = 2;
    write("newer-version", &newer);
    write("bad-index", &changed(records + 8, &[99]));
    let mut tail = changed(end + 12, &[2]);
    seal(&mut tail);
    write("tail-lies", &tail);
    let mut bomb = changed(metadata, &[255, 255, 255, 63]);
    seal(&mut bomb);
    write("metadata-bomb", &bomb);
    write("bad-header", &changed(20, &[1]));
    write("bad-chunk", &changed(90, &[0x55, 0xaa]));
    let layer = records + 32;
    for (name, at, value) in [("rank-lies", 64 + 2, 255), ("newer-coding", 64, 255)] {
        let mut chunk = changed(at, &[value]);
        let bytes = u32::from_le_bytes(good[layer + 8..layer + 12].try_into().unwrap()) as usize;
        let crc = crc32fast::hash(&chunk[64..64 + bytes]);
        chunk[layer + 12..layer + 16].copy_from_slice(&crc.to_le_bytes());
        seal(&mut chunk);
        write(name, &chunk);
    }
    let mut gap = changed(layer, &[65]);
    seal(&mut gap);
    write("gap", &gap);
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

/// The fields of a table of `formats/ltc.md` under `### heading`, with their types.
fn document_fields(heading: &str) -> Vec<(String, String)> {
    let text = std::fs::read_to_string(formats("ltc.md")).unwrap();
    let section = text.split(&format!("\n### {heading}\n")).nth(1).unwrap().split("\n#").next().unwrap();
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows = section.lines().filter(|line| line.starts_with("| ")).skip(1).map(cells);
    rows.map(|cells| (cells[1].clone(), cells[2].clone())).collect()
}

/// A value as the document's types write it.
enum Value {
    Integer(u64),
    Text(&'static str),
    Floats(Vec<f32>),
    List(usize, Vec<u8>),
    Raw(Vec<u8>),
}

fn integer(value: u64) -> Vec<u8> {
    match value {
        0..251 => vec![value as u8],
        251..0x1_0000 => [&[251], &(value as u16).to_le_bytes()[..]].concat(),
        0x1_0000..0x1_0000_0000 => [&[252], &(value as u32).to_le_bytes()[..]].concat(),
        _ => [&[253], &value.to_le_bytes()[..]].concat(),
    }
}

/// Bytes of a table's fields in its order, each checked to have the stated type.
fn written_as_documented(heading: &str, values: &[(&str, Value)]) -> Vec<u8> {
    let fields = document_fields(heading);
    assert_eq!(fields.len(), values.len(), "{heading}");
    let bytes = fields.iter().zip(values).map(|((field, kind), (name, value))| {
        assert_eq!(field, name, "{heading}");
        let (word, bytes) = match value {
            Value::Integer(value) => ("integer", integer(*value)),
            Value::Text(text) => ("text", [integer(text.len() as u64), text.as_bytes().to_vec()].concat()),
            Value::Floats(floats) => ("float", floats.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Value::List(length, items) => ("list", [integer(*length as u64), items.clone()].concat()),
            Value::Raw(bytes) => ("", bytes.clone()),
        };
        assert!(kind.contains(word), "{heading}, {field}: {kind} is no {word}");
        bytes
    });
    bytes.collect::<Vec<_>>().concat()
}

/// The metadata of a container without their compression, and how many of those bytes are the job.
fn metadata_of(path: &Path) -> (Vec<u8>, usize) {
    let file = std::fs::read(path).unwrap();
    let number = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let (metadata, end) = (number(file.len() - 40), file.len() - 64);
    let (job_bytes, report_bytes) = (number(metadata), number(metadata + 4));
    let frame = &file[metadata + 12..metadata + number(end + 20)];
    let plain = match number(metadata + 8) {
        1 => zstd::bulk::decompress(frame, job_bytes + report_bytes).unwrap(),
        _ => frame.to_vec(),
    };
    (plain, job_bytes)
}

/// The job of the test below, with one light, as the document has it.
fn documented_job(panel: &Light) -> Vec<u8> {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let light = written_as_documented(
        "Light",
        &[
            ("name", Value::Text("panel")),
            ("kind", Value::Raw(vec![1, 20, 15])),
            ("unit", Value::Raw(vec![2])),
            ("emission", Value::Floats(vec![1.0, 2.0, 3.0])),
            ("first column", Value::Integer(0)),
            ("places", Value::List(300, floats(panel.places.as_flattened()))),
            ("extents", Value::List(300, floats(&panel.extents))),
        ],
    );
    written_as_documented(
        "Job",
        &[
            ("width", Value::Integer(300)),
            ("height", Value::Integer(200)),
            ("columns", Value::Integer(300)),
            ("block side", Value::Integer(256)),
            ("lights", Value::List(1, light)),
            ("source", Value::Text("room")),
            ("content", Value::Raw(vec![9; 32])),
            ("program", Value::Text("p")),
            ("samples per pixel", Value::Integer(70_000)),
            ("seed", Value::Integer(1 << 40)),
            ("settings", Value::Text("s")),
            ("metres per unit", Value::Floats(vec![0.5])),
            ("scene weights", Value::List(1, [integer(0), integer(300), floats(&[0.25; 900])].concat())),
            ("column scales", Value::List(300, floats(&[1e-6; 300]))),
        ],
    )
}

#[test]
fn the_metadata_is_written_as_the_document_says() {
    let mut basis = LightBasis::new();
    let mut panel = light("panel", LightKind::AreaTexels { across: 20, down: 15 });
    panel.unit = LightUnit::Irradiance;
    panel.emission = [1.0, 2.0, 3.0];
    basis.push(panel.clone()).unwrap();
    basis.set_scene_weights(0, vec![[0.25; 3]; 300]).unwrap();
    basis.set_column_scales(vec![1e-6; 300]).unwrap();
    let provenance = Provenance {
        source: "room".into(),
        content: [9; 32],
        program: "p".into(),
        samples_per_pixel: 70_000,
        seed: 1 << 40,
        settings: "s".into(),
        metres_per_unit: 0.5,
    };
    let job = Job { shape: MatrixShape::new(300, 200, 300, 256).unwrap(), basis, provenance };
    let report = ltm::container::ContainerReport {
        program: "a".into(),
        method: "b".into(),
        target: "c".into(),
        prior: "d".into(),
        settings: "e".into(),
        provenance: vec![("f".into(), "g".into())],
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let options = ContainerOptions { report, partial: true, ..Default::default() };
    let errors = LightErrors {
        prior: 0.5,
        all_on: 0.25,
        random: 0.125,
        single_mean: 2.0,
        single_worst: 3.0,
        worst_column: 290,
        noise_mean: 4.0,
        noise_worst: 5.0,
    };
    let mut writer = ContainerWriter::create(&path, &job, options).unwrap();
    let cleaning = DenoiseErrors { noise_before: 1.5, noise_after: 0.75, bias: 0.0625 };
    let exposed = ExposedError { asked: 0.75, reached: 0.5 };
    let stated = StatedErrors { lights: Some(errors), cleaning: Some(cleaning), exposed: Some(exposed) };
    writer.state_errors(stated);
    writer.finish().unwrap();
    assert_eq!(*ContainerReader::open(&path).unwrap().errors(), stated);
    let (plain, job_bytes) = metadata_of(&path);
    assert_eq!(plain[..job_bytes], documented_job(&panel));
    let report = written_as_documented(
        "Report",
        &[
            ("program", Value::Text("a")),
            ("method", Value::Text("b")),
            ("target", Value::Text("c")),
            ("prior", Value::Text("d")),
            ("settings", Value::Text("e")),
            ("provenance", Value::List(1, vec![1, b'f', 1, b'g'])),
        ],
    );
    let errors = written_as_documented(
        "Light errors",
        &[
            ("prior", Value::Floats(vec![0.5])),
            ("all on", Value::Floats(vec![0.25])),
            ("random", Value::Floats(vec![0.125])),
            ("single mean", Value::Floats(vec![2.0])),
            ("single worst", Value::Floats(vec![3.0])),
            ("worst column", Value::Integer(290)),
            ("noise mean", Value::Floats(vec![4.0])),
            ("noise worst", Value::Floats(vec![5.0])),
        ],
    );
    let cleaning = written_as_documented(
        "Cleaning errors",
        &[
            ("noise before", Value::Floats(vec![1.5])),
            ("noise after", Value::Floats(vec![0.75])),
            ("bias", Value::Floats(vec![0.0625])),
        ],
    );
    let exposed = written_as_documented(
        "Exposed error",
        &[("asked", Value::Floats(vec![0.75])), ("reached", Value::Floats(vec![0.5]))],
    );
    assert_eq!(plain[job_bytes..], [report, errors, cleaning, exposed].concat());
    // Every kind and unit has its name in the document, in order.
    let kinds = &document_fields("Light")[1].1;
    assert_eq!(kinds.split(", ").filter(|part| !part.starts_with("down)")).count(), 9, "{kinds}");
}

/// The start of a chunk, as the document's table has it.
#[test]
fn a_chunk_begins_as_the_document_says() {
    let text = std::fs::read_to_string(formats("ltc.md")).unwrap();
    let section = text.split("\n## Chunk\n").nth(1).unwrap().split("\n#").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| ")).skip(1);
    let rows: Vec<Vec<&str>> = rows.map(|line| line.split('|').map(str::trim).collect()).collect();
    let layout = BlockLayout::of(&small_job(), BlockId(0));
    let factors = FactoredBlock {
        sparse: (0..200).map(|i| SparseEntry { column: ColumnIndex(i % 67), row: i, value: i as f32 + 1.0 }).collect(),
        ..block(&job(), BlockId(3))
    };
    let mut sorted = factors.sparse.clone();
    sorted.sort_by_key(|entry| (entry.column, entry.row));
    let factors = FactoredBlock { sparse: sorted, ..factors };
    let part = LayerPart { shared: 2, ..Default::default() };
    let bytes = encode_layer(&layout, &factors, part, &CodecSettings::default()).unwrap();
    let (mut at, mut read) = (0, Vec::new());
    for row in &rows {
        let mut value = 0usize;
        match row[2] {
            "byte" => {
                value = usize::from(bytes[at]);
                at += 1;
            }
            "number" => {
                for shift in (0..).step_by(7) {
                    value |= usize::from(bytes[at] & 127) << shift;
                    at += 1;
                    if bytes[at - 1] < 128 {
                        break;
                    }
                }
            }
            other => panic!("{other}"),
        }
        read.push((row[1], value));
    }
    let names: Vec<_> = read.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["coding", "shared", "rank", "sparse entries", "side", "low bits"]);
    let values: Vec<_> = read.iter().map(|(_, value)| *value).collect();
    assert_eq!(values[..4], [3, 2, 4, 200]);
    // Twice the bytes of the side stream, and whether the coefficients have 8 states of 4 bytes or one.
    let (side, states) = (values[4] / 2, [1, 8][values[4] % 2]);
    assert!(side > 100 && at + side + values[5] + 4 * states <= bytes.len());
}
