//! A layer: some components of a block and some of its sparse entries, as one chunk of bytes.

use super::adaptive::{BitCoder, BitDecoder, BitEncoder, SignedContexts};
use super::classes::CLASSES;
use super::planes::{PlanePlan, PlaneShape, Scratch, plan, push, read};
use super::rans::{RansDecoder, RansEncoder};
use super::rotation::{ROTATION_BITS, Rotation, rotate, transposed};
use super::sparse;
use super::step::{STEP_BITS, STEP_LIMIT, index_of, step_of};
use super::transform::{MAX_TILE, ZONES};
use crate::container::layout::BlockLayout;
use crate::matrix::{CHANNELS, FactoredBlock};

/// Settings of the codec.
#[derive(Clone, Debug, PartialEq)]
pub struct CodecSettings {
    /// Squared error, in squared quantisation steps, that a bit is worth. At high rates a uniform quantiser gives
    /// `2 ln 2 / 12 ≈ 0.12`; 0 rounds to nearest.
    pub lambda: f32,
    /// Share of a block's bytes that its base layer may take, where its first component fits in; 1: one layer only.
    pub base_share: f32,
}

impl Default for CodecSettings {
    fn default() -> Self {
        Self { lambda: 0.15, base_share: 0.1 }
    }
}

/// The codings that this module writes, as the first byte of a chunk has them: right sides of shared components are those
/// of the base layer.
pub(super) const CODING_SHARED: u8 = 1;
/// … or are stored as what the base layer's lack.
pub(super) const CODING_REFINED: u8 = 2;
/// Bytes of a chunk before its streams: coding, reserved, rank, sparse entries, bytes of the adaptive stream.
pub(super) const CHUNK_HEADER_BYTES: usize = 12;
/// Sides of tiles that a block's pixels may be cut into, by stored index.
const TILES: [usize; 4] = [32, 16, 8, 4];
/// A component's steps and rotation alone take more bytes than this.
const LEAST_COMPONENT_BYTES: usize = 6;

/// What the encoding of a layer takes from the block that it is part of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerPart {
    /// This many first components are differences from the base layer's first ones, on the left …
    pub shared: usize,
    /// … and on the right too; otherwise their right sides are the base layer's and are not stored again.
    pub refines_right: bool,
    /// Step for sparse values; `None`: found from the layer's own factors and values.
    pub sparse_step: Option<f32>,
}

/// Encodes all components and sparse entries of `block` as one layer.
///
/// Errors, as plain text for the caller to place: a value that is not finite, more than 255 shared components.
pub fn encode_layer(
    layout: &BlockLayout,
    block: &FactoredBlock,
    part: LayerPart,
    settings: &CodecSettings,
) -> Result<Vec<u8>, String> {
    let shared = part.shared;
    if shared > block.rank().min(255) {
        return Err(format!("{shared} components cannot be shared"));
    }
    let sparse_finite = block.sparse.iter().all(|e| e.value.is_finite());
    if !block.left.iter().chain(&block.right).all(|v| v.is_finite()) || !sparse_finite {
        return Err("it has a value that is not finite".into());
    }
    let components: Vec<Component> = (0..block.rank()).map(|k| Component::new(layout, block, k, settings)).collect();
    let total = |tile: usize| components.iter().flat_map(|c| &c.left[tile]).map(|p| p.cost).sum::<f32>();
    let tile = (0..TILES.len()).min_by(|&a, &b| total(a).total_cmp(&total(b))).expect("there are tiles");
    let mut side = BitEncoder::new();
    let mut values = RansEncoder::default();
    side.bits(tile as u32, 2);
    let mut contexts = ClassContexts::default();
    for (k, component) in components.iter().enumerate() {
        let is_right_stored = k >= shared || part.refines_right;
        let stored_planes = if is_right_stored { usize::MAX } else { CHANNELS };
        side.bits((component.left_step + STEP_LIMIT) as u32, STEP_BITS);
        if is_right_stored {
            side.bits((component.right_step + STEP_LIMIT) as u32, STEP_BITS);
        }
        side.bits(component.rotation.0, ROTATION_BITS);
        for (kind, plane) in component.planes(tile).take(stored_planes) {
            contexts.code(&mut side, kind, plane.classes);
            push(&mut values, plane);
        }
    }
    if !block.sparse.is_empty() {
        let step = index_of(part.sparse_step.unwrap_or_else(|| sparse_step(block)));
        side.bits((step + STEP_LIMIT) as u32, STEP_BITS);
        sparse::write(&mut side, &block.sparse, layout.pixels(), step_of(step));
    }
    let side = side.finish();
    let mut bytes = vec![if part.refines_right { CODING_REFINED } else { CODING_SHARED }, shared as u8];
    bytes.extend((block.rank() as u16).to_le_bytes());
    bytes.extend((block.sparse.len() as u32).to_le_bytes());
    bytes.extend((side.len() as u32).to_le_bytes());
    bytes.extend(side);
    if !components.is_empty() {
        bytes.extend(values.finish());
    }
    Ok(bytes)
}

