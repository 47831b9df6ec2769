//! What a stage says that it needs is what it allocates at most, as a counting allocator sees it.

use ltm::light::Clusters;
use ltm::matrix::{BlockId, MatrixShape, TracedBlock};
use ltm::scene::BuiltIn;
use ltm::trace::{TraceSettings, Tracer};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

#[test]
fn tracing_a_block_takes_what_is_stated() {
    let loaded = BuiltIn { width: 32, height: 32, texels: 16 }.named("diffuse").unwrap();
    let columns = loaded.scene.basis.column_count() as u32;
    let shape = MatrixShape::new(32, 32, columns, 32).unwrap();
    let clusters = Clusters::of_basis(&loaded.scene.basis).count();
    let settings = TraceSettings { samples_per_pixel: 4, seed: 0, max_depth: 5 };
    let tracer = Tracer::new(loaded.scene, shape, settings).unwrap();
    let mut block = TracedBlock::default();
    block.block.reset(shape.max_block_rows(), shape.columns());
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    tracer.trace_block(BlockId(0), &mut block);
    let taken = ALLOCATOR.peak_usage().saturating_sub(before) as u64;
    let stated = Tracer::block_needs_bytes(shape, clusters);
    // At most, and not much more than it may come to: the list of differences grows with what a pixel's paths reach.
    assert!(taken <= stated && taken > stated * 3 / 4, "took {taken} bytes, said {stated}");
}
