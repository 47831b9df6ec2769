//! Farms: whatever the ranges, their order and their repeats, the merge gives the bytes of one machine; what cannot be merged is refused
//! by name, and what is missing is listed.

use std::fs;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use ltm::Error;
use ltm::blob_store::BlobStore;
use ltm::compress::{CompressSettings, Method, Target};
use ltm::farm::{FarmJob, Next, RefusedShard, Round, Shards, WorkFolders, find_unit, windows};
use ltm::pipeline::{self, PackOptions};
use ltm::resources::NoProgress;
use ltm::scene::{BuiltIn, LoadedScene};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A small room of fifteen blocks, those at the right and lower edge not full.
fn room(name: &str) -> LoadedScene {
    let mut loaded = BuiltIn { width: 72, height: 40, texels: 8 }.named(name).unwrap();
    loaded.settings.samples_per_pixel = 4;
    loaded.settings.block_side = 16;
    loaded
}

const BLOCKS: u32 = 15;

fn options(denoise: bool) -> PackOptions {
    PackOptions { denoise, ..PackOptions::default() }
}

fn job(name: &str, options: &PackOptions) -> FarmJob {
    FarmJob::new(room(name), options).unwrap()
}

fn depot(folder: &Path) -> BlobStore {
    BlobStore::open(folder.join("shards").to_str().unwrap()).unwrap()
}

fn build(name: &str, options: &PackOptions, range: Range<u32>, depot: &BlobStore) -> String {
    job(name, options).build(range, depot, None, &NoProgress).unwrap().name
}

fn shards(job: &FarmJob, depot: &BlobStore, folder: &Path) -> Shards {
    job.shards(depot, &folder.join("cache"), &NoProgress).unwrap()
}

fn merge(name: &str, options: &PackOptions, depot: &BlobStore, folder: &Path) -> Vec<u8> {
    let job = job(name, options);
    let shards = shards(&job, depot, folder);
    assert_eq!((&*shards.missing, &*shards.refused), (&[][..], &[][..]));
    let path = folder.join("merged.ltc");
    job.merge(shards, &path, &NoProgress).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::remove_file(path).unwrap();
    bytes
}

fn single(name: &str, options: &PackOptions, folder: &Path) -> Vec<u8> {
    let path = folder.join("single.ltc");
    pipeline::render_packed(room(name), &path, options, &NoProgress).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::remove_file(path).unwrap();
    bytes
}

#[test]
fn any_ranges_in_any_order_give_the_bytes_of_one_machine() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let slope = |target| CompressSettings { target, ..CompressSettings::default() };
    let cases = [
        ("mixed", options(true)),
        ("diffuse", options(true)),
        ("mixed", options(false)),
        ("environment", options(false)),
        ("diffuse", PackOptions { compress: slope(Target::Bytes(20_000)), ..options(false) }),
        ("diffuse", PackOptions { compress: CompressSettings::of_method(Method::BlockSvd), ..options(false) }),
    ];
    for (at, (name, options)) in cases.into_iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let expected = single(name, &options, folder.path());
        // Short ranges and long ones: both in the first case, in turn in the others.
        let mosts = if at == 0 { &[3, BLOCKS][..] } else { &[[3, BLOCKS][at % 2]] };
        for &most in mosts {
            let depot = BlobStore::open(folder.path().join(most.to_string()).to_str().unwrap()).unwrap();
            let mut ranges = Vec::new();
            let mut first = 0;
            while first < BLOCKS {
                let end = (first + random.random_range(1..=most)).min(BLOCKS);
                ranges.push(first..end);
                first = end;
            }
            // Some twice, and one over the edges of others.
            ranges.push(ranges[0].clone());
            ranges.push(3..9);
            ranges.shuffle(&mut random);
            ranges.iter().for_each(|range| drop(build(name, &options, range.clone(), &depot)));
            assert!(merge(name, &options, &depot, folder.path()) == expected, "{name}, up to {most} blocks");
        }
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left.len(), mosts.len(), "{left:?}");
    }
}

