//! Latency of the window: from a fader's movement to its picture, in frames and milliseconds, with the container's error
//! beside it; and from the start of the program to its first picture, in a real window on a virtual display.
//!
//! `cargo bench -p ltm-view` measures rooms that it traces itself, kept without loss but for the
//! container's rounding; `LTM_VIEW_CONTAINER=FILE.ltc` measures others (several with `:` between them). With `LTM_VIEW_DEVICE=1` the device relights
//! that would draw the window, whatever it is, and shows the pictures unless it is a software one; both ways are
//! measured. The window is laid out in full sixty times a second, as a display would ask for it; putting its triangles
//! on the screen is not part of the time.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

#[path = "../tests/view_window/container.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod container;
#[path = "../tests/view_window/driver.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod driver;
#[path = "../../../benches/figures/mod.rs"]
mod figures;
#[path = "../../../benches/figures/files.rs"]
mod files;
#[path = "view/first_picture.rs"]
mod first_picture;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use driver::Driver;
use eframe::egui::{Pos2, Rect, vec2};
use figures::Figures;
use ltm::container::ContainerReader;
use ltm::image::ToneMapping;
use ltm::light::Lighting;
use ltm::matrix::FactorSource;
use ltm::relight::{CpuRelighter, GpuRelighter, GpuScreen};
use ltm::scene::BuiltIn;
use ltm_view::display::{CURVES, Display};

const FRAME: Duration = Duration::from_micros(16_667);
/// What it is run by, and the variables that it reads.
const COMMAND: &str = "cargo bench -p ltm-view";
const VARIABLES: [&str; 2] = ["LTM_VIEW_DEVICE", "LTM_VIEW_CONTAINER"];
/// Movements that are measured one by one, and frames of one long drag.
const MOVES: usize = 60;
const DRAG_FRAMES: usize = 120;

fn main() -> ExitCode {
    if let Some(code) = first_picture::act_as_viewer(Instant::now()) {
        return code;
    }
    if let Some(paths) = std::env::var_os("LTM_VIEW_CONTAINER") {
        let paths: Vec<PathBuf> = std::env::split_paths(&paths).collect();
        let mut figures = Figures::new("bench-view", &VARIABLES, COMMAND);
        paths.iter().for_each(|path| measure(path, &mut figures));
        figures.write();
        return ExitCode::SUCCESS;
    }
    let mut figures = Figures::new("bench-view", &VARIABLES, COMMAND);
    let folder = tempfile::tempdir().expect("a temporary folder");
    // As many components as columns: a packed container of this size has a tenth of them.
    for (name, texels) in [("mixed", 4), ("mixed", 8), ("environment", 8)] {
        let path: PathBuf = folder.path().join(format!("{name}-{texels}.ltc"));
        let built_in = BuiltIn { width: 320, height: 240, texels };
        container::write(&path, built_in.named(name).expect("a built-in scene"), 4);
        measure(&path, &mut figures);
    }
    figures.write();
    ExitCode::SUCCESS
}

