//! What a stage says that it needs is what it allocates at most, as a counting allocator sees it.

use std::sync::{Mutex, PoisonError};

use ltm::image::LinearImage;
use ltm::light::{Clusters, Light, LightBasis, LightKind};
use ltm::matrix::{BlockId, MatrixShape, TracedBlock};
use ltm::pipeline::{relit_layers_need_bytes, write_relit_layers};
use ltm::resources::MemoryNeed;
use ltm::scene::BuiltIn;
use ltm::trace::{TraceSettings, Tracer, TracerMemory};
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// The peak is that of the process: one test at a time.
static TURN: Mutex<()> = Mutex::new(());

/// What `work` takes at most beside what is held before it.
fn taken_by(work: impl FnOnce()) -> u64 {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    work();
    ALLOCATOR.peak_usage().saturating_sub(before) as u64
}

/// Layers wait on the disk, however many there are.
#[test]
fn writing_layers_takes_one_image_and_what_is_stated() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let shape = MatrixShape::new(512, 384, 24, 32).unwrap();
    let names: Vec<String> = (0..24).map(|i| format!("lamp {i}")).collect();
    let image_bytes = 512 * 384 * 12;
    let taken = taken_by(|| {
        let mut relit = |_| Ok(LinearImage::black(512, 384));
        write_relit_layers(&folder.path().join("layers.exr"), shape, &names, &mut relit).unwrap();
    });
    let stated = image_bytes + relit_layers_need_bytes(names.len(), shape);
    assert!(taken <= stated, "took {taken} bytes, said {stated}");
    assert!(stated < 24 * image_bytes, "{stated} bytes are those of all images");
}

/// The lightings of an animation are made one after the other.
#[test]
fn frames_of_an_animation_take_a_few_lightings() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("look.toml");
    let looks = "[[look]]\nname = 'on'\n[[look]]\nname = 'off'\n[[look.light]]\nname = '*'\non = false\n";
    let keys = "[[key]]\ntime_secs = 0\nlook = 'on'\n[[key]]\ntime_secs = 10\nlook = 'off'\n";
    std::fs::write(&path, format!("{looks}{keys}")).unwrap();
    let mut basis = LightBasis::new();
    basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 64, down: 64 })).unwrap();
    let look = ltm::look::load(&path, &basis).unwrap();
    let lighting_bytes = 64 * 64 * 12;
    assert_eq!(look.bytes(), 3 * lighting_bytes);
    let taken = taken_by(|| {
        let frames = look.frames(25.0).unwrap();
        assert_eq!(frames.count(), 251);
        (0..frames.count()).for_each(|frame| drop(frames.lighting(frame).unwrap()));
    });
    // One, and the one that it is made from; 251 would be 12 MB.
    assert!(taken < 4 * lighting_bytes, "took {taken} bytes");
}

#[test]
fn tracing_a_block_takes_what_is_stated() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let loaded = BuiltIn { width: 32, height: 32, texels: 16 }.named("diffuse").unwrap();
    let columns = loaded.scene.basis.column_count() as u32;
    let shape = MatrixShape::new(32, 32, columns, 32).unwrap();
    let clusters = Clusters::of_basis(&loaded.scene.basis).count();
    let settings = TraceSettings { samples_per_pixel: 4, seed: 0, max_depth: 5 };
    let tracer = Tracer::new(loaded.scene, shape, settings).unwrap();
    let mut block = TracedBlock::default();
    block.block.reset(shape.max_block_rows(), shape.columns());
    let taken = taken_by(|| {
        tracer.trace_block(BlockId(0), &mut block);
    });
    let stated = TracerMemory { scene: tracer.scene(), shape, clusters, settings }.thread_bytes();
    // At most, and not much more than it may come to: the list of differences grows with what a pixel's paths reach.
    assert!(taken <= stated && taken > stated * 3 / 4, "took {taken} bytes, said {stated}");
}

/// Photons are sent anew: what the ones before took is counted as held.
#[test]
fn photons_take_what_is_stated() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let loaded = BuiltIn { width: 256, height: 192, texels: 4 }.named("mixed").unwrap();
    let scene = std::sync::Arc::new(loaded.scene);
    let shape = MatrixShape::new(256, 192, 16, 32).unwrap();
    // A path of one segment sees no photon.
    let none = TraceSettings { samples_per_pixel: 16, seed: 0, max_depth: 1 };
    let settings = TraceSettings { max_depth: 8, ..none };
    let tracer = Tracer::new(std::sync::Arc::clone(&scene), shape, none).unwrap();
    assert_eq!(tracer.photon_count(), 0);
    let mut count = 0;
    let taken = taken_by(|| count = tracer.with_settings(settings).unwrap().photon_count());
    let clusters = Clusters::of_basis(&scene.basis).count();
    let memory = TracerMemory { scene: &scene, shape, clusters, settings };
    let stated = memory.photon_bytes();
    // At most, as if every photon came to rest somewhere, in leaves half empty; most do, in leaves nearly full.
    assert!(count > 50_000 && taken <= stated && taken > stated / 4, "{count} took {taken} bytes, said {stated}");
    // However many samples there are.
    let many = TraceSettings { samples_per_pixel: 4096, ..settings };
    assert!(TracerMemory { settings: many, ..memory }.photon_bytes() <= 256 << 20);
}
