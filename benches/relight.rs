//! Relighting speed, with the error reached and the memory bandwidth of the same run beside it.
//!
//! The matrix: 1024×768 pixels, 1,024 columns, blocks of 32×32 pixels. Each block is a sum of smooth products of falling
//! size in full precision; what is relit is its first 8 components in 8 bits, and the error is that of the relit image
//! against the direct product with all 24 components.
//!
//! The direct product that all is compared with is *warm*: the raw f32 entries in memory, and nothing else read. Where one light is
//! changed, it is the product with that light's column alone.
//!
//! `LTM_BENCH_MATRIX=path/without/extension` takes a matrix of one's own instead (several with `:` between them): its
//! `.ltc` relit in every way, from memory and through budgets, against the direct product with its `.ltm`, warm as above; and
//! once *cold*, from a file that the system's cache has forgotten, against the direct product from such a file, which has the
//! entries and nothing else; and what a page-in costs. Beside it the product with right factors decoded to one value a column, as a
//! ratio; where there is no `.ltm`, that alone. For the paper's Conference Room, with the folder that holds it in `LTM_SCENES`:
//!
//! ```text
//! ltm render examples/scenes/conference-20.toml --samples 16 -o twenty.ltm && ltm-pack twenty.ltm
//! ltm render examples/scenes/conference-panel-32.toml --samples 16 -o panel.ltm && ltm-pack panel.ltm
//! LTM_BENCH_MATRIX=$PWD/twenty:$PWD/panel cargo bench --bench relight
//! ```

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

#[path = "relight/decoded.rs"]
mod decoded;
#[path = "relight/direct.rs"]
mod direct;
mod figures;
#[path = "figures/files.rs"]
mod files;
#[path = "../tests/relight_source/mod.rs"]
mod relight_source;

use std::hint::black_box;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use criterion::{BenchmarkGroup, Criterion, Throughput, measurement::WallTime};
use decoded::Decoded;
use direct::InMemory;
use figures::Figures;
use ltm::container::ContainerReader;
use ltm::error::Result;
use ltm::image::{LinearImage, compare};
use ltm::light::Lighting;
use ltm::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, TracedBlock};
use ltm::relight::{
    CompactBlock, CpuRelighter, GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter, relight_raw,
    relight_streaming,
};
use ltm::store::StoreReader;
use rayon::prelude::*;

/// What it is run by.
const COMMAND: &str = "cargo bench --bench relight";
const FULL_RANK: usize = 24;
const KEPT_RANK: usize = 8;
/// Turns of what is compared with each other, of which the median is told.
const ROUNDS: usize = 5;
/// Cold images, of which the median is told.
const COLD_ROUNDS: usize = 3;

/// Step of right sides of smooth blocks.
const RIGHT_STEP: f32 = 2.0 / 127.0;

/// Smooth blocks made when they are asked for.
struct Smooth {
    shape: MatrixShape,
    rank: usize,
}

impl Smooth {
    fn new(rank: usize) -> Self {
        Self { shape: MatrixShape::new(1024, 768, 1024, 32).unwrap(), rank }
    }

    fn block(&self, id: BlockId, rank: usize) -> FactoredBlock {
        let rows = self.shape.rect(id).rows();
        let columns = self.shape.columns();
        let (mut left, mut right) = (Vec::new(), Vec::new());
        let phase = id.0 as f32;
        for k in 0..rank {
            let (f, size) = (k as f32, 0.55f32.powi(k as i32));
            let base = if k == 0 { 1.0 } else { 0.0 };
            left.extend((0..rows).map(|i| size * (base + (phase + f * (1.0 + i as f32 * 0.004)).sin())));
            // Whole numbers of steps, as those of a container are.
            let values = (0..columns).map(|j| base + (0.3 * phase + f * (0.5 + j as f32 * 0.006)).cos());
            right.extend(values.map(|value| (value / RIGHT_STEP).round() * RIGHT_STEP));
        }
        let steps = |peak: f32| (0..rank).map(|k| peak * 0.55f32.powi(k as i32)).collect::<Vec<_>>();
        FactoredBlock {
            rows,
            columns,
            left,
            right,
            // So coarse that 8 bits are taken.
            left_step: steps(8.0 / 127.0),
            right_step: vec![RIGHT_STEP; rank],
            ..Default::default()
        }
    }
}

