//! Algorithms 1–4 over the whole matrix: what they choose and keep, however many blocks and threads there are.

use std::sync::atomic::{AtomicU32, Ordering};

use ltm::Result;
use ltm::compress::{CompressSettings, Compressor, CompressorPlan, Core, Method, PriorChoice, Scope, Target};
use ltm::light::{Light, LightBasis, LightKind};
use ltm::matrix::{Block, BlockId, BlockSource, MatrixShape, TracedBlock};

const ALGORITHMS: [Method; 4] = [Method::Algorithm1, Method::Algorithm2, Method::Algorithm3, Method::Algorithm4];
const SIDE: u32 = 8;

fn panel() -> LightBasis {
    let mut basis = LightBasis::new();
    let light = Light::unplaced("panel", LightKind::AreaTexels { across: SIDE, down: SIDE });
    basis.push(light).unwrap();
    basis
}

/// A floor below the panel with a shadow edge, made when it is read.
struct Floor {
    shape: MatrixShape,
    broken: bool,
    reads: AtomicU32,
}

impl Floor {
    fn new(width: u32, height: u32, block_side: u32) -> Self {
        let shape = MatrixShape::new(width, height, SIDE * SIDE, block_side).unwrap();
        Self { shape, broken: false, reads: AtomicU32::new(0) }
    }

    fn entry(&self, x: u32, y: u32, channel: usize, column: usize) -> f32 {
        let (x, y) = (x as f32 / self.shape.width() as f32, y as f32 / self.shape.height() as f32);
        let (u, v) = ((column as u32 % SIDE) as f32 / SIDE as f32, (column as u32 / SIDE) as f32 / SIDE as f32);
        let lit = if x + 0.5 * u > 0.8 { 0.2 } else { 1.0 };
        [0.7, 0.5, 0.3][channel] * lit / ((x - u).powi(2) + (y - v).powi(2) + 0.25).powi(2)
    }
}

impl BlockSource for Floor {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let rect = self.shape.rect(id);
        target.block.reset(rect.rows(), self.shape.columns());
        for (i, value) in target.block.entries_mut().iter_mut().enumerate() {
            let (row, column) = (i % rect.rows(), i / rect.rows());
            let (channel, pixel) = (row / rect.pixels(), (row % rect.pixels()) as u32);
            *value = self.entry(rect.x + pixel % rect.width, rect.y + pixel / rect.width, channel, column);
        }
        if self.broken && id.0 == 0 {
            target.block.entries_mut()[5] = f32::NAN;
            target.block.entries_mut()[6] = f32::INFINITY;
        }
        Ok(())
    }
}

fn settings(method: Method, scope: Scope) -> CompressSettings {
    CompressSettings {
        rank: 16,
        scope,
        prior: PriorChoice::Flat,
        target: Target::Slope(0.0),
        truncation: 1e-3,
        ..CompressSettings::of_method(method)
    }
}

fn block_of(source: &Floor, id: BlockId) -> Block {
    let mut block = TracedBlock::default();
    source.read_block(id, &mut block).unwrap();
    block.block
}

/// Every block analysed: the bytes of the candidates, and the relative error over the matrix.
fn analyse(source: &Floor, settings: CompressSettings) -> (Vec<Vec<u8>>, f64) {
    let compressor = CompressorPlan::new(&panel(), source.shape, settings).unwrap().choose_globally(source).unwrap();
    let (mut bytes, mut error, mut norm) = (Vec::new(), 0.0, 0.0);
    for id in source.shape.blocks() {
        let block = block_of(source, id);
        let candidate = compressor.analyse(id, block.view(), None);
        let packed = candidate.whole();
        assert!(packed.is_consistent());
        for (a, b) in block.entries().iter().zip(packed.expand().entries()).filter(|(a, _)| a.is_finite()) {
            error += f64::from(a - b).powi(2);
            norm += f64::from(*a).powi(2);
        }
        bytes.push(candidate.to_bytes());
    }
    (bytes, (error / norm).sqrt())
}

#[test]
fn over_one_block_the_whole_matrix_is_the_block() {
    let floor = Floor::new(20, 16, 32);
    for method in ALGORITHMS {
        for core in [Core::LeastSquares, Core::Textbook] {
            let of = |scope| analyse(&floor, CompressSettings { core, ..settings(method, scope) }).0;
            assert!(of(Scope::Global) == of(Scope::Block), "{method}, {core:?}");
        }
    }
}

#[test]
fn the_choice_and_every_block_are_the_same_for_any_number_of_threads() {
    // 70 blocks, three mini-batches; edges that are not full; the sample is a tenth of the rows, so that it streams.
    let floor = Floor::new(78, 55, 8);
    for method in ALGORITHMS {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                analyse(&floor, CompressSettings { sample_rows: 1_287, ..settings(method, Scope::Global) }).0
            })
        };
        let one = with(1);
        assert!([2, 3, 7].into_iter().all(|threads| with(threads) == one), "{method}");
    }
}

