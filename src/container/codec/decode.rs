//! A chunk of bytes back to a layer, whatever its coding.

use std::sync::Arc;

use super::adaptive::{BitCoder, BitDecoder};
use super::chunk::{CODING_REFINED, CODING_SHARED, CODING_ZONES, Chunk};
use super::component::{right_bands, right_images, turn_back};
use super::low_bits::LowBits;
use super::planes::{PlaneShape, Scratch, TILES, read, read_numbers, zone_steps};
use super::rans::RansDecoder;
use super::rotation::ROTATION_BITS;
use super::side::{ClassContexts, ComponentHead, Heads, PlaneKind, TILE_BITS, code_band_steps, code_step};
use super::sparse;
use super::step::{Steps, step_of};
use crate::container::layout::BlockLayout;
use crate::matrix::{CodedBlock, CodedRow, FactoredBlock};

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
    pulp::Arch::new().dispatch(Decoding { layout, bytes, base, right: RightSides::Values })
}

/// As [`decode_layer`], with right sides as coefficients: a row for each that the layer stores. The layer's first components are to
/// be added to those of the base layer that they refine, their rows to its rows. None where a step lies beyond those that there
/// are, so that no unit fits all rows.
///
/// # Errors
/// As [`decode_layer`].
pub(crate) fn decode_coded_layer(
    layout: &BlockLayout,
    bytes: &[u8],
    base: Option<&FactoredBlock>,
) -> Result<Option<CodedBlock>, String> {
    let mut rows = CodedRows { rows: Vec::new(), are_in_range: true };
    let right = RightSides::Coded(&mut rows);
    let factors = pulp::Arch::new().dispatch(Decoding { layout, bytes, base, right })?;
    Ok(rows.are_in_range.then_some(CodedBlock { factors, right: rows.rows }))
}

/// How much finer each band of the right sides of a layer is, as the layer itself says it; none where it says nothing.
pub(crate) fn stored_band_steps(layout: &BlockLayout, bytes: &[u8]) -> Option<Vec<i8>> {
    let chunk = Chunk::parse(bytes).ok().filter(|chunk| chunk.rank > 0 && chunk.shared == 0)?;
    if !chunk.has_band_steps() {
        return Some(Vec::new());
    }
    Some(read_band_steps(&mut BitDecoder::new(&bytes[chunk.side]), layout))
}

/// What becomes of right sides.
enum RightSides<'a> {
    /// Values in the factors.
    Values,
    /// Coefficients in rows of their own.
    Coded(&'a mut CodedRows),
}

struct CodedRows {
    rows: Vec<CodedRow>,
    are_in_range: bool,
}

/// A call of [`decode`]: a closure would not be inlined into the functions that are compiled for each vector unit.
struct Decoding<'a> {
    layout: &'a BlockLayout,
    bytes: &'a [u8],
    base: Option<&'a FactoredBlock>,
    right: RightSides<'a>,
}

impl pulp::NullaryFnOnce for Decoding<'_> {
    type Output = Result<FactoredBlock, String>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { layout, bytes, base, right } = self;
        decode(layout, bytes, base, right)
    }
}

