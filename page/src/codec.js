// From a chunk to factors: the reading half of src/container/codec, of codings 3, 4 and 5.

import { BitDecoder, CLASSES, NUMBER_CONTEXTS, RansDecoder, SIGNED_CONTEXTS } from './coder.js';

/**
 * A block `L R + S`. `left`: three planes of pixels for each component; `right`: rows of coefficients that add up to its right
 * sides. Sparse entries: of each its column, its row (channel · pixels + pixel) and its value. `fineness`: how much finer each
 * band of a right side is stored, in half octaves; empty: all alike.
 * @typedef {{ rank: number, left: Float32Array, right: RightRow[], sparse: Sparse, fineness: Int8Array }} Factors
 * What is not zero of a row: place in its tile and value, and for each tile where they end.
 * @typedef {{ component: number, ends: Uint32Array, places: Uint16Array, values: Float32Array }} RightRow
 * @typedef {{ columns: Uint32Array, rows: Uint32Array, values: Float32Array }} Sparse
 */
/**
 * The columns as little images, as src/container/layout.rs cuts them.
 * @typedef {{ across: number, down: number, isImage: boolean }} LightPlane
 */

/**
 * Columns that are transformed together: by the cosine transform where they are texels of an image.
 * @typedef {{ first: number, stride: number, width: number, height: number, isImage: boolean }} ColumnTile
 */

const ZONES = 10;
const ZONE_LIMITS = [1, 2, 6, 16, 36, 72, 144, 256, 484, Infinity];
const TILES = [32, 16, 8, 4];
const MAX_TILE = 32;
const STEP_LIMIT = 600;
const EIGHTHS = [1, 1.0905077, 1.1892071, 1.2968396, Math.SQRT2, 1.5422108, 1.6817929, 1.834008].map(Math.fround);

/** The coding where bands of right sides have steps of their own, and that where zones of left sides have the steps below. */
const CODING_BANDS = 4;
const CODING_ZONES = 5;
/** How much finer each zone of a left side is stored, by its tile: src/container/codec/planes.rs. */
const ZONE_STEPS = [
  [6, 3, 2, 1, 1, 0, -1, -2, -4, -5],
  [3, 2, 1, 0, -1, -3, -4, -5, -6, -6],
  [2, 1, 0, -2, -4, -6, -6, -6, -6, -6],
  [0, -1, -3, -5, -6, -6, -6, -6, -6, -6],
].map((steps) => Int8Array.from(steps));
const NO_FINENESS = new Int8Array(0);
const NO_VALUES = new Float32Array(0);

/** Where each group of contexts of the side stream begins. */
const [FINENESS, TILE, LEFT_STEP, RIGHT_STEP, ROTATION, BANDS, COLUMN, GAPS, START, MASKS, FIRST, OTHERS, CONTEXTS] = [
  SIGNED_CONTEXTS, 1, SIGNED_CONTEXTS, SIGNED_CONTEXTS, 1, 6 * SIGNED_CONTEXTS, NUMBER_CONTEXTS, 3 * NUMBER_CONTEXTS, SIGNED_CONTEXTS, 64,
  SIGNED_CONTEXTS, SIGNED_CONTEXTS, 0,
].map((_, i, sizes) => sizes.slice(0, i).reduce((a, b) => a + b, 0));

/** @param {{ across: number, down: number }[]} lights */
export function lightPlanes(lights) {
  /** @type {LightPlane[]} */
  const planes = [];
  for (const { across, down } of lights) {
    const isImage = across !== 1 || down !== 1;
    const last = planes[planes.length - 1];
    if (last && !isImage && !last.isImage) last.across++;
    else planes.push({ across, down, isImage });
  }
  return planes;
}

/** Columns of a tile that is not transformed. */
const MOST_COLUMNS = 1024;

