//! An adaptive binary range coder for data that are small beside the coefficients: steps, classes, sparse entries.
//!
//! The carry-less coder of Subbotin with 32-bit bounds. Each context is a 12-bit probability that moves by a share of
//! its error, a quarter at first and a 32nd in the long run.

/// An adaptive probability that the next bit is 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context {
    zero: u16,
    seen: u8,
}

const ONE: u32 = 1 << 12;

impl Default for Context {
    fn default() -> Self {
        Self { zero: (ONE / 2) as u16, seen: 0 }
    }
}

impl Context {
    fn split(self, range: u32) -> u32 {
        (range >> 12) * u32::from(self.zero)
    }

    fn learn(&mut self, bit: bool) {
        let shift = 2 + u32::from(self.seen / 4).min(3);
        self.seen = (self.seen + 1).min(12);
        let target = if bit { 32 } else { ONE as i32 - 32 };
        self.zero = (i32::from(self.zero) + ((target - i32::from(self.zero)) >> shift)) as u16;
    }
}

/// Writes bits.
pub(super) struct BitEncoder {
    low: u32,
    range: u32,
    bytes: Vec<u8>,
}

/// Reads bits.
pub(super) struct BitDecoder<'a> {
    low: u32,
    range: u32,
    code: u32,
    bytes: &'a [u8],
    next: usize,
}

/// What coder and decoder share: a walk over values that either writes or reads them.
pub(super) trait BitCoder {
    /// Codes one bit with a context: writes `bit` and gives it back, or reads one.
    fn bit(&mut self, context: &mut Context, bit: bool) -> bool;

    /// Codes one bit that is as likely 0 as 1.
    fn even_bit(&mut self, bit: bool) -> bool;

    /// Codes the low `count` bits of a number, highest first.
    fn bits(&mut self, value: u32, count: u32) -> u32 {
        (0..count).rev().fold(0, |read, i| read << 1 | u32::from(self.even_bit(value >> i & 1 == 1)))
    }

    /// Codes a number below 2³⁰ by its length (in unary, one context each) and its bits; the bit after the
    /// highest has a context too.
    fn number(&mut self, contexts: &mut NumberContexts, value: u32) -> u32 {
        // A reader's argument is arbitrary.
        let value = (value & 0x3fff_ffff) + 1;
        let length = 31 - value.leading_zeros();
        let mut read = 0;
        while read < 30 && self.bit(&mut contexts.length[read as usize], length > read) {
            read += 1;
        }
        let mut number = 1u32;
        for i in (0..read).rev() {
            let bit = value >> i & 1 == 1;
            let bit =
                if i + 1 == read { self.bit(&mut contexts.second[read as usize], bit) } else { self.even_bit(bit) };
            number = number << 1 | u32::from(bit);
        }
        number - 1
    }

    /// Codes a signed number: zero or not, sign, magnitude.
    fn signed(&mut self, contexts: &mut SignedContexts, value: i32) -> i32 {
        if !self.bit(&mut contexts.nonzero, value != 0) {
            return 0;
        }
        let negative = self.bit(&mut contexts.negative, value < 0);
        let magnitude = self.number(&mut contexts.magnitude, value.unsigned_abs().saturating_sub(1)) + 1;
        if negative { -(magnitude as i32) } else { magnitude as i32 }
    }
}

/// Contexts of [`BitCoder::number`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct NumberContexts {
    length: [Context; 32],
    second: [Context; 32],
}

/// Contexts of [`BitCoder::signed`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SignedContexts {
    nonzero: Context,
    negative: Context,
    magnitude: NumberContexts,
}

const TOP: u32 = 1 << 24;
const BOTTOM: u32 = 1 << 16;

impl BitEncoder {
    /// An empty stream.
    pub(super) fn new() -> Self {
        Self { low: 0, range: u32::MAX, bytes: Vec::new() }
    }

