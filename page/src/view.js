// One of the views of a page: its data, its picture, and where that stands. What is on the lights is the page's.

/** @import { BlockNews } from './worker.js' */
/** @import { EmbeddedBytes, FetchedBytes, Head, Listener } from './stream.js' */
import { rectOf } from './blocks.js';
import { readShare } from './stream.js';
import { Engine } from './engine.js';
import { LookAround } from './around.js';

const LAYER_NAMES = ['coarse', 'fine'];

/** Where a picture is drawn before it is put where it is seen. @param {number} width @param {number} height */
function layerOf(width, height) {
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [width, height];
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
}

/** A view whose head is known. */
export class View {
  /** @param {string} name @param {Head} head @param {() => void} goOn lets its data go on */
  constructor(name, head, goOn) {
    this.name = name;
    this.head = head;
    this.goOn = goOn;
    /** Place of each of its lights among all. @type {number[]} */
    this.places = [];
    const whole = head.levels[1];
    this.now = layerOf(whole.width, whole.height);
    this.other = layerOf(whole.width, whole.height);
    this.isOtherOld = true;
    /** Where its picture stood when it was seen last. @type {{ scale: number, x: number, y: number, fitted: boolean } | null} */
    this.standing = null;
    const mayBePanorama = head.panorama ?? whole.width === 2 * whole.height;
    /** How one looks around in it; none: it is no panorama. @type {LookAround | null} */
    this.look = mayBePanorama ? new LookAround() : null;
    this.isAround = head.panorama === true;
    /** @type {Map<string, string>} */
    this.damage = new Map();
    this.isComplete = false;
    this.loaded = 0;
    /** What the picture that is seen was drawn from. */
    this.drawn = 'loading';
    /** @type {Engine | null} */
    this.engine = null;
  }

  /**
   * The engine; what hears of it hears of this view. It is made, and the data go on, once it is asked for.
   * @param {string} script
   * @param {{ changed: (view: View, news: BlockNews | null) => void, lost: (view: View) => void, way: (view: View, way: string) => void, failed: (why: string) => void }} page
   */
  begin(script, page) {
    if (this.engine) return this.engine;
    const wish = new URLSearchParams(location.search).get('compute');
    this.engine = new Engine(this.head, script, wish, {
      changed: (news) => {
        this.isOtherOld = true;
        page.changed(this, news);
      },
      bad: (/** @type {BlockNews} */ news) => {
        this.lost(news.level, news.layer, news.id, news.problem);
        page.lost(this);
      },
      way: (way) => page.way(this, way),
      failed: page.failed,
    });
    this.goOn();
    return this.engine;
  }

  /** @param {number} level @param {number} layer @param {number | null} id @param {string} why */
  lost(level, layer, id, why) {
    const which = level === 0 ? 'preview' : LAYER_NAMES[layer] ?? `layer ${layer}`;
    let where = `all that is missing of it`;
    if (id !== null) {
      const { x, y, width, height } = rectOf(this.head.levels[level], id);
      const shrink = level === 0 ? this.head.shrink : 1;
      where = `pixels ${x * shrink} to ${(x + width) * shrink - 1} across, ${y * shrink} to ${(y + height) * shrink - 1} down`;
    }
    this.damage.set(`${level} ${layer} ${id}`, `${which}, ${where}: ${why}`);
  }
}

/**
 * Opens a view: its head comes at once, what follows once it is seen. `news` hears of what comes, of how much has come, and of the end or why
 * there is none.
 * @param {string} name
 * @param {FetchedBytes | EmbeddedBytes} bytes
 * @param {{ came: (view: View) => void, progressed: (view: View) => void, ended: (view: View, problem: string | null) => void }} news
 * @returns {Promise<View>}
 */
export function openView(name, bytes, news) {
  return new Promise((resolve, reject) => {
    /** @type {View | null} */
    let view = null;
    const known = () => /** @type {View} */ (view);
    /** @type {Listener} */
    const listener = {
      head: (head) => new Promise((goOn) => resolve((view = new View(name, head, () => goOn())))),
      chunk: (level, id, layer, chunk) => known().engine?.decode(level, id, layer, chunk),
      layerDone: () => news.came(known()),
      progress: (have, total) => {
        known().loaded = have / total;
        news.progressed(known());
      },
      lost: (level, layer, id, why) => {
        known().lost(level, layer, id, why);
        news.came(known());
      },
    };
    readShare(bytes, listener).then(() => {
      known().isComplete = true;
      news.ended(known(), null);
    }, (error) => {
      if (view) news.ended(view, error instanceof Error ? error.message : String(error));
      else reject(error);
    });
  });
}
