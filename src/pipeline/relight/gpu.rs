//! Relighting on a GPU that holds all factors or pages them.

use super::RelightOptions;
use crate::container::ContainerReader;
use crate::error::Result;
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::relight::{GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter};
use crate::resources::human_bytes;

/// A relighter on a GPU.
pub(super) enum OnGpu<'a> {
    Resident(Box<GpuRelighter>),
    Paged(Box<PagedGpuRelighter<'a>>),
}

impl<'a> OnGpu<'a> {
    /// Opens the adapter and, without a budget, loads all factors. Errors: [`NoGpu`](crate::Error::NoGpu), and those of
    /// reading the container.
    pub(super) fn open(
        container: &'a ContainerReader,
        options: &RelightOptions,
        paged: &dyn Fn() -> PagedRelighter<'a>,
    ) -> Result<Self> {
        match (options.gpu_memory_bytes, options.memory_bytes) {
            (None, None) => GpuRelighter::new(container).map(|gpu| Self::Resident(Box::new(gpu))),
            (bytes, _) => PagedGpuRelighter::new(paged(), bytes.unwrap_or(u64::MAX), GpuSettings::default())
                .map(|gpu| Self::Paged(Box::new(gpu))),
        }
    }

    pub(super) fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        match self {
            Self::Resident(gpu) => gpu.relight(lighting),
            Self::Paged(gpu) => gpu.relight(lighting),
        }
    }

    pub(super) fn adapter(&self) -> String {
        match self {
            Self::Resident(gpu) => gpu.adapter(),
            Self::Paged(gpu) => gpu.adapter(),
        }
    }

    /// Whether the adapter is a software renderer on the CPU.
    pub(super) fn is_software(&self) -> bool {
        match self {
            Self::Resident(gpu) => gpu.is_software(),
            Self::Paged(gpu) => gpu.is_software(),
        }
    }

    /// Name of the adapter, and how much of its memory is used.
    pub(super) fn description(&self) -> String {
        match self {
            Self::Resident(gpu) => format!("GPU ({})", gpu.adapter()),
            Self::Paged(gpu) => {
                format!("GPU ({}, at most {} of its memory)", gpu.adapter(), human_bytes(gpu.peak_bytes()))
            }
        }
    }

    /// See [`Relighter::damage`](super::Relighter::damage).
    pub(super) fn damage(&self) -> Vec<String> {
        match self {
            Self::Resident(gpu) => gpu.damage().to_vec(),
            Self::Paged(gpu) => gpu.host().damage(),
        }
    }

    /// The pager of factors, if not all of them fit.
    pub(super) fn host(&self) -> Option<&PagedRelighter<'a>> {
        match self {
            Self::Resident(_) => None,
            Self::Paged(gpu) => Some(gpu.host()),
        }
    }
}
