// Blocks of factors on the CPU: `c = L (R ℓ) + S ℓ`, for pictures, single pixels and luminances.

/** @import { Factors } from './codec.js' */
/** @import { Tone, Rgb } from './colour.js' */
import { showBlock } from './colour.js';

/**
 * A picture and its grid of blocks.
 * @typedef {{ width: number, height: number, side: number }} Shape
 */

/** @param {Shape} shape */
export function gridOf({ width, height, side }) {
  return { across: Math.ceil(width / side), down: Math.ceil(height / side) };
}

/**
 * The pixels of a block.
 * @param {Shape} shape
 * @param {number} id
 */
export function rectOf(shape, id) {
  const { across } = gridOf(shape);
  const [x, y] = [(id % across) * shape.side, Math.floor(id / across) * shape.side];
  return { x, y, width: Math.min(shape.side, shape.width - x), height: Math.min(shape.side, shape.height - y) };
}

/**
 * The columns whose weight is not what it was, and by how much; `weights` are three planes of columns.
 * @param {Float32Array} weights
 * @param {Float32Array | null} before
 */
export function changesOf(weights, before) {
  const columns = weights.length / 3;
  /** @type {number[]} */
  const changed = [];
  const deltas = new Float64Array(weights.length);
  for (let i = 0; i < weights.length; i++) deltas[i] = weights[i] - (before ? before[i] : 0);
  for (let j = 0; j < columns; j++) {
    if (deltas[j] !== 0 || deltas[columns + j] !== 0 || deltas[2 * columns + j] !== 0) changed.push(j);
  }
  return { changed, deltas };
}

/** The sums `R ℓ` of a block under one lighting after another: only what changed is added. */
export class Projection {
  /** @param {Float32Array} right, a value a column for each component. @param {number} rank @param {number} columns */
  constructor(right, rank, columns) {
    this.right = right;
    this.rank = rank;
    this.columns = columns;
    this.sums = new Float64Array(3 * rank);
  }

  /** @param {{ changed: number[], deltas: Float64Array }} changes */
  add({ changed, deltas }) {
    const { right, columns, sums } = this;
    for (let k = 0; k < this.rank; k++) {
      let [r, g, b] = [0, 0, 0];
      for (let i = 0; i < changed.length; i++) {
        const j = changed[i];
        const value = right[k * columns + j];
        r += value * deltas[j];
        g += value * deltas[columns + j];
        b += value * deltas[2 * columns + j];
      }
      sums[3 * k] += r;
      sums[3 * k + 1] += g;
      sums[3 * k + 2] += b;
    }
  }
}

/** Blocks of one picture, as they are known so far. */
export class BlockStore {
  /** @param {Shape} shape @param {number} columns */
  constructor(shape, columns) {
    this.shape = shape;
    this.columns = columns;
    /** @type {Map<number, { factors: Factors, projection: Projection, weights: Float32Array | null }>} */
    this.blocks = new Map();
  }

  /** @param {number} id @param {Factors} factors */
  set(id, factors) {
    const projection = new Projection(factors.right, factors.rank, this.columns);
    this.blocks.set(id, { factors, projection, weights: null });
  }

  /** @param {number} id */
  factorsOf(id) {
    return this.blocks.get(id)?.factors ?? null;
  }

  /**
   * The radiance of a block, three planes of pixels; null where it is not known.
   * @param {number} id
   * @param {Float32Array} weights
   */
  radiance(id, weights) {
    const block = this.blocks.get(id);
    if (!block) return null;
    const { factors, projection } = block;
    if (block.weights !== weights) {
      projection.add(changesOf(weights, block.weights));
      block.weights = weights;
    }
    const rect = rectOf(this.shape, id);
    const pixels = rect.width * rect.height;
    const planes = new Float32Array(3 * pixels);
    const { left, sparse } = factors;
    for (let k = 0; k < factors.rank; k++) {
      for (let channel = 0; channel < 3; channel++) {
        const sum = projection.sums[3 * k + channel];
        if (sum === 0) continue;
        const [from, to] = [(3 * k + channel) * pixels, channel * pixels];
        for (let p = 0; p < pixels; p++) planes[to + p] += left[from + p] * sum;
      }
    }
    for (let i = 0; i < sparse.rows.length; i++) {
      const row = sparse.rows[i];
      planes[row] += sparse.values[i] * weights[Math.floor(row / pixels) * this.columns + sparse.columns[i]];
    }
    return { planes, rect };
  }

  /**
   * A row of blocks as it is shown; pixels of blocks that are not known stay clear.
   * @param {number} row
   * @param {Float32Array} weights
   * @param {Tone} tone
   */
  strip(row, weights, tone) {
    const { across } = gridOf(this.shape);
    const { width, side, height } = this.shape;
    const rgba = new Uint8ClampedArray(4 * width * Math.min(side, height - row * side));
    for (let column = 0; column < across; column++) {
      const shown = this.radiance(row * across + column, weights);
      if (shown) showBlock(shown.planes, shown.rect.width, shown.rect.height, tone, rgba, shown.rect.x, width);
    }
    return rgba;
  }

  /**
   * The radiance at a pixel; null where its block is not known.
   * @param {number} x
   * @param {number} y
   * @param {Float32Array} weights
   * @returns {Rgb | null}
   */
  probe(x, y, weights) {
    const { side } = this.shape;
    const found = this.radiance(Math.floor(y / side) * gridOf(this.shape).across + Math.floor(x / side), weights);
    if (!found) return null;
    const { planes, rect } = found;
    const [at, pixels] = [(y - rect.y) * rect.width + x - rect.x, rect.width * rect.height];
    return [planes[at], planes[at + pixels], planes[at + 2 * pixels]];
  }

  /** The luminances of all known blocks. @param {Float32Array} weights */
  luminances(weights) {
    /** @type {Float32Array[]} */
    const lists = [];
    for (const id of this.blocks.keys()) {
      const { planes } = /** @type {{ planes: Float32Array }} */ (this.radiance(id, weights));
      const pixels = planes.length / 3;
      const list = new Float32Array(pixels);
      for (let p = 0; p < pixels; p++) {
        list[p] = 0.2126 * planes[p] + 0.7152 * planes[pixels + p] + 0.0722 * planes[2 * pixels + p];
      }
      lists.push(list);
    }
    return lists;
  }
}
