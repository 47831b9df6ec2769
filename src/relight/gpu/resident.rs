//! A bank of blocks in GPU memory, with what is needed to run the kernels over it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::bank::{Bank, Sizes};
use super::device::Gpu;
use super::kernels::{KERNELS, KernelBuffer, SpreadOver, THREADS};
use super::staging::{Parcel, Staging};
use crate::error::{Error, Result};
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS, ColumnTransform};
use crate::relight::lighting::{LightingCoefficients, padded};

/// Arrays that all banks of a matrix share.
pub(super) struct SharedArrays {
    /// Planes of coefficients, then planes of columns.
    lighting: wgpu::Buffer,
    transform: Arc<ColumnTransform>,
    /// Where each tile begins in a plane of coefficients.
    firsts: Vec<u32>,
    /// What columns of the factors are divided by; empty where all are 1.
    scales: Vec<f32>,
    staging: Mutex<Staging>,
}

impl SharedArrays {
    pub(super) fn new(gpu: &Gpu, transform: &Arc<ColumnTransform>, scales: &[f32]) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let size = Self::lighting_bytes(transform);
        let descriptor = wgpu::BufferDescriptor { label: Some("lighting"), size, usage, mapped_at_creation: false };
        let firsts = transform.tiles().iter().scan(0, |end, &tile| {
            *end += padded(tile) as u32;
            Some(*end - padded(tile) as u32)
        });
        Self {
            lighting: gpu.device.create_buffer(&descriptor),
            firsts: firsts.collect(),
            transform: Arc::clone(transform),
            scales: scales.to_vec(),
            staging: Mutex::default(),
        }
    }

    /// Where each tile begins in a plane of coefficients.
    pub(super) fn firsts(&self) -> &[u32] {
        &self.firsts
    }

    /// The way to the GPU's memory, which one thread uses at a time.
    pub(super) fn staging(&self) -> MutexGuard<'_, Staging> {
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn lighting_bytes(transform: &ColumnTransform) -> u64 {
        ((coefficients(transform) + transform.columns().next_multiple_of(4)) * CHANNELS * size_of::<f32>()) as u64
    }

    /// Bytes of the lighting.
    pub(super) fn bytes(&self) -> u64 {
        self.lighting.size()
    }

    /// Sets what the next submission uses: a plane of coefficients for each channel, then one of columns, in fours.
    pub(super) fn set(&self, gpu: &Gpu, lighting: &Lighting) {
        let (columns, plane) = (self.transform.columns(), coefficients(&self.transform));
        let mut planes = vec![0.0f32; Self::lighting_bytes(&self.transform) as usize / size_of::<f32>()];
        let lighting = LightingCoefficients::new(lighting, &self.scales, &self.transform);
        let (of_coefficients, of_columns) = planes.split_at_mut(CHANNELS * plane);
        for (tile, &first) in lighting.tiles().iter().zip(&self.firsts).filter(|(tile, _)| tile.used > 0) {
            for (values, plane) in tile.planes().iter().zip(of_coefficients.chunks_exact_mut(plane)) {
                plane[first as usize..][..values.len()].copy_from_slice(values);
            }
        }
        for (channel, plane) in lighting.channels().iter().zip(of_columns.chunks_exact_mut(columns.next_multiple_of(4)))
        {
            plane[..columns].copy_from_slice(channel);
        }
        gpu.queue.write_buffer(&self.lighting, 0, bytemuck::cast_slice(&planes));
    }
}

/// Coefficients of a plane, each tile filled up.
fn coefficients(transform: &ColumnTransform) -> usize {
    transform.tiles().iter().map(|&tile| padded(tile)).sum()
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
    /// Bytes uploaded to them.
    pub(super) sent_bytes: u64,
}

