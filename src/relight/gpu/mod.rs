//! Relighting on the GPU: factors stay quantised in its memory and are dequantised in the kernels of `shaders/`.
//!
//! The only place that knows wgpu. Works within the default limits of WebGPU: blocks are gathered into *banks* none of
//! whose arrays exceeds one binding (128 MiB).

mod bank;
mod device;
mod kernels;

use rayon::prelude::*;
use wgpu::util::DeviceExt;

use super::compact::CompactBlock;
use super::cpu::check_columns;
use super::damage::read_what_stands;
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS, FactorSource, MatrixShape};
use bank::{Bank, Sizes};
use device::Gpu;
use kernels::{KERNELS, THREADS};

/// Blocks that are read in parallel before they are packed.
const BATCH: usize = 64;

/// How a [`GpuRelighter`] uses its device.
#[derive(Clone, Copy, Debug)]
pub struct GpuSettings {
    /// Largest array in bytes; what the device can bind is an upper bound.
    pub binding_bytes: u64,
}

impl Default for GpuSettings {
    fn default() -> Self {
        Self { binding_bytes: u64::MAX }
    }
}

/// A matrix of factors resident in GPU memory.
pub struct GpuRelighter {
    gpu: Gpu,
    shape: MatrixShape,
    lighting: wgpu::Buffer,
    banks: Vec<ResidentBank>,
    /// For each block its bank and first pixel there, none for a hole.
    places: Vec<Option<(usize, u32)>>,
    damage: Vec<String>,
    resident_bytes: u64,
}

/// A bank on the device.
struct ResidentBank {
    image: wgpu::Buffer,
    readback: wgpu::Buffer,
    /// For each kernel its bindings and number of workgroups; none where it has nothing to do.
    passes: Vec<Option<(wgpu::BindGroup, [u32; 3])>>,
}

impl GpuRelighter {
    /// Uploads all factors of `source`. A damaged block keeps the layers before the damage, or becomes a hole; see
    /// [`damage`](Self::damage).
    ///
    /// Errors: [`Error::NoGpu`] without a loader, an adapter or enough memory; what the source reports other than
    /// damage; a block or a lighting that is too large for one binding.
    pub fn new(source: &dyn FactorSource) -> Result<Self> {
        Self::with_settings(source, GpuSettings::default())
    }

    /// As [`new`](Self::new), with settings.
    ///
    /// Errors: as [`new`](Self::new).
    pub fn with_settings(source: &dyn FactorSource, settings: GpuSettings) -> Result<Self> {
        Self::on(Gpu::open()?, source, settings)
    }

