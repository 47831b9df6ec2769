//! The store against the disk: writing and reading, against plain `pwrite` and `pread` of the same bytes in the same
//! run, with the error of each precision.
//!
//! `LTM_BENCH_RENDER=16` (samples per pixel) renders the built-in room with and without a store instead, in turns;
//! `LTM_BENCH_ROUNDS` says how often.
//!
//! `LTM_BENCH_STREAM=f32` (or `f16`, `bf16`) does one file alone instead, as large as asked for: written, verified and
//! read by two threads, with the peak of resident memory. `LTM_BENCH_DENSITY` is the share of columns that are not zero.
//!
//! `cargo bench --bench store`; `LTM_BENCH_BLOCKS` sets the number of blocks (of 3,072 rows; 64 where unset),
//! `LTM_BENCH_COLUMNS` their columns (1,024, so 12 MiB in f32), `LTM_BENCH_FOLDER` the disk. Criterion repeats short work many times; a disk wants long runs,
//! few of them and taken in turns, so this is a program of its own. It prints the best of `ROUNDS`.

mod figures;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use figures::Figures;
use ltm::container::ContainerOptions;
use ltm::light::{Job, Light, LightBasis, LightKind, Lighting, Provenance};
use ltm::matrix::{BlockId, BlockNoise, BlockSink, BlockSource, MatrixShape, TracedBlock};
use ltm::pipeline::{PackOptions, RenderOptions};
use ltm::resources::NoProgress;
use ltm::store::{FileStorage, Precision, Storage, StoreOptions, StoreReader, StoreWriter, requirements, verify};
use ltm::trace::{TraceSettings, Tracer};

/// What it is run by.
const COMMAND: &str = "cargo bench --bench store";
const ROUNDS: usize = 3;
/// Rounds of rendering with and without a store.
const RENDER_ROUNDS: usize = 15;

fn main() {
    let blocks = std::env::var("LTM_BENCH_BLOCKS").ok().and_then(|n| n.parse().ok()).unwrap_or(64u32);
    let parent = std::env::var_os("LTM_BENCH_FOLDER").unwrap_or_else(|| std::env::temp_dir().into());
    let folder = tempfile::tempdir_in(parent).unwrap();
    let columns = std::env::var("LTM_BENCH_COLUMNS").ok().and_then(|n| n.parse().ok()).unwrap_or(1024u32);
    let job = job(blocks, columns);
    let mut traced = block(&job);
    if let Ok(precision) = std::env::var("LTM_BENCH_STREAM") {
        return stream(folder.path(), &job, &mut traced, precision.parse().unwrap());
    }
    if let Some(samples) = std::env::var("LTM_BENCH_RENDER").ok().and_then(|n| n.parse().ok()) {
        return render(folder.path(), samples);
    }
    let (rows, columns) = (traced.block.rows(), traced.block.columns());
    let raw = job.shape.raw_bytes();
    eprintln!(
        "{blocks} blocks of {rows} rows × {columns} columns, {:.2} GiB in f32\n",
        raw as f64 / (1u64 << 30) as f64
    );
    let variables = ["LTM_BENCH_BLOCKS", "LTM_BENCH_COLUMNS", "LTM_BENCH_FOLDER"];
    let mut figures = Figures::new("bench-store", &variables, COMMAND);
    writing(folder.path(), &job, &traced, &mut figures);
    eprintln!(
        "\nreading                                  cold GB/s   warm GB/s   error (largest, relative to the entry)"
    );
    let plain = plain_file(folder.path());
    let mut plain_rates = Vec::new();
    for (name, threads) in [("pread", 1), ("pread, two threads", 2)] {
        let read = |cold| {
            best(
                || rate(raw, || read_plain(&plain, blocks, threads)),
                || {
                    if cold {
                        evict(&plain)
                    }
                },
            )
        };
        let (cold, warm) = (read(true), read(false));
        eprintln!("  {name:<36} {cold:>9.2}   {warm:>9.2}");
        plain_rates.push((cold, warm));
    }
    for write in WRITES.iter().filter(|write| write.threads == 1 && write.reserve) {
        let path = folder.path().join(write.name);
        let error = largest_error(&path, &traced);
        figures.add(write.name, "largest_relative_error", f64::from(error));
        let stored = open(&path).tally().unwrap().stored_bytes;
        for threads in [1, 2] {
            for (how, work) in READS {
                let read = |cold| {
                    let once = || match how {
                        Read::Positioned => {
                            each_block(&Positioned(StoreReader::open_positioned(&path).unwrap()), threads, work);
                        }
                        Read::Mapped => each_block(&open(&path), threads, work),
                    };
                    best(
                        || rate(stored, once),
                        || {
                            if cold {
                                evict(&path)
                            }
                        },
                    )
                };
                let name = format!("store, {}, {work:?}, {how:?}, {threads}", write.name);
                let (cold, warm) = (read(true), read(false));
                eprintln!("  {name:<36} {cold:>9.2}   {warm:>9.2}   {error:.1e}");
                let (plain_cold, plain_warm) = plain_rates[threads as usize - 1];
                figures.add(&name, "cold_over_plain", cold / plain_cold);
                figures.add(&name, "warm_over_plain", warm / plain_warm);
            }
        }
        jobs(folder.path(), &job, &path, stored);
    }
    figures.write();
}

