//! A chunk of bytes back to a layer, whatever its coding.

use std::sync::Arc;

use super::adaptive::{BitCoder, BitDecoder};
use super::chunk::{CODING_BANDS, CODING_REFINED, CODING_SHARED, CODING_ZONES, Chunk};
use super::component::{right_bands, right_images, turn_back};
use super::low_bits::LowBits;
use super::planes::{PlaneShape, Scratch, TILES, read, zone_steps};
use super::rans::RansDecoder;
use super::rotation::ROTATION_BITS;
use super::side::{ClassContexts, ComponentHead, Heads, PlaneKind, TILE_BITS, code_band_steps, code_step};
use super::sparse;
use super::step::{Steps, step_of};
use crate::container::layout::BlockLayout;
use crate::matrix::{CHANNELS, FactoredBlock};

/// Number of components of the base layer that a layer refines; 0 where the bytes are no layer.
pub fn shared_components(bytes: &[u8]) -> usize {
    Chunk::parse(bytes).map_or(0, |chunk| chunk.shared)
}

/// What a layer claims to hold before it is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Claims {
    /// Components beyond those that refine the base layer's.
    pub(crate) components: usize,
    /// Number of its components.
    pub(crate) rank: usize,
    pub(crate) sparse_entries: usize,
}

/// What the bytes of a layer claim.
///
/// # Errors
/// As plain text: they are no layer.
pub(crate) fn claims(bytes: &[u8]) -> Result<Claims, String> {
    let Chunk { shared, rank, sparse_entries, .. } = Chunk::parse(bytes)?;
    Ok(Claims { components: rank.saturating_sub(shared), rank, sparse_entries })
}

/// Number of trailing components of a decoded layer that only correct `R` for the base layer's `L`; they are skipped where
/// layers are merged rather than added.
pub fn correcting_components(bytes: &[u8]) -> usize {
    Chunk::parse(bytes).map_or(0, |chunk| if chunk.refines_right() { chunk.shared } else { 0 })
}

/// Decodes a layer, so that it adds to the base layer. `base` is the base layer where this is not it.
///
/// With `L + ΔL` and `R + ΔR` for the base layer's `L R`, the layer is `ΔL (R + ΔR) + L ΔR`: its first components are
/// the first product, its last ones the second.
///
/// # Errors
/// As text for the caller to place: anything that cannot be a layer of this layout.
pub fn decode_layer(layout: &BlockLayout, bytes: &[u8], base: Option<&FactoredBlock>) -> Result<FactoredBlock, String> {
    pulp::Arch::new().dispatch(Decoding { layout, bytes, base })
}

/// A call of [`decode`]: a closure would not be inlined into the functions that are compiled for each vector unit.
struct Decoding<'a> {
    layout: &'a BlockLayout,
    bytes: &'a [u8],
    base: Option<&'a FactoredBlock>,
}

impl pulp::NullaryFnOnce for Decoding<'_> {
    type Output = Result<FactoredBlock, String>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        decode(self.layout, self.bytes, self.base)
    }
}

