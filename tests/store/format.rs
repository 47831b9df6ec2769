//! The document, the golden files and the bad files say what the code does.

use std::fs;
use std::path::{Path, PathBuf};

use ltm::Error;
use ltm::light::Job;
use ltm::matrix::{BlockId, BlockSink, BlockSource, Feature};
use ltm::store::{
    HEADER_FIELDS, MAGIC, PAGE_BYTES, Precision, RECORD_BYTES, RECORD_FIELDS, StoreOptions, StoreReader, StoreWriter,
    VERSION, merge, verify,
};

use crate::blocks::{block, job, options, read, write_all};

fn formats() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats")
}

/// Rows of the table that follows a mark in the document, cut into cells.
fn table_after(mark: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(formats().join("ltm.md")).unwrap();
    let rest = text.split_once(mark).unwrap_or_else(|| panic!("no '{mark}' in ltm.md")).1;
    let lines = rest.lines().skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|'));
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().replace('`', "")).collect();
    lines.skip(2).map(cells).collect()
}

#[test]
fn the_field_tables_of_the_document_are_those_of_the_code() {
    for (mark, fields) in [("<!-- fields: header -->", HEADER_FIELDS), ("<!-- fields: record -->", RECORD_FIELDS)] {
        let written: Vec<_> = table_after(mark)
            .into_iter()
            .map(|row| (row[0].clone(), row[1].parse().unwrap(), row[2].parse().unwrap()))
            .collect();
        let coded: Vec<(String, usize, usize)> =
            fields.iter().map(|&(name, offset, size)| (name.to_owned(), offset, size)).collect();
        assert_eq!(written, coded, "{mark}");
    }
}

#[test]
fn the_numbers_of_the_document_are_those_of_the_code() {
    let header = table_after("<!-- fields: header -->");
    let cell = |name: &str, column: usize| header.iter().find(|row| row[0] == name).unwrap()[column].clone();
    let magic: Vec<u8> = cell("magic", 3).split(' ').map(|hex| u8::from_str_radix(hex, 16).unwrap()).collect();
    assert_eq!(magic, MAGIC);
    assert_eq!(cell("version", 4), format!("1 to {VERSION}"));
    for precision in Precision::ALL {
        assert!(cell("precision", 3).contains(&format!("{}: {precision}", precision.code())));
    }
    let parts = table_after("## The whole");
    assert_eq!(parts[0][2], PAGE_BYTES.to_string());
    assert!(parts[2][2].starts_with(&format!("{RECORD_BYTES} for each block")));
    let versions = table_after("## Promise");
    assert_eq!(versions.last().unwrap()[0], VERSION.to_string());
    use ltm::matrix::MatrixShape;
    assert_eq!(cell("width", 4), format!("1 to {}", MatrixShape::MAX_IMAGE_SIDE));
    assert_eq!(cell("columns", 4), format!("1 to {}", MatrixShape::MAX_COLUMNS));
    assert!(cell("block_side", 4).starts_with(&format!("1 to {};", MatrixShape::MAX_BLOCK_SIDE)));
}

/// Constants that are on disks. They never change; a new meaning takes a new version.
#[test]
fn never_change_these() {
    assert_eq!(MAGIC, [0x89, b'L', b'T', b'M', 13, 10, 26, 10]);
    assert_eq!((PAGE_BYTES, RECORD_BYTES), (4096, 64));
    assert_eq!(Precision::ALL.map(|precision| precision.code()), [0, 1, 2]);
    use ltm::store::{COMMITTED, NOISE_NONE, NOISE_STORED, NOISE_ZERO, PLANES_STORED};
    assert_eq!((COMMITTED, NOISE_NONE, NOISE_STORED, NOISE_ZERO, PLANES_STORED), (1, 0, 1, 2, 1));
}

/// The golden file of version 2, whose planes do not know materials: it is read, and no longer written.
const WITHOUT_MATERIAL: &str = "golden/v2-f16.ltm";

/// A golden file: its name, how it is stored, and whether it has column scales. Planes are the same in all precisions.
struct Golden {
    name: &'static str,
    options: StoreOptions,
    has_scales: bool,
}

