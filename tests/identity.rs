//! Versions of the algorithms: what the tracer and the compressor make does not change unless their number does.
//!
//! A matrix and an interrupted pack are continued, filled in and merged by that number. Where one of these tests fails, raise
//! the number that it names and write the new pair here.

use ltm::compress::{COMPRESSOR_VERSION, CompressSettings, Compressor, Target};
use ltm::container::{ContainerOptions, ContainerWriter};
use ltm::denoise::{
    DENOISER_VERSION, DenoisedRegion, Denoiser, FilterRadii, GuideStatistics, ImageOrigin, ImageRows, Pool, Region,
};
use ltm::light::Job;
use ltm::matrix::{BlockId, ColumnIndex, FactoredBlock, SparseEntry, TracedBlock};
use ltm::pipeline::job_of;
use ltm::scene::BuiltIn;
use ltm::trace::{TRACER_VERSION, TraceSettings, Tracer};
use sha2::{Digest, Sha256};

/// Version of the tracer, and the checksum of what it makes of the rooms below.
const TRACED: (u32, &str) = (17, "8c64067a5abaecb0");
/// Version of the compressor, and for each block of the rooms the rank and the number of single entries that it keeps. They change
/// with what is traced as well.
const KEPT: (u32, &[(usize, usize)]) =
    (8, &[(2, 9), (3, 229), (1, 0), (1, 0), (2, 0), (1, 0), (11, 190), (3, 289), (3, 0), (5, 0), (5, 0), (2, 0)]);
/// Version of the compressor, and the checksum of the bytes that given factors are encoded to.
const ENCODED: (u32, &str) = (8, "248ea0a512b1e80b");

/// Version of denoising, and what it makes of some pixels of a given window.
const DENOISED: (u32, [f32; 8]) = (23, [0.703_0, 0.603_0, 0.939_0, 0.953_9, 0.163_4, 0.559_5, 0.073_0, 0.655_0]);

/// Two rooms that have between them texelled lights in view, an environment, glass and mirrors; and their blocks.
fn rooms() -> [(Job, Vec<TracedBlock>); 2] {
    ["mixed", "environment"].map(|name| {
        let mut room = BuiltIn { width: 40, height: 24, texels: 8 }.named(name).unwrap();
        room.settings.block_side = 16;
        let job = job_of(&room).unwrap();
        let settings = TraceSettings { samples_per_pixel: 8, seed: 1, max_depth: 5 };
        let tracer = Tracer::new(room.scene, job.shape, settings).unwrap();
        let block = |id| {
            let mut block = TracedBlock::default();
            tracer.trace_block(id, &mut block);
            block
        };
        let blocks = job.shape.blocks().map(block).collect();
        (job, blocks)
    })
}

