//! Splits a block into a base layer and a refinement.
//!
//! The base layer is for the first whole image with all lights on. It has the first component, which is nearly that
//! image, with both factors coarser, and all sparse entries, without which lights in view would be missing. The
//! refinement has what that component lacks in both factors, and the other components. Together they are the block at
//! its full rank.

use super::codec::{
    CodecSettings, LayerPart, correcting_components, decode_coded_layer, decode_layer, encode_layer, shared_components,
    sparse_step,
};
use super::layout::BlockLayout;
use crate::matrix::{CodedBlock, FactoredBlock};

/// Blocks of fewer bytes than this stay in one layer: the second one's own bytes would not pay.
const MIN_SPLIT_BYTES: usize = 256;
/// Ratios of the base layer's steps to the block's, left and right. The errors of the right factor's steps nearly
/// cancel in the sum over all lights; those of the left factor's do not. Tuned: decision 36.
const COARSENESS: [f32; 2] = [2.2, 8.0];
/// Most of a block's bytes that its base layer may take.
const MAX_SHARE: f32 = 0.6;

/// Encodes a block: one layer, or two where a base layer pays.
pub(super) fn encode_layers(
    layout: &BlockLayout,
    block: &FactoredBlock,
    settings: &CodecSettings,
) -> Result<Vec<Vec<u8>>, String> {
    let block = &with_steps(block);
    let part = LayerPart { sparse_step: Some(sparse_step(block)), ..Default::default() };
    if settings.layered && block.rank() > 1 {
        let base = encode_layer(layout, &base_of(block), part, settings)?;
        let decoded = decode_layer(layout, &base, None)?;
        let mut rest = FactoredBlock { sparse: vec![], ..block.clone() };
        for (values, coarse) in [(&mut rest.left, &decoded.left), (&mut rest.right, &decoded.right)] {
            values.iter_mut().zip(coarse).for_each(|(value, coarse)| *value -= coarse);
        }
        let rest = encode_layer(layout, &rest, LayerPart { shared: 1, ..part }, settings)?;
        let bytes = base.len() + rest.len();
        if bytes >= MIN_SPLIT_BYTES && base.len() as f32 <= MAX_SHARE * bytes as f32 {
            return Ok(vec![base, rest]);
        }
    }
    Ok(vec![encode_layer(layout, block, part, settings)?])
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
        let mut layer = decode_layer(layout, bytes, base.or(Some(&whole).filter(|_| joined)))?;
        if whole.rank() == 0 && whole.sparse.is_empty() {
            whole = layer;
            continue;
        }
        // Where the base layer is at hand, what it lacks is put in place.
        let (shared, last) = if joined { (shared_components(bytes), correcting_components(bytes)) } else { (0, 0) };
        let rank = layer.rank() - last;
        for (missing, left) in layer.left[..shared * layer.rows].iter_mut().zip(&whole.left) {
            *missing += left;
        }
        if shared == whole.rank() {
            // The usual case: nothing has to be moved.
            layer.left.truncate(rank * layer.rows);
            layer.right.truncate(rank * layer.columns);
            layer.left_step.truncate(rank);
            layer.right_step.truncate(rank);
            layer.sparse.append(&mut whole.sparse);
            layer.right_band_steps = whole.right_band_steps;
            whole = layer;
            continue;
        }
        whole.left[..shared * layer.rows].copy_from_slice(&layer.left[..shared * layer.rows]);
        whole.right[..shared * layer.columns].copy_from_slice(&layer.right[..shared * layer.columns]);
        whole.left_step[..shared].copy_from_slice(&layer.left_step[..shared]);
        whole.right_step[..shared].copy_from_slice(&layer.right_step[..shared]);
        whole.left.extend_from_slice(&layer.left[shared * layer.rows..rank * layer.rows]);
        whole.right.extend_from_slice(&layer.right[shared * layer.columns..rank * layer.columns]);
        whole.left_step.extend_from_slice(&layer.left_step[shared..rank]);
        whole.right_step.extend_from_slice(&layer.right_step[shared..rank]);
        whole.sparse.extend(layer.sparse);
    }
    sort_sparse(&mut whole);
    Ok(whole)
}

fn sort_sparse(block: &mut FactoredBlock) {
    if !block.sparse.is_sorted_by_key(|entry| (entry.column, entry.row)) {
        block.sparse.sort_unstable_by_key(|entry| (entry.column, entry.row));
    }
}

/// Decodes the first layers of a block with right sides as coefficients, and joins them. None where no unit fits all rows.
pub(super) fn join_coded(layout: &BlockLayout, layers: &[Vec<u8>]) -> Result<Option<CodedBlock>, String> {
    let factors = FactoredBlock { rows: layout.rows(), columns: layout.columns(), ..Default::default() };
    let mut whole = CodedBlock { factors, right: Vec::new() };
    for (i, bytes) in layers.iter().enumerate() {
        let base = Some(&whole.factors).filter(|_| i > 0);
        let Some(layer) = decode_coded_layer(layout, bytes, base)? else { return Ok(None) };
        let have_one_unit = layer.factors.right_band_steps == whole.factors.right_band_steps;
        if !have_one_unit && !whole.right.is_empty() && !layer.right.is_empty() {
            return Ok(None);
        }
        add_layer(&mut whole, layer, shared_components(bytes));
    }
    sort_sparse(&mut whole.factors);
    Ok(Some(whole))
}

/// Adds a layer to those before it, of whose components it refines the first.
fn add_layer(whole: &mut CodedBlock, layer: CodedBlock, shared: usize) {
    let CodedBlock { factors, right } = whole;
    let (rows, known) = (factors.rows, factors.rank() as u32);
    let layer_factors = layer.factors;
    let (missing, left) = layer_factors.left.split_at(shared * rows);
    factors.left.iter_mut().zip(missing).for_each(|(sum, missing)| *sum += missing);
    factors.left.extend_from_slice(left);
    for (steps, of_layer) in
        [(&mut factors.left_step, &layer_factors.left_step), (&mut factors.right_step, &layer_factors.right_step)]
    {
        steps[..shared].copy_from_slice(&of_layer[..shared]);
        steps.extend_from_slice(&of_layer[shared..]);
    }
    factors.sparse.extend(layer_factors.sparse);
    factors.by_eye = layer_factors.by_eye;
    if right.is_empty() {
        factors.right_band_steps = layer_factors.right_band_steps;
    }
    right.extend(layer.right.into_iter().map(|mut row| {
        if let Some(own) = row.component.checked_sub(shared as u32) {
            row.component = known + own;
        }
        row
    }));
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

/// The first component alone, coarser, with all sparse entries.
fn base_of(block: &FactoredBlock) -> FactoredBlock {
    let [left, right] = COARSENESS;
    FactoredBlock {
        rows: block.rows,
        columns: block.columns,
        left: block.left_component(0).to_vec(),
        right: block.right_component(0).to_vec(),
        left_step: vec![block.left_step[0] * left],
        right_step: vec![block.right_step[0] * right],
        sparse: block.sparse.clone(),
        right_band_steps: block.right_band_steps.clone(),
        by_eye: block.by_eye,
    }
}
