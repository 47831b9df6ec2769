//! Seeded inputs for what `tools/fuzz` feeds without end: no input makes a reader panic, hang, or hold memory that it has
//! not earned. Needs no fuzzer and no nightly compiler.
//!
//! A run of the tests feeds each target a fixed number of inputs. `LTM_FUZZ_INPUTS` asks for another number, `LTM_FUZZ_SEED`
//! for others than last time, and an argument for one target:
//!
//! ```text
//! LTM_FUZZ_INPUTS=10000000 LTM_FUZZ_SEED=7 cargo test --release --test fuzz -- npy
//! ```
//!
//! An input that fails is left in the folder of temporary files, and its name printed.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Trial};
use ltm::container::codec::{CodecSettings, LayerPart, encode_layer};
use ltm::container::verify;
use ltm::matrix::{ColumnIndex, FactoredBlock, SparseEntry};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

#[path = "../tools/fuzz/inputs/files.rs"]
mod files;
#[path = "../tools/fuzz/inputs/limit.rs"]
mod limit;
#[path = "../tools/fuzz/inputs/ltc.rs"]
mod ltc;
#[path = "../tools/fuzz/inputs/ltc_file.rs"]
mod ltc_file;
#[path = "../tools/fuzz/inputs/ltm.rs"]
mod ltm_file;

#[global_allocator]
static ALLOCATOR: limit::Counted = limit::Counted;

const INPUTS: usize = 20_000;
/// Whole files take longer than single chunks.
const FILES: usize = 1_000;
/// Longest that an input of some kilobytes may take: readers that hang take for ever.
const LONGEST: Duration = Duration::from_secs(10);
/// What reading one of our own small files may hold.
const OWN_FILES: usize = 8 << 20;

fn main() -> ExitCode {
    let own = [
        ("ltm", no_changed_matrix_makes_its_reader_panic as fn()),
        ("ltc", no_changed_chunk_makes_its_decoder_panic),
        ("ltc_file", no_changed_container_makes_its_reader_panic),
    ];
    let own = own.map(|(name, test)| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    });
    let foreign = files::TARGETS.iter().map(|target| {
        Trial::test(target.name, move || {
            feed(target);
            Ok(())
        })
    });
    // One at a time: memory is counted for the whole process.
    let arguments = Arguments { test_threads: Some(1), ..Arguments::from_args() };
    libtest_mimic::run(&arguments, own.into_iter().chain(foreign).collect()).exit_code()
}

/// How many inputs each target gets, and from which seed on.
fn asked(usual: usize) -> (usize, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    (number("LTM_FUZZ_INPUTS").map_or(usual, |inputs| inputs as usize), number("LTM_FUZZ_SEED").unwrap_or(0))
}

/// Feeds a target its sound files and then changed ones.
fn feed(target: &files::Target) {
    // In memory where there is such a folder: millions of small files are written.
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.unwrap();
    let seeds = (target.seeds)();
    // What is made once and kept is made before memory is counted.
    for seed in &seeds {
        assert!((target.look)(seed, folder.path()), "{}: a sound file is refused", target.name);
    }
    let (inputs, seed) = asked(FILES);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut accepted = 0;
    for _ in 0..inputs {
        let input = changed(&seeds, &mut random);
        accepted += usize::from(fed(target.name, &input, || (target.look)(&input, folder.path())));
    }
    eprintln!("{}: {inputs} inputs, {accepted} accepted", target.name);
    // Neither past every check nor stopped by the first.
    assert!(inputs < 500 || (1..inputs).contains(&accepted), "{accepted} of {inputs} accepted");
}

