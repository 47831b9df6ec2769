//! A block as a base layer and a refinement.
//!
//! The base layer holds the first components, both sides coarse, and the strongest sparse entries. The refinement holds
//! what is missing on both sides of those components, the other components, and the other sparse entries. Added up, or put
//! together component by component, both are the block at its full rank.

use super::codec::{
    CodecSettings, LayerPart, correcting_components, decode_layer, encode_layer, shared_components, sparse_step,
};
use super::layout::BlockLayout;
use crate::matrix::{FactoredBlock, SparseEntry};

/// Blocks of fewer bytes than this stay in one layer: the second one's own bytes would not pay.
const LEAST_SPLIT_BYTES: usize = 256;
/// How much coarser the base layer may be, tried in this order. With both sides coarse, a base layer of a tenth of the
/// bytes is 33 to 54 dB near the whole image where the left sides alone reached that with a quarter to a half.
const COARSENESS: [f32; 3] = [8.0, 16.0, 32.0];
/// Where not even one component at its coarsest fits the budget, it is taken still if it is below this share of the block.
const LARGEST_SHARE: f32 = 0.6;
/// Of the base layer's bytes, the share that sparse entries may take.
const SPARSE_SHARE: f32 = 0.7;

/// Encodes a block: one layer, or two where a base layer of the wanted share can be made.
pub(super) fn encode_layers(
    layout: &BlockLayout,
    block: &FactoredBlock,
    settings: &CodecSettings,
) -> Result<Vec<Vec<u8>>, String> {
    let block = &with_steps(block);
    let part = LayerPart { sparse_step: Some(sparse_step(block)), ..Default::default() };
    let whole = encode_layer(layout, block, part, settings)?;
    let budget = (whole.len() as f32 * settings.base_share) as usize;
    if whole.len() < LEAST_SPLIT_BYTES || settings.base_share >= 1.0 || block.rank() == 0 {
        return Ok(vec![whole]);
    }
    let sparse = strongest(layout, block, (budget as f32 * SPARSE_SHARE) as usize, part, settings)?;
    let encode =
        |rank: usize, coarseness: f32| encode_layer(layout, &base_of(block, rank, coarseness, &sparse), part, settings);
    let mut best: Option<(usize, Vec<u8>)> = None;
    for coarseness in COARSENESS {
        // As many components as fit: more of them never take fewer bytes.
        let (mut fits, mut too_many) = (0, block.rank().min(255) + 1);
        while too_many - fits > 1 {
            let rank = if fits == 0 { 1 } else { fits.midpoint(too_many) };
            let bytes = encode(rank, coarseness)?;
            let is_last = coarseness == COARSENESS[COARSENESS.len() - 1];
            let is_small = bytes.len() as f32 <= LARGEST_SHARE * whole.len() as f32;
            if bytes.len() <= budget || (rank == 1 && is_last && is_small) {
                fits = rank;
                best = Some((rank, bytes));
            } else {
                too_many = rank;
            }
        }
        if best.is_some() {
            break;
        }
    }
    let Some((shared, base)) = best else {
        return Ok(vec![whole]);
    };
    let decoded = decode_layer(layout, &base, None)?;
    let mut rest = block.clone();
    let sides = [(&mut rest.left, &decoded.left), (&mut rest.right, &decoded.right)];
    for (values, coarse) in sides {
        values.iter_mut().zip(coarse).for_each(|(value, coarse)| *value -= coarse);
    }
    rest.sparse.retain(|e| sparse.binary_search_by_key(&(e.column, e.row), |s| (s.column, s.row)).is_err());
    let part = LayerPart { shared, refines_right: true, ..part };
    Ok(vec![base, encode_layer(layout, &rest, part, settings)?])
}

/// Decodes layers and joins them. `base` is the base layer where it is not the first of them.
pub(super) fn join_layers<'a, E: From<String>>(
    layout: &BlockLayout,
    layers: impl Iterator<Item = Result<&'a [u8], E>>,
    base: Option<&FactoredBlock>,
) -> Result<FactoredBlock, E> {
    let mut whole = FactoredBlock { rows: layout.rows(), columns: layout.columns(), ..Default::default() };
    for (i, bytes) in layers.enumerate() {
        let bytes = bytes?;
        let joined = base.is_none() && i > 0;
        let layer = decode_layer(layout, bytes, base.or(Some(&whole).filter(|_| joined)))?;
        // Where the base layer is at hand, what it lacks is put in place.
        let (shared, last) = if joined { (shared_components(bytes), correcting_components(bytes)) } else { (0, 0) };
        let rank = layer.rank() - last;
        for (left, missing) in whole.left.iter_mut().zip(&layer.left[..shared * layer.rows]) {
            *left += missing;
        }
        whole.right[..shared * layer.columns].copy_from_slice(&layer.right[..shared * layer.columns]);
        whole.left_step[..shared].copy_from_slice(&layer.left_step[..shared]);
        whole.right_step[..shared].copy_from_slice(&layer.right_step[..shared]);
        whole.left.extend_from_slice(&layer.left[shared * layer.rows..rank * layer.rows]);
        whole.right.extend_from_slice(&layer.right[shared * layer.columns..rank * layer.columns]);
        whole.left_step.extend_from_slice(&layer.left_step[shared..rank]);
        whole.right_step.extend_from_slice(&layer.right_step[shared..rank]);
        whole.sparse.extend(layer.sparse);
    }
    whole.sparse.sort_unstable_by_key(|entry| (entry.column, entry.row));
    Ok(whole)
}

/// The strongest sparse entries that fit into about `budget` bytes, in order.
fn strongest(
    layout: &BlockLayout,
    block: &FactoredBlock,
    budget: usize,
    part: LayerPart,
    settings: &CodecSettings,
) -> Result<Vec<SparseEntry>, String> {
    let bare = FactoredBlock { left: vec![], right: vec![], left_step: vec![], right_step: vec![], ..block.clone() };
    let bytes = encode_layer(layout, &bare, part, settings)?.len();
    let mut sparse = block.sparse.clone();
    if bytes > budget {
        let count = sparse.len() * budget / bytes;
        sparse.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()).then((a.column, a.row).cmp(&(b.column, b.row))));
        sparse.truncate(count);
        sparse.sort_unstable_by_key(|entry| (entry.column, entry.row));
    }
    Ok(sparse)
}

/// The block with steps for every component: where none are given, what a 16-bit float would keep of the largest value.
fn with_steps(block: &FactoredBlock) -> FactoredBlock {
    let fine = |values: &[f32]| values.iter().fold(0.0f32, |m, v| m.max(v.abs())) / 2048.0;
    let mut block = block.clone();
    if block.left_step.is_empty() {
        block.left_step = (0..block.rank()).map(|k| fine(block.left_component(k))).collect();
    }
    if block.right_step.is_empty() {
        block.right_step = (0..block.rank()).map(|k| fine(block.right_component(k))).collect();
    }
    block
}

fn base_of(block: &FactoredBlock, rank: usize, coarseness: f32, sparse: &[SparseEntry]) -> FactoredBlock {
    FactoredBlock {
        rows: block.rows,
        columns: block.columns,
        left: block.left[..rank * block.rows].to_vec(),
        right: block.right[..rank * block.columns].to_vec(),
        left_step: block.left_step[..rank].iter().map(|step| step * coarseness).collect(),
        right_step: block.right_step[..rank].iter().map(|step| step * coarseness).collect(),
        sparse: sparse.to_vec(),
    }
}