#[test]
fn a_range_that_is_there_is_found_and_has_one_name_from_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let (depot, options) = (depot(folder.path()), options(true));
    let fingerprint = job("mixed", &options).fingerprint();
    let find = |range, check| find_unit(&fingerprint, Round::Trace, &range, &depot, check).unwrap();
    assert_eq!(find(2..7, false), None, "the folder is not there yet");
    let name = build("mixed", &options, 2..7, &depot);
    assert_eq!(find(2..7, false), Some(name.clone()));
    assert_eq!(find(2..6, false), None);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| build("mixed", &options, 2..7, &depot)), name);
    assert_eq!(depot.names("").unwrap(), std::slice::from_ref(&name));
    // A look trusts the name; a check does not.
    let path = folder.path().join("shards").join(&name);
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, bytes).unwrap();
    assert_eq!(find(2..7, false), Some(name.clone()));
    assert_eq!(find(2..7, true), None);
    build("mixed", &options, 2..7, &depot);
    assert_eq!(find(2..7, true), Some(name));
}

#[test]
fn what_cannot_be_merged_is_refused_by_name_and_its_blocks_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (depot, packed) = (depot(folder.path()), options(false));
    let good = build("mixed", &packed, 0..5, &depot);
    let flipped = build("mixed", &packed, 5..8, &depot);
    let cut = build("mixed", &packed, 9..11, &depot);
    let renamed = build("mixed", &packed, 11..12, &depot);
    let other_job = build("diffuse", &packed, 8..9, &depot);
    let other_settings = build("mixed", &options(true), 8..9, &depot);
    let place = |name: &str| folder.path().join("shards").join(name);
    let mut bytes = fs::read(place(&flipped)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    fs::write(place(&flipped), bytes).unwrap();
    let bytes = fs::read(place(&cut)).unwrap();
    fs::write(place(&cut), &bytes[..bytes.len() - 3]).unwrap();
    let wrong = renamed.replace("00000011-00000012", "00000012-00000013");
    fs::rename(place(&renamed), place(&wrong)).unwrap();
    let mut bytes = fs::read(place(&good)).unwrap();
    bytes[7] = b'9';
    fs::write(place("newer.shard"), bytes).unwrap();
    fs::write(place("notes.shard"), "what a person wrote").unwrap();
    fs::write(place("readme.txt"), "is none of ours").unwrap();

    let job = job("mixed", &packed);
    let found = shards(&job, &depot, folder.path());
    let problem = |name: &str| {
        let of = |refused: &&RefusedShard| refused.name == name;
        found.refused.iter().find(of).unwrap_or_else(|| panic!("{name} is not refused")).problem.clone()
    };
    assert!(problem(&flipped).contains("changed"), "{}", problem(&flipped));
    assert!(problem(&cut).contains("length"), "{}", problem(&cut));
    assert!(problem(&wrong).contains("renamed"), "{}", problem(&wrong));
    assert!(problem(&other_job).contains("another job"), "{}", problem(&other_job));
    assert!(problem(&other_settings).contains("other settings"), "{}", problem(&other_settings));
    assert!(problem("newer.shard").contains("version 9"), "{}", problem("newer.shard"));
    assert!(problem("notes.shard").contains("cut short") || problem("notes.shard").contains("no shard"));
    assert_eq!((found.refused.len(), found.count), (7, 1));
    assert_eq!(found.missing, vec![5..BLOCKS]);
    let path = folder.path().join("room.ltc");
    let error = job.merge(found, &path, &NoProgress).unwrap_err();
    assert!(matches!(error, Error::Incomplete { .. }) && error.exit_code() == 8, "{error}");
    assert!(error.to_string().contains("10 of 15 blocks"), "{error}");
    assert!(!path.exists());

    // The rest is merged as soon as what is missing is there.
    build("mixed", &packed, 5..BLOCKS, &depot);
    let job = FarmJob::new(room("mixed"), &packed).unwrap();
    let found = shards(&job, &depot, folder.path());
    assert_eq!((found.refused.len(), found.missing.len()), (7, 0));
    job.merge(found, &path, &NoProgress).unwrap();
    assert!(fs::read(&path).unwrap() == single("mixed", &packed, folder.path()));
}

/// Every byte of a shard is held to its name, and none makes the reader panic.
#[test]
fn every_flipped_byte_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let (depot, packed) = (depot(folder.path()), options(true));
    let name = build("diffuse", &packed, 14..15, &depot);
    let path = folder.path().join("shards").join(&name);
    let bytes = fs::read(&path).unwrap();
    let job = job("diffuse", &packed);
    // All of the head, then some.
    let places = (0..256).chain((256..bytes.len()).step_by(bytes.len() / 100 + 1));
    for at in places {
        let mut changed = bytes.clone();
        changed[at] ^= 0x81;
        fs::write(&path, changed).unwrap();
        let found = shards(&job, &depot, folder.path());
        assert_eq!((found.refused.len(), found.count), (1, 0), "byte {at}");
    }
}

