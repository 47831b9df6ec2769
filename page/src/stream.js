// The data as they come: from a server that may know ranges or not, or from inside of the page. formats/share.md says what the
// bytes mean. What is damaged is fetched once more where ranges are known, and else told.

import { crc32 } from './checksum.js';
import { gridOf } from './blocks.js';

/**
 * The head of the data, see formats/share.md.
 * @typedef {{ offset: number, indexBytes: number, indexCrc: number, chunkBytes: number }} Layer
 * @typedef {{ width: number, height: number, side: number, ranks: number[], sparse: number[], layers: Layer[] }} Level
 * @typedef {{ name: string, kind: string, unit: string, across: number, down: number, emission: number[], scene: number[][],
 *   scale: number }} Light
 * @typedef {{ name: string, lights: (number[][] | null)[] }} Look
 * @typedef {{ title: string, program: string, columns: number, shrink: number, exposure: number, lumensPerWatt: number | null, panorama: boolean | null,
 *   lights: Light[],
 *   groups: { name: string, lights: number[] }[], looks: Look[], levels: Level[] }} Head
 */
/**
 * What hears of the data. `lost`: a chunk, or with no block a whole layer, that does not fit its checksum or never came.
 * @typedef {{ head: (head: Head) => void | Promise<void>, chunk: (level: number, id: number, layer: number, bytes: Uint8Array) => void,
 *   layerDone: (level: number, layer: number) => void, progress: (have: number, total: number) => void,
 *   lost: (level: number, layer: number, id: number | null, why: string) => void }} Listener
 */

const START_BYTES = 20;
const SHARE_MAGIC = [0x89, 0x4c, 0x54, 0x53, 0x0d, 0x0a, 0x1a, 0x0a];
/** Times in a row that a stream that breaks is asked to go on, after pauses that double from the first: a minute in all. */
const MOST_RESUMES = 8;
const FIRST_PAUSE_MS = 250;

/** The data end before their end. */
export class Truncated extends Error {}

/** Bytes in order, from a server. */
export class FetchedBytes {
  /** @param {string} url */
  constructor(url) {
    this.url = url;
    /** @type {ReadableStreamDefaultReader<Uint8Array> | null} */
    this.reader = null;
    this.received = 0;
    this.resumes = 0;
  }

  /** The next piece; null at the end. @returns {Promise<Uint8Array | null>} */
  async next() {
    if (!this.reader) await this.open(0);
    for (;;) {
      try {
        const { value, done } = await /** @type {ReadableStreamDefaultReader<Uint8Array>} */ (this.reader).read();
        if (done) return null;
        this.received += value.length;
        this.resumes = 0;
        return value;
      } catch {
        let isOpen = false;
        while (!isOpen) {
          if (this.resumes++ >= MOST_RESUMES) return null;
          await new Promise((resolve) => setTimeout(resolve, FIRST_PAUSE_MS * 2 ** (this.resumes - 1)));
          isOpen = await this.open(this.received).then(() => true, () => false);
        }
      }
    }
  }

  /** @param {number} from */
  async open(from) {
    const response = await fetch(this.url, from > 0 ? { headers: { Range: `bytes=${from}-` } } : {});
    if (!response.ok || !response.body) throw new Error(`the server answers ${response.status}`);
    const reader = response.body.getReader();
    this.reader = reader;
    // A server without ranges begins anew.
    let skip = response.status === 206 ? 0 : from;
    while (skip > 0) {
      const { value, done } = await reader.read();
      if (done) return;
      if (value.length > skip) {
        const rest = value.subarray(skip);
        let given = false;
        // The rest of the piece comes first, then what the stream has.
        this.reader = /** @type {any} */ ({
          read: async () => (given ? reader.read() : ((given = true), { value: rest, done: false })),
        });
      }
      skip -= Math.min(skip, value.length);
    }
  }

  /** A part once more, past every cache; null where the server knows no ranges. @param {number} from @param {number} bytes */
  async again(from, bytes) {
    try {
      const range = `bytes=${from}-${from + bytes - 1}`;
      const response = await fetch(this.url, { headers: { Range: range }, cache: 'reload' });
      if (response.status !== 206) {
        await response.body?.cancel();
        return null;
      }
      return new Uint8Array(await response.arrayBuffer());
    } catch {
      return null;
    }
  }
}

/** Bytes in order, from the page itself. */
export class EmbeddedBytes {
  /** @param {string} base64 */
  constructor(base64) {
    this.text = base64.trim();
    this.at = 0;
  }