impl Golden {
    /// The golden files of a version, but for that of version 2.
    fn of_version(version: u32) -> Vec<Self> {
        let of = |name, precision, planes| {
            let options = StoreOptions { precision, planes, ..options() };
            Self { name, options, has_scales: false }
        };
        match version {
            1 => vec![
                of("v1-f32", Precision::F32, false),
                of("v1-f16", Precision::F16, false),
                of("v1-bf16", Precision::Bf16, false),
            ],
            3 => vec![of("v3-f16", Precision::F16, true)],
            4 => vec![
                of("v4-f32", Precision::F32, false),
                of("v4-f16", Precision::F16, false),
                of("v4-bf16", Precision::Bf16, false),
                of("v4-f16-planes", Precision::F16, true),
                Self { has_scales: true, ..of("v4-f16-column-scales", Precision::F16, true) },
                of("v4-f16-later-section", Precision::F16, true),
            ],
            VERSION => vec![
                of("v5-f32", Precision::F32, false),
                of("v5-f16", Precision::F16, false),
                of("v5-bf16", Precision::Bf16, false),
                of("v5-f16-planes", Precision::F16, true),
                Self { has_scales: true, ..of("v5-f16-column-scales", Precision::F16, true) },
                of(LATER_SECTION, Precision::F16, true),
            ],
            other => panic!("version {other}"),
        }
    }

    fn path(&self) -> PathBuf {
        formats().join("golden").join(self.name).with_extension("ltm")
    }

    fn job(&self) -> Job {
        let mut job = job(3);
        if self.has_scales {
            job.basis.set_column_scales(vec![0.25; 3]).unwrap();
            job.basis.set_scene_weights(0, vec![[1.0, 2.0, 3.0], [0.5; 3], [0.0; 3]]).unwrap();
        }
        job
    }

    fn write(&self, path: &Path) {
        let job = self.job();
        let writer = StoreWriter::create(path, &job, self.options).unwrap();
        write_all(&job, &writer);
        writer.finish().unwrap();
    }
}

/// The golden file that has a section of a program later than this: a reader passes over it.
const LATER_SECTION: &str = "v5-f16-later-section";

/// The golden file that the bad ones are made from.
fn sound_file(name: &str) -> Vec<u8> {
    fs::read(formats().join("golden").join(name).with_extension("ltm")).unwrap()
}

/// The file with another job description: of another length, with all that follows from it.
fn with_job(file: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let length = u64::from_le_bytes(file[48..56].try_into().unwrap()) as usize;
    let mut job = file[4096..4096 + length].to_vec();
    change(&mut job);
    assert!(job.len() <= TABLE - 4096);
    let mut bytes = file.to_vec();
    bytes[4096..TABLE].fill(0);
    bytes[4096..4096 + job.len()].copy_from_slice(&job);
    let checksum = crc32fast::hash(&bytes[4096..TABLE]);
    set_header(&mut bytes, "job_bytes", &(job.len() as u64).to_le_bytes());
    set_header(&mut bytes, "job_checksum", &checksum.to_le_bytes());
    bytes
}

#[test]
fn golden_files_are_read_and_those_of_this_version_are_what_would_be_written_now() {
    let folder = tempfile::tempdir().unwrap();
    for golden in [1, 3, 4, VERSION].into_iter().flat_map(Golden::of_version) {
        let (path, name, precision) = (golden.path(), golden.name, golden.options.precision);
        assert!(verify(&path, |_, _| true).unwrap().is_complete(), "{name}");
        let reader = StoreReader::open(&path).unwrap();
        assert_eq!((reader.precision(), reader.job()), (precision, &golden.job()), "{name}");
        for id in reader.shape().blocks() {
            let (stored, mut original) = (read(&reader, id).unwrap(), block(&golden.job(), id));
            if let Some(planes) = original.planes.as_mut().filter(|_| !name.starts_with("v5")) {
                planes.pixel_albedo_of_samples();
            }
            assert_eq!(stored.planes, original.planes.filter(|_| golden.options.planes), "{name}");
            for (stored, original) in stored.block.entries().iter().zip(original.block.entries()) {
                assert!(
                    f64::from((stored - original).abs())
                        <= precision.relative_error() * f64::from(*original) + 2f64.powi(-39)
                );
            }
        }
        if name.starts_with(&format!("v{VERSION}-")) && name != LATER_SECTION {
            let now = folder.path().join("now.ltm");
            golden.write(&now);
            assert!(fs::read(&now).unwrap() == fs::read(&path).unwrap(), "{name}: a change needs a new version");
            fs::remove_file(now).unwrap();
        }
    }
}

