//! Golden files are read as they were written, bad files are refused for what is wrong with them.

use std::path::Path;

use ltm::container::{ContainerOptions, ContainerReader, ContainerWriter, verify};
use ltm::light::{Job, StatedErrors};
use ltm::matrix::{FactorSource, FactoredBlock};

use super::{BAND_STEPS, DENOISED_LIGHT, STATED, block, formats, job, pack_finer, report, small_file};

/// The golden files: version, coding of their base layers, and of their refinements.
const GOLDEN: [(&str, u32, u8, u8); 9] = [
    ("v1", 1, 1, 1),
    ("v1-coding-2", 1, 1, 2),
    ("v1-coding-3", 1, 3, 3),
    ("v1-coding-4", 1, 4, 4),
    ("v2", 2, 4, 4),
    ("v2-column-scales", 2, 4, 4),
    ("v2-coding-5", 2, 5, 5),
    ("v2-denoised-lights", 2, 5, 5),
    ("v2-later-section", 2, 4, 4),
];

/// The job with scales of its columns and weights of its scene.
fn scaled_job() -> Job {
    let mut job = job();
    job.basis.set_column_scales([vec![2.0; 64], vec![0.5, 1.0, 0.25]].concat()).unwrap();
    job.basis.set_scene_weights(0, (0..64).map(|i| [i as f32, 1.0, 0.5]).collect()).unwrap();
    job
}

/// The job of a golden file, and what it says of errors.
fn said_of(name: &str) -> (Job, StatedErrors) {
    match name {
        "v2-column-scales" => (scaled_job(), STATED),
        "v2-denoised-lights" => {
            let denoised_lights = vec![DENOISED_LIGHT; job().basis.lights().len()];
            (job(), StatedErrors { denoised_lights, ..STATED })
        }
        _ => (job(), StatedErrors::default()),
    }
}