impl FactorSource for Smooth {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn layer_count(&self, _: BlockId) -> u32 {
        1
    }

    fn encoded_bytes(&self, id: BlockId, _: Range<u32>) -> u64 {
        (self.rank * (self.shape.rect(id).rows() + self.shape.columns())) as u64
    }

    fn read_layers(&self, id: BlockId, _: Range<u32>) -> Result<FactoredBlock> {
        Ok(self.block(id, self.rank))
    }
}

impl BlockSource for Smooth {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        target.block = self.block(id, FULL_RANK).expand();
        Ok(())
    }
}

/// Bytes per second of summing an array far larger than the caches on all threads: the most that a relight can move.
fn read_bandwidth() -> f64 {
    let words = vec![1u64; 64 << 20];
    let sum = || words.par_chunks(1 << 16).map(|chunk| pulp::Arch::new().dispatch(Sum(chunk))).sum::<u64>();
    let fastest = (0..7).map(|_| {
        let start = Instant::now();
        black_box(sum());
        start.elapsed().as_secs_f64()
    });
    (words.len() * 8) as f64 / fastest.fold(f64::INFINITY, f64::min)
}

/// A sum by the widest vectors of the machine, as products are.
struct Sum<'a>(&'a [u64]);

impl pulp::NullaryFnOnce for Sum<'_> {
    type Output = u64;

    #[inline(always)]
    fn call(self) -> u64 {
        self.0.iter().sum()
    }
}

/// Mean seconds of one call over about a second of calls.
fn mean_secs(mut call: impl FnMut()) -> f64 {
    call();
    let start = Instant::now();
    let mut calls = 0;
    while start.elapsed().as_secs_f64() < 1.0 {
        call();
        calls += 1;
    }
    start.elapsed().as_secs_f64() / f64::from(calls)
}

/// Bytes that hold all chunks of a source in memory.
fn chunk_bytes(source: &dyn FactorSource) -> u64 {
    let layers = |id| source.layer_count(id);
    source.shape().blocks().map(|id| source.encoded_bytes(id, 0..layers(id)) + 192 * u64::from(layers(id))).sum()
}

/// What bringing all blocks in costs on one thread, step by step: the share of it that is reading and checking.
fn page_in(container: &ContainerReader) -> f64 {
    let shape = FactorSource::shape(container);
    let transform = container.column_transform();
    let (mut read, mut decode, mut compact) = (0.0, 0.0, 0.0);
    let mut factor_bytes = 0;
    let took = |seconds: &mut f64, start: Instant| *seconds += start.elapsed().as_secs_f64();
    // The first time everything is cold.
    for round in 0..2 {
        if round == 1 {
            (read, decode, compact, factor_bytes) = (0.0, 0.0, 0.0, 0);
        }
        for id in shape.blocks() {
            let start = Instant::now();
            let chunks: Vec<_> =
                (0..container.layer_count(id)).map(|layer| container.stored_layer(id, layer).unwrap()).collect();
            took(&mut read, start);
            let start = Instant::now();
            let block = container.decode_coded(id, &chunks).unwrap();
            took(&mut decode, start);
            let start = Instant::now();
            factor_bytes += CompactBlock::new(shape, id, block, &transform).unwrap().bytes();
            took(&mut compact, start);
        }
    }
    println!(
        "  page-in of {} blocks on one thread: read and checked {:.2} ms, decoded {:.2} ms, made compact {:.2} ms; \
         {:.2} MB stored, {:.2} MB compact",
        shape.block_count(),
        1e3 * read,
        1e3 * decode,
        1e3 * compact,
        container.file_bytes() as f64 / 1e6,
        factor_bytes as f64 / 1e6,
    );
    read / (read + decode + compact)
}

/// Seconds of the direct product, where there is enough memory for it: with all entries in memory, of one light changed there, and from
/// a file of them.
#[derive(Default)]
struct DirectSecs {
    warm: Option<f64>,
    change: Option<f64>,
    cold: Option<f64>,
}

/// The rates of this machine in this run, and the error that every figure is printed with.
struct Ruler {
    bandwidth: f64,
    reference: LinearImage,
    direct: DirectSecs,
    /// What is measured.
    case: String,
    figures: Figures,
}

impl Ruler {
    fn decibels(&self, image: &LinearImage) -> f64 {
        compare(image, &self.reference).psnr_linear
    }

