//! What rendering, packing and relighting allocate at most, as a counting allocator sees it, for growing matrices; the
//! error that was reached beside it.

#![expect(clippy::print_stdout, reason = "a bench prints its results")]

mod figures;

use figures::Figures;
use ltm::container::ContainerReader;
use ltm::light::Lighting;
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::relight::{CpuRelighter, relight_streaming};
use ltm::resources::{NoProgress, human_bytes};
use ltm::scene::BuiltIn;
use ltm::store::StoreReader;
use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const SAMPLES: u32 = 8;
const TEXELS: u32 = 32;

/// The result of `work`, and the most that was allocated while it ran beyond what was before.
fn peak<T>(work: impl FnOnce() -> T) -> (T, u64) {
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let result = work();
    (result, ALLOCATOR.peak_usage().saturating_sub(before) as u64)
}

fn main() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (matrix_path, container_path) = (folder.path().join("m.ltm"), folder.path().join("m.ltc"));
    println!(
        "mixed, {} columns, {SAMPLES} samples per pixel, blocks of 32 px, f32, {} threads",
        TEXELS * TEXELS,
        rayon::current_num_threads()
    );
    println!(
        "{:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>12}",
        "rows", "raw", "render", "pack", "load", "relight", "streaming", "relative L2"
    );
    let mut figures = Figures::new("bench-memory", &[], "cargo bench --bench memory");
    // The first is not shown: in it the dense algebra reserves 960 MiB of address space for each thread, once, of which only
    // what a product needs is ever touched.
    for (round, (width, height)) in [(96, 64), (96, 64), (192, 128), (384, 256)].into_iter().enumerate() {
        let mut loaded = BuiltIn { width, height, texels: TEXELS }.named("mixed").expect("a built-in scene");
        loaded.settings.samples_per_pixel = SAMPLES;
        let mut render = RenderOptions::default();
        render.store.overwrite = true;
        let rendered = peak(|| pipeline::render(loaded, &matrix_path, &render, &NoProgress).expect("rendering")).1;
        let matrix = StoreReader::open(&matrix_path).expect("the matrix");
        let mut options = PackOptions { allow_lost_lights: true, denoise: true, ..PackOptions::default() };
        options.container.overwrite = true;
        let (report, packed) =
            peak(|| pipeline::pack(&matrix, matrix.job(), &container_path, &options, &NoProgress).expect("packing"));
        let container = ContainerReader::open(&container_path).expect("the container");
        let (relighter, loaded) = peak(|| CpuRelighter::load(&container).expect("the factors"));
        let lighting = Lighting::of_scene(&matrix.job().basis);
        let relit = peak(|| relighter.relight(&lighting).expect("an image")).1;
        drop(relighter);
        let streamed = peak(|| relight_streaming(&container, &lighting).expect("an image")).1;
        if round == 0 {
            continue;
        }
        println!(
            "{:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>12.5}",
            matrix.job().shape.rows(),
            human_bytes(report.raw_bytes),
            human_bytes(rendered),
            human_bytes(packed),
            human_bytes(loaded),
            human_bytes(relit),
            human_bytes(streamed),
            report.relative_l2
        );
        let case = format!("{} rows", matrix.job().shape.rows());
        for (figure, bytes) in [
            ("raw_bytes", report.raw_bytes),
            ("render_bytes", rendered),
            ("pack_bytes", packed),
            ("load_bytes", loaded),
            ("relight_bytes", relit),
            ("streaming_bytes", streamed),
        ] {
            figures.add(&case, figure, bytes as f64);
        }
    }
    figures.write();
}