/// Blocks of an earlier version and of this one are joined where both have the same planes: here, none.
#[test]
fn blocks_of_files_of_earlier_versions_and_of_this_one_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let (half, whole) = (folder.path().join("half.ltm"), folder.path().join("whole.ltm"));
    let golden = Golden::of_version(4).remove(1);
    let writer = StoreWriter::create(&half, &golden.job(), golden.options).unwrap();
    for id in golden.job().shape.blocks().take(3) {
        writer.write_block(id, &block(&golden.job(), id)).unwrap();
    }
    writer.finish().unwrap();
    for inputs in [[half.clone(), golden.path()], [golden.path(), half]] {
        let report = merge(&inputs, &whole, |_, _| true).unwrap();
        assert_eq!((report.copied, report.missing.len()), (6, 0));
        // What is written anew is of this version, but for a continued output.
        assert!(fs::read(&whole).unwrap() == sound_file("v5-f16"));
        fs::remove_file(&whole).unwrap();
    }
    // Planes of an earlier version have no place in a file of this one.
    let golden = Golden::of_version(3).remove(0);
    let refused = merge(&[golden.path()], &whole, |_, _| true).unwrap_err();
    assert!(refused.to_string().contains("earlier version of the format"), "{refused}");
    // Noise and planes of divided columns are no others' noise and planes.
    let scaled = folder.path().join("scaled.ltm");
    let mut job = golden.job();
    job.basis.set_column_scales(vec![0.25; 3]).unwrap();
    let writer = StoreWriter::create(&scaled, &job, golden.options).unwrap();
    write_all(&job, &writer);
    writer.finish().unwrap();
    assert!(merge(&[golden.path(), scaled], &whole, |_, _| true).is_err());
}

#[test]
fn the_sections_of_the_document_are_those_of_a_file() {
    let file = sound_file("v5-f16-column-scales");
    let length = u64::from_le_bytes(file[48..56].try_into().unwrap()) as usize;
    let (mut rest, mut tags) = (&file[4096..4096 + length], Vec::new());
    while !rest.is_empty() {
        tags.push(String::from_utf8(rest[..4].to_vec()).unwrap());
        rest = &rest[8 + u32::from_le_bytes(rest[4..8].try_into().unwrap()) as usize..];
    }
    let documented: Vec<_> = table_after("<!-- fields: sections -->").into_iter().map(|row| row[0].clone()).collect();
    assert_eq!(tags, documented);
}

#[test]
fn a_file_of_version_2_is_read_and_its_materials_are_not_known() {
    let path = formats().join(WITHOUT_MATERIAL);
    assert!(verify(&path, |_, _| true).unwrap().is_complete());
    let reader = StoreReader::open(&path).unwrap();
    assert_eq!(reader.job(), &job(3));
    for id in reader.shape().blocks() {
        let (stored, mut original) = (read(&reader, id).unwrap(), block(&job(3), id));
        if let Some(planes) = &mut original.planes {
            planes.pixel_albedo_of_samples();
            let material = Feature::Material.planes();
            let material = material.start * planes.pixels()..material.end * planes.pixels();
            planes.features[material.clone()].fill(0.0);
            planes.feature_variance[material].fill(0.0);
        }
        assert_eq!(stored.planes, original.planes);
    }
}

