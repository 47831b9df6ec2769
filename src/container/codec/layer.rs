//! A layer: some components of a block and some of its sparse entries, as one chunk of bytes.

use super::adaptive::BitEncoder;
use super::chunk::{CODING_APART, CODING_BANDS, CODING_ZONES, Chunk, MIN_COMPONENT_BYTES};
use super::component::{QuantisedComponent, right_bands};
use super::planes::push;
use super::rans::{RansEncoder, RansStreams};
use super::settings::CodecSettings;
use super::side::{ClassContexts, Heads, code_band_steps, code_step};
use super::sparse;
use super::step::{index_of, step_of};
use crate::container::layout::BlockLayout;
use crate::matrix::FactoredBlock;

/// What the encoding of a layer takes from the block that it is part of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerPart {
    /// This many first components are differences from the base layer's first ones, on both sides. Where there are any, bands are as fine as
    /// in the base layer, which the block is to say too.
    pub shared: usize,
    /// Step for sparse values; `None`: found from the layer's own factors and values.
    pub sparse_step: Option<f32>,
}

/// Encodes all components and sparse entries of `block` as one layer.
///
/// # Errors
/// As text for the caller to place: a value that is not finite, more shared components than there are, band_steps of other bands than
/// the layout has.
pub fn encode_layer(
    layout: &BlockLayout,
    block: &FactoredBlock,
    part: LayerPart,
    settings: &CodecSettings,
) -> Result<Vec<u8>, String> {
    let rank = block.rank();
    if part.shared > rank {
        return Err(format!("{} components cannot be shared", part.shared));
    }
    let bands = right_bands(&layout.lights);
    if ![0, bands].contains(&block.right_band_steps.len()) {
        return Err(format!("it says how finely {} bands are stored and has {bands}", block.right_band_steps.len()));
    }
    let sparse_finite = block.sparse.iter().all(|e| e.value.is_finite());
    if !block.left.iter().chain(&block.right).all(|v| v.is_finite()) || !sparse_finite {
        return Err("it has a value that is not finite".into());
    }
    let mut side = BitEncoder::new();
    let mut values = RansEncoder::default();
    let (mut heads, mut contexts) = (Heads::default(), ClassContexts::default());
    let coding = match block.right_band_steps.is_empty() {
        _ if rank == 0 => CODING_APART,
        _ if block.by_eye => CODING_ZONES,
        false => CODING_BANDS,
        true => CODING_APART,
    };
    if coding != CODING_APART && part.shared == 0 {
        let mut band_steps = block.right_band_steps.to_vec();
        band_steps.resize(bands, 0);
        code_band_steps(&mut side, &mut band_steps);
    }
    let mut before = None;
    for k in 0..rank {
        let component = QuantisedComponent::new(layout, block, k, before.as_ref(), settings);
        heads.code(&mut side, component.head);
        for (kind, plane) in component.planes() {
            contexts.code(&mut side, kind, plane.classes);
            push(&mut values, plane);
        }
        before = Some(component.head);
    }
    if !block.sparse.is_empty() {
        let step = index_of(part.sparse_step.unwrap_or_else(|| sparse_step(block)));
        code_step(&mut side, step);
        sparse::write(&mut side, &block.sparse, layout.pixels(), step_of(step));
    }
    let mut side = side.finish();
    let RansStreams { values, is_long, low_bits } = if rank > 0 { values.finish() } else { RansStreams::default() };
    let streams = side.len() + low_bits.len() + values.len();
    side.resize(side.len() + (rank * MIN_COMPONENT_BYTES).saturating_sub(streams), 0);
    Ok(Chunk::write(coding, [part.shared, rank, block.sparse.len()], &side, &low_bits, &values, is_long))
}

/// The step for sparse values that fits the steps of the factors.
pub fn sparse_step(block: &FactoredBlock) -> f32 {
    let magnitudes = || block.sparse.iter().map(|e| e.value.abs()).filter(|&v| v > 0.0);
    let (least, most) = magnitudes().fold((f32::MAX, 0.0f32), |(a, b), v| (a.min(v), b.max(v)));
    let step = match block.left_step.first() {
        // A sparse entry acts on the image as an entry of the first component does, weighed by how much light that
        // component gathers.
        Some(&step) => step * block.right_component(0).iter().sum::<f32>().abs(),
        None => least / 1024.0,
    };
    step.clamp(most * 1e-6, least.max(most * 1e-6))
}
