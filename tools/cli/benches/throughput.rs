//! `ltm-pack` and `ltm-unpack` as their users run them, on a matrix of gigabytes: bytes of the matrix as f32 a second,
//! beside the error and the size that were reached.
//!
//! The matrix (the built-in room, 1,024 columns, 16 samples per pixel) is rendered first; `LTM_BENCH_GIB` says how large it
//! is to be (default 2). It lies in the temporary folder, which needs twice that room.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

#[path = "../../../benches/figures/mod.rs"]
mod figures;

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use figures::Figures;
use ltm::pipeline::{self, RenderOptions};
use ltm::resources::NoProgress;
use ltm::scene::BuiltIn;
use ltm::store::StoreReader;

const TEXELS: u32 = 32;
const SAMPLES: u32 = 16;

/// Image height of a 4:3 image whose matrix has about so many bytes.
fn height_for(bytes: f64) -> u32 {
    let pixels = bytes / f64::from(3 * 4 * TEXELS * TEXELS);
    (pixels * 0.75).sqrt().round() as u32
}

/// Runs a program on a file, and returns what it says.
fn run(program: &str, input: &Path, output: &Path) -> String {
    let mut command = Command::new(program);
    let done = command.arg(input).args(["--force", "--memory", "1GiB", "-o"]).arg(output).output();
    let done = done.expect("the program starts");
    assert!(done.status.success(), "{program}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8_lossy(&done.stdout).into_owned()
}

fn bench(criterion: &mut Criterion) {
    let gib: f64 = std::env::var("LTM_BENCH_GIB").map_or(2.0, |text| text.parse().expect("LTM_BENCH_GIB is a number"));
    let height = height_for(gib * f64::from(1 << 30));
    let width = height * 4 / 3;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [matrix, container, again] = ["room.ltm", "room.ltc", "again.ltm"].map(|name| folder.path().join(name));
    let mut loaded = BuiltIn { width, height, texels: TEXELS }.named("mixed").expect("a built-in scene");
    loaded.settings.samples_per_pixel = SAMPLES;
    pipeline::render(loaded, &matrix, &RenderOptions::default(), &NoProgress).expect("rendering");
    let shape = StoreReader::open(&matrix).expect("the matrix").job().shape;
    let (pack, unpack) = (env!("CARGO_BIN_EXE_ltm-pack"), env!("CARGO_BIN_EXE_ltm-unpack"));
    let said = run(pack, &matrix, &container);
    let mut figures = Figures::new("bench-throughput", &["LTM_BENCH_GIB"], "cargo bench -p ltm-cli");
    let case = format!("{} x {}", shape.rows(), shape.columns());
    let rate = |program: &str, input: &Path, output: &Path| {
        let timed = || {
            let begun = Instant::now();
            run(program, input, output);
            begun.elapsed().as_secs_f64()
        };
        shape.raw_bytes() as f64 / (0..3).map(|_| timed()).fold(f64::INFINITY, f64::min) / 1e9
    };
    figures.add(&case, "pack_gb_per_s", rate(pack, &matrix, &container));
    figures.add(&case, "unpack_gb_per_s", rate(unpack, &container, &again));
    figures.add(&case, "container_bytes", std::fs::metadata(&container).expect("the container").len() as f64);
    figures.write();

    let mut group = criterion.benchmark_group("throughput");
    group.throughput(Throughput::Bytes(shape.raw_bytes())).sample_size(10);
    group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(30));
    let name = format!("{} x {} f32", shape.rows(), shape.columns());
    group.bench_function(format!("pack {name}"), |bencher| bencher.iter(|| run(pack, &matrix, &container)));
    group.bench_function(format!("unpack {name}"), |bencher| bencher.iter(|| run(unpack, &container, &again)));
    group.finish();
    println!("blocks of {} px, {SAMPLES} samples per pixel; packed:\n{said}", shape.block_side());
}

criterion_group! {
    name = benches;
    config = Criterion::default().without_plots();
    targets = bench
}
criterion_main!(benches);
