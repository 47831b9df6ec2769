//! `.ltc` + lighting → image.

use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::FactorSource;
use crate::relight::{CpuRelighter, GpuRelighter};

use super::Watch;

/// Where to relight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The GPU if there is a real one, else the CPU, saying so.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// The GPU, or an error.
    Gpu,
}

/// How to relight.
#[derive(Clone, Copy, Debug, Default)]
pub struct RelightOptions {
    /// Where.
    pub device: Device,
}

/// A container that is ready to be relit any number of times.
pub struct Relighter {
    kind: Kind,
}

enum Kind {
    Cpu(CpuRelighter),
    Gpu(Box<GpuRelighter>),
}

impl Relighter {
    /// Reads a container's factors to where they will be used. Damaged blocks are noted to `watch` and shown by what
    /// stands of them.
    ///
    /// Errors: those of reading the container; [`Error::NoGpu`] if a GPU is demanded and there is none.
    pub fn open(source: &dyn FactorSource, options: RelightOptions, watch: &dyn Watch) -> Result<Self> {
        let kind = match gpu(source, options.device, watch)? {
            Some(gpu) => Kind::Gpu(Box::new(gpu)),
            None => Kind::Cpu(CpuRelighter::load(source)?),
        };
        let relighter = Self { kind };
        relighter.damage().iter().for_each(|line| watch.note(line));
        Ok(relighter)
    }

    /// The image under a lighting. Errors: those of the relighters.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        match &self.kind {
            Kind::Cpu(cpu) => cpu.relight(lighting),
            Kind::Gpu(gpu) => gpu.relight(lighting),
        }
    }

    /// One line for each block that is shown with fewer layers than it has, or as a hole.
    pub fn damage(&self) -> &[String] {
        match &self.kind {
            Kind::Cpu(cpu) => cpu.damage(),
            Kind::Gpu(gpu) => gpu.damage(),
        }
    }

    /// What does the work, for people.
    pub fn description(&self) -> String {
        match &self.kind {
            Kind::Cpu(_) => format!("CPU ({} threads)", rayon::current_num_threads()),
            Kind::Gpu(gpu) => format!("GPU ({})", gpu.adapter()),
        }
    }
}

/// The GPU if it is wanted and there is one that is faster than the CPU.
fn gpu(source: &dyn FactorSource, device: Device, watch: &dyn Watch) -> Result<Option<GpuRelighter>> {
    if device == Device::Cpu {
        return Ok(None);
    }
    match GpuRelighter::new(source) {
        // A driver that computes on the CPU is slower than our own code there.
        Ok(gpu) if device == Device::Auto && gpu.is_software() => {
            watch.note(&format!("the only adapter is a software one ({}); relighting on the CPU", gpu.adapter()));
            Ok(None)
        }
        Ok(gpu) => Ok(Some(gpu)),
        Err(Error::NoGpu(reason)) if device == Device::Auto => {
            watch.note(&format!("no GPU ({reason}); relighting on the CPU"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Relights a container under each lighting. Also says, as text, what did it.
///
/// Errors: as [`Relighter::open`] and [`Relighter::relight`].
pub fn relight(
    source: &dyn FactorSource,
    lightings: &[Lighting],
    device: Device,
    watch: &dyn Watch,
) -> Result<(Vec<LinearImage>, String)> {
    let relighter = Relighter::open(source, RelightOptions { device }, watch)?;
    let images = lightings.iter().map(|lighting| relighter.relight(lighting)).collect::<Result<_>>()?;
    Ok((images, relighter.description()))
}
