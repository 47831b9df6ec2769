// The page itself: it joins the data, the engine, the stage and the mixer. The same script runs in workers.

/** @import { View } from './view.js' */
/** @import { Mix } from './mix.js' */
import { CURVES, luminance, toneOf } from './colour.js';
import { serve } from './worker.js';
import { EmbeddedBytes, FetchedBytes, inflate } from './stream.js';
import { Desk, copyOf, ofShortForm, shortForm, unionOf } from './mix.js';
import { openView } from './view.js';
import { Mixer, make, signed } from './mixer.js';
import { Stage } from './stage.js';
import { AroundCanvas } from './around.js';

/** Changes that can be undone. */
const MOST_UNDONE = 100;
/** Width of a look's thumbnail. */
const THUMB_WIDTH = 160;
/** What is said of the picture as it stands, and as one looks around in it. */
const FLAT_LABEL = 'Picture: arrow keys move it, plus and minus zoom, F fits it, 1 shows it pixel for pixel; the cross in the middle reads it';
const AROUND_LABEL = 'Panorama: arrow keys turn, plus and minus zoom, F looks ahead, P shows it flat; the cross in the middle reads it';
const WAY_NAMES = { webgpu: 'WebGPU', webgl2: 'WebGL 2', worker: 'workers' };

/** @template {HTMLElement} [T=HTMLElement] @param {string} id */
function byId(id) {
  return /** @type {T} */ (document.getElementById(id));
}

/** @param {number} value */
function short(value) {
  return value === 0 ? '0' : Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3 ? value.toExponential(2) : String(Number(value.toPrecision(3)));
}

/** @param {Uint8Array<ArrayBuffer>} bytes */
async function deflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new CompressionStream('deflate-raw'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** @param {any} state */
async function fragmentOf(state) {
  const bytes = await deflate(new TextEncoder().encode(JSON.stringify(state)));
  const text = btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(''));
  return '#' + text.replaceAll('+', '-').replaceAll('/', '_').replaceAll('=', '');
}

/** @param {string} fragment */
async function stateOf(fragment) {
  const text = atob(fragment.slice(1).replaceAll('-', '+').replaceAll('_', '/'));
  return JSON.parse(new TextDecoder().decode(await inflate(Uint8Array.from(text, (sign) => sign.charCodeAt(0)))));
}

/** The page once the heads of its views are known: one mix lights them all. */
class Page {
  /** @param {View[]} views @param {string} script */
  constructor(views, script) {
    const { all, places } = unionOf(views);
    views.forEach((view, i) => (view.places = places[i]));
    this.views = views;
    this.view = views[0];
    this.script = script;
    this.head = all;
    this.desk = new Desk(all);
    this.current = this.desk.mixOf(-1);
    this.exposure = all.exposure;
    this.curve = 0;
    /** @type {Mix[]} */
    this.undone = [];
    this.lastKept = copyOf(this.current);
    /** @type {Mix | null} */
    this.kept = null;
    /** Weights of the view's columns. @type {Float32Array | null} */
    this.weights = null;
    /** @type {Float32Array | null} */
    this.otherWeights = null;
    this.isWanted = false;
    this.isBusy = false;
    this.areThumbsOld = true;
    /** @type {{ x: number, y: number } | null} */
    this.asked = null;
    this.fragment = '';
    this.lastState = '';
    /** What was told last, beside the damage of views. */
    this.notice = '';
    this.linkTimer = 0;
    this.picture = byId('picture');
    const canvas = /** @type {HTMLCanvasElement} */ (this.picture);
    this.shown = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
    this.stage = new Stage(byId('stage'), canvas, {
      read: (at) => {
        this.asked = at;
        this.probe();
      },
      moved: () => this.moved(),
      turned: () => {
        this.moved();
        this.link();
      },
    });
    this.around = new AroundCanvas(byId('around'));
    this.turning = 0;
    this.mixer = new Mixer(byId('lights'), this.desk, () => this.current, (change, isEnd) => this.change(change, isEnd));
    this.fillControls();
    this.listen();
    this.show(0);
  }

