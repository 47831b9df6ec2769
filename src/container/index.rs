//! The index of an open container: its bytes as they stand in the file, checked once, records decoded when asked for.

use std::ops::Range;

use rayon::prelude::*;

use super::format::{
    BLOCK_RECORD_BYTES, BlockRecord, HEADER_BYTES, LAYER_RECORD_BYTES, LayerRecord, MAX_LAYERS, TRAILER_BYTES, Trailer,
};

/// Bytes that one thread takes at a time: as many as its caches hold.
pub(super) const PIECE_BYTES: usize = 1 << 20;

/// Block and layer records of a container.
#[derive(Debug)]
pub(super) struct Index {
    /// The end of the file.
    bytes: Vec<u8>,
    blocks: Range<usize>,
    layers: Range<usize>,
    base_end: u64,
}

impl Index {
    /// Takes the end of a file, of which `trailer` was read, and holds it to its checksum and to the one order that
    /// chunks may have. Also returns the metadata.
    ///
    /// Errors, as plain text for the caller to place: what does not hold. Panics where `end` is shorter than the trailer says.
    pub(super) fn of(mut end: Vec<u8>, trailer: &Trailer) -> Result<(Self, Vec<u8>), String> {
        let tail_bytes = trailer.tail_bytes() as usize;
        if tail_bytes < end.len() / 2 {
            end = end[end.len() - tail_bytes..].to_vec();
        }
        let begin = end.len() - tail_bytes;
        let tail = &end[begin..end.len() - TRAILER_BYTES];
        let blocks_begin = begin + trailer.metadata_bytes as usize;
        let layers_begin = blocks_begin + trailer.block_count as usize * BLOCK_RECORD_BYTES;
        let (blocks, layers) = (blocks_begin..layers_begin, layers_begin..end.len() - TRAILER_BYTES);
        let check = || check_order(&end[blocks.clone()], &end[layers.clone()], trailer.metadata_offset);
        let (crc, order) = match tail.len() {
            0..=PIECE_BYTES => (crc32fast::hash(tail), check()),
            _ => rayon::join(|| checksum(tail), check),
        };
        if crc != trailer.tail_crc {
            return Err("the checksum of metadata and index does not fit".into());
        }
        let base_end = order?;
        let metadata = end[begin..blocks_begin].to_vec();
        Ok((Self { bytes: end, blocks, layers, base_end }, metadata))
    }

    /// The record of a block. Panics beyond the last.
    pub(super) fn block(&self, index: usize) -> BlockRecord {
        let bytes = &self.bytes[self.blocks.clone()][index * BLOCK_RECORD_BYTES..][..BLOCK_RECORD_BYTES];
        BlockRecord::decode(bytes).expect("records were checked when the file was opened")
    }

    /// The record of a layer. Panics beyond the last.
    pub(super) fn layer(&self, index: usize) -> LayerRecord {
        LayerRecord::decode(&self.bytes[self.layers.clone()][index * LAYER_RECORD_BYTES..][..LAYER_RECORD_BYTES])
    }

    /// End of the base layers in the file.
    pub(super) fn base_end(&self) -> u64 {
        self.base_end
    }

    /// What says of every block where and what it is: the records of blocks and layers, with the checksum of each chunk.
    pub(super) fn record_bytes(&self) -> [&[u8]; 2] {
        [&self.bytes[self.blocks.clone()], &self.bytes[self.layers.clone()]]
    }

    /// Memory that it takes.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.len() as u64
    }
}

/// CRC-32 of the bytes, in pieces on all threads.
fn checksum(bytes: &[u8]) -> u32 {
    let of_piece = |piece: &[u8]| {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(piece);
        hasher
    };
    let pieces: Vec<_> = bytes.par_chunks(PIECE_BYTES).map(of_piece).collect();
    let mut whole = crc32fast::Hasher::new();
    pieces.iter().for_each(|piece| whole.combine(piece));
    whole.finalize()
}