#[test]
fn the_golden_file_of_each_version_and_coding_is_read_as_it_was_written() {
    for (name, version, base, coding) in GOLDEN {
        let path = formats(&format!("golden/{name}.ltc"));
        assert_eq!(verify(&path).unwrap().faults, [], "{name}");
        assert_eq!(std::fs::read(&path).unwrap()[8..12], version.to_le_bytes(), "{name}");
        let reader = ContainerReader::open(&path).unwrap();
        let (job, errors) = said_of(name);
        assert_eq!((reader.job(), reader.errors()), (&job, &errors), "{name}");
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
    for (name, version, _, coding) in GOLDEN {
        let row = documented.lines().find(|line| line.contains(&format!("`golden/{name}.ltc`")));
        assert!(row.is_some_and(|row| row.starts_with(&format!("| {version} | {coding} |"))), "{name}: {row:?}");
    }
}

#[test]
fn the_golden_files_of_this_version_are_what_would_be_written_now() {
    let folder = tempfile::tempdir().unwrap();
    let now = folder.path().join("now.ltc");
    for name in ["v2", "v2-column-scales", "v2-coding-5", "v2-denoised-lights"] {
        write_golden(&now, name);
        let same = std::fs::read(&now).unwrap() == std::fs::read(formats(&format!("golden/{name}.ltc"))).unwrap();
        assert!(same, "{name}: a change needs a new version");
        std::fs::remove_file(&now).unwrap();
    }
}

fn write_golden(path: &Path, name: &str) {
    let (job, errors) = said_of(name);
    let by_eye = matches!(name, "v2-coding-5" | "v2-denoised-lights");
    if errors == StatedErrors::default() && !by_eye {
        return pack_finer(path, &job, job.shape.blocks(), false, &BAND_STEPS);
    }
    let mut writer = ContainerWriter::create(path, &job, ContainerOptions::default()).unwrap();
    for id in job.shape.blocks() {
        let factors = FactoredBlock { right_band_steps: BAND_STEPS.into(), by_eye, ..block(&job, id) };
        writer.write_block(id, &factors, &report(id)).unwrap();
    }
    writer.state_errors(errors);
    writer.finish().unwrap();
}

/// A container of version 2 with other sections, which are laid open; all lengths and checksums hold.
fn with_sections(file: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let number = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let end = file.len() - 64;
    let metadata = number(end + 24);
    let records = metadata + number(end + 20);
    let mut sections = match number(metadata + 4) {
        1 => zstd::bulk::decompress(&file[metadata + 8..records], number(metadata)).unwrap(),
        _ => file[metadata + 8..records].to_vec(),
    };
    change(&mut sections);
    let length = (sections.len() as u32).to_le_bytes();
    let tail = [&length[..], &[0; 4], &sections, &file[records..end]].concat();
    let mut trailer = file[end..].to_vec();
    trailer[20..24].copy_from_slice(&(sections.len() as u32 + 8).to_le_bytes());
    trailer[32..40].copy_from_slice(&((metadata + tail.len() + 64) as u64).to_le_bytes());
    trailer[40..44].copy_from_slice(&crc32fast::hash(&tail).to_le_bytes());
    let crc = crc32fast::hash(&trailer[..60]);
    trailer[60..].copy_from_slice(&crc.to_le_bytes());
    [&file[..metadata], &tail, &trailer].concat()
}

/// Where a section begins and ends.
fn section(sections: &[u8], tag: &[u8; 4]) -> std::ops::Range<usize> {
    let mut at = 0;
    loop {
        let length = u32::from_le_bytes(sections[at + 4..at + 8].try_into().unwrap()) as usize;
        if sections[at..at + 4] == *tag {
            return at..at + 8 + length;
        }
        at += 8 + length;
    }
}

type Change = fn(&mut Vec<u8>);

/// The bad files of sections, and how they are made from a sound one.
const BAD_SECTIONS: [(&str, Change); 6] = [
    ("section-cut-short", |sections| sections.truncate(section(sections, b"rprt").start + 5)),
    ("section-length-lies", |sections| {
        let length = section(sections, b"rprt").start + 4;
        sections[length..length + 4].fill(255);
    }),
    ("section-unknown-required", |sections| sections.extend(b"Newx\x04\0\0\0what")),
    ("section-twice", |sections| sections.extend_from_within(section(sections, b"rprt"))),
    ("section-trailing", |sections| {
        let length = section(sections, b"rprt").start + 4;
        sections[length] += 1;
        sections.push(0);
    }),
    ("section-missing", |sections| drop(sections.drain(section(sections, b"Desc")))),
];

#[test]
fn every_bad_file_is_refused_for_what_is_wrong_with_it() {
    let cases = [
        ("cut-short", "cut short"),
        ("not-ours", "is not a container"),
        ("newer-version", "format version 255"),
        ("bad-index", "checksum of metadata and index"),
        ("tail-lies", "do not fill the end"),
        ("metadata-bomb", "claims more than its bytes can hold"),
        ("bad-header", "header"),
        ("bad-chunk", "block 0"),
        ("rank-lies", "claims rank"),
        ("gap", "one after the other"),
        ("newer-coding", "coded in an unknown way (255)"),
        ("sections-bomb", "claims more than its bytes can hold"),
        ("section-cut-short", "a section is cut short"),
        ("section-length-lies", "claims 4294967295 bytes"),
        ("section-unknown-required", "'Newx' is unknown"),
        ("section-twice", "'rprt' stands twice"),
        ("section-trailing", "has 1 trailing bytes"),
        ("section-missing", "job description is missing"),
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

/// Makes the golden files and the bad files where they do not exist yet. Some bad ones are of version 1; those are no longer made.
#[test]
#[ignore = "makes files that are never rewritten"]
fn make_golden_and_bad_files() {
    for name in ["v2", "v2-column-scales", "v2-coding-5"] {
        let golden = formats(&format!("golden/{name}.ltc"));
        if !golden.exists() {
            write_golden(&golden, name);
        }
    }
    let later = formats("golden/v2-later-section.ltc");
    if !later.exists() {
        let file = std::fs::read(formats("golden/v2.ltc")).unwrap();
        std::fs::write(later, with_sections(&file, |sections| sections.extend(b"newx\x04\0\0\0what"))).unwrap();
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
    let mut newer = changed(8, &[255]);
    newer[end + 8] = 255;
    write("newer-version", &newer);
    write("bad-index", &changed(records + 8, &[99]));
    let mut tail = changed(end + 12, &[2]);
    seal(&mut tail);
    write("tail-lies", &tail);
    let mut bomb = changed(metadata, &[255, 255, 255, 63]);
    seal(&mut bomb);
    write("sections-bomb", &bomb);
    for (name, change) in BAD_SECTIONS {
        write(name, &with_sections(&good, change));
    }
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
