//! A range coder with asymmetric numeral systems (Duda, *Asymmetric numeral systems*, 2013, §3): interleaved 32-bit
//! states, 16-bit words.

use super::classes::{ESCAPE, LARGEST, MAX_MAGNITUDE, PROBABILITY_BITS, SymbolTable, TOTAL, coding_of, symbol_of};
use super::low_bits::{LowBits, LowBitsWriter};

/// Interleaved states of a long stream. A state costs two bytes and lets one more value be decoded at the same time.
pub(super) const MAX_STATES: usize = 8;
/// Streams of fewer bytes than this have one state.
const LONG_BYTES: usize = 512;
/// Bits of the length of an escaped value.
const LENGTH_BITS: u32 = 5;
/// States stay at or above this.
const LOWEST: u32 = 1 << 16;

/// Collects values in reading order; the coder itself runs backwards over them at the end.
#[derive(Default)]
pub(super) struct RansEncoder {
    /// Place in its band (modulo the states), start and frequency of each step.
    steps: Vec<(u8, u16, u16)>,
    low_bits: LowBitsWriter,
}

/// Reads values back.
pub(super) struct RansDecoder<'a> {
    /// Value `i` of a band is in state `i mod count`.
    states: [u32; MAX_STATES],
    count: usize,
    words: &'a [[u8; 2]],
    next: usize,
    /// Where low bits and escaped values stand apart; else they stand among the words.
    low_bits: Option<LowBits<'a>>,
}

/// What an encoder made.
#[derive(Default)]
pub(super) struct RansStreams {
    pub(super) values: Vec<u8>,
    /// Whether the values have [`MAX_STATES`] states rather than one.
    pub(super) is_long: bool,
    pub(super) low_bits: Vec<u8>,
}

impl RansEncoder {
    /// Adds the values of a band, coded with `class` (not 0).
    pub(super) fn push_band(&mut self, class: u32, values: &[i32]) {
        let (table, shift) = coding_of(class);
        for (i, &value) in values.iter().enumerate() {
            let symbol = symbol_of(value >> shift);
            self.steps.push(((i % MAX_STATES) as u8, table.start[symbol], table.frequency[symbol]));
            if symbol == ESCAPE {
                let high = value >> shift;
                let excess = high.unsigned_abs() - LARGEST as u32;
                let length = 31 - excess.leading_zeros();
                self.low_bits.push(length, LENGTH_BITS);
                self.low_bits.push(excess - (1 << length), length);
                self.low_bits.push(u32::from(high < 0), 1);
            }
        }
        if shift > 0 {
            values.iter().for_each(|&value| self.low_bits.push(value as u32, shift));
        }
    }

    /// The streams of everything pushed.
    pub(super) fn finish(self) -> RansStreams {
        let short = self.with_states::<1>();
        let is_long = short.len() >= LONG_BYTES;
        let values = if is_long { self.with_states::<MAX_STATES>() } else { short };
        RansStreams { values, is_long, low_bits: self.low_bits.finish() }
    }

