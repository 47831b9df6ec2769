// Who makes the picture: WebGPU where there is one, WebGL 2 elsewhere, workers as the last resort. Whoever it is, the preview
// stands below the blocks that are not there yet.

/** @import { Factors } from './codec.js' */
/** @import { Tone } from './colour.js' */
/** @import { Head, Level } from './stream.js' */
/** @import { BlockNews } from './worker.js' */
import { columnTiles, lightPlanes, noFactors } from './codec.js';
import { gridOf } from './blocks.js';
import { GlPainter } from './webgl.js';
import { GpuPainter } from './webgpu.js';
import { Crew } from './worker.js';

/** Ways to compute, the best first. */
export const WAYS = ['webgpu', 'webgl2', 'worker'];
/** Workers at most: more than decode faster than a network brings. */
const MOST_WORKERS = 4;

/**
 * What makes pictures of one level.
 * @typedef {{ setBlock: (id: number, factors: Factors) => void,
 *   draw: (weights: Float32Array, tone: Tone) => Promise<HTMLCanvasElement> }} Painter
 */

/** A level painted by the workers that hold its blocks. */
class CrewPainter {
  /** @param {Level} level @param {number} index @param {Crew} crew */
  constructor(level, index, crew) {
    this.index = index;
    this.crew = crew;
    this.side = level.side;
    this.canvas = document.createElement('canvas');
    [this.canvas.width, this.canvas.height] = [level.width, level.height];
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext('2d'));
  }

  setBlock() {}

  /** @param {Float32Array} weights @param {Tone} tone */
  async draw(weights, tone) {
    for (const { row, rgba } of await this.crew.strips(this.index, weights, tone)) {
      this.context.putImageData(new ImageData(rgba, this.canvas.width), 0, row * this.side);
    }
    return this.canvas;
  }
}

/** The picture under any lighting, as far as it is known. */
export class Engine {
  /**
   * @param {Head} head
   * @param {string} script the page's own script, for workers
   * @param {string | null} wish a way to compute, or null for the best
   * @param {{ changed: (news: BlockNews | null) => void, bad: (news: BlockNews) => void, way: (way: string) => void,
   *   failed: (why: string) => void }} listener
   */
  constructor(head, script, wish, listener) {
    this.head = head;
    this.listener = listener;
    this.ways = wish ? WAYS.slice(Math.max(WAYS.indexOf(wish), 0)) : WAYS.slice();
    this.way = '';
    this.planes = lightPlanes(head.lights);
    /** Chunks that were handed to the workers and have not come back. */
    this.atWork = 0;
    const count = Math.max(1, Math.min(MOST_WORKERS, (navigator.hardwareConcurrency || 2)));
    this.crew = new Crew(script, count, (news) => this.take(news), (why) => this.listener.failed(why));
    const black = head.levels.map(({ ranks, sparse }) => [...ranks.keys()].filter((id) => ranks[id] === 0 && sparse[id] === 0));
    this.black = black;
    this.crew.start({
      levels: head.levels.map(({ width, height, side }) => ({ width, height, side })),
      columns: head.columns, planes: this.planes, black, givesFactors: this.ways[0] !== 'worker',
    });
    /** @type {Painter[]} */
    this.painters = [];
    /** Blocks of each level that are known, and whether all are. */
    this.known = head.levels.map((_, level) => new Set(black[level]));
    /** Factors that came before there was a painter. @type {{ level: number, id: number, factors: Factors }[]} */
    this.waiting = [];
    this.ready = this.choose();
  }

  /** Takes the first way that works. */
  async choose() {
    for (const way of this.ways) {
      try {
        this.painters = await this.open(way);
        this.way = way;
        break;
      } catch (error) {
        console.info(`${way}: ${error instanceof Error ? error.message : error}`);
      }
    }
    this.black.forEach((ids, level) => ids.forEach((id) => this.painters[level].setBlock(id, noFactors())));
    if (this.way === 'worker') this.crew.giveNoMore();
    else this.waiting.forEach(({ level, id, factors }) => this.painters[level].setBlock(id, factors));
    this.waiting = [];
    this.listener.way(this.way);
    this.listener.changed(null);
  }

