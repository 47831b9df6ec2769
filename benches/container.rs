//! The codec of containers against its rivals, and the container as a file: bytes, error and speed beside each other.
//!
//! The blocks are real ones, of the five built-in scenes (64 × 64 pixels, so four blocks of 3,072 rows; a light of 32 × 32
//! texels, 1,024 columns, or an environment of 512; 1,024 samples per pixel, so that they are not noise), compressed for the
//! default target, which the noise stops, and for a lower one. Error is that of images relit under the 16 probe lightings
//! against the unquantised factors; a rival's bytes are those at which it has this codec's error, between two of its steps.
//! Speed counts decoded factors in f32, one thread. The tables are printed before the timings.

mod figures;
#[path = "container/rivals.rs"]
mod rivals;

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use figures::Figures;
use ltm::compress::{CompressSettings, Compressor, Target};
use ltm::container::codec::{CodecSettings, LayerPart, decode_layer, encode_layer};
use ltm::container::{BlockLayout, ContainerOptions, ContainerReader, ContainerWriter};
use ltm::image::LinearImage;
use ltm::light::Job;
use ltm::matrix::BlockReport;
use ltm::matrix::{BlockId, BlockSource, FactorSource, FactoredBlock, MatrixShape, TracedBlock};
use ltm::pipeline::{PackOptions, RenderOptions};
use ltm::resources::NoProgress;
use ltm::scene::{BUILT_IN_NAMES, BuiltIn};
use ltm::store::StoreReader;
use rivals::{Packing, Transform};

/// PSNR of relit images that the blocks are compressed for, in dB.
const TARGETS_DB: [f64; 2] = [30.0, 45.0];
/// By how much the steps of rivals are coarser than the block's, to find the same error.
const COARSENESS: [f32; 8] = [0.25, 0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83];
/// Texels of a light in a row.
const ACROSS: usize = 32;
/// Samples per pixel of the scenes.
const SAMPLES: u32 = 1024;
/// Name of what is timed on the large container; given alone, nothing else is run.
const OPEN: &str = "container/open";
/// Size of the large container.
const LARGE_BYTES: usize = 1 << 30;

/// Renders 64 × 64 pixels of a built-in scene.
fn matrix(folder: &Path, name: &str, samples_per_pixel: u32) -> StoreReader {
    let mut loaded =
        BuiltIn { width: 64, height: 64, ..BuiltIn::default() }.named(name).expect("the scene is built in");
    loaded.settings.samples_per_pixel = samples_per_pixel;
    let path = folder.join(format!("{name}.ltm"));
    ltm::pipeline::render(loaded, &path, &RenderOptions::default(), &NoProgress).expect("the scene renders");
    StoreReader::open(&path).expect("the matrix is there")
}

/// The factors and sparse entries of all blocks for a target, with the steps that it allows.
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
            traced.divide_columns(job.basis.column_scales());
            compressor.analyse(id, traced.block.view(), traced.noise.as_ref())
        })
        .collect();
    let cut = compressor.choose(candidates.iter().map(|candidate| candidate.summary()));
    candidates.iter().map(|candidate| candidate.cut(&cut)).collect()
}

/// The rows of a block under lightings, columns × lightings, one after the other.
fn relit(block: &FactoredBlock, lightings: &[f32]) -> Vec<f32> {
    let mut all = Vec::new();
    for lighting in lightings.chunks_exact(block.columns) {
        let mut rows = vec![0.0f32; block.rows];
        for k in 0..block.rank() {
            let through: f32 = block.right_component(k).iter().zip(lighting).map(|(r, w)| r * w).sum();
            rows.iter_mut().zip(block.left_component(k)).for_each(|(row, left)| *row += left * through);
        }
        for entry in &block.sparse {
            rows[entry.row as usize] += entry.value * lighting[entry.column.index()];
        }
        all.extend(rows);
    }
    all
}

