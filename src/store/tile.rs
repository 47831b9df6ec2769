//! What stands in a block's slot: the columns that are not zero, the probes, and the side data that lists and checks
//! them.

use super::StoreLayout;
use super::record::TileRecord;

/// Which columns a tile holds, their checksums and scales, and the variances of the noise.
#[derive(Debug, Default, PartialEq)]
pub(super) struct SideData {
    /// Stored columns in ascending order.
    pub(super) columns: Vec<u32>,
    /// CRC-32 of the stored bytes of each column, then of each probe.
    pub(super) checksums: Vec<u32>,
    /// Scale of each column, then of each probe; empty where the precision has none.
    pub(super) scales: Vec<f32>,
    /// See `BlockNoise`; empty unless the noise is stored.
    pub(super) row_variance: Vec<f32>,
    /// See `BlockNoise`; empty unless the noise is stored.
    pub(super) column_variance: Vec<f32>,
}

impl SideData {
    /// The bytes after the columns and probes: `padding` zeros and the side data.
    pub(super) fn encode(&self, columns: usize, padding: usize) -> Vec<u8> {
        let mut present = vec![0u32; columns.div_ceil(32)];
        for &column in &self.columns {
            present[column as usize / 32] |= 1 << (column % 32);
        }
        let mut bytes = vec![0; padding];
        bytes.extend_from_slice(bytemuck::cast_slice(&present));
        bytes.extend_from_slice(bytemuck::cast_slice(&self.checksums));
        for part in [&self.scales, &self.row_variance, &self.column_variance] {
            bytes.extend_from_slice(bytemuck::cast_slice(part));
        }
        bytes
    }

    /// Reads it back from the bytes after the columns and probes, whose checksum has been found to hold. Errors, as
    /// plain text for the caller to place: what contradicts the record.
    pub(super) fn decode(bytes: &[u8], layout: &StoreLayout, rows: usize, record: &TileRecord) -> Result<Self, String> {
        let columns = layout.shape.columns();
        let stored = record.stored() as usize;
        let noise = record.noise == super::NOISE_STORED;
        let side = layout.side_bytes(rows as u64, columns as u64, stored as u64, noise) as usize;
        let padding = bytes.len().checked_sub(side).ok_or("its side data is cut short")?;
        let mut rest = &bytes[padding..];
        let mut take = |count: usize| {
            let (part, after) = rest.split_at(count * 4);
            rest = after;
            part
        };
        let words = |bytes: &[u8]| -> Vec<u32> { bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect() };
        let floats = |bytes: &[u8]| -> Vec<f32> { bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect() };
        let present = words(take(columns.div_ceil(32)));
        let side = Self {
            columns: (0..columns as u32).filter(|c| present[*c as usize / 32] >> (c % 32) & 1 == 1).collect(),
            checksums: words(take(stored)),
            scales: floats(take(if layout.precision.has_scale() { stored } else { 0 })),
            row_variance: floats(take(if noise { rows } else { 0 })),
            column_variance: floats(take(if noise { columns } else { 0 })),
        };
        let bits: u32 = present.iter().map(|word| word.count_ones()).sum();
        if side.columns.len() as u32 != bits || bits != record.stored_columns {
            return Err("its list of stored columns contradicts its commit record".into());
        }
        if side.scales.iter().any(|scale| !scale.is_normal() || *scale < 0.0) {
            return Err("a column's scale is out of range".into());
        }
        Ok(side)
    }
}
