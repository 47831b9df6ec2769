//! `.ltc`: whatever the bytes of a chunk are, decoding them ends, without a panic, in an error or a sound block.
//!
//! The checksum of a chunk is the container's business, so changes are past it at once. Shared by the fuzz target and by
//! `tests/fuzz.rs`, which needs no fuzzer.

use std::sync::LazyLock;

use ltm::container::BlockLayout;
use ltm::container::codec::decode_layer;
use ltm::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance};
use ltm::matrix::{BlockId, MatrixShape};

/// 20 × 12 pixels under a light of 5 × 3 texels and a lamp.
pub(crate) static LAYOUT: LazyLock<BlockLayout> = LazyLock::new(|| {
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

/// Decodes the bytes as a chunk. Returns whether they made a block.
pub(crate) fn look(input: &[u8]) -> bool {
    let Ok(block) = decode_layer(&LAYOUT, input, None) else { return false };
    assert!(block.is_consistent());
    assert!(block.left.iter().chain(&block.right).all(|v| v.is_finite()));
    // What was decoded once serves as a base layer for the same bytes.
    let _ = decode_layer(&LAYOUT, input, Some(&block));
    true
}
