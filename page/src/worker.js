// What runs in a worker: it decodes the chunks of its rows of blocks, keeps their factors, and answers questions about them. Where
// there is no GPU it makes the picture too.

/** @import { LightPlane, Factors } from './codec.js' */
/** @import { Shape } from './blocks.js' */
/** @import { Rgb, Tone } from './colour.js' */
import { BlockStore, gridOf, rectOf } from './blocks.js';
import { columnTiles, decodeChunk, noFactors } from './codec.js';

/**
 * What a worker is told. `level`: 0 the preview, 1 the picture. `black`: for each level the blocks that have no chunk.
 * @typedef {{ type: 'start', levels: Shape[], columns: number, planes: LightPlane[], black: number[][],
 *   givesFactors: boolean }} Start
 * @typedef {{ type: 'chunk', level: number, id: number, layer: number, bytes: Uint8Array }} Chunk
 * @typedef {{ type: 'strips', token: number, level: number, weights: Float32Array, tone: Tone, rows: number[] }} Strips
 * @typedef {{ type: 'probe', token: number, level: number, x: number, y: number, weights: Float32Array }} Probe
 * @typedef {{ type: 'luminances', token: number, level: number, weights: Float32Array }} Luminances
 * @typedef {{ type: 'give' }} Give
 * @typedef {Start | Chunk | Strips | Probe | Luminances | Give} Order
 */
/**
 * What it says. A block that cannot be decoded has a problem in place of factors.
 * @typedef {{ type: 'block', level: number, id: number, layer: number, factors: Factors | null, problem: string }} BlockNews
 * @typedef {{ type: 'answer', token: number, value: any }} Answer
 * @typedef {BlockNews | Answer} News
 */

/** @param {{ postMessage: (news: News, transfer?: Transferable[]) => void, onmessage: any }} scope */
export function serve(scope) {
  /** @type {Start} */
  let start;
  /** @type {BlockStore[]} */
  let stores = [];
  /** @type {Float32Array | null} */
  let last = null;
  /** The same object for the same lighting, which comes as a copy each time: blocks know by it what they were lit by. @param {Float32Array} weights */
  const known = (weights) =>
    last && last.length === weights.length && last.every((value, i) => value === weights[i]) ? last : (last = weights);
  /** @param {Chunk} chunk */
  const take = ({ level, id, layer, bytes }) => {
    const { width, height } = rectOf(start.levels[level], id);
    try {
      const before = stores[level].factorsOf(id);
      if (layer > 0 && !before) throw new Error('its base layer is missing');
      const factors = decodeChunk(bytes, width, height, start.columns, start.planes, before);
      stores[level].set(id, factors);
      scope.postMessage({ type: 'block', level, id, layer, factors: start.givesFactors ? factors : null, problem: '' });
    } catch (error) {
      scope.postMessage({ type: 'block', level, id, layer, factors: null, problem: String(error) });
    }
  };
  scope.onmessage = (/** @type {{ data: Order }} */ { data: order }) => {
    const answer = (/** @type {any} */ value, /** @type {Transferable[]} */ transfer = []) => {
      scope.postMessage({ type: 'answer', token: /** @type {Probe} */ (order).token, value }, transfer);
    };
    switch (order.type) {
      case 'start':
        start = order;
        stores = order.levels.map((shape) => new BlockStore(shape, order.columns, columnTiles(order.planes)));
        order.black.forEach((ids, level) => ids.forEach((id) => stores[level].set(id, noFactors())));
        break;
      case 'chunk':
        take(order);
        break;
      case 'strips': {
        const [store, weights] = [stores[order.level], known(order.weights)];
        const strips = order.rows.map((row) => ({ row, rgba: store.strip(row, weights, order.tone) }));
        answer(strips, strips.map((strip) => strip.rgba.buffer));
        break;
      }
      case 'probe':
        answer(stores[order.level].probe(order.x, order.y, known(order.weights)));
        break;
      case 'luminances': {
        const lists = stores[order.level].luminances(known(order.weights));
        answer(lists, lists.map((list) => /** @type {ArrayBuffer} */ (list.buffer)));
        break;
      }
      case 'give':
        // The page has changed from a GPU to workers: nothing is to be given any more.
        start = { ...start, givesFactors: false };
        break;
    }
  };
}

