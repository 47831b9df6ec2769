// Looking around in a panorama: which of its places is seen where, and the picture that is seen so. As the scene's panorama camera has it
// (src/scene/camera.rs): the viewing direction in the middle, what is right of it to the right, up at the upper edge, and at the left and
// the right edge what lies behind, ±180°.

const TURN = 2 * Math.PI;
const DEGREE = TURN / 360;
/** Field of view along the larger side of what is seen, in radians: at first, at least, at most. */
const FIRST_FIELD = 80 * DEGREE;
const LEAST_FIELD = 30 * DEGREE;
const MOST_FIELD = 100 * DEGREE;
/** Pixels, across and down, between places that are computed; those in between lie evenly, unless they go round too fast. */
const MESH = 8;
/** Share of the panorama's width that a mesh may span so. */
const MOST_SPAN = 0.02;
/** Pixels of what is seen while it moves, at most, and how long it rests until it is drawn finer. */
const MOST_MOVING = 1e6;
const REST_MS = 150;

/** A direction to look, and how wide. */
export class LookAround {
  constructor() {
    this.yaw = 0;
    this.pitch = 0;
    this.field = FIRST_FIELD;
  }

  /** Looks to where the camera looked. */
  ahead() {
    [this.yaw, this.pitch, this.field] = [0, 0, FIRST_FIELD];
  }

  /** @param {number} right @param {number} up in radians; not beyond straight up and down */
  turn(right, up) {
    const yaw = this.yaw + right;
    this.yaw = yaw - TURN * Math.round(yaw / TURN);
    this.pitch = Math.min(Math.max(this.pitch + up, -TURN / 4), TURN / 4);
  }

  /** @param {number} factor by which what is in the middle grows */
  zoom(factor) {
    this.field = Math.min(Math.max(2 * Math.atan(Math.tan(this.field / 2) / factor), LEAST_FIELD), MOST_FIELD);
  }

  /** Pixels of a radian in the middle of a view of this size. @param {number} width @param {number} height */
  focal(width, height) {
    return Math.max(width, height) / 2 / Math.tan(this.field / 2);
  }

  /** For a link: degrees of yaw, pitch and field of view. */
  get degrees() {
    return [this.yaw, this.pitch, this.field].map((v) => Number((v / DEGREE).toFixed(1)));
  }

  /** @param {number[]} degrees of a link */
  goTo(degrees) {
    const [yaw, pitch, field] = degrees.map((v) => v * DEGREE);
    if (![yaw, pitch, field].every(Number.isFinite)) return;
    this.ahead();
    this.turn(yaw, pitch);
    this.field = Math.min(Math.max(field, LEAST_FIELD), MOST_FIELD);
  }

  /**
   * What is seen in a view of this size: for a place in its pixels from the top left, the panorama's, as shares of its width and height.
   * @param {number} width
   * @param {number} height
   * @returns {(x: number, y: number) => [number, number]}
   */
  sight(width, height) {
    const focal = this.focal(width, height);
    const [sinYaw, cosYaw, sinPitch, cosPitch] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    return (x, y) => {
      const [aside, above] = [x - width / 2, height / 2 - y];
      const up = above * cosPitch + focal * sinPitch;
      const level = focal * cosPitch - above * sinPitch;
      const right = aside * cosYaw + level * sinYaw;
      const ahead = level * cosYaw - aside * sinYaw;
      return [Math.atan2(right, ahead) / TURN + 0.5, Math.atan2(Math.hypot(right, ahead), up) / (TURN / 2)];
    };
  }

  /**
   * The pixel of a panorama that is seen at a place of a view.
   * @param {{ width: number, height: number }} panorama
   * @param {number} width
   * @param {number} height
   * @param {number} x
   * @param {number} y
   */
  pixelAt(panorama, width, height, x, y) {
    const [u, v] = this.sight(width, height)(x, y);
    return { x: Math.floor(u * panorama.width) % panorama.width, y: Math.min(Math.floor(v * panorama.height), panorama.height - 1) };
  }
}

/** Between two colours of four bytes, 256 being all of the second. @param {number} a @param {number} b @param {number} share */
function between(a, b, share) {
  const rest = 256 - share;
  const even = Math.imul(a & 0xff00ff, rest) + Math.imul(b & 0xff00ff, share) + 0x800080;
  const odd = Math.imul((a >>> 8) & 0xff00ff, rest) + Math.imul((b >>> 8) & 0xff00ff, share) + 0x800080;
  return ((even >>> 8) & 0xff00ff) | (odd & 0xff00ff00);
}

