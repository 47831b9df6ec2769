//! A bank of blocks in GPU memory, with what is needed to run the kernels over it.

use wgpu::util::DeviceExt;

use super::bank::{Bank, Sizes};
use super::device::Gpu;
use super::kernels::{Array, KERNELS, SpreadOver, THREADS};
use crate::error::{Error, Result};
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS};

/// Arrays that all banks of a matrix share.
pub(super) struct SharedArrays {
    lighting: wgpu::Buffer,
}

impl SharedArrays {
    pub(super) fn new(gpu: &Gpu, columns: usize) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let size = Self::lighting_bytes(columns);
        let descriptor = wgpu::BufferDescriptor { label: Some("lighting"), size, usage, mapped_at_creation: false };
        Self { lighting: gpu.device.create_buffer(&descriptor) }
    }

    pub(super) fn lighting_bytes(columns: usize) -> u64 {
        (columns * CHANNELS * size_of::<f32>()) as u64
    }

    /// Sets what the next submission uses.
    pub(super) fn set(&self, gpu: &Gpu, lighting: &Lighting) {
        let planes: Vec<f32> = (0..CHANNELS).flat_map(|channel| lighting.channel(channel)).collect();
        gpu.queue.write_buffer(&self.lighting, 0, bytemuck::cast_slice(&planes));
    }
}

/// A bank on the device.
pub(super) struct ResidentBank {
    /// Its blocks, and the radiance of their pixels, as the kernels know both.
    pub(super) blocks: wgpu::Buffer,
    pub(super) image: wgpu::Buffer,
    readback: wgpu::Buffer,
    /// Pixels of its largest block.
    pub(super) max_pixels: u32,
    /// For each kernel its bindings and number of workgroups; none where it has nothing to do.
    passes: Vec<Option<(wgpu::BindGroup, [u32; 3])>>,
    /// Its blocks, each with its first pixel.
    pub(super) places: Vec<(BlockId, u32)>,
    /// Bytes of its buffers.
    pub(super) bytes: u64,
}

impl ResidentBank {
    /// Puts a bank that has blocks into GPU memory.
    pub(super) fn upload(gpu: &Gpu, shared: &SharedArrays, columns: usize, bank: &Bank) -> Result<Self> {
        let device = &gpu.device;
        let sizes = Sizes {
            columns: columns as u32,
            components: bank.components.len() as u32,
            blocks: bank.blocks.len() as u32,
            sparse_rows: bank.sparse_rows.len() as u32,
        };
        let make = |label, contents: &[u8], usage| {
            // A binding may not be empty: nothing reads these bytes.
            let contents = if contents.is_empty() { &[0; 16][..] } else { contents };
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
        };
        let storage = wgpu::BufferUsages::STORAGE;
        let uniform = make("sizes", bytemuck::bytes_of(&sizes), wgpu::BufferUsages::UNIFORM);
        let components = make("components", bytemuck::cast_slice(&bank.components), storage);
        let blocks = make("blocks", bytemuck::cast_slice(&bank.blocks), storage);
        let factors = make("factors", bytemuck::cast_slice(&bank.factors), storage);
        let rows = make("rows", bytemuck::cast_slice(&bank.sparse_rows), storage);
        let entries = make("entries", bytemuck::cast_slice(&bank.sparse_entries), storage);
        let pixels = u64::from(bank.pixels);
        let scratch = |label, size: u64, usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let out = storage | wgpu::BufferUsages::COPY_SRC;
        let projected = scratch("projected", (4 * CHANNELS as u64 * u64::from(sizes.components)).max(16), storage);
        let image = scratch("image", 4 * CHANNELS as u64 * pixels, out);
        let back = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let readback = scratch("readback", 4 * CHANNELS as u64 * pixels, back);
        let buffer = |array: Array| match array {
            Array::Sizes => &uniform,
            Array::Lighting => &shared.lighting,
            Array::Components => &components,
            Array::Blocks => &blocks,
            Array::Factors => &factors,
            Array::Rows => &rows,
            Array::Entries => &entries,
            Array::Projected => &projected,
            Array::Image => &image,
        };
        let passes = KERNELS.iter().zip(&gpu.pipelines).map(|((kernel, spread_over), pipeline)| {
            let groups = match spread_over {
                SpreadOver::Components => spread(gpu, sizes.components),
                SpreadOver::SparseRows => spread(gpu, sizes.sparse_rows.div_ceil(THREADS)),
                SpreadOver::Pixels => per_block(gpu, sizes.blocks, bank.max_pixels.div_ceil(4)),
            };
            let entries: Vec<_> = (0..)
                .zip(kernel.bindings)
                .map(|(binding, &array)| wgpu::BindGroupEntry { binding, resource: buffer(array).as_entire_binding() })
                .collect();
            let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(kernel.name),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            (!groups.contains(&0)).then_some((bindings, groups))
        });
        let passes = passes.collect();
        let buffers = [&uniform, &components, &blocks, &factors, &rows, &entries, &projected, &image, &readback];
        let bytes = buffers.iter().map(|buffer| buffer.size()).sum();
        gpu.check()?;
        let (places, max_pixels) = (bank.ids.clone(), bank.max_pixels);
        Ok(Self { blocks, image, readback, max_pixels, passes, places, bytes })
    }

