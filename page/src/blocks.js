// Blocks of factors on the CPU: `c = L (R ℓ) + S ℓ`, for pictures, single pixels and luminances.

/** @import { ColumnTile, Factors, RightRow } from './codec.js' */
/** @import { Tone, Rgb } from './colour.js' */
import { coefficientsOf } from './codec.js';
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
 * What has changed of a lighting: of each tile of columns that has, three planes of coefficients, or null for one that is 0.
 * @typedef {{ tile: number, planes: (Float64Array | null)[] }[]} Changes
 */

/**
 * By how much the weights are not what they were, as coefficients; `weights` are three planes of columns.
 * @param {ColumnTile[]} tiles
 * @param {Float32Array} weights
 * @param {Float32Array | null} before
 * @returns {Changes}
 */
export function changesOf(tiles, weights, before) {
  const columns = weights.length / 3;
  const deltas = new Float64Array(weights.length);
  for (let i = 0; i < weights.length; i++) deltas[i] = weights[i] - (before ? before[i] : 0);
  return tiles.flatMap((place, tile) => {
    const planes = [0, 1, 2].map((channel) => coefficientsOf(place, deltas, channel * columns));
    return planes.some((plane) => plane) ? [{ tile, planes }] : [];
  });
}

/** Changes to one lighting, each from the lighting before of some blocks: computed once for all of them. */
export class ChangesTo {
  /** @param {ColumnTile[]} tiles @param {Float32Array} weights */
  constructor(tiles, weights) {
    this.tiles = tiles;
    this.weights = weights;
    /** @type {Map<Float32Array | null, Changes>} */
    this.changes = new Map();
  }

  /** @param {Float32Array | null} before */
  from(before) {
    let changes = this.changes.get(before);
    if (!changes) this.changes.set(before, (changes = changesOf(this.tiles, this.weights, before)));
    return changes;
  }
}

/** The sums `R ℓ` of a block under one lighting after another: only what changed is added. */
export class Projection {
  /** @param {RightRow[]} rows that add up to the right sides. @param {number} rank */
  constructor(rows, rank) {
    this.rows = rows;
    this.sums = new Float64Array(3 * rank);
    /** The lighting that the sums are those of. @type {Float32Array | null} */
    this.weights = null;
  }

  /** Brings the sums to another lighting; says whether they were of another. @param {ChangesTo} changes */
  bring(changes) {
    if (this.weights === changes.weights) return false;
    this.add(changes.from(this.weights));
    this.weights = changes.weights;
    return true;
  }

  /** @param {Changes} changes */
  add(changes) {
    for (const { component, ends, places, values } of this.rows) {
      for (const { tile, planes } of changes) {
        const [begin, end] = [tile > 0 ? ends[tile - 1] : 0, ends[tile]];
        for (let channel = 0; channel < 3; channel++) {
          const plane = planes[channel];
          if (!plane) continue;
          let sum = 0;
          for (let i = begin; i < end; i++) sum += values[i] * plane[places[i]];
          this.sums[3 * component + channel] += sum;
        }
      }
    }
  }
}

/** Blocks of one picture, as they are known so far. */
export class BlockStore {
  /** @param {Shape} shape @param {number} columns @param {ColumnTile[]} tiles */
  constructor(shape, columns, tiles) {
    this.shape = shape;
    this.columns = columns;
    this.tiles = tiles;
    /** @type {Map<number, { factors: Factors, projection: Projection }>} */
    this.blocks = new Map();
    /** @type {ChangesTo | null} */
    this.changes = null;
  }

  /** @param {number} id @param {Factors} factors */
  set(id, factors) {
    this.blocks.set(id, { factors, projection: new Projection(factors.right, factors.rank) });
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
    if (this.changes?.weights !== weights) this.changes = new ChangesTo(this.tiles, weights);
    projection.bring(/** @type {ChangesTo} */ (this.changes));
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