    /// Tells of one way; with the bytes that it moves through memory, where those are known and are what takes the time.
    fn report(&mut self, name: &str, secs: f64, moved: Option<u64>, decibels: f64) {
        let case = self.begin(name, secs, decibels);
        if let Some(bytes) = moved {
            let rate = bytes as f64 / secs;
            let part = rate / self.bandwidth;
            print!(
                ", {:.1} MB moved, {:.2} GB/s = {part:.2} of the {:.1} GB/s read here",
                bytes as f64 / 1e6,
                rate / 1e9,
                self.bandwidth / 1e9,
            );
            self.figures.add(&case, "of_bandwidth", part);
        }
        self.over_direct(&case, ("warm", self.direct.warm), secs);
    }

    /// Tells of what is read from disk.
    fn report_cold(&mut self, name: &str, secs: f64, decibels: f64) {
        let case = self.begin(name, secs, decibels);
        self.over_direct(&case, ("cold", self.direct.cold), secs);
    }

    /// Tells of one light changed.
    fn report_change(&mut self, secs: f64, decibels: f64) {
        let case = self.begin("cpu, one light changed", secs, decibels);
        self.over_direct(&case, ("change", self.direct.change), secs);
    }

    /// Begins the line of one way. Returns its case among the figures.
    fn begin(&mut self, name: &str, secs: f64, decibels: f64) -> String {
        let case = format!("{}: {name}", self.case);
        print!("  {name}: {:.3} ms, {:.1} per second, {decibels:.1} dB", 1e3 * secs, 1.0 / secs);
        self.figures.add(&case, "milliseconds", 1e3 * secs);
        case
    }

    /// Ends the line with how many times faster it is than the direct product that is like it, where that was measured.
    fn over_direct(&mut self, case: &str, (told, direct): (&str, Option<f64>), secs: f64) {
        if let Some(direct) = direct {
            let ratio = direct / secs;
            print!(", {ratio:.1} × faster than the direct product, {told}");
            self.figures.add(case, &format!("{told}_direct_over_it"), ratio);
        }
        println!();
    }

    /// Measures the direct product with the raw entries in memory, where they fit; and with those of a file that is written for
    /// that, if it is named.
    fn measure_direct(&mut self, matrix: &dyn BlockSource, lighting: &Lighting, file: Option<&Path>) {
        let Some(entries) = InMemory::load(matrix) else {
            return println!("  there is not enough memory for the raw matrix: no direct product");
        };
        let target = entries.target();
        let secs = mean_secs(|| entries.product(lighting, &target));
        let image = entries.image(&target);
        let mut columns = (0..matrix.shape().columns() as u32).cycle();
        let change_secs = mean_secs(|| {
            let column = ColumnIndex(columns.next().expect("it never ends"));
            entries.add_column(column, [1e-6; CHANNELS], &target);
        });
        let (rate, bytes) = (entries.bytes() as f64 / secs, entries.bytes());
        println!(
            "direct product with the raw matrix in memory: {secs:.3} s, {:.2} GB, {:.2} GB/s = {:.2} of the {:.1} GB/s read \
             here, {:.0} dB",
            bytes as f64 / 1e9,
            rate / 1e9,
            rate / self.bandwidth,
            self.bandwidth / 1e9,
            self.decibels(&image),
        );
        println!("  one light changed, with its raw column in memory: {:.3} ms", 1e3 * change_secs);
        let cold = file.map(|path| {
            entries.write(path).expect("the folder of the matrix can be written");
            let (image, secs) =
                cold(path, |path| Ok(entries.opened(path).and_then(|file| file.relit(lighting)).unwrap()));
            std::fs::remove_file(path).expect("it was just written");
            let rate = bytes as f64 / secs / 1e9;
            println!(
                "  from disk, a file of the entries: {secs:.3} s, {rate:.2} GB/s, {:.0} dB",
                self.decibels(&image)
            );
            self.figures.add(&self.case, "direct_cold_milliseconds", 1e3 * secs);
            secs
        });
        self.direct = DirectSecs { warm: Some(secs), change: Some(change_secs), cold };
        for (figure, value) in [
            ("direct_change_milliseconds", 1e3 * change_secs),
            ("entries_gigabytes", bytes as f64 / 1e9),
            ("direct_warm_milliseconds", 1e3 * secs),
            ("direct_warm_of_bandwidth", rate / self.bandwidth),
        ] {
            self.figures.add(&self.case, figure, value);
        }
    }
}

