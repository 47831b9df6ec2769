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

/// Relights a container under each lighting. Also says, as text, what did it.
///
/// Errors: those of reading the container; [`Error::NoGpu`] if a GPU is demanded and there is none.
pub fn relight(
    source: &dyn FactorSource,
    lightings: &[Lighting],
    device: Device,
    watch: &dyn Watch,
) -> Result<(Vec<LinearImage>, String)> {
    if device != Device::Cpu {
        match GpuRelighter::new(source) {
            // A driver that computes on the CPU is slower than our own code there.
            Ok(gpu) if device == Device::Auto && gpu.is_software() => {
                watch.note(&format!("the only adapter is a software one ({}); relighting on the CPU", gpu.adapter()));
            }
            Ok(gpu) => {
                let images = lightings.iter().map(|lighting| gpu.relight(lighting)).collect::<Result<_>>()?;
                return Ok((images, format!("GPU ({})", gpu.adapter())));
            }
            Err(Error::NoGpu(reason)) if device == Device::Auto => {
                watch.note(&format!("no GPU ({reason}); relighting on the CPU"));
            }
            Err(error) => return Err(error),
        }
    }
    let cpu = CpuRelighter::load(source)?;
    let images = lightings.iter().map(|lighting| cpu.relight(lighting)).collect::<Result<_>>()?;
    Ok((images, format!("CPU ({} threads)", rayon::current_num_threads())))
}