  /** @returns {Promise<Uint8Array | null>} */
  async next() {
    if (this.at >= this.text.length) return null;
    const part = atob(this.text.slice(this.at, this.at + (1 << 18)));
    this.at += 1 << 18;
    // The page is shown while its data are unpacked.
    await new Promise((resolve) => setTimeout(resolve));
    return Uint8Array.from(part, (sign) => sign.charCodeAt(0));
  }

  /** @returns {Promise<null>} */
  async again() {
    return null;
  }
}

/** Takes so many bytes at a time from pieces of any length. */
class Source {
  /** @param {FetchedBytes | EmbeddedBytes} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    /** @type {Uint8Array} */
    this.piece = new Uint8Array(0);
    this.taken = 0;
    this.ended = false;
  }

  /** @param {number} count @returns {Promise<Uint8Array<ArrayBuffer>>} */
  async take(count) {
    const out = new Uint8Array(count);
    let have = 0;
    while (have < count) {
      if (this.piece.length === 0) {
        const next = this.ended ? null : await this.bytes.next();
        if (!next) {
          this.ended = true;
          throw new Truncated(`the data end after ${this.taken + have} bytes`);
        }
        this.piece = next;
      }
      const part = this.piece.subarray(0, count - have);
      out.set(part, have);
      have += part.length;
      this.piece = this.piece.subarray(part.length);
    }
    this.taken += count;
    return out;
  }

  /**
   * Bytes that fit a checksum, fetched once more where they do not; null where they do not then either.
   * @param {number} count
   * @param {number} crc
   */
  async checked(count, crc) {
    const from = this.taken;
    const bytes = await this.take(count);
    if (crc32(bytes) === crc) return bytes;
    const again = await this.bytes.again(from, count);
    return again && again.length === count && crc32(again) === crc ? again : null;
  }
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Reads the data from their first byte to their last.
 * @param {FetchedBytes | EmbeddedBytes} bytes
 * @param {Listener} listener
 */
export async function readShare(bytes, listener) {
  const source = new Source(bytes);
  const start = await source.take(START_BYTES);
  const number = new DataView(start.buffer);
  if (SHARE_MAGIC.some((byte, i) => start[i] !== byte)) throw new Error('the data are not those of such a page');
  if (number.getUint32(8, true) !== 1) throw new Error(`the data are of version ${number.getUint32(8, true)}, unknown here`);
  const packed = await source.checked(number.getUint32(12, true), number.getUint32(16, true));
  if (!packed) throw new Error('the head of the data is damaged');
  /** @type {Head} */
  const head = JSON.parse(new TextDecoder().decode(await inflate(packed)));
  // What follows waits for whoever is not ready for it.
  await listener.head(head);
  const total = source.taken + head.levels.flatMap((level) => level.layers)
    .reduce((sum, layer) => sum + layer.indexBytes + layer.chunkBytes, 0);
  for (const [level, { layers }] of head.levels.entries()) {
    for (const [layer, { indexBytes, indexCrc, chunkBytes }] of layers.entries()) {
      try {
        const index = await source.checked(indexBytes, indexCrc);
        if (index) {
          await readChunks(source, head.levels[level], index, level, layer, listener, total);
        } else {
          listener.lost(level, layer, null, 'its index does not fit its checksum');
          await source.take(chunkBytes);
        }
        listener.layerDone(level, layer);
      } catch (error) {
        if (!(error instanceof Truncated)) throw error;
        listener.lost(level, layer, null, error.message);
      }
      listener.progress(source.taken, total);
    }
  }
}

/**
 * @param {Source} source
 * @param {Level} shape
 * @param {Uint8Array} index
 * @param {number} level
 * @param {number} layer
 * @param {Listener} listener
 * @param {number} total
 */
async function readChunks(source, shape, index, level, layer, listener, total) {
  const view = new DataView(index.buffer, index.byteOffset, index.length);
  const { across, down } = gridOf(shape);
  let at = 0;
  for (let id = 0; id < across * down; id++) {
    let size = 0;
    for (let shift = 0; ; shift += 7) {
      const byte = index[at++];
      size += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) break;
    }
    if (size === 0) continue;
    const crc = view.getUint32(at, true);
    at += 4;
    const chunk = await source.checked(size, crc);
    if (chunk) listener.chunk(level, id, layer, chunk);
    else listener.lost(level, layer, id, 'it does not fit its checksum');
    if (id % 16 === 15) listener.progress(source.taken, total);
  }
}
