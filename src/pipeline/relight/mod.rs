//! Relighting of a container.

use std::path::Path;

#[cfg(feature = "gpu")]
mod gpu;
#[cfg(not(feature = "gpu"))]
mod no_gpu;
mod passes;

#[cfg(feature = "gpu")]
use self::gpu::OnGpu;
#[cfg(not(feature = "gpu"))]
use self::no_gpu::OnGpu;
pub use self::passes::{PASSES, passes_need_bytes, relight_passes};
use super::row_spill::{RowPlace, RowSpill};
use super::unpack::safe_names;
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::{self, ImageSize, LinearImage};
use crate::light::Lighting;
use crate::matrix::{BlockSource, CHANNELS, MatrixShape};
use crate::relight::{CpuRelighter, PagedRelighter, relight_raw};
use crate::resources::{Held, PerThread, Progress, ResourceEstimate, Threads, budget_bytes, human_bytes};
use crate::store::StoreReader;

/// The device to relight on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The GPU if there is a hardware adapter, otherwise the CPU with a note.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The GPU, or an error.
    Gpu,
}

/// Options of relighting.
#[derive(Clone, Copy, Debug, Default)]
pub struct RelightOptions {
    /// The device to use.
    pub device: Device,
    /// Limit of anonymous memory in bytes; `None` for the size of all factors, or less if the system has less.
    pub memory_bytes: Option<u64>,
    /// Part of that memory which the caller needs beside relighting one image.
    pub beside_bytes: u64,
    /// Limit of GPU memory in bytes; `None` for the size of all factors.
    pub gpu_memory_bytes: Option<u64>,
}

/// A container prepared to be relit any number of times.
pub struct Relighter<'a> {
    kind: Kind<'a>,
    threads: Threads,
}

enum Kind<'a> {
    Cpu(Box<CpuRelighter>),
    Paged(Box<PagedRelighter<'a>>),
    Gpu(OnGpu<'a>),
}

impl<'a> Relighter<'a> {
    /// Prepares a container for relighting. It uploads or reads all factors; with a budget they are read while
    /// relighting.
    ///
    /// # Errors
    /// Those of reading the container; [`Error::Resources`] for a budget in which not even one block can be
    /// decoded; [`Error::NoGpu`] if a GPU is demanded and there is none.
    pub fn open(container: &'a ContainerReader, options: RelightOptions, watch: &dyn Progress) -> Result<Self> {
        let image = Held(image_bytes(container.job().shape));
        let need = ResourceEstimate::of(&[container, &image, &Held(options.beside_bytes)]);
        let threads = need.threads_within("relighting", options.memory_bytes)?;
        let left = |bytes: u64| bytes.saturating_sub(need.bytes(threads));
        let too_small = |bytes: &u64| container.factors_bytes() > left(*bytes);
        let budget = options.memory_bytes.or_else(|| Some(budget_bytes(None)).filter(too_small));
        let paged = || PagedRelighter::new(container, budget.map_or(u64::MAX, left));
        let kind = match gpu(container, &options, &paged, watch)? {
            Some(gpu) => gpu,
            None if budget.is_some() => Kind::Paged(Box::new(paged())),
            None => Kind::Cpu(Box::new(CpuRelighter::load(container)?)),
        };
        Ok(Self { kind, threads: Threads::new(threads)? })
    }

    /// The image under a lighting.
    ///
    /// # Errors
    /// Those of the relighters.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        self.threads.run(|| match &self.kind {
            Kind::Cpu(cpu) => cpu.relight(lighting),
            Kind::Paged(paged) => paged.relight(lighting),
            Kind::Gpu(gpu) => gpu.relight(lighting),
        })
    }

    /// One line for each block that has fewer layers than it should, or none. With a budget, only of blocks that were
    /// read.
    pub fn damage(&self) -> Vec<String> {
        match &self.kind {
            Kind::Cpu(cpu) => cpu.damage().to_vec(),
            Kind::Paged(paged) => paged.damage(),
            Kind::Gpu(gpu) => gpu.damage(),
        }
    }

    /// The device that did the work, for people.
    pub fn description(&self) -> String {
        let cpu = match self.threads.count() {
            1 => "CPU (1 thread)".to_owned(),
            threads => format!("CPU ({threads} threads)"),
        };
        let of_pages = |paged: &PagedRelighter| {
            let (reads, kept) = (paged.reads(), paged.resident_bytes());
            format!("{} chunks ({}) read, {} kept", reads.chunks, human_bytes(reads.bytes), human_bytes(kept))
        };
        match &self.kind {
            Kind::Cpu(_) => cpu,
            Kind::Paged(paged) => format!("{cpu}, {}", of_pages(paged)),
            Kind::Gpu(gpu) => match gpu.host() {
                Some(paged) => format!("{}, {}", gpu.description(), of_pages(paged)),
                None => gpu.description(),
            },
        }
    }
}

