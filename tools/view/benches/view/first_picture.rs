//! From the start of the program to the first picture in a real window, on a virtual display (Xvfb).
//!
//! The benchmark starts itself as the viewer, again and again. A moment counts once the frame that shows it has been
//! given to the display, which is when the next one begins.

use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use eframe::egui;
use ltm_view::{App, WindowOptions};

use super::figures::Figures;
use super::files;
use super::percentile;

/// First argument with which this program is the viewer of the container that follows.
const AS_VIEWER: &str = "--act-as-viewer";
/// Starts of each kind, of which the median is told.
const STARTS: usize = 7;
const SIZE: [f32; 2] = [1440.0, 900.0];
/// What is waited for, in this order.
const MOMENTS: [&str; 4] =
    ["window_milliseconds", "first_picture_milliseconds", "base_layers_milliseconds", "whole_picture_milliseconds"];

/// Acts as the viewer if that is asked for: prints the milliseconds to each moment.
pub(crate) fn act_as_viewer(begun: Instant) -> Option<ExitCode> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, path] = arguments.as_slice() else { return None };
    if mode != AS_VIEWER {
        return None;
    }
    let viewport = egui::ViewportBuilder::default().with_title("ltm").with_inner_size(SIZE);
    let native = eframe::NativeOptions { viewport, centered: true, ..Default::default() };
    let options = WindowOptions { path: Some(path.into()), size: Some(SIZE), ..Default::default() };
    let create: eframe::AppCreator<'_> = Box::new(move |context| {
        // The window relights by the processor where the adapter is a software one, as it is here.
        let app = App::new(&context.egui_ctx, options, None, Arc::new(Mutex::new(None)));
        Ok(Box::new(Timed { app, begun, drawn: 0, told: 0 }))
    });
    Some(match eframe::run_native("ltm", native, create) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    })
}

/// The window, with a look at the clock between its frames.
struct Timed {
    app: App,
    begun: Instant,
    /// Moments that the last frame has drawn.
    drawn: usize,
    /// Moments that have been told.
    told: usize,
}

impl eframe::App for Timed {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        for _ in self.told..self.drawn {
            println!("{}", self.begun.elapsed().as_secs_f64() * 1e3);
        }
        self.told = self.drawn;
        if self.told == MOMENTS.len() {
            ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
        }
        self.app.show(ui);
        let progress = self.app.progress();
        let drawn = match self.app.pictures() {
            0 => 1,
            _ if progress.is_complete() => 4,
            _ if progress.base >= 1.0 => 3,
            _ => 2,
        };
        if drawn > self.drawn {
            self.drawn = drawn;
            // Else there might be no next frame.
            ui.ctx().request_repaint();
        }
    }

    fn raw_input_hook(&mut self, context: &egui::Context, input: &mut egui::RawInput) {
        self.app.take_turns(context, input);
    }
}

/// Milliseconds to each moment of one start; none where there is no virtual display.
fn start(path: &Path) -> Option<[f64; MOMENTS.len()]> {
    let this = std::env::current_exe().expect("this program has a path");
    let screen = format!("-screen 0 {}x{}x24", SIZE[0], SIZE[1]);
    let output = Command::new("xvfb-run")
        .args(["-a", "-s", &screen])
        .arg(this)
        .args([AS_VIEWER.as_ref(), path.as_os_str()])
        .env_remove("WAYLAND_DISPLAY")
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let told = String::from_utf8_lossy(&output.stdout);
    let moments: Vec<f64> = told.lines().filter_map(|line| line.parse().ok()).collect();
    let moments = moments.try_into().ok();
    if moments.is_none() {
        println!("  no window can be opened: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    moments
}

/// The time to the first picture of a container, with its file in the system's cache and without, in turns.
pub(crate) fn measure(path: &Path, case: &str, figures: &mut Figures) {
    let path = &std::path::absolute(path).expect("there is a folder");
    // The first of all also brings program and drivers into the cache.
    if start(path).is_none() {
        return;
    }
    let mut moments = [const { [const { Vec::new() }; MOMENTS.len()] }; 2];
    for _ in 0..STARTS {
        for (is_warm, moments) in moments.iter_mut().enumerate() {
            if is_warm == 0 {
                files::forget(path);
            }
            let Some(took) = start(path) else { return };
            moments.iter_mut().zip(took).for_each(|(all, took)| all.push(took));
        }
    }
    for (kind, moments) in ["cold", "warm"].into_iter().zip(&mut moments) {
        print!("  from the start of the program, {kind}, medians of {STARTS}:");
        for (name, took) in MOMENTS.into_iter().zip(moments) {
            let median = percentile(took, 0.5);
            figures.add(case, &format!("{kind}_{name}"), median);
            print!(" {} {median:.0} ms", name.trim_end_matches("_milliseconds").replace('_', " "));
        }
        println!();
    }
}
