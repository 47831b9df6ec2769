//! 16-bit factors with a scale for each component, byte-shuffled, zstd.

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::super::layout::BlockLayout;
use crate::matrix::{ColumnIndex, FactoredBlock, SparseEntry};

/// Settings of the codec.
#[derive(Clone, Debug, PartialEq)]
pub struct CodecSettings {
    /// zstd level.
    pub level: i32,
}

impl Default for CodecSettings {
    fn default() -> Self {
        Self { level: 9 }
    }
}

const HEADER_BYTES: usize = 8;

/// Encodes the components and sparse entries of `block`. Errors: a value that is not finite.
pub fn encode_layer(layout: &BlockLayout, block: &FactoredBlock, settings: &CodecSettings) -> Result<Vec<u8>, String> {
    debug_assert_eq!(layout.rows(), block.rows);
    let sparse_finite = block.sparse.iter().all(|e| e.value.is_finite());
    if !block.left.iter().chain(&block.right).all(|v| v.is_finite()) || !sparse_finite {
        return Err("has a value that is not finite".into());
    }
    let mut bytes = Vec::new();
    bytes.extend((block.rank() as u32).to_le_bytes());
    bytes.extend((block.sparse.len() as u32).to_le_bytes());
    let mut body: Vec<u8> = Vec::new();
    let mut halves = Vec::new();
    for k in 0..block.rank() {
        for values in [block.left_component(k), block.right_component(k)] {
            let scale = values.iter().fold(0.0f32, |m, v| m.max(v.abs())).max(f32::MIN_POSITIVE);
            body.extend(scale.to_le_bytes());
            halves.extend(values.iter().map(|v| f16::from_f32(v / scale)));
        }
    }
    body.extend(halves.iter().map(|h| h.to_le_bytes()[0]));
    body.extend(halves.iter().map(|h| h.to_le_bytes()[1]));
    let mut last = 0;
    let places: Vec<u32> = block
        .sparse
        .iter()
        .map(|e| {
            let place = e.column.index() as u64 * block.rows as u64 + u64::from(e.row);
            let gap = place - last;
            last = place;
            gap as u32
        })
        .collect();
    for byte in 0..4 {
        body.extend(places.iter().map(|p| p.to_le_bytes()[byte]));
    }
    for byte in 0..4 {
        body.extend(block.sparse.iter().map(|e| e.value.to_le_bytes()[byte]));
    }
    bytes.extend(zstd::bulk::compress(&body, settings.level).expect("compressing into memory cannot fail"));
    Ok(bytes)
}

/// Decodes a layer. Errors, as plain text for the caller to place: anything that cannot be a layer of this layout.
pub fn decode_layer(layout: &BlockLayout, bytes: &[u8]) -> Result<FactoredBlock, String> {
    let (rows, columns) = (layout.rows(), layout.columns());
    if bytes.len() < HEADER_BYTES {
        return Err("the chunk is cut short".into());
    }
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes")) as usize;
    let (rank, sparse) = (number(0), number(4));
    if rank > rows.min(columns) {
        return Err(format!("the chunk claims rank {rank}"));
    }
    let values = rank * (rows + columns);
    let body_bytes = rank * 8 + 2 * values + sparse * 8;
    if body_bytes > 65_536 + 256 * bytes.len() {
        return Err("the chunk claims more than its bytes can hold".into());
    }
    let body = zstd::bulk::decompress(&bytes[HEADER_BYTES..], body_bytes)
        .map_err(|e| format!("the chunk does not decompress ({e})"))?;
    if body.len() != body_bytes {
        return Err("the chunk's lengths do not fit each other".into());
    }
    let (scales, rest) = body.split_at(rank * 8);
    let (halves, rest) = rest.split_at(2 * values);
    let (low, high) = halves.split_at(values);
    let halves: Vec<f16> = low.iter().zip(high).map(|(&l, &h)| f16::from_le_bytes([l, h])).collect();
    let mut floats = vec![0.0f32; values];
    halves.convert_to_f32_slice(&mut floats);
    let mut block = FactoredBlock { rows, columns, ..Default::default() };
    for (component, scales) in floats.chunks_exact(rows + columns).zip(scales.chunks_exact(8)) {
        let scale = |at: usize| f32::from_le_bytes(scales[at..at + 4].try_into().expect("4 bytes"));
        block.left.extend(component[..rows].iter().map(|v| v * scale(0)));
        block.right.extend(component[rows..].iter().map(|v| v * scale(4)));
    }
    let word = |at: usize, i: usize| {
        u32::from_le_bytes([rest[at + i], rest[at + sparse + i], rest[at + 2 * sparse + i], rest[at + 3 * sparse + i]])
    };
    let mut place = 0u64;
    for i in 0..sparse {
        place += u64::from(word(0, i));
        let (column, row) = (place / rows as u64, (place % rows as u64) as u32);
        let entry = SparseEntry { column: ColumnIndex(column as u32), row, value: f32::from_bits(word(4 * sparse, i)) };
        block.sparse.push(entry);
    }
    let finite = block.left.iter().chain(&block.right).chain(block.sparse.iter().map(|e| &e.value));
    if !finite.into_iter().all(|v| v.is_finite()) {
        return Err("the chunk holds a value that is not finite".into());
    }
    if !block.is_consistent() {
        return Err("the chunk's sparse entries are not in order or outside the block".into());
    }
    Ok(block)
}
