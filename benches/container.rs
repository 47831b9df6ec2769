//! The codec of containers against its rivals, and the container as a file: bytes, error and speed beside each other.
//!
//! The blocks are real ones: four neighbours of the built-in room (32 × 32 pixels, so 3,072 rows; a light of 32 × 32 texels,
//! 1,024 columns; 64 samples per pixel), compressed for three targets. Speed counts decoded factors in f32, one thread.
//! The tables are printed before the timings.

#[path = "container/rivals.rs"]
mod rivals;

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ltm::compress::{CompressSettings, Compressor, Target};
use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, BlockReport, ContainerOptions, ContainerReader, ContainerWriter};
use ltm::light::Job;
use ltm::matrix::{BlockId, BlockSource, FactoredBlock, MatrixShape, TracedBlock};
use ltm::pipeline::{Quiet, RenderOptions};
use ltm::store::StoreReader;
use rivals::{Packing, Transform};

/// PSNR of relit images that the blocks are compressed for, in dB.
const TARGETS_DB: [f64; 3] = [40.0, 50.0, 60.0];
/// Name of what is timed on the large container; given alone, nothing else is run.
const OPEN: &str = "container/open";
/// Size of the large container.
const LARGE_BYTES: usize = 1 << 30;

/// Renders 64 × 64 pixels of the built-in room.
fn matrix(folder: &std::path::Path) -> StoreReader {
    let mut loaded = ltm::scene::built_in();
    (loaded.scene.camera.width, loaded.scene.camera.height) = (64, 64);
    loaded.settings.samples_per_pixel = 64;
    let path = folder.join("room.ltm");
    ltm::pipeline::render(loaded, &path, &RenderOptions::default(), &Quiet).expect("the room renders");
    StoreReader::open(&path).expect("the matrix is there")
}

/// The factors of all blocks for a target, with the steps that it allows.
fn factors(matrix: &StoreReader, decibels: f64) -> Vec<FactoredBlock> {
    let job = matrix.job();
    let settings = CompressSettings { target: Target::PsnrDb(decibels), ..Default::default() };
    let compressor = Compressor::new(&job.basis, job.shape, settings).expect("the settings are sound");
    let mut traced = TracedBlock::default();
    let candidates: Vec<_> = job
        .shape
        .blocks()
        .map(|id| {
            matrix.read_block(id, &mut traced).expect("the block is there");
            compressor.analyse(id, traced.block.view(), traced.noise.as_ref())
        })
        .collect();
    let cut = compressor.choose(candidates.iter().map(|candidate| candidate.summary()));
    candidates.iter().map(|candidate| FactoredBlock { sparse: vec![], ..candidate.cut(&cut) }).collect()
}

/// Relative error of the factors' product in the Frobenius norm.
fn error(pairs: &[(FactoredBlock, &FactoredBlock)]) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    for (decoded, block) in pairs {
        let (a, b) = (decoded.expand(), block.expand());
        for (a, b) in a.entries().iter().zip(b.entries()) {
            difference += f64::from(a - b).powi(2);
            norm += f64::from(*b).powi(2);
        }
    }
    (difference / norm).sqrt()
}

