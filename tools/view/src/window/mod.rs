//! The window over the mixer's state: egui on wgpu.

mod actions;
mod app;
mod autosave;
mod chooser;
mod command_line;
mod comparison;
mod daylight_panel;
mod document;
mod event_throttle;
mod exports;
mod exposure;
mod fader;
mod features_panel;
mod features_view;
mod file_jobs;
mod file_reading;
mod frames;
mod keys;
mod layout;
mod light_list;
mod light_meter;
mod light_panel;
mod message;
mod meter_overlay;
mod meter_panel;
mod mixer_panel;
mod native_dialog;
mod number_format;
mod open_view;
mod outline_panel;
mod pattern_editor;
mod pattern_panel;
mod picture_panel;
mod picture_place;
mod question;
mod renaming;
mod render_bar;
mod rendering;
mod report;
mod requests;
mod row_menu;
mod sampling;
mod screen;
mod seen_lights;
mod selection;
mod shown_picture;
mod snapshots_panel;
mod status;
mod sun_panel;
mod surfaces_state;
mod tabs;
mod tabs_panel;
mod theme;
mod top_bar;
mod view_panel;
mod view_state;
mod worker_events;
mod worker_requests;

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};
use std::sync::{Arc, Mutex};

use eframe::egui;

pub use app::App;

use super::{RelightOn, WindowOptions};
use ltm::error::{Error, Result};

/// Opens the window and stays until it is closed.
///
/// Errors: no display, no adapter or a missing library, in one line that names the package; a screenshot that cannot
/// be written. A container that cannot be opened is told in the window, or is an error if there is a screenshot to take.
pub fn run(options: WindowOptions) -> Result<()> {
    let viewport = egui::ViewportBuilder::default()
        .with_title("ltm")
        .with_app_id("ltm")
        .with_inner_size(options.size.unwrap_or([1440.0, 900.0]))
        .with_min_inner_size([560.0, 360.0])
        .with_drag_and_drop(true);
    let native = eframe::NativeOptions { viewport, centered: true, ..Default::default() };
    let failure = Arc::new(Mutex::new(None));
    let outcome = {
        let failure = failure.clone();
        quietly(|| {
            eframe::run_native(
                "ltm",
                native,
                Box::new(move |context| {
                    let state = context.wgpu_render_state.clone().filter(|state| {
                        let is_software = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
                        match options.relight_on {
                            RelightOn::Auto => !is_software,
                            RelightOn::Cpu => false,
                            RelightOn::Gpu => true,
                        }
                    });
                    Ok(Box::new(App::new(&context.egui_ctx, options, state, failure)))
                }),
            )
        })
    };
    match outcome {
        Err(panic) => Err(unusable(&panic)),
        Ok(Err(error)) => Err(unusable(&error.to_string())),
        Ok(Ok(())) => match failure.lock().ok().and_then(|mut failure| failure.take()) {
            Some(error) => Err(error),
            None => Ok(()),
        },
    }
}

/// Runs something whose libraries panic where one of theirs is missing; the panic's message is an error then. Panics
/// of other threads are reported as ever.
fn quietly<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    let here = std::thread::current().id();
    let usual: Arc<dyn Fn(&PanicHookInfo) + Send + Sync> = Arc::from(take_hook());
    let message = Arc::new(Mutex::new(String::new()));
    {
        let (usual, message) = (usual.clone(), message.clone());
        set_hook(Box::new(move |info| {
            if std::thread::current().id() != here {
                usual(info);
            } else if let Ok(mut message) = message.lock() {
                let text = info.payload_as_str().unwrap_or("the window stopped");
                *message = match info.location() {
                    Some(at) => format!("{text} ({}:{})", at.file(), at.line()),
                    None => text.to_owned(),
                };
            }
        }));
    }
    let outcome = catch_unwind(AssertUnwindSafe(run));
    set_hook(Box::new(move |info| usual(info)));
    outcome.map_err(|_| message.lock().map(|message| message.clone()).unwrap_or_default())
}

/// What is wrong with the system, with the Debian packages that mend it.
fn unusable(message: &str) -> Error {
    const LOADED_BY_NAME: [(&str, &str); 4] = [
        ("xkbcommon-x11", "libxkbcommon-x11-0"),
        ("xkbcommon", "libxkbcommon0"),
        ("wayland-client", "libwayland-client0"),
        ("libvulkan", "libvulkan1 mesa-vulkan-drivers"),
    ];
    let text = message.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    let lower = text.to_lowercase();
    let says = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    let variable = |name: &str| format!("{name}={}", std::env::var(name).unwrap_or_default());
    if says(&["xlib's shared libraries"]) {
        let hint = "apt-get install libx11-6 libx11-xcb1 libxcursor1 libxi6";
        return Error::input("the window", "one of the libraries of X11 is missing", hint);
    }
    if says(&["wayland compositor"]) {
        let problem = format!("no compositor answers at {}", variable("WAYLAND_DISPLAY"));
        return Error::input("the window", problem, "unset WAYLAND_DISPLAY to open the window on DISPLAY");
    }
    if says(&["wayland_display", "open display", "connection to x server"]) {
        let problem = match std::env::var("DISPLAY") {
            Ok(display) if !display.is_empty() => format!("there is no display at DISPLAY={display}"),
            _ => "there is no display to open a window on".into(),
        };
        let hint = "start it in a graphical session, or over `ssh -X`, or in `xvfb-run` (apt-get install xvfb)";
        return Error::input("the window", problem, hint);
    }
    if let Some((_, package)) = LOADED_BY_NAME.iter().find(|(library, _)| lower.contains(library)) {
        return Error::input("the window", "a library is missing", format!("apt-get install {package}"));
    }
    if says(&["adapter", "wgpu", "surface"]) {
        let problem = "no driver of Vulkan or OpenGL can draw a window on this display";
        return Error::NoGpu(format!("{problem}; apt-get install mesa-vulkan-drivers gives one in software"));
    }
    // Where in a dependency it was noticed helps nobody who reads this.
    let text = text
        .rsplit_once(".rs:")
        .map_or(text.as_str(), |(_, rest)| rest.trim_start_matches(|c: char| !c.is_alphabetic()));
    Error::input("the window", format!("cannot be opened ({text})"), "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_one_line_with_its_package() {
        let outcome = quietly(|| panic!("Library libxkbcommon-x11.so could not be loaded."));
        let error = unusable(&outcome.unwrap_err()).to_string();
        assert_eq!(error, "the window: a library is missing; apt-get install libxkbcommon-x11-0");
        for (message, named) in [
            ("neither WAYLAND_DISPLAY nor DISPLAY is set", "no display"),
            ("os error at /x/linux/mod.rs:788: Failed to open connection to X server", "no display"),
            ("os error at /x/mod.rs:89: Could not find wayland compositor", "WAYLAND_DISPLAY"),
            ("os error at /x/mod.rs:788: Failed to load one of xlib's shared libraries", "libxcursor1"),
            ("WGPU error: No suitable `wgpu::Adapter` found.\nmore", "mesa-vulkan-drivers"),
            ("WGPU error: Failed to create surface for any enabled backend: {}", "mesa-vulkan-drivers"),
            ("os error at /x/mod.rs:7: Something new", "opened (Something new)"),
        ] {
            let error = unusable(message).to_string();
            assert!(error.contains(named) && !error.contains('\n') && !error.contains("/x/"), "{error}");
        }
        assert_eq!(quietly(|| 7), Ok(7));
    }
}