  /** The engine of the view that is seen; it begins with the first call. */
  get engine() {
    return this.view.begin(this.script, {
      changed: (view, news) => {
        // The first layer of the preview has what all lights do together; the next tells them apart.
        if (view === this.view && news?.level === 0 && news.layer > 0) this.areThumbsOld = true;
        this.came(view);
      },
      lost: (view) => this.came(view),
      way: (view, way) => {
        if (view === this.view) document.body.dataset.way = way;
      },
      failed: fail,
    });
  }

  /** Shows a view under the same mix, where it stood. @param {number} index */
  show(index) {
    const view = this.views[index];
    if (view !== this.view) {
      this.view.standing = this.stage.standing;
      this.link();
    }
    this.view = view;
    const { width, height } = view.head.levels[1];
    const canvas = /** @type {HTMLCanvasElement} */ (this.picture);
    [canvas.width, canvas.height] = [width, height];
    for (const thumb of this.thumbs ?? []) thumb.canvas.height = Math.round((THUMB_WIDTH * height) / width);
    document.body.dataset.way = this.engine.way;
    document.body.dataset.view = view.name;
    Array.from(byId('views').children).forEach((tab, i) => tab.setAttribute('aria-pressed', String(i === index)));
    this.mixer.list(view.places);
    this.lookAround(view.isAround);
    this.stage.goTo(view.standing);
    [this.weights, this.asked, this.areThumbsOld] = [null, null, true];
    this.compare();
    this.compose();
    this.showDamage();
  }

  /** Shows the next view, or one before. @param {number} step */
  step(step) {
    const count = this.views.length;
    if (count > 1) this.show((this.views.indexOf(this.view) + count + step) % count);
  }

  /** Looks around in the panorama, or shows it flat. @param {boolean} isAround */
  lookAround(isAround) {
    const { view } = this;
    view.isAround = isAround;
    this.stage.look = isAround ? view.look : null;
    byId('look').hidden = !view.look;
    byId('look').setAttribute('aria-pressed', String(isAround));
    [byId('picture').hidden, byId('around').hidden] = [isAround, !isAround];
    byId('stage').setAttribute('aria-label', isAround ? AROUND_LABEL : view.look ? FLAT_LABEL.replace(';', ', P looks around in it;') : FLAT_LABEL);
    this.around.pictures = [];
    this.asked = null;
    this.stage.settle();
  }

  /** The picture stands elsewhere, or something else of it is seen. */
  moved() {
    this.placeLine();
    if (this.stage.look && !this.turning) {
      this.turning = requestAnimationFrame(() => {
        this.turning = 0;
        this.seeAround();
      });
    }
  }

  /** Draws what is seen of a panorama. */
  seeAround() {
    const { look } = this.stage;
    const { now, other } = this.view;
    if (look) this.around.draw(look, this.otherWeights ? [now, other] : [now], this.wipe);
  }

  /** Share of the width at whose left the other mix is seen. */
  get wipe() {
    return Number(/** @type {HTMLInputElement} */ (byId('wipe')).value);
  }

  /** Something of a view has come, or was lost. @param {View} view */
  came(view) {
    if (view !== this.view) return;
    this.showDamage();
    this.request();
  }

  /** The weights of the view's columns under a mix. @param {Mix} mix */
  lighting(mix) {
    return this.desk.lighting(mix, this.view.head.lights, this.view.places);
  }

  /** @param {(mix: Mix) => void} change @param {boolean} isEnd */
  change(change, isEnd) {
    change(this.current);
    if (isEnd && JSON.stringify(this.lastKept) !== JSON.stringify(this.current)) {
      this.undone.push(this.lastKept);
      if (this.undone.length > MOST_UNDONE) this.undone.shift();
      this.lastKept = copyOf(this.current);
    }
    this.weights = null;
    this.mixer.refresh();
    this.request();
    this.link();
  }

  /** @param {Mix} mix */
  take(mix) {
    this.change(() => (this.current = copyOf(mix)), true);
  }

