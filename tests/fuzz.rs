//! A fixed number of seeded inputs for what `tools/fuzz` feeds without end: no input makes a reader panic or allocate
//! what the bytes have not earned. Needs no fuzzer and no nightly compiler.

use ltm::container::codec::{CodecSettings, LayerPart, encode_layer};
use ltm::container::verify;
use ltm::matrix::{ColumnIndex, FactoredBlock, SparseEntry};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

#[path = "../tools/fuzz/inputs/ltc.rs"]
mod ltc;
#[path = "../tools/fuzz/inputs/ltc_file.rs"]
mod ltc_file;
#[path = "../tools/fuzz/inputs/ltm.rs"]
mod ltm_file;

const INPUTS: usize = 20_000;
/// Whole containers take longer than single chunks.
const CONTAINERS: usize = 2_000;

/// Bytes that fields do not like.
const BYTES: [u8; 8] = [0, 1, 2, 3, 0x7f, 0x80, 0xfe, 0xff];

fn some_byte(random: &mut impl Rng) -> u8 {
    if random.random_range(0..3) == 0 { random.random() } else { BYTES[random.random_range(0..BYTES.len())] }
}

#[test]
fn no_changed_matrix_makes_its_reader_panic() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let (mut opened, mut input) = (0, Vec::new());
    for _ in 0..INPUTS {
        input.clear();
        let sound = random.random_range(0..ltm_file::SOUND.len());
        if random.random_range(0..8) == 0 {
            // The file itself, cut, or with bytes put in or left out.
            input.push(1);
            input.extend_from_slice(ltm_file::SOUND[sound]);
            let at = random.random_range(1..input.len());
            match random.random_range(0..3) {
                0 => input.truncate(at),
                1 => drop(input.splice(at..at, [0; 64])),
                _ => drop(input.drain(at..(at + 64).min(input.len()))),
            }
        } else {
            input.push(2 * sound as u8);
            for _ in 0..random.random_range(1..5) {
                // Mostly where the fields are: header, description, records, side data.
                let (start, length) = [(0, 88), (4096, 200), (ltm_file::TABLE, 64 * ltm_file::BLOCKS), (0, 45_056)]
                    [random.random_range(0..4)];
                let at = (start + random.random_range(0..length)) as u16;
                input.extend(at.to_le_bytes());
                input.push(some_byte(&mut random));
            }
        }
        opened += usize::from(ltm_file::look(&input));
    }
    // Neither past every check nor stopped by the first.
    assert!((INPUTS / 10..INPUTS * 9 / 10).contains(&opened), "{opened} of {INPUTS} opened");
}

#[test]
fn no_changed_chunk_makes_its_decoder_panic() {
    let mut random = Pcg64Mcg::seed_from_u64(2);
    let layout = &*ltc::LAYOUT;
    let (rows, columns) = (layout.rows(), layout.columns());
    let mut wave = |count: usize| -> Vec<f32> {
        let step = random.random::<f32>();
        (0..count).map(|i| (i as f32 * step).sin()).collect()
    };
    let block = FactoredBlock {
        rows,
        columns,
        left: wave(3 * rows),
        right: wave(3 * columns),
        sparse: (0..9u32).map(|i| SparseEntry { column: ColumnIndex(i), row: 7 * i, value: 1.0 + i as f32 }).collect(),
        ..FactoredBlock::default()
    };
    let sound = encode_layer(layout, &block, LayerPart::default(), &CodecSettings::default()).unwrap();
    assert!(ltc::look(&sound));
    let mut decoded = 0;
    for _ in 0..INPUTS {
        let mut input = sound.clone();
        for _ in 0..random.random_range(1..5) {
            let at = random.random_range(0..input.len());
            input[at] = some_byte(&mut random);
        }
        if random.random_range(0..8) == 0 {
            input.truncate(random.random_range(0..input.len()));
        }
        decoded += usize::from(ltc::look(&input));
    }
    assert!(decoded > INPUTS / 100 && decoded < INPUTS, "{decoded} of {INPUTS} decoded");
}

#[test]
fn no_changed_container_makes_its_reader_panic() {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.ltc");
    let (mut opened, mut input) = (0, Vec::new());
    for (sound, file) in ltc_file::SOUND.iter().enumerate() {
        assert!(ltc_file::look(&[2 * sound as u8], &path));
        assert!(verify(&path).unwrap().faults.is_empty());
        assert!(file.len() < usize::from(u16::MAX));
    }
    for _ in 0..CONTAINERS {
        input.clear();
        let sound = random.random_range(0..ltc_file::SOUND.len());
        let file = &ltc_file::SOUND[sound];
        if random.random_range(0..8) == 0 {
            // The file itself, cut, or with bytes put in or left out.
            input.push(1);
            input.extend_from_slice(file);
            let at = random.random_range(1..input.len());
            match random.random_range(0..3) {
                0 => input.truncate(at),
                1 => drop(input.splice(at..at, [0; 64])),
                _ => drop(input.drain(at..(at + 64).min(input.len()))),
            }
        } else {
            input.push(2 * sound as u8);
            let [metadata, blocks, layers] = ltc_file::parts(file);
            let trailer = file.len() - ltc_file::ENDS;
            for _ in 0..random.random_range(1..4) {
                // Chunks, metadata, both kinds of records, trailer.
                let places =
                    [ltc_file::ENDS..metadata, metadata..blocks, blocks..layers, layers..trailer, trailer..file.len()];
                let weighed = [0, 0, 0, 1, 1, 2, 2, 3, 4][random.random_range(0..9)];
                let at = random.random_range(places[weighed].clone()) as u16;
                input.extend(at.to_le_bytes());
                input.push(some_byte(&mut random));
            }
        }
        opened += usize::from(ltc_file::look(&input, &path));
    }
    // Neither past every check nor stopped by the first.
    assert!((CONTAINERS / 10..CONTAINERS * 9 / 10).contains(&opened), "{opened} of {CONTAINERS} opened");
}
