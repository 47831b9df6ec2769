//! `ltm demo`.

use std::io::IsTerminal;
use std::path::PathBuf;

use clap::Args;
use ltm::Result;
use ltm::pipeline::demo::demo;

use crate::input::Overrides;
use crate::sibling;
use ltm_cli::console::Console;
use ltm_cli::words::parse_size;
use ltm_cli::{say, shell};

#[derive(Args)]
pub(crate) struct Demo {
    /// Folder for the results.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Samples per pixel [default: 16].
    #[arg(long)]
    samples: Option<u32>,
    /// Image size, WIDTHxHEIGHT [default: 1280x720].
    #[arg(long, value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Do not open the window at the end, which is done on a terminal that has a display.
    #[arg(long)]
    no_window: bool,
}

pub(crate) fn run(options: &Demo, threads: Option<usize>, console: &Console) -> Result<()> {
    let overrides = Overrides { samples: options.samples, size: options.size, seed: None };
    let report = demo(overrides.of(ltm::scene::furnished_room()), &options.out, console)?;
    let out = options.out.display();
    println!("{report}\n");
    let container = shell::word(&report.container);
    say!("The images are in {out}/. Next:");
    say!("  ltm view {container}                     mix its lights in a window");
    say!("  ltm relight {container} -o relit.png     relight it in milliseconds");
    say!("  ltm                                      in a folder of yours: what can be done with its files");
    if !options.no_window && has_display() && sibling::is_installed("ltm-view") {
        say!("Opening the window (ltm demo --no-window leaves it out).");
        return sibling::run("ltm-view", threads, &sibling::Arguments::of([report.container.into()]));
    }
    Ok(())
}

/// Whether somebody sits before this who could see a window.
fn has_display() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let has_desktop = cfg!(any(windows, target_os = "macos")) || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY");
    has_desktop && std::io::stdout().is_terminal()
}
