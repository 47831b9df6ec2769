//! Where everything stands in the file: it follows from shape, precision, probes and the job description's length.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::light::{Clusters, Job, encode_job};
use crate::matrix::{BlockId, BlockPlanes, CHANNELS, FEATURE_PLANES, MatrixShape, SeenEmission};

use super::{Precision, StoreOptions};

/// Alignment of the parts of the file and of the slots, in bytes: the page of the machines this runs on.
pub const PAGE_BYTES: u64 = 4096;
/// Bytes of one commit record: a power of two below a disk sector, so that no record straddles two.
pub const RECORD_BYTES: u64 = 64;
/// Bytes that one thread encodes or decodes before it writes or reads on.
pub(super) const STAGING_BYTES: usize = 1 << 20;
/// Bytes that are read at a time to be checked: still in the second-level cache when they are.
pub(super) const READING_BYTES: usize = 1 << 18;

/// Offsets and sizes of a file's parts, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreLayout {
    pub(super) shape: MatrixShape,
    pub(super) precision: Precision,
    pub(super) max_probes: u32,
    /// Clusters of columns in the planes; 0 where there is no room for planes.
    pub(super) clusters: u32,
    /// Planes of features, fewer in files of an earlier version; 0 where there is no room for planes.
    pub(super) features: u32,
    pub(super) job_bytes: u64,
}

/// Bytes that a store needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requirements {
    /// Anonymous memory of the store itself for one thread that writes or reads a block; the block is the caller's.
    pub memory_bytes: u64,
    /// Disk space at most: the reserved file. Zero columns give their part back as they are committed.
    pub disk_bytes: u64,
}

/// What storing `job` will need, known before anything is begun.
///
/// # Panics
/// Never: all blocks are a range of them.
pub fn requirements(job: &Job, options: &StoreOptions) -> Requirements {
    requirements_of(job, options, 0..job.shape.block_count()).expect("all blocks are a range of them")
}

/// What storing a range of blocks will need.
///
/// # Errors
/// There are no such blocks.
pub fn requirements_of(job: &Job, options: &StoreOptions, blocks: Range<u32>) -> Result<Requirements> {
    let layout = StoreLayout::new(job, options, encode_job(job).len() as u64);
    let job_bytes = layout.job_bytes;
    let slots = layout.slots_of(blocks)?;
    let rows = job.shape.max_block_rows() as u64;
    let columns = job.shape.columns() as u64;
    // Encoded entries lie in two buffers, one filled while the other is written.
    let staging = 2 * layout.staging_bytes() as u64;
    let table = u64::from(job.shape.block_count());
    let side = layout.side_bytes(rows, columns, columns + u64::from(options.max_probes), true);
    // Planes as they lie in the file, and as they come out of it.
    let pixels = rows / CHANNELS as u64;
    let seen = BlockPlanes::most_seen(pixels, columns);
    let planes = match layout.clusters {
        0 => 0,
        clusters => {
            let decoded = BlockPlanes::fixed_bytes(pixels, clusters.into()) + seen * size_of::<SeenEmission>() as u64;
            layout.planes_bytes(rows, seen) + decoded
        }
    };
    Ok(Requirements {
        memory_bytes: staging + 2 * side + planes + table + 2 * job_bytes,
        disk_bytes: layout.slots_offset() + (slots.end - slots.start),
    })
}

fn aligned(bytes: u64) -> u64 {
    bytes.next_multiple_of(PAGE_BYTES)
}

impl StoreLayout {
    pub(super) fn new(job: &Job, options: &StoreOptions, job_bytes: u64) -> Self {
        let StoreOptions { precision, max_probes, .. } = *options;
        let clusters = if options.planes { Clusters::of_basis(&job.basis).count() as u32 } else { 0 };
        let features = if clusters > 0 { FEATURE_PLANES as u32 } else { 0 };
        Self { shape: job.shape, precision, max_probes, clusters, features, job_bytes }
    }

    /// Whether blocks are stored in the same bytes as in a file of another layout, whatever the length of its description.
    pub(super) fn has_same_tiles(&self, other: &Self) -> bool {
        *self == Self { job_bytes: self.job_bytes, ..*other }
    }

    /// Whether there is room for what the samples of each block are.
    pub fn has_planes(&self) -> bool {
        self.clusters > 0
    }

    /// Most probe lightings that a block's noise may hold.
    pub fn max_probes(&self) -> u32 {
        self.max_probes
    }

    /// Offset of the job description, which follows the header page.
    pub fn job_offset(&self) -> u64 {
        PAGE_BYTES
    }

    /// Offset of the commit table.
    pub fn table_offset(&self) -> u64 {
        self.job_offset() + aligned(self.job_bytes)
    }

    /// Offset of a block's commit record.
    pub fn record_offset(&self, id: BlockId) -> u64 {
        self.table_offset() + u64::from(id.0) * RECORD_BYTES
    }

    /// Offset of the first slot.
    pub fn slots_offset(&self) -> u64 {
        self.table_offset() + aligned(u64::from(self.shape.block_count()) * RECORD_BYTES)
    }