/// Number of components of the base layer that a layer refines; 0 where the bytes are no layer.
pub fn shared_components(bytes: &[u8]) -> usize {
    bytes.get(1).map_or(0, |&shared| usize::from(shared))
}

/// Number of components at the end of a decoded layer that only stand for what the refined right sides bring with the
/// base layer's left sides: who puts the layers together, rather than adding them, leaves them out.
pub fn correcting_components(bytes: &[u8]) -> usize {
    if bytes.first() == Some(&CODING_REFINED) { shared_components(bytes) } else { 0 }
}

/// Decodes a layer, so that it adds to the base layer. `base` is the base layer where this is not it.
///
/// With `L + ΔL` and `R + ΔR` for the base layer's `L R`, the layer is `ΔL (R + ΔR) + L ΔR`: its first components are the
/// first product, its last ones the second.
///
/// Errors, as plain text for the caller to place: anything that cannot be a layer of this layout.
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
    let Some((header, streams)) = bytes.split_at_checked(CHUNK_HEADER_BYTES) else {
        return Err("the chunk is cut short".into());
    };
    if ![CODING_SHARED, CODING_REFINED].contains(&header[0]) {
        return Err(format!("the chunk is coded in an unknown way ({})", header[0]));
    }
    let shared = shared_components(bytes);
    let number = |at: usize| u32::from_le_bytes(header[at..at + 4].try_into().expect("4 bytes")) as usize;
    let rank = usize::from(u16::from_le_bytes([header[2], header[3]]));
    let (sparse_count, side_bytes) = (number(4), number(8));
    let Some((side, values)) = streams.split_at_checked(side_bytes) else {
        return Err("the chunk is cut short".into());
    };
    if shared > rank || shared > base.map_or(0, FactoredBlock::rank) {
        return Err(format!("the chunk shares {shared} components that are not there"));
    }
    if rank > rows.min(columns) + shared || rank * LEAST_COMPONENT_BYTES > side_bytes || sparse_count > rows * columns {
        return Err(format!("the chunk claims rank {rank} and {sparse_count} sparse entries"));
    }
    let mut side = BitDecoder::new(side);
    let tile = TILES[side.bits(0, 2) as usize];
    let mut decoder = if rank > 0 { Some(RansDecoder::new(values)?) } else { None };
    if rank == 0 && !values.is_empty() {
        return Err("the chunk has bytes that belong to nothing".into());
    }
    let mut block = FactoredBlock {
        rows,
        columns,
        left: vec![0.0; rank * rows],
        right: vec![0.0; rank * columns],
        ..Default::default()
    };
    let mut contexts = ClassContexts::default();
    let mut scratch = Scratch::default();
    let mut corrections: Vec<(usize, Vec<f32>)> = Vec::new();
    let left_shape = PlaneShape { width: layout.width, height: layout.height, tile };
    if let Some(decoder) = &mut decoder {
        let components = block.left.chunks_exact_mut(rows).zip(block.right.chunks_exact_mut(columns));
        for (k, (left, right)) in components.enumerate() {
            let left_step = side.bits(0, STEP_BITS) as i32 - STEP_LIMIT;
            block.left_step.push(step_of(left_step));
            let base = base.filter(|_| k < shared);
            let copied = base.filter(|_| header[0] == CODING_SHARED);
            let right_step = match copied {
                Some(base) => base.right_step[k],
                None => step_of(side.bits(0, STEP_BITS) as i32 - STEP_LIMIT),
            };
            block.right_step.push(right_step);
            let rotation = Rotation(side.bits(0, ROTATION_BITS));
            for channel in 0..CHANNELS {
                let plane = &mut left[channel * pixels..][..pixels];
                let classes = contexts.code(&mut side, PlaneKind::left(channel), [0; ZONES]);
                check_classes(&classes)?;
                read(decoder, &classes, left_shape, step_of(left_step), &mut scratch, plane);
            }
            rotate(left, transposed(rotation.matrix()));
            if let Some(base) = copied {
                right.copy_from_slice(base.right_component(k));
            }
            let mut rest = &mut *right;
            for shape in right_shapes(layout).filter(|_| copied.is_none()) {
                let plane;
                (plane, rest) = rest.split_at_mut(shape.width * shape.height);
                let classes = contexts.code(&mut side, PlaneKind::Right, [0; ZONES]);
                check_classes(&classes)?;
                read(decoder, &classes, shape, right_step, &mut scratch, plane);
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
    if sparse_count > 0 {
        let step = step_of(side.bits(0, STEP_BITS) as i32 - STEP_LIMIT);
        block.sparse = sparse::read(&mut side, sparse_count, pixels, columns, step)?;
    }
    Ok(block)
}

/// One component, quantised for every size of tile.
struct Component {
    left_step: i32,
    right_step: i32,
    rotation: Rotation,
    /// For each size of tile, the three rotated channels.
    left: [[PlanePlan; CHANNELS]; TILES.len()],
    right: Vec<PlanePlan>,
}

impl Component {
    fn new(layout: &BlockLayout, block: &FactoredBlock, k: usize, settings: &CodecSettings) -> Self {
        let mut left = block.left_component(k).to_vec();
        let right = block.right_component(k);
        let left_step = index_of(allowed_step(&block.left_step, k, &left));
        let right_step = index_of(allowed_step(&block.right_step, k, right));
        let rotation = Rotation::onto_axes(&left);
        rotate(&mut left, rotation.matrix());
        let left_plans = TILES.map(|tile| {
            let shape = PlaneShape { width: layout.width, height: layout.height, tile };
            let step = left_step;
            std::array::from_fn(|c| plan(&left[c * layout.pixels()..][..layout.pixels()], shape, step, settings.lambda))
        });
        let step = right_step;
        let mut rest = right;
        let right_plans = right_shapes(layout).map(|shape| {
            let plane;
            (plane, rest) = rest.split_at(shape.width * shape.height);
            plan(plane, shape, step, settings.lambda)
        });
        let right = right_plans.collect();
        Self { left_step, right_step, rotation, left: left_plans, right }
    }

    /// Its images in the order of coding.
    fn planes(&self, tile: usize) -> impl Iterator<Item = (PlaneKind, &PlanePlan)> {
        let left = self.left[tile].iter().enumerate().map(|(c, plane)| (PlaneKind::left(c), plane));
        left.chain(self.right.iter().map(|plane| (PlaneKind::Right, plane)))
    }
}

/// The step that a component asks for; where none is given, what a 16-bit float would keep of its largest value.
fn allowed_step(steps: &[f32], k: usize, values: &[f32]) -> f32 {
    let largest = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    // Coefficients are at most √1024 times larger than values; they must stay inside what is stored.
    let least = largest * 1e-5;
    steps.get(k).map_or(largest / 2048.0, |&step| step).max(least)
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

/// The images of a component of the right factor.
fn right_shapes(layout: &BlockLayout) -> impl Iterator<Item = PlaneShape> {
    layout.lights.planes().iter().map(|plane| PlaneShape {
        width: plane.across,
        height: plane.down,
        tile: if plane.is_image { MAX_TILE } else { 0 },
    })
}

fn check_classes(classes: &[u32; ZONES]) -> Result<(), String> {
    if classes.iter().all(|&class| class < CLASSES) { Ok(()) } else { Err("a band has an unknown class".into()) }
}

/// Which statistics an image's classes share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PlaneKind {
    /// The strongest colour axis.
    Strong = 0,
    /// The other colour axes.
    Weak = 1,
    /// A light.
    Right = 2,
}

impl PlaneKind {
    fn left(channel: usize) -> Self {
        if channel == 0 { Self::Strong } else { Self::Weak }
    }
}

/// Contexts and predictions for classes.
#[derive(Default)]
struct ClassContexts {
    contexts: [[SignedContexts; 2]; 3],
    before: [[i32; ZONES]; 3],
}

impl ClassContexts {
    /// Codes the classes of an image as differences: from the same zone of the last image of this kind, moved by as
    /// much as the zone before differed.
    fn code(&mut self, coder: &mut impl BitCoder, kind: PlaneKind, classes: [u32; ZONES]) -> [u32; ZONES] {
        let kind = kind as usize;
        let mut shift = 0;
        std::array::from_fn(|zone| {
            let before = &mut self.before[kind][zone];
            let guess = (*before + shift).clamp(0, CLASSES as i32 - 1);
            let context = &mut self.contexts[kind][usize::from(guess == 0)];
            let class = guess.saturating_add(coder.signed(context, classes[zone] as i32 - guess));
            let class = class.clamp(0, CLASSES as i32);
            shift = class - *before;
            *before = class;
            class as u32
        })
    }
}