/// What is written plainly, and read again.
fn plain_file(folder: &Path) -> PathBuf {
    folder.join("plain")
}

/// Writing, against the best of the plain ways.
fn writing(folder: &Path, job: &Job, traced: &TracedBlock, figures: &mut Figures) {
    let (blocks, raw, plain) = (job.shape.block_count(), job.shape.raw_bytes(), plain_file(folder));
    eprintln!("writing                                       stored      GB/s stored   of the best pwrite");
    const PLAIN: [(&str, usize, bool); 3] = [
        ("pwrite of blocks, one fsync", 12 << 20, false),
        ("pwrite of 1 MiB, one fsync", 1 << 20, false),
        ("pwrite of 1 MiB, fdatasync per block", 1 << 20, true),
    ];
    let mut rates = vec![0.0f64; PLAIN.len() + WRITES.len()];
    for _ in 0..ROUNDS {
        for (i, &(_, at_once, sync_each)) in PLAIN.iter().enumerate() {
            let _ = std::fs::remove_file(&plain);
            rates[i] = rates[i].max(rate(raw, || write_plain(&plain, blocks, traced, at_once, sync_each)));
        }
        for (i, write) in WRITES.iter().enumerate() {
            let path = folder.join(write.name);
            let _ = std::fs::remove_file(&path);
            let mut stored = 0;
            let seconds = timed(|| stored = write_store(&path, job, traced, write));
            let i = PLAIN.len() + i;
            rates[i] = rates[i].max(stored as f64 / seconds / 1e9);
        }
    }
    let best_plain = rates[..PLAIN.len()].iter().copied().fold(0.0, f64::max);
    for ((name, ..), rate) in PLAIN.iter().zip(&rates) {
        eprintln!("  {name:<37} {raw:>12}   {rate:>8.2}      {:.2}", rate / best_plain);
    }
    for (write, rate) in WRITES.iter().zip(&rates[PLAIN.len()..]) {
        let stored = open(&folder.join(write.name)).tally().unwrap().stored_bytes;
        eprintln!("  store, {:<30} {:>12}   {rate:>8.2}      {:.2}", write.name, stored, rate / best_plain);
        figures.add(write.name, "written_over_plain", rate / best_plain);
    }
}

/// How a block comes to who works on it.
#[derive(Clone, Copy, Debug)]
enum Read {
    /// Read into a block of the worker's own.
    Positioned,
    /// Borrowed from the map.
    Mapped,
}

/// What is done with a block once it is there.
#[derive(Clone, Copy, Debug)]
enum Work {
    Nothing,
    Columns,
}

const READS: [(Read, Work); 4] = [
    (Read::Positioned, Work::Nothing),
    (Read::Mapped, Work::Nothing),
    (Read::Positioned, Work::Columns),
    (Read::Mapped, Work::Columns),
];

/// A store that gives its blocks in no other way than by reading them: what there was before maps.
struct Positioned(StoreReader<FileStorage>);