  undo() {
    const mix = this.undone.pop();
    if (!mix) return;
    this.lastKept = copyOf(mix);
    this.change(() => (this.current = copyOf(mix)), false);
  }

  fillControls() {
    const curve = byId('curve');
    curve.append(...CURVES.map((name, i) => make('option', { value: String(i) }, name)));
    if (this.views.length > 1) {
      byId('views').hidden = false;
      byId('views').append(...this.views.map(({ name }, i) => make('button', { type: 'button', onclick: () => this.show(i) }, name)));
    }
    const looks = byId('looks');
    const names = ["Scene's own", ...this.head.looks.map((look) => look.name)];
    const { width, height } = this.view.head.levels[1];
    /** @type {CanvasRenderingContext2D[]} */
    this.thumbs = names.map((name, i) => {
      const thumb = make('canvas', { width: THUMB_WIDTH, height: Math.round((THUMB_WIDTH * height) / width), 'aria-hidden': 'true' });
      looks.append(make('button', { type: 'button', onclick: () => this.take(this.desk.mixOf(i - 1)) }, thumb, make('span', {}, name)));
      return /** @type {CanvasRenderingContext2D} */ (thumb.getContext('2d'));
    });
    const compare = /** @type {HTMLSelectElement} */ (byId('compare'));
    compare.append(make('option', { value: '' }, 'Nothing'), ...names.map((name, i) => make('option', { value: String(i - 1) }, name)));
    this.showDisplay();
  }

  showDisplay() {
    /** @type {HTMLInputElement} */ (byId('exposure')).value = String(this.exposure);
    byId('exposure').setAttribute('aria-valuetext', `${signed(this.exposure)} stops`);
    byId('exposure-value').textContent = signed(this.exposure);
    /** @type {HTMLSelectElement} */ (byId('curve')).value = String(this.curve);
  }

  /** @param {number} exposure @param {number} curve */
  display(exposure, curve) {
    [this.exposure, this.curve] = [Math.min(Math.max(exposure, -60), 60), curve];
    this.view.isOtherOld = this.areThumbsOld = true;
    this.showDisplay();
    this.request();
    this.link();
  }