/** The tiles of the columns, as src/matrix/column_transform.rs cuts them. @param {LightPlane[]} planes */
export function columnTiles(planes) {
  /** @type {ColumnTile[]} */
  const tiles = [];
  let begin = 0;
  for (const { across, down, isImage } of planes) {
    const [wide, high] = isImage ? [MAX_TILE, MAX_TILE] : [MOST_COLUMNS, 1];
    for (let y = 0; y < down; y += high) {
      for (let x = 0; x < across; x += wide) {
        const [width, height] = [Math.min(wide, across - x), Math.min(high, down - y)];
        tiles.push({ first: begin + y * across + x, stride: across, width, height, isImage });
      }
    }
    begin += across * down;
  }
  return tiles;
}

/**
 * The coefficients of one value a column in a tile, `v · width + u`; null where all are 0.
 * @param {ColumnTile} tile
 * @param {Float64Array} values
 * @param {number} offset of the first column
 */
export function coefficientsOf({ first, stride, width, height, isImage }, values, offset) {
  const begin = offset + first;
  const value = values[begin];
  let [isEven, isDark] = [true, true];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const here = values[begin + y * stride + x];
      if (here !== value) isEven = false;
      if (here !== 0) isDark = false;
    }
  }
  if (isDark) return null;
  const out = new Float64Array(width * height);
  if (!isImage) {
    out.set(values.subarray(begin, begin + width));
  } else if (isEven) {
    out[0] = value * Math.sqrt(width * height);
  } else {
    const [across, down] = [cosinesOf(width), cosinesOf(height)];
    const row = new Float64Array(width);
    for (let y = 0; y < height; y++) {
      row.fill(0);
      let isLit = false;
      for (let x = 0; x < width; x++) {
        const here = values[begin + y * stride + x];
        if (here === 0) continue;
        isLit = true;
        for (let u = 0; u < width; u++) row[u] += here * across[u * width + x];
      }
      if (!isLit) continue;
      for (let v = 0; v < height; v++) {
        const cosine = down[v * height + y];
        for (let u = 0; u < width; u++) out[v * width + u] += row[u] * cosine;
      }
    }
  }
  return out;
}

/** @param {number} index */
function stepOf(index) {
  const inside = Math.min(Math.max(index, -STEP_LIMIT), STEP_LIMIT);
  return EIGHTHS[inside & 7] * 2 ** (inside >> 3);
}

/** @type {Map<number, Uint16Array[]>} */
const SCANS = new Map();

/**
 * Places of the coefficients of each zone of a tile, in the order of coding.
 * @param {number} width
 * @param {number} height
 */
function scanOf(width, height) {
  const key = width * 64 + height;
  let scan = SCANS.get(key);
  if (!scan) {
    const zones = Array.from({ length: ZONES }, () => /** @type {number[]} */ ([]));
    for (let v = 0; v < height; v++) {
      for (let u = 0; u < width; u++) {
        zones[ZONE_LIMITS.findIndex((limit) => u * u + v * v < limit)].push(v * width + u);
      }
    }
    scan = zones.map((places) => Uint16Array.from(places));
    SCANS.set(key, scan);
  }
  return scan;
}

/** @type {Map<number, Float32Array>} */
const COSINES = new Map();

/** Row `u` is the `u`-th cosine over `n` places. @param {number} n */
function cosinesOf(n) {
  let rows = COSINES.get(n);
  if (!rows) {
    rows = new Float32Array(n * n);
    for (let u = 0; u < n; u++) {
      const scale = Math.sqrt((u === 0 ? 1 : 2) / n);
      for (let x = 0; x < n; x++) rows[u * n + x] = scale * Math.cos((Math.PI * (x + 0.5) * u) / n);
    }
    COSINES.set(n, rows);
  }
  return rows;
}

const TILE_ROWS = new Float32Array(MAX_TILE * MAX_TILE);

/**
 * The cosine transform of a tile, back, into `out` at a place. Coefficients that are zero at the high end cost nothing.
 * @param {Float32Array} tile
 * @param {number} width
 * @param {number} height
 * @param {Float32Array} out
 * @param {number} first
 * @param {number} stride
 */
