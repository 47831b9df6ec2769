//! A GPU against its own memory and its own bus, in one run: bytes that a kernel reads of its memory, bytes that are sent to
//! it and come back, images relit from factors that it holds, and from factors that pass through a tenth of the memory that they
//! take. One table; an adapter that computes on the processor is called software, and its figures tell nothing of a GPU.
//!
//! The matrices: random factors in 16 bits, in blocks of 32 × 32 pixels: of 1024 × 768 pixels 1,024 columns at rank 8, and 4,096 at
//! rank 32; these of 3840 × 2160 pixels too, where the adapter is not software (13 GB of the host's memory); and the containers that
//! `LTM_BENCH_CONTAINER` names, with `:` between them. Errors are against the CPU's image of the same factors. `tools/gpu.sh` runs
//! this after the tests. For the paper's Conference Room, with the folder that holds it in `LTM_SCENES`:
//!
//! ```text
//! ltm render examples/scenes/conference-20.toml --samples 16 -o twenty.ltm && ltm-pack twenty.ltm
//! ltm render examples/scenes/conference-panel-32.toml --samples 16 -o panel.ltm && ltm-pack panel.ltm
//! LTM_BENCH_CONTAINER=$PWD/twenty.ltc:$PWD/panel.ltc cargo bench --bench gpu
//! ```

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

mod figures;
#[path = "../tests/relight_source/mod.rs"]
mod relight_source;

use std::time::Instant;

use figures::Figures;
use ltm::container::ContainerReader;
use ltm::image::{LinearImage, compare};
use ltm::matrix::FactorSource;
use ltm::relight::{CpuRelighter, Detail, GpuAdapter, GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter};
use rayon::prelude::*;
use relight_source::{Recipe, random_lighting};

/// Of one reading, and of one sending.
const MOVED_BYTES: u64 = 512 << 20;
/// Bytes of each buffer through which they are sent. Tuned: decision 40.
const STAGED_BYTES: u64 = 8 << 20;
const STAGED: usize = 3;
/// Random matrices: name, pixels, columns and rank.
const RANDOM: [(&str, (u32, u32), u32, usize); 3] = [
    ("random 1024", (1024, 768), 1024, 8),
    ("random 4096", (1024, 768), 4096, 32),
    ("random 4096, 4K", (3840, 2160), 4096, 32),
];
/// Names containers to relight.
const CONTAINERS: &str = "LTM_BENCH_CONTAINER";
/// What it is run by.
const COMMAND: &str = "cargo bench --bench gpu";

/// Reads all of an array, and writes where the sum is what it never is.
const READ: &str = "
@group(0) @binding(0) var<storage, read> words: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> sum: array<u32>;
@compute @workgroup_size(256)
fn add_up(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    var total = vec4<u32>(0u);
    for (var i = id.x; i < arrayLength(&words); i += 256u * groups.x) {
        total += words[i];
    }
    if total.x + total.y + total.z + total.w == 1u {
        sum[0] = total.x;
    }
}";

/// Mean seconds of one call over about a second of calls, the first not counted.
fn mean_secs(mut call: impl FnMut()) -> f64 {
    call();
    let (start, mut calls) = (Instant::now(), 0);
    while start.elapsed().as_secs_f64() < 1.0 {
        call();
        calls += 1;
    }
    start.elapsed().as_secs_f64() / f64::from(calls)
}

fn device() -> (wgpu::Device, wgpu::Queue) {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let options =
        wgpu::RequestAdapterOptions { power_preference: wgpu::PowerPreference::HighPerformance, ..Default::default() };
    let adapter = pollster::block_on(wgpu::Instance::new(descriptor).request_adapter(&options)).unwrap();
    let descriptor = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
    pollster::block_on(adapter.request_device(&descriptor)).unwrap()
}

/// Bytes a second.
struct Rates {
    /// That a kernel reads of the GPU's memory.
    memory: f64,
    /// That come from the host's memory into the GPU's, and back.
    sent: f64,
    back: f64,
}

impl Rates {
    fn measure() -> Self {
        let (device, queue) = device();
        let data: Vec<u32> = (0..MOVED_BYTES as u32 / 4).map(|i| i.wrapping_mul(0x9e37_79b9)).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let moved = buffer(&device, usage, MOVED_BYTES, false);
        let sent = sending(&device, &queue, &moved, bytemuck::cast_slice(&data));
        Self { memory: reading(&device, &queue, &moved), sent, back: coming_back(&device, &queue, &moved) }
    }
}

fn buffer(device: &wgpu::Device, usage: wgpu::BufferUsages, size: u64, mapped_at_creation: bool) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation })
}

fn wait(device: &wgpu::Device) {
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
}