/// Best seconds of many runs.
fn best_secs(work: impl Fn()) -> f64 {
    (0..40)
        .map(|_| {
            let begun = Instant::now();
            work();
            begun.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min)
}

fn compare(job: &Job, blocks: &[FactoredBlock], decibels: f64) {
    let factor_bytes: usize = blocks.iter().map(|b| 4 * (b.left.len() + b.right.len())).sum();
    let raw: usize = blocks.iter().map(|b| 4 * b.rows * b.columns).sum();
    let rank: usize = blocks.iter().map(FactoredBlock::rank).sum();
    eprintln!(
        "\n{decibels} dB: {} blocks of 3072 rows × 1024 columns, ranks together {rank}, factors {factor_bytes} bytes in f32",
        blocks.len()
    );
    eprintln!("{:<34} {:>8} {:>8} {:>12} {:>10}", "coding", "bytes", "ratio", "relative L2", "decode");
    let say = |name: &str, bytes: usize, error: f64, secs: Option<f64>| {
        let speed = secs.map_or("-".into(), |s| format!("{:.2} GB/s", factor_bytes as f64 / s / 1e9));
        eprintln!("{name:<34} {bytes:>8} {:>7.0}× {error:>12.2e} {speed:>10}", raw as f64 / bytes as f64);
    };
    for (name, bits, packing) in [
        ("16 bits, scaled, zstd", 16, Packing::Plain),
        ("16 bits, scaled, shuffled, zstd", 16, Packing::Shuffled),
        ("8 bits, scaled, zstd", 8, Packing::Plain),
    ] {
        let coded: Vec<_> = blocks.iter().map(|block| rivals::scaled(block, bits, packing)).collect();
        let bytes = coded.iter().map(|(bytes, _)| bytes).sum();
        let pairs: Vec<_> = coded.into_iter().map(|(_, decoded)| decoded).zip(blocks).collect();
        say(name, bytes, error(&pairs), None);
    }
    for (name, transform, packing) in [
        ("steps, zstd", Transform::None, Packing::Plain),
        ("steps, shuffled, zstd", Transform::None, Packing::Shuffled),
        ("steps, bit planes, zstd", Transform::None, Packing::Planes),
        ("wavelet 9/7, steps, shuffled, zstd", Transform::Wavelet, Packing::Shuffled),
        ("wavelet 9/7, steps, planes, zstd", Transform::Wavelet, Packing::Planes),
        ("DCT, steps, shuffled, zstd", Transform::Cosine, Packing::Shuffled),
        ("DCT, steps, planes, zstd", Transform::Cosine, Packing::Planes),
        ("neighbour, DCT, shuffled, zstd", Transform::NeighbourCosine, Packing::Shuffled),
    ] {
        let neighbour = |i: usize| &blocks[i.saturating_sub(1)];
        // The first block has no neighbour before it.
        let plain =
            |i: usize| if i == 0 && transform == Transform::NeighbourCosine { Transform::Cosine } else { transform };
        let coded: Vec<_> =
            blocks.iter().enumerate().map(|(i, b)| rivals::encode(b, neighbour(i), plain(i), packing)).collect();
        let secs = best_secs(|| coded.iter().for_each(|packed| drop(black_box(rivals::decode(packed)))));
        let pairs: Vec<_> = coded.iter().map(rivals::decode).zip(blocks).collect();
        say(name, coded.iter().map(rivals::Packed::bytes).sum(), error(&pairs), Some(secs));
    }
    let layouts: Vec<_> = job.shape.blocks().map(|id| BlockLayout::of(job, id)).collect();
    for (name, lambda) in [("this codec, nearest step", 0.0), ("this codec", CodecSettings::default().lambda)] {
        let settings = CodecSettings { lambda, ..Default::default() };
        let coded: Vec<_> = blocks
            .iter()
            .zip(&layouts)
            .map(|(b, layout)| encode_layer(layout, b, LayerPart::default(), &settings).expect("the block is finite"))
            .collect();
        let decode = |i: usize| decode_layer(&layouts[i], &coded[i], None).expect("the bytes are sound");
        let secs = best_secs(|| (0..coded.len()).for_each(|i| drop(black_box(decode(i)))));
        let pairs: Vec<_> = (0..coded.len()).map(decode).zip(blocks).collect();
        say(name, coded.iter().map(Vec::len).sum(), error(&pairs), Some(secs));
    }
}

fn codec(criterion: &mut Criterion) {
    large_file(criterion);
    if std::env::args().any(|argument| argument == OPEN) {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let matrix = matrix(folder.path());
    let job = matrix.job();
    for decibels in TARGETS_DB {
        compare(job, &factors(&matrix, decibels), decibels);
    }
    eprintln!();
    let mut group = criterion.benchmark_group("container");
    group.sample_size(20);
    for decibels in TARGETS_DB {
        let block = &factors(&matrix, decibels)[2];
        let layout = BlockLayout::of(job, BlockId(2));
        let encode = || encode_layer(&layout, block, LayerPart::default(), &CodecSettings::default()).expect("finite");
        let bytes = encode();
        group.throughput(Throughput::Bytes(4 * (block.left.len() + block.right.len()) as u64));
        group.bench_function(format!("encode/{decibels}dB"), |b| b.iter(|| black_box(encode())));
        group.bench_function(format!("decode/{decibels}dB"), |b| {
            b.iter(|| black_box(decode_layer(&layout, black_box(&bytes), None).expect("the bytes are sound")));
        });
    }
    group.finish();
}

/// A container of a gigabyte, of one block again and again: written, and opened.
fn large_file(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let matrix = matrix(folder.path());
    let (job, block) = (matrix.job(), &factors(&matrix, 60.0)[2]);
    let path = folder.path().join("large.ltc");
    let layout = BlockLayout::of(job, BlockId(0));
    let bytes = encode_layer(&layout, block, LayerPart::default(), &CodecSettings::default()).expect("finite").len();
    let side = ((LARGE_BYTES / bytes) as f64).sqrt().ceil().min(2048.0) as u32;
    let shape = MatrixShape::new(32 * side, 32 * side, job.shape.columns() as u32, 32).expect("the shape is possible");
    let job = Job { shape, ..job.clone() };
    let begun = Instant::now();
    let writer = ContainerWriter::create(&path, &job, ContainerOptions::default()).expect("the folder can be written");
    let encoded = writer.encode(BlockId(0), block).expect("the block is finite");
    for id in shape.blocks() {
        writer.write_encoded(id, &encoded, &BlockReport::default()).expect("there is room");
    }
    let summary = writer.finish().expect("there is room");
    let secs = begun.elapsed().as_secs_f64();
    eprintln!(
        "container of {} blocks, {:.2} GB: written and sealed in {secs:.1} s, {:.2} GB/s (every byte twice, with fsync)",
        summary.blocks,
        summary.file_bytes as f64 / 1e9,
        summary.file_bytes as f64 / secs / 1e9
    );
    criterion.bench_function(OPEN, |b| {
        b.iter(|| black_box(ContainerReader::open(&path).expect("the file is sound")));
    });
}

criterion_group! { name = benches; config = Criterion::default().without_plots(); targets = codec }
criterion_main!(benches);