function inverse(tile, width, height, out, first, stride) {
  let [usedRows, usedColumns] = [0, 0];
  for (let v = 0; v < height; v++) {
    for (let u = 0; u < width; u++) {
      if (tile[v * width + u] !== 0) {
        usedRows = v + 1;
        if (u >= usedColumns) usedColumns = u + 1;
      }
    }
  }
  const [down, across] = [cosinesOf(height), cosinesOf(width)];
  for (let y = 0; y < height; y++) {
    for (let u = 0; u < usedColumns; u++) TILE_ROWS[u] = 0;
    for (let v = 0; v < usedRows; v++) {
      const cosine = down[v * height + y];
      for (let u = 0; u < usedColumns; u++) TILE_ROWS[u] += tile[v * width + u] * cosine;
    }
    const row = first + y * stride;
    for (let x = 0; x < width; x++) out[row + x] = 0;
    for (let u = 0; u < usedColumns; u++) {
      const value = TILE_ROWS[u];
      const cosines = u * width;
      for (let x = 0; x < width; x++) out[row + x] += across[cosines + x] * value;
    }
  }
}

const SCRATCH = { integers: new Int32Array(0), tiles: new Float32Array(0) };

/**
 * Reads the coefficients of an image into `SCRATCH.tiles`, tile by tile; the tiles, none where all are zero. `tile`: side of its
 * tiles; 0: values as they are, which stand in one.
 * @param {RansDecoder} decoder
 * @param {number[]} classes
 * @param {{ width: number, height: number, tile: number }} shape
 * @param {number} stepIndex
 * @param {Int8Array} fineness
 */
function readTiles(decoder, classes, { width, height, tile: side }, stepIndex, fineness) {
  const size = width * height;
  /** @type {{ x: number, y: number, w: number, h: number, at: number, scan: Uint16Array[] }[]} */
  const cut = [];
  if (classes.slice(0, side === 0 ? 1 : ZONES).every((c) => c === 0)) return cut;
  if (SCRATCH.integers.length < size) {
    SCRATCH.integers = new Int32Array(size);
    SCRATCH.tiles = new Float32Array(size);
  }
  const { integers, tiles } = SCRATCH;
  if (side === 0) {
    decoder.readBand(classes[0], integers, size);
    const step = stepOf(stepIndex);
    for (let i = 0; i < size; i++) {
      tiles[i] = integers[i] * (fineness.length > 0 ? stepOf(stepIndex - 4 * fineness[i]) : step);
    }
    return [{ x: 0, y: 0, w: width, h: height, at: 0, scan: [] }];
  }
  let at = 0;
  for (let y = 0; y < height; y += side) {
    for (let x = 0; x < width; x += side) {
      const [w, h] = [Math.min(side, width - x), Math.min(side, height - y)];
      cut.push({ x, y, w, h, at, scan: scanOf(w, h) });
      at += w * h;
    }
  }
  tiles.fill(0, 0, size);
  for (let zone = 0; zone < ZONES; zone++) {
    if (classes[zone] === 0) continue;
    const count = cut.reduce((sum, tile) => sum + tile.scan[zone].length, 0);
    decoder.readBand(classes[zone], integers, count);
    const step = stepOf(stepIndex - 4 * (fineness[zone] ?? 0));
    let next = 0;
    for (const tile of cut) {
      const places = tile.scan[zone];
      for (let i = 0; i < places.length; i++) tiles[tile.at + places[i]] = integers[next++] * step;
    }
  }
  return cut;
}

/**
 * Reads an image of pixels into `out` at a place, where zeros stand.
 * @param {RansDecoder} decoder
 * @param {number[]} classes
 * @param {{ width: number, height: number, tile: number }} shape
 * @param {number} stepIndex
 * @param {Int8Array} fineness
 * @param {Float32Array} out
 * @param {number} first
 */
function readImage(decoder, classes, shape, stepIndex, fineness, out, first) {
  for (const { x, y, w, h, at } of readTiles(decoder, classes, shape, stepIndex, fineness)) {
    inverse(SCRATCH.tiles.subarray(at, at + w * h), w, h, out, first + y * shape.width + x, shape.width);
  }
}

/** Gathers what is not zero of a row. */
class RowBuilder {
  constructor() {
    /** @type {number[]} */
    this.ends = [];
    this.places = new Uint16Array(256);
    this.values = new Float32Array(256);
    this.count = 0;
  }

