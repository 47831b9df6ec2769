//! Relighting speed, with the error reached and the memory bandwidth of the same run beside it.
//!
//! The matrix: 1024×768 pixels, 1,024 columns, blocks of 32×32 pixels. Each block is a sum of smooth products of falling
//! size in full precision; what is relit is its first 8 components in 8 bits, and the error is that of the relit image
//! against the direct product with all 24 components.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

#[path = "../tests/relight_source/mod.rs"]
mod relight_source;

use std::hint::black_box;
use std::ops::Range;
use std::time::Instant;

use criterion::{Criterion, Throughput};
use ltm::error::Result;
use ltm::image::{LinearImage, compare};
use ltm::light::Lighting;
use ltm::matrix::{BlockId, BlockSource, ColumnIndex, FactorSource, FactoredBlock, MatrixShape, TracedBlock};
use ltm::relight::{CpuRelighter, GpuRelighter, relight_raw, relight_streaming};
use rayon::prelude::*;

const FULL_RANK: usize = 24;
const KEPT_RANK: usize = 8;

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
            right.extend((0..columns).map(|j| base + (0.3 * phase + f * (0.5 + j as f32 * 0.006)).cos()));
        }
        let steps = |peak: f32| (0..rank).map(|k| peak * 0.55f32.powi(k as i32)).collect::<Vec<_>>();
        FactoredBlock {
            rows,
            columns,
            left,
            right,
            left_step: steps(2.0 / 127.0),
            right_step: vec![2.0 / 127.0; rank],
            sparse: Vec::new(),
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
    let sum = || words.par_chunks(1 << 16).map(|chunk| chunk.iter().sum::<u64>()).sum::<u64>();
    let fastest = (0..7).map(|_| {
        let start = Instant::now();
        black_box(sum());
        start.elapsed().as_secs_f64()
    });
    (words.len() * 8) as f64 / fastest.fold(f64::INFINITY, f64::min)
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

fn main() {
    let mut criterion = Criterion::default().sample_size(10).configure_from_args();
    let source = Smooth::new(KEPT_RANK);
    let shape = source.shape;
    let lightings: Vec<Lighting> = (1..=2).map(|seed| relight_source::random_lighting(1024, seed)).collect();
    let relighter = CpuRelighter::load(&source).unwrap();
    let relit = relighter.relight(&lightings[0]).unwrap();
    let start = Instant::now();
    let reference = relight_raw(&source, &lightings[..1]).unwrap().remove(0);
    let raw_secs = start.elapsed().as_secs_f64();
    let error = compare(&relit, &reference);
    let rank = relighter.mean_rank();
    println!(
        "{} rows × {} columns, rank {rank}, blocks of 32 × 32, 8 bits: {:.1} dB (peak {:.1}), relative L2 {:.1e}",
        shape.rows(),
        shape.columns(),
        error.psnr_linear,
        error.peak,
        error.relative_l2,
    );
    let image_bytes = shape.rows() * 4;
    let moved = relighter.factor_bytes() + image_bytes;
    let bandwidth = read_bandwidth();
    let mut target = LinearImage::black(shape.width(), shape.height());
    let report = |name: &str, secs: f64, bytes: u64| {
        let rate = bytes as f64 / secs;
        println!(
            "{name}: {:.3} ms, {:.0} per second, {:.1} MB moved, {:.1} GB/s = {:.2} of the {:.1} GB/s read here, {:.1} dB",
            1e3 * secs,
            1.0 / secs,
            bytes as f64 / 1e6,
            rate / 1e9,
            rate / bandwidth,
            bandwidth / 1e9,
            error.psnr_linear,
        );
    };
    report("full relight", mean_secs(|| relighter.relight_into(&lightings[0], &mut target).unwrap()), moved);
    let mut kept = relighter.relight_kept(&lightings[0]).unwrap();
    let mut i = 0;
    let mut change = || {
        i += 1;
        relighter.change(&mut kept, &[(ColumnIndex(i % 1024), [i as f32 % 3.0; 3])]).unwrap();
    };
    report("one light changed", mean_secs(&mut change), moved);
    println!("direct product with blocks multiplied out in memory: {raw_secs:.2} s (making them included)");
    println!("streaming: {:.3} s", mean_secs(|| drop(relight_streaming(&source, &lightings[0]).unwrap())));

    let mut group = criterion.benchmark_group("relight 1024x768, 1024 columns, rank 8, 8 bits");
    group.throughput(Throughput::Bytes(moved));
    group.bench_function("cpu, full", |b| b.iter(|| relighter.relight_into(&lightings[0], &mut target).unwrap()));
    group.bench_function("cpu, one light changed", |b| b.iter(&mut change));
    match GpuRelighter::new(&source) {
        Ok(gpu) => {
            let error = compare(&gpu.relight(&lightings[0]).unwrap(), &reference);
            println!("{}: {:.1} dB", gpu.adapter(), error.psnr_linear);
            group.bench_function("gpu, resident", |b| b.iter(|| gpu.relight_resident(&lightings[0]).unwrap()));
            group.bench_function("gpu, read back", |b| b.iter(|| gpu.relight(&lightings[0]).unwrap()));
        }
        Err(error) => println!("{error}"),
    }
    group.finish();
    criterion.final_summary();
}