impl BlockSource for Positioned {
    fn shape(&self) -> MatrixShape {
        self.0.shape()
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> ltm::Result<()> {
        self.0.read_block(id, target)
    }
}

/// Warm: raw relighting under one lighting and under eight, and packing, in turns.
fn jobs(folder: &Path, job: &Job, path: &Path, stored: u64) {
    let (positioned, mapped) = (Positioned(StoreReader::open_positioned(path).unwrap()), || open(path));
    let lighting = Lighting::uniform(job.basis.column_count(), [1.0; 3]).unwrap();
    let packed = folder.join("packed.ltc");
    let pack = |source: &dyn BlockSource| {
        let options = PackOptions {
            allow_lost_lights: true,
            container: ContainerOptions { overwrite: true, ..Default::default() },
            ..PackOptions::default()
        };
        ltm::pipeline::pack(source, job, &packed, &options, &NoProgress).unwrap();
    };
    let relight = |source: &dyn BlockSource, count: usize| {
        ltm::relight::relight_raw(source, &vec![lighting.clone(); count]).unwrap();
    };
    let mut seconds = [[f64::INFINITY; 2]; 3];
    for _ in 0..ROUNDS {
        let mut note = |job: usize, how: usize, work: &dyn Fn()| {
            seconds[job][how] = seconds[job][how].min(timed(work));
        };
        for (job, count) in [(0, 1), (1, 8)] {
            note(job, 0, &|| relight(&positioned, count));
            note(job, 1, &|| relight(&mapped(), count));
        }
        note(2, 0, &|| pack(&positioned));
        note(2, 1, &|| pack(&mapped()));
    }
    for (name, [before, after]) in ["relight, 1 lighting", "relight, 8", "pack"].into_iter().zip(seconds) {
        let rate = |seconds: f64| stored as f64 / seconds / 1e9;
        eprintln!(
            "  {name:<28} positioned {before:>7.3} s ({:.2} GB/s)   mapped {after:>7.3} s ({:.2} GB/s)   {:.2} of the time",
            rate(before),
            rate(after),
            after / before
        );
    }
}

/// One large file: written, verified, read cold, without anything else on the disk.
fn stream(folder: &Path, job: &Job, traced: &mut TracedBlock, precision: Precision) {
    let density: f64 = std::env::var("LTM_BENCH_DENSITY").ok().and_then(|n| n.parse().ok()).unwrap_or(1.0);
    let kept = (traced.block.columns() as f64 * density) as usize * traced.block.rows();
    traced.block.entries_mut()[kept..].fill(0.0);
    let path = folder.join("stream.ltm");
    let write = Write { name: "", precision, threads: 2, reserve: density == 1.0 };
    let gib = |bytes: u64| bytes as f64 / (1u64 << 30) as f64;
    let options = StoreOptions { precision, ..StoreOptions::default() };
    let stated = requirements(job, &options);
    eprintln!("{} × {} entries, {precision}, {density} of the columns not zero", job.shape.rows(), job.shape.columns());
    eprintln!("  as f32 {:.2} GiB; disk at most {:.2} GiB", gib(job.shape.raw_bytes()), gib(stated.disk_bytes));
    let mut stored = 0;
    let report = |what: &str, work: &mut dyn FnMut() -> u64| {
        let started = Instant::now();
        let bytes = work();
        let seconds = started.elapsed().as_secs_f64();
        let rate = bytes as f64 / seconds / 1e9;
        eprintln!(
            "  {what:<7} {seconds:>7.2} s {:>7.2} GiB {rate:>6.2} GB/s, peak {} so far",
            gib(bytes),
            peak_memory()
        );
    };
    eprintln!("  a block and what else runs: peak {}", peak_memory());
    report("write", &mut || {
        stored = write_store(&path, job, traced, &write);
        stored
    });
    evict(&path);
    report("verify", &mut || verify(&path, |_, _| true).unwrap().verified_bytes);
    evict(&path);
    report("read", &mut || {
        each_block(&open(&path), 2, Work::Nothing);
        open(&path).tally().unwrap().stored_bytes
    });
}

/// The built-in room traced into memory only, and into a store: what the store adds. Both stand side by side in each round,
/// each first in every other one; what is told is of the ratios of the rounds, which what else runs changes less than
/// the times.
fn render(folder: &Path, samples_per_pixel: u32) {
    let rounds = std::env::var("LTM_BENCH_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(RENDER_ROUNDS);
    let mut loaded = ltm::scene::built_in();
    loaded.settings.samples_per_pixel = samples_per_pixel;
    let job = ltm::pipeline::job_of(&loaded).unwrap();
    let settings =
        TraceSettings { samples_per_pixel, seed: loaded.settings.seed, max_depth: loaded.settings.max_depth };
    let (rows, columns) = (job.shape.rows(), job.shape.columns());
    eprintln!("{rows} rows × {columns} columns, {samples_per_pixel} samples per pixel, {rounds} rounds");
    eprintln!("into memory only (processors')   into a store, f32 (processors')   overhead (processors')");
    let path = folder.join("render.ltm");
    let into_memory = || {
        let tracer = Tracer::new(loaded.scene.clone(), job.shape, settings).unwrap();
        trace_all(&tracer, job.shape);
    };
    let into_store = || {
        let options =
            RenderOptions { store: StoreOptions { overwrite: true, ..Default::default() }, ..Default::default() };
        ltm::pipeline::render(loaded.clone(), &path, &options, &NoProgress).unwrap();
    };
    let ways: [&dyn Fn(); 2] = [&into_memory, &into_store];
    // The first of all is cold.
    into_store();
    let mut ratios = [Vec::new(), Vec::new()];
    for round in 0..rounds {
        let mut took = [[0.0; 2]; 2];
        for way in [round % 2, 1 - round % 2] {
            let processors = processors_seconds();
            took[way] = [timed(ways[way]), processors_seconds() - processors];
        }
        let [memory, store] = took;
        let over = [store[0] / memory[0], store[1] / memory[1]];
        (ratios.iter_mut().zip(over)).for_each(|(ratios, ratio)| ratios.push(ratio));
        let [clock, processors] = over.map(|ratio| 100.0 * (ratio - 1.0));
        let [memory, store] = [memory, store].map(|[clock, processors]| format!("{clock:.2} s ({processors:.2} s)"));
        eprintln!("{memory:>30} {store:>33} {clock:>11.1} % ({processors:.1} %)");
    }
    let variables = ["LTM_BENCH_RENDER", "LTM_BENCH_ROUNDS", "LTM_BENCH_FOLDER"];
    let mut figures = Figures::new("bench-store-render", &variables, COMMAND);
    for (case, ratios) in ["seconds", "processors' seconds"].into_iter().zip(&mut ratios) {
        ratios.sort_by(f64::total_cmp);
        let at = |part: f64| ratios[((ratios.len() - 1) as f64 * part).round() as usize];
        let [low, median, high] = [0.25, 0.5, 0.75].map(at);
        eprintln!("{case}, store over memory: median {median:.3}, quartiles {low:.3} to {high:.3}");
        figures.add(case, "store_over_memory_median", median);
        figures.add(case, "store_over_memory_lower_quartile", low);
        figures.add(case, "store_over_memory_upper_quartile", high);
        figures.add(case, "rounds", ratios.len() as f64);
    }
    figures.write();
}

/// Traces all blocks and keeps none, each thread the next one that nobody has: as a render does.
fn trace_all(tracer: &Tracer, shape: MatrixShape) {
    let next = AtomicU32::new(0);
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                let mut traced = TracedBlock::default();
                loop {
                    let id = BlockId(next.fetch_add(1, Ordering::Relaxed));
                    if id.0 >= shape.block_count() {
                        break;
                    }
                    tracer.trace_block(id, &mut traced);
                }
            });
        }
    });
}

