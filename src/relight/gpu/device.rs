//! An adapter, a device and the compiled kernels.

use std::sync::{Arc, Mutex};

use super::kernels::{KERNELS, Kernel, PROJECT_SUBGROUPS};
use crate::error::{Error, Result};

/// A GPU ready to run the kernels.
pub(super) struct Gpu {
    pub adapter: wgpu::AdapterInfo,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub pipelines: Vec<wgpu::ComputePipeline>,
    /// Whether the kernels sum within subgroups.
    pub subgroups: bool,
    /// The error that the driver reported asynchronously, outside our calls.
    complaint: Arc<Mutex<Option<String>>>,
}

/// The adapter that [`GpuRelighter`](super::GpuRelighter) would use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuAdapter {
    /// Its name and its driver's interface, as in "llvmpipe (Vulkan)".
    pub name: String,
    /// Whether it computes on the processor (llvmpipe, WARP), slower than the CPU path.
    pub is_software: bool,
}

impl GpuAdapter {
    /// Looks for the most powerful adapter, without opening it.
    ///
    /// # Errors
    /// [`Error::NoGpu`] without a loader or an adapter.
    pub fn find() -> Result<Self> {
        let info = find_adapter()?.get_info();
        Ok(Self::of(&info))
    }

    /// Every adapter, each with its driver's name and version in the driver's own words.
    pub fn all() -> Vec<(Self, String)> {
        let adapters = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::PRIMARY));
        let described = |info: wgpu::AdapterInfo| {
            let driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
            (Self::of(&info), driver)
        };
        adapters.iter().map(|adapter| described(adapter.get_info())).collect()
    }

    fn of(info: &wgpu::AdapterInfo) -> Self {
        Self { name: name_of(info), is_software: is_software(info) }
    }
}

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    wgpu::Instance::new(descriptor)
}

fn find_adapter() -> Result<wgpu::Adapter> {
    let instance = instance();
    let options =
        wgpu::RequestAdapterOptions { power_preference: wgpu::PowerPreference::HighPerformance, ..Default::default() };
    pollster::block_on(instance.request_adapter(&options))
        .map_err(|e| Error::NoGpu(format!("no adapter was found ({}); relighting on the CPU works", line(&e))))
}

fn name_of(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({})", info.name, info.backend)
}

fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == wgpu::DeviceType::Cpu
}

impl Gpu {
    /// Opens the most powerful adapter with the default limits of WebGPU, which every adapter has, and with subgroups if
    /// they are wanted and offered.
    pub(super) fn open(subgroups: bool) -> Result<Self> {
        let adapter = find_adapter()?;
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("relight"),
            required_features: adapter.features() & wgpu::Features::SUBGROUP,
            required_limits: wgpu::Limits::default(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| Error::NoGpu(format!("{} cannot be opened ({})", info.name, line(&e))))?;
        let complaint = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&complaint);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            sink.lock().expect("no thread panics with it").get_or_insert(line(&error));
        }));
        Self::with(device, queue, subgroups, complaint)
    }

    /// Uses a device that others use too, whose errors go where they have set.
    pub(super) fn on_device(device: wgpu::Device, queue: wgpu::Queue, subgroups: bool) -> Result<Self> {
        Self::with(device, queue, subgroups, Arc::default())
    }

    fn with(
        device: wgpu::Device,
        queue: wgpu::Queue,
        subgroups: bool,
        complaint: Arc<Mutex<Option<String>>>,
    ) -> Result<Self> {
        let subgroups = subgroups && device.features().contains(wgpu::Features::SUBGROUP);
        let mut kernels = KERNELS.map(|(kernel, _)| kernel);
        if subgroups {
            kernels[0] = PROJECT_SUBGROUPS;
        }
        let pipelines = kernels.iter().map(|kernel| compile(&device, kernel)).collect();
        let gpu = Self { adapter: device.adapter_info(), device, queue, pipelines, subgroups, complaint };
        gpu.check()?;
        Ok(gpu)
    }

    /// Name of the adapter and its driver's interface.
    pub(super) fn name(&self) -> String {
        name_of(&self.adapter)
    }

    /// Whether the adapter is a software renderer on the CPU.
    pub(super) fn is_software(&self) -> bool {
        is_software(&self.adapter)
    }

    /// A new command encoder.
    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Errors if the driver has complained since the last call.
    pub(super) fn check(&self) -> Result<()> {
        match self.complaint.lock().expect("no thread panics with it").take() {
            Some(complaint) => Err(Error::NoGpu(format!("{} failed ({complaint})", self.adapter.name))),
            None => Ok(()),
        }
    }

    /// Waits until a submission is done, and what was to be mapped after it is.
    pub(super) fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<()> {
        // Others may use the queue too: what they have submitted since is not waited for.
        self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })
    }

    fn poll(&self, until: wgpu::PollType) -> Result<()> {
        self.device
            .poll(until)
            .map_err(|e| Error::NoGpu(format!("{} stopped answering ({})", self.adapter.name, line(&e))))?;
        self.check()
    }
}

pub(super) fn compile<B>(device: &wgpu::Device, kernel: &Kernel<B>) -> wgpu::ComputePipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(kernel.name),
        source: wgpu::ShaderSource::Wgsl(kernel.source.into()),
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(kernel.name),
        layout: None,
        module: &module,
        entry_point: Some(kernel.name),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// An error as one line.
fn line(error: &dyn std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