/** Workers that share the rows of blocks among them. */
export class Crew {
  /**
   * @param {string} script the page's own script
   * @param {number} count
   * @param {(news: BlockNews) => void} onBlock
   * @param {(why: string) => void} onFailure of a worker that does not start
   */
  constructor(script, count, onBlock, onFailure) {
    this.token = 0;
    /** @type {Map<number, { worker: number, resolve: (value: any) => void, reject: (error: Error) => void }>} */
    this.waiting = new Map();
    /** Why there is nothing to ask. */
    this.failure = '';
    this.url = URL.createObjectURL(new Blob([script], { type: 'text/javascript' }));
    this.workers = Array.from({ length: count }, (_, index) => {
      let isStarted = false;
      const worker = new Worker(this.url);
      worker.onmessage = (/** @type {{ data: News }} */ { data: news }) => {
        isStarted = true;
        if (news.type === 'block') {
          onBlock(news);
        } else {
          this.waiting.get(news.token)?.resolve(news.value);
          this.waiting.delete(news.token);
        }
      };
      worker.onerror = (event) => {
        const why = event.message || 'this browser or server lets the page start no workers';
        if (!isStarted) this.failure = why;
        this.waiting.forEach((asked, token) => {
          if (isStarted && asked.worker !== index) return;
          this.waiting.delete(token);
          asked.reject(new Error(why));
        });
        if (!isStarted) onFailure(why);
      };
      return worker;
    });
  }

  /** @param {Omit<Start, 'type'>} start */
  start(start) {
    this.levels = start.levels;
    this.workers.forEach((worker) => worker.postMessage({ type: 'start', ...start }));
  }

  /** @param {number} level @param {number} row of blocks */
  workerOf(level, row) {
    // The preview has few rows: all of them are of one worker.
    return level === 0 ? 0 : row % this.workers.length;
  }

  /** @param {number} level @param {number} id @param {number} layer @param {Uint8Array} bytes */
  decode(level, id, layer, bytes) {
    const shape = /** @type {Shape[]} */ (this.levels)[level];
    const worker = this.workers[this.workerOf(level, Math.floor(id / gridOf(shape).across))];
    worker.postMessage({ type: 'chunk', level, id, layer, bytes });
  }

  /** @param {number} worker @param {any} order @returns {Promise<any>} */
  ask(worker, order) {
    const token = ++this.token;
    if (this.failure) return Promise.reject(new Error(this.failure));
    return new Promise((resolve, reject) => {
      this.waiting.set(token, { worker, resolve, reject });
      this.workers[worker].postMessage({ ...order, token });
    });
  }

  /**
   * All rows of blocks as they are shown.
   * @param {number} level
   * @param {Float32Array} weights
   * @param {Tone} tone
   * @returns {Promise<{ row: number, rgba: Uint8ClampedArray<ArrayBuffer> }[]>}
   */
  async strips(level, weights, tone) {
    const { down } = gridOf(/** @type {Shape[]} */ (this.levels)[level]);
    const parts = this.workers.map((_, worker) => {
      const rows = Array.from({ length: down }, (_, row) => row).filter((row) => this.workerOf(level, row) === worker);
      return rows.length > 0 ? this.ask(worker, { type: 'strips', level, weights, tone, rows }) : [];
    });
    return (await Promise.all(parts)).flat();
  }

  /** @param {number} level @param {number} x @param {number} y @param {Float32Array} weights @returns {Promise<Rgb | null>} */
  probe(level, x, y, weights) {
    const shape = /** @type {Shape[]} */ (this.levels)[level];
    return this.ask(this.workerOf(level, Math.floor(y / shape.side)), { type: 'probe', level, x, y, weights });
  }

  /** @param {number} level @param {Float32Array} weights @returns {Promise<Float32Array[]>} */
  async luminances(level, weights) {
    const lists = this.workers.map((_, worker) => this.ask(worker, { type: 'luminances', level, weights }));
    return (await Promise.all(lists)).flat();
  }

  giveNoMore() {
    this.workers.forEach((worker) => worker.postMessage({ type: 'give' }));
  }
}
