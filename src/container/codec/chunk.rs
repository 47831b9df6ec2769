//! The start of a chunk: how it is coded, how much it holds, and where its streams lie.

use std::ops::Range;

/// The coding of a chunk is its first byte. In this one, right sides of shared components are those of the base layer.
pub(super) const CODING_SHARED: u8 = 1;
/// As [`CODING_SHARED`], but the right sides of shared components are stored, as differences from the base layer's.
pub(super) const CODING_REFINED: u8 = 2;
/// As [`CODING_REFINED`], with a compact start, tiles for each component, and low bits apart. Writers use this and the following.
pub(super) const CODING_APART: u8 = 3;
/// As [`CODING_APART`], where bands of the right sides have steps of their own.
pub(super) const CODING_BANDS: u8 = 4;
/// As [`CODING_BANDS`], where the zones of left sides have the steps of [`zone_steps`](super::planes::zone_steps).
pub(super) const CODING_ZONES: u8 = 5;

/// Bytes before the streams with the first two codings: coding, shared, rank, sparse entries, bytes of the side stream.
const LONG_BYTES: usize = 12;
/// With these, a component's steps and rotation alone take more bytes than this.
const LONG_COMPONENT_BYTES: usize = 6;
/// Bytes of a chunk for each component at least; a writer fills up with zeros.
pub(super) const MIN_COMPONENT_BYTES: usize = 4;

/// Content and layout of a chunk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Chunk {
    pub(super) coding: u8,
    /// Components that refine the base layer's first ones.
    pub(super) shared: usize,
    pub(super) rank: usize,
    pub(super) sparse_entries: usize,
    /// Interleaved states of the coefficients.
    pub(super) states: usize,
    pub(super) side: Range<usize>,
    pub(super) low_bits: Range<usize>,
    pub(super) values: Range<usize>,
}

impl Chunk {
    /// Reads the start of a chunk. Errors: unknown coding, or lengths beyond its end.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let cut_short = || "the chunk is cut short".to_owned();
        let mut chunk = Self { coding: *bytes.first().ok_or_else(cut_short)?, ..Self::default() };
        let (start, side_bytes, low_bytes) = match chunk.coding {
            CODING_SHARED | CODING_REFINED => {
                let header = bytes.get(..LONG_BYTES).ok_or_else(cut_short)?;
                let number = |at: usize| u32::from_le_bytes(header[at..at + 4].try_into().expect("4 bytes")) as usize;
                chunk.shared = usize::from(header[1]);
                chunk.rank = usize::from(u16::from_le_bytes([header[2], header[3]]));
                chunk.sparse_entries = number(4);
                chunk.states = 4;
                (LONG_BYTES, number(8), 0)
            }
            CODING_APART | CODING_BANDS | CODING_ZONES => {
                let mut rest = &bytes[1..];
                let mut number = || read_number(&mut rest).ok_or_else(cut_short);
                chunk.shared = number()?;
                chunk.rank = number()?;
                chunk.sparse_entries = number()?;
                let side = number()?;
                let low_bytes = number()?;
                chunk.states = if side % 2 == 0 { 1 } else { super::rans::MAX_STATES };
                (bytes.len() - rest.len(), side / 2, low_bytes)
            }
            unknown => return Err(format!("the chunk is coded in an unknown way ({unknown})")),
        };
        // Each number is below 2³², so that sums do not overflow.
        chunk.side = start..start + side_bytes;
        chunk.low_bits = chunk.side.end..chunk.side.end + low_bytes;
        if chunk.low_bits.end > bytes.len() {
            return Err(cut_short());
        }
        chunk.values = chunk.low_bits.end..bytes.len();
        Ok(chunk)
    }

    /// Holds what is claimed to what a block can have and to what the bytes can hold.
    pub(super) fn check(&self, rows: usize, columns: usize, base_rank: usize) -> Result<(), String> {
        if self.shared > self.rank || self.shared > base_rank {
            return Err(format!("the chunk shares {} components that are not there", self.shared));
        }
        let enough = match self.coding {
            CODING_APART | CODING_BANDS | CODING_ZONES => self.rank * MIN_COMPONENT_BYTES <= self.values.end,
            _ => self.rank * LONG_COMPONENT_BYTES <= self.side.len(),
        };
        if self.rank > rows.min(columns) + self.shared || !enough || self.sparse_entries > rows * columns {
            let (rank, entries) = (self.rank, self.sparse_entries);
            return Err(format!("the chunk claims rank {rank} and {entries} sparse entries"));
        }
        Ok(())
    }

    /// Whether bands of right sides have steps of their own.
    pub(super) fn has_band_steps(&self) -> bool {
        matches!(self.coding, CODING_BANDS | CODING_ZONES)
    }

    /// Whether the right sides of shared components are stored as what the base layer's lack.
    pub(super) fn refines_right(&self) -> bool {
        self.coding != CODING_SHARED
    }

    /// A chunk of one of the newest codings, which begin alike.
    pub(super) fn write(
        coding: u8,
        counts: [usize; 3],
        side: &[u8],
        low_bits: &[u8],
        values: &[u8],
        is_long: bool,
    ) -> Vec<u8> {
        let mut bytes = vec![coding];
        let lengths = [side.len() * 2 + usize::from(is_long), low_bits.len()];
        counts.into_iter().chain(lengths).for_each(|number| write_number(&mut bytes, number));
        [side, low_bits, values].into_iter().for_each(|stream| bytes.extend(stream));
        bytes
    }
}

/// Seven bits a byte, lowest first; the highest bit says that more follow.
fn write_number(bytes: &mut Vec<u8>, mut number: usize) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// `None` where the bytes end, or for a number of 2³² or more.
fn read_number(bytes: &mut &[u8]) -> Option<usize> {
    let mut number = 0u64;
    for shift in (0..35).step_by(7) {
        let byte;
        (byte, *bytes) = bytes.split_first()?;
        number |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return u32::try_from(number).ok().map(|number| number as usize);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_length_come_back_and_larger_ones_do_not() {
        for number in [0, 1, 127, 128, 16_383, 16_384, 1 << 21, u32::MAX as usize] {
            let mut bytes = Vec::new();
            write_number(&mut bytes, number);
            assert_eq!(read_number(&mut bytes.as_slice()), Some(number));
            assert_eq!(read_number(&mut &bytes[..bytes.len() - 1]), None);
        }
        assert_eq!(read_number(&mut [0xff; 9].as_slice()), None);
        assert_eq!(read_number(&mut [0xff, 0xff, 0xff, 0xff, 0x7f].as_slice()), None);
    }

    #[test]
    fn a_start_is_read_as_it_was_written() {
        for coding in [CODING_APART, CODING_BANDS, CODING_ZONES] {
            let bytes = Chunk::write(coding, [2, 300, 70_000], &[1; 200], &[2; 5], &[3; 40], true);
            let chunk = Chunk::parse(&bytes).unwrap();
            assert_eq!((chunk.coding, chunk.shared, chunk.rank, chunk.sparse_entries), (coding, 2, 300, 70_000));
            assert!(bytes[chunk.side.clone()] == [1; 200] && bytes[chunk.low_bits.clone()] == [2; 5]);
            assert!(bytes[chunk.values.clone()] == [3; 40] && chunk.states == super::super::rans::MAX_STATES);
            for length in 0..chunk.values.start {
                assert!(Chunk::parse(&bytes[..length]).is_err(), "cut at {length}");
            }
        }
    }
}
