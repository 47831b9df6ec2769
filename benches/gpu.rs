//! A GPU against its own memory and its own bus, in one run: bytes copied inside it, bytes sent to it, images relit from factors
//! that it holds, and from factors that pass through a tenth of the memory that they take. One table; an adapter that computes
//! on the processor is called software, and its figures tell nothing of a GPU.
//!
//! The matrix: 1024 × 768 pixels, 1,024 columns, random factors of rank 8 in blocks of 32 × 32. Errors are against the CPU's
//! image of the same factors. `tools/gpu.sh` runs this after the tests.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

#[path = "../tests/relight_source/mod.rs"]
mod relight_source;

use std::time::Instant;

use ltm::image::{LinearImage, compare};
use ltm::relight::{CpuRelighter, GpuRelighter, GpuSettings, PagedGpuRelighter, PagedRelighter};
use relight_source::{Recipe, random_lighting};

/// Of one copy, and of one sending.
const COPIED_BYTES: u64 = 128 << 20;
/// Copies in one submission, so that what a submission costs does not count.
const COPIES: u64 = 8;

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

/// Bytes a second that are read and written by copying inside the GPU, and bytes a second that are sent to it.
fn rates(device: &wgpu::Device, queue: &wgpu::Queue) -> (f64, f64) {
    let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
    let buffer = || {
        let descriptor = wgpu::BufferDescriptor { label: None, size: COPIED_BYTES, usage, mapped_at_creation: false };
        device.create_buffer(&descriptor)
    };
    let (from, to) = (buffer(), buffer());
    let wait = || {
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    };
    let copied = mean_secs(|| {
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        (0..COPIES).for_each(|_| encoder.copy_buffer_to_buffer(&from, 0, &to, 0, COPIED_BYTES));
        queue.submit([encoder.finish()]);
        wait();
    });
    let data = vec![1u8; COPIED_BYTES as usize];
    let sent = mean_secs(|| {
        queue.write_buffer(&to, 0, &data);
        queue.submit([]);
        wait();
    });
    ((2 * COPIES * COPIED_BYTES) as f64 / copied, COPIED_BYTES as f64 / sent)
}

fn row(what: &str, secs: f64, bytes: f64, share: &str, image: Option<(&LinearImage, &LinearImage)>) {
    let error = image.map_or("–".to_owned(), |(image, reference)| match compare(image, reference).relative_l2 {
        0.0 => "the same bits".to_owned(),
        error => format!("{error:.1e}"),
    });
    println!("| {what} | {:.3} | {:.1} | {:.2} | {share} | {error} |", 1e3 * secs, bytes / 1e6, bytes / secs / 1e9);
}

fn main() {
    let source = Recipe::new((1024, 768), 32, 1024, &[8]).make();
    let lighting = random_lighting(1024, 1);
    let gpu = match GpuRelighter::new(&source) {
        Ok(gpu) => gpu,
        Err(problem) => {
            println!("{problem}");
            // Asked for, its absence is a failure, as in the tests.
            std::process::exit(i32::from(std::env::var("LTM_REQUIRE_GPU").is_ok_and(|value| value == "1")));
        }
    };
    let kind = if gpu.is_software() { ": SOFTWARE, no GPU" } else { "" };
    println!("\nAdapter: {}{kind}\n", gpu.adapter());
    println!(
        "| what | ms | MB moved | GB/s | of the rate | relative L2 to the CPU's image |\n|---|---|---|---|---|---|"
    );
    let (device, queue) = device();
    let (copy, bus) = rates(&device, &queue);
    row(
        "copied inside, read and written",
        (2 * COPIED_BYTES) as f64 / copy,
        (2 * COPIED_BYTES) as f64,
        "copying: 1",
        None,
    );
    row("sent", COPIED_BYTES as f64 / bus, COPIED_BYTES as f64, "sending: 1", None);
    drop((device, queue));

    let reference = CpuRelighter::load(&source).unwrap().relight(&lighting).unwrap();
    let moved = (gpu.resident_bytes() + source.shape.rows() * 4) as f64;
    let share = |bytes: f64, secs: f64, rate: f64, name: &str| format!("{name}: {:.2}", bytes / secs / rate);
    let secs = mean_secs(|| gpu.relight_resident(&lighting).unwrap());
    let image = gpu.radiance().unwrap();
    row("relit, stays there", secs, moved, &share(moved, secs, copy, "copying"), Some((&image, &reference)));
    let secs = mean_secs(|| drop(gpu.relight(&lighting).unwrap()));
    row("relit and read back", secs, moved, &share(moved, secs, copy, "copying"), Some((&image, &reference)));

    let budget = gpu.resident_bytes() / 10;
    drop(gpu);
    let host = PagedRelighter::new(&source, u64::MAX);
    let paged = PagedGpuRelighter::new(host, budget, GpuSettings::default()).unwrap();
    let image = paged.relight(&lighting).unwrap();
    let (before, mut images) = (paged.uploaded_bytes(), 0.0);
    let secs = mean_secs(|| {
        drop(paged.relight(&lighting).unwrap());
        images += 1.0;
    });
    let moved = (paged.uploaded_bytes() - before) as f64 / images;
    let name = "relit through a tenth of the memory, read back";
    row(name, secs, moved, &share(moved, secs, bus, "sending"), Some((&image, &reference)));
}
