// Where the picture stands in its window: moved, zoomed, read; by mouse, touch and keyboard. In a panorama one looks around instead.

/** @import { LookAround } from './around.js' */

const MOST_ZOOM = 32;

/** The picture's place in its window. */
export class Stage {
  /**
   * @param {HTMLElement} stage
   * @param {HTMLCanvasElement} picture
   * @param {{ read: (at: { x: number, y: number } | null) => void, moved: () => void, turned: () => void }} listener hears of pixels to read,
   *   of moves, and of turns in a panorama
   */
  constructor(stage, picture, listener) {
    this.stage = stage;
    this.picture = picture;
    this.listener = listener;
    this.scale = 1;
    this.x = 0;
    this.y = 0;
    this.fitted = true;
    /** How one looks around; none: the picture is flat. @type {LookAround | null} */
    this.look = null;
    /** @type {Map<number, PointerEvent>} */
    this.pointers = new Map();
    new ResizeObserver(() => this.settle()).observe(stage);
    stage.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoom(2 ** (-event.deltaY / (event.deltaMode === 0 ? 300 : 10)), ...this.inside(event));
      if (this.look) this.readAt(event);
    }, { passive: false });
    stage.addEventListener('pointerdown', (event) => {
      stage.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, event);
      this.readAt(event);
    });
    stage.addEventListener('pointermove', (event) => this.move(event));
    for (const name of /** @type {const} */ (['pointerup', 'pointercancel'])) {
      stage.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    }
    // A finger that is lifted leaves too, but what it asked for stays.
    stage.addEventListener('pointerleave', (event) => event.pointerType === 'mouse' && listener.read(null));
    stage.addEventListener('focus', () => this.readMiddle());
    stage.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!step || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      if (this.look) {
        const angle = this.look.field / (event.shiftKey ? 200 : 12);
        this.turn(-step[0] * angle, step[1] * angle);
      } else {
        const far = event.shiftKey ? 1 : 40;
        [this.x, this.y, this.fitted] = [this.x + step[0] * far, this.y + step[1] * far, false];
        this.place();
      }
      this.readMiddle();
    });
  }

  /** @param {MouseEvent} event @returns {[number, number]} its place in the stage */
  inside(event) {
    const box = this.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** @param {PointerEvent} event */
  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (before) {
      const other = Array.from(this.pointers.values()).find((pointer) => pointer.pointerId !== event.pointerId);
      const [x, y] = this.inside(event);
      const [fromX, fromY] = this.inside(before);
      if (other) {
        // Two fingers: as far apart as they are.
        const [otherX, otherY] = this.inside(other);
        const apart = Math.max(Math.hypot(fromX - otherX, fromY - otherY), 10);
        this.zoom(Math.hypot(x - otherX, y - otherY) / apart, otherX, otherY);
      } else if (this.look) {
        // The picture goes with the pointer.
        const focal = this.look.focal(this.stage.clientWidth, this.stage.clientHeight);
        if (x !== fromX || y !== fromY) this.turn((fromX - x) / focal, (y - fromY) / focal);
      } else {
        [this.x, this.y] = [this.x + x - fromX, this.y + y - fromY];
        if (x !== fromX || y !== fromY) this.fitted = false;
        this.place();
      }
      this.pointers.set(event.pointerId, event);
    }
    this.readAt(event);
  }

  /** @param {number} right @param {number} up in radians */
  turn(right, up) {
    this.look?.turn(right, up);
    this.listener.turned();
  }

  /** @param {number} x @param {number} y in the stage */
  pixelAt(x, y) {
    if (this.look) return this.look.pixelAt(this.picture, this.stage.clientWidth, this.stage.clientHeight, x, y);
    const at = { x: Math.floor((x - this.x) / this.scale), y: Math.floor((y - this.y) / this.scale) };
    return at.x >= 0 && at.y >= 0 && at.x < this.picture.width && at.y < this.picture.height ? at : null;
  }

  /** @param {MouseEvent} event */
  readAt(event) {
    this.listener.read(this.pixelAt(...this.inside(event)));
  }

  readMiddle() {
    if (this.stage.matches(':focus-visible')) {
      this.listener.read(this.pixelAt(this.stage.clientWidth / 2, this.stage.clientHeight / 2));
    }
  }

  /** The whole picture, or of a panorama what lay ahead of the camera. */
  fit() {
    if (this.look) {
      this.look.ahead();
      this.listener.turned();
      this.readMiddle();
      return;
    }
    this.fitted = true;
    this.settle();
  }

  /** Places the picture once more: its stage is another, or it is. */
  settle() {
    if (!this.fitted) return this.place();
    const { clientWidth, clientHeight } = this.stage;
    this.scale = Math.min(clientWidth / this.picture.width, clientHeight / this.picture.height);
    this.x = (clientWidth - this.picture.width * this.scale) / 2;
    this.y = (clientHeight - this.picture.height * this.scale) / 2;
    this.place();
  }

  /** Where the picture stands, to go back there. */
  get standing() {
    const { scale, x, y, fitted } = this;
    return { scale, x, y, fitted };
  }

  /** @param {{ scale: number, x: number, y: number, fitted: boolean } | null} standing where it stood; null: it is fitted */
  goTo(standing) {
    Object.assign(this, standing ?? { fitted: true });
    this.settle();
  }

  /** Where the picture begins and how wide it is, in the stage. */
  get span() {
    return this.look ? [0, this.stage.clientWidth] : [this.x, this.picture.width * this.scale];
  }

  /** One pixel of the picture on one of the screen. */
  one() {
    const { clientWidth, clientHeight } = this.stage;
    const seen = this.look ? (2 * Math.PI * this.look.focal(clientWidth, clientHeight)) / this.picture.width : this.scale;
    this.zoom(1 / (seen * window.devicePixelRatio));
  }

  /** @param {number} factor @param {number} x @param {number} y what stays where it is */
  zoom(factor, x = this.stage.clientWidth / 2, y = this.stage.clientHeight / 2) {
    if (this.look) {
      this.look.zoom(factor);
      this.listener.turned();
      this.readMiddle();
      return;
    }
    const least = Math.min(1, 32 / Math.max(this.picture.width, this.picture.height));
    const scale = Math.min(Math.max(this.scale * factor, least), MOST_ZOOM);
    const share = scale / this.scale;
    [this.x, this.y, this.scale, this.fitted] = [x - (x - this.x) * share, y - (y - this.y) * share, scale, false];
    this.place();
    this.readMiddle();
  }

  place() {
    const keep = 24;
    const [width, height] = [this.picture.width * this.scale, this.picture.height * this.scale];
    this.x = Math.min(Math.max(this.x, keep - width), this.stage.clientWidth - keep);
    this.y = Math.min(Math.max(this.y, keep - height), this.stage.clientHeight - keep);
    this.picture.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.scale})`;
    this.picture.style.imageRendering = this.scale * window.devicePixelRatio >= 1 ? 'pixelated' : 'auto';
    this.listener.moved();
  }
}