/// Looks at an input; where that panics or takes long, leaves it on the disk.
fn fed<T>(target: &str, input: &[u8], look: impl FnOnce() -> T) -> T {
    let begun = Instant::now();
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(look));
    let took = begun.elapsed();
    match result {
        Ok(result) if took < LONGEST => result,
        other => {
            let path: PathBuf = std::env::temp_dir().join(format!("ltm-fuzz-{target}-{}", std::process::id()));
            std::fs::write(&path, input).unwrap();
            eprintln!("{target}: {} after {took:?}", path.display());
            match other {
                Ok(_) => panic!("an input took {took:?}"),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
    }
}

/// One of some sound files with a few changes: bytes, numbers of two, four and eight bytes, words, pieces taken out, doubled or
/// taken from elsewhere, an early end.
fn changed(seeds: &[Vec<u8>], random: &mut impl Rng) -> Vec<u8> {
    let mut input = seeds[random.random_range(0..seeds.len())].clone();
    for _ in 0..random.random_range(1..6) {
        if input.is_empty() {
            break;
        }
        // Half of the changes where headers are.
        let reach = if random.random() { input.len() } else { input.len().min(512) };
        let at = random.random_range(0..reach);
        let piece = at..(at + random.random_range(0..32)).min(input.len());
        match random.random_range(0..10) {
            0..4 => input[at] = some_byte(random),
            4 => {
                let width = [2, 4, 8][random.random_range(0..3)].min(input.len() - at);
                let number = NUMBERS[random.random_range(0..NUMBERS.len())].to_le_bytes();
                input[at..at + width].copy_from_slice(&number[..width]);
            }
            5 | 6 => {
                let word = files::WORDS[random.random_range(0..files::WORDS.len())];
                let end = (at + random.random_range(0..4)).min(input.len());
                drop(input.splice(at..end, word.bytes()));
            }
            7 => drop(input.drain(piece)),
            8 => {
                let piece = input[piece].to_vec();
                let to = random.random_range(0..=input.len());
                drop(input.splice(to..to, piece));
            }
            _ if random.random_range(0..4) == 0 => input.truncate(at),
            _ => input[at] ^= 1 << random.random_range(0..8),
        }
    }
    input
}

/// Numbers that lengths do not like.
const NUMBERS: [u64; 10] =
    [0, 1, 0x7fff, 0xffff, 0x1_0000, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7fff_ffff_ffff_ffff, u64::MAX];

/// Bytes that fields do not like.
const BYTES: [u8; 8] = [0, 1, 2, 3, 0x7f, 0x80, 0xfe, 0xff];

fn some_byte(random: &mut impl Rng) -> u8 {
    if random.random_range(0..3) == 0 { random.random() } else { BYTES[random.random_range(0..BYTES.len())] }
}

fn no_changed_matrix_makes_its_reader_panic() {
    let (inputs, seed) = asked(INPUTS);
    let mut random = Pcg64Mcg::seed_from_u64(1 + seed);
    let (mut opened, mut input) = (0, Vec::new());
    for _ in 0..inputs {
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
                let whole = ltm_file::SOUND[sound].len().min(usize::from(u16::MAX));
                let (start, length) = [(0, 88), (4096, 200), (ltm_file::TABLE, 64 * ltm_file::BLOCKS), (0, whole)]
                    [random.random_range(0..4)];
                let at = (start + random.random_range(0..length)) as u16;
                input.extend(at.to_le_bytes());
                input.push(some_byte(&mut random));
            }
        }
        opened += usize::from(fed("ltm", &input, || limit::within(OWN_FILES, || ltm_file::look(&input))));
    }
    eprintln!("ltm: {inputs} inputs, {opened} opened");
    // Neither past every check nor stopped by the first.
    assert!((inputs / 10..inputs * 9 / 10).contains(&opened), "{opened} of {inputs} opened");
}

fn no_changed_chunk_makes_its_decoder_panic() {
    let (inputs, seed) = asked(INPUTS);
    let mut random = Pcg64Mcg::seed_from_u64(2 + seed);
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
    let bands =
        layout.lights.planes().iter().map(|plane| if plane.is_image { 10 } else { plane.across }).sum::<usize>();
    let right_band_steps: Vec<i8> = (0..bands).map(|band| 9 - band as i8 % 12).collect();
    let finer = FactoredBlock { right_band_steps: right_band_steps.into(), ..block.clone() };
    let sound = [block, finer].map(|block| {
        let sound = encode_layer(layout, &block, LayerPart::default(), &CodecSettings::default()).unwrap();
        assert!(ltc::look(&sound));
        sound
    });
    let mut decoded = 0;
    for i in 0..inputs {
        let mut input = sound[i % 2].clone();
        for _ in 0..random.random_range(1..5) {
            let at = random.random_range(0..input.len());
            input[at] = some_byte(&mut random);
        }
        if random.random_range(0..8) == 0 {
            input.truncate(random.random_range(0..input.len()));
        }
        decoded += usize::from(fed("ltc", &input, || limit::within(OWN_FILES, || ltc::look(&input))));
    }
    eprintln!("ltc: {inputs} inputs, {decoded} decoded");
    assert!(decoded > inputs / 100 && decoded < inputs, "{decoded} of {inputs} decoded");
}

fn no_changed_container_makes_its_reader_panic() {
    let (inputs, seed) = asked(FILES);
    let mut random = Pcg64Mcg::seed_from_u64(3 + seed);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.ltc");
    let (mut opened, mut input) = (0, Vec::new());
    for (sound, file) in ltc_file::SOUND.iter().enumerate() {
        assert!(ltc_file::look(&[2 * sound as u8], &path));
        assert!(verify(&path).unwrap().faults.is_empty());
        assert!(file.len() < usize::from(u16::MAX));
    }
    for _ in 0..inputs {
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
        opened += usize::from(fed("ltc_file", &input, || limit::within(OWN_FILES, || ltc_file::look(&input, &path))));
    }
    eprintln!("ltc_file: {inputs} inputs, {opened} opened");
    // Neither past every check nor stopped by the first.
    assert!((inputs / 10..inputs * 9 / 10).contains(&opened), "{opened} of {inputs} opened");
}
