//! The commit record of a block.

use crate::matrix::BlockId;

use super::{RECORD_BYTES, StoreLayout, disk_structure};

/// State of a committed block; an uncommitted block's record is all zero.
pub const COMMITTED: u32 = 1;
/// The block's source knew nothing of its noise.
pub const NOISE_NONE: u32 = 0;
/// The noise is stored in the tile.
pub const NOISE_STORED: u32 = 1;
/// The noise is known and zero throughout, so nothing of it is stored.
pub const NOISE_ZERO: u32 = 2;

/// The planes are stored in the tile; 0 where there are none.
pub const PLANES_STORED: u32 = 1;

disk_structure! {
    /// A commit record as it lies in the commit table.
    RecordBytes,
    /// Fields of a commit record.
    RECORD_FIELDS {
        checksum: u32,
        state: u32,
        block: u32,
        noise: u32,
        offset: u64,
        length: u64,
        stored_columns: u32,
        probes: u32,
        side_checksum: u32,
        planes: u32,
        seen: u32,
        planes_checksum: u32,
        reserved: [u32; 2],
    }
}

const _: () = assert!(size_of::<RecordBytes>() as u64 == RECORD_BYTES);

/// A record as read: not to be believed.
#[derive(Clone, Copy)]
pub(super) struct UnverifiedRecord(pub(super) [u8; RECORD_BYTES as usize]);

/// The content of a verified record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TileRecord {
    /// Bytes of the tile, from the start of the slot; 0 for a block that holds nothing.
    pub(super) length: u64,
    /// Columns that are not zero throughout.
    pub(super) stored_columns: u32,
    /// Probe lightings of the noise.
    pub(super) probes: u32,
    /// One of the `NOISE_` constants.
    pub(super) noise: u32,
    /// Checksum of the side data.
    pub(super) side_checksum: u32,
    /// What is said of the planes, where they are stored.
    pub(super) planes: Option<PlanesRecord>,
}

/// The planes of a block, from its verified record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PlanesRecord {
    /// Emitters in view that they list.
    pub(super) seen: u32,
    /// Checksum of the planes.
    pub(super) checksum: u32,
}

impl TileRecord {
    /// Probes that lie in the tile.
    pub(super) fn stored_probes(&self) -> u32 {
        if self.noise == NOISE_STORED { self.probes } else { 0 }
    }

    /// Columns and probes that lie in the tile.
    pub(super) fn stored(&self) -> u64 {
        u64::from(self.stored_columns) + u64::from(self.stored_probes())
    }

    /// Bytes of the planes in the tile.
    pub(super) fn planes_bytes(&self, layout: &StoreLayout, rows: u64) -> u64 {
        self.planes.map_or(0, |planes| layout.planes_bytes(rows, planes.seen.into()))
    }

    /// Whether the tile holds columns or noise, and so side data.
    pub(super) fn has_main(&self, layout: &StoreLayout, rows: usize) -> bool {
        self.length > self.planes_bytes(layout, rows as u64)
    }

    /// Bytes of the tile of a block of `rows`.
    pub(super) fn tile_bytes(&self, layout: &StoreLayout, rows: u64) -> u64 {
        let (columns, probes) = (u64::from(self.stored_columns), u64::from(self.stored_probes()));
        layout.tile_bytes(rows, columns, probes, self.noise == NOISE_STORED) + self.planes_bytes(layout, rows)
    }

    pub(super) fn encode(&self, layout: &StoreLayout, id: BlockId) -> [u8; RECORD_BYTES as usize] {
        let mut fields = RecordBytes {
            checksum: 0,
            state: COMMITTED,
            block: id.0,
            noise: self.noise,
            offset: layout.slot_offset(id),
            length: self.length,
            stored_columns: self.stored_columns,
            probes: self.probes,
            side_checksum: self.side_checksum,
            planes: if self.planes.is_some() { PLANES_STORED } else { 0 },
            seen: self.planes.map_or(0, |planes| planes.seen),
            planes_checksum: self.planes.map_or(0, |planes| planes.checksum),
            reserved: [0; 2],
        };
        fields.checksum = crc32fast::hash(&bytemuck::bytes_of(&fields)[4..]);
        bytemuck::cast(fields)
    }
}

impl UnverifiedRecord {
    /// Whether it is the record of a block that is not committed.
    pub(super) fn is_blank(&self) -> bool {
        self.0.iter().all(|&byte| byte == 0)
    }

    /// Believes the record once its checksum holds and it says nothing that the layout does not allow; `None` for a
    /// block that is not committed. Errors, as plain text for the caller to place.
    pub(super) fn verify(&self, layout: &StoreLayout, id: BlockId) -> Result<Option<TileRecord>, String> {
        if self.is_blank() {
            return Ok(None);
        }
        let fields: RecordBytes = bytemuck::cast(self.0);
        if crc32fast::hash(&self.0[4..]) != fields.checksum {
            return Err("the commit record's checksum does not hold".into());
        }
        let RecordBytes { length, stored_columns, probes, noise, side_checksum, .. } = fields;
        let stored = PlanesRecord { seen: fields.seen, checksum: fields.planes_checksum };
        let planes = (fields.planes == PLANES_STORED).then_some(stored);
        let record = TileRecord { length, stored_columns, probes, noise, side_checksum, planes };
        let rows = layout.shape.rect(id).rows() as u64;
        let planes_fit = match planes {
            Some(planes) => layout.has_planes() && u64::from(planes.seen) <= layout.most_seen(rows),
            None => (fields.planes, fields.seen, fields.planes_checksum) == (0, 0, 0),
        };
        let in_range = fields.state == COMMITTED
            && fields.block == id.0
            && fields.offset == layout.slot_offset(id)
            && stored_columns as usize <= layout.shape.columns()
            && probes <= layout.max_probes
            && noise <= NOISE_ZERO
            && (noise != NOISE_NONE || probes == 0)
            && planes_fit
            && fields.reserved == [0; 2]
            && length == record.tile_bytes(layout, rows);
        if in_range { Ok(Some(record)) } else { Err("the commit record is out of range".into()) }
    }
}