impl ResidentBank {
    /// Puts a bank that has blocks into GPU memory, and submits that with the commands that `then` adds.
    pub(super) fn upload(
        gpu: &Gpu,
        shared: &SharedArrays,
        bank: &Bank,
        then: impl FnOnce(&Self, &mut wgpu::CommandEncoder),
    ) -> Result<(Self, wgpu::SubmissionIndex)> {
        let device = &gpu.device;
        let lengths = bank.lengths();
        let sizes = Sizes {
            columns: shared.transform.columns() as u32,
            coefficients: coefficients(&shared.transform) as u32,
            components: lengths.components as u32,
            blocks: lengths.blocks as u32,
            sparse_rows: lengths.sparse_rows as u32,
        };
        let [components, cells, blocks, factors, rows, entries] = bank.arrays();
        let arrays = [("sizes", vec![bytemuck::bytes_of(&sizes)]), components, cells, blocks, factors, rows, entries];
        let sent = arrays.each_ref().map(|(label, pieces)| empty(gpu, label, pieces));
        let [uniform, components, cells, blocks, factors, rows, entries] = &sent;
        let storage = wgpu::BufferUsages::STORAGE;
        let scratch = |label, size: u64, usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let pixels = lengths.pixels as u64;
        let out = storage | wgpu::BufferUsages::COPY_SRC;
        let projected = scratch("projected", (4 * CHANNELS as u64 * u64::from(sizes.components)).max(16), storage);
        let image = scratch("image", 4 * CHANNELS as u64 * pixels, out);
        let back = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let readback = scratch("readback", 4 * CHANNELS as u64 * pixels, back);
        let buffer = |array: KernelBuffer| match array {
            KernelBuffer::Sizes => uniform,
            KernelBuffer::Lighting => &shared.lighting,
            KernelBuffer::Components => components,
            KernelBuffer::Cells => cells,
            KernelBuffer::Blocks => blocks,
            KernelBuffer::Factors => factors,
            KernelBuffer::Rows => rows,
            KernelBuffer::Entries => entries,
            KernelBuffer::Projected => &projected,
            KernelBuffer::Image => &image,
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
        let made_bytes: u64 = [&projected, &image, &readback].iter().map(|buffer| buffer.size()).sum();
        let sent_bytes = sent.iter().map(wgpu::Buffer::size).sum();
        let resident = Self {
            blocks: blocks.clone(),
            image,
            readback,
            max_pixels: bank.max_pixels,
            passes,
            places: bank.places(),
            bytes: sent_bytes + made_bytes,
            sent_bytes,
        };
        let parcels = sent.iter().zip(arrays).map(|(target, (_, pieces))| Parcel { target, pieces });
        let mut staging = shared.staging();
        let mut sent = staging.send(gpu, &parcels.collect::<Vec<_>>())?;
        then(&resident, &mut sent.encoder);
        let submission = staging.submit(gpu, sent);
        gpu.check()?;
        Ok((resident, submission))
    }

    /// As [`upload`](Self::upload), and begins to relight the bank and to read it back.
    pub(super) fn upload_and_relight(
        gpu: &Gpu,
        shared: &SharedArrays,
        bank: &Bank,
    ) -> Result<(Self, wgpu::SubmissionIndex)> {
        let uploaded = Self::upload(gpu, shared, bank, |resident, encoder| {
            relight_and_copy(gpu, encoder, std::iter::once(resident));
        })?;
        uploaded.0.map();
        Ok(uploaded)
    }

    /// Lets the host read the copy of its image when what is submitted so far is done.
    fn map(&self) {
        self.readback.map_async(wgpu::MapMode::Read, .., |_| ());
    }

    fn dispatch(&self, pass: &mut wgpu::ComputePass, kernel: usize) {
        if let Some((bindings, [x, y, z])) = &self.passes[kernel] {
            pass.set_bind_group(0, bindings, &[]);
            pass.dispatch_workgroups(*x, *y, *z);
        }
    }
}

/// A buffer for an array.
fn empty(gpu: &Gpu, label: &str, pieces: &[&[u8]]) -> wgpu::Buffer {
    let size: usize = pieces.iter().map(|piece| piece.len()).sum();
    let binding = if label == "sizes" { wgpu::BufferUsages::UNIFORM } else { wgpu::BufferUsages::STORAGE };
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        // A binding may not be empty: nothing that counts is read there.
        size: size.max(16) as u64,
        usage: binding | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
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

/// Lets the images of banks be copied to where the host can read them.
fn copy<'a>(encoder: &mut wgpu::CommandEncoder, banks: impl Iterator<Item = &'a ResidentBank>) {
    for bank in banks {
        encoder.copy_buffer_to_buffer(&bank.image, 0, &bank.readback, 0, None);
    }
}

/// Lets the kernels relight banks, and their images be copied to where the host can read them.
fn relight_and_copy<'a>(
    gpu: &Gpu,
    encoder: &mut wgpu::CommandEncoder,
    banks: impl Iterator<Item = &'a ResidentBank> + Clone,
) {
    relight(gpu, &mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()), banks.clone());
    copy(encoder, banks);
}

/// Begins to read the images of banks back as they are.
pub(super) fn submit_copy<'a>(
    gpu: &Gpu,
    banks: impl Iterator<Item = &'a ResidentBank> + Clone,
) -> wgpu::SubmissionIndex {
    let mut encoder = gpu.encoder();
    copy(&mut encoder, banks.clone());
    submit_copied(gpu, encoder, banks)
}

/// Submits commands that copy the images of banks, and lets the host read the copies.
fn submit_copied<'a>(
    gpu: &Gpu,
    encoder: wgpu::CommandEncoder,
    banks: impl Iterator<Item = &'a ResidentBank>,
) -> wgpu::SubmissionIndex {
    let submission = gpu.queue.submit([encoder.finish()]);
    banks.for_each(ResidentBank::map);
    submission
}

/// Begins to relight banks and to read them back.
pub(super) fn submit(gpu: &Gpu, banks: &[&ResidentBank]) -> wgpu::SubmissionIndex {
    let mut encoder = gpu.encoder();
    relight_and_copy(gpu, &mut encoder, banks.iter().copied());
    submit_copied(gpu, encoder, banks.iter().copied())
}

/// Hands what was read back, once that is done, to `take`: the pixels of each bank.
pub(super) fn read_back(
    gpu: &Gpu,
    banks: &[&ResidentBank],
    take: impl FnOnce(&[&[[f32; CHANNELS]]]) -> Result<()>,
) -> Result<()> {
    let mapped = banks.iter().map(|bank| bank.readback.get_mapped_range(..)).collect::<Result<Vec<_>, _>>();
    let mapped = mapped.map_err(|e| Error::NoGpu(format!("{}: the image cannot be read ({e})", gpu.adapter.name)))?;
    let images: Vec<&[[f32; CHANNELS]]> = mapped.iter().map(|bytes| bytemuck::cast_slice(bytes)).collect();
    let taken = take(&images);
    drop(mapped);
    banks.iter().for_each(|bank| bank.readback.unmap());
    taken
}
