//! Relighting on a GPU, and whether it is the faster way.

use std::mem;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ltm::container::ContainerReader;
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::matrix::{CHANNELS, FactorSource, PixelRect};
use ltm::relight::{GpuAdapter, GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter};
use ltm::resources::budget_bytes;
use ltm::{Error, Result};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::unlocked;
use crate::threads::on_pool;

/// The adapter that a process found, by the process's id: a driver does not outlive a fork.
static FOUND: Mutex<Option<(u32, Option<GpuAdapter>)>> = Mutex::new(None);

/// Where to relight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Device {
    Auto,
    Cpu,
    Gpu,
}

impl Device {
    pub(crate) fn parse(name: &str) -> PyResult<Self> {
        match name {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu),
            _ => Err(PyValueError::new_err(format!("device: '{name}' is none of auto, cpu, gpu"))),
        }
    }
}

/// The adapter of this process, looked for once. Errors: [`Error::NoGpu`] where there is none, or where the process that
/// this one was forked from has used the driver.
pub(crate) fn adapter() -> Result<GpuAdapter> {
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    match &*found {
        Some((id, _)) if *id != process::id() => {
            return Err(Error::NoGpu("this process was forked from one that has used the GPU; spawn it".into()));
        }
        Some((_, Some(adapter))) => return Ok(adapter.clone()),
        // An adapter that was not there is looked for again: its error says why it is not.
        Some((_, None)) | None => {}
    }
    let now = GpuAdapter::find();
    *found = Some((process::id(), now.as_ref().ok().cloned()));
    now
}

/// The adapter that `device="gpu"` runs on: its name and whether it is a software one; None where there is none.
#[pyfunction]
pub(crate) fn gpu(py: Python<'_>) -> PyResult<Option<(String, bool)>> {
    unlocked(py, || match on_pool(adapter) {
        Ok(GpuAdapter { name, is_software }) => Ok(Some((name, is_software))),
        Err(Error::NoGpu(_)) => Ok(None),
        Err(error) => Err(error),
    })
}

/// The factors of a container in GPU memory, as far as they fit.
pub(crate) struct OnGpu {
    /// There until it is dropped.
    kind: Option<Kind>,
    process: u32,
}

enum Kind {
    Resident(Box<GpuRelighter>),
    Paged(Box<PagedGpuRelighter<'static>>),
}

impl OnGpu {
    /// Uploads all factors where no budget is given, else as far as the budgets go as they are asked for.
    pub(crate) fn open(
        container: &Arc<ContainerReader>,
        memory_bytes: Option<u64>,
        gpu_memory_bytes: Option<u64>,
    ) -> Result<Self> {
        adapter()?;
        let kind = if memory_bytes.is_none() && gpu_memory_bytes.is_none() {
            Kind::Resident(Box::new(GpuRelighter::new(&**container)?))
        } else {
            let source: Arc<dyn FactorSource> = container.clone();
            let host = PagedRelighter::sharing(source, budget_bytes(memory_bytes));
            let bytes = gpu_memory_bytes.unwrap_or(u64::MAX);
            Kind::Paged(Box::new(PagedGpuRelighter::new(host, bytes, GpuSettings::default())?))
        };
        Ok(Self { kind: Some(kind), process: process::id() })
    }

    fn image(&self, lighting: &Lighting) -> Result<LinearImage> {
        if self.process != process::id() {
            return Err(Error::NoGpu("the matrix was opened on the GPU before this process was forked".into()));
        }
        match &self.kind {
            Some(Kind::Resident(gpu)) => gpu.relight(lighting),
            Some(Kind::Paged(gpu)) => gpu.relight(lighting),
            None => Err(Error::NoGpu("the matrix is closed".into())),
        }
    }

    /// Sets the pixels of a region under each lighting; the whole image is relit for it.
    pub(crate) fn relight(
        &self,
        lightings: &[Lighting],
        region: PixelRect,
        pixels: &mut [[f32; CHANNELS]],
    ) -> Result<()> {
        let (x, width) = (region.x as usize, region.width as usize);
        for (lighting, target) in lightings.iter().zip(pixels.chunks_exact_mut(width * region.height as usize)) {
            let image = self.image(lighting)?;
            let rows = image.pixels.chunks_exact(image.width as usize).skip(region.y as usize);
            target.chunks_exact_mut(width).zip(rows).for_each(|(to, from)| to.copy_from_slice(&from[x..x + width]));
        }
        Ok(())
    }

    /// Whether some of what was looked at so far is damaged.
    pub(crate) fn is_damaged(&self) -> bool {
        match &self.kind {
            Some(Kind::Resident(gpu)) => !gpu.damage().is_empty(),
            Some(Kind::Paged(gpu)) => !gpu.host().damage().is_empty(),
            None => false,
        }
    }
}

impl Drop for OnGpu {
    fn drop(&mut self) {
        // In a forked child the driver's threads are not there to be waited for.
        if self.process != process::id() {
            mem::forget(self.kind.take());
        }
    }
}

/// The time of a second run: the first brings what is needed to where it is needed.
pub(crate) fn second_run(mut work: impl FnMut() -> Result<()>) -> Result<Duration> {
    work()?;
    let begun = Instant::now();
    work()?;
    Ok(begun.elapsed())
}
