// The two coders of a chunk: an adaptive binary range coder for what is small, rANS for coefficients. formats/ltc.md says what
// the bits mean; these are the reading halves of src/container/codec/adaptive.rs, rans.rs, classes.rs and low_bits.rs.

/** Contexts of a number: 32 for its length, 32 for the bit after its highest. */
export const NUMBER_CONTEXTS = 64;
/** Contexts of a signed number: whether it is 0, its sign, its magnitude. */
export const SIGNED_CONTEXTS = 2 + NUMBER_CONTEXTS;

/** Reads bits with contexts, which are numbered; bytes beyond the end are zeros. */
export class BitDecoder {
  /**
   * @param {Uint8Array} bytes
   * @param {number} contexts
   */
  constructor(bytes, contexts) {
    this.bytes = bytes;
    this.next = 0;
    this.low = 0;
    this.range = 0xffffffff;
    this.code = 0;
    this.zero = new Uint16Array(contexts).fill(2048);
    this.seen = new Uint8Array(contexts);
    for (let i = 0; i < 4; i++) this.shiftIn();
  }

  shiftIn() {
    const byte = this.next < this.bytes.length ? this.bytes[this.next] : 0;
    this.code = ((this.code << 8) | byte) >>> 0;
    this.next++;
  }

  /** Whether reading has gone further beyond the end than a stream can. */
  isExhausted() {
    return this.next > this.bytes.length + 8;
  }

  /** @param {number} split */
  decode(split) {
    const bit = (this.code - this.low) >>> 0 >= split;
    if (bit) {
      this.low = (this.low + split) >>> 0;
      this.range = (this.range - split) >>> 0;
    } else {
      this.range = split;
    }
    for (;;) {
      if ((this.low ^ (this.low + this.range)) >>> 0 >= 0x1000000) {
        if (this.range >= 0x10000) break;
        this.range = -this.low & 0xffff;
      }
      this.shiftIn();
      this.low = (this.low << 8) >>> 0;
      this.range = (this.range << 8) >>> 0;
    }
    return bit;
  }

  /** @param {number} context */
  bit(context) {
    const zero = this.zero[context];
    const bit = this.decode((this.range >>> 12) * zero);
    const seen = this.seen[context];
    this.zero[context] = zero + (((bit ? 32 : 4064) - zero) >> (2 + Math.min(seen >> 2, 3)));
    this.seen[context] = Math.min(seen + 1, 12);
    return bit;
  }

  /** A plain number of so many bits, highest first. @param {number} count */
  bits(count) {
    let value = 0;
    for (let i = 0; i < count; i++) value = ((value << 1) | Number(this.decode(this.range >>> 1))) >>> 0;
    return value;
  }

  /** @param {number} first of its contexts */
  number(first) {
    let length = 0;
    while (length < 30 && this.bit(first + length)) length++;
    let number = 1;
    for (let i = length - 1; i >= 0; i--) {
      const bit = i + 1 === length ? this.bit(first + 32 + length) : this.decode(this.range >>> 1);
      number = number * 2 + Number(bit);
    }
    return number - 1;
  }

  /** @param {number} first of its contexts */
  signed(first) {
    if (!this.bit(first)) return 0;
    const negative = this.bit(first + 1);
    const magnitude = this.number(first + 2) + 1;
    return negative ? -magnitude : magnitude;
  }
}

const PROBABILITY_BITS = 11;
const TOTAL = 1 << PROBABILITY_BITS;
const LARGEST = 7;
const ESCAPE = 15;
const FIRST_SHIFTED = 9;
/** Classes there are. */
export const CLASSES = 41;
const RATIOS = [
  0.0012726, 0.0089677, 0.035674, 0.094707, 0.188876, 0.307747, 0.434598, 0.554749, 0.434598, 0.554749,
];