/// The GPU, if it is wanted and faster than the CPU.
fn gpu<'a>(
    container: &'a ContainerReader,
    options: &RelightOptions,
    paged: &dyn Fn() -> PagedRelighter<'a>,
    watch: &dyn Progress,
) -> Result<Option<Kind<'a>>> {
    if options.device == Device::Cpu {
        return Ok(None);
    }
    match OnGpu::open(container, options, paged) {
        // A software renderer is slower than our own CPU code.
        Ok(gpu) if gpu.is_software() && options.device == Device::Auto => {
            watch.note(&format!("the only adapter is a software one ({}); relighting on the CPU", gpu.adapter()));
            Ok(None)
        }
        Ok(gpu) => Ok(Some(Kind::Gpu(gpu))),
        Err(Error::NoGpu(reason)) if options.device == Device::Auto => {
            watch.note(&format!("no GPU ({reason}); relighting on the CPU"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Bytes of the image and of its encoder.
fn image_bytes(shape: MatrixShape) -> u64 {
    3 * shape.rows() * 4
}

/// Writes one layer for each name into one OpenEXR file at `path`: the images that `relight` returns for their indices,
/// in order, and the one after the last as the picture without a layer (`R`, `G`, `B`), which compositors show first. The images are kept in a
/// temporary file beside it, so that memory holds one of them plus [`relit_layers_need_bytes`]. Characters in names that other
/// programs cannot read are replaced.
///
/// # Errors
/// Those of `relight`; the system refuses to write.
pub fn write_relit_layers(
    path: &Path,
    shape: MatrixShape,
    names: &[String],
    relight: &mut dyn FnMut(usize) -> Result<LinearImage>,
) -> Result<()> {
    let size = ImageSize { width: shape.width() as usize, height: shape.height() as usize };
    let spill = RowSpill::create(path, names.len() + 1, size.width, size.height)?;
    let mut row = vec![0.0; size.width];
    for index in 0..=names.len() {
        let image = relight(index)?;
        for (y, pixels) in image.pixels.chunks_exact(size.width).enumerate() {
            for channel in 0..CHANNELS {
                row.iter_mut().zip(pixels).for_each(|(value, pixel)| *value = pixel[channel]);
                spill.write(RowPlace { image: index, channel, y, x: 0 }, &row)?;
            }
        }
    }
    let mut layers = safe_names(names.iter().map(String::as_str));
    layers.push(String::new());
    image::write_exr_rows(path, true, &layers, size, &mut |layer, channel, y, row| {
        spill.read(RowPlace { image: layer, channel, y, x: 0 }, row)
    })
}

/// Upper bound of the bytes of memory that [`write_relit_layers`] takes beside an image.
pub fn relit_layers_need_bytes(layers: usize, shape: MatrixShape) -> u64 {
    image::exr_rows_need_bytes(layers + 1, ImageSize { width: shape.width() as usize, height: shape.height() as usize })
}

/// Relights a container under each lighting. Also returns the name of the device, for people. Damage is reported to
/// `watch`.
///
/// # Errors
/// As [`Relighter::open`] and [`Relighter::relight`].
pub fn relight(
    container: &ContainerReader,
    lightings: &[Lighting],
    options: RelightOptions,
    watch: &dyn Progress,
) -> Result<(Vec<LinearImage>, String)> {
    let relighter = Relighter::open(container, options, watch)?;
    let images = lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<_>>()?;
    relighter.damage().iter().for_each(|line| watch.note(line));
    Ok((images, relighter.description()))
}

/// The direct product with a stored matrix on the CPU, on as many threads as blocks fit into the memory given.
///
/// # Errors
/// Those of reading the matrix; [`Error::Resources`] where not even one block fits.
pub fn relight_matrix(matrix: &StoreReader, lighting: &Lighting, options: RelightOptions) -> Result<LinearImage> {
    let shape = BlockSource::shape(matrix);
    // A block with its noise, as stored and as multiplied, and its sums.
    let block = PerThread(shape.max_block_bytes() + 8 * shape.max_block_rows() as u64);
    let need = ResourceEstimate::of(&[matrix, &block, &Held(image_bytes(shape)), &Held(options.beside_bytes)]);
    let threads = Threads::new(need.threads_within("relighting", options.memory_bytes)?)?;
    threads.run(|| Ok(relight_raw(matrix, std::slice::from_ref(lighting))?.remove(0)))
}