/// Compiled for the vector units that the machine turns out to have.
#[inline(always)]
fn decode(layout: &BlockLayout, bytes: &[u8], base: Option<&FactoredBlock>) -> Result<FactoredBlock, String> {
    let (rows, columns, pixels) = (layout.rows(), layout.columns(), layout.pixels());
    let chunk = Chunk::parse(bytes)?;
    chunk.check(rows, columns, base.map_or(0, FactoredBlock::rank))?;
    let is_apart = !matches!(chunk.coding, CODING_SHARED | CODING_REFINED);
    let mut side = BitDecoder::new(&bytes[chunk.side.clone()]);
    // With the first codings all components have the same tiles, said once.
    let one_tile = if is_apart { 0 } else { side.bits(0, TILE_BITS) };
    let (low_bits, values) = (&bytes[chunk.low_bits.clone()], &bytes[chunk.values.clone()]);
    let mut decoder = match chunk.rank {
        0 if values.is_empty() && low_bits.is_empty() => None,
        0 => return Err("the chunk has bytes that belong to nothing".into()),
        _ => Some(RansDecoder::new(values, chunk.states, is_apart.then(|| LowBits::new(low_bits)))?),
    };
    let mut block = FactoredBlock {
        rows,
        columns,
        left: vec![0.0; chunk.rank * rows],
        right: vec![0.0; chunk.rank * columns],
        ..Default::default()
    };
    let (mut heads, mut contexts) = (Heads::default(), ClassContexts::default());
    block.by_eye = chunk.coding == CODING_ZONES;
    if matches!(chunk.coding, CODING_BANDS | CODING_ZONES) {
        block.right_band_steps = match base.filter(|_| chunk.shared > 0) {
            Some(base) => Arc::clone(&base.right_band_steps),
            None => {
                let mut band_steps = vec![0; right_bands(&layout.lights)];
                code_band_steps(&mut side, &mut band_steps);
                band_steps.into()
            }
        };
    }
    let band_steps = Arc::clone(&block.right_band_steps);
    let mut scratch = Scratch::default();
    let mut corrections: Vec<(usize, Vec<f32>)> = Vec::new();
    if let Some(decoder) = &mut decoder {
        let components = block.left.chunks_exact_mut(rows).zip(block.right.chunks_exact_mut(columns));
        for (k, (left, right)) in components.enumerate() {
            let base = base.filter(|_| k < chunk.shared);
            let copied = base.filter(|_| !chunk.refines_right());
            let head = if is_apart {
                heads.code(&mut side, ComponentHead::default())
            } else {
                ComponentHead {
                    tile: one_tile,
                    left_step: code_step(&mut side, 0),
                    right_step: if copied.is_none() { code_step(&mut side, 0) } else { 0 },
                    rotation: side.bits(0, ROTATION_BITS),
                }
            };
            let left_step = step_of(head.left_step);
            let right_step = copied.map_or(step_of(head.right_step), |base| base.right_step[k]);
            block.left_step.push(left_step);
            block.right_step.push(right_step);
            let shape = PlaneShape { width: layout.width, height: layout.height, tile: TILES[head.tile as usize] };
            for channel in 0..CHANNELS {
                let classes = contexts.read(&mut side, PlaneKind::left(channel))?;
                read(
                    decoder,
                    &classes,
                    shape,
                    Steps { index: head.left_step, band_steps: zone_steps(head.tile as usize, block.by_eye) },
                    &mut scratch,
                    &mut left[channel * pixels..][..pixels],
                );
            }
            turn_back(left, head.rotation);
            if let Some(base) = copied {
                right.copy_from_slice(base.right_component(k));
            }
            let mut rest = &mut *right;
            for (shape, band_steps) in right_images(&layout.lights, &band_steps).filter(|_| copied.is_none()) {
                let plane;
                (plane, rest) = rest.split_at_mut(shape.values());
                let classes = contexts.read(&mut side, PlaneKind::Right)?;
                read(decoder, &classes, shape, Steps { index: head.right_step, band_steps }, &mut scratch, plane);
            }
            if let Some(base) = base.filter(|_| copied.is_none()) {
                corrections.push((k, right.to_vec()));
                right.iter_mut().zip(base.right_component(k)).for_each(|(right, base)| *right += base);
            }
            if side.is_exhausted() {
                return Err("the chunk's steps and classes are cut short".into());
            }
        }
    }
    decoder.map_or(Ok(()), RansDecoder::finish)?;
    for (k, right) in corrections {
        let base = base.expect("only the base layer's components are refined");
        block.left.extend_from_slice(base.left_component(k));
        block.left_step.push(base.left_step[k]);
        block.right_step.push(block.right_step[k]);
        block.right.extend(right);
    }
    if chunk.sparse_entries > 0 {
        let step = step_of(code_step(&mut side, 0));
        block.sparse = sparse::read(&mut side, chunk.sparse_entries, pixels, columns, step)?;
    }
    Ok(block)
}