    fn with_states<const STATES: usize>(&self) -> Vec<u8> {
        let mut states = [LOWEST; STATES];
        let mut words: Vec<u16> = Vec::with_capacity(self.steps.len() / 4);
        for &(state, start, frequency) in self.steps.iter().rev() {
            let x = &mut states[usize::from(state) % STATES];
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
    /// Starts on the bytes that an encoder made, with this many states (1, 4 or 8), and on the low bits if they stand
    /// apart.
    pub(super) fn new(bytes: &'a [u8], count: usize, low_bits: Option<LowBits<'a>>) -> Result<Self, String> {
        let (start, words) = bytes.split_at_checked(4 * count).ok_or("the coefficients are cut short")?;
        let (words, odd) = words.as_chunks::<2>();
        if !odd.is_empty() {
            return Err("the coefficients have half a word".into());
        }
        let mut states = [LOWEST; MAX_STATES];
        for (state, bytes) in states.iter_mut().zip(start.as_chunks::<4>().0) {
            *state = u32::from_le_bytes(*bytes);
        }
        Ok(Self { states, count, words, next: 0, low_bits })
    }

    /// Reads the values of a band that was coded with `class` (not 0).
    #[inline(always)]
    pub(super) fn read_band(&mut self, class: u32, values: &mut [i32]) {
        let (table, shift) = coding_of(class);
        let Some(low_bits) = &mut self.low_bits else {
            match shift {
                0 => self.read_among::<false>(table, 0, values),
                _ => self.read_among::<true>(table, shift, values),
            }
            return;
        };
        let (words, next) = (self.words, &mut self.next);
        let has_escapes = match self.count {
            1 => read_symbols(table, self.states.first_chunk_mut::<1>().expect("one"), words, next, values),
            _ => read_symbols(table, &mut self.states, words, next, values),
        };
        if has_escapes {
            for value in values.iter_mut().filter(|value| **value == ESCAPE as i32 - LARGEST) {
                let length = low_bits.take(LENGTH_BITS).min(24);
                let excess = (1 << length) + low_bits.take(length);
                let magnitude = ((excess + LARGEST as u32) as i32).min(MAX_MAGNITUDE);
                *value = if low_bits.take(1) == 1 { -magnitude } else { magnitude };
            }
        }
        if shift > 0 {
            low_bits.read(values, shift);
        }
    }

    /// Values with all their bits among the words, as the first codings have them, in four states.
    #[inline(always)]
    fn read_among<const SHIFTED: bool>(&mut self, table: &SymbolTable, shift: u32, values: &mut [i32]) {
        const STATES: usize = 4;
        let most = if SHIFTED { 2 * STATES } else { STATES };
        let (groups, rest) = values.as_chunks_mut::<STATES>();
        let mut states: [u32; STATES] = *self.states.first_chunk().expect("there are as many");
        for group in groups {
            // A value takes at most one word, two with low bits, unless it is an escape or has many low bits.
            let words = self.words.get(self.next..self.next + most).filter(|_| shift <= 8);
            let (before, mut taken, mut escapes) = (states, 0usize, 0u32);
            if let Some(words) = words {
                let mut renormalise = |x: u32| {
                    // As many words as values at most: the index cannot pass the end.
                    let word = u32::from(u16::from_le_bytes(words[taken.min(most - 1)]));
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
            }
            if words.is_none() || escapes != 0 {
                self.states[..STATES].copy_from_slice(&before);
                self.read_slowly(table, shift, group);
                states = *self.states.first_chunk().expect("there are as many");
            } else {
                self.next += taken;
            }
        }
        self.states[..STATES].copy_from_slice(&states);
        self.read_slowly(table, shift, rest);
    }

    /// Any values of the first codings, one by one.
    #[inline(never)]
    fn read_slowly(&mut self, table: &SymbolTable, shift: u32, values: &mut [i32]) {
        let mut states = self.states;
        for group in values.chunks_mut(self.count) {
            for (value, x) in group.iter_mut().zip(&mut states) {
                let slot = table.slots[(*x & (TOTAL - 1)) as usize];
                *x = (slot >> 16) * (*x >> PROBABILITY_BITS) + ((slot & 0xffff) >> 4);
                if *x < LOWEST {
                    *x = *x << 16 | self.word();
                }
                let symbol = (slot & 15) as usize;
                let high = if symbol == ESCAPE { self.read_escape(x) } else { symbol as i32 - LARGEST };
                *value = if shift > 0 { high << shift | self.read_bits(x, shift) as i32 } else { high };
            }
        }
        self.states = states;
    }

    /// Checks that everything was read and nothing more.
    pub(super) fn finish(self) -> Result<(), String> {
        if self.next == self.words.len() && self.states == [LOWEST; MAX_STATES] {
            self.low_bits.map_or(Ok(()), LowBits::finish)
        } else {
            Err("the coefficients do not end where their coder does".into())
        }
    }

    #[cold]
    fn read_escape(&mut self, x: &mut u32) -> i32 {
        let length = self.read_bits(x, LENGTH_BITS).min(24);
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

/// Reads symbols, less [`LARGEST`]. Returns whether there are escapes among them. Words beyond the end are zeros, which
/// [`RansDecoder::finish`] notices.
#[inline(always)]
fn read_symbols<const STATES: usize>(
    table: &SymbolTable,
    states_kept: &mut [u32; STATES],
    words: &[[u8; 2]],
    next: &mut usize,
    values: &mut [i32],
) -> bool {
    let (mut states, mut escapes) = (*states_kept, 0u32);
    let (groups, rest) = values.as_chunks_mut::<STATES>();
    let mut symbol_of = |x: u32| {
        let slot = table.slots[(x & (TOTAL - 1)) as usize];
        escapes |= u32::from(slot & 15 == ESCAPE as u32);
        ((slot & 15) as i32 - LARGEST, (slot >> 16) * (x >> PROBABILITY_BITS) + ((slot & 0xffff) >> 4))
    };
    for group in groups {
        // A value takes at most one word.
        let here = words.get(*next..).unwrap_or_default();
        let mut padded = [[0; 2]; STATES];
        let here: &[[u8; 2]; STATES] = match here.first_chunk() {
            Some(here) => here,
            None => {
                padded[..here.len()].copy_from_slice(here);
                &padded
            }
        };
        let mut taken = 0usize;
        for (value, x) in group.iter_mut().zip(&mut states) {
            let after;
            (*value, after) = symbol_of(*x);
            let word = u32::from(u16::from_le_bytes(here[taken % STATES]));
            let low = after < LOWEST;
            taken += usize::from(low);
            *x = if low { after << 16 | word } else { after };
        }
        *next += taken;
    }
    for (value, x) in rest.iter_mut().zip(&mut states) {
        (*value, *x) = symbol_of(*x);
        if *x < LOWEST {
            *x = *x << 16 | words.get(*next).map_or(0, |word| u32::from(u16::from_le_bytes(*word)));
            *next += 1;
        }
    }
    *states_kept = states;
    escapes != 0
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
        for classes in [vec![1, 2, 8, 9, 10, 11, 20, 40], vec![8]] {
            // Few values make a short stream.
            let values = if classes.len() > 1 { &values[..] } else { &values[340..] };
            let mut encoder = RansEncoder::default();
            classes.iter().for_each(|&class| encoder.push_band(class, values));
            let RansStreams { values: bytes, is_long, low_bits } = encoder.finish();
            assert_eq!(is_long, classes.len() > 1);
            let count = if is_long { MAX_STATES } else { 1 };
            let start = |bytes| RansDecoder::new(bytes, count, Some(LowBits::new(&low_bits)));
            let mut decoder = start(&bytes).unwrap();
            for &class in &classes {
                let mut read = vec![0; values.len()];
                decoder.read_band(class, &mut read);
                assert_eq!(read, values, "class {class}");
            }
            decoder.finish().unwrap();
            assert!(start(&bytes[..bytes.len() - 1]).is_err());
            assert!(start(&bytes[..bytes.len() - 2]).unwrap().finish().is_err());
        }
    }
}
