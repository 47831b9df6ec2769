// What is on each light, and the lighting that this makes: the twin of tools/view/src/mixer.rs, with the same numbers.

/** @import { Head, Light } from './stream.js' */
/** @import { Rgb } from './colour.js' */
import { kelvinOf, kelvinToLinear, luminance } from './colour.js';

/** How far a light can be taken up or down, in stops. */
export const MOST_STOPS = 8;
const SAME_COLOUR = 1e-5;
const UNITS = [0, 1, 2];

/**
 * Colour of a light: as in the scene (null), of a black body, or linear Rec. 709, whose brightness does not count.
 * @typedef {null | { kelvin: number } | { rgb: Rgb }} Tint
 * `pattern`: what the texels are multiplied by, three values each; `turn`: how far an environment is turned to the right, in degrees.
 * @typedef {{ on: boolean, solo: boolean, stops: number, tint: Tint, pattern: Float32Array | null, turn: number }} LightMix
 * @typedef {{ on: boolean, stops: number }} GroupMix
 * @typedef {{ lights: LightMix[], groups: GroupMix[] }} Mix
 */

/** The lights of a head with their groups, as a mix needs them. */
export class Desk {
  /** @param {Head} head */
  constructor(head) {
    this.head = head;
    this.lights = head.lights;
    /** @type {{ name: string, lights: number[] }[]} */
    this.groups = head.groups.concat(stemGroups(head)).filter((group) => group.lights.length > 0);
    /** @type {number[]} group of each light, -1 for none */
    this.groupOf = head.lights.map((_, light) => this.groups.findIndex((group) => group.lights.includes(light)));
  }

  /** The weights of each light in a look: -1 is the scene's own lighting. @param {number} look @param {number} light */
  weightsOf(look, light) {
    const { across, down, scene } = this.lights[light];
    const weights = (look >= 0 ? this.head.looks[look].lights[light] : null) ?? scene;
    return weights.length === 1 ? Array(across * down).fill(weights[0]) : weights;
  }

  /** @param {number} look @returns {Mix} */
  mixOf(look) {
    return {
      lights: this.lights.map((light, i) => ofWeights(light, this.weightsOf(look, i))),
      groups: this.groups.map(() => ({ on: true, stops: 0 })),
    };
  }

  /** @param {Mix} mix @param {number} light */
  shines(mix, light) {
    const own = mix.lights[light];
    const group = mix.groups[this.groupOf[light]];
    return own.on && (!group || group.on) && (own.solo || !mix.lights.some((other) => other.solo));
  }

  /**
   * The weights of all columns of a view times their scales, three planes: what its factors are multiplied by.
   * @param {Mix} mix
   * @param {Light[]} lights the view's
   * @param {number[]} places of each of them among the desk's
   */
  lighting(mix, lights, places) {
    const columns = lights.reduce((sum, light) => sum + light.across * light.down, 0);
    const weights = new Float32Array(3 * columns);
    let first = 0;
    lights.forEach((light, i) => {
      const texels = light.across * light.down;
      const at = first;
      first += texels;
      if (!this.shines(mix, places[i])) return;
      const own = mix.lights[places[i]];
      const gain = 2 ** (own.stops + (mix.groups[this.groupOf[places[i]]]?.stops ?? 0));
      const colour = colourOf(light, own.tint).map((v) => v * gain * light.scale);
      const pattern = own.pattern && turned(light, own.pattern, own.turn);
      for (let texel = 0; texel < texels; texel++) {
        for (const ch of UNITS) weights[ch * columns + at + texel] = colour[ch] * (pattern ? pattern[3 * texel + ch] : 1);
      }
    });
    return weights;
  }
}

/**
 * The lights, groups and looks of several views of one scene, as of one head; and the place of each view's lights among them. A light is
 * one with another view's if name, texels and unit are the same; else the view's name stands behind its own.
 * @param {{ name: string, head: Head }[]} views
 * @returns {{ all: Head, places: number[][] }}
 */