/// What becomes of a bad file.
#[derive(Debug, PartialEq)]
enum Fate {
    /// Cannot be opened, with this in the message.
    Refused(&'static str),
    /// Opens; these blocks are bad, with this in the message, and all others can be read.
    Blocks(&'static [u32], &'static str),
}
use Fate::{Blocks, Refused};

type Change = fn(&mut Vec<u8>);

/// Sets bytes of the header and makes its checksum hold.
fn set_header(bytes: &mut [u8], name: &str, value: &[u8]) {
    let offset = HEADER_FIELDS.iter().find(|field| field.0 == name).unwrap().1;
    bytes[offset..offset + value.len()].copy_from_slice(value);
    let checksum = crc32fast::hash(&bytes[12..4096]);
    bytes[8..12].copy_from_slice(&checksum.to_le_bytes());
}

/// Sets bytes of block 0's record and makes its checksum hold.
fn set_record(bytes: &mut [u8], name: &str, value: &[u8]) {
    let offset = RECORD_FIELDS.iter().find(|field| field.0 == name).unwrap().1;
    let record = &mut bytes[TABLE..TABLE + 64];
    record[offset..offset + value.len()].copy_from_slice(value);
    let checksum = crc32fast::hash(&record[4..]);
    record[..4].copy_from_slice(&checksum.to_le_bytes());
}

/// Changes the side data of block 0 and makes all checksums hold.
fn set_side(bytes: &mut [u8], change: impl FnOnce(&mut [u8])) {
    let number = |at: usize| u64::from_le_bytes(bytes[TABLE + at..TABLE + at + 8].try_into().unwrap()) as usize;
    let (start, end) = (number(16) + COLUMNS_OF_BLOCK_0, number(16) + number(24));
    change(&mut bytes[start..end]);
    let checksum = crc32fast::hash(&bytes[start..end]);
    set_record(bytes, "side_checksum", &checksum.to_le_bytes());
}

/// Changes the job description and makes its checksum and the header's hold.
fn set_job(bytes: &mut [u8], change: impl FnOnce(&mut [u8])) {
    change(&mut bytes[4096..TABLE]);
    let checksum = crc32fast::hash(&bytes[4096..TABLE]);
    set_header(bytes, "job_checksum", &checksum.to_le_bytes());
}

/// Offsets in the golden f16 file.
const TABLE: usize = 8192;
const SLOTS: usize = 12_288;
/// Three columns and two probes of 192 rows in 2 bytes.
const COLUMNS_OF_BLOCK_0: usize = 5 * 192 * 2;
/// Features and variances of 64 pixels, light of three clusters: the planes without their emitters.
const PLANES_OF_BLOCK_0: usize = 64 * 66 + 192 * 3 * 8;
/// Emitters in view in block 0, see `blocks.rs`.
const SEEN_IN_BLOCK_0: usize = 4;

/// Every bad file: its name, how it is made from a golden f16 file, and what must become of it.
const BAD: &[(&str, Change, Fate)] = &[
    ("ltm-empty", |b| b.clear(), Refused("is not an .ltm file")),
    ("ltm-not-ours", |b| *b = b"P6 2 2 255 not a matrix".to_vec(), Refused("is not an .ltm file")),
    ("ltm-text-transfer", |b| b.splice(4..6, [b'\n']).for_each(drop), Refused("is not an .ltm file")),
    ("ltm-newer-version", |b| set_header(b, "version", &255u32.to_le_bytes()), Refused("format version 255")),
    ("ltm-header-flipped", |b| b[25] ^= 1, Refused("header's checksum")),
    ("ltm-header-cut", |b| b.truncate(100), Refused("cut short inside the header")),
    ("ltm-precision-unknown", |b| set_header(b, "precision", &3u32.to_le_bytes()), Refused("unknown precision")),
    ("ltm-probes-absurd", |b| set_header(b, "max_probes", &u32::MAX.to_le_bytes()), Refused("out of range")),
    ("ltm-width-zero", |b| set_header(b, "width", &0u32.to_le_bytes()), Refused("image width")),
    ("ltm-columns-absurd", |b| set_header(b, "columns", &u32::MAX.to_le_bytes()), Refused("number of columns")),
    ("ltm-clusters-in-version-1", |b| set_header(b, "clusters", &3u32.to_le_bytes()), Refused("out of range")),
    ("ltm-job-absurd", |b| set_header(b, "job_bytes", &u64::MAX.to_le_bytes()), Refused("its columns take")),
    ("ltm-table-elsewhere", |b| set_header(b, "table_offset", &0u64.to_le_bytes()), Refused("offsets do not fit")),
    ("ltm-job-flipped", |b| b[4100] ^= 1, Refused("job description's checksum")),
    (
        "ltm-job-lights-absurd",
        |b| set_job(b, |job| job[4..9].copy_from_slice(&[252, 255, 255, 255, 127])),
        Refused("does not decode"),
    ),
    ("ltm-job-other-shape", |b| set_job(b, |job| job[0] = 21), Refused("differ in shape")),
    (
        "ltm-job-trailing",
        |b| {
            let longer = u64::from_le_bytes(b[48..56].try_into().unwrap()) + 1;
            set_header(b, "job_bytes", &longer.to_le_bytes());
        },
        Refused("trailing"),
    ),
    ("ltm-cut-before-slots", |b| b.truncate(SLOTS - 1), Refused("cut short before its blocks")),
    ("ltm-cut-in-block-4", |b| b.truncate(SLOTS + 4 * 4096 + 100), Blocks(&[4, 5], "cut off")),
    ("ltm-record-flipped", |b| b[TABLE + 30] ^= 1, Blocks(&[0], "commit record's checksum")),
    ("ltm-record-elsewhere", |b| set_record(b, "offset", &20_480u64.to_le_bytes()), Blocks(&[0], "out of range")),
    ("ltm-record-of-another", |b| b.copy_within(TABLE..TABLE + 64, TABLE + 128), Blocks(&[2], "out of range")),
    ("ltm-record-length", |b| set_record(b, "length", &u64::MAX.to_le_bytes()), Blocks(&[0], "out of range")),
    ("ltm-side-flipped", |b| b[SLOTS + COLUMNS_OF_BLOCK_0 + 9] ^= 1, Blocks(&[0], "side data's checksum")),
    ("ltm-side-contradicts", |b| set_side(b, |side| side[0] = 3), Blocks(&[0], "contradicts")),
    (
        "ltm-scale-not-a-number",
        |b| {
            set_side(b, |side| side[24..28].copy_from_slice(&f32::NAN.to_le_bytes()));
        },
        Blocks(&[0], "scale is out of range"),
    ),
    ("ltm-column-flipped", |b| b[SLOTS + 400] ^= 1, Blocks(&[0], "checksum of column 1")),
    ("ltm-probe-flipped", |b| b[SLOTS + 4 * 384] ^= 1, Blocks(&[0], "checksum of noise probe 1")),
    ("ltm-planes-no-clusters", |b| set_header(b, "clusters", &0u32.to_le_bytes()), Refused("out of range")),
    ("ltm-planes-other-clusters", |b| set_planes_clusters(b, 2), Refused("differ in clusters")),
    ("ltm-planes-flipped", |b| set_planes(b, |planes| planes[7] ^= 1, false), Blocks(&[0], "checksum of its planes")),
    (
        "ltm-planes-pixel-absurd",
        |b| set_planes(b, |planes| seen(planes)[..4].copy_from_slice(&64u32.to_le_bytes()), true),
        Blocks(&[0], "emitters in view"),
    ),
    (
        "ltm-planes-column-absurd",
        |b| set_planes(b, |planes| seen(planes)[4..8].copy_from_slice(&3u32.to_le_bytes()), true),
        Blocks(&[0], "emitters in view"),
    ),
    (
        "ltm-planes-out-of-order",
        |b| set_planes(b, |planes| seen(planes)[..4].copy_from_slice(&63u32.to_le_bytes()), true),
        Blocks(&[0], "emitters in view"),
    ),
    ("ltm-planes-emitters-absurd", |b| set_record(b, "seen", &u32::MAX.to_le_bytes()), Blocks(&[0], "out of range")),
    ("ltm-planes-unknown", |b| set_record(b, "planes", &2u32.to_le_bytes()), Blocks(&[0], "out of range")),
    ("ltm-section-cut-short", |b| *b = with_job(b, |job| job.extend(b"newx\x04")), Refused("a section is cut short")),
    (
        "ltm-section-length-lies",
        |b| *b = with_job(b, |job| job[4..8].fill(255)),
        Refused("section 'Desc' claims 4294967295 bytes"),
    ),
    (
        "ltm-section-unknown-required",
        |b| *b = with_job(b, |job| job.extend(b"Newx\x04\0\0\0what")),
        Refused("section 'Newx' is unknown"),
    ),
    (
        "ltm-section-twice",
        |b| *b = with_job(b, |job| job.extend_from_within(..)),
        Refused("section 'Desc' stands twice"),
    ),
    (
        "ltm-section-trailing",
        |b| {
            *b = with_job(b, |job| {
                job[4] += 1;
                job.push(0);
            });
        },
        Refused("1 trailing bytes"),
    ),
    ("ltm-section-missing", |b| *b = with_job(b, |job| job[0] = b'd'), Refused("job description is missing")),
];

/// The golden file that a bad one is made from.
fn made_from(name: &str) -> &'static str {
    match name {
        _ if name.starts_with("ltm-planes") => "v3-f16",
        _ if name.starts_with("ltm-section") => "v5-f16",
        _ => "v1-f16",
    }
}