/** For each table and slot: frequency << 16 | place in the symbol << 4 | symbol. */
const SLOTS = RATIOS.map((ratio, index) => {
  const weights = new Float64Array(16);
  let weight;
  if (index >= 8) {
    weight = 1 - ratio;
    for (let n = 0; n <= LARGEST; n++) {
      weights[LARGEST + n] = weight;
      if (n < LARGEST) weights[LARGEST - 1 - n] = weight;
      weight *= ratio;
    }
  } else {
    const root = Math.sqrt(ratio);
    weights[LARGEST] = 2 * (1 - root);
    weight = root * (1 - ratio);
    for (let n = 1; n <= LARGEST; n++) {
      weights[LARGEST + n] = weight;
      weights[LARGEST - n] = weight;
      weight *= ratio;
    }
  }
  weights[ESCAPE] = (2 * weight) / (1 - ratio);
  const sum = weights.reduce((a, b) => a + b, 0);
  const floor = 1 + TOTAL / 1024;
  const free = TOTAL - floor * 16;
  const frequency = Array.from(weights, (w) => Math.trunc(floor + (w / sum) * free));
  frequency[LARGEST] += TOTAL - frequency.reduce((a, b) => a + b, 0);
  const slots = new Uint32Array(TOTAL);
  let at = 0;
  frequency.forEach((count, symbol) => {
    for (let offset = 0; offset < count; offset++) slots[at++] = ((count << 16) | (offset << 4) | symbol) >>> 0;
  });
  return slots;
});

/** Reads coefficients, band by band. */
export class RansDecoder {
  /**
   * @param {Uint8Array} bytes
   * @param {number} count of states
   * @param {Uint8Array} lowBits
   */
  constructor(bytes, count, lowBits) {
    if (bytes.length < 4 * count || bytes.length % 2 !== 0) throw new Error('the coefficients are cut short');
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    this.states = Uint32Array.from({ length: count }, (_, i) => view.getUint32(4 * i, true));
    this.bytes = bytes;
    this.next = 4 * count;
    this.lowBits = lowBits;
    this.bit = 0;
  }

  /** The next low bits, at most 24. @param {number} count */
  take(count) {
    const [bytes, at] = [this.lowBits, this.bit >> 3];
    const word = (bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16) | (bytes[at + 3] << 24)) >>> (this.bit & 7);
    this.bit += count;
    return word & ((1 << count) - 1);
  }

  /**
   * The first `length` of `values` become a band's, coded with a class that is not 0.
   * @param {number} bandClass
   * @param {Int32Array} values
   * @param {number} length
   */
  readBand(bandClass, values, length) {
    const shifted = bandClass >= FIRST_SHIFTED;
    const slots = SLOTS[shifted ? 8 + ((bandClass - FIRST_SHIFTED) % 2) : bandClass - 1];
    const shift = shifted ? 1 + ((bandClass - FIRST_SHIFTED) >> 1) : 0;
    const { states, bytes } = this;
    const mask = states.length - 1;
    let next = this.next;
    let escapes = false;
    for (let i = 0; i < length; i++) {
      const x = states[i & mask];
      const slot = slots[x & (TOTAL - 1)];
      values[i] = (slot & 15) - LARGEST;
      if ((slot & 15) === ESCAPE) escapes = true;
      let after = (slot >>> 16) * (x >>> PROBABILITY_BITS) + ((slot & 0xffff) >>> 4);
      if (after < 0x10000) {
        after = (after << 16) | bytes[next] | (bytes[next + 1] << 8);
        next += 2;
      }
      states[i & mask] = after;
    }
    this.next = next;
    if (escapes) {
      for (let i = 0; i < length; i++) {
        if (values[i] !== ESCAPE - LARGEST) continue;
        const bits = Math.min(this.take(5), 24);
        const magnitude = Math.min((1 << bits) + this.take(bits) + LARGEST, 1 << 24);
        values[i] = this.take(1) === 1 ? -magnitude : magnitude;
      }
    }
    if (shift > 0) {
      for (let i = 0; i < length; i++) values[i] = (values[i] << shift) | this.take(shift);
    }
  }

  /** Checks that everything was read and nothing more. */
  finish() {
    const whole = this.next === this.bytes.length && this.states.every((x) => x === 0x10000);
    if (!whole || (this.bit + 7) >> 3 !== this.lowBits.length) {
      throw new Error('the coefficients do not end where their coder does');
    }
  }
}