export function unionOf(views) {
  /** @type {Head} */
  const all = { ...views[0].head, lights: [], groups: [], looks: [] };
  const places = views.map(({ name, head }) => head.lights.map((light) => {
    const isSame = (/** @type {Light} */ other) => other.across === light.across && other.down === light.down && other.unit === light.unit;
    const found = all.lights.findIndex((other) => other.name === light.name);
    if (found >= 0 && isSame(all.lights[found])) return found;
    const own = found < 0 ? light.name : `${light.name} (${name})`;
    const again = all.lights.findIndex((other) => other.name === own);
    if (again >= 0 && isSame(all.lights[again])) return again;
    return all.lights.push({ ...light, name: own }) - 1;
  }));
  views.forEach(({ head }, view) => {
    for (const { name, lights } of head.groups) {
      const group = all.groups.find((other) => other.name === name) ?? all.groups[all.groups.push({ name, lights: [] }) - 1];
      const isFree = (/** @type {number} */ light) => all.groups.every((other) => !other.lights.includes(light));
      group.lights.push(...lights.map((light) => places[view][light]).filter(isFree));
    }
    for (const { name, lights } of head.looks) {
      const look = all.looks.find((other) => other.name === name) ?? all.looks[all.looks.push({ name, lights: [] }) - 1];
      lights.forEach((weights, light) => (look.lights[places[view][light]] ??= weights));
    }
  });
  return { all, places };
}

/**
 * The part of a name that its group shares: what stands before the last `/` or `:`, or before a final number.
 * @param {string} name
 */