/// Compiled for the vector units that the machine turns out to have.
#[inline(always)]
fn decode(
    layout: &BlockLayout,
    bytes: &[u8],
    base: Option<&FactoredBlock>,
    mut right_sides: RightSides<'_>,
) -> Result<FactoredBlock, String> {
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
    let has_values = matches!(right_sides, RightSides::Values);
    let mut block = FactoredBlock {
        rows,
        columns,
        left: vec![0.0; chunk.rank * rows],
        right: vec![0.0; if has_values { chunk.rank * columns } else { 0 }],
        by_eye: chunk.coding == CODING_ZONES,
        ..Default::default()
    };
    let (mut heads, mut contexts) = (Heads::default(), ClassContexts::default());
    if chunk.has_band_steps() {
        block.right_band_steps = match base.filter(|_| chunk.shared > 0) {
            Some(base) => Arc::clone(&base.right_band_steps),
            None => read_band_steps(&mut side, layout).into(),
        };
    }
    let band_steps = Arc::clone(&block.right_band_steps);
    let mut scratch = Scratch::default();
    let mut corrections: Vec<(usize, Vec<f32>)> = Vec::new();
    for k in 0..chunk.rank {
        let decoder = decoder.as_mut().expect("there are components");
        let base = base.filter(|_| k < chunk.shared);
        let copied = base.filter(|_| !chunk.refines_right());
        let head = match is_apart {
            true => heads.code(&mut side, ComponentHead::default()),
            false => long_head(&mut side, one_tile, copied.is_none()),
        };
        let right_step = copied.map_or(step_of(head.right_step), |base| base.right_step[k]);
        block.left_step.push(step_of(head.left_step));
        block.right_step.push(right_step);
        let shape = PlaneShape { width: layout.width, height: layout.height, tile: TILES[head.tile as usize] };
        let steps = Steps { index: head.left_step, band_steps: zone_steps(head.tile as usize, block.by_eye) };
        let left = &mut block.left[k * rows..][..rows];
        for (channel, plane) in left.chunks_exact_mut(pixels).enumerate() {
            let classes = contexts.read(&mut side, PlaneKind::left(channel))?;
            read(decoder, &classes, shape, steps, &mut scratch, plane);
        }
        turn_back(left, head.rotation);
        let (index, mut images) = (head.right_step, right_images(&layout.lights, &band_steps));
        match &mut right_sides {
            RightSides::Coded(_) if copied.is_some() => {}
            RightSides::Coded(coded) => {
                let values = read_coded_right(decoder, &mut side, &mut contexts, layout, &mut scratch)?;
                let are_in_range = |(_, band_steps)| Steps { index, band_steps }.are_in_range();
                coded.are_in_range &= images.all(are_in_range);
                coded.rows.push(CodedRow { component: k as u32, step: right_step, values });
            }
            RightSides::Values => {
                let right = &mut block.right[k * columns..][..columns];
                if let Some(base) = copied {
                    right.copy_from_slice(base.right_component(k));
                } else {
                    let mut rest = &mut *right;
                    for (shape, band_steps) in images {
                        let plane;
                        (plane, rest) = rest.split_at_mut(shape.values());
                        let classes = contexts.read(&mut side, PlaneKind::Right)?;
                        read(decoder, &classes, shape, Steps { index, band_steps }, &mut scratch, plane);
                    }
                    if let Some(base) = base {
                        corrections.push((k, right.to_vec()));
                        right.iter_mut().zip(base.right_component(k)).for_each(|(right, base)| *right += base);
                    }
                }
            }
        }
        if side.is_exhausted() {
            return Err("the chunk's steps and classes are cut short".into());
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

/// The numbers of a right side.
#[inline(always)]
fn read_coded_right(
    decoder: &mut RansDecoder<'_>,
    side: &mut BitDecoder<'_>,
    contexts: &mut ClassContexts,
    layout: &BlockLayout,
    scratch: &mut Scratch,
) -> Result<Vec<i32>, String> {
    let mut values = vec![0; layout.columns()];
    let mut rest = values.as_mut_slice();
    for (shape, _) in right_images(&layout.lights, &[]) {
        let plane;
        (plane, rest) = rest.split_at_mut(shape.values());
        let classes = contexts.read(side, PlaneKind::Right)?;
        read_numbers(decoder, &classes, shape, scratch, plane);
    }
    Ok(values)
}

/// The head of a component with the first codings; `has_right`: whether its right side is stored.
fn long_head(side: &mut BitDecoder, tile: u32, has_right: bool) -> ComponentHead {
    ComponentHead {
        tile,
        left_step: code_step(side, 0),
        right_step: if has_right { code_step(side, 0) } else { 0 },
        rotation: side.bits(0, ROTATION_BITS),
    }
}

fn read_band_steps(side: &mut BitDecoder, layout: &BlockLayout) -> Vec<i8> {
    let mut band_steps = vec![0; right_bands(&layout.lights)];
    code_band_steps(side, &mut band_steps);
    band_steps
}