  /** @param {string} way @returns {Promise<Painter[]>} */
  async open(way) {
    const { levels, columns } = this.head;
    const lost = () => this.fallBack(way);
    const tiles = columnTiles(this.planes);
    if (way === 'webgpu') return Promise.all(levels.map((level) => GpuPainter.open(level, columns, tiles, lost)));
    if (way === 'webgl2') return levels.map((level) => new GlPainter(level, columns, tiles, lost));
    return levels.map((level, index) => new CrewPainter(level, index, this.crew));
  }

  /** The GPU was lost: the workers hold all that is needed. @param {string} way that was lost */
  fallBack(way) {
    if (this.way !== way) return;
    this.ways = ['worker'];
    this.way = '';
    this.ready = this.choose();
  }

  /** @param {number} level @param {number} id @param {number} layer @param {Uint8Array} bytes */
  decode(level, id, layer, bytes) {
    this.atWork++;
    this.crew.decode(level, id, layer, bytes);
  }

  /** @param {BlockNews} news */
  take(news) {
    this.atWork--;
    if (news.problem !== '') {
      this.listener.bad(news);
    } else {
      this.known[news.level].add(news.id);
      if (news.factors) {
        if (this.way === '') this.waiting.push({ level: news.level, id: news.id, factors: news.factors });
        else this.painters[news.level].setBlock(news.id, news.factors);
      }
    }
    this.listener.changed(news);
  }

  /** Whether every block is known, be it coarsely. @param {number} level */
  isWhole(level) {
    const { across, down } = gridOf(this.head.levels[level]);
    return this.known[level].size === across * down;
  }

  /**
   * Draws the picture onto a canvas of its size.
   * @param {CanvasRenderingContext2D} onto
   * @param {Float32Array} weights
   * @param {Tone} tone
   */
  async draw(onto, weights, tone) {
    await this.ready;
    const isWhole = this.isWhole(1);
    // A canvas of a GPU holds its picture only until the task ends: each is copied at once.
    if (!isWhole) {
      const preview = await this.painters[0].draw(weights, tone);
      onto.clearRect(0, 0, onto.canvas.width, onto.canvas.height);
      onto.imageSmoothingQuality = 'high';
      const { shrink } = this.head;
      onto.drawImage(preview, 0, 0, preview.width * shrink, preview.height * shrink);
      if (this.known[1].size === 0) return;
    }
    onto.drawImage(await this.painters[1].draw(weights, tone), 0, 0);
  }

  /**
   * Draws the preview alone, as small as a canvas is.
   * @param {CanvasRenderingContext2D} onto
   * @param {Float32Array} weights
   * @param {Tone} tone
   */
  async drawSmall(onto, weights, tone) {
    await this.ready;
    onto.drawImage(await this.painters[0].draw(weights, tone), 0, 0, onto.canvas.width, onto.canvas.height);
  }

  /** The level that single pixels and luminances are read from: the picture where it is known. @param {number} x @param {number} y */
  levelAt(x, y) {
    const level = this.head.levels[1];
    return this.known[1].has(Math.floor(y / level.side) * gridOf(level).across + Math.floor(x / level.side)) ? 1 : 0;
  }

  /** The radiance at a pixel of the picture; null where nothing is known. @param {number} x @param {number} y @param {Float32Array} weights */
  probe(x, y, weights) {
    const level = this.levelAt(x, y);
    const at = (/** @type {number} */ v) => (level === 0 ? Math.floor(v / this.head.shrink) : v);
    return this.crew.probe(level, at(x), at(y), weights);
  }

  /**
   * Exposure, in stops, that brings the 85th percentile of luminance to 0.7, as the window does. What is ten stops below the 99th percentile of
   * all pixels, and black, does not count.
   * @param {Float32Array} weights
   */
  async exposureFor(weights) {
    const lists = await this.crew.luminances(this.isWhole(1) ? 1 : 0, weights);
    const all = new Float32Array(lists.reduce((sum, list) => sum + list.length, 0));
    let at = 0;
    for (const list of lists) for (const v of list) all[at++] = Number.isFinite(v) ? Math.max(v, 0) : 0;
    all.sort();
    const percentile = (/** @type {Float32Array} */ sorted, /** @type {number} */ percent) =>
      sorted[Math.floor(((sorted.length - 1) * percent) / 100)] ?? 0;
    const least = percentile(all, 99) / 1024;
    const seen = all.subarray(all.findIndex((v) => v > 0 && v >= least));
    const bright = percentile(seen, 85);
    if (!(bright > 0)) return 0;
    return Math.min(Math.max(Math.log2(0.7 / bright), -24), 24);
  }
}
