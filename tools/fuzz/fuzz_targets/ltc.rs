//! `.ltc`: whatever the bytes of a chunk are, decoding them ends, without a panic, in an error or a sound block.
//!
//! The checksum of a chunk is the container's business, so the fuzzer is past it at once.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use ltm::container::BlockLayout;
use ltm::container::codec::decode_layer;
use ltm::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance};
use ltm::matrix::{BlockId, MatrixShape};

/// 20 × 12 pixels under a light of 5 × 3 texels and a lamp.
static LAYOUT: LazyLock<BlockLayout> = LazyLock::new(|| {
    let mut basis = LightBasis::new();
    for (name, kind, columns) in [("a", LightKind::AreaTexels { across: 5, down: 3 }, 15), ("b", LightKind::Lamp, 1)] {
        let light = Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![1.0; columns],
        };
        basis.push(light).expect("the lights fit");
    }
    let shape = MatrixShape::new(20, 12, 16, 32).expect("the shape is possible");
    BlockLayout::of(&Job { shape, basis, provenance: Provenance::default() }, BlockId(0))
});

fuzz_target!(|input: &[u8]| {
    if let Ok(block) = decode_layer(&LAYOUT, input, None) {
        assert!(block.is_consistent());
        assert!(block.left.iter().chain(&block.right).all(|v| v.is_finite()));
        // What was decoded once serves as a base layer for the same bytes.
        let _ = decode_layer(&LAYOUT, input, Some(&block));
    }
});