/// Every way to relight a source, first as a table with errors, then for criterion.
fn measure(source: &dyn FactorSource, lighting: &Lighting, ruler: &mut Ruler, group: &mut BenchmarkGroup<WallTime>) {
    let shape = source.shape();
    let relighter = CpuRelighter::load(source).unwrap();
    let mut target = relighter.relight(lighting).unwrap();
    let error = compare(&target, &ruler.reference);
    let (columns, side, rank) = (shape.columns(), shape.block_side(), relighter.mean_rank());
    println!(
        "{} rows × {columns} columns, mean rank {rank:.2}, blocks of {side} × {side}, 8 and 16 bits, {:.1} MB of factors: \
         {:.1} dB (peak {:.3}), clip {:.1} dB, relative L2 {:.1e}",
        shape.rows(),
        relighter.factor_bytes() as f64 / 1e6,
        error.psnr_linear,
        error.peak,
        error.psnr_clipped,
        error.relative_l2,
    );
    for (figure, value) in [
        ("mean_rank", rank),
        ("lin_db", error.psnr_linear),
        ("clip_db", error.psnr_clipped),
        ("factor_megabytes", relighter.factor_bytes() as f64 / 1e6),
    ] {
        ruler.figures.add(&ruler.case, figure, value);
    }
    let moved = relighter.factor_bytes() + shape.rows() * 4;
    group.throughput(Throughput::Bytes(moved));
    let full = mean_secs(|| relighter.relight_into(lighting, &mut target).unwrap());
    ruler.report("cpu, full", full, Some(moved), ruler.decibels(&target));
    let mut kept = relighter.relight_kept(lighting).unwrap();
    let mut i = 0;
    let mut change = || {
        i += 1;
        let column = i % columns as u32;
        relighter.change(&mut kept, &[(ColumnIndex(column), [i as f32 % 3.0; 3])]).unwrap();
    };
    ruler.report_change(mean_secs(&mut change), ruler.decibels(&target));
    group.bench_function("cpu, full", |b| b.iter(|| relighter.relight_into(lighting, &mut target).unwrap()));
    group.bench_function("cpu, one light changed", |b| b.iter(&mut change));

    for (name, budget) in [
        ("nothing in memory", 0),
        ("the chunks in memory", chunk_bytes(source)),
        ("the chunks and half of the factors in memory", chunk_bytes(source) + relighter.factor_bytes() / 2),
        ("the chunks and all factors in memory", u64::MAX),
    ] {
        let paged = PagedRelighter::new(source, budget);
        let decibels = ruler.decibels(&paged.relight(lighting).unwrap());
        let before = paged.reads();
        let mut images = 0;
        let secs = mean_secs(|| {
            paged.relight(lighting).unwrap();
            images += 1;
        });
        let decodes = (paged.reads().decodes - before.decodes) / images;
        // Where blocks are decoded that takes the time, whatever is moved.
        let moved = (decodes == 0).then_some(moved);
        ruler.report(&format!("cpu, {name}, {decodes} blocks decoded"), secs, moved, decibels);
    }
    let mut streamed = None;
    let secs = mean_secs(|| streamed = Some(relight_streaming(source, lighting).unwrap().0));
    ruler.report("cpu, streamed", secs, None, streamed.map_or(0.0, |image| ruler.decibels(&image)));
    measure_gpu(source, lighting, moved, ruler, group);
}