#[test]
fn what_no_farm_can_do_is_refused() {
    let global = CompressSettings {
        scope: ltm::compress::Scope::Global,
        method: Method::Algorithm4,
        ..CompressSettings::default()
    };
    let refused = FarmJob::new(room("mixed"), &PackOptions { compress: global, ..options(false) });
    assert!(matches!(refused, Err(Error::Input { .. })));
    let folder = tempfile::tempdir().unwrap();
    for range in [3..3, 10..16, 99..100] {
        let built = job("mixed", &options(true)).build(range, &depot(folder.path()), None, &NoProgress);
        assert!(matches!(built, Err(Error::Input { .. })));
    }
    assert!(matches!(BlobStore::open("gopher://here/there"), Err(Error::Input { .. })));
}

#[test]
fn a_probe_says_what_blocks_cost() {
    let probe = job("mixed", &options(true)).probe(&NoProgress).unwrap();
    assert_eq!(probe.blocks.iter().map(|probed| probed.block.0).collect::<Vec<_>>(), (0..BLOCKS).collect::<Vec<_>>());
    let folder = tempfile::tempdir().unwrap();
    let name = build("mixed", &options(true), 0..BLOCKS, &depot(folder.path()));
    let bytes: u64 = probe.blocks.iter().map(|probed| probed.bytes).sum();
    let whole = fs::metadata(folder.path().join("shards").join(name)).unwrap().len();
    // The head, 16 bytes for the place of the summary and of each of four records; in the summary the light of each block, and sums of
    // products of the images of clusters, and of these.
    let clusters = ltm::light::Clusters::of_basis(&job("mixed", &options(true)).job().basis).count() as u64;
    assert_eq!(
        whole,
        bytes + 128 + 16 * (1 + 4 * u64::from(BLOCKS)) + 8 * u64::from(BLOCKS) + 16 * (clusters + 1) * clusters
    );
    assert!(probe.blocks.iter().all(|probed| probed.seconds > 0.0));
}

/// A room that is several windows wide or high, in few samples.
fn long_room(width: u32, height: u32) -> LoadedScene {
    let mut loaded = BuiltIn { width, height, texels: 8 }.named("mixed").unwrap();
    loaded.settings.samples_per_pixel = 2;
    loaded.settings.block_side = 16;
    loaded
}

/// Ranges of a few blocks each.
fn ranges_of(blocks: u32, most: u32, random: &mut Pcg64Mcg) -> Vec<Range<u32>> {
    let (mut ranges, mut first) = (Vec::new(), 0);
    while first < blocks {
        let end = (first + random.random_range(1..=most)).min(blocks);
        ranges.push(first..end);
        first = end;
    }
    ranges
}

/// Does all rounds, in any order, with units that are lost and done again, and gives the container.
fn by_rounds(
    room: &dyn Fn() -> LoadedScene,
    options: &PackOptions,
    ranges: &[Range<u32>],
    folder: &Path,
    random: &mut Pcg64Mcg,
) -> Vec<u8> {
    let depot = Arc::new(BlobStore::open(folder.join("depot").to_str().unwrap()).unwrap());
    let keep = folder.join("keep");
    fs::create_dir_all(&keep).unwrap();
    let job = || FarmJob::new(room(), options).unwrap();
    let fingerprint = job().fingerprint();
    let mut seen = Vec::new();
    let coded = loop {
        let (round, mut units) = match job().next(ranges, &depot, false, &NoProgress).unwrap() {
            Next::Build { round, units, .. } => (round, units),
            Next::Merge(coded) => break coded,
        };
        let again = seen.last() == Some(&round);
        seen.push(round);
        units.shuffle(random);
        // The last is lost the first time, where there are several.
        if !again && units.len() > 1 {
            units.pop();
        }
        for number in units {
            let unit = job().units(round, ranges)[number].clone();
            let build = |keep: Option<&Path>| {
                let folders = WorkFolders { scratch: None, keep };
                job().build_unit(round, unit.clone(), &depot, folders, &NoProgress).unwrap().name
            };
            // What is kept of the analysis, or not, changes nothing.
            let name = build(Some(&*keep).filter(|_| random.random()));
            assert_eq!(find_unit(&fingerprint, round, &unit, &depot, true).unwrap(), Some(name.clone()));
            if random.random_range(0..4) == 0 {
                assert_eq!(build(None), name, "{round:?} {unit:?}");
            }
        }
    };
    seen.dedup();
    assert_eq!(seen, job().rounds());
    let path = folder.join("rounds.ltc");
    job().assemble(&coded, &depot, &path, &NoProgress).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::remove_file(path).unwrap();
    bytes
}