    /// Offset of a block's slot: the slots stand in block order without gaps, those at the right and bottom edges
    /// smaller.
    pub fn slot_offset(&self, id: BlockId) -> u64 {
        let shape = self.shape;
        let (across, down) = (u64::from(shape.blocks_across()), u64::from(shape.blocks_down()));
        let (x, y) = (u64::from(id.0) % across, u64::from(id.0) / across);
        let height = |y| {
            if y + 1 == down { shape.height() - (down - 1) as u32 * shape.block_side() } else { shape.block_side() }
        };
        let right = shape.width() - (across - 1) as u32 * shape.block_side();
        let band = |height: u32| {
            (across - 1) * self.slot_bytes_of(shape.block_side().min(shape.width()), height)
                + self.slot_bytes_of(right, height)
        };
        let above = if y == 0 { 0 } else { y * band(height(0)) };
        self.slots_offset() + above + x * self.slot_bytes_of(shape.block_side().min(shape.width()), height(y))
    }

    /// The bytes of the file that hold the slots of a range of blocks.
    pub(super) fn slots_of(&self, blocks: Range<u32>) -> Result<Range<u64>> {
        let count = self.shape.block_count();
        if blocks.is_empty() || blocks.end > count {
            let place = format!("blocks {}..{}", blocks.start, blocks.end);
            return Err(Error::input(place, format!("the image has blocks 0..{count}"), "give a range inside it"));
        }
        let last = BlockId(blocks.end - 1);
        Ok(self.slot_offset(BlockId(blocks.start))..self.slot_offset(last) + self.slot_bytes(last))
    }

    /// Bytes of a block's slot: what it takes with every column and all its noise.
    pub fn slot_bytes(&self, id: BlockId) -> u64 {
        let rect = self.shape.rect(id);
        self.slot_bytes_of(rect.width, rect.height)
    }

    fn slot_bytes_of(&self, width: u32, height: u32) -> u64 {
        let rows = u64::from(width) * u64::from(height) * CHANNELS as u64;
        let columns = self.shape.columns() as u64;
        let planes = if self.has_planes() { self.planes_bytes(rows, self.most_seen(rows)) } else { 0 };
        aligned(self.tile_bytes(rows, columns, u64::from(self.max_probes), true) + planes)
    }

    /// Bytes of the file.
    pub fn file_bytes(&self) -> u64 {
        let last = BlockId(self.shape.block_count() - 1);
        self.slot_offset(last) + self.slot_bytes(last)
    }

    /// Bytes of a buffer that holds a few columns, or the largest one.
    pub(super) fn staging_bytes(&self) -> usize {
        STAGING_BYTES.max(self.shape.max_block_rows() * self.precision.entry_bytes())
    }

    /// Bytes of the columns and probes of a tile.
    pub(super) fn column_bytes(&self, rows: u64, stored: u64) -> u64 {
        rows * stored * self.precision.entry_bytes() as u64
    }

    /// Emitters that a block's planes may list.
    pub(super) fn most_seen(&self, rows: u64) -> u64 {
        BlockPlanes::most_seen(rows / CHANNELS as u64, self.shape.columns() as u64)
    }

    /// Bytes of a block's planes, which list `seen` emitters.
    pub(super) fn planes_bytes(&self, rows: u64, seen: u64) -> u64 {
        let features = rows / CHANNELS as u64 * u64::from(self.features) * 6;
        let light = rows * u64::from(self.clusters) * 4 * 2;
        (features + light).next_multiple_of(4) + seen * size_of::<SeenEmission>() as u64
    }

    /// Bytes of a tile without its planes: columns, probes, padding to 8, side data. Nothing at all where there is
    /// nothing to say.
    pub(super) fn tile_bytes(&self, rows: u64, stored_columns: u64, probes: u64, noise: bool) -> u64 {
        let stored = stored_columns + if noise { probes } else { 0 };
        if stored_columns == 0 && !noise {
            return 0;
        }
        self.column_bytes(rows, stored).next_multiple_of(8)
            + self.side_bytes(rows, self.shape.columns() as u64, stored, noise)
    }

    /// Bytes of the side data: which columns are stored, a checksum (and a scale) for each stored one, the variances.
    pub(super) fn side_bytes(&self, rows: u64, columns: u64, stored: u64, noise: bool) -> u64 {
        let scales = if self.precision.has_scale() { stored * 4 } else { 0 };
        let variances = if noise { (rows + columns) * 4 } else { 0 };
        columns.div_ceil(32) * 4 + stored * 4 + scales + variances
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_follow_each_other_without_gap_or_overlap() {
        for (width, height, side) in [(1, 1, 32), (33, 31, 32), (100, 70, 16), (7, 300, 256), (64, 64, 32)] {
            for precision in Precision::ALL {
                let shape = MatrixShape::new(width, height, 5, side).unwrap();
                let layout = StoreLayout { shape, precision, max_probes: 2, clusters: 3, features: 11, job_bytes: 100 };
                let mut end = layout.slots_offset();
                for id in shape.blocks() {
                    assert_eq!(layout.slot_offset(id), end, "{width}×{height} by {side}, {id}");
                    end += layout.slot_bytes(id);
                    assert_eq!(end % PAGE_BYTES, 0);
                }
                assert_eq!(layout.file_bytes(), end);
            }
        }
    }

    #[test]
    fn the_largest_shape_does_not_overflow() {
        let shape = MatrixShape::new(65_536, 65_536, 1 << 24, 256).unwrap();
        let layout = StoreLayout {
            shape,
            precision: Precision::F32,
            max_probes: 16,
            clusters: 24,
            features: 11,
            job_bytes: 1 << 30,
        };
        assert!(layout.file_bytes() > shape.raw_bytes());
    }
}
