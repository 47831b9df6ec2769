//! Writing what stands in a block's slot. Where entries are encoded, the next columns are while the last are written.

use crate::matrix::{BlockNoise, BlockView, ColumnIndex, TracedBlock};

use super::layout::STAGING_BYTES;
use super::planes::encode_planes;
use super::record::{PlanesRecord, TileRecord};
use super::storage::{Storage, write_all};
use super::tile::SideData;
use super::{NOISE_NONE, NOISE_STORED, NOISE_ZERO, Precision, StoreLayout};

/// Writes tiles into a storage.
pub(super) struct TileWriter<'a, S> {
    pub(super) storage: &'a S,
    pub(super) layout: &'a StoreLayout,
}

impl<S: Storage> TileWriter<'_, S> {
    /// Writes a block's tile at `slot`, which nobody else may do meanwhile, and returns its record.
    pub(super) fn write(&self, slot: u64, block: &TracedBlock) -> std::io::Result<TileRecord> {
        let (view, noise) = (block.block.view(), block.noise.as_ref());
        let rows = view.rows();
        let is_zero = |values: &[f32]| values.iter().all(|value| value.to_bits() == 0);
        let noise_kind = match noise {
            None => NOISE_NONE,
            Some(noise) if [&noise.row_variance, &noise.column_variance, &noise.probes].iter().all(|v| is_zero(v)) => {
                NOISE_ZERO
            }
            Some(_) => NOISE_STORED,
        };
        let stored_noise = noise.filter(|_| noise_kind == NOISE_STORED);
        let mut side = SideData {
            columns: (0..view.columns() as u32).filter(|&c| !is_zero(view.column(ColumnIndex(c)))).collect(),
            row_variance: stored_noise.map_or(vec![], |noise| noise.row_variance.clone()),
            column_variance: stored_noise.map_or(vec![], |noise| noise.column_variance.clone()),
            ..SideData::default()
        };
        let probes = noise.map_or(0, |noise| (noise.probes.len() / rows) as u32);
        let mut record = TileRecord {
            length: 0,
            stored_columns: side.columns.len() as u32,
            probes,
            noise: noise_kind,
            side_checksum: 0,
            planes: None,
        };
        // A file without room for planes leaves them out.
        if let Some(planes) = block.planes.as_ref().filter(|_| self.layout.has_planes()) {
            record.planes = Some(PlanesRecord { seen: planes.emission.len() as u32, checksum: 0 });
        }
        record.length = record.tile_bytes(self.layout, rows as u64);
        let planes_start = record.length - record.planes_bytes(self.layout, rows as u64);
        if let (Some(said), Some(planes)) = (&mut record.planes, &block.planes) {
            let bytes = encode_planes(planes, self.layout);
            said.checksum = crc32fast::hash(&bytes);
            write_all(self.storage, slot + planes_start, &bytes)?;
        }
        if planes_start > 0 {
            let end = self.write_columns(slot, view, stored_noise, &mut side)?;
            let padding = (end - slot).next_multiple_of(8) - (end - slot);
            let tail = side.encode(view.columns(), padding as usize);
            record.side_checksum = crc32fast::hash(&tail);
            write_all(self.storage, end, &tail)?;
        }
        Ok(record)
    }

    /// Writes the stored columns, then the probes, and returns where they end.
    fn write_columns(
        &self,
        offset: u64,
        view: BlockView<'_>,
        noise: Option<&BlockNoise>,
        side: &mut SideData,
    ) -> std::io::Result<u64> {
        let column_bytes = view.rows() * self.layout.precision.entry_bytes();
        let at_once = (STAGING_BYTES / column_bytes).max(1);
        let columns = std::mem::take(&mut side.columns);
        let runs = columns.chunk_by(|a, b| a + 1 == *b).flat_map(|run| run.chunks(at_once));
        let parts = runs.map(|part| &view.entries()[part[0] as usize * view.rows()..][..part.len() * view.rows()]);
        let probes = noise.map_or(&[][..], |noise| &noise.probes).chunks(at_once * view.rows());
        let parts = parts.chain(probes);
        let end = match self.layout.precision {
            // Where the entries are stored as they are, they are written from where they lie.
            Precision::F32 => {
                let mut offset = offset;
                for values in parts {
                    let bytes: &[u8] = bytemuck::cast_slice(values);
                    side.checksums.extend(bytes.chunks_exact(column_bytes).map(crc32fast::hash));
                    write_all(self.storage, offset, bytes)?;
                    offset += bytes.len() as u64;
                }
                offset
            }
            _ => self.write_encoded(offset, view.rows(), parts, side)?,
        };
        side.columns = columns;
        Ok(end)
    }

    /// Encodes each part while the one before it is written, and returns where they end.
    fn write_encoded<'a>(
        &self,
        offset: u64,
        rows: usize,
        mut parts: impl Iterator<Item = &'a [f32]>,
        side: &mut SideData,
    ) -> std::io::Result<u64> {
        let precision = self.layout.precision;
        let column_bytes = rows * precision.entry_bytes();
        let mut encode = |values: &[f32], bytes: &mut Vec<u8>| {
            bytes.resize(values.len() * precision.entry_bytes(), 0);
            for (column, bytes) in values.chunks_exact(rows).zip(bytes.chunks_exact_mut(column_bytes)) {
                let scale = precision.encode(column, bytes);
                if precision.has_scale() {
                    side.scales.push(scale);
                }
                side.checksums.push(crc32fast::hash(bytes));
            }
        };
        let mut first = Vec::new();
        encode(parts.next().unwrap_or_default(), &mut first);
        let Some(second) = parts.next() else {
            write_all(self.storage, offset, &first)?;
            return Ok(offset + first.len() as u64);
        };
        // A thread of its own, not one of the pool's: waiting in the pool, this one could take up another block.
        std::thread::scope(|scope| {
            let (full, to_write) = std::sync::mpsc::sync_channel::<Vec<u8>>(0);
            let (written, empty) = std::sync::mpsc::channel();
            let storage = self.storage;
            let writer = scope.spawn(move || {
                let mut offset = offset;
                for bytes in to_write {
                    write_all(storage, offset, &bytes)?;
                    offset += bytes.len() as u64;
                    let _ = written.send(bytes);
                }
                Ok(offset)
            });
            // Fails where the writer has stopped for an error, which it returns.
            let mut going = full.send(first).is_ok();
            let mut spare = Vec::new();
            for values in std::iter::once(second).chain(parts) {
                if !going {
                    break;
                }
                encode(values, &mut spare);
                going = full.send(spare).is_ok();
                spare = empty.recv().unwrap_or_default();
            }
            drop(full);
            writer.join().expect("writing does not panic")
        })
    }
}
