//! Coding the factors of a block: bytes against error against speed, each printed beside the others.
//!
//! The block is 32 × 32 pixels (3,072 rows) under a light of 32 × 32 texels (1,024 columns), of rank 8: smooth
//! components of falling weight, an edge, and noise. Throughput counts the decoded factors in f32.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, LightLayout};
use ltm::light::{Light, LightBasis, LightKind, LightUnit};
use ltm::matrix::{BlockId, FactoredBlock, MatrixShape};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const SIDE: usize = 32;
const ROWS: usize = 3 * SIDE * SIDE;
const COLUMNS: usize = SIDE * SIDE;
const RANK: usize = 8;

fn layout() -> BlockLayout {
    let mut basis = LightBasis::new();
    let light = Light {
        name: "panel".into(),
        kind: LightKind::AreaTexels { across: SIDE as u32, down: SIDE as u32 },
        unit: LightUnit::Radiance,
        emission: [1.0; 3],
        first_column: 0,
        places: vec![[0.0; 3]; COLUMNS],
        extents: vec![1.0; COLUMNS],
    };
    basis.push(light).expect("the light fits");
    let shape = MatrixShape::new(SIDE as u32, SIDE as u32, COLUMNS as u32, SIDE as u32).expect("the shape is possible");
    BlockLayout::new(shape.rect(BlockId(0)), LightLayout::of(&basis))
}

/// Smooth images with an edge and 5 % of noise, of energy 4⁻ᵏ.
fn block() -> FactoredBlock {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut block = FactoredBlock { rows: ROWS, columns: COLUMNS, ..Default::default() };
    for k in 0..RANK {
        let (a, b, c): (f32, f32, f32) = (random.random(), random.random(), random.random());
        let mut texel = |i: usize, size: f32| {
            let (x, y) = ((i % SIDE) as f32, (i / SIDE % SIDE) as f32);
            let smooth = (0.1 * (k + 1) as f32 * (a * x + b * y) + 3.0 * c).cos();
            let edge = if x > 20.0 * a + 0.5 * y { 1.0 } else { 0.4 };
            size * (smooth * edge + 0.05 * (random.random::<f32>() - 0.5))
        };
        let size = 0.5f32.powi(k as i32);
        let colour = [1.0, 0.5 + 0.4 * c, 0.3 + 0.2 * a];
        block.left.extend((0..ROWS).map(|i| texel(i, colour[i / COLUMNS] / 32.0)));
        block.right.extend((0..COLUMNS).map(|i| texel(i, size)));
    }
    block
}

/// Relative error of the factors' product in the Frobenius norm.
fn error(a: &FactoredBlock, b: &FactoredBlock) -> f64 {
    let (a, b) = (a.expand(), b.expand());
    let pairs = || a.entries().iter().zip(b.entries()).map(|(&a, &b)| (f64::from(a), f64::from(b)));
    (pairs().map(|(a, b)| (a - b).powi(2)).sum::<f64>() / pairs().map(|(_, b)| b * b).sum::<f64>()).sqrt()
}

/// Factors as 8- or 16-bit numbers with a scale for each component, byte-shuffled, through zstd: what the codec is held
/// against. Gives the bytes and what they decode to.
fn plain(block: &FactoredBlock, bits: u32) -> (usize, FactoredBlock) {
    let (mut low, mut high, mut decoded) = (Vec::new(), Vec::new(), block.clone());
    let limit = ((1 << (bits - 1)) - 1) as f32;
    let sides = decoded.left.chunks_exact_mut(ROWS).chain(decoded.right.chunks_exact_mut(COLUMNS));
    for values in sides {
        let scale = values.iter().fold(0.0f32, |m, v| m.max(v.abs())) / limit;
        for value in values {
            let q = (*value / scale).round();
            *value = q * scale;
            low.push((q as i32) as u8);
            high.push((q as i32 >> 8) as u8);
        }
    }
    if bits > 8 {
        low.extend(high);
    }
    let packed = zstd::bulk::compress(&low, 9).expect("compressing into memory cannot fail");
    (packed.len() + 8 * RANK, decoded)
}

fn codec(criterion: &mut Criterion) {
    let (layout, block) = (layout(), block());
    let raw = ROWS * COLUMNS * 4;
    let factors = (4 * RANK * (ROWS + COLUMNS)) as u64;
    let say = |name: &str, bytes: usize, decoded: &FactoredBlock| {
        let (ratio, error) = (raw as f64 / bytes as f64, error(decoded, &block));
        eprintln!(
            "{name}: {bytes} bytes, {ratio:.0}× ({ROWS} rows × {COLUMNS} columns, rank {RANK}, block {SIDE}), relative L2 {error:.1e}"
        );
    };
    for bits in [16, 8] {
        let (bytes, decoded) = plain(&block, bits);
        say(&format!("int{bits}, shuffled, zstd"), bytes, &decoded);
    }
    let mut group = criterion.benchmark_group("container");
    group.throughput(Throughput::Bytes(factors)).sample_size(20);
    for relative in [1e-3f32, 1e-2, 3e-2] {
        let mut block = block.clone();
        // Equal error on both sides: a step relative to the first component's size.
        block.left_step = (0..RANK).map(|k| relative * 2.0f32.powi(k as i32) / 32.0).collect();
        block.right_step = vec![relative; RANK];
        let settings = CodecSettings::default();
        let encode = || encode_layer(&layout, &block, LayerPart::default(), &settings).expect("the block is finite");
        let bytes = encode();
        say(&format!("cosine transform, steps {relative}"), bytes.len(), &decode_layer(&layout, &bytes, None).unwrap());
        group.bench_function(format!("encode/{relative}"), |b| b.iter(|| black_box(encode())));
        group.bench_function(format!("decode/{relative}"), |b| {
            b.iter(|| black_box(decode_layer(&layout, black_box(&bytes), None).expect("the bytes are sound")));
        });
    }
}

criterion_group!(benches, codec);
criterion_main!(benches);
