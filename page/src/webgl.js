// Pictures by WebGL 2: left sides in an array of textures, a square for each component; the sums `R ℓ` are made here, and one pass
// over the pixels does the rest. The twin of shaders/reconstruct.wgsl, scatter.wgsl and tone.wgsl.

/** @import { ColumnTile, Factors } from './codec.js' */
/** @import { Tone } from './colour.js' */
/** @import { Level } from './stream.js' */
import { ChangesTo, Projection, gridOf, rectOf } from './blocks.js';

/** Widest row of textures that are only lists. */
const LIST_WIDTH = 1024;
/** Widest texture for left sides. */
const LEFT_WIDTH = 2048;

const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp usampler2D;
uniform sampler2DArray leftSides;
uniform sampler2D projected;
uniform usampler2D blockTable;
uniform usampler2D pointers;
uniform sampler2D entries;
uniform sampler2D lighting;
uniform int side;
uniform int tilesAcross;
uniform int pictureHeight;
uniform vec3 gain;
uniform int curve;
uniform vec2 range;
out vec4 shown;

ivec2 listed(int index) {
  return ivec2(index % ${LIST_WIDTH}, index / ${LIST_WIDTH});
}

vec3 encodeSrgb(vec3 linear) {
  vec3 v = clamp(linear, 0.0, 1.0);
  vec3 curved = 1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055;
  return mix(curved, 12.92 * v, lessThanEqual(v, vec3(0.0031308)));
}

