// Colours: the twins of src/image/kelvin.rs, src/image/tone.rs and src/image/tone_tables.rs.

/** @typedef {[number, number, number]} Rgb */
/**
 * How radiance is shown. `curve`: 0 none, 1 AgX, 2 filmic, 3 neutral, 4 false colour from `lowStops` over `rangeStops`.
 * @typedef {{ gain: Rgb, curve: number, lowStops: number, rangeStops: number }} Tone
 */

/** Names of the curves, by their number. */
export const CURVES = ['sRGB', 'AgX', 'Filmic', 'Neutral', 'False colour'];
export const FALSE_COLOUR = 4;
/** Stops below and above 1, after exposure, that false colours cover. */
export const STOPS_SHOWN = [-10, 6];
export const KELVIN_RANGE = [1667, 25000];

/** @param {ArrayLike<number>} rgb */
export function luminance(rgb) {
  return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/**
 * Linear Rec. 709 colour of a black body, of luminance 1.
 * @param {number} kelvin
 * @returns {Rgb}
 */
export function kelvinToLinear(kelvin) {
  const t = Math.min(Math.max(kelvin, KELVIN_RANGE[0]), KELVIN_RANGE[1]);
  const u = 1e3 / t;
  const x = t <= 4000
    ? -0.2661239 * u ** 3 - 0.2343589 * u ** 2 + 0.8776956 * u + 0.17991
    : -3.0258469 * u ** 3 + 2.1070379 * u ** 2 + 0.2226347 * u + 0.24039;
  const y = t <= 2222
    ? -1.1063814 * x ** 3 - 1.3481102 * x ** 2 + 2.18555832 * x - 0.20219683
    : t <= 4000
      ? -0.9549476 * x ** 3 - 1.37418593 * x ** 2 + 2.09137015 * x - 0.16748867
      : 3.081758 * x ** 3 - 5.8733867 * x ** 2 + 3.75112997 * x - 0.37001483;
  const [cx, cz] = [x / y, (1 - x - y) / y];
  const rgb = [
    3.2404542 * cx - 1.5371385 - 0.4985314 * cz,
    -0.969266 * cx + 1.8760108 + 0.041556 * cz,
    0.0556434 * cx - 0.2040259 + 1.0572252 * cz,
  ].map((v) => Math.max(v, 0));
  const level = luminance(rgb);
  return /** @type {Rgb} */ (rgb.map((v) => v / level));
}

/**
 * Temperature of the black body that has the same ratio of red to blue.
 * @param {ArrayLike<number>} rgb
 */
export function kelvinOf(rgb) {
  let [low, high] = KELVIN_RANGE;
  for (let i = 0; i < 40; i++) {
    const middle = 0.5 * (low + high);
    const [r, , b] = kelvinToLinear(middle);
    if (r * rgb[2] > b * rgb[0]) low = middle;
    else high = middle;
  }
  return 0.5 * (low + high);
}

/** @param {number} linear */
export function encodeSrgb(linear) {
  const v = Math.min(Math.max(linear, 0), 1);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
}

/** @param {number} encoded */
export function decodeSrgb(encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : ((encoded + 0.055) / 1.055) ** 2.4;
}

/**
 * What a colour input shows for a linear colour: its largest channel at 1.
 * @param {ArrayLike<number>} rgb
 */
export function hexOf(rgb) {
  const peak = Math.max(rgb[0], rgb[1], rgb[2], 1e-12);
  return '#' + Array.from(rgb, (v) => Math.round(255 * encodeSrgb(v / peak)).toString(16).padStart(2, '0')).join('');
}

/**
 * @param {string} hex
 * @returns {Rgb}
 */
export function linearOfHex(hex) {
  return /** @type {Rgb} */ ([1, 3, 5].map((at) => decodeSrgb(parseInt(hex.slice(at, at + 2), 16) / 255)));
}

/**
 * @param {number} curve
 * @param {number} exposure in stops
 * @returns {Tone}
 */
export function toneOf(curve, exposure) {
  const gain = 2 ** exposure;
  const lowStops = STOPS_SHOWN[0] - exposure;
  return { gain: [gain, gain, gain], curve, lowStops, rangeStops: STOPS_SHOWN[1] - STOPS_SHOWN[0] };
}

const SRGB_STEPS = 1 << 14;
const SRGB_TABLE = Uint8Array.from({ length: SRGB_STEPS + 1 }, (_, i) => encodeSrgb(i / SRGB_STEPS) * 255 + 0.5);
/** AgX is flat below 2⁻¹³ and above 2⁵; ten bits of the mantissa count between them. */
const AGX_FIRST = (-13 + 127) << 10;
const AGX_TABLE = Float32Array.from({ length: 18 << 10 }, (_, i) => {
  const middle = 2 ** (-13 + (i >> 10)) * (1 + ((i & 1023) + 0.5) / 1024);
  const x = (Math.min(Math.max(Math.log2(middle), -12.47393), 4.026069) + 12.47393) / (4.026069 + 12.47393);
  return [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232].reduce((sum, term) => sum * x + term, 0);
});
const FALSE_COLOURS = [0, 0, 0, 0.05, 0, 0.5, 0, 0.4, 0.9, 0, 0.7, 0.2, 0.9, 0.8, 0, 0.9, 0.1, 0, 1, 1, 1];
const ONE_FLOAT = new Float32Array(1);
const ITS_BITS = new Int32Array(ONE_FLOAT.buffer);

/** @param {number} value */
function srgbByte(value) {
  return SRGB_TABLE[Math.min(Math.max((value * SRGB_STEPS + 0.5) | 0, 0), SRGB_STEPS)];
}

/** @param {number} value */
function agxCurve(value) {
  ONE_FLOAT[0] = value > 0 ? value : 0;
  return AGX_TABLE[Math.min(Math.max((ITS_BITS[0] >> 13) - AGX_FIRST, 0), AGX_TABLE.length - 1)];
}

/**
 * Shows one block's radiance, three planes of pixels, as bytes of colour at a place in `rgba`, a picture of `stride` pixels a row.
 * @param {Float32Array} planes
 * @param {number} width
 * @param {number} height
 * @param {Tone} tone
 * @param {Uint8ClampedArray} rgba
 * @param {number} first
 * @param {number} stride
 */
export function showBlock(planes, width, height, tone, rgba, first, stride) {
  const pixels = width * height;
  const [gr, gg, gb] = tone.gain;
  const top = 65000 / Math.max(gr, gg, gb);
  for (let p = 0; p < pixels; p++) {
    const at = 4 * (first + ((p / width) | 0) * stride + (p % width));
    let r = Math.min(Math.max(planes[p], 0), top);
    let g = Math.min(Math.max(planes[pixels + p], 0), top);
    let b = Math.min(Math.max(planes[2 * pixels + p], 0), top);
    rgba[at + 3] = 255;
    if (tone.curve === FALSE_COLOUR) {
      const stops = Math.log2(Math.max(0.2126 * r + 0.7152 * g + 0.0722 * b, 2 ** tone.lowStops)) - tone.lowStops;
      const place = Math.min(Math.max(stops / tone.rangeStops, 0), 1) * 6;
      const step = Math.min(place | 0, 5);
      for (let ch = 0; ch < 3; ch++) {
        const [low, high] = [FALSE_COLOURS[3 * step + ch], FALSE_COLOURS[3 * step + 3 + ch]];
        rgba[at + ch] = srgbByte(low + (high - low) * (place - step));
      }
      continue;
    }
    r *= gr;
    g *= gg;
    b *= gb;
    if (tone.curve === 1) {
      const x = agxCurve(0.84247905 * r + 0.0784336 * g + 0.079223745 * b);
      const y = agxCurve(0.042328242 * r + 0.87846864 * g + 0.07916613 * b);
      const z = agxCurve(0.042375655 * r + 0.0784336 * g + 0.879143 * b);
      // A clamped array rounds by itself.
      rgba[at] = 255 * (1.196879 * x - 0.09802088 * y - 0.09902974 * z);
      rgba[at + 1] = 255 * (-0.052896757 * x + 1.1519031 * y - 0.09896118 * z);
      rgba[at + 2] = 255 * (-0.052971636 * x - 0.09804345 * y + 1.1510737 * z);
      continue;
    }
    if (tone.curve === 2) {
      r = (r * (2.51 * r + 0.03)) / (r * (2.43 * r + 0.59) + 0.14);
      g = (g * (2.51 * g + 0.03)) / (g * (2.43 * g + 0.59) + 0.14);
      b = (b * (2.51 * b + 0.03)) / (b * (2.43 * b + 0.59) + 0.14);
    } else if (tone.curve === 3) {
      const least = Math.min(r, g, b);
      const offset = least < 0.08 ? least - 6.25 * least * least : 0.04;
      r -= offset;
      g -= offset;
      b -= offset;
      const peak = Math.max(r, g, b);
      if (peak >= 0.76) {
        const newPeak = 1 - (0.24 * 0.24) / (peak + 0.24 - 0.76);
        const mixed = 1 - 1 / (0.15 * (peak - newPeak) + 1);
        const scale = (newPeak / peak) * (1 - mixed);
        r = r * scale + newPeak * mixed;
        g = g * scale + newPeak * mixed;
        b = b * scale + newPeak * mixed;
      }
    }
    rgba[at] = srgbByte(r);
    rgba[at + 1] = srgbByte(g);
    rgba[at + 2] = srgbByte(b);
  }
}
