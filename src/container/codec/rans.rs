//! A range coder with asymmetric numeral systems (Duda, *Asymmetric numeral systems*, 2013, §3): four interleaved
//! 32-bit states, 16-bit words.

use super::classes::{ESCAPE, LARGEST, MAX_MAGNITUDE, PROBABILITY_BITS, TOTAL, Table, coding_of, symbol_of};

/// Interleaved states; value `i` of a band uses state `i mod STATES`.
const STATES: usize = 4;
/// States stay at or above this.
const LOWEST: u32 = 1 << 16;

/// Collects values in reading order; the coder itself runs backwards over them at the end.
#[derive(Default)]
pub(super) struct RansEncoder {
    /// State, start and frequency of each step.
    steps: Vec<(u8, u16, u16)>,
}

/// Reads values back.
pub(super) struct RansDecoder<'a> {
    states: [u32; STATES],
    words: &'a [[u8; 2]],
    next: usize,
}

impl RansEncoder {
    /// Adds the values of a band, coded with `class` (not 0).
    pub(super) fn push_band(&mut self, class: u32, values: &[i32]) {
        let (table, shift) = coding_of(class);
        for (i, &value) in values.iter().enumerate() {
            let state = (i % STATES) as u8;
            let high = value >> shift;
            let symbol = symbol_of(high);
            self.steps.push((state, table.start[symbol], table.frequency[symbol]));
            if symbol == ESCAPE {
                let excess = high.unsigned_abs() - LARGEST as u32;
                let length = 31 - excess.leading_zeros();
                self.push_bits(state, length, 5);
                self.push_bits(state, excess - (1 << length), length);
                self.push_bits(state, u32::from(high < 0), 1);
            }
            self.push_bits(state, (value & ((1 << shift) - 1)) as u32, shift);
        }
    }

    fn push_bits(&mut self, state: u8, value: u32, count: u32) {
        let mut left = count;
        while left > 0 {
            let part = left.min(8);
            left -= part;
            let bits = (value >> left) & ((1 << part) - 1);
            let room = PROBABILITY_BITS - part;
            self.steps.push((state, (bits << room) as u16, 1 << room));
        }
    }

    /// The bytes of everything pushed.
    pub(super) fn finish(self) -> Vec<u8> {
        let mut states = [LOWEST; STATES];
        let mut words: Vec<u16> = Vec::new();
        for &(state, start, frequency) in self.steps.iter().rev() {
            let x = &mut states[usize::from(state)];
            let frequency = u32::from(frequency);
            if u64::from(*x) >= u64::from(frequency) << (32 - PROBABILITY_BITS) {
                words.push(*x as u16);
                *x >>= 16;
            }
            *x = ((*x / frequency) << PROBABILITY_BITS) + *x % frequency + u32::from(start);
        }
        let mut bytes = Vec::with_capacity(4 * STATES + 2 * words.len());
        states.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        words.iter().rev().for_each(|word| bytes.extend(word.to_le_bytes()));
        bytes
    }
}