    fn dispatch(&self, pass: &mut wgpu::ComputePass, kernel: usize) {
        if let Some((bindings, [x, y, z])) = &self.passes[kernel] {
            pass.set_bind_group(0, bindings, &[]);
            pass.dispatch_workgroups(*x, *y, *z);
        }
    }
}

/// A row of workgroups as long as the device takes, and as many rows as needed.
fn spread(gpu: &Gpu, count: u32) -> [u32; 3] {
    let most = gpu.device.limits().max_compute_workgroups_per_dimension;
    [count.min(most), count.div_ceil(most), 1]
}

/// Workgroups for blocks, none of which needs more than so many threads.
pub(super) fn per_block(gpu: &Gpu, blocks: u32, threads: u32) -> [u32; 3] {
    let [down, deep, _] = spread(gpu, blocks);
    [threads.div_ceil(THREADS), down, deep]
}

/// Lets the kernels relight banks with what [`SharedArrays::set`] set.
pub(super) fn relight<'a>(
    gpu: &Gpu,
    pass: &mut wgpu::ComputePass,
    banks: impl Iterator<Item = &'a ResidentBank> + Clone,
) {
    for (kernel, pipeline) in gpu.pipelines.iter().enumerate() {
        pass.set_pipeline(pipeline);
        banks.clone().for_each(|bank| bank.dispatch(pass, kernel));
    }
}

/// Begins to read the images of banks back.
pub(super) fn submit_copy<'a>(
    gpu: &Gpu,
    mut encoder: wgpu::CommandEncoder,
    banks: impl Iterator<Item = &'a ResidentBank> + Clone,
) -> wgpu::SubmissionIndex {
    for bank in banks.clone() {
        encoder.copy_buffer_to_buffer(&bank.image, 0, &bank.readback, 0, None);
    }
    let submission = gpu.queue.submit([encoder.finish()]);
    banks.for_each(|bank| bank.readback.map_async(wgpu::MapMode::Read, .., |_| ()));
    submission
}

/// Begins to relight banks and to read them back.
pub(super) fn submit(gpu: &Gpu, banks: &[&ResidentBank]) -> wgpu::SubmissionIndex {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let banks = banks.iter().copied();
    relight(gpu, &mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()), banks.clone());
    submit_copy(gpu, encoder, banks)
}

/// Hands what was read back, once that is done, to `take`, bank by bank.
pub(super) fn read_back(gpu: &Gpu, banks: &[&ResidentBank], take: &mut dyn FnMut(&ResidentBank, &[u8])) -> Result<()> {
    for bank in banks {
        {
            let mapped = bank.readback.get_mapped_range(..);
            let mapped =
                mapped.map_err(|e| Error::NoGpu(format!("{}: the image cannot be read ({e})", gpu.adapter.name)))?;
            take(bank, &mapped);
        }
        bank.readback.unmap();
    }
    Ok(())
}