/**
 * Draws what is seen of a panorama into some columns of a view: bilinear, across the seam too.
 * @param {ImageData} panorama
 * @param {LookAround} look
 * @param {ImageData} view
 * @param {number} from
 * @param {number} to
 */
export function drawAround(panorama, look, view, from, to) {
  const { width, height } = panorama;
  const [source, target] = [panorama, view].map(({ data }) => new Uint32Array(data.buffer, data.byteOffset, data.length / 4));
  const sight = look.sight(view.width, view.height);
  const colour = (/** @type {number} */ u, /** @type {number} */ v) => {
    const x = u * width - 0.5;
    const y = Math.min(Math.max(v * height - 0.5, 0), height - 1);
    const [left, top] = [Math.floor(x), Math.floor(y)];
    const near = left < 0 ? width - 1 : left;
    const far = left + 1 < width ? left + 1 : 0;
    const [above, below] = [top * width, Math.min(top + 1, height - 1) * width];
    const share = Math.round(256 * (x - left));
    const high = between(source[above + near], source[above + far], share);
    const low = between(source[below + near], source[below + far], share);
    return between(high, low, Math.round(256 * (y - top)));
  };
  for (let y = 0; y < view.height; y += MESH) {
    for (let x = from; x < to; x += MESH) {
      const place = (/** @type {number} */ i, /** @type {number} */ j) => sight(x + i + 0.5, y + j + 0.5);
      const [[au, av], [bu, bv], [cu, cv], [du, dv]] = [place(0, 0), place(MESH, 0), place(0, MESH), place(MESH, MESH)];
      const isEven = Math.max(au, bu, cu, du) - Math.min(au, bu, cu, du) < MOST_SPAN;
      const [across, down] = [Math.min(MESH, to - x), Math.min(MESH, view.height - y)];
      for (let j = 0; j < down; j++) {
        const [share, first] = [j / MESH, (y + j) * view.width + x];
        const [u, v] = [au + (cu - au) * share, av + (cv - av) * share];
        const [stepU, stepV] = [(bu + (du - bu) * share - u) / MESH, (bv + (dv - bv) * share - v) / MESH];
        for (let i = 0; i < across; i++) {
          const [atU, atV] = isEven ? [u + i * stepU, v + i * stepV] : place(i, j);
          target[first + i] = colour(atU, atV);
        }
      }
    }
  }
}

/** Where a panorama is seen as one looks around in it. */
export class AroundCanvas {
  /** @param {HTMLCanvasElement} canvas as large as what is seen */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
    /** What is seen, and at the left of the wipe, if there is one; none: they have changed. @type {ImageData[]} */
    this.pictures = [];
    this.timer = 0;
    /** @type {ImageData | null} */
    this.view = null;
  }

  /**
   * Draws what is seen, coarsely where it is large, and fine once it rests.
   * @param {LookAround} look
   * @param {CanvasRenderingContext2D[]} pictures the picture, and what it is compared with
   * @param {number} wipe share of the width up to which the other one is seen
   * @param {boolean} isFine
   */
  draw(look, pictures, wipe, isFine = false) {
    clearTimeout(this.timer);
    const { canvas } = this;
    const { clientWidth, clientHeight } = canvas;
    if (clientWidth * clientHeight === 0) return;
    const fine = window.devicePixelRatio;
    const scale = isFine ? fine : Math.min(fine, Math.sqrt(MOST_MOVING / (clientWidth * clientHeight)));
    if (scale < fine) this.timer = window.setTimeout(() => this.draw(look, pictures, wipe, true), REST_MS);
    const [width, height] = [Math.round(clientWidth * scale), Math.round(clientHeight * scale)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    if (this.view?.width !== width || this.view.height !== height) this.view = this.context.createImageData(width, height);
    if (this.pictures.length === 0) this.pictures = pictures.map((one) => one.getImageData(0, 0, one.canvas.width, one.canvas.height));
    const [now, other] = this.pictures;
    const line = other ? Math.round(wipe * width) : 0;
    if (other) drawAround(other, look, this.view, 0, line);
    drawAround(now, look, this.view, line, width);
    this.context.putImageData(this.view, 0, 0);
  }
}
