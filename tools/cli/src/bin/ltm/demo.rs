//! `ltm demo`.

use std::path::PathBuf;

use clap::Args;
use ltm::Result;
use ltm::pipeline::demo::demo;

use crate::input::Overrides;
use ltm_cli::console::Console;
use ltm_cli::words::parse_size;

/// Samples per pixel of the demonstration: what keeps it under a minute on two cores.
const DEMO_SAMPLES: u32 = 256;

#[derive(Args)]
pub(crate) struct Demo {
    /// Folder for the results.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Samples per pixel [default: 256].
    #[arg(long)]
    samples: Option<u32>,
    /// Image size, WIDTHxHEIGHT [default: the embedded scene's own].
    #[arg(long, value_parser = parse_size)]
    size: Option<(u32, u32)>,
}

impl Default for Demo {
    fn default() -> Self {
        Self { out: "out".into(), samples: None, size: None }
    }
}

pub(crate) fn run(options: &Demo, console: &Console) -> Result<()> {
    let samples = options.samples.or(Some(DEMO_SAMPLES));
    let loaded = Overrides { samples, size: options.size, seed: None }.of(ltm::scene::built_in());
    let report = demo(loaded, &options.out, console)?;
    let out = options.out.display();
    println!("{report}\n");
    println!("The images are in {out}/. Next:");
    println!("  ltm info {out}/demo.ltc                       what the container is");
    println!("  ltm relight {out}/demo.ltc -o relit.png       relight it in milliseconds");
    println!("  ltm render SCENE.toml                     your own scene; formats/scene.md says how to write one");
    Ok(())
}
