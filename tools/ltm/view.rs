//! `ltm view`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use ltm::Result;
use ltm::view::{RelightOn, WindowOptions};

#[derive(Args)]
pub(crate) struct View {
    /// The container; without it, one is dropped on the window.
    file: Option<PathBuf>,
    /// Save a PNG of the window once its picture stands, and close it.
    #[arg(long, value_name = "PNG")]
    screenshot: Option<PathBuf>,
    /// Where to relight: on the device that draws the window unless it is a software one, on the CPU, or there anyway.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceName,
}

#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    Auto,
    Cpu,
    Gpu,
}

pub(crate) fn run(options: View) -> Result<()> {
    ltm::view::run(WindowOptions {
        path: options.file,
        screenshot: options.screenshot,
        frames: 10,
        relight_on: match options.device {
            DeviceName::Auto => RelightOn::Auto,
            DeviceName::Cpu => RelightOn::Cpu,
            DeviceName::Gpu => RelightOn::Gpu,
        },
        state_folder: state_folder(),
        ..Default::default()
    })
}

/// Where programs keep what a user would not miss: the XDG base directories' state folder.
fn state_folder() -> Option<PathBuf> {
    let folder = |name| std::env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let state = folder("XDG_STATE_HOME").or_else(|| Some(folder("HOME")?.join(".local/state")))?;
    Some(state.join("ltm"))
}
