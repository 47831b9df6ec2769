// Pictures by WebGPU, with the kernels of the GPU relighter: the same texts, the same arrays (shaders/layout.wgsl). The sums `R ℓ`
// are made here.

/** @import { ColumnTile, Factors } from './codec.js' */
/** @import { Tone } from './colour.js' */
/** @import { Level } from './stream.js' */
import { ChangesTo, Projection, rectOf } from './blocks.js';
import { halvesOf, slotsOf } from './webgl.js';

const THREADS = 64;
const MOST_GROUPS = 65535;
/** Bytes of an entry of each array. */
const COMPONENT_BYTES = 16;
const BLOCK_BYTES = 20;

/** Workgroups for so many, in two dimensions. @param {number} count */
function spread(count) {
  return [Math.min(count, MOST_GROUPS), Math.ceil(count / MOST_GROUPS)];
}

/** One level of the picture on a GPU by WebGPU. */
export class GpuPainter {
  /** Throws where there is no device, or the picture is too large for it. @param {Level} level @param {number} columns @param {ColumnTile[]} tiles @param {() => void} onLost */
  static async open(level, columns, tiles, onLost) {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) throw new Error('there is no WebGPU');
    const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
    const device = await adapter.requestDevice({ requiredLimits: { maxStorageBufferBindingSize, maxBufferSize } });
    device.lost.then(onLost);
    const painter = new GpuPainter(level, columns, tiles, device);
    await painter.build();
    return painter;
  }

  /** @param {Level} level @param {number} columns @param {ColumnTile[]} tiles @param {GPUDevice} device */
  constructor(level, columns, tiles, device) {
    this.level = level;
    this.columns = columns;
    this.tiles = tiles;
    this.device = device;
    this.canvas = document.createElement('canvas');
    [this.canvas.width, this.canvas.height] = [level.width, level.height];
    const { first, sum } = slotsOf(level.ranks);
    this.first = first;
    this.slots = Math.max(sum, 1);
    // Words that the left side of a component takes, in 16 bits a value.
    this.leftWords = level.ranks.map((_, id) => {
      const { width, height } = rectOf(level, id);
      return 6 * Math.ceil((width * height) / 4);
    });
    let words = 0;
    this.firstWord = level.ranks.map((rank, id) => {
      const begin = words;
      words += rank * this.leftWords[id];
      return begin;
    });
    this.words = Math.max(words, 1);
    this.components = new DataView(new ArrayBuffer(COMPONENT_BYTES * this.slots));
    this.projected = new Float32Array(3 * this.slots);
    /** @type {Map<number, { rank: number, projection: Projection, scales: number[] }>} the blocks that are known */
    this.blocks = new Map();
    /** @type {Map<number, { target: Uint32Array, ends: Uint32Array, columns: Uint32Array, values: Float32Array }>} */
    this.sparse = new Map();
    this.isNew = true;
  }

  async build() {
    const { device, level } = this;
    device.pushErrorScope('out-of-memory');
    device.pushErrorScope('validation');
    const pipeline = (/** @type {string} */ name, /** @type {string} */ code) =>
      device.createComputePipelineAsync({
        layout: 'auto',
        compute: { module: device.createShaderModule({ code }), entryPoint: name },
      });
    const [reconstruct, scatter, tone] = await Promise.all([
      pipeline('reconstruct', KERNELS.reconstruct), pipeline('scatter', KERNELS.scatter), pipeline('tone', KERNELS.tone),
    ]);
    this.pipelines = { reconstruct, scatter, tone };
    const pixels = level.width * level.height;
    this.buffers = {
      sizes: this.buffer(32, GPUBufferUsage.UNIFORM),
      tone: this.buffer(32, GPUBufferUsage.UNIFORM),
      lighting: this.buffer(48 * Math.ceil(this.columns / 4)),
      components: this.buffer(COMPONENT_BYTES * this.slots),
      factors: this.buffer(4 * this.words),
      projected: this.buffer(12 * this.slots),
      image: this.buffer(12 * pixels),
    };
    this.screen = device.createTexture({
      size: [level.width, level.height],
      format: 'rgba8unorm',
      usage: GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC,
    });
    this.context = /** @type {GPUCanvasContext} */ (this.canvas.getContext('webgpu'));
    this.context.configure({
      device, format: 'rgba8unorm', usage: GPUTextureUsage.COPY_DST | GPUTextureUsage.RENDER_ATTACHMENT, alphaMode: 'premultiplied',
    });
    const problems = [await device.popErrorScope(), await device.popErrorScope()];
    const problem = problems.find((problem) => problem);
    if (problem) throw new Error(problem.message);
  }

  /** @param {number} size @param {number} usage */
  buffer(size, usage = GPUBufferUsage.STORAGE) {
    return this.device.createBuffer({ size: Math.max(size, 16), usage: usage | GPUBufferUsage.COPY_DST });
  }

  /** @param {number} id @param {Factors} factors */
  setBlock(id, factors) {
    const { width, height } = rectOf(this.level, id);
    const pixels = width * height;
    const padded = 4 * Math.ceil(pixels / 4);
    const leftWords = this.leftWords[id];
    const words = new Uint16Array(2 * factors.rank * leftWords);
    /** @type {number[]} */
    const scales = [];
    for (let k = 0; k < factors.rank; k++) {
      const left = halvesOf(factors.left.subarray(3 * k * pixels, 3 * (k + 1) * pixels));
      const leftAt = k * leftWords;
      scales.push(left.scale);
      for (let ch = 0; ch < 3; ch++) {
        words.set(left.halves.subarray(ch * pixels, (ch + 1) * pixels), 2 * leftAt + ch * padded);
      }
      this.components.setUint32(COMPONENT_BYTES * (this.first[id] + k) + 8, this.firstWord[id] + leftAt, true);
    }
    if (words.length > 0) this.device.queue.writeBuffer(/** @type {any} */ (this.buffers).factors, 4 * this.firstWord[id], words);
    this.blocks.set(id, { rank: factors.rank, projection: new Projection(factors.right, factors.rank), scales });
    this.setSparse(id, factors, pixels);
    this.isNew = true;
  }

  /** @param {number} id @param {Factors} factors @param {number} pixels */
  setSparse(id, { sparse }, pixels) {
    const order = Array.from(sparse.rows.keys()).sort((a, b) => sparse.rows[a] - sparse.rows[b]);
    const firstPixel = this.firstPixel(id);
    const target = /** @type {number[]} */ ([]);
    const ends = /** @type {number[]} */ ([]);
    order.forEach((i, at) => {
      const place = 3 * (firstPixel + (sparse.rows[i] % pixels)) + Math.floor(sparse.rows[i] / pixels);
      if (target[target.length - 1] !== place) target.push(place);
      ends[target.length - 1] = at + 1;
    });
    this.sparse.set(id, {
      target: Uint32Array.from(target),
      ends: Uint32Array.from(ends),
      columns: Uint32Array.from(order, (i) => sparse.columns[i]),
      values: Float32Array.from(order, (i) => sparse.values[i]),
    });
  }

  /** Where a block's pixels begin among those of all blocks. @param {number} id */
  firstPixel(id) {
    const { x, y, height } = rectOf(this.level, id);
    return y * this.level.width + x * height;
  }

  /** Makes the arrays that depend on which blocks are known. */
  renew() {
    const { device } = this;
    const buffers = /** @type {NonNullable<typeof this.buffers>} */ (this.buffers);
    const pipelines = /** @type {NonNullable<typeof this.pipelines>} */ (this.pipelines);
    device.queue.writeBuffer(buffers.components, 0, this.components.buffer);
    const ids = Array.from(this.blocks.keys());
    const blocks = new Uint32Array((BLOCK_BYTES / 4) * Math.max(ids.length, 1));
    ids.forEach((id, i) => {
      const { width, height } = rectOf(this.level, id);
      const { rank } = /** @type {{ rank: number }} */ (this.blocks.get(id));
      blocks.set([this.first[id], rank, width * height, this.firstPixel(id), id], (BLOCK_BYTES / 4) * i);
    });
    const lists = Array.from(this.sparse.values());
    const rows = new Uint32Array(3 * Math.max(1, lists.reduce((sum, list) => sum + list.target.length, 0)));
    const entries = new DataView(new ArrayBuffer(8 * Math.max(1, lists.reduce((sum, list) => sum + list.values.length, 0))));
    let [row, entry] = [0, 0];
    for (const { target, ends, columns, values } of lists) {
      target.forEach((place, i) => rows.set([place, entry + (i > 0 ? ends[i - 1] : 0), entry + ends[i]], 3 * row++));
      columns.forEach((column, i) => {
        entries.setUint32(8 * (entry + i), column, true);
        entries.setFloat32(8 * (entry + i) + 4, values[i], true);
      });
      entry += values.length;
    }
    const made = (/** @type {ArrayBuffer} */ data) => {
      const buffer = device.createBuffer({ size: data.byteLength, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
      device.queue.writeBuffer(buffer, 0, data);
      return buffer;
    };
    this.passing?.forEach((buffer) => buffer.destroy());
    const [blockList, rowList, entryList] = [made(blocks.buffer), made(rows.buffer), made(/** @type {ArrayBuffer} */ (entries.buffer))];
    this.passing = [blockList, rowList, entryList];
    device.queue.writeBuffer(buffers.sizes, 0, Uint32Array.of(this.columns, 0, this.slots, ids.length, row));
    const bind = (/** @type {GPUComputePipeline} */ pipeline, /** @type {GPUBindingResource[]} */ resources) =>
      device.createBindGroup({
        layout: pipeline.getBindGroupLayout(0),
        entries: resources.map((resource, binding) => ({ binding, resource })),
      });
    const of = (/** @type {GPUBuffer} */ buffer) => ({ buffer });
    const { sizes, lighting, components, factors, projected, image, tone } = buffers;
    const quads = Math.ceil(Math.ceil(this.level.side ** 2 / 4) / THREADS);
    const screen = /** @type {GPUTexture} */ (this.screen).createView();
    /** @type {[GPUComputePipeline, GPUBindGroup, number[]][]} */
    const passes = [
      [pipelines.reconstruct, bind(pipelines.reconstruct, [sizes, blockList, components, factors, projected, image].map(of)),
        [quads, ...spread(ids.length)]],
      [pipelines.scatter, bind(pipelines.scatter, [sizes, lighting, rowList, entryList, image].map(of)),
        spread(Math.ceil(row / THREADS))],
      [pipelines.tone, bind(pipelines.tone, [of(tone), of(blockList), of(image), screen]),
        [Math.ceil(this.level.side ** 2 / THREADS), ...spread(ids.length)]],
    ];
    this.passes = ids.length > 0 ? passes.filter(([, , groups]) => groups.every((count) => count > 0)) : [];
    this.isNew = false;
  }

  /**
   * The picture on a canvas that holds it until this task ends.
   * @param {Float32Array} weights
   * @param {Tone} tone
   */
  async draw(weights, tone) {
    const { device, level } = this;
    const buffers = /** @type {NonNullable<typeof this.buffers>} */ (this.buffers);
    if (this.isNew) this.renew();
    // A plane for each channel, in fours.
    const plane = 4 * Math.ceil(this.columns / 4);
    const planes = new Float32Array(3 * plane);
    for (let ch = 0; ch < 3; ch++) planes.set(weights.subarray(ch * this.columns, (ch + 1) * this.columns), ch * plane);
    device.queue.writeBuffer(buffers.lighting, 0, planes);
    const changes = new ChangesTo(this.tiles, weights);
    this.blocks.forEach(({ projection, scales }, id) => {
      if (!projection.bring(changes)) return;
      scales.forEach((scale, k) => {
        for (let ch = 0; ch < 3; ch++) this.projected[3 * (this.first[id] + k) + ch] = projection.sums[3 * k + ch] * scale;
      });
    });
    device.queue.writeBuffer(buffers.projected, 0, this.projected);
    const uniform = new DataView(new ArrayBuffer(32));
    tone.gain.forEach((gain, i) => uniform.setFloat32(4 * i, gain, true));
    [tone.curve, level.width, level.side].forEach((value, i) => uniform.setUint32(12 + 4 * i, value, true));
    [tone.lowStops, tone.rangeStops].forEach((value, i) => uniform.setFloat32(24 + 4 * i, value, true));
    device.queue.writeBuffer(buffers.tone, 0, uniform);
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    for (const [pipeline, bindings, groups] of /** @type {NonNullable<typeof this.passes>} */ (this.passes)) {
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, bindings);
      pass.dispatchWorkgroups(groups[0], groups[1] ?? 1, groups[2] ?? 1);
    }
    pass.end();
    const context = /** @type {GPUCanvasContext} */ (this.context);
    const size = [level.width, level.height];
    encoder.copyTextureToTexture(
      { texture: /** @type {GPUTexture} */ (this.screen) }, { texture: context.getCurrentTexture() }, size);
    device.queue.submit([encoder.finish()]);
    return this.canvas;
  }
}