fn measure(path: &Path, figures: &mut Figures) {
    let reader = ContainerReader::open(path).expect("a container");
    let (shape, light) = (reader.shape(), reader.job().basis.lights()[0].name.clone());
    let ranks: usize = shape.blocks().map(|id| reader.rank(id)).sum();
    let mut driver = match std::env::var_os("LTM_VIEW_DEVICE") {
        Some(_) => Driver::open_on_device(path, None),
        None => Driver::open(path),
    };
    let fader = driver.find(&format!("{light}, stops"));
    let (mut frames, mut millis) = (Vec::new(), Vec::new());
    driver.press(at(fader, 0.0));
    driver.settle();
    for step in 0..MOVES {
        let before = driver.pictures();
        let begun = Instant::now();
        let mut tick = Tick::new();
        driver.move_to(at(fader, 0.1 + 0.3 * (step % 7) as f32));
        let mut count = 0;
        while driver.pictures() == before {
            tick.wait();
            driver.frame(Vec::new());
            count += 1;
        }
        frames.push(count as f64);
        millis.push(begun.elapsed().as_secs_f64() * 1e3);
        driver.settle();
    }
    let mut pictures = 0;
    let mut last = driver.pictures();
    let begun = Instant::now();
    let mut tick = Tick::new();
    for frame in 0..DRAG_FRAMES {
        driver.move_to(at(fader, (frame as f32 * 0.05).sin()));
        tick.wait();
        let now = driver.pictures();
        pictures += usize::from(now != last);
        last = now;
    }
    let rate = pictures as f64 / begun.elapsed().as_secs_f64();
    driver.release(at(fader, 0.0));
    let columns = shape.columns();
    println!(
        "{}: {} × {} pixels × 3 channels, {columns} columns, mean rank {:.1}, blocks of {}, one light of {} changed",
        path.file_name().unwrap_or_default().to_string_lossy(),
        shape.width(),
        shape.height(),
        ranks as f64 / f64::from(shape.block_count()),
        shape.block_side(),
        reader.job().basis.lights().len(),
    );
    let [half_frames, most_frames] = [0.5, 0.95].map(|part| percentile(&mut frames, part));
    let [half_millis, most_millis] = [0.5, 0.95].map(|part| percentile(&mut millis, part));
    println!(
        "  movement to picture: {half_frames:.0} frames median, {most_frames:.0} at the 95th percentile; {half_millis:.1} ms \
         median, {most_millis:.1} ms at the 95th",
    );
    let case = path.file_stem().unwrap_or_default().to_string_lossy();
    for (figure, value) in [
        ("frames_median", half_frames),
        ("frames_95th", most_frames),
        ("milliseconds_median", half_millis),
        ("milliseconds_95th", most_millis),
        ("pictures_a_second", rate),
        ("stated_error", error(&reader)),
    ] {
        figures.add(&case, figure, value);
    }
    for (figure, value) in [
        ("columns", columns as f64),
        ("pixels", f64::from(shape.width() * shape.height())),
        ("file_bytes", reader.file_bytes() as f64),
    ] {
        figures.add(&case, figure, value);
    }
    println!(
        "  during a drag of {DRAG_FRAMES} frames: {rate:.1} pictures a second; stated error {:.2e}",
        error(&reader)
    );
    first_picture::measure(path, &case, figures);
    let relighter = CpuRelighter::load(&reader).expect("factors");
    let image = relighter.relight(&Lighting::of_scene(&reader.job().basis)).expect("an image");
    if std::env::var_os("LTM_VIEW_DEVICE").is_some() {
        measure_device(&reader);
    }
    for (curve, name) in CURVES {
        let display = Display { tone: ToneMapping { curve, ..Default::default() }, false_colour: false };
        let millis = median_millis(|| drop(std::hint::black_box(display.show(&image))));
        println!("  radiance to colours and histogram, {name}: {millis:.2} ms median");
    }
}

/// What a picture costs that stays on the device, and one that is read back and shown by the CPU.
fn measure_device(reader: &ContainerReader) {
    let lighting = Lighting::of_scene(&reader.job().basis);
    let screen = GpuScreen::new(GpuRelighter::new(reader).expect("a device")).expect("a screen");
    let adapter = screen.relighter().adapter();
    for (curve, name) in CURVES {
        let display = Display { tone: ToneMapping { curve, ..Default::default() }, false_colour: false };
        let on_screen = median_millis(|| screen.show(Some(&lighting), display.shown_as()).expect("a picture"));
        let tone = median_millis(|| screen.show(None, display.shown_as()).expect("a picture"));
        let read = median_millis(|| {
            let image = screen.relighter().relight(&lighting).expect("an image");
            std::hint::black_box(display.show(&image));
        });
        println!(
            "  {adapter}, {name}: relit and in the window's texture {on_screen:.2} ms, of which tones {tone:.2} ms; \
             relit, read back and shown by the CPU {read:.2} ms (medians)"
        );
    }
}

fn median_millis(mut work: impl FnMut()) -> f64 {
    let once = |_| {
        let begun = Instant::now();
        work();
        begun.elapsed().as_secs_f64() * 1e3
    };
    percentile(&mut (0..MOVES).map(once).collect::<Vec<f64>>(), 0.5)
}

/// A place on the fader, in parts of its half from the middle.
fn at(fader: Rect, part: f32) -> Pos2 {
    fader.center() + vec2(part * fader.width() * 0.2, 0.0)
}

/// Relative error over all blocks, as the container states it.
fn error(reader: &ContainerReader) -> f64 {
    let reports = reader.shape().blocks().map(|id| reader.block_report(id));
    let (error, norm) =
        reports.fold((0.0, 0.0), |sum, report| (sum.0 + report.squared_error, sum.1 + report.squared_norm));
    (error / norm).sqrt()
}

fn percentile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part).round() as usize]
}

/// The beat of a display.
struct Tick(Instant);

impl Tick {
    fn new() -> Self {
        Self(Instant::now() + FRAME)
    }

    fn wait(&mut self) {
        std::thread::sleep(self.0.saturating_duration_since(Instant::now()));
        self.0 = (self.0 + FRAME).max(Instant::now());
    }
}