    /// As [`with_settings`](Self::with_settings), on a device that is open already. What the device reports outside
    /// calls of this type goes to the handler that its owner has set.
    ///
    /// Errors: as [`new`](Self::new).
    pub fn on_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        source: &dyn FactorSource,
        settings: GpuSettings,
    ) -> Result<Self> {
        Self::on(Gpu::on_device(device, queue)?, source, settings)
    }

    fn on(gpu: Gpu, source: &dyn FactorSource, settings: GpuSettings) -> Result<Self> {
        let shape = source.shape();
        let limit = settings.binding_bytes.min(gpu.device.limits().max_storage_buffer_binding_size);
        let lighting_bytes = (shape.columns() * CHANNELS * 4) as u64;
        if lighting_bytes > limit {
            return Err(too_large("the lighting", lighting_bytes, limit));
        }
        let lighting = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("lighting"),
            size: lighting_bytes,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut relighter = Self {
            gpu,
            shape,
            lighting,
            banks: Vec::new(),
            places: Vec::with_capacity(shape.block_count() as usize),
            damage: Vec::new(),
            resident_bytes: lighting_bytes,
        };
        relighter.load(source, limit)?;
        Ok(relighter)
    }

    fn load(&mut self, source: &dyn FactorSource, limit: u64) -> Result<()> {
        let shape = self.shape;
        let ids: Vec<BlockId> = shape.blocks().collect();
        let mut bank = Bank::default();
        for batch in ids.chunks(BATCH) {
            let read: Vec<_> = batch
                .par_iter()
                .map(|&id| {
                    let readable = read_what_stands(source, id)?;
                    let block = readable.block.map(|block| CompactBlock::new(shape, id, &block)).transpose()?;
                    Ok((id, block, readable.damage.map(|damage| damage.to_string())))
                })
                .collect::<Result<_>>()?;
            for (id, block, damage) in read {
                self.damage.extend(damage);
                let Some(block) = block else {
                    self.places.push(None);
                    continue;
                };
                if bank.largest_with(&block) > limit {
                    self.upload(std::mem::take(&mut bank))?;
                }
                let largest = bank.largest_with(&block);
                if largest > limit {
                    return Err(too_large(&id.to_string(), largest, limit));
                }
                self.places.push(Some((self.banks.len(), bank.pixels)));
                bank.push(id, &block);
            }
        }
        self.upload(bank)
    }

    /// Puts a bank into GPU memory. An empty one is not kept.
    fn upload(&mut self, bank: Bank) -> Result<()> {
        if bank.blocks.is_empty() {
            return Ok(());
        }
        let device = &self.gpu.device;
        let sizes = Sizes {
            columns: self.shape.columns() as u32,
            components: bank.components.len() as u32,
            blocks: bank.blocks.len() as u32,
            sparse_rows: bank.sparse_rows.len() as u32,
        };
        let mut bytes_made = 0;
        let mut make = |label, contents: &[u8], usage| {
            bytes_made += contents.len() as u64;
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
        let image_bytes = 4 * CHANNELS as u64 * u64::from(bank.pixels);
        let projected_bytes = (4 * CHANNELS as u64 * u64::from(sizes.components)).max(16);
        let scratch = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let projected = scratch("projected", projected_bytes, storage);
        let image = scratch("image", image_bytes, storage | wgpu::BufferUsages::COPY_SRC);
        let readback = scratch("readback", image_bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let buffer = |name: &str| match name {
            "sizes" => &uniform,
            "lighting" => &self.lighting,
            "components" => &components,
            "blocks" => &blocks,
            "factors" => &factors,
            "rows" => &rows,
            "entries" => &entries,
            "projected" => &projected,
            "image" => &image,
            other => unreachable!("a test holds the kernels to these names, not {other}"),
        };
        let most = device.limits().max_compute_workgroups_per_dimension;
        // A row of workgroups as long as the device takes, and as many rows as needed.
        let spread = |count: u32| [count.min(most), count.div_ceil(most), 1];
        let passes = KERNELS.iter().zip(&self.gpu.pipelines).map(|(kernel, pipeline)| {
            let groups = match kernel.name {
                "project" => spread(sizes.components),
                "scatter" => spread(sizes.sparse_rows.div_ceil(THREADS)),
                _ => {
                    let [down, deep, _] = spread(sizes.blocks);
                    [bank.max_pixels.div_ceil(4).div_ceil(THREADS), down, deep]
                }
            };
            let entries: Vec<_> = (0..)
                .zip(kernel.bindings)
                .map(|(binding, name)| wgpu::BindGroupEntry { binding, resource: buffer(name).as_entire_binding() })
                .collect();
            let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(kernel.name),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            (!groups.contains(&0)).then_some((bindings, groups))
        });
        let passes = passes.collect();
        self.resident_bytes += bytes_made + image_bytes + projected_bytes;
        self.banks.push(ResidentBank { image, readback, passes });
        self.gpu.check()
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// Name of the adapter and its driver's interface, as in "llvmpipe (Vulkan)".
    pub fn adapter(&self) -> String {
        format!("{} ({})", self.gpu.adapter.name, self.gpu.adapter.backend)
    }

    /// Whether the adapter is a processor in disguise, which the CPU path outruns.
    pub fn is_software(&self) -> bool {
        self.gpu.adapter.device_type == wgpu::DeviceType::Cpu
    }

    /// One line for each block that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> &[String] {
        &self.damage
    }

    /// Bytes of GPU memory that the matrix takes, images included.
    pub fn resident_bytes(&self) -> u64 {
        self.resident_bytes
    }

    /// Number of banks that the blocks were gathered into.
    pub fn bank_count(&self) -> usize {
        self.banks.len()
    }

    /// The image under `lighting`.
    ///
    /// Errors: a lighting with another number of columns than the matrix, and [`Error::NoGpu`] where the device fails.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        self.submit(lighting, true)?;
        for bank in &self.banks {
            bank.readback.map_async(wgpu::MapMode::Read, .., |_| ());
        }
        self.gpu.wait()?;
        let image = self.gather();
        self.banks.iter().for_each(|bank| bank.readback.unmap());
        image
    }

    /// Relights and waits, leaving the image in GPU memory: what a display would cost.
    ///
    /// Errors: as [`relight`](Self::relight).
    pub fn relight_resident(&self, lighting: &Lighting) -> Result<()> {
        self.submit(lighting, false)?;
        self.gpu.wait()
    }

    fn submit(&self, lighting: &Lighting, read_back: bool) -> Result<()> {
        check_columns(self.shape, lighting)?;
        let planes: Vec<f32> = (0..CHANNELS).flat_map(|channel| lighting.channel(channel)).collect();
        self.gpu.queue.write_buffer(&self.lighting, 0, bytemuck::cast_slice(&planes));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            for (kernel, pipeline) in self.gpu.pipelines.iter().enumerate() {
                pass.set_pipeline(pipeline);
                for (bindings, [x, y, z]) in self.banks.iter().filter_map(|bank| bank.passes[kernel].as_ref()) {
                    pass.set_bind_group(0, bindings, &[]);
                    pass.dispatch_workgroups(*x, *y, *z);
                }
            }
        }
        if read_back {
            for bank in &self.banks {
                encoder.copy_buffer_to_buffer(&bank.image, 0, &bank.readback, 0, None);
            }
        }
        self.gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Sets the pixels of the image from the banks, whose buffers are mapped.
    fn gather(&self) -> Result<LinearImage> {
        let mapped: Vec<_> = self
            .banks
            .iter()
            .map(|bank| bank.readback.get_mapped_range(..))
            .collect::<Result<_, _>>()
            .map_err(|e| Error::NoGpu(format!("{}: the image cannot be read ({e})", self.gpu.adapter.name)))?;
        let pixels: Vec<&[[f32; CHANNELS]]> = mapped.iter().map(|bytes| bytemuck::cast_slice(bytes)).collect();
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        for_each_tile(&mut image, self.shape, |mut tile| {
            match self.places[tile.id.index()] {
                Some((bank, first)) => tile.copy(&pixels[bank][first as usize..]),
                None => tile.mark_as_hole(),
            }
            Ok::<_, Error>(())
        })?;
        Ok(image)
    }
}

fn too_large(what: &str, needed: u64, limit: u64) -> Error {
    Error::Resources {
        what: format!("{what} on the GPU"),
        needed: format!("{needed} bytes in one binding"),
        available: format!("the limit is {limit}"),
        hint: "relight on the CPU".into(),
    }
}
