//! `ltm view`.

use std::path::PathBuf;

use clap::Args;
use ltm::Result;
use ltm::view::WindowOptions;

#[derive(Args)]
pub(crate) struct View {
    /// The container; without it, one is dropped on the window.
    file: Option<PathBuf>,
    /// Save a PNG of the window once its picture stands, and close it.
    #[arg(long, value_name = "PNG")]
    screenshot: Option<PathBuf>,
}

pub(crate) fn run(options: View) -> Result<()> {
    ltm::view::run(WindowOptions {
        path: options.file,
        screenshot: options.screenshot,
        frames: 10,
        ..Default::default()
    })
}