impl<'a> RansDecoder<'a> {
    /// Starts on the bytes that an encoder made.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let (states, words) = bytes.split_at_checked(4 * STATES).ok_or("the coefficients are cut short")?;
        let (words, odd) = words.as_chunks::<2>();
        if !odd.is_empty() {
            return Err("the coefficients have half a word".into());
        }
        let state = |i: usize| u32::from_le_bytes(states[4 * i..4 * i + 4].try_into().expect("4 bytes"));
        Ok(Self { states: std::array::from_fn(state), words, next: 0 })
    }

    /// Reads the values of a band that was coded with `class` (not 0).
    #[inline(always)]
    pub(super) fn read_band(&mut self, class: u32, values: &mut [i32]) {
        let (table, shift) = coding_of(class);
        match shift {
            0 => self.read_coded::<false>(table, 0, values),
            _ => self.read_coded::<true>(table, shift, values),
        }
    }

    #[inline(always)]
    fn read_coded<const SHIFTED: bool>(&mut self, table: &Table, shift: u32, values: &mut [i32]) {
        let (groups, rest) = values.as_chunks_mut::<STATES>();
        for group in groups {
            // A group takes at most two words a value, unless it has an escape or many low bits.
            let words = self.words.get(self.next..self.next + 2 * STATES).filter(|_| shift <= 8);
            let Some(words) = words.and_then(|words| <&[[u8; 2]; 2 * STATES]>::try_from(words).ok()) else {
                self.read_slowly(table, shift, group);
                continue;
            };
            let (mut states, mut taken, mut escapes) = (self.states, 0usize, 0u32);
            let mut renormalise = |x: u32| {
                let word = u32::from(u16::from_le_bytes(words[taken % (2 * STATES)]));
                let low = x < LOWEST;
                taken += usize::from(low);
                if low { x << 16 | word } else { x }
            };
            for (value, x) in group.iter_mut().zip(&mut states) {
                let slot = table.slots[(*x & (TOTAL - 1)) as usize];
                *x = renormalise((slot >> 16) * (*x >> PROBABILITY_BITS) + ((slot & 0xffff) >> 4));
                let symbol = slot & 15;
                escapes |= u32::from(symbol == ESCAPE as u32);
                *value = symbol as i32 - LARGEST;
                if SHIFTED {
                    let room = PROBABILITY_BITS - shift;
                    let slot = *x & (TOTAL - 1);
                    *value = *value << shift | (slot >> room) as i32;
                    *x = renormalise((*x >> PROBABILITY_BITS << room) + (slot & ((1 << room) - 1)));
                }
            }
            if escapes != 0 {
                self.read_slowly(table, shift, group);
                continue;
            }
            self.next += taken;
            self.states = states;
        }
        self.read_slowly(table, shift, rest);
    }

    /// Any values, one by one.
    #[inline(never)]
    fn read_slowly(&mut self, table: &Table, shift: u32, values: &mut [i32]) {
        let mut states = self.states;
        for (value, x) in values.iter_mut().zip(&mut states) {
            let slot = table.slots[(*x & (TOTAL - 1)) as usize];
            *x = (slot >> 16) * (*x >> PROBABILITY_BITS) + ((slot & 0xffff) >> 4);
            if *x < LOWEST {
                *x = *x << 16 | self.word();
            }
            let symbol = (slot & 15) as usize;
            let high = if symbol == ESCAPE { self.read_escape(x) } else { symbol as i32 - LARGEST };
            *value = if shift > 0 { high << shift | self.read_bits(x, shift) as i32 } else { high };
        }
        self.states = states;
    }

    /// Checks that everything was read and nothing more.
    pub(super) fn finish(self) -> Result<(), String> {
        if self.next == self.words.len() && self.states == [LOWEST; STATES] {
            Ok(())
        } else {
            Err("the coefficients do not end where their coder does".into())
        }
    }

    #[cold]
    fn read_escape(&mut self, x: &mut u32) -> i32 {
        let length = self.read_bits(x, 5).min(24);
        let excess = (1 << length) + self.read_bits(x, length);
        let magnitude = ((excess + LARGEST as u32) as i32).min(MAX_MAGNITUDE);
        if self.read_bits(x, 1) == 1 { -magnitude } else { magnitude }
    }

    fn read_bits(&mut self, x: &mut u32, count: u32) -> u32 {
        let (mut left, mut value) = (count, 0);
        while left > 0 {
            let part = left.min(8);
            left -= part;
            let room = PROBABILITY_BITS - part;
            let slot = *x & (TOTAL - 1);
            value = value << part | slot >> room;
            *x = (*x >> PROBABILITY_BITS << room) + (slot & ((1 << room) - 1));
            if *x < LOWEST {
                *x = *x << 16 | self.word();
            }
        }
        value
    }

    /// The next word; zero beyond the end, which [`finish`](Self::finish) notices.
    fn word(&mut self) -> u32 {
        let word = self.words.get(self.next).map_or(0, |w| u32::from(u16::from_le_bytes(*w)));
        self.next += 1;
        word
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_every_class_and_size_come_back() {
        let values: Vec<i32> = (0..400)
            .map(|i| (i * i * 7919) % (3 << (i % 20)) * if i % 3 == 0 { -1 } else { 1 })
            .chain([MAX_MAGNITUDE, -MAX_MAGNITUDE, 0, 8, -8, 7, -7])
            .collect();
        let classes = [1, 2, 8, 9, 10, 11, 20, 40];
        let mut encoder = RansEncoder::default();
        classes.iter().for_each(|&class| encoder.push_band(class, &values));
        let bytes = encoder.finish();
        let mut decoder = RansDecoder::new(&bytes).unwrap();
        for &class in &classes {
            let mut read = vec![0; values.len()];
            decoder.read_band(class, &mut read);
            assert_eq!(read, values, "class {class}");
        }
        decoder.finish().unwrap();
        assert!(RansDecoder::new(&bytes[..bytes.len() - 1]).is_err());
        assert!(RansDecoder::new(&bytes[..bytes.len() - 2]).unwrap().finish().is_err());
    }
}
