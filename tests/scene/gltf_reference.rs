//! Rooms as glTF files against another renderer: Mitsuba 3, its own materials written beside ours by
//! `tests/references/make_gltf.py`, which also writes the files.

use std::path::Path;
use std::sync::Arc;

use ltm::matrix::{BlockId, CHANNELS, MatrixShape, TracedBlock};
use ltm::scene::load;
use ltm::trace::{TraceSettings, Tracer};

use super::z_test::{Comparison, compare, reference, write_evidence};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("a_gltf_room_of_matte_mirror_metal_and_sheet_agrees_with_the_reference", equal_models),
    ("plastic_of_a_gltf_room_differs_from_the_reference_as_is_stated", plastic),
];

const SIDE: usize = 16;
const LIGHTS: usize = 2;
const PIXELS: usize = SIDE * SIDE;

/// Independent renders of a file's matrix, `[light][channel][y][x]`, against the reference of that name.
fn compared(name: &str) -> (Comparison, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/references/{name}.glb"));
    let loaded = load(&path).unwrap().sized(SIDE as u32, SIDE as u32);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let basis = &loaded.scene.basis;
    let names: Vec<&str> = basis.lights().iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["left", "right"]);
    // A factor of 1 and a strength of 2.
    assert!(basis.lights().iter().all(|light| light.emission == [2.0; 3]));
    let scene = Arc::new(loaded.scene);
    let shape = MatrixShape::new(SIDE as u32, SIDE as u32, LIGHTS as u32, SIDE as u32).unwrap();
    let render = |seed| {
        let settings = TraceSettings { samples_per_pixel: 128, seed, max_depth: 24 };
        let mut traced = TracedBlock::default();
        Tracer::new(Arc::clone(&scene), shape, settings).unwrap().trace_block(BlockId(0), &mut traced);
        traced.block.entries().iter().map(|&entry| f64::from(entry)).collect::<Vec<_>>()
    };
    let renders: Vec<Vec<f64>> = (0..24).map(render).collect();
    let (mean, variance) = reference(name);
    assert_eq!((mean.len(), renders[0].len()), (LIGHTS * CHANNELS * PIXELS, LIGHTS * CHANNELS * PIXELS));
    // Channels are of the same paths: one of them stands for all.
    let found = compare(&renders, (&mean, &variance), |entry| (entry / PIXELS).is_multiple_of(CHANNELS));
    eprintln!("{name}: {found}");
    (found, write_evidence(name, &renders))
}

/// Textured and plain matte walls, a coloured mirror, a rough metal that reflects all, a tinted pane; nested and mirrored nodes.
fn equal_models() {
    let (found, evidence) = compared("gltf");
    // 1,536 entries, 512 of them independent: see tests/transport/references.rs, whose bounds these are.
    assert!(found.mean_square < 1.35 && found.far <= 12 && found.whole.abs() < 4.0, "{found}; {evidence}");
}

/// Our base under a coat is lit through the coat; that of Mitsuba's `principled`, the model to which importers translate such a
/// material, is not, and is brighter at grazing angles.
fn plastic() {
    let (found, evidence) = compared("gltf_plastic");
    assert!(found.relative.abs() < 0.03 && found.mean_square > 1.0, "{found}; {evidence}");
}