function stemOf(name) {
  const at = Math.max(name.lastIndexOf('/'), name.lastIndexOf(':'));
  if (at >= 0) return name.slice(0, at);
  const plain = name.replace(/[0-9]+$/, '');
  return plain === name ? '' : plain.replace(/[._\- #]+$/, '');
}

/** Lights of no other group whose names differ in their last part only. @param {Head} head */
function stemGroups(head) {
  /** @type {Map<string, number[]>} */
  const byStem = new Map();
  head.lights.forEach(({ name }, light) => {
    const stem = stemOf(name);
    if (stem === '' || head.groups.some((group) => group.lights.includes(light))) return;
    byStem.set(stem, [...(byStem.get(stem) ?? []), light]);
  });
  return Array.from(byStem, ([name, lights]) => ({ name, lights })).filter((group) => group.lights.length > 1);
}

/** Weight of a texel with pattern 1, were the light on. @param {Light} light @param {Tint} tint @returns {number[]} */
export function colourOf(light, tint) {
  const ofScene = luminance(light.emission) === 0 ? [1, 1, 1] : light.emission;
  if (!tint) return ofScene;
  const colour = 'kelvin' in tint ? kelvinToLinear(tint.kelvin) : tint.rgb;
  const own = luminance(colour);
  return UNITS.map((ch) => (own <= 0 ? 0 : (colour[ch] / own) * luminance(ofScene)));
}

/**
 * What gives a light these weights: one weight on all texels becomes stops and a tint, others a pattern.
 * @param {Light} light
 * @param {number[][]} weights
 * @returns {LightMix}
 */
function ofWeights(light, weights) {
  /** @type {LightMix} */
  const mix = { on: true, solo: false, stops: 0, tint: null, pattern: null, turn: 0 };
  if (weights.every((weight) => weight.every((v) => v === 0))) return { ...mix, on: false };
  const base = colourOf(light, null);
  const [first] = weights;
  const isEven = weights.every((weight) => UNITS.every((ch) => weight[ch] === first[ch]));
  const stops = Math.log2(luminance(first) / luminance(base));
  if (isEven && first.every((v) => v >= 0) && Math.abs(stops) <= MOST_STOPS) {
    const peak = Math.max(...first);
    const kelvin = kelvinOf(first);
    /** @type {Tint[]} */
    const tints = [null, { kelvin: Math.round(kelvin) }, { kelvin }];
    const isNear = (/** @type {Tint} */ tint) =>
      colourOf(light, tint).every((v, ch) => Math.abs(v * 2 ** stops - first[ch]) <= SAME_COLOUR * peak);
    const near = tints.findIndex(isNear);
    const rgb = /** @type {Rgb} */ (first.map((v) => v / peak));
    return { ...mix, stops: Math.abs(stops) < 1e-6 ? 0 : stops, tint: near >= 0 ? tints[near] : { rgb } };
  }
  // A channel that the scene's colour lacks could not be multiplied up from it.
  /** @type {Tint} */
  const tint = base.every((v) => v > 0) ? null : { rgb: [1, 1, 1] };
  const over = colourOf(light, tint);
  const pattern = Float32Array.from(weights.flatMap((weight) => UNITS.map((ch) => weight[ch] / over[ch])));
  return { ...mix, tint, pattern };
}

/**
 * The pattern of an environment turned about the vertical; that of other lights as it is.
 * @param {Light} light
 * @param {Float32Array} pattern
 * @param {number} degrees
 */
export function turned({ kind, across, down }, pattern, degrees) {
  if (degrees === 0 || (kind !== 'lat-long' && kind !== 'octahedral')) return pattern;
  const out = new Float32Array(pattern.length);
  if (kind === 'lat-long') {
    const columns = (((degrees / 360) * across) % across + across) % across;
    const [whole, part] = [Math.floor(columns), columns % 1];
    for (let row = 0; row < down; row++) {
      for (let column = 0; column < across; column++) {
        const here = 3 * (row * across + ((column + across - whole) % across));
        const left = 3 * (row * across + ((column + 2 * across - whole - 1) % across));
        const at = 3 * (row * across + column);
        for (const ch of UNITS) out[at + ch] = pattern[here + ch] * (1 - part) + pattern[left + ch] * part;
      }
    }
    return out;
  }
  const CUTS = 4;
  const [sin, cos] = [Math.sin((-degrees * Math.PI) / 180), Math.cos((-degrees * Math.PI) / 180)];
  for (let texel = 0; texel < across * down; texel++) {
    for (let cut = 0; cut < CUTS * CUTS; cut++) {
      const x = (texel % across) + ((cut % CUTS) + 0.5) / CUTS;
      const y = Math.floor(texel / across) + (Math.floor(cut / CUTS) + 0.5) / CUTS;
      const [dx, dy, dz] = fromSquare(x / across, y / down);
      const [u, v] = toSquare(dx * cos - dz * sin, dy, dz * cos + dx * sin);
      const column = Math.min(Math.floor(u * across), across - 1);
      const from = 3 * (Math.min(Math.floor(v * down), down - 1) * across + column);
      for (const ch of UNITS) out[3 * texel + ch] += pattern[from + ch] / (CUTS * CUTS);
    }
  }
  return out;
}

/** The equal-area octahedral map, as src/light/environment.rs has it. @param {number} x @param {number} y @param {number} z */
function toSquare(x, y, z) {
  const radius = Math.min(Math.sqrt((x * x + z * z) / (1 + Math.abs(y))), 1);
  const minor = (radius * Math.atan2(Math.abs(z), Math.abs(x))) / (Math.PI / 2);
  const major = radius - minor;
  const [u, v] = y < 0 ? [1 - minor, 1 - major] : [major, minor];
  return [0.5 + 0.5 * (x < 0 ? -u : u), 0.5 + 0.5 * (z < 0 ? -v : v)];
}

/** @param {number} across @param {number} down */
function fromSquare(across, down) {
  const [u, v] = [2 * across - 1, 2 * down - 1];
  const above = 1 - (Math.abs(u) + Math.abs(v));
  const radius = 1 - Math.abs(above);
  const turn = radius === 0 ? 0 : (((Math.abs(v) - Math.abs(u)) / radius + 1) * Math.PI) / 4;
  const ring = radius * Math.sqrt(Math.max(2 - radius * radius, 0));
  return [Math.cos(turn) * ring * (u < 0 ? -1 : 1), (1 - radius * radius) * (above < 0 ? -1 : 1), Math.sin(turn) * ring * (v < 0 ? -1 : 1)];
}

/** @param {Mix} mix @returns {Mix} */
export function copyOf(mix) {
  return { lights: mix.lights.map((light) => ({ ...light })), groups: mix.groups.map((group) => ({ ...group })) };
}

/**
 * A short form of what a mix changes in the scene's, for a link. Patterns are kept to one part in 255 of the square root of their
 * largest value.
 * @param {Desk} desk
 * @param {Mix} mix
 */
export function shortForm(desk, mix) {
  const scene = desk.mixOf(-1);
  /** @type {Record<string, any>} */
  const lights = {};
  mix.lights.forEach((own, i) => {
    const was = scene.lights[i];
    /** @type {Record<string, any>} */
    const said = {};
    if (own.on !== was.on) said.on = Number(own.on);
    if (own.solo) said.solo = 1;
    if (own.stops !== was.stops) said.stops = Number(own.stops.toFixed(4));
    if (JSON.stringify(own.tint) !== JSON.stringify(was.tint)) said.tint = own.tint;
    if (own.turn !== was.turn) said.turn = own.turn;
    const isSame = own.pattern?.length === was.pattern?.length && (own.pattern ?? []).every((v, at) => v === was.pattern?.[at]);
    if (!isSame) said.pattern = own.pattern ? packed(own.pattern) : null;
    if (Object.keys(said).length > 0) lights[i] = said;
  });
  const groups = Object.fromEntries(Object.entries(mix.groups).filter(([, group]) => !group.on || group.stops !== 0));
  return { lights, groups };
}

/**
 * The mix that a short form says; what it says of lights that are not there is passed over.
 * @param {Desk} desk
 * @param {any} form
 */
export function ofShortForm(desk, form) {
  const mix = desk.mixOf(-1);
  const finite = (/** @type {any} */ value, /** @type {number} */ most) =>
    typeof value === 'number' && Number.isFinite(value) ? Math.min(Math.max(value, -most), most) : 0;
  for (const [index, said] of Object.entries(form?.lights ?? {})) {
    const own = mix.lights[Number(index)];
    const light = desk.lights[Number(index)];
    if (!own || typeof said !== 'object' || !said) continue;
    if ('on' in said) own.on = Boolean(said.on);
    own.solo = Boolean(said.solo);
    if ('stops' in said) own.stops = finite(said.stops, MOST_STOPS);
    if ('turn' in said) own.turn = finite(said.turn, 360);
    if ('tint' in said) own.tint = tintOf(said.tint);
    if ('pattern' in said) own.pattern = said.pattern ? unpacked(said.pattern, 3 * light.across * light.down) : null;
  }
  for (const [index, said] of Object.entries(form?.groups ?? {})) {
    if (mix.groups[Number(index)]) mix.groups[Number(index)] = { on: Boolean(said?.on), stops: finite(said?.stops, MOST_STOPS) };
  }
  return mix;
}

/** @param {any} tint @returns {Tint} */
function tintOf(tint) {
  const isNumber = (/** @type {any} */ v) => typeof v === 'number' && Number.isFinite(v);
  if (isNumber(tint?.kelvin)) return { kelvin: tint.kelvin };
  return Array.isArray(tint?.rgb) && tint.rgb.length === 3 && tint.rgb.every(isNumber) ? { rgb: tint.rgb } : null;
}

/** @param {Float32Array} pattern */
function packed(pattern) {
  const peak = pattern.reduce((a, b) => Math.max(a, b), 0);
  const bytes = Array.from(pattern, (v) => String.fromCharCode(Math.round(255 * Math.sqrt(Math.max(v, 0) / (peak || 1)))));
  return { peak, texels: btoa(bytes.join('')) };
}

/** @param {any} form @param {number} length */
function unpacked(form, length) {
  const bytes = atob(String(form.texels));
  const peak = Number(form.peak);
  if (bytes.length !== length || !Number.isFinite(peak)) return null;
  return Float32Array.from(bytes, (sign) => (sign.charCodeAt(0) / 255) ** 2 * peak);
}
