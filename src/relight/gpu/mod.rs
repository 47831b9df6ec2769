//! Relighting on the GPU: factors stay quantised in its memory and are dequantised in the kernels of `shaders/`.
//!
//! The only place that knows wgpu. Works within the default limits of WebGPU: blocks are gathered into *banks* none of
//! whose arrays exceeds one binding (128 MiB).

mod bank;
mod device;
mod gather;
mod kernels;
mod paged;
mod resident;
mod screen;
mod staging;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::cpu::{check_columns, check_size};
use super::damage::read_compact;
use super::tiles::for_each_tile;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, ColumnTransform, FactorSource, MatrixShape};
use bank::{Bank, Packed};
use device::Gpu;
use resident::{ResidentBank, SharedArrays, read_back, relight, submit, submit_copy};

pub use device::GpuAdapter;
pub use paged::PagedGpuRelighter;
pub use screen::{GpuScreen, ShownAs};

/// Blocks that are read in parallel before they are packed.
const BATCH: usize = 64;

/// Settings of a [`GpuRelighter`].
#[derive(Clone, Copy, Debug)]
pub struct GpuSettings {
    /// Largest array in bytes; what the device can bind is an upper bound.
    pub binding_bytes: u64,
    /// Whether threads add up within their subgroups where the device offers that.
    pub subgroups: bool,
}

impl Default for GpuSettings {
    fn default() -> Self {
        Self { binding_bytes: u64::MAX, subgroups: true }
    }
}

/// A matrix of factors resident in GPU memory. Threads may share it: calls take turns.
pub struct GpuRelighter {
    gpu: Gpu,
    shape: MatrixShape,
    shared: SharedArrays,
    banks: Vec<ResidentBank>,
    /// For each block its bank and first pixel there, none for a hole.
    places: Vec<Option<(usize, u32)>>,
    damage: Vec<String>,
    /// Held from setting the lighting until what it gives was read: the buffers serve one call at a time.
    turn: Mutex<()>,
}

impl GpuRelighter {
    /// Uploads all factors of `source`. A damaged block keeps the layers before the damage, or becomes a hole; see
    /// [`damage`](Self::damage).
    ///
    /// # Errors
    /// [`Error::NoGpu`] without a loader, an adapter or enough memory; what the source reports other than
    /// damage; a block or a lighting that is too large for one binding.
    pub fn new(source: &dyn FactorSource) -> Result<Self> {
        Self::with_settings(source, GpuSettings::default())
    }