  /** Appends a tile of the row. @param {Float32Array} tile */
  push(tile) {
    if (this.count + tile.length > this.places.length) {
      const [places, values] = [this.places, this.values];
      const room = 2 * (this.count + tile.length);
      [this.places, this.values] = [new Uint16Array(room), new Float32Array(room)];
      this.places.set(places.subarray(0, this.count));
      this.values.set(values.subarray(0, this.count));
    }
    for (let i = 0; i < tile.length; i++) {
      if (tile[i] === 0) continue;
      this.places[this.count] = i;
      this.values[this.count++] = tile[i];
    }
    this.ends.push(this.count);
  }

  /** @param {number} component @returns {RightRow} */
  finish(component) {
    const [places, values] = [this.places.slice(0, this.count), this.values.slice(0, this.count)];
    return { component, ends: Uint32Array.from(this.ends), places, values };
  }
}

/**
 * Reads an image of texels, or a row of lights of one column, onto the end of a row.
 * @param {RansDecoder} decoder
 * @param {number[]} classes
 * @param {LightPlane} plane
 * @param {number} stepIndex
 * @param {Int8Array} fineness
 * @param {RowBuilder} row
 */
function readRight(decoder, classes, { across, down, isImage }, stepIndex, fineness, row) {
  const shape = { width: across, height: down, tile: isImage ? MAX_TILE : 0 };
  const cut = readTiles(decoder, classes, shape, stepIndex, fineness);
  if (!isImage) {
    for (let x = 0; x < across; x += MOST_COLUMNS) {
      row.push(cut.length > 0 ? SCRATCH.tiles.subarray(x, Math.min(x + MOST_COLUMNS, across)) : NO_VALUES);
    }
    return;
  }
  for (const { w, h, at } of cut) row.push(SCRATCH.tiles.subarray(at, at + w * h));
  const count = Math.ceil(across / MAX_TILE) * Math.ceil(down / MAX_TILE);
  for (let i = cut.length; i < count; i++) row.push(NO_VALUES);
}

/**
 * Turns the three planes of a component back from their principal axes.
 * @param {Float32Array} left
 * @param {number} first
 * @param {number} pixels
 * @param {number} rotation
 */
function turnBack(left, first, pixels, rotation) {
  const largest = rotation >>> 30;
  const q = [0, 0, 0, 0];
  let rest = 1;
  [0, 1, 2, 3].filter((i) => i !== largest).forEach((place, i) => {
    q[place] = (((rotation >>> (10 * i)) & 1023) - 512) / 722;
    rest -= q[place] * q[place];
  });
  q[largest] = Math.sqrt(Math.max(rest, 0));
  const [x, y, z, w] = q;
  // The matrix of src/container/codec/rotation.rs, transposed.
  const m = [
    1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w),
    2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w),
    2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y),
  ];
  for (let i = first; i < first + pixels; i++) {
    const [a, b, c] = [left[i], left[i + pixels], left[i + 2 * pixels]];
    left[i] = m[0] * a + m[1] * b + m[2] * c;
    left[i + pixels] = m[3] * a + m[4] * b + m[5] * c;
    left[i + 2 * pixels] = m[6] * a + m[7] * b + m[8] * c;
  }
}

/** Reads the start of a chunk. @param {Uint8Array} bytes */
function readStart(bytes) {
  let at = 1;
  const number = () => {
    let value = 0;
    for (let shift = 0; shift < 35; shift += 7) {
      if (at >= bytes.length) throw new Error('the chunk is cut short');
      const byte = bytes[at++];
      value += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) return value;
    }
    throw new Error('the chunk has a number that is too large');
  };
  if (bytes[0] < 3 || bytes[0] > CODING_ZONES) throw new Error(`the chunk is coded in an unknown way (${bytes[0]})`);
  const [shared, rank, sparse, side, low] = [number(), number(), number(), number(), number()];
  const lowBegin = at + Math.floor(side / 2);
  if (lowBegin + low > bytes.length) throw new Error('the chunk is cut short');
  return {
    shared, rank, sparse,
    hasBands: bytes[0] >= CODING_BANDS,
    hasZones: bytes[0] === CODING_ZONES,
    states: side % 2 === 0 ? 1 : 8,
    side: bytes.subarray(at, lowBegin),
    low: bytes.subarray(lowBegin, lowBegin + low),
    values: bytes.subarray(lowBegin + low),
  };
}