/// Through a few mapped buffers in turns, each filled by all threads while others are emptied. Filling alone is faster yet.
fn sending(device: &wgpu::Device, queue: &wgpu::Queue, target: &wgpu::Buffer, data: &[u8]) -> f64 {
    let usage = wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC;
    let staged: [_; STAGED] = std::array::from_fn(|_| buffer(device, usage, STAGED_BYTES, true));
    let mut emptied: [Option<wgpu::SubmissionIndex>; STAGED] = Default::default();
    let secs = mean_secs(|| {
        for (i, part) in data.chunks(STAGED_BYTES as usize).enumerate() {
            let from = &staged[i % STAGED];
            if let Some(submission) = emptied[i % STAGED].take() {
                device.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None }).unwrap();
            }
            let mut mapped = from.get_mapped_range_mut(..).unwrap();
            let stripes: Vec<_> = mapped.slice(..).into_chunks::<65_536>().0.into_iter().collect();
            stripes.into_par_iter().zip(part.par_chunks(65_536)).for_each(|(stripe, part)| {
                wgpu::WriteOnly::<[u8]>::from(stripe).copy_from_slice(part);
            });
            drop(mapped);
            from.unmap();
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(from, 0, target, i as u64 * STAGED_BYTES, STAGED_BYTES);
            emptied[i % STAGED] = Some(queue.submit([encoder.finish()]));
            from.map_async(wgpu::MapMode::Write, .., |_| ());
        }
        wait(device);
    });
    data.len() as f64 / secs
}

/// By a kernel, in the largest pieces that one binding takes, often enough that submitting does not count.
fn reading(device: &wgpu::Device, queue: &wgpu::Queue, moved: &wgpu::Buffer) -> f64 {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(READ.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("add_up"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let sum = buffer(device, wgpu::BufferUsages::STORAGE, 16, false);
    let piece = MOVED_BYTES.min(device.limits().max_storage_buffer_binding_size) / 256 * 256;
    let bindings: Vec<wgpu::BindGroup> = (0..MOVED_BYTES)
        .step_by(piece as usize)
        .map(|offset| {
            let size = std::num::NonZeroU64::new(piece.min(MOVED_BYTES - offset));
            let words = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: moved, offset, size });
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: words },
                    wgpu::BindGroupEntry { binding: 1, resource: sum.as_entire_binding() },
                ],
            })
        })
        .collect();
    // Nearly all of a software adapter's time goes into this.
    let times = if device.adapter_info().device_type == wgpu::DeviceType::Cpu { 1 } else { 8 };
    let secs = mean_secs(|| {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        for bindings in (0..times).flat_map(|_| &bindings) {
            pass.set_bind_group(0, bindings, &[]);
            pass.dispatch_workgroups(4096, 1, 1);
        }
        drop(pass);
        queue.submit([encoder.finish()]);
        wait(device);
    });
    f64::from(times) * MOVED_BYTES as f64 / secs
}

fn coming_back(device: &wgpu::Device, queue: &wgpu::Queue, moved: &wgpu::Buffer) -> f64 {
    let back = buffer(device, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST, MOVED_BYTES, false);
    let secs = mean_secs(|| {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(moved, 0, &back, 0, MOVED_BYTES);
        queue.submit([encoder.finish()]);
        wait(device);
    });
    MOVED_BYTES as f64 / secs
}

/// A line of the table, and the same among the figures.
struct Row<'a> {
    what: &'a str,
    secs: f64,
    bytes: f64,
    /// The rate that it is held against.
    of: Option<(&'a str, f64)>,
    image: Option<&'a LinearImage>,
}

impl Row<'_> {
    fn tell(self, figures: &mut Figures, case: &str, reference: &LinearImage) {
        let Self { what, secs, bytes, of, image } = self;
        let case = format!("{case}: {what}");
        figures.add(&case, "milliseconds", 1e3 * secs);
        figures.add(&case, "megabytes_moved", bytes / 1e6);
        let share = of.map_or("–".to_owned(), |(name, rate)| {
            figures.add(&case, &format!("of_{name}"), bytes / secs / rate);
            format!("{name}: {:.2}", bytes / secs / rate)
        });
        let error = image.map_or("–".to_owned(), |image| {
            let error = compare(image, reference).relative_l2;
            figures.add(&case, "relative_l2", error);
            if error == 0.0 { "the same bits".to_owned() } else { format!("{error:.1e}") }
        });
        println!("| {what} | {:.3} | {:.1} | {:.2} | {share} | {error} |", 1e3 * secs, bytes / 1e6, bytes / secs / 1e9);
    }
}