#[test]
fn rounds_give_the_bytes_of_one_machine() {
    let mut random = Pcg64Mcg::seed_from_u64(6);
    let slope = |target| CompressSettings { target, ..CompressSettings::default() };
    let of_bytes = |denoise| PackOptions { compress: slope(Target::Bytes(20_000)), ..options(denoise) };
    let cases = [
        ("mixed", options(true)),
        ("diffuse", of_bytes(true)),
        ("mixed", options(false)),
        ("diffuse", of_bytes(false)),
        ("diffuse", PackOptions { compress: CompressSettings::of_method(Method::BlockSvd), ..options(false) }),
    ];
    for (name, options) in cases {
        let folder = tempfile::tempdir().unwrap();
        let expected = single(name, &options, folder.path());
        let ranges = ranges_of(BLOCKS, 6, &mut random);
        let found = by_rounds(&|| room(name), &options, &ranges, folder.path(), &mut random);
        assert!(found == expected, "{name}, {options:?}");
    }
}

#[test]
fn windows_of_a_picture_that_are_denoised_apart_give_the_bytes_of_one_machine() {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    for (width, height) in [(544, 32), (32, 544)] {
        let folder = tempfile::tempdir().unwrap();
        let room = || long_room(width, height);
        let options = options(true);
        let path = folder.path().join("single.ltc");
        pipeline::render_packed(room(), &path, &options, &NoProgress).unwrap();
        let expected = fs::read(&path).unwrap();
        let shape = FarmJob::new(room(), &options).unwrap().job().shape;
        assert!(windows(shape).len() == 3 && shape.columns() > 32, "windows, and clusters of columns");
        let ranges = ranges_of(shape.block_count(), 40, &mut random);
        let found = by_rounds(&room, &options, &ranges, folder.path(), &mut random);
        assert!(found == expected, "{width} × {height}");
    }
}

#[test]
fn what_a_round_lacks_is_said_and_a_changed_shard_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (depot, options) = (Arc::new(depot(folder.path())), options(true));
    let ranges = [0..8, 8..BLOCKS];
    let job = || job("mixed", &options);
    let build = |round, unit: Range<u32>| job().build_unit(round, unit, &depot, WorkFolders::default(), &NoProgress);
    let next = |check| match job().next(&ranges, &depot, check, &NoProgress).unwrap() {
        Next::Build { round, units, of, damaged } => (round, units, of, damaged),
        Next::Merge(_) => panic!("nothing is coded"),
    };
    let early = build(Round::Clean, 0..BLOCKS).unwrap_err();
    assert!(matches!(early, Error::Incomplete { .. }) && early.to_string().contains("clean"), "{early}");
    build(Round::Trace, 0..8).unwrap();
    assert_eq!(next(false), (Round::Trace, vec![1], 2, Vec::new()));
    let shard = build(Round::Trace, 8..BLOCKS).unwrap().name;
    assert_eq!(next(false), (Round::Clean, vec![0], 1, Vec::new()));
    for unit in [0..BLOCKS + 1, 0..3, 4..4] {
        assert!(matches!(build(Round::Clean, unit), Err(Error::Input { .. })));
    }
    assert!(matches!(job().next(&[0..8, 9..BLOCKS], &depot, false, &NoProgress), Err(Error::Input { .. })));
    // A byte of what is read there.
    let path = folder.path().join("shards").join(&shard);
    let whole = fs::read(&path).unwrap();
    let mut bytes = whole.clone();
    bytes[whole.len() / 3] ^= 1;
    fs::write(&path, &bytes).unwrap();
    assert!(matches!(build(Round::Clean, 0..BLOCKS), Err(Error::Damaged { .. })));
    assert_eq!(next(true), (Round::Trace, vec![1], 2, vec![shard]));
    build(Round::Trace, 8..BLOCKS).unwrap();
    assert!(fs::read(&path).unwrap() == whole);
    assert_eq!(next(true).0, Round::Clean);
    build(Round::Clean, 0..BLOCKS).unwrap();
    assert_eq!(next(true), (Round::Analyse, vec![0, 1], 2, Vec::new()));
}