fn short(hash: Sha256) -> String {
    hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

/// Sines and logarithms are the system's: elsewhere a last bit may be another.
#[test]
#[cfg_attr(not(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu")), ignore = "made on Linux, x86-64")]
fn what_is_traced_changes_only_with_the_tracers_version() {
    let mut hash = Sha256::new();
    for block in rooms().iter().flat_map(|(_, blocks)| blocks) {
        let noise = block.noise.as_ref().unwrap();
        for values in [block.block.entries(), &noise.row_variance, &noise.column_variance, &noise.probes] {
            hash.update(bytemuck::cast_slice(values));
        }
    }
    assert_eq!(
        (TRACER_VERSION, short(hash).as_str()),
        TRACED,
        "what is traced has changed: raise TRACER_VERSION in src/trace/mod.rs, and write the new pair into TRACED"
    );
}

/// Decisions, not bits: large products are summed in the order of the machine's vectors.
#[test]
fn what_is_kept_changes_only_with_the_compressors_version() {
    let mut found = Vec::new();
    for (job, blocks) in rooms() {
        let settings = CompressSettings { target: Target::PsnrDb(40.0), ..CompressSettings::default() };
        let compressor = Compressor::new(&job.basis, job.shape, settings).unwrap();
        let analyse = |(id, block): (u32, &TracedBlock)| {
            compressor.analyse(BlockId(id), block.block.view(), block.noise.as_ref())
        };
        let candidates: Vec<_> = (0..).zip(&blocks).map(analyse).collect();
        let cut = compressor.choose(candidates.iter().map(|candidate| candidate.summary()));
        found.extend(
            candidates.iter().map(|candidate| candidate.cut(&cut)).map(|kept| (kept.rank(), kept.sparse.len())),
        );
    }
    assert_eq!(
        (COMPRESSOR_VERSION, found.as_slice()),
        KEPT,
        "what is kept has changed: raise COMPRESSOR_VERSION in src/compress/mod.rs, and write the new pair into KEPT"
    );
}

/// To a few ten thousandths, as sums of products are the machine's.
#[test]
fn what_images_are_denoised_to_changes_only_with_the_cleaners_version() {
    const SIZE: (usize, usize) = (24, 16);
    let rows = |planes| ImageRows::zeros(SIZE.0, SIZE.1, planes);
    let [mut direct_light, mut indirect_light] = [rows(12), rows(12)];
    let [mut seen, mut seen_variance] = [rows(10), rows(10)];
    let grain = |i: usize| 0.5 + ((i as u32).wrapping_mul(2_654_435_769) >> 20) as f32 / 4096.0;
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            let floor = y > 9;
            // Of what is beside it one row is the edge: black in part.
            let lit = if y == 5 { (x * 5 % 12) as f32 / 11.0 } else { 1.0 };
            let albedo = lit * if floor { 0.75 } else { 0.5 };
            (0..3).for_each(|plane| seen_variance.row_mut(plane, y)[x] = lit * (1.0 - lit) / 16.0);
            let features = [albedo, albedo, albedo, 0.0, f32::from(floor), f32::from(!floor), 4.0, 0.0, 0.0, 1.0];
            features.iter().enumerate().for_each(|(plane, &value)| seen.row_mut(plane, y)[x] = value);
            for plane in 0..12 {
                // The second cluster leaves a third in shadow.
                let direct = if plane % 6 > 2 && x < 8 { 0.0 } else { albedo };
                let at = (plane * SIZE.1 + y) * SIZE.0 + x;
                direct_light.row_mut(plane, y)[x] = direct * grain(2 * at);
                indirect_light.row_mut(plane, y)[x] = 0.25 * albedo * grain(2 * at + 1);
            }
        }
    }
    let mut tally = GuideStatistics::new(2);
    let halves = |light: &ImageRows| {
        let plane = |plane| (0..SIZE.1).flat_map(move |y| light.row(plane, y).to_vec());
        [0..6, 6..12].map(|planes| planes.flat_map(plane).collect::<Vec<f32>>())
    };
    let (direct, indirect) = (halves(&direct_light), halves(&indirect_light));
    tally.add([&direct[0], &direct[1]], [&indirect[0], &indirect[1]]);
    let (guides, pool) = (tally.guides(), Pool::default());
    let region = Region { x: 0..SIZE.0, y: 0..SIZE.1 };
    let (groups, origin) = (vec![0, 1], ImageOrigin::Traced);
    let all = DenoisedRegion { size: SIZE, block: SIZE.1, region, features: 10, groups, origin };
    let mut denoising = Denoiser::new(all, FilterRadii::of_image(1, 1), &guides, &pool);
    let wanted = denoising.wants().unwrap();
    for strip in denoising.strips(&wanted, &[0]) {
        strip.direct.copy_from_slice(direct_light.values());
        strip.indirect.copy_from_slice(indirect_light.values());
        strip.features.copy_from_slice(seen.values());
        strip.feature_variance.copy_from_slice(seen_variance.values());
    }
    let images = denoising.denoise(&wanted).images;
    let at = [(0, 2, 2), (0, 9, 11), (1, 10, 3), (2, 15, 23), (3, 4, 7), (3, 4, 8), (4, 5, 1), (5, 0, 16)];
    let found = at.map(|(plane, y, x)| images.row(plane, y)[x]);
    let is_same = DENOISER_VERSION == DENOISED.0 && found.iter().zip(DENOISED.1).all(|(a, b)| (a - b).abs() < 2e-4);
    assert!(
        is_same,
        "{DENOISER_VERSION}, {found:?}: what images are denoised to has changed: raise DENOISER_VERSION in src/denoise/mod.rs, \
         and write the new pair into DENOISED"
    );
}

#[test]
fn what_factors_are_encoded_to_changes_only_with_the_compressors_version() {
    let (job, _) = rooms().into_iter().next().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let writer = ContainerWriter::create(&folder.path().join("a.ltc"), &job, ContainerOptions::default()).unwrap();
    let mut hash = Sha256::new();
    for id in job.shape.blocks() {
        let even = factors(job.shape.rect(id).rows(), job.shape.columns(), id.0);
        // The ten zones of the panel.
        let finer = FactoredBlock { right_band_steps: [9, 6, 3, 1, 0, 0, 0, 0, 0, 0].into(), ..even.clone() };
        for block in [even, finer] {
            writer.encode(id, &block).unwrap().layers().iter().for_each(|layer| hash.update(layer));
        }
    }
    assert_eq!(
        (COMPRESSOR_VERSION, short(hash).as_str()),
        ENCODED,
        "encoded bytes have changed: raise COMPRESSOR_VERSION in src/compress/mod.rs, and write the new pair into ENCODED"
    );
}

/// Five smooth components of falling size with some grain, and a few single entries.
fn factors(rows: usize, columns: usize, seed: u32) -> FactoredBlock {
    let grain = |i: usize| (((i as u32 ^ seed).wrapping_mul(2_654_435_769) >> 20) as f32 / 4096.0 - 0.5) * 0.125;
    let wave = |i: usize, k: usize, of: usize| {
        let t = (i * (k + 1)) as f32 / of as f32;
        // A triangle: additions alone, the same everywhere.
        4.0 * (t - (t + 0.5).floor()).abs() - 1.0
    };
    let mut block = FactoredBlock { rows, columns, ..Default::default() };
    for k in 0..5 {
        let size = 1.0 / (1 << k) as f32;
        block.left.extend((0..rows).map(|i| (wave(i, k, rows) + grain(i + k)) / 16.0));
        block.right.extend((0..columns).map(|j| size * (wave(j, k, columns) + grain(j + 7 * k))));
        block.left_step.push(0.004 / size);
        block.right_step.push(0.01);
    }
    block.sparse = (0..6)
        .map(|i| SparseEntry { column: ColumnIndex(i * 9), row: (11 * i + seed) % rows as u32, value: 3.0 + i as f32 })
        .collect();
    block
}