fn main() {
    let adapter = match GpuAdapter::find() {
        Ok(adapter) => adapter,
        Err(problem) => {
            println!("{problem}");
            // Asked for, its absence is a failure, as in the tests.
            std::process::exit(i32::from(std::env::var("LTM_REQUIRE_GPU").is_ok_and(|value| value == "1")));
        }
    };
    let mut figures = Figures::new("bench-gpu", &["LTM_SCENES", CONTAINERS], COMMAND);
    let kind = if adapter.is_software { ": SOFTWARE, no GPU" } else { "" };
    println!("\nAdapter: {}{kind}\n", adapter.name);
    let rates = Rates::measure();
    for (what, figure, rate) in [
        ("its memory, read by a kernel", "memory_gb_per_s", rates.memory),
        ("sent to it from the host's memory", "sent_gb_per_s", rates.sent),
        ("back from it", "back_gb_per_s", rates.back),
    ] {
        println!("- {what}: {:.1} GB/s", rate / 1e9);
        figures.add(&adapter.name, figure, rate / 1e9);
    }
    let named = std::env::var_os(CONTAINERS).unwrap_or_default();
    for path in std::env::split_paths(&named).filter(|path| !path.as_os_str().is_empty()) {
        let container = ContainerReader::open(&path).expect("a container");
        let ranks: usize = container.shape().blocks().map(|id| container.rank(id)).sum();
        let rank = ranks as f64 / f64::from(container.shape().block_count());
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        relight(&mut figures, &format!("{}: {name}", adapter.name), &rates, &container, rank);
    }
    for (name, size, columns, rank) in RANDOM {
        let is_large = size.0 * size.1 > 1024 * 768;
        if adapter.is_software && is_large {
            println!("\n{name}: left out, for a software adapter would take minutes");
            continue;
        }
        let source = Recipe::new(size, 32, columns, &[rank]).make();
        relight(&mut figures, &format!("{}: {name}", adapter.name), &rates, &source, rank as f64);
    }
    figures.write();
}

/// Relights a matrix in all ways.
fn relight(figures: &mut Figures, case: &str, rates: &Rates, source: &dyn FactorSource, rank: f64) {
    let shape = source.shape();
    let columns = shape.columns();
    println!(
        "\n{case}: {} rows, {columns} columns, mean rank {rank:.1}, blocks of {}\n",
        shape.rows(),
        shape.block_side()
    );
    println!(
        "| what | ms | MB moved | GB/s | of the rate | relative L2 to the CPU's image |\n|---|---|---|---|---|---|"
    );
    figures.add(case, "rows", shape.rows() as f64);
    figures.add(case, "columns", columns as f64);
    figures.add(case, "mean_rank", rank);
    let lighting = random_lighting(columns, 1);
    let gpu = GpuRelighter::new(source).unwrap();
    let cpu = CpuRelighter::load(source).unwrap();
    let reference = cpu.relight(&lighting).unwrap();
    let mut image = reference.clone();
    let secs = mean_secs(|| cpu.relight_into(&lighting, &mut image).unwrap());
    let bytes = cpu.factor_bytes() as f64;
    Row { what: "relit on the CPU", secs, bytes, of: None, image: None }.tell(figures, case, &reference);
    drop(cpu);
    let image_bytes = shape.rows() * 4;
    // Factors and lists are read, the image is written; the buffers hold it twice, once to be read back.
    let moved = (gpu.resident_bytes() - image_bytes) as f64;
    let secs = mean_secs(|| gpu.relight_resident(&lighting).unwrap());
    image = gpu.radiance().unwrap();
    let of = Some(("memory", rates.memory));
    Row { what: "relit, stays there", secs, bytes: moved, of, image: Some(&image) }.tell(figures, case, &reference);
    let secs = mean_secs(|| gpu.relight_into(&lighting, &mut image).unwrap());
    let (what, of) = ("relit and read back", Some(("back", rates.back)));
    Row { what, secs, bytes: image_bytes as f64, of, image: Some(&image) }.tell(figures, case, &reference);

    let budget = gpu.resident_bytes() / 10;
    drop(gpu);
    let host = PagedRelighter::new(source, u64::MAX);
    let paged = PagedGpuRelighter::new(host, budget, GpuSettings::default()).unwrap();
    let all: Vec<_> = shape.blocks().collect();
    paged.relight_view(&lighting, &all, Detail::Whole, &mut image).unwrap();
    let (before, mut images) = (paged.uploaded_bytes(), 0.0);
    let secs = mean_secs(|| {
        paged.relight_view(&lighting, &all, Detail::Whole, &mut image).unwrap();
        images += 1.0;
    });
    let bytes = (paged.uploaded_bytes() - before) as f64 / images;
    let (what, of) = ("relit through a tenth of the memory, read back", Some(("sent", rates.sent)));
    Row { what, secs, bytes, of, image: Some(&image) }.tell(figures, case, &reference);
}
