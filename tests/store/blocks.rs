//! Hand-made jobs and blocks.

use ltm::light::{Clusters, Job, Light, LightBasis, LightKind, Provenance};
use ltm::matrix::{
    BlockId, BlockNoise, BlockPlanes, BlockSink, BlockSource, CHANNELS, Feature, MatrixShape, SeenEmission, TracedBlock,
};
use ltm::store::{Storage, StoreOptions, StoreReader};

/// A small job with a smaller block at each edge: 20 × 11 pixels in blocks of 8, 3 × 2 blocks.
pub(crate) fn job(columns: u32) -> Job {
    job_of(20, 11, columns, 8)
}

pub(crate) fn job_of(width: u32, height: u32, columns: u32, block_side: u32) -> Job {
    let mut basis = LightBasis::new();
    let light = Light::unplaced("panel", LightKind::AreaTexels { across: columns, down: 1 });
    basis.push(light).unwrap();
    let shape = MatrixShape::new(width, height, columns, block_side).unwrap();
    Job { shape, basis, provenance: Provenance { source: "hand-made".into(), seed: 7, ..Default::default() } }
}

/// A block that depends on `id` alone: some with every column, some with gaps, block 3 all zero; noise of three kinds.
pub(crate) fn block(job: &Job, id: BlockId) -> TracedBlock {
    let (rows, columns) = (job.shape.rect(id).rows(), job.shape.columns());
    let mut traced = TracedBlock::default();
    traced.block.reset(rows, columns);
    let mut state = u64::from(id.0).wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    for (c, column) in traced.block.entries_mut().chunks_exact_mut(rows).enumerate() {
        let is_zero = match id.0 % 4 {
            0 => false,
            1 => c % 3 == 1,
            2 => c == 0 || c + 1 == columns,
            _ => true,
        };
        if !is_zero {
            column.iter_mut().for_each(|entry| *entry = next());
        }
    }
    let probes = 2;
    traced.noise = match id.0 % 4 {
        1 => None,
        3 => Some(BlockNoise {
            row_variance: vec![0.0; rows],
            column_variance: vec![0.0; columns],
            probes: vec![0.0; rows * probes],
        }),
        _ => Some(BlockNoise {
            row_variance: (0..rows).map(|_| next()).collect(),
            column_variance: (0..columns).map(|_| next()).collect(),
            probes: (0..rows * probes).map(|_| next() - 0.5).collect(),
        }),
    };
    // Of every kind of block but one: also of the one that is zero.
    let clusters = Clusters::of_basis(&job.basis).count();
    traced.planes = (id.0 % 4 != 2).then(|| planes(rows / CHANNELS, columns, clusters, &mut next));
    traced
}

/// Planes with four emitters in view, fewer where there are not as many pixels and columns.
fn planes(pixels: usize, columns: usize, clusters: usize, next: &mut impl FnMut() -> f32) -> BlockPlanes {
    let mut planes = BlockPlanes::default();
    planes.reset(pixels, clusters);
    // The planes that earlier versions do not know are drawn last, so that all else is what its golden file holds.
    let known = Feature::Material.planes().start * pixels;
    planes.features[..known].iter_mut().for_each(|value| *value = next() - 0.5);
    let light = planes.direct.iter_mut().chain(&mut planes.indirect).flatten();
    light.chain(&mut planes.feature_variance[..known]).for_each(|value| *value = next());
    let mut seen = |pixel: usize, column: usize| {
        let value = [next(), next(), next()];
        SeenEmission { pixel: pixel as u32, column: column as u32, value }
    };
    planes.emission = vec![seen(0, 0), seen(pixels / 2, 0), seen(pixels / 2, columns - 1), seen(pixels - 1, 0)];
    planes.emission.dedup_by_key(|seen| (seen.pixel, seen.column));
    for later in [Feature::Material, Feature::PixelAlbedo].map(Feature::planes) {
        let later = later.start * pixels..later.end * pixels;
        let (means, variances) = (&mut planes.features[later.clone()], &mut planes.feature_variance[later]);
        means.iter_mut().chain(variances).for_each(|value| *value = next());
    }
    planes.round();
    planes
}

pub(crate) fn write_all(job: &Job, sink: &impl BlockSink) {
    job.shape.blocks().for_each(|id| sink.write_block(id, &block(job, id)).unwrap());
}

pub(crate) fn options() -> StoreOptions {
    StoreOptions { max_probes: 2, planes: true, ..StoreOptions::default() }
}

pub(crate) fn read(reader: &StoreReader<impl Storage>, id: BlockId) -> ltm::Result<TracedBlock> {
    let mut target = TracedBlock::default();
    reader.read_block(id, &mut target).map(|()| target)
}
