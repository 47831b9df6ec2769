// The list of lights: switches, faders, colours, texels; groups and search.

/** @import { Light } from './stream.js' */
/** @import { LightMix, Mix, Desk } from './mix.js' */
import { hexOf, kelvinOf, linearOfHex } from './colour.js';
import { MOST_STOPS, colourOf, turned } from './mix.js';

/**
 * An element with properties and children.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, any>} [properties]
 * @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (name in element && !name.includes('-')) /** @type {any} */ (element)[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** @param {number} value */
export function signed(value) {
  return (value >= 0.005 ? '+' : value <= -0.005 ? '−' : '') + Math.abs(value).toFixed(2);
}

/** The panel of lights. */
export class Mixer {
  /**
   * @param {HTMLElement} list
   * @param {Desk} desk
   * @param {() => Mix} mix the present one
   * @param {(change: (mix: Mix) => void, isEnd: boolean) => void} change makes a change; `isEnd`: it is one step of undoing
   */
  constructor(list, desk, mix, change) {
    this.desk = desk;
    this.mix = mix;
    this.change = change;
    /** @type {(() => void)[]} */
    this.refreshers = [];
    /** @type {{ row: HTMLElement, text: string }[]} */
    this.rows = [];
    /** @type {{ head: HTMLElement, lights: number[], list: HTMLElement, isFolded: boolean }[]} */
    this.heads = [];
    /** Places of the lights that are listed: those of the view that is seen. @type {Set<number>} */
    this.present = new Set(desk.lights.keys());
    this.words = '';
    const placed = new Set();
    desk.lights.forEach((_, light) => {
      const group = desk.groupOf[light];
      if (group < 0) list.append(this.lightRow(light));
      else if (!placed.has(group)) list.append(this.groupRow(group));
      placed.add(group);
    });
    this.refresh();
  }

  /** Brings every control to the present mix. */
  refresh() {
    this.refreshers.forEach((refresh) => refresh());
  }

  /** Shows the lights whose name or kind holds every word. @param {string} words */
  search(words) {
    this.words = words;
    const wanted = words.toLowerCase().split(/\s+/).filter((word) => word !== '');
    const isShown = (/** @type {number} */ light) => this.present.has(light) && wanted.every((word) => this.rows[light].text.includes(word));
    this.rows.forEach((row, light) => (row.row.hidden = !isShown(light)));
    this.heads.forEach(({ head, lights, list, isFolded }) => {
      head.hidden = !lights.some(isShown);
      list.hidden = isFolded && wanted.length === 0;
    });
  }

  /** Lists these lights alone. @param {number[]} places */
  list(places) {
    this.present = new Set(places);
    this.search(this.words);
  }

  /** A button that is pressed or not. @param {string} label @param {string} sign @param {() => boolean} state @param {() => void} press */
  toggle(label, sign, state, press) {
    const button = make('button', { type: 'button', 'aria-label': label, title: label, onclick: press }, sign);
    this.refreshers.push(() => button.setAttribute('aria-pressed', String(state())));
    return button;
  }

  /** @param {string} label @param {() => number} stops @param {(mix: Mix, stops: number) => void} set */
  fader(label, stops, set) {
    const value = make('output');
    const range = make('input', { type: 'range', min: -MOST_STOPS, max: MOST_STOPS, step: 0.05, 'aria-label': `${label}, stops` });
    range.addEventListener('input', () => this.change((mix) => set(mix, Number(range.value)), false));
    range.addEventListener('change', () => this.change(() => {}, true));
    range.addEventListener('dblclick', () => this.change((mix) => set(mix, 0), true));
    this.refreshers.push(() => {
      if (Number(range.value) !== stops()) range.value = String(stops());
      value.textContent = signed(stops());
      range.setAttribute('aria-valuetext', `${signed(stops())} stops`);
    });
    return make('div', { className: 'fader' }, range, value);
  }

  /** @param {number} group */
  groupRow(group) {
    const { name, lights } = this.desk.groups[group];
    const own = () => this.mix().groups[group];
    const inside = make('ul', { 'aria-label': name }, ...lights.map((light) => this.lightRow(light)));
    const entry = { head: /** @type {HTMLElement} */ (inside), lights, list: inside, isFolded: false };
    const fold = make('button', { type: 'button', 'aria-label': `Lights of ${name}`, 'aria-expanded': 'true' }, '▾');
    fold.addEventListener('click', () => {
      entry.isFolded = !entry.isFolded;
      inside.hidden = entry.isFolded;
      fold.textContent = entry.isFolded ? '▸' : '▾';
      fold.setAttribute('aria-expanded', String(!entry.isFolded));
    });
    const row = make('div', { className: 'light', role: 'group', 'aria-label': `Group ${name}` },
      this.toggle(`On: group ${name}`, 'On', () => own().on, () => this.change((mix) => (mix.groups[group].on = !own().on), true)),
      make('strong', { className: 'name', title: name }, name), make('span'), fold,
      this.fader(`Group ${name}`, () => own().stops, (mix, stops) => (mix.groups[group].stops = stops)));
    entry.head = make('li', {}, row, inside);
    this.heads.push(entry);
    return entry.head;
  }

  /** @param {number} index */
  lightRow(index) {
    const light = this.desk.lights[index];
    const { name } = light;
    const own = () => this.mix().lights[index];
    const set = (/** @type {Partial<LightMix>} */ part, isEnd = true) =>
      this.change((mix) => Object.assign(mix.lights[index], part), isEnd);
    const more = make('div', { className: 'more', hidden: true });
    const swatch = make('button', { type: 'button', className: 'swatch', 'aria-label': `Colour of ${name}`, 'aria-expanded': 'false' });
    swatch.addEventListener('click', () => {
      if (!more.hasChildNodes()) this.fillMore(more, light, own, set);
      more.hidden = !more.hidden;
      swatch.setAttribute('aria-expanded', String(!more.hidden));
    });
    this.refreshers.push(() => swatch.style.setProperty('--swatch', hexOf(colourOf(light, own().tint))));
    const solo = (/** @type {MouseEvent} */ event) => this.change((mix) => toggleSolo(mix, index, event.shiftKey), true);
    const row = make('li', { className: 'light' },
      this.toggle(`On: ${name}`, 'On', () => own().on, () => set({ on: !own().on })),
      make('span', { className: 'name', title: name }, name), swatch,
      this.toggle(`Solo ${name}`, 'Solo', () => own().solo, () => {}),
      this.fader(name, () => own().stops, (mix, stops) => (mix.lights[index].stops = stops)), more);
    /** @type {HTMLButtonElement} */ (row.children[3]).addEventListener('click', solo);
    this.rows[index] = { row, text: `${name} ${light.kind}`.toLowerCase() };
    return row;
  }

  /**
   * Colour, turning and texels of a light.
   * @param {HTMLElement} more
   * @param {Light} light
   * @param {() => LightMix} own
   * @param {(part: Partial<LightMix>, isEnd?: boolean) => void} set
   */
  fillMore(more, light, own, set) {
    const { name } = light;
    const now = () => colourOf(light, own().tint);
    const kelvin = make('input', { type: 'range', min: 1670, max: 12000, step: 10, 'aria-label': `${name}, kelvin` });
    const said = make('output');
    const picker = make('input', { type: 'color', 'aria-label': `${name}, colour` });
    const kind = make('select', { 'aria-label': `${name}, kind of colour` },
      ...[['scene', "Scene's colour"], ['kelvin', 'Black body'], ['rgb', 'Colour']].map(([value, text]) => make('option', { value }, text)));
    kind.addEventListener('change', () => {
      const rgb = /** @type {[number, number, number]} */ (linearOfHex(hexOf(now())));
      set({ tint: kind.value === 'scene' ? null : kind.value === 'kelvin' ? { kelvin: Math.round(kelvinOf(now())) } : { rgb } });
    });
    kelvin.addEventListener('input', () => set({ tint: { kelvin: Number(kelvin.value) } }, false));
    picker.addEventListener('input', () => set({ tint: { rgb: linearOfHex(picker.value) } }, false));
    [kelvin, picker].forEach((input) => input.addEventListener('change', () => set({})));
    const kelvinRow = make('div', { className: 'row' }, kelvin, said);
    const refresh = () => {
      const { tint } = own();
      kind.value = !tint ? 'scene' : 'kelvin' in tint ? 'kelvin' : 'rgb';
      kelvinRow.hidden = kind.value !== 'kelvin';
      picker.hidden = kind.value !== 'rgb';
      if (tint && 'kelvin' in tint) kelvin.value = String(tint.kelvin);
      said.textContent = `${kelvin.value} K`;
      picker.value = hexOf(now());
    };
    this.refreshers.push(refresh);
    more.append(make('div', { className: 'row' }, kind, picker), kelvinRow);
    if (light.kind === 'lat-long' || light.kind === 'octahedral') {
      const turn = make('input', { type: 'range', min: -180, max: 180, step: 1, 'aria-label': `${name}, turned, degrees` });
      const degrees = make('output');
      turn.addEventListener('input', () => set({ turn: Number(turn.value) }, false));
      turn.addEventListener('change', () => set({}));
      this.refreshers.push(() => {
        turn.value = String(own().turn);
        degrees.textContent = `${own().turn}°`;
      });
      more.append(make('div', { className: 'row' }, 'Turn', turn, degrees));
    }
    if (light.across * light.down > 1) this.texels(more, light, own, set);
    this.refresh();
  }

  /**
   * A surface to paint on.
   * @param {HTMLElement} more
   * @param {Light} light
   * @param {() => LightMix} own
   * @param {(part: Partial<LightMix>, isEnd?: boolean) => void} set
   */
  texels(more, light, own, set) {
    const { name, across, down } = light;
    const canvas = make('canvas', {
      className: 'texels', width: across, height: down, tabIndex: 0, role: 'application',
      'aria-label': `${name}, ${across} by ${down} texels: arrow keys move, Space paints`,
    });
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
    const level = make('input', { type: 'range', min: 0, max: 2, step: 0.05, value: '0', 'aria-label': `${name}, brightness of the brush` });
    const colour = make('input', { type: 'color', value: '#ffffff', 'aria-label': `${name}, colour of the brush` });
    const radius = make('input', { type: 'range', min: 0.5, max: Math.max(2, across / 4), step: 0.5, value: '1', 'aria-label': `${name}, radius of the brush` });
    const cursor = { x: Math.floor(across / 2), y: Math.floor(down / 2) };
    const paint = (/** @type {number} */ x, /** @type {number} */ y, /** @type {boolean} */ isEnd) => {
      const ink = linearOfHex(colour.value).map((v) => v * Number(level.value));
      // One paints on what one sees: the pattern as it is turned.
      const { pattern: before, turn } = own();
      const pattern = before ? turned(light, before, turn).slice() : new Float32Array(3 * across * down).fill(1);
      const reach = Number(radius.value);
      for (let row = 0; row < down; row++) {
        for (let column = 0; column < across; column++) {
          const isAt = column === Math.floor(x) && row === Math.floor(y);
          if (isAt || Math.hypot(column + 0.5 - x, row + 0.5 - y) < reach) pattern.set(ink, 3 * (row * across + column));
        }
      }
      set({ pattern, turn: 0 }, isEnd);
    };
    const at = (/** @type {PointerEvent} */ event) => {
      const box = canvas.getBoundingClientRect();
      return [((event.clientX - box.left) / box.width) * across, ((event.clientY - box.top) / box.height) * down];
    };
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      const [x, y] = at(event);
      paint(x, y, false);
    });
    canvas.addEventListener('pointermove', (event) => {
      const [x, y] = at(event);
      if (event.buttons === 1) paint(x, y, false);
    });
    canvas.addEventListener('pointerup', () => set({}));
    canvas.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (step) {
        cursor.x = Math.min(Math.max(cursor.x + step[0], 0), across - 1);
        cursor.y = Math.min(Math.max(cursor.y + step[1], 0), down - 1);
        show();
      } else if (event.key === ' ') {
        paint(cursor.x + 0.5, cursor.y + 0.5, true);
      } else {
        return;
      }
      event.preventDefault();
      event.stopPropagation();
    });
    const show = () => {
      const { pattern, turn, tint } = own();
      const base = colourOf(light, tint);
      const texels = pattern && turned(light, pattern, turn);
      const peak = texels ? texels.reduce((a, b) => Math.max(a, b), 1e-9) : 1;
      const image = context.createImageData(across, down);
      const top = Math.max(...base);
      for (let i = 0; i < across * down; i++) {
        for (let ch = 0; ch < 3; ch++) {
          const value = ((texels ? texels[3 * i + ch] / peak : 1) * base[ch]) / top;
          image.data[4 * i + ch] = 255 * Math.max(value, 0) ** (1 / 2.2);
        }
        image.data[4 * i + 3] = 255;
      }
      context.putImageData(image, 0, 0);
      if (document.activeElement === canvas) {
        context.fillStyle = '#ff3080';
        context.fillRect(cursor.x, cursor.y, 1, 1);
      }
    };
    canvas.addEventListener('focus', show);
    canvas.addEventListener('blur', show);
    this.refreshers.push(show);
    const filled = (/** @type {number} */ value) => set({ pattern: value === 1 ? null : new Float32Array(3 * across * down).fill(value) });
    more.append(canvas,
      make('div', { className: 'row' }, 'Brush', level, colour),
      make('div', { className: 'row' }, 'Radius', radius,
        make('button', { type: 'button', onclick: () => filled(0), 'aria-label': `${name}: all texels dark` }, 'Clear'),
        make('button', { type: 'button', onclick: () => filled(1), 'aria-label': `${name}: all texels lit` }, 'Fill')));
  }
}

/** Solo on one light alone; `add` leaves the others' as it is. @param {Mix} mix @param {number} light @param {boolean} add */
function toggleSolo(mix, light, add) {
  const was = mix.lights[light].solo;
  const others = mix.lights.some((own, i) => own.solo && i !== light);
  if (!add) mix.lights.forEach((own) => (own.solo = false));
  mix.lights[light].solo = add ? !was : !was || others;
}