/// Seconds that all threads of this process have run, in the system as well.
fn processors_seconds() -> f64 {
    let told = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    told.tv_sec as f64 + 1e-9 * told.tv_nsec as f64
}

fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or(" unknown");
    line.trim().to_owned()
}

struct Write {
    name: &'static str,
    precision: Precision,
    threads: usize,
    reserve: bool,
}

const WRITES: [Write; 5] = [
    Write { name: "f32", precision: Precision::F32, threads: 1, reserve: true },
    Write { name: "f32, two threads", precision: Precision::F32, threads: 2, reserve: true },
    Write { name: "f32, not reserved", precision: Precision::F32, threads: 1, reserve: false },
    Write { name: "f16", precision: Precision::F16, threads: 1, reserve: true },
    Write { name: "bf16", precision: Precision::Bf16, threads: 1, reserve: true },
];

fn job(blocks: u32, columns: u32) -> Job {
    let mut basis = LightBasis::new();
    let kind = LightKind::AreaTexels { across: 32, down: columns / 32 };
    basis.push(Light::unplaced("panel", kind)).unwrap();
    let shape = MatrixShape::new(32, 32 * blocks, columns, 32).unwrap();
    Job { shape, basis, provenance: Provenance::default() }
}

fn block(job: &Job) -> TracedBlock {
    let mut traced = TracedBlock::default();
    let rows = job.shape.max_block_rows();
    traced.block.reset(rows, job.shape.columns());
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((state >> 8) as f32 + 1.0) / (1u32 << 24) as f32
    };
    traced.block.entries_mut().iter_mut().for_each(|entry| *entry = next());
    traced.noise = Some(BlockNoise {
        row_variance: vec![0.1; rows],
        column_variance: vec![0.1; job.shape.columns()],
        probes: vec![0.1; rows * 16],
    });
    traced
}

