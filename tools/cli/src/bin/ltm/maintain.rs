//! `ltm repair` and `ltm merge`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::Result;
use ltm::host::{human_bytes, parse_bytes};
use ltm::pipeline;
use ltm::scene::LoadOptions;

use crate::input::{Kind, kind_of, parse_size, with_overrides};
use ltm_cli::console::Console;

#[derive(Args)]
pub(crate) struct Repair {
    /// The matrix.
    file: PathBuf,
    /// The scene file that it was rendered from.
    scene: PathBuf,
    /// Samples per pixel it was rendered with [default: the scene file's].
    #[arg(long)]
    samples: Option<u32>,
    /// Image size it was rendered with, WIDTHxHEIGHT [default: the scene file's].
    #[arg(long, value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Textures may be missing, as when it was rendered.
    #[arg(long)]
    allow_missing: bool,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

#[derive(Args)]
pub(crate) struct Merge {
    /// The parts: all .ltm or all .ltc.
    #[arg(required = true)]
    parts: Vec<PathBuf>,
    /// The joined file.
    #[arg(short, long)]
    output: PathBuf,
    /// Replace a container that is there (a matrix is added to).
    #[arg(long)]
    force: bool,
}

pub(crate) fn repair(options: &Repair, console: &Console) -> Result<()> {
    let allowed = LoadOptions { allow_missing: options.allow_missing };
    let loaded = with_overrides(ltm::scene::load_with(&options.scene, allowed)?, options.samples, options.size);
    let repaired = pipeline::repair(loaded, &options.file, options.memory, console)?;
    println!("{}: {} blocks rendered again", options.file.display(), repaired.len());
    Ok(())
}

pub(crate) fn merge(options: &Merge) -> Result<()> {
    let Merge { parts, output, force } = options;
    match kind_of(output)? {
        Kind::Container => {
            let paths: Vec<&Path> = parts.iter().map(PathBuf::as_path).collect();
            let summary = ltm::container::merge(&paths, output, *force)?;
            println!("{}: {} blocks, {}", output.display(), summary.blocks, human_bytes(summary.file_bytes));
        }
        Kind::Matrix => {
            let report = ltm::store::merge(parts, output, |_, _| {})?;
            println!("{}: {} blocks copied, {} were there", output.display(), report.copied, report.present);
            for (path, damage) in &report.damaged {
                println!("damaged: {}, {}: {}", path.display(), damage.block, damage.problem);
            }
            if !report.missing.is_empty() {
                let missing: Vec<_> = report.missing.iter().map(|id| id.0).collect();
                println!("missing blocks: {missing:?}");
            }
        }
    }
    Ok(())
}