/// Holds the records to the one order that they may have, in one pass over both. Returns where the base layers end.
fn check_order(blocks: &[u8], layers: &[u8], chunks_end: u64) -> Result<u64, String> {
    let mut rest = layers.chunks_exact(LAYER_RECORD_BYTES).map(LayerRecord::decode);
    // Of each layer: where its first chunk begins, and where its last one so far ends.
    let (mut begins, mut ends, mut depth) = ([0u64; MAX_LAYERS], [0u64; MAX_LAYERS], 0);
    let mut next_layer = 0u64;
    let claimed = || blocks.chunks_exact(BLOCK_RECORD_BYTES).map(|record| u64::from(record[4])).sum::<u64>();
    let miscounted =
        || format!("the index has {} layers but its blocks {}", layers.len() / LAYER_RECORD_BYTES, claimed());
    for record in blocks.chunks_exact(BLOCK_RECORD_BYTES) {
        let record = BlockRecord::decode(record).ok_or("a block's record in the index has bytes without a meaning")?;
        if u64::from(record.first_layer) != next_layer || (record.layers > 0 && !record.present) {
            return Err("the index does not number its layers in order".into());
        }
        next_layer += u64::from(record.layers);
        for layer in 0..usize::from(record.layers) {
            let chunk = rest.next().ok_or_else(miscounted)?;
            if layer == depth {
                (begins[layer], ends[layer], depth) = (chunk.offset, chunk.offset, depth + 1);
            }
            if chunk.offset != ends[layer] {
                return Err("the index does not place its chunks one after the other".into());
            }
            // Cannot overflow where the first chunk begins right: there are 2³² chunks of 2³² bytes at most.
            ends[layer] = ends[layer].wrapping_add(u64::from(chunk.bytes));
        }
    }
    if rest.next().is_some() {
        return Err(miscounted());
    }
    let mut offset = HEADER_BYTES as u64;
    for (&begin, &end) in begins.iter().zip(&ends).take(depth) {
        if begin != offset {
            return Err("the index does not place its chunks one after the other".into());
        }
        offset = end;
    }
    if offset != chunks_end {
        return Err("the chunks do not reach to the metadata".into());
    }
    Ok(if depth > 0 { ends[0] } else { HEADER_BYTES as u64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Records of blocks with so many layers of so many bytes each, in order.
    fn records(blocks: &[&[u32]]) -> (Vec<u8>, Vec<u8>, u64) {
        let depth = blocks.iter().map(|layers| layers.len()).max().unwrap_or(0);
        let mut places: Vec<Vec<u64>> = blocks.iter().map(|layers| vec![0; layers.len()]).collect();
        let mut offset = HEADER_BYTES as u64;
        for layer in 0..depth {
            for (places, sizes) in places.iter_mut().zip(blocks).filter(|(places, _)| layer < places.len()) {
                places[layer] = offset;
                offset += u64::from(sizes[layer]);
            }
        }
        let (mut block_bytes, mut layer_bytes, mut first_layer) = (Vec::new(), Vec::new(), 0);
        for (places, sizes) in places.iter().zip(blocks) {
            let record = BlockRecord { first_layer, layers: sizes.len() as u8, present: true, ..Default::default() };
            block_bytes.extend(record.encode());
            first_layer += sizes.len() as u32;
            for (&offset, &bytes) in places.iter().zip(*sizes) {
                layer_bytes.extend(LayerRecord { offset, bytes, crc: 0 }.encode());
            }
        }
        (block_bytes, layer_bytes, offset)
    }

    #[test]
    fn only_the_one_order_is_accepted() {
        let (blocks, layers, end) = records(&[&[5, 7], &[], &[3], &[2, 0, 9]]);
        assert_eq!(check_order(&blocks, &layers, end), Ok(64 + 10));
        assert_eq!(check_order(&[], &[], 64), Ok(64));
        assert!(check_order(&blocks, &layers, end + 1).unwrap_err().contains("reach"));
        let cut = &layers[..layers.len() - LAYER_RECORD_BYTES];
        assert!(check_order(&blocks, cut, end).unwrap_err().contains("5 layers but its blocks 6"));
        let more = [&layers[..], &[0; LAYER_RECORD_BYTES]].concat();
        assert!(check_order(&blocks, &more, end).unwrap_err().contains("7 layers but its blocks 6"));
        // No single number can be changed: neither an offset or a size, nor a first layer or a count.
        for at in 0..layers.len() {
            let mut changed = layers.clone();
            changed[at] ^= 1;
            let is_placed = at % LAYER_RECORD_BYTES < 12;
            assert_eq!(check_order(&blocks, &changed, end).is_err(), is_placed, "byte {at} of the layers");
        }
        for at in 0..blocks.len() {
            let mut changed = blocks.clone();
            changed[at] ^= 2;
            let (record, field) = (at / BLOCK_RECORD_BYTES, at % BLOCK_RECORD_BYTES);
            // A block without layers has neither rank nor sparse entries; any figure may stand in a report.
            let is_free = (12..28).contains(&field) || ((6..12).contains(&field) && record != 1);
            assert_eq!(check_order(&changed, &layers, end).is_err(), !is_free, "byte {at}");
        }
    }

    #[test]
    fn a_checksum_in_pieces_is_that_of_the_whole() {
        let bytes: Vec<u8> = (0..3 * PIECE_BYTES + 17).map(|i| ((i * i) >> 7) as u8).collect();
        assert_eq!(checksum(&bytes), crc32fast::hash(&bytes));
    }
}