/// The ways of a GPU, where there is one.
fn measure_gpu(
    source: &dyn FactorSource,
    lighting: &Lighting,
    moved: u64,
    ruler: &mut Ruler,
    group: &mut BenchmarkGroup<WallTime>,
) {
    match GpuRelighter::new(source) {
        Ok(gpu) => {
            let decibels = ruler.decibels(&gpu.relight(lighting).unwrap());
            let name = gpu.adapter();
            let resident = mean_secs(|| gpu.relight_resident(lighting).unwrap());
            // The bandwidth is that of the processor's memory: another device has one of its own.
            let moved = name.contains("llvmpipe").then_some(moved);
            ruler.report(&format!("{name}, resident"), resident, moved, decibels);
            let read_back = mean_secs(|| drop(gpu.relight(lighting).unwrap()));
            ruler.report(&format!("{name}, read back"), read_back, None, decibels);
            group.bench_function("gpu, resident", |b| b.iter(|| gpu.relight_resident(lighting).unwrap()));
            let host = PagedRelighter::new(source, u64::MAX);
            let budget = gpu.resident_bytes() / 10;
            drop(gpu);
            match PagedGpuRelighter::new(host, budget, GpuSettings::default()) {
                Ok(paged) => {
                    let decibels = ruler.decibels(&paged.relight(lighting).unwrap());
                    let secs = mean_secs(|| drop(paged.relight(lighting).unwrap()));
                    ruler.report(&format!("{name}, a tenth of the factors in its memory"), secs, None, decibels);
                }
                Err(error) => println!("  {error}"),
            }
        }
        Err(error) => println!("  {error}"),
    }
}

/// An image made from a file that the system's cache has forgotten, its opening with it: the image, and the median of the
/// seconds.
fn cold(path: &Path, image: impl Fn(&Path) -> Result<LinearImage>) -> (LinearImage, f64) {
    let mut rounds: Vec<(LinearImage, f64)> = (0..COLD_ROUNDS)
        .map(|_| {
            files::forget(path);
            let start = Instant::now();
            (image(path).unwrap(), start.elapsed().as_secs_f64())
        })
        .collect();
    rounds.sort_by(|a, b| a.1.total_cmp(&b.1));
    rounds.swap_remove(COLD_ROUNDS / 2)
}

/// What right factors as coefficients are beside decoded ones, which are held with a value for each column: turn by turn, so that both
/// meet the same machine.
fn measure_decoded(container: &ContainerReader, case: &str, figures: &mut Figures) {
    let (shape, scales) = (container.job().shape, container.column_scales());
    let (coded, decoded) = (CpuRelighter::load(container).unwrap(), Decoded::load(container));
    let [left_bytes, right_bytes] = decoded.bytes();
    let mut image = LinearImage::black(shape.width(), shape.height());
    let mut rows = Vec::new();
    let columns = shape.columns();
    let mut one = vec![[0.0; CHANNELS]; columns];
    one[columns / 3] = [1.0, 0.5, 0.25];
    let lightings = [
        ("the scene's light", Lighting::of_scene(&container.job().basis)),
        ("a random light", relight_source::random_lighting(columns, 1)),
        ("one column", Lighting::new(one).unwrap()),
    ];
    let held = coded.factor_bytes() as f64;
    println!(
        "{} rows × {columns} columns, mean rank {:.1}, blocks of {}: {:.2} MB in the file; in memory {:.2} MB, of which left sides take some {:.2}; decoded {:.2} MB, right sides {:.2}",
        shape.rows(),
        coded.mean_rank(),
        shape.block_side(),
        container.file_bytes() as f64 / 1e6,
        held / 1e6,
        left_bytes as f64 / 1e6,
        (left_bytes + right_bytes) as f64 / 1e6,
        right_bytes as f64 / 1e6,
    );
    figures.add(case, "held_over_file", held / container.file_bytes() as f64);
    figures.add(case, "decoded_over_file", (left_bytes + right_bytes) as f64 / container.file_bytes() as f64);
    for (name, lighting) in &lightings {
        let mut ratios: Vec<(f64, f64)> = (0..ROUNDS)
            .map(|_| {
                let of_decoded = mean_secs(|| decoded.product(lighting, scales, &mut rows));
                (mean_secs(|| coded.relight_into(lighting, &mut image).unwrap()), of_decoded)
            })
            .collect();
        ratios.sort_by(|a, b| (a.1 / a.0).total_cmp(&(b.1 / b.0)));
        let ((coded, decoded), ratio) = (ratios[ROUNDS / 2], |at: usize| ratios[at].1 / ratios[at].0);
        println!(
            "  {name}: {:.3} ms, decoded {:.3} ms: {:.2} × ({:.2} to {:.2})",
            1e3 * coded,
            1e3 * decoded,
            ratio(ROUNDS / 2),
            ratio(0),
            ratio(ROUNDS - 1),
        );
        figures.add(&format!("{case}: {name}"), "decoded_over_it", ratio(ROUNDS / 2));
    }
    let mut kept = coded.relight_kept(&lightings[0].1).unwrap();
    for (name, step) in [("one light changed", columns), ("a stroke over a hundredth of the columns", 1)] {
        let mut round = 0;
        let secs = mean_secs(|| {
            round += 1;
            let count = if step == 1 { columns / 100 } else { 1 };
            let weight = [round as f32 % 3.0; CHANNELS];
            let first = round * 37 % (columns - count);
            let changes: Vec<_> = (first..first + count).map(|j| (ColumnIndex(j as u32), weight)).collect();
            coded.change(&mut kept, &changes).unwrap();
        });
        println!("  {name}: {:.3} ms", 1e3 * secs);
        figures.add(&format!("{case}: {name}"), "milliseconds", 1e3 * secs);
    }
}