    /// The bytes of everything written.
    pub(super) fn finish(mut self) -> Vec<u8> {
        for _ in 0..4 {
            self.bytes.push((self.low >> 24) as u8);
            self.low <<= 8;
        }
        // A reader takes missing bytes for zeros.
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }

    fn encode(&mut self, split: u32, bit: bool) {
        if bit {
            self.low = self.low.wrapping_add(split);
            self.range -= split;
        } else {
            self.range = split;
        }
        while shift_out(self.low, &mut self.range) {
            self.bytes.push((self.low >> 24) as u8);
            self.low <<= 8;
            self.range <<= 8;
        }
    }
}

/// Whether the highest byte is settled (or the range has to be cut so that it is).
fn shift_out(low: u32, range: &mut u32) -> bool {
    if low ^ low.wrapping_add(*range) < TOP {
        return true;
    }
    if *range < BOTTOM {
        *range = low.wrapping_neg() & (BOTTOM - 1);
        return true;
    }
    false
}

impl BitCoder for BitEncoder {
    fn bit(&mut self, context: &mut Context, bit: bool) -> bool {
        self.encode(context.split(self.range), bit);
        context.learn(bit);
        bit
    }

    fn even_bit(&mut self, bit: bool) -> bool {
        self.encode(self.range >> 1, bit);
        bit
    }
}

impl<'a> BitDecoder<'a> {
    /// Starts on the bytes that an encoder made.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { low: 0, range: u32::MAX, code: 0, bytes, next: 0 };
        (0..4).for_each(|_| decoder.shift_in());
        decoder
    }

    /// Whether reading has gone further beyond the end than an encoder's stream can.
    pub(super) fn is_exhausted(&self) -> bool {
        self.next > self.bytes.len() + 8
    }

    fn shift_in(&mut self) {
        self.code = self.code << 8 | u32::from(self.bytes.get(self.next).copied().unwrap_or(0));
        self.next += 1;
    }

    fn decode(&mut self, split: u32) -> bool {
        let bit = self.code.wrapping_sub(self.low) >= split;
        if bit {
            self.low = self.low.wrapping_add(split);
            self.range -= split;
        } else {
            self.range = split;
        }
        while shift_out(self.low, &mut self.range) {
            self.shift_in();
            self.low <<= 8;
            self.range <<= 8;
        }
        bit
    }
}

impl BitCoder for BitDecoder<'_> {
    fn bit(&mut self, context: &mut Context, _: bool) -> bool {
        let bit = self.decode(context.split(self.range));
        context.learn(bit);
        bit
    }

    fn even_bit(&mut self, _: bool) -> bool {
        self.decode(self.range >> 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(coder: &mut impl BitCoder, values: &[i32]) -> Vec<i32> {
        let (mut context, mut number, mut signed) = Default::default();
        let mut read = Vec::new();
        for &value in values {
            read.push(i32::from(coder.bit(&mut context, value % 7 == 0)));
            read.push(coder.number(&mut number, value.unsigned_abs()) as i32);
            read.push(coder.signed(&mut signed, value));
            read.push(coder.bits(value as u32 & 0x7ff, 11) as i32);
        }
        read
    }

    #[test]
    fn what_is_written_is_read() {
        let values: Vec<i32> = (0..3000).map(|i: i32| (i * 7919) % (1 << (i % 28)) - (i % 5)).collect();
        let mut encoder = BitEncoder::new();
        let wrote = walk(&mut encoder, &values);
        let bytes = encoder.finish();
        let mut decoder = BitDecoder::new(&bytes);
        assert_eq!(walk(&mut decoder, &vec![0; values.len()]), wrote);
        assert!(!decoder.is_exhausted());
    }

    #[test]
    fn rare_bits_cost_little() {
        let mut encoder = BitEncoder::new();
        let mut context = Context::default();
        (0..8000).for_each(|i| {
            encoder.bit(&mut context, i % 1000 == 999);
        });
        // The bound of a probability of 1/128 is 90 bits for zeros and 7 for each of eight ones.
        assert!(encoder.finish().len() < 40);
    }
}
