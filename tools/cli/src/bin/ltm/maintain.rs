//! `ltm repair` and `ltm merge`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::container::ContainerReader;
use ltm::files::check_output;
use ltm::matrix::BlockId;
use ltm::pipeline;
use ltm::resources::{Progress, human_bytes, parse_bytes};
use ltm::{Error, Result};

use crate::farm::{self, Listing};
use crate::input::{Kind, Overrides, SceneFiles, kind_of};
use ltm_cli::console::Console;
use ltm_cli::say;

#[derive(Args)]
pub(crate) struct Repair {
    /// The matrix.
    file: PathBuf,
    /// The scene file that it was rendered from; what follows is to be as it was then.
    scene: PathBuf,
    #[command(flatten)]
    overrides: Overrides,
    #[command(flatten)]
    files: SceneFiles,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

#[derive(Args)]
pub(crate) struct Merge {
    /// The parts: all .ltm or all .ltc; with --plan, the folder of the shards.
    #[arg(required = true)]
    pub(crate) parts: Vec<PathBuf>,
    /// The joined file.
    #[arg(short, long)]
    pub(crate) output: PathBuf,
    /// The plan whose shards are to be made a container.
    #[arg(long, conflicts_with = "partial")]
    plan: Option<PathBuf>,
    /// With --plan: leave all but the last step to workers. What the next round begins with is put into the place of the shards, and the
    /// units that are missing are listed (exit code 8); where none is, the container is written.
    #[arg(long, requires = "plan")]
    pub(crate) rounds: bool,
    /// With --rounds: read all shards, and list as missing those whose bytes have changed.
    #[arg(long, requires = "rounds")]
    pub(crate) check: bool,
    /// With --plan: merge nothing, and list the ranges that are missing.
    #[arg(long, value_enum, requires = "plan", num_args = 0..=1, require_equals = true, default_missing_value = "ranges")]
    pub(crate) list: Option<Listing>,
    /// With --plan: the scene file, where it does not lie where the plan says.
    #[arg(long, requires = "plan")]
    pub(crate) scene: Option<PathBuf>,
    /// Replace a container that is there (a matrix is added to).
    #[arg(long)]
    pub(crate) force: bool,
    /// Blocks may be missing still: more parts follow.
    #[arg(long)]
    partial: bool,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    pub(crate) memory: Option<u64>,
}

pub(crate) fn repair(options: &Repair, console: &Console) -> Result<()> {
    options.files.one_camera()?;
    let allowed = options.files.load_options(options.memory);
    let loaded = options.overrides.of(pipeline::load_scene(&options.scene, allowed)?);
    let repaired = pipeline::repair(loaded, &options.file, options.memory, console)?;
    say!("{}: {} blocks rendered again", options.file.display(), repaired.len());
    Ok(())
}

pub(crate) fn merge(options: &Merge, console: &Console) -> Result<()> {
    let Merge { parts, output, force, partial, memory, .. } = options;
    if let Some(plan) = &options.plan {
        return farm::merge(options, plan, console);
    }
    pipeline::admit_merge(parts, *memory)?;
    let before = std::cell::Cell::new(0);
    let progress = |done: u32, all: u32| {
        let before = before.replace(done);
        if before == 0 {
            console.begin("joining", u64::from(all), "steps");
        }
        console.advance(u64::from(done - before), 0, "B");
        !console.interrupted()
    };
    let missing = match kind_of(output)? {
        Kind::Container => {
            let paths: Vec<&Path> = parts.iter().map(PathBuf::as_path).collect();
            let summary = ltm::container::merge(&paths, output, *force, progress);
            console.end();
            let summary = summary?;
            say!("{}: {} blocks, {}", output.display(), summary.blocks, human_bytes(summary.file_bytes));
            let reader = ContainerReader::open(output)?;
            reader.job().shape.blocks().filter(|&id| !reader.has_block(id)).collect()
        }
        Kind::Matrix => {
            check_output(output, true)?;
            let report = ltm::store::merge(parts, output, progress);
            console.end();
            let report = report?;
            say!("{}: {} blocks copied, {} were there", output.display(), report.copied, report.present);
            match report.mended {
                0 => {}
                1 => say!("1 damaged block replaced"),
                mended => say!("{mended} damaged blocks replaced"),
            }
            for (path, damage) in &report.damaged {
                say!("damaged: {}, {}: {}", path.display(), damage.block, damage.problem);
            }
            if let Some((path, damage)) = report.damaged.first() {
                let problem = format!("{} is damaged, and no other part holds it whole", damage.block);
                return Err(Error::damaged(path, problem, "render that block again and merge once more"));
            }
            report.missing
        }
    };
    if missing.is_empty() {
        return Ok(());
    }
    let text = format!("{} blocks are missing: {}", missing.len(), ranges(&missing));
    if *partial {
        println!("{text}");
        return Ok(());
    }
    Err(Error::input(output.display().to_string(), text, "merge the parts that hold them too, or say --partial"))
}

/// Numbers of blocks in order, as ranges.
fn ranges(ids: &[BlockId]) -> String {
    let runs = ids.chunk_by(|a, b| a.0 + 1 == b.0).map(|run| match run {
        [one] => one.0.to_string(),
        [first, .., last] => format!("{} to {}", first.0, last.0),
        [] => String::new(),
    });
    runs.collect::<Vec<_>>().join(", ")
}