fn timed(work: impl FnOnce()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}

fn rate(bytes: u64, work: impl FnOnce()) -> f64 {
    bytes as f64 / timed(work) / 1e9
}

fn best(work: impl Fn() -> f64, before: impl Fn()) -> f64 {
    (0..ROUNDS).map(|_| (before(), work()).1).fold(0.0, f64::max)
}

fn open(path: &Path) -> StoreReader {
    StoreReader::open(path).unwrap()
}

/// Drops a file's pages from the page cache, as far as the kernel follows the advice.
fn evict(path: &Path) {
    let storage = FileStorage::new(File::open(path).unwrap());
    storage.sync().unwrap();
    storage.release(0, storage.length().unwrap());
}

fn write_plain(path: &Path, blocks: u32, traced: &TracedBlock, at_once: usize, sync_each: bool) {
    let file = File::create(path).unwrap();
    let bytes: &[u8] = bytemuck::cast_slice(traced.block.entries());
    for i in 0..u64::from(blocks) {
        for (j, part) in bytes.chunks(at_once).enumerate() {
            file.write_all_at(part, i * bytes.len() as u64 + (j * at_once) as u64).unwrap();
        }
        if sync_each {
            file.sync_data().unwrap();
        }
    }
    file.sync_all().unwrap();
}

fn write_store(path: &Path, job: &Job, traced: &TracedBlock, write: &Write) -> u64 {
    let options = StoreOptions { precision: write.precision, reserve: write.reserve, ..StoreOptions::default() };
    let writer = StoreWriter::create(path, job, options).unwrap();
    let next = AtomicU32::new(0);
    std::thread::scope(|scope| {
        for _ in 0..write.threads {
            scope.spawn(|| {
                loop {
                    let id = BlockId(next.fetch_add(1, Ordering::Relaxed));
                    if id.0 >= job.shape.block_count() {
                        break;
                    }
                    writer.write_block(id, traced).unwrap();
                }
            });
        }
    });
    writer.finish().unwrap().stored_bytes
}

fn read_plain(path: &Path, blocks: u32, threads: u32) {
    let file = File::open(path).unwrap();
    let next = AtomicU32::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let block_bytes = file.metadata().unwrap().len() / u64::from(blocks);
                let mut bytes = vec![0; block_bytes as usize];
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= blocks {
                        break;
                    }
                    file.read_exact_at(&mut bytes, u64::from(i) * block_bytes).unwrap();
                }
            });
        }
    });
}

fn each_block(source: &dyn BlockSource, threads: u32, work: Work) {
    let (next, columns) = (AtomicU32::new(0), source.shape().columns() as u32);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut scratch = TracedBlock::default();
                loop {
                    let id = BlockId(next.fetch_add(1, Ordering::Relaxed));
                    if id.0 >= source.shape().block_count() {
                        break;
                    }
                    match work {
                        Work::Nothing => source.visit_block(id, &mut scratch, &mut |_| Ok(())).unwrap(),
                        Work::Columns => source
                            .visit_columns(id, 0..columns, &mut scratch, &mut |_, entries| {
                                std::hint::black_box(
                                    entries.iter().fold(0, |sum: u32, v| sum.wrapping_add(v.to_bits())),
                                );
                            })
                            .unwrap(),
                    }
                }
            });
        }
    });
}

fn largest_error(path: &Path, traced: &TracedBlock) -> f32 {
    let mut target = TracedBlock::default();
    open(path).read_block(BlockId(0), &mut target).unwrap();
    let pairs = target.block.entries().iter().zip(traced.block.entries());
    pairs.map(|(stored, original)| (stored - original).abs() / original).fold(0.0, f32::max)
}
