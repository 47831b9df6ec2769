//! Bits of coefficients that are stored as they are: the lowest bits in wide bands, and values without a symbol. They
//! are one bit string, lowest bit first in each byte.

/// Collects bits.
#[derive(Default)]
pub(super) struct LowBitsWriter {
    bytes: Vec<u8>,
    /// Bits that wait for a whole byte, and how many.
    rest: u64,
    rest_bits: u32,
}

impl LowBitsWriter {
    /// Adds the lowest `count` bits of a value, at most 24.
    pub(super) fn push(&mut self, value: u32, count: u32) {
        self.rest |= u64::from(value & ((1 << count) - 1)) << self.rest_bits;
        self.rest_bits += count;
        while self.rest_bits >= 8 {
            self.bytes.push(self.rest as u8);
            self.rest >>= 8;
            self.rest_bits -= 8;
        }
    }

    /// The bytes of everything pushed, the last one filled up with zeros.
    pub(super) fn finish(mut self) -> Vec<u8> {
        if self.rest_bits > 0 {
            self.bytes.push(self.rest as u8);
        }
        self.bytes
    }
}

/// Reads bits back.
pub(super) struct LowBits<'a> {
    bytes: &'a [u8],
    bit: usize,
}

impl<'a> LowBits<'a> {
    /// Starts on the bytes that a writer made.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, bit: 0 }
    }

    /// Makes room for `count` bits, at most 16, below each value and reads them there. Beyond the end they are zeros,
    /// which [`finish`](Self::finish) notices.
    #[inline(always)]
    pub(super) fn read(&mut self, values: &mut [i32], count: u32) {
        // As many values at a time as fit into a 64-bit word, wherever in a byte they begin.
        match count {
            1 => self.read_words::<1, 8>(values),
            2 => self.read_words::<2, 8>(values),
            3 => self.read_words::<3, 8>(values),
            4 => self.read_words::<4, 8>(values),
            5 => self.read_words::<5, 8>(values),
            6 => self.read_words::<6, 8>(values),
            7 => self.read_words::<7, 8>(values),
            8 => self.read_words::<8, 4>(values),
            9 => self.read_words::<9, 4>(values),
            10 => self.read_words::<10, 4>(values),
            11 => self.read_words::<11, 4>(values),
            12 => self.read_words::<12, 4>(values),
            _ => self.read_slowly(values, count),
        }
    }

    #[inline(always)]
    fn read_words<const COUNT: u32, const LANES: usize>(&mut self, values: &mut [i32]) {
        let (groups, rest) = values.as_chunks_mut::<LANES>();
        for group in groups {
            let Some(word) = self.bytes.get(self.bit / 8..).and_then(|bytes| bytes.first_chunk::<8>()) else {
                self.read_slowly(group, COUNT);
                continue;
            };
            let word = u64::from_le_bytes(*word) >> (self.bit % 8);
            for (i, value) in group.iter_mut().enumerate() {
                *value = *value << COUNT | ((word >> (i as u32 * COUNT)) & ((1 << COUNT) - 1)) as i32;
            }
            self.bit += LANES * COUNT as usize;
        }
        self.read_slowly(rest, COUNT);
    }

    #[inline(always)]
    fn read_slowly(&mut self, values: &mut [i32], count: u32) {
        for value in values {
            *value = *value << count | self.take(count) as i32;
        }
    }

    /// The next `count` bits, at most 24.
    #[inline(always)]
    pub(super) fn take(&mut self, count: u32) -> u32 {
        let word = match self.bytes.get(self.bit / 8..).and_then(|bytes| bytes.first_chunk::<4>()) {
            Some(bytes) => u32::from_le_bytes(*bytes),
            None => self.last_word(),
        };
        let bits = word >> (self.bit % 8) & ((1 << count) - 1);
        self.bit += count as usize;
        bits
    }

    #[cold]
    fn last_word(&self) -> u32 {
        let byte = |i: usize| u32::from(self.bytes.get(self.bit / 8 + i).copied().unwrap_or(0));
        byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24
    }

    /// Checks that everything was read and nothing more.
    pub(super) fn finish(self) -> Result<(), String> {
        if self.bit.div_ceil(8) == self.bytes.len() {
            Ok(())
        } else {
            Err("the low bits do not end where the coefficients do".into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_every_length_come_back() {
        let values: Vec<i32> = (0..77).map(|i: i32| i.wrapping_mul(0x5bd1_e995) >> 3).collect();
        let mut writer = LowBitsWriter::default();
        for count in 1..=16 {
            values[..60 + count as usize].iter().for_each(|&value| writer.push(value as u32, count));
        }
        writer.push(0xab_cdef, 24);
        let bytes = writer.finish();
        let mut reader = LowBits::new(&bytes);
        for count in 1..=16u32 {
            let mut read: Vec<i32> = values[..60 + count as usize].iter().map(|v| v >> count).collect();
            reader.read(&mut read, count);
            assert_eq!(read, values[..60 + count as usize], "{count} bits");
        }
        assert_eq!(reader.take(24), 0xab_cdef);
        reader.finish().unwrap();
        let mut short = LowBits::new(&bytes[..3]);
        short.read(&mut [0; 9], 3);
        assert!(short.finish().is_err());
    }
}