#[test]
fn mini_batches_choose_as_well_as_k_means_over_all_rows_at_once() {
    let floor = Floor::new(64, 64, 8);
    for method in [Method::Algorithm2, Method::Algorithm4] {
        let median = |sample_rows| {
            let error =
                |seed| analyse(&floor, CompressSettings { sample_rows, seed, ..settings(method, Scope::Global) }).1;
            let mut errors: Vec<f64> = (0..9).map(error).collect();
            errors.sort_by(f64::total_cmp);
            errors[4]
        };
        let (streamed, held) = (median(256), median(1 << 16));
        // Medians of 9 draws scatter by a third; 256 of 12,288 rows alone would not see the shadow's edge for all texels.
        assert!(streamed < 1.5 * held, "{method}: {streamed:e} against {held:e}");
    }
}

#[test]
fn every_block_is_near_the_best_that_sixteen_columns_can_do() {
    let floor = Floor::new(48, 48, 16);
    let whole = Floor::new(48, 48, 48);
    let (_, best) = analyse(&whole, CompressSettings { rank: 16, ..settings(Method::BlockSvd, Scope::Block) });
    for method in ALGORITHMS {
        let (_, error) = analyse(&floor, settings(method, Scope::Global));
        // The bound √(1 + k (n − k)) for the best 16 of 64 columns is 28; chosen by k-means and crossed with rows.
        assert!(error > 0.999 * best && error < 28.0 * best, "{method}: {error:e}, best {best:e}");
    }
}

#[test]
fn blocks_are_read_as_often_as_is_said_and_only_where_rows_are_wanted() {
    let floor = Floor::new(128, 128, 8);
    for (method, sample_rows) in
        [(Method::Algorithm1, 512), (Method::Algorithm2, 512), (Method::Algorithm2, 1 << 16), (Method::Algorithm3, 512)]
    {
        let settings = CompressSettings { sample_rows, ..settings(method, Scope::Global) };
        let plan = CompressorPlan::new(&panel(), floor.shape, settings).unwrap();
        let passes = plan.global_passes();
        floor.reads.store(0, Ordering::Relaxed);
        let compressor = plan.choose_globally(&floor).unwrap();
        let (reads, blocks) = (floor.reads.load(Ordering::Relaxed), floor.shape.block_count());
        assert!(reads <= passes * blocks, "{method}: {reads}");
        // 32 rows lie in 32 blocks of 256 at most.
        let most =
            if method == Method::Algorithm2 { u32::from(sample_rows == 512) * 2 * blocks + blocks + 32 } else { 64 };
        assert!(reads <= most, "{method}: {reads} reads, {most} at most");
        let chosen = compressor.chosen_globally().unwrap();
        assert!(chosen.columns.len() == 16 && chosen.rows.len() <= 32, "{method}");
    }
}

#[test]
fn unusable_entries_stay_where_they_are() {
    let (clean, broken) = (Floor::new(40, 40, 8), Floor { broken: true, ..Floor::new(40, 40, 8) });
    for method in ALGORITHMS {
        let error = |floor| analyse(floor, CompressSettings { sample_rows: 480, ..settings(method, Scope::Global) }).1;
        let (without, with) = (error(&clean), error(&broken));
        // Two of 4,800 rows have an entry that was replaced, one by the block's largest: at most those rows are lost.
        assert!(with < without + 2.0 * (2.0f64 / 4800.0).sqrt(), "{method}: {with:e}, without {without:e}");
    }
}

#[test]
fn methods_of_blocks_are_refused() {
    let shape = Floor::new(8, 8, 8).shape;
    for method in [Method::Auto, Method::Proposed, Method::BlockPca, Method::BlockSvd] {
        let error = Compressor::new(&panel(), shape, settings(method, Scope::Global)).err().unwrap().to_string();
        assert!(error.contains("block by block") && error.contains("algorithm1"), "{error}");
    }
    let projection = CompressSettings { core: Core::Projection, ..settings(Method::Algorithm4, Scope::Global) };
    assert!(Compressor::new(&panel(), shape, projection).is_err());
    let small = CompressSettings { sample_rows: 31, ..settings(Method::Algorithm4, Scope::Global) };
    assert!(Compressor::new(&panel(), shape, small).is_err());
    // Without the matrix nothing can be chosen from the whole of it.
    let plan = CompressorPlan::new(&panel(), shape, settings(Method::Algorithm4, Scope::Global)).unwrap();
    assert!(plan.for_blocks().err().unwrap().to_string().contains("whole matrix"));
}