  listen() {
    const on = (/** @type {string} */ id, /** @type {string} */ event, /** @type {(input: HTMLInputElement) => void} */ act) =>
      byId(id).addEventListener(event, () => act(byId(id)));
    on('fit', 'click', () => this.stage.fit());
    on('one', 'click', () => this.stage.one());
    on('in', 'click', () => this.stage.zoom(Math.SQRT2));
    on('out', 'click', () => this.stage.zoom(Math.SQRT1_2));
    on('look', 'click', () => this.toggleLook());
    on('full', 'click', () => this.fullScreen());
    on('png', 'click', () => this.savePng());
    on('link', 'click', (button) => this.copyLink(button));
    on('exposure', 'input', (input) => this.display(Number(input.value), this.curve));
    on('exposure', 'dblclick', () => this.display(this.head.exposure, this.curve));
    on('curve', 'change', (input) => this.display(this.exposure, Number(input.value)));
    on('expose', 'click', () => this.expose());
    on('search', 'input', (input) => this.mixer.search(input.value));
    on('undo', 'click', () => this.undo());
    on('reset', 'click', () => this.take(this.desk.mixOf(-1)));
    on('keep', 'click', () => this.keep());
    on('compare', 'change', () => this.compare());
    on('wipe', 'input', () => this.compose());
    // The line can be pulled too.
    byId('line').addEventListener('pointerdown', (event) => {
      event.stopPropagation();
      byId('line').setPointerCapture(event.pointerId);
    });
    byId('line').addEventListener('pointermove', (event) => {
      if (!byId('line').hasPointerCapture(event.pointerId)) return;
      event.stopPropagation();
      const [left, width] = this.stage.span;
      const share = (this.stage.inside(event)[0] - left) / width;
      /** @type {HTMLInputElement} */ (byId('wipe')).value = String(share);
      this.compose();
    });
    window.addEventListener('hashchange', () => this.readFragment());
    document.addEventListener('keydown', (event) => this.key(event));
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const target = /** @type {HTMLElement} */ (event.target);
    if (event.altKey || event.metaKey || target.matches('input[type=search], select, [role=application]')) return;
    const compare = /** @type {HTMLSelectElement} */ (byId('compare'));
    /** @type {Record<string, () => void>} */
    const keys = {
      f: () => this.stage.fit(), F: () => this.fullScreen(), 1: () => this.stage.one(),
      '+': () => this.stage.zoom(Math.SQRT2), '=': () => this.stage.zoom(Math.SQRT2), '-': () => this.stage.zoom(Math.SQRT1_2),
      e: () => this.display(this.exposure + 0.5, this.curve), E: () => this.display(this.exposure - 0.5, this.curve),
      n: () => this.expose(), t: () => this.display(this.exposure, (this.curve + 1) % CURVES.length),
      p: () => this.toggleLook(), v: () => this.step(1), V: () => this.step(-1), k: () => this.keep(), '/': () => byId('search').focus(),
      w: () => {
        compare.value = compare.value === '' ? (this.kept ? 'kept' : '-1') : '';
        this.compare();
      },
    };
    const act = event.ctrlKey ? (event.key === 'z' ? () => this.undo() : null) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  keep() {
    this.kept = copyOf(this.current);
    const compare = /** @type {HTMLSelectElement} */ (byId('compare'));
    if (!compare.querySelector('[value=kept]')) compare.append(make('option', { value: 'kept' }, 'The mix that was kept'));
    compare.value = 'kept';
    this.compare();
  }

  compare() {
    const { value } = /** @type {HTMLSelectElement} */ (byId('compare'));
    const mix = value === '' ? null : value === 'kept' ? this.kept : this.desk.mixOf(Number(value));
    this.otherWeights = mix ? this.lighting(mix) : null;
    this.view.isOtherOld = true;
    byId('wipe-label').hidden = byId('line').hidden = !mix;
    this.placeLine();
    this.request();
  }

  placeLine() {
    const [left, width] = this.stage.span;
    byId('line').style.left = `${left + this.wipe * width - 1}px`;
  }

  toggleLook() {
    if (!this.view.look) return;
    this.lookAround(!this.view.isAround);
    this.link();
  }

  async expose() {
    this.display(await this.engine.exposureFor((this.weights ??= this.lighting(this.current))), this.curve);
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else byId('view').requestFullscreen?.();
  }

  savePng() {
    const canvas = this.view.now.canvas;
    canvas.toBlob((blob) => {
      if (!blob) return;
      const url = URL.createObjectURL(blob);
      make('a', { href: url, download: `${this.views.length > 1 ? this.view.name : this.head.title}.png` }).click();
      setTimeout(() => URL.revokeObjectURL(url), 10_000);
    }, 'image/png');
  }

  /** @param {HTMLElement} button */
  async copyLink(button) {
    await this.writeFragment();
    const done = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    button.textContent = done ? 'Copied' : 'In the address bar';
    setTimeout(() => (button.textContent = 'Copy link'), 2000);
  }

  link() {
    clearTimeout(this.linkTimer);
    this.linkTimer = window.setTimeout(() => this.writeFragment(), 400);
  }

  async writeFragment() {
    const view = this.views.length > 1 ? { view: this.views.indexOf(this.view) } : {};
    const { look, isAround } = this.view;
    const around = look ? { look: isAround ? look.degrees : null } : {};
    const state = { ...shortForm(this.desk, this.current), exposure: Number(this.exposure.toFixed(3)), curve: this.curve, ...view, ...around };
    this.fragment = await fragmentOf(state);
    history.replaceState(null, '', this.fragment);
  }

  /** Takes the mix of the link, if it has one that is understood. */
  async readFragment() {
    if (location.hash.length < 2 || location.hash === this.fragment) return;
    try {
      const state = await stateOf(location.hash);
      this.take(ofShortForm(this.desk, state));
      const curve = CURVES[state.curve] ? state.curve : 0;
      if (Number.isFinite(state.exposure)) this.display(state.exposure, curve);
      if (this.views[state.view] && this.views[state.view] !== this.view) this.show(state.view);
      const { look } = this.view;
      if (look && state.look !== undefined) {
        if (Array.isArray(state.look)) look.goTo(state.look);
        this.lookAround(state.look !== null);
      }
    } catch {
      this.say('the link holds no mix of this picture');
    }
  }

  request() {
    this.isWanted = true;
    document.body.dataset.drawing = 'yes';
    if (!this.isBusy) requestAnimationFrame(() => this.draw());
  }

  async draw() {
    if (this.isBusy || !this.isWanted) return;
    [this.isBusy, this.isWanted] = [true, false];
    try {
      await this.paint();
    } catch (error) {
      // A GPU that is lost may say so here before it does by itself: the workers take over.
      const { way } = this.engine;
      console.info(String(error));
      if (way === 'worker') {
        if (document.body.dataset.state !== 'failed') this.tell(`This mix could not be shown: ${error}.`);
        return;
      }
      if (way !== '') this.engine.fallBack(way);
      this.isWanted = true;
    } finally {
      this.isBusy = false;
    }
    document.body.dataset.drawing = this.isWanted ? 'yes' : 'no';
    this.showState();
    this.probe();
    if (this.isWanted) requestAnimationFrame(() => this.draw());
  }

  async paint() {
    const begun = performance.now();
    const { view, engine } = this;
    const tone = toneOf(this.curve, this.exposure);
    this.weights ??= this.lighting(this.current);
    const known = engine.isWhole(1) ? 'base' : engine.isWhole(0) ? 'preview' : 'loading';
    await engine.draw(view.now, this.weights, tone);
    if (view !== this.view) return;
    if (this.otherWeights && view.isOtherOld) {
      view.isOtherOld = false;
      await engine.draw(view.other, this.otherWeights, tone);
      if (view !== this.view) return;
    }
    this.around.pictures = [];
    this.compose();
    view.drawn = known;
    this.showState();
    document.body.dataset.ms = (performance.now() - begun).toFixed(1);
    document.body.dataset.pictures = String(Number(document.body.dataset.pictures ?? 0) + 1);
    if (this.areThumbsOld && engine.isWhole(0)) {
      this.areThumbsOld = false;
      for (const [i, thumb] of (this.thumbs ?? []).entries()) {
        await engine.drawSmall(thumb, this.lighting(this.desk.mixOf(i - 1)), tone);
        if (view !== this.view) return;
      }
    }
  }

  /** Puts the picture, and what it is compared with, where they are seen. */
  compose() {
    const { canvas } = this.shown;
    this.shown.clearRect(0, 0, canvas.width, canvas.height);
    this.shown.drawImage(this.view.now.canvas, 0, 0);
    this.seeAround();
    if (!this.otherWeights) return;
    const width = Math.round(canvas.width * this.wipe);
    if (width > 0) {
      this.shown.clearRect(0, 0, width, canvas.height);
      this.shown.drawImage(this.view.other.canvas, 0, 0, width, canvas.height, 0, 0, width, canvas.height);
    }
    this.placeLine();
  }

  async probe() {
    const at = this.asked;
    const output = byId('probe');
    if (!at || !this.weights) {
      output.textContent = '';
      return;
    }
    const { view } = this;
    const rgb = await this.engine.probe(at.x, at.y, this.weights);
    if (this.asked !== at || view !== this.view || !rgb) return;
    const bright = luminance(rgb);
    const lumens = view.head.lumensPerWatt;
    // A matt surface sends on at most what it gets: E ≥ π L.
    const unit = lumens ? `${short(bright * lumens)} cd/m²  ≥ ${short(bright * lumens * Math.PI)} lx` : `Y ${short(bright)}`;
    output.textContent = `${at.x}, ${at.y}   ${unit}\n${rgb.map(short).join('  ')}`;
  }

  /** @param {string} problem */
  tell(problem) {
    this.notice = problem;
    byId('damage').textContent = problem;
    byId('damage').hidden = false;
  }

  /** Says what is damaged of the view; of one without damage, what was told last. */
  showDamage() {
    if (document.body.dataset.state === 'failed') return;
    const list = Array.from(this.view.damage.values());
    const box = byId('damage');
    if (list.length === 0) {
      // What stands there already is not to be read aloud once more.
      if (box.textContent !== this.notice) box.textContent = this.notice;
      box.hidden = this.notice === '';
      return;
    }
    box.hidden = false;
    const shown = list.slice(0, 20).map((line) => make('li', {}, line));
    if (list.length > shown.length) shown.push(make('li', {}, `and ${list.length - shown.length} more`));
    box.replaceChildren(`The data are damaged: ${list.length} of their parts cannot be used. The rest is shown; where fine parts are missing, coarser.`, make('ul', {}, ...shown));
  }

  showState() {
    const { dataset } = document.body;
    if (dataset.state === 'failed') return;
    const isIdle = this.engine.atWork === 0;
    const { view } = this;
    const isDone = view.isComplete && isIdle && !this.isBusy && !this.isWanted;
    dataset.state = isDone ? (view.damage.size > 0 ? 'damaged' : 'complete') : view.drawn;
    const { width, height } = view.head.levels[1];
    const way = WAY_NAMES[/** @type {keyof typeof WAY_NAMES} */ (this.engine.way)] ?? '';
    if (isDone) this.say(`${width} × ${height} pixels, ${view.places.length} lights, by ${way}`);
    else this.say(`Loading, ${Math.round(100 * view.loaded)} %`);
    if (dataset.state !== this.lastState) performance.mark(`ltm-${dataset.state}`);
    this.lastState = dataset.state;
  }

  /** @param {string} text */
  say(text) {
    if (byId('status').textContent !== text) byId('status').textContent = text;
  }

  /** All of a view has come, or no more will. @param {View} view @param {string | null} problem */
  ended(view, problem) {
    if (problem !== null && this.views.length === 1) fail(problem);
    else if (problem !== null) this.tell(`No more of ${view.name} comes: ${problem}.`);
    else if (view === this.view) this.request();
  }
}

/** Says that there is no picture, or no more of it. @param {string} problem */
function fail(problem) {
  byId('damage').textContent = `The picture cannot be shown: ${problem}.`;
  byId('damage').hidden = false;
  byId('status').textContent = '';
  document.body.dataset.state = 'failed';
}

async function run() {
  const script = byId('script').textContent ?? '';
  const embedded = Array.from(document.querySelectorAll('script[type="application/vnd.ltm.share"]'));
  const fetched = Array.from(document.querySelectorAll('meta[name=ltm-data]'));
  const sources = embedded.length > 0
    ? embedded.map((own) => ({ own, bytes: new EmbeddedBytes(own.textContent ?? '') }))
    : fetched.map((own) => ({ own, bytes: new FetchedBytes(own.getAttribute('content') ?? '') }));
  /** @type {Page | null} */
  let page = null;
  /** @param {unknown} error */
  const none = (error) => {
    fail(error instanceof Error ? error.message : String(error));
    const hint = embedded.length === 0 && location.protocol === 'file:' ? ' A page in a folder needs a server; one made with --single does not.' : '';
    byId('damage').append(hint);
  };
  try {
    const opened = await Promise.allSettled(sources.map(({ own, bytes }) => openView(own.getAttribute('data-view') ?? '', bytes, {
      came: (view) => page?.came(view),
      progressed: (view) => {
        if (page && view === page.view) page.showState();
      },
      ended: (view, problem) => page?.ended(view, problem),
    })));
    const views = opened.flatMap((one) => (one.status === 'fulfilled' ? [one.value] : []));
    const [lost] = opened.flatMap((one) => (one.status === 'rejected' ? [one.reason] : []));
    if (views.length === 0) throw lost;
    page = new Page(views, script);
    if (lost) page.tell(`A view cannot be shown: ${lost instanceof Error ? lost.message : lost}.`);
    page.readFragment();
  } catch (error) {
    none(error);
  }
}

if (typeof document === 'undefined') serve(/** @type {any} */ (globalThis));
else run();