/**
 * How much finer the bands of right sides are, each as its difference from the one before.
 * @param {BitDecoder} side
 * @param {LightPlane[]} planes
 */
function readFineness(side, planes) {
  const bands = planes.reduce((sum, plane) => sum + bandsOf(plane), 0);
  let before = 0;
  return Int8Array.from({ length: bands }, () => {
    before = Math.min(Math.max(before + side.signed(FINENESS), -128), 127);
    return before;
  });
}

/** @param {LightPlane} plane */
function bandsOf(plane) {
  return plane.isImage ? ZONES : plane.across;
}

/**
 * A chunk joined to the layers before it.
 * @param {Uint8Array} bytes
 * @param {number} width
 * @param {number} height
 * @param {number} columns
 * @param {LightPlane[]} planes
 * @param {Factors | null} base
 * @returns {Factors}
 */
export function decodeChunk(bytes, width, height, columns, planes, base) {
  const chunk = readStart(bytes);
  const pixels = width * height;
  const rows = 3 * pixels;
  const { rank, shared } = chunk;
  const before = base ? base.rank : 0;
  if (shared > rank || shared > before || rank > Math.min(rows, columns) + shared || 4 * rank > bytes.length) {
    throw new Error(`the chunk claims rank ${rank}`);
  }
  const side = new BitDecoder(chunk.side, CONTEXTS);
  /** @type {Int8Array} */
  let fineness = NO_FINENESS;
  if (chunk.hasBands) fineness = base && shared > 0 ? base.fineness : readFineness(side, planes);
  // The base layer's other components, which this one has nothing to say of, stay between those that it refines and its own.
  const kept = before - shared;
  const left = new Float32Array((rank + kept) * rows);
  const right = base ? base.right.slice() : [];
  if (base) left.set(base.left.subarray(shared * rows), shared * rows);
  if (rank > 0) {
    const decoder = new RansDecoder(chunk.values, chunk.states, chunk.low);
    let head = { tile: 0, left: 0, right: 0, rotation: 0 };
    const classesBefore = [0, 1, 2].map(() => new Int32Array(ZONES));
    const readClasses = (/** @type {number} */ kind) => {
      let shift = 0;
      return Array.from(classesBefore[kind], (last, zone) => {
        const guess = Math.min(Math.max(last + shift, 0), CLASSES - 1);
        const found = guess + side.signed(BANDS + (2 * kind + Number(guess === 0)) * SIGNED_CONTEXTS);
        const zoneClass = Math.min(Math.max(found, 0), CLASSES);
        if (zoneClass === CLASSES) throw new Error('a band has an unknown class');
        shift = zoneClass - last;
        classesBefore[kind][zone] = zoneClass;
        return zoneClass;
      });
    };
    for (let k = 0; k < rank; k++) {
      if (k > 0) {
        const tile = side.bit(TILE) ? head.tile : side.bits(2);
        const leftStep = head.left + side.signed(LEFT_STEP);
        const rightStep = head.right + side.signed(RIGHT_STEP);
        const rotation = side.bit(ROTATION) ? head.rotation : side.bits(32);
        const inside = (/** @type {number} */ step) => Math.min(Math.max(step, -STEP_LIMIT), STEP_LIMIT);
        head = { tile, left: inside(leftStep), right: inside(rightStep), rotation };
      } else {
        const tile = side.bits(2);
        const leftStep = side.bits(11) - STEP_LIMIT;
        head = { tile, left: leftStep, right: side.bits(11) - STEP_LIMIT, rotation: side.bits(32) };
      }
      const place = k < shared ? k : k + kept;
      const shape = { width, height, tile: TILES[head.tile] };
      for (let channel = 0; channel < 3; channel++) {
        const first = place * rows + channel * pixels;
        const zones = chunk.hasZones ? ZONE_STEPS[head.tile] : NO_FINENESS;
        readImage(decoder, readClasses(Math.min(channel, 1)), shape, head.left, zones, left, first);
      }
      turnBack(left, place * rows, pixels, head.rotation);
      let band = 0;
      const row = new RowBuilder();
      for (const plane of planes) {
        const finer = fineness.subarray(band, band + bandsOf(plane));
        readRight(decoder, readClasses(2), plane, head.right, finer, row);
        band += bandsOf(plane);
      }
      right.push(row.finish(place));
      if (base && k < shared) {
        for (let i = k * rows; i < (k + 1) * rows; i++) left[i] += base.left[i];
      }
      if (side.isExhausted()) throw new Error("the chunk's steps and classes are cut short");
    }
    decoder.finish();
  }
  const own = chunk.sparse > 0 ? readSparse(side, chunk.sparse, pixels, columns) : noSparse();
  return { rank: rank + kept, left, right, sparse: base ? joined(base.sparse, own) : own, fineness: base ? base.fineness : fineness };
}