vec3 agx(vec3 linear) {
  mat3 intoBase = transpose(mat3(
    0.84247905, 0.0784336, 0.079223745,
    0.042328242, 0.87846864, 0.07916613,
    0.042375655, 0.0784336, 0.879143));
  mat3 outOfBase = transpose(mat3(
    1.196879, -0.09802088, -0.09902974,
    -0.052896757, 1.1519031, -0.09896118,
    -0.052971636, -0.09804345, 1.1510737));
  float low = -12.47393;
  float high = 4.026069;
  vec3 stops = log2(max(intoBase * linear, vec3(1e-10)));
  vec3 x = (clamp(stops, low, high) - low) / (high - low);
  vec3 curved = ((((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x) - 0.00232;
  return clamp(outOfBase * curved, 0.0, 1.0);
}

vec3 neutral(vec3 linear) {
  float start = 0.76;
  float least = min(linear.x, min(linear.y, linear.z));
  float offset = least < 0.08 ? least - 6.25 * least * least : 0.04;
  vec3 color = linear - offset;
  float peak = max(color.x, max(color.y, color.z));
  if (peak < start) return color;
  float room = 1.0 - start;
  float newPeak = 1.0 - room * room / (peak + room - start);
  float mixed = 1.0 - 1.0 / (0.15 * (peak - newPeak) + 1.0);
  return color * (newPeak / peak) * (1.0 - mixed) + vec3(newPeak * mixed);
}

vec3 falseColour(vec3 radiance) {
  vec3 colours[7] = vec3[7](
    vec3(0.0), vec3(0.05, 0.0, 0.5), vec3(0.0, 0.4, 0.9), vec3(0.0, 0.7, 0.2), vec3(0.9, 0.8, 0.0), vec3(0.9, 0.1, 0.0),
    vec3(1.0));
  float luminance = dot(radiance, vec3(0.2126, 0.7152, 0.0722));
  float stops = log2(max(luminance, exp2(range.x))) - range.x;
  float at = clamp(stops / range.y, 0.0, 1.0) * 6.0;
  int place = min(int(at), 5);
  return encodeSrgb(mix(colours[place], colours[place + 1], at - float(place)));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.x, float(pictureHeight) - gl_FragCoord.y);
  uvec4 block = texelFetch(blockTable, at / side, 0);
  shown = vec4(0.0);
  if (block.z == 0u) return;
  vec3 sum = vec3(0.0);
  ivec2 inside = at % side;
  for (uint k = 0u; k < block.y; k++) {
    int slot = int(block.x + k);
    int tile = slot % (tilesAcross * tilesAcross);
    ivec3 texel = ivec3(ivec2(tile % tilesAcross, tile / tilesAcross) * side + inside, slot / (tilesAcross * tilesAcross));
    sum += texelFetch(leftSides, texel, 0).rgb * texelFetch(projected, listed(slot), 0).rgb;
  }
  int pointer = int(texelFetch(pointers, at, 0).r);
  if (pointer > 0) {
    int count = int(texelFetch(entries, listed(pointer - 1), 0).r);
    for (int i = 0; i < count; i++) {
      vec4 entry = texelFetch(entries, listed(pointer + i), 0);
      int channel = int(entry.g);
      sum[channel] += entry.b * texelFetch(lighting, listed(int(entry.r)), 0)[channel];
    }
  }
  vec3 radiance = max(sum, vec3(0.0));
  vec3 linear = min(radiance * gain, vec3(65000.0));
  vec3 display;
  if (curve == 1) display = agx(linear);
  else if (curve == 2) display = encodeSrgb((linear * (2.51 * linear + 0.03)) / (linear * (2.43 * linear + 0.59) + 0.14));
  else if (curve == 3) display = encodeSrgb(neutral(linear));
  else if (curve == 4) display = falseColour(radiance);
  else display = encodeSrgb(linear);
  shown = vec4(display, 1.0);
}`;

/** Largest value of 16-bit floats: what is 2²⁹ times smaller becomes 0. */
const HALF_PEAK = 32768;
const FLOAT_BITS = new Float32Array(1);
const HALF_BITS = new Int32Array(FLOAT_BITS.buffer);

/** @param {number} value of at most 2¹⁵, as the bits of a 16-bit float that is not subnormal */
function halfOf(value) {
  FLOAT_BITS[0] = value;
  const bits = HALF_BITS[0];
  const size = bits & 0x7fffffff;
  const rounded = size + 0xfff + ((size >> 13) & 1);
  return rounded < 0x38800000 ? 0 : ((rounded >> 13) - (112 << 10)) | ((bits >> 16) & 0x8000);
}

/**
 * Values as 16-bit floats, and what they are to be multiplied by.
 * @param {Float32Array} values
 */
export function halvesOf(values) {
  let peak = 0;
  for (let i = 0; i < values.length; i++) peak = Math.max(peak, Math.abs(values[i]));
  const scale = peak / HALF_PEAK || 1;
  const halves = new Uint16Array(values.length);
  for (let i = 0; i < values.length; i++) halves[i] = halfOf(values[i] / scale);
  return { halves, scale };
}

/** First slot of each block, of as many as it will have components, and their sum. @param {number[]} ranks */
export function slotsOf(ranks) {
  let sum = 0;
  const first = ranks.map((rank) => (sum += rank) - rank);
  return { first, sum };
}

/** One level of the picture on a GPU by WebGL 2. Throws where there is none, or it is too small. */
export class GlPainter {
  /** @param {Level} level @param {number} columns @param {ColumnTile[]} tiles @param {() => void} onLost */
  constructor(level, columns, tiles, onLost) {
    this.level = level;
    this.columns = columns;
    this.tiles = tiles;
    this.canvas = document.createElement('canvas');
    this.canvas.width = level.width;
    this.canvas.height = level.height;
    const gl = this.canvas.getContext('webgl2', { antialias: false, depth: false, powerPreference: 'high-performance' });
    if (!gl) throw new Error('there is no WebGL 2');
    this.gl = gl;
    this.canvas.addEventListener('webglcontextlost', onLost);
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    const { first, sum } = slotsOf(level.ranks);
    this.first = first;
    const square = Math.ceil(Math.sqrt(Math.max(sum, 1)));
    this.tilesAcross = Math.max(1, Math.min(square, Math.floor(Math.min(LEFT_WIDTH, most) / level.side)));
    const layers = Math.max(1, Math.ceil(sum / this.tilesAcross ** 2));
    const rowsOf = (/** @type {number} */ items) => Math.max(1, Math.ceil(items / LIST_WIDTH));
    // Of each pixel that has sparse entries: their number, then they.
    let entries = 0;
    this.firstEntry = level.sparse.map((count) => (entries += 2 * count) - 2 * count);
    const tallest = Math.max(level.width, level.height, rowsOf(sum), rowsOf(entries), rowsOf(columns));
    if (tallest > most || layers > gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS)) throw new Error('the picture is too large');
    this.program = this.compile();
    const grid = gridOf(level);
    const texture = (/** @type {string} */ name, /** @type {number} */ unit, /** @type {number} */ target) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, gl.createTexture());
      gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.uniform1i(gl.getUniformLocation(this.program, name), unit);
    };
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    texture('leftSides', 0, gl.TEXTURE_2D_ARRAY);
    const width = this.tilesAcross * level.side;
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA16F, width, width, layers);
    texture('projected', 1, gl.TEXTURE_2D);
    this.projected = new Float32Array(4 * LIST_WIDTH * rowsOf(sum));
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, LIST_WIDTH, rowsOf(sum));
    texture('blockTable', 2, gl.TEXTURE_2D);
    this.table = new Uint32Array(4 * grid.across * grid.down);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, grid.across, grid.down);
    texture('pointers', 3, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, level.width, level.height);
    texture('entries', 4, gl.TEXTURE_2D);
    this.entries = new Float32Array(4 * LIST_WIDTH * rowsOf(entries));
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, LIST_WIDTH, rowsOf(entries));
    texture('lighting', 5, gl.TEXTURE_2D);
    this.lighting = new Float32Array(4 * LIST_WIDTH * rowsOf(columns));
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, LIST_WIDTH, rowsOf(columns));
    gl.uniform1i(gl.getUniformLocation(this.program, 'side'), level.side);
    gl.uniform1i(gl.getUniformLocation(this.program, 'tilesAcross'), this.tilesAcross);
    gl.uniform1i(gl.getUniformLocation(this.program, 'pictureHeight'), level.height);
    gl.viewport(0, 0, level.width, level.height);
    if (gl.getError() !== gl.NO_ERROR) throw new Error('the GPU has not enough memory');
    /** @type {({ projection: Projection, scales: number[] } | null)[]} */
    this.blocks = level.ranks.map(() => null);
    this.isTableNew = true;
    this.areEntriesNew = true;
  }

  compile() {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`no program: ${gl.getProgramInfoLog(program)}`);
    gl.useProgram(program);
    return program;
  }

  /** @param {number} id @param {Factors} factors */
  setBlock(id, factors) {
    const { gl, level } = this;
    const rect = rectOf(level, id);
    const pixels = rect.width * rect.height;
    /** @type {number[]} */
    const scales = [];
    gl.activeTexture(gl.TEXTURE0);
    for (let k = 0; k < factors.rank; k++) {
      const { halves, scale } = halvesOf(factors.left.subarray(3 * k * pixels, 3 * (k + 1) * pixels));
      scales.push(scale);
      const texels = new Uint16Array(4 * pixels);
      for (let p = 0; p < pixels; p++) {
        for (let ch = 0; ch < 3; ch++) texels[4 * p + ch] = halves[ch * pixels + p];
      }
      const slot = this.first[id] + k;
      const inLayer = slot % this.tilesAcross ** 2;
      const [x, y] = [(inLayer % this.tilesAcross) * level.side, Math.floor(inLayer / this.tilesAcross) * level.side];
      const layer = Math.floor(slot / this.tilesAcross ** 2);
      gl.texSubImage3D(
        gl.TEXTURE_2D_ARRAY, 0, x, y, layer, rect.width, rect.height, 1, gl.RGBA, gl.HALF_FLOAT, texels);
    }
    this.setSparse(id, factors, rect, pixels);
    this.blocks[id] = { projection: new Projection(factors.right, factors.rank), scales };
    this.table.set([this.first[id], factors.rank, 1, 0], 4 * id);
    this.isTableNew = true;
  }

  /** @param {number} id @param {Factors} factors @param {{ x: number, y: number, width: number, height: number }} rect @param {number} pixels */
  setSparse(id, { sparse }, rect, pixels) {
    if (sparse.rows.length === 0) return;
    const order = Array.from(sparse.rows.keys()).sort((a, b) => (sparse.rows[a] % pixels) - (sparse.rows[b] % pixels));
    const pointers = new Uint32Array(pixels);
    let next = this.firstEntry[id];
    let head = -1;
    let last = -1;
    for (const i of order) {
      const pixel = sparse.rows[i] % pixels;
      if (pixel !== last) {
        [head, last] = [next++, pixel];
        this.entries[4 * head] = 0;
        pointers[pixel] = head + 1;
      }
      this.entries[4 * head]++;
      this.entries.set([sparse.columns[i], Math.floor(sparse.rows[i] / pixels), sparse.values[i]], 4 * next++);
    }
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE3);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, rect.x, rect.y, rect.width, rect.height, gl.RED_INTEGER, gl.UNSIGNED_INT, pointers);
    this.areEntriesNew = true;
  }

  /**
   * The picture on a canvas that holds it until this task ends.
   * @param {Float32Array} weights
   * @param {Tone} tone
   */
  async draw(weights, tone) {
    const { gl, columns } = this;
    const changes = new ChangesTo(this.tiles, weights);
    this.blocks.forEach((block, id) => {
      if (!block?.projection.bring(changes)) return;
      block.scales.forEach((scale, k) => {
        for (let ch = 0; ch < 3; ch++) {
          this.projected[4 * (this.first[id] + k) + ch] = block.projection.sums[3 * k + ch] * scale;
        }
      });
    });
    const fill = (/** @type {number} */ unit, /** @type {Float32Array} */ list) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, LIST_WIDTH, list.length / (4 * LIST_WIDTH), gl.RGBA, gl.FLOAT, list);
    };
    fill(1, this.projected);
    for (let j = 0; j < columns; j++) {
      for (let ch = 0; ch < 3; ch++) this.lighting[4 * j + ch] = weights[ch * columns + j];
    }
    fill(5, this.lighting);
    if (this.areEntriesNew) fill(4, this.entries);
    if (this.isTableNew) {
      const grid = gridOf(this.level);
      gl.activeTexture(gl.TEXTURE2);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, grid.across, grid.down, gl.RGBA_INTEGER, gl.UNSIGNED_INT, this.table);
    }
    [this.areEntriesNew, this.isTableNew] = [false, false];
    gl.uniform3f(gl.getUniformLocation(this.program, 'gain'), ...tone.gain);
    gl.uniform1i(gl.getUniformLocation(this.program, 'curve'), tone.curve);
    gl.uniform2f(gl.getUniformLocation(this.program, 'range'), tone.lowStops, tone.rangeStops);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    if (gl.isContextLost()) throw new Error('the GPU was lost');
    return this.canvas;
  }
}
