//! Compressing a block: speed against error, with the SVD of the same block beside it, full and randomized.
//!
//! The block is 32 × 32 pixels (3,072 rows, f32) below a panel, with a shadow edge and 2 % of noise; under 1,024 columns
//! (a panel of 32 × 32 texels) and under 24 (lamps). Each line of the table gives the rank, the error of the factors
//! before they are quantised, and that of relit images; criterion gives the times, one thread.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod figures;
#[path = "compress/randomized.rs"]
mod randomized;

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use faer::MatRef;
use figures::Figures;
use ltm::compress::{CompressSettings, Compressor, Method, PriorChoice, Target};
use ltm::light::{Light, LightBasis, LightKind, evaluation_lightings};
use ltm::matrix::{Block, BlockId, MatrixShape};

const SIDE: u32 = 32;
const RANK: usize = 16;

fn lights(across: u32, down: u32) -> LightBasis {
    let mut basis = LightBasis::new();
    let light = Light::unplaced("panel", LightKind::AreaTexels { across, down });
    basis.push(light).expect("the light fits");
    basis
}

fn block(across: u32, down: u32) -> Block {
    let pixels = (SIDE * SIDE) as usize;
    let (rows, columns) = (3 * pixels, (across * down) as usize);
    let entry = |at: usize| {
        let (row, column) = (at % rows, at / rows);
        let (x, y) = ((row % SIDE as usize) as f32 / SIDE as f32, (row % pixels / SIDE as usize) as f32 / SIDE as f32);
        let (u, v) = (column as u32 % across, column as u32 / across);
        let (u, v) = (u as f32 / across as f32, v as f32 / down as f32);
        let lit = if x + 0.5 * u > 0.8 { 0.2 } else { 1.0 };
        let hash = (row as u32).wrapping_mul(2_654_435_761).wrapping_add(column as u32 * 40_503) >> 8;
        let noise = 1.0 + 0.02 * (hash % 1024) as f32 / 512.0;
        lit * noise / ((x - u).powi(2) + (y - v).powi(2) + 0.25).powi(2)
    };
    Block::from_entries(rows, columns, (0..rows * columns).map(entry).collect())
}

/// Relative errors of the entries, and of images under the evaluation lightings.
fn errors(basis: &LightBasis, a: &Block, b: &Block) -> (f64, f64) {
    let ratio = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let (error, norm) = pairs.fold((0.0, 0.0), |(e, n), (a, b)| (e + (a - b).powi(2), n + a * a));
        f64::sqrt(error / norm)
    };
    let matrix = ratio(&mut a.entries().iter().zip(b.entries()).map(|(&a, &b)| (f64::from(a), f64::from(b))));
    let mut images = Vec::new();
    for (_, lighting) in evaluation_lightings(basis, 1) {
        let image = |block: &Block| -> Vec<f64> {
            let mut image = vec![0.0; block.rows()];
            for (column, weight) in block.entries().chunks_exact(block.rows()).zip(lighting.weights()) {
                image.iter_mut().zip(column).for_each(|(sum, &v)| *sum += f64::from(v) * f64::from(weight[0]));
            }
            image
        };
        images.extend(image(a).into_iter().zip(image(b)));
    }
    (matrix, ratio(&mut images.into_iter()))
}

fn analyse(criterion: &mut Criterion) {
    let mut figures = Figures::new("bench-compress", &[], "cargo bench --bench compress");
    println!(
        "{:>7} {:>34} {:>5} {:>12} {:>12} {:>9}",
        "columns", "method", "rank", "matrix error", "image error", "ms"
    );
    for (across, down) in [(32, 32), (6, 4)] {
        let (basis, block) = (lights(across, down), block(across, down));
        let shape = MatrixShape::new(SIDE, SIDE, across * down, SIDE).expect("the shape is possible");
        let mut group = criterion.benchmark_group(format!("{} rows x {} columns, f32", block.rows(), block.columns()));
        group.sample_size(10).throughput(Throughput::Bytes(4 * block.entries().len() as u64));
        // With a flat prior the errors of both are of the same kind: ours at rank 16 against the SVD's.
        let flat = CompressSettings { prior: PriorChoice::Flat, rank: RANK, ..Default::default() };
        let cases = [
            ("auto", CompressSettings { rank: RANK, ..Default::default() }),
            ("auto, flat", flat),
            ("svd", CompressSettings { rank: RANK, ..CompressSettings::of_method(Method::BlockSvd) }),
            ("algorithm4", CompressSettings { rank: RANK, ..CompressSettings::of_method(Method::Algorithm4) }),
        ];
        for (name, settings) in cases {
            let settings = CompressSettings { target: Target::Slope(0.0), ..settings };
            let compressor = Compressor::new(&basis, shape, settings).expect("the settings are possible");
            let candidate = compressor.analyse(BlockId(0), block.view(), None);
            let factored = candidate.cut(&compressor.choose([candidate.summary()].into_iter()));
            let (matrix, images) = errors(&basis, &block, &factored.expand());
            let analyse = || drop(black_box(compressor.analyse(BlockId(0), block.view(), None)));
            tell(&mut figures, (name, block.columns()), factored.rank(), (matrix, images), least_secs(analyse));
            group.bench_function(name, |bencher| bencher.iter(analyse));
        }
        let dense = MatRef::from_column_major_slice(block.entries(), block.rows(), block.columns());
        for (name, power) in [("svd, randomized", 0), ("svd, randomized, a power iteration", 1)] {
            let (left, right) = randomized::leading(dense, RANK, power);
            let product = &left * &right;
            let entries =
                (0..block.entries().len()).map(|at| product[(at % block.rows(), at / block.rows())]).collect();
            let found = errors(&basis, &block, &Block::from_entries(block.rows(), block.columns(), entries));
            let find = || drop(black_box(randomized::leading(dense, RANK, power)));
            tell(&mut figures, (name, block.columns()), left.ncols(), found, least_secs(find));
            group.bench_function(name, |bencher| bencher.iter(find));
        }
        group.finish();
    }
    figures.write();
}

/// Prints and keeps what came of a method.
fn tell(figures: &mut Figures, (name, columns): (&str, usize), rank: usize, (matrix, images): (f64, f64), secs: f64) {
    println!("{columns:>7} {name:>34} {rank:>5} {matrix:>12.2e} {images:>12.2e} {:>9.2}", 1e3 * secs);
    let case = format!("{name}, {columns} columns");
    for (figure, value) in
        [("rank", rank as f64), ("matrix_error", matrix), ("image_error", images), ("milliseconds", 1e3 * secs)]
    {
        figures.add(&case, figure, value);
    }
}

/// The least seconds of ten calls.
fn least_secs(call: impl Fn()) -> f64 {
    let timed = || {
        let begun = Instant::now();
        call();
        begun.elapsed().as_secs_f64()
    };
    (0..10).map(|_| timed()).fold(f64::INFINITY, f64::min)
}

criterion_group! { name = benches; config = Criterion::default().without_plots(); targets = analyse }
criterion_main!(benches);