    /// As [`new`](Self::new), with settings.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_settings(source: &dyn FactorSource, settings: GpuSettings) -> Result<Self> {
        Self::on(Gpu::open(settings.subgroups)?, source, settings)
    }

    /// As [`with_settings`](Self::with_settings), on a device that is open already. What the device reports outside
    /// calls of this type goes to the handler that its owner has set.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn on_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        source: &dyn FactorSource,
        settings: GpuSettings,
    ) -> Result<Self> {
        Self::on(Gpu::on_device(device, queue, settings.subgroups)?, source, settings)
    }

    fn on(gpu: Gpu, source: &dyn FactorSource, settings: GpuSettings) -> Result<Self> {
        let shape = source.shape();
        let transform = source.column_transform();
        let limit = binding_limit(&gpu, &transform, settings)?;
        let shared = SharedArrays::new(&gpu, &transform, source.column_scales());
        let places = vec![None; shape.block_count() as usize];
        let mut relighter =
            Self { gpu, shape, shared, banks: Vec::new(), places, damage: Vec::new(), turn: Mutex::new(()) };
        relighter.load(source, &transform, limit)?;
        Ok(relighter)
    }

    fn load(&mut self, source: &dyn FactorSource, transform: &ColumnTransform, limit: u64) -> Result<()> {
        let ids: Vec<BlockId> = self.shape.blocks().collect();
        let mut bank = Bank::default();
        for batch in ids.chunks(BATCH) {
            let read = batch.par_iter().map(|&id| {
                let (block, damage) = read_compact(source, transform, id)?;
                Ok((block.map(|block| Packed::new(id, &Arc::new(block), self.shared.firsts())), damage))
            });
            for (packed, damage) in read.collect::<Result<Vec<_>>>()? {
                self.damage.extend(damage);
                let Some(packed) = packed else { continue };
                let added = packed.lengths();
                if bank.lengths().plus(added).largest_bytes() > limit {
                    self.upload(std::mem::take(&mut bank))?;
                }
                if added.largest_bytes() > limit {
                    return Err(too_large(&packed.id.to_string(), added.largest_bytes(), limit));
                }
                bank.push(packed);
            }
        }
        self.upload(bank)?;
        // Nothing more will be sent.
        self.shared.staging().release();
        Ok(())
    }

    /// Puts a bank into GPU memory. An empty one is not kept.
    fn upload(&mut self, bank: Bank) -> Result<()> {
        if !bank.blocks.is_empty() {
            let (resident, _) = ResidentBank::upload(&self.gpu, &self.shared, &bank, |_, _| ())?;
            for &(id, first) in &resident.places {
                self.places[id.index()] = Some((self.banks.len(), first));
            }
            self.banks.push(resident);
        }
        Ok(())
    }

    /// Shape of the matrix.
    pub fn shape(&self) -> MatrixShape {
        self.shape
    }

    /// Name of the adapter and its driver's interface, as in "llvmpipe (Vulkan)".
    pub fn adapter(&self) -> String {
        self.gpu.name()
    }

    /// Whether the adapter is a software one (llvmpipe, WARP), slower than the CPU path.
    pub fn is_software(&self) -> bool {
        self.gpu.is_software()
    }

    /// Whether threads sum within their subgroups.
    pub fn uses_subgroups(&self) -> bool {
        self.gpu.subgroups
    }

    /// One line for each block that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> &[String] {
        &self.damage
    }

    /// Bytes of GPU memory that the matrix takes, images included.
    pub fn resident_bytes(&self) -> u64 {
        self.banks.iter().map(|bank| bank.bytes).sum::<u64>() + self.shared.bytes()
    }

    /// Number of banks that the blocks were gathered into.
    pub fn bank_count(&self) -> usize {
        self.banks.len()
    }

    /// The image under `lighting`.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix, and [`Error::NoGpu`] where the device fails.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        self.relight_into(lighting, &mut image)?;
        Ok(image)
    }

    /// As [`relight`](Self::relight), into an image that is at hand: making one can take longer than the rest.
    ///
    /// # Errors
    /// As [`relight`](Self::relight), and an image of another size than the matrix.
    pub fn relight_into(&self, lighting: &Lighting, image: &mut LinearImage) -> Result<()> {
        check_columns(self.shape, lighting)?;
        check_size(self.shape, image)?;
        let _turn = self.turn();
        self.shared.set(&self.gpu, lighting);
        let submission = submit(&self.gpu, &self.banks.iter().collect::<Vec<_>>());
        self.read(submission, image)
    }

    /// The image under the lighting of the newest call, read back once more; black before the first.
    ///
    /// # Errors
    /// [`Error::NoGpu`] where the device fails.
    pub fn radiance(&self) -> Result<LinearImage> {
        let _turn = self.turn();
        let mut image = LinearImage::black(self.shape.width(), self.shape.height());
        self.read(submit_copy(&self.gpu, self.banks.iter()), &mut image)?;
        Ok(image)
    }

    /// Sets an image to what a submission copies, once that is done.
    fn read(&self, submission: wgpu::SubmissionIndex, image: &mut LinearImage) -> Result<()> {
        self.gpu.wait_for(submission)?;
        let banks: Vec<&ResidentBank> = self.banks.iter().collect();
        read_back(&self.gpu, &banks, |images| {
            for_each_tile(image, self.shape, |mut tile| {
                match self.places[tile.id.index()] {
                    Some((bank, first)) => tile.copy(&images[bank][first as usize..]),
                    None => tile.mark_as_hole(),
                }
                Ok(())
            })
        })
    }

    /// Relights and waits, leaving the image in GPU memory: what a display would cost.
    ///
    /// # Errors
    /// As [`relight`](Self::relight).
    pub fn relight_resident(&self, lighting: &Lighting) -> Result<()> {
        check_columns(self.shape, lighting)?;
        let _turn = self.turn();
        self.shared.set(&self.gpu, lighting);
        self.run(|pass| relight(&self.gpu, pass, self.banks.iter()))
    }

    /// Waits until no other thread uses the buffers.
    fn turn(&self) -> MutexGuard<'_, ()> {
        // What a call that panicked left in the buffers is written anew by the next.
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs what one pass is given, and waits. The caller holds the turn.
    fn run(&self, fill: impl FnOnce(&mut wgpu::ComputePass)) -> Result<()> {
        let mut encoder = self.gpu.encoder();
        fill(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()));
        self.gpu.wait_for(self.gpu.queue.submit([encoder.finish()]))
    }
}

/// Bytes that one array may have. Errors: the lighting is larger.
fn binding_limit(gpu: &Gpu, transform: &ColumnTransform, settings: GpuSettings) -> Result<u64> {
    let limit = settings.binding_bytes.min(gpu.device.limits().max_storage_buffer_binding_size);
    match SharedArrays::lighting_bytes(transform) {
        bytes if bytes > limit => Err(too_large("the lighting", bytes, limit)),
        _ => Ok(limit),
    }
}

fn too_large(what: &str, needed: u64, limit: u64) -> Error {
    Error::Resources {
        what: format!("{what} on the GPU"),
        needed: format!("{needed} bytes"),
        available: format!("the limit is {limit}"),
        hint: "relight on the CPU".into(),
    }
}