/** A black block. @returns {Factors} */
export function noFactors() {
  return { rank: 0, left: new Float32Array(0), right: [], sparse: noSparse(), fineness: NO_FINENESS };
}

/** @returns {Sparse} */
function noSparse() {
  return { columns: new Uint32Array(0), rows: new Uint32Array(0), values: new Float32Array(0) };
}

/**
 * @param {Sparse} a
 * @param {Sparse} b
 * @returns {Sparse}
 */
function joined(a, b) {
  if (b.rows.length === 0) return a;
  const both = (/** @type {'columns' | 'rows'} */ key) => {
    const list = new Uint32Array(a[key].length + b[key].length);
    list.set(a[key]);
    list.set(b[key], a[key].length);
    return list;
  };
  const values = new Float32Array(a.values.length + b.values.length);
  values.set(a.values);
  values.set(b.values, a.values.length);
  return { columns: both('columns'), rows: both('rows'), values };
}

/**
 * @param {BitDecoder} side
 * @param {number} count
 * @param {number} pixels
 * @param {number} columns
 * @returns {Sparse}
 */
function readSparse(side, count, pixels, columns) {
  const step = stepOf(side.bits(11) - STEP_LIMIT);
  const sparse = { columns: new Uint32Array(count), rows: new Uint32Array(count), values: new Float32Array(count) };
  let [column, pixel, mask, columnStart, lastGap, read] = [0, 0, 0, 0, 0, 0];
  let begun = false;
  let values = [0, 0, 0];
  while (read < count) {
    const advance = side.number(COLUMN);
    column += advance;
    if (advance === 0 && begun) {
      lastGap = side.number(GAPS + NUMBER_CONTEXTS * Math.min(32 - Math.clz32(lastGap), 2));
      pixel += lastGap + 1;
    } else {
      columnStart += side.signed(START);
      lastGap = 0;
      pixel = columnStart;
    }
    let now = 0;
    for (let c = 0; c < 3; c++) now |= Number(side.bit(MASKS + 8 * mask + (now | ((1 << c) >> 1)))) << c;
    const next = values.slice();
    let first = -1;
    for (let c = 0; c < 3; c++) {
      if (((now >> c) & 1) === 0) continue;
      const guess = first < 0 ? values[c] : next[first] + values[c] - values[first];
      next[c] = guess + side.signed(first < 0 ? FIRST : OTHERS);
      if (first < 0) first = c;
    }
    [values, mask, begun] = [next, now, true];
    if (pixel < 0 || pixel >= pixels || column >= columns || mask === 0 || side.isExhausted()) {
      throw new Error('a sparse entry stands outside the block');
    }
    for (let c = 0; c < 3 && read < count; c++) {
      if (((mask >> c) & 1) === 0) continue;
      sparse.columns[read] = column;
      sparse.rows[read] = c * pixels + pixel;
      sparse.values[read++] = values[c] * step;
    }
  }
  return sparse;
}