/// Changes the planes of block 0, and makes their checksum hold if wanted.
fn set_planes(bytes: &mut [u8], change: impl FnOnce(&mut [u8]), sound: bool) {
    let field = |name: &str| TABLE + RECORD_FIELDS.iter().find(|field| field.0 == name).unwrap().1;
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let end = number(field("offset")) + number(field("length"));
    let start = end - (PLANES_OF_BLOCK_0 + SEEN_IN_BLOCK_0 * 20);
    change(&mut bytes[start..end]);
    if sound {
        let checksum = crc32fast::hash(&bytes[start..end]);
        set_record(bytes, "planes_checksum", &checksum.to_le_bytes());
    }
}

/// The list of emitters in the planes of block 0.
fn seen(planes: &mut [u8]) -> &mut [u8] {
    &mut planes[PLANES_OF_BLOCK_0..]
}

/// Changes the number of clusters, and whatever of the header follows from it.
fn set_planes_clusters(bytes: &mut [u8], clusters: u32) {
    set_header(bytes, "clusters", &clusters.to_le_bytes());
    // Pixels of the six blocks, whose slots have room for three columns, two probes, noise, and planes.
    let slot = |pixels: u64| {
        let (rows, clusters) = (3 * pixels, u64::from(clusters));
        let tile = (rows * 5 * 2).next_multiple_of(8) + 4 + 5 * 8 + (rows + 3) * 4;
        (tile + (pixels * 66 + rows * clusters * 8).next_multiple_of(4) + pixels * 3 * 20).next_multiple_of(4096)
    };
    let length = SLOTS as u64 + [64, 64, 32, 24, 24, 12].map(slot).iter().sum::<u64>();
    set_header(bytes, "file_bytes", &length.to_le_bytes());
}