/// A matrix of one's own, as a container and stored.
fn measure_own(stem: &Path, bandwidth: f64, criterion: &mut Criterion, mut figures: Figures) -> Figures {
    let container = ContainerReader::open(&stem.with_extension("ltc")).unwrap();
    let path = stem.with_extension("ltm");
    let name = stem.file_name().map_or_else(Default::default, |name| name.to_string_lossy());
    measure_decoded(&container, &name, &mut figures);
    if !path.exists() {
        return figures;
    }
    let lighting = Lighting::of_scene(&container.job().basis);
    let (reference, stored_secs) =
        cold(&path, |path| Ok(relight_raw(&StoreReader::open(path)?, std::slice::from_ref(&lighting))?.remove(0)));
    let (packed, packed_secs) =
        cold(&stem.with_extension("ltc"), |path| Ok(relight_streaming(&ContainerReader::open(path)?, &lighting)?.0));
    let matrix = StoreReader::open(&path).unwrap();
    let bytes = matrix.tally().unwrap().stored_bytes as f64;
    println!(
        "{}: direct product with the stored matrix from disk: {stored_secs:.2} s, {:.2} GB, {:.2} GB/s; the container is \
         {:.2} MB",
        stem.display(),
        bytes / 1e9,
        bytes / stored_secs / 1e9,
        container.file_bytes() as f64 / 1e6,
    );
    let read_share = page_in(&container);
    let mut group = criterion.benchmark_group(format!("relight {name}"));
    let case = name.into_owned();
    let mut ruler = Ruler { bandwidth, reference, direct: DirectSecs::default(), case, figures };
    ruler.figures.add(&ruler.case, "stored_gigabytes", bytes / 1e9);
    ruler.figures.add(&ruler.case, "page_in_read_share", read_share);
    ruler.measure_direct(&matrix, &lighting, Some(&stem.with_extension("entries")));
    ruler.report_cold("the stored matrix, cold: from disk", stored_secs, f64::INFINITY);
    ruler.report_cold("cpu, cold: the container from disk", packed_secs, ruler.decibels(&packed));
    measure(&container, &lighting, &mut ruler, &mut group);
    group.finish();
    ruler.figures
}

fn main() {
    let mut criterion = Criterion::default().without_plots().sample_size(10).configure_from_args();
    let bandwidth = read_bandwidth();
    if let Some(stems) = std::env::var_os("LTM_BENCH_MATRIX") {
        let stems: Vec<PathBuf> = std::env::split_paths(&stems).collect();
        let figures = Figures::new("bench-relight-own", &["LTM_SCENES", "LTM_BENCH_MATRIX"], COMMAND);
        let measured = |figures, stem: &PathBuf| measure_own(stem, bandwidth, &mut criterion, figures);
        stems.iter().fold(figures, measured).write();
        return criterion.final_summary();
    }
    let source = Smooth::new(KEPT_RANK);
    let lighting = relight_source::random_lighting(1024, 1);
    let reference = relight_raw(&source, std::slice::from_ref(&lighting)).unwrap().remove(0);
    let mut group = criterion.benchmark_group("relight 1024x768, 1024 columns, rank 8, 8 bits");
    let figures = Figures::new("bench-relight", &[], COMMAND);
    let case = "synthetic".to_owned();
    let mut ruler = Ruler { bandwidth, reference, direct: DirectSecs::default(), case, figures };
    ruler.measure_direct(&source, &lighting, None);
    measure(&source, &lighting, &mut ruler, &mut group);
    ruler.figures.write();
    group.finish();
    criterion.final_summary();
}
