//! `ltm share`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::light::{LightBasis, Lighting};
use ltm::look::Look;
use ltm::pipeline::{self, ShareOptions};
use ltm::resources::{human_bytes, parse_bytes};
use ltm::share::SharedLook;
use ltm::{Error, Result};

use crate::input::load_look;
use ltm_cli::console::Console;
use ltm_cli::say;

#[derive(Args)]
pub(crate) struct Share {
    /// The container.
    input: PathBuf,
    /// The folder to write, or with --single the file.
    #[arg(short, long)]
    output: PathBuf,
    /// One HTML file with everything inside, which opens from a disk without a server.
    #[arg(long)]
    single: bool,
    /// A look file (TOML or JSON) whose looks the page offers, and whose groups it shows; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    lighting: Vec<PathBuf>,
    /// Read images that a look names outside of its folder and of LTM_SCENES: for looks whose author you trust.
    #[arg(long)]
    allow_outside: bool,
    /// Title of the page [default: the container's name].
    #[arg(long)]
    title: Option<String>,
    /// Exposure that the page begins with, in stops [default: as the window chooses it].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f32>,
    /// Replace the files if they exist.
    #[arg(long)]
    force: bool,
    /// Memory to stay within, for example 1GiB.
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

pub(crate) fn run(options: &Share, console: &Console) -> Result<()> {
    let container = pipeline::open_container(&options.input)?;
    if let Some(stops) = options.exposure.filter(|stops| !(-60.0..=60.0).contains(stops)) {
        return Err(Error::input("--exposure", format!("{stops} stops are out of range"), "give −60 to 60"));
    }
    let stem = options.input.file_stem().unwrap_or_default().to_string_lossy();
    let basis = &container.job().basis;
    let mut choices = ShareOptions {
        title: options.title.clone().unwrap_or_else(|| stem.into_owned()),
        exposure_stops: options.exposure,
        single: options.single,
        overwrite: options.force,
        memory_bytes: options.memory,
        ..ShareOptions::default()
    };
    options.lighting.iter().try_for_each(|path| {
        let file = load_look(path, basis, options.allow_outside)?;
        take_looks(path, &file, basis, &mut choices)
    })?;
    let report = pipeline::share(&container, &options.output, &choices, console)?;
    let (total, container_bytes) = (report.total_bytes, container.file_bytes());
    say!(
        "{}: {}, {:.2} × the container; a first picture after {}",
        report.page.display(),
        human_bytes(total),
        total as f64 / container_bytes as f64,
        human_bytes(report.page_bytes + report.data.to_preview),
    );
    Ok(())
}

/// Adds the looks and groups of a look file.
fn take_looks(path: &Path, file: &Look, basis: &LightBasis, choices: &mut ShareOptions) -> Result<()> {
    if *file.lighting() != Lighting::of_scene(basis) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        choices.looks.push(SharedLook { name, lighting: file.lighting().clone() });
    }
    for name in file.names() {
        choices.looks.push(SharedLook { name: name.to_owned(), lighting: file.named(name)?.clone() });
    }
    for (name, columns) in file.groups() {
        let is_free = |light: usize| choices.groups.iter().all(|(_, lights)| !lights.contains(&light));
        let lights = (0..basis.lights().len())
            .filter(|&light| columns.contains(&basis.lights()[light].first_column) && is_free(light))
            .collect();
        choices.groups.push((name.clone(), lights));
    }
    Ok(())
}