/// Makes the golden files of a new version (those that are there are never rewritten), then the bad files.
#[test]
#[ignore = "writes into formats/: run by hand when the version goes up, or for a new bad file"]
fn make_golden_and_bad_files() {
    for golden in Golden::of_version(VERSION) {
        let path = golden.path();
        match (path.exists(), golden.name) {
            (true, _) => {}
            (false, LATER_SECTION) => {
                let later = |job: &mut Vec<u8>| job.extend(b"newx\x04\0\0\0what");
                fs::write(path, with_job(&sound_file("v5-f16-planes"), later)).unwrap();
            }
            (false, _) => golden.write(&path),
        }
    }
    for (name, change, _) in BAD {
        let mut bytes = sound_file(made_from(name));
        change(&mut bytes);
        fs::write(formats().join("bad").join(name).with_extension("ltm"), bytes).unwrap();
    }
}

#[test]
fn every_bad_file_is_refused_for_its_own_fault() {
    for (name, change, fate) in BAD {
        let path = formats().join("bad").join(name).with_extension("ltm");
        let mut made = sound_file(made_from(name));
        change(&mut made);
        assert!(fs::read(&path).unwrap() == made, "{name} is not what its case says");
        match (StoreReader::open(&path), fate) {
            (Err(error), Refused(part)) => {
                let message = error.to_string();
                assert!(message.contains(part) && message.contains(name), "{name}: {message}");
            }
            (Ok(reader), Blocks(bad, part)) => {
                for id in reader.shape().blocks() {
                    match read(&reader, id) {
                        Ok(_) => assert!(!bad.contains(&id.0), "{name}: {id} is not refused"),
                        Err(Error::Damaged { problem, .. }) => {
                            assert!(bad.contains(&id.0) && problem.contains(part), "{name}: {problem}");
                        }
                        Err(other) => panic!("{name}: {other}"),
                    }
                }
                let report = verify(&path, |_, _| true).unwrap();
                let listed: Vec<_> = report.damaged.iter().map(|damage| damage.block).collect();
                assert_eq!(listed, bad.iter().map(|&id| BlockId(id)).collect::<Vec<_>>(), "{name}");
            }
            (opened, fate) => {
                panic!("{name}: {fate:?}, but {}", opened.err().map_or("it opens".into(), |e| e.to_string()))
            }
        }
    }
}

#[test]
fn every_bad_file_has_a_case() {
    for entry in fs::read_dir(formats().join("bad")).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if stem.starts_with("ltm-") {
            assert!(BAD.iter().any(|(name, ..)| *name == stem), "{stem}");
        }
    }
}