/// Relative L2 error of images relit from decoded blocks.
fn error(decoded: &[FactoredBlock], blocks: &[FactoredBlock], lightings: &[f32]) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    for (decoded, block) in decoded.iter().zip(blocks) {
        for (a, b) in relit(decoded, lightings).iter().zip(relit(block, lightings)) {
            difference += f64::from(a - b).powi(2);
            norm += f64::from(b).powi(2);
        }
    }
    (difference / norm).sqrt()
}

/// Bytes at an error, between two measured points on logarithmic scales; none outside them.
fn bytes_at(error: f64, points: &[(f64, usize)]) -> Option<f64> {
    points.windows(2).find_map(|pair| {
        let [(e0, b0), (e1, b1)] = [pair[0], pair[1]].map(|(error, bytes)| (error.ln(), (bytes as f64).ln()));
        let share = (error.ln() - e0) / (e1 - e0);
        (0.0..=1.0).contains(&share).then(|| (b0 + share * (b1 - b0)).exp())
    })
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

fn compare(job: &Job, blocks: &[FactoredBlock], title: &str, figures: &mut Figures) {
    let blocks: Vec<_> = blocks.iter().map(|block| FactoredBlock { sparse: vec![], ..block.clone() }).collect();
    let factor_bytes: usize = blocks.iter().map(|b| 4 * (b.left.len() + b.right.len())).sum();
    let rank: usize = blocks.iter().map(FactoredBlock::rank).sum();
    let probes = ltm::light::probe_lightings(&job.basis);
    eprintln!(
        "\n{title}: {} blocks of 3072 rows × {} columns, ranks together {rank}, factors {factor_bytes} bytes in f32",
        blocks.len(),
        job.shape.columns()
    );
    let layouts: Vec<_> = job.shape.blocks().map(|id| BlockLayout::of(job, id)).collect();
    let settings = CodecSettings::default();
    let encode = |i: usize| encode_layer(&layouts[i], &blocks[i], LayerPart::default(), &settings).expect("finite");
    let begun = Instant::now();
    let coded: Vec<_> = (0..blocks.len()).map(encode).collect();
    let encode_secs = begun.elapsed().as_secs_f64();
    let decode = |i: usize| decode_layer(&layouts[i], &coded[i], None).expect("the bytes are sound");
    let secs = best_secs(|| (0..coded.len()).for_each(|i| drop(black_box(decode(i)))));
    let decoded: Vec<_> = (0..coded.len()).map(decode).collect();
    let (bytes, wanted) = (coded.iter().map(Vec::len).sum::<usize>() as f64, error(&decoded, &blocks, &probes));
    let speed = |secs: f64| format!("{:.2} GB/s", factor_bytes as f64 / secs / 1e9);
    eprintln!("{:<36} {:>8} {:>8} {:>12} {:>10}", "coding", "bytes", "of ours", "relit error", "decode");
    let packed = factor_bytes as f64 / encode_secs / 1e9;
    eprintln!(
        "{:<36} {bytes:>8.0} {:>8} {wanted:>12.2e} {:>10}, encode {packed:.3} GB/s",
        "this codec",
        "",
        speed(secs)
    );
    figures.add(title, "encoded_gb_per_s", packed);
    figures.add(title, "decoded_gb_per_s", factor_bytes as f64 / secs / 1e9);
    for (name, bits, packing) in
        [("16 bits, scaled, shuffled, zstd", 16, Packing::Shuffled), ("8 bits, scaled, zstd", 8, Packing::Plain)]
    {
        let coded: Vec<_> = blocks.iter().map(|block| rivals::scaled(block, bits, packing)).collect();
        let bytes: usize = coded.iter().map(|(bytes, _)| bytes).sum();
        let decoded: Vec<_> = coded.into_iter().map(|(_, decoded)| decoded).collect();
        eprintln!("{name:<36} {bytes:>8} {:>8} {:>12.2e}", "", error(&decoded, &blocks, &probes));
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
        // The first block has no neighbour before it.
        let plain =
            |i: usize| if i == 0 && transform == Transform::NeighbourCosine { Transform::Cosine } else { transform };
        let mut points: Vec<(f64, usize)> = Vec::new();
        let mut secs = f64::MAX;
        for coarseness in COARSENESS {
            let block = |i: usize| rivals::coarser(&blocks[i], coarseness);
            let coded: Vec<_> = (0..blocks.len())
                .map(|i| rivals::encode(&block(i), &blocks[i.saturating_sub(1)], plain(i), packing))
                .collect();
            let decoded: Vec<_> = coded.iter().map(rivals::decode).collect();
            points.push((error(&decoded, &blocks, &probes), coded.iter().map(rivals::Packed::bytes).sum()));
            if coarseness == 1.0 {
                secs = best_secs(|| coded.iter().for_each(|packed| drop(black_box(rivals::decode(packed)))));
            }
        }
        match bytes_at(wanted, &points) {
            Some(theirs) => {
                let ratio = format!("{:.2}×", theirs / bytes);
                figures.add(&format!("{title}: {name}"), "bytes_over_ours", theirs / bytes);
                eprintln!("{name:<36} {theirs:>8.0} {ratio:>8} {wanted:>12.2e} {:>10}", speed(secs));
            }
            None => eprintln!("{name:<36} {:>8} {:>8} {:>12} {:>10}", "-", "", "not reached", speed(secs)),
        }
    }
}

/// Lightings of one kind, columns × lightings, one after the other.
type Lightings = (&'static str, Vec<f32>);

/// What the beginning of a file is looked at under. All lights on is what the first component of each block is made for;
/// the others have their light from one side or place: two halves across and two down, a sixteenth at each place, and
/// single texels.
fn lightings(columns: usize) -> [Lightings; 4] {
    let down = columns / ACROSS;
    let lit = |is_on: &dyn Fn(usize, usize) -> bool| -> Vec<f32> {
        (0..columns).map(|column| f32::from(u8::from(is_on(column % ACROSS, column / ACROSS)))).collect()
    };
    let halves = [
        lit(&|x, _| x < ACROSS / 2),
        lit(&|x, _| x >= ACROSS / 2),
        lit(&|_, y| y < down / 2),
        lit(&|_, y| y >= down / 2),
    ];
    let places = || (0..16).map(|i| (i % 4, i / 4));
    let spots = places().map(|(i, j)| lit(&|x, y| x * 4 / ACROSS == i && y * 4 / down == j));
    let singles = places().map(|(i, j)| lit(&|x, y| x == (2 * i + 1) * ACROSS / 8 && y == (2 * j + 1) * down / 8));
    [
        ("all_on", vec![1.0; columns]),
        ("half", halves.concat()),
        ("spot", spots.collect::<Vec<_>>().concat()),
        ("single", singles.collect::<Vec<_>>().concat()),
    ]
}

/// The pixels of blocks one after the other, for what does not ask where they are.
#[derive(Clone, Default)]
struct Pixels(Vec<[f32; 3]>);

impl Pixels {
    /// Of a block's rows, channel by channel.
    fn push(&mut self, rows: &[f32]) {
        let (red, rest) = rows.split_at(rows.len() / 3);
        let (green, blue) = rest.split_at(red.len());
        self.0.extend(red.iter().zip(green).zip(blue).map(|((&red, &green), &blue)| [red, green, blue]));
    }

    fn image(self) -> LinearImage {
        LinearImage { width: self.0.len() as u32, height: 1, pixels: self.0 }
    }
}

/// PSNR of an image against the truth, exposed and clipped; none where that has no white, since less than a twentieth of it is lit.
fn clip_decibels(image: &LinearImage, truth: &LinearImage) -> Option<f64> {
    let lit = truth.luminances().filter(|luminance| *luminance > 0.0).count();
    (20 * lit > truth.pixels.len()).then(|| ltm::image::compare(image, truth).psnr_clipped)
}

/// What the beginning of a container shows, against the whole of it: both against the matrix, the mean over the lightings of
/// a kind.
fn first_image(matrix: &StoreReader, folder: &Path, title: &str, figures: &mut Figures) {
    let (job, path) = (matrix.job(), folder.join("packed.ltc"));
    let mut options = PackOptions { allow_lost_lights: true, denoise: true, ..PackOptions::default() };
    options.container.overwrite = true;
    ltm::pipeline::pack(matrix, job, &path, &options, &NoProgress).expect("there is room");
    let packed = ContainerReader::open(&path).expect("the file is sound");
    let (share, bytes) = (packed.base_bytes() as f64 / packed.file_bytes() as f64, packed.file_bytes());
    eprintln!("{title}: clipped at white, from {:.1} % of the file and from all {bytes} bytes", 100.0 * share);
    figures.add(title, "base_share", share);
    let columns = job.shape.columns();
    for (kind, lightings) in lightings(columns) {
        let count = lightings.len() / columns;
        let [mut truth, mut base, mut whole] = [(); 3].map(|()| vec![Pixels::default(); count]);
        let mut traced = TracedBlock::default();
        for id in job.shape.blocks() {
            matrix.read_block(id, &mut traced).expect("the block is there");
            let rows = traced.block.rows();
            for (truth, lighting) in truth.iter_mut().zip(lightings.chunks_exact(columns)) {
                let mut sums = vec![0.0f32; rows];
                for (column, weight) in traced.block.entries().chunks_exact(rows).zip(lighting) {
                    sums.iter_mut().zip(column).for_each(|(row, value)| *row += weight * value);
                }
                truth.push(&sums);
            }
            let layers = [packed.read_layers(id, 0..1), packed.read_block(id)];
            for (layers, images) in layers.into_iter().zip([&mut base, &mut whole]) {
                let relit = relit(&layers.expect("the file is sound"), &lightings);
                images.iter_mut().zip(relit.chunks_exact(rows)).for_each(|(image, rows)| image.push(rows));
            }
        }
        let [truth, base, whole] = [truth, base, whole].map(|of| of.into_iter().map(Pixels::image).collect::<Vec<_>>());
        // Some places of a sky light nothing that is in view.
        let mean = |images: &[LinearImage]| {
            let each: Vec<f64> =
                images.iter().zip(&truth).filter_map(|(image, truth)| clip_decibels(image, truth)).collect();
            each.iter().sum::<f64>() / each.len() as f64
        };
        let (base, whole) = (mean(&base), mean(&whole));
        eprintln!("  {kind}, mean of at most {count}: base layers {base:.2} dB, the whole {whole:.2} dB");
        figures.add(title, &format!("{kind}_base_clip_db"), base);
        figures.add(title, &format!("{kind}_whole_clip_db"), whole);
    }
}

fn codec(criterion: &mut Criterion) {
    large_file(criterion);
    if std::env::args().any(|argument| argument == OPEN) {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let matrices = BUILT_IN_NAMES.map(|name| (name, matrix(folder.path(), name, SAMPLES)));
    let mut figures = Figures::new("bench-container", &[], "cargo bench --bench container");
    for (name, matrix) in &matrices {
        for decibels in TARGETS_DB {
            compare(matrix.job(), &factors(matrix, decibels), &format!("{name} at {decibels} dB"), &mut figures);
        }
        first_image(matrix, folder.path(), name, &mut figures);
    }
    figures.write();
    eprintln!();
    let mut group = criterion.benchmark_group("container");
    group.sample_size(20);
    let (_, matrix) = &matrices[0];
    for decibels in [30.0, 45.0, 60.0] {
        let block = &FactoredBlock { sparse: vec![], ..factors(matrix, decibels).swap_remove(2) };
        let layout = BlockLayout::of(matrix.job(), BlockId(2));
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
    let matrix = matrix(folder.path(), "mixed", 64);
    let (job, block) = (matrix.job(), &FactoredBlock { sparse: vec![], ..factors(&matrix, 60.0).swap_remove(2) });
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
