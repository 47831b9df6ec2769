//! `ltm share`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::container::ContainerReader;
use ltm::light::{Light, LightBasis, Lighting};
use ltm::look::Look;
use ltm::pipeline::{self, ShareOptions, ShareView};
use ltm::resources::{Progress, human_bytes, parse_bytes};
use ltm::share::SharedLook;
use ltm::{Error, Result};

use crate::input::load_look;
use ltm_cli::console::Console;
use ltm_cli::say;

#[derive(Args)]
pub(crate) struct Share {
    /// The container, or several of one scene: their views become tabs under one mix.
    #[arg(required = true)]
    input: Vec<PathBuf>,
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
    /// Title of the page [default: the first container's name].
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
    if let Some(stops) = options.exposure.filter(|stops| !(-60.0..=60.0).contains(stops)) {
        return Err(Error::input("--exposure", format!("{stops} stops are out of range"), "give −60 to 60"));
    }
    let containers = options.input.iter().map(|path| pipeline::open_container(path)).collect::<Result<Vec<_>>>()?;
    let mut views: Vec<ShareView<'_>> = Vec::new();
    for (path, container) in options.input.iter().zip(&containers) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        if views.iter().any(|view| view.name == *stem) {
            let hint = "name each container once, and give files of different folders different names";
            return Err(Error::input(path.display().to_string(), format!("there is a view '{stem}' already"), hint));
        }
        let mut view = ShareView { name: stem.into_owned(), ..ShareView::of(container) };
        options.lighting.iter().try_for_each(|path| {
            let file = load_look(path, &container.job().basis, options.allow_outside)?;
            take_looks(path, &file, &mut view)
        })?;
        views.push(view);
    }
    let choices = ShareOptions {
        title: options.title.clone().unwrap_or_else(|| views[0].name.clone()),
        exposure_stops: options.exposure,
        single: options.single,
        overwrite: options.force,
        memory_bytes: options.memory,
    };
    for view in views.iter().filter(|view| views.len() > 1 && !shares_lights(view, &views)) {
        console.note(&format!(
            "{} has no light in common with the other views: its lights are mixed by themselves",
            view.name
        ));
    }
    let report = pipeline::share(&views, &options.output, &choices, console)?;
    let container_bytes: u64 = containers.iter().map(ContainerReader::file_bytes).sum();
    say!(
        "{}: {}, {:.2} × the {}; a first picture after {}",
        report.page.display(),
        human_bytes(report.total_bytes),
        report.total_bytes as f64 / container_bytes as f64,
        if views.len() > 1 { "containers" } else { "container" },
        human_bytes(report.page_bytes + report.data.to_preview),
    );
    Ok(())
}

/// Whether another view has a light of this one: the page takes for the same what has one name, as many texels, and one unit.
fn shares_lights(view: &ShareView<'_>, views: &[ShareView<'_>]) -> bool {
    let others = || views.iter().filter(|other| other.name != view.name).map(|other| &other.container.job().basis);
    let has = |basis: &LightBasis, light: &Light| {
        basis.find(&light.name).is_some_and(|own| own.layout() == light.layout() && own.unit == light.unit)
    };
    view.container.job().basis.lights().iter().any(|light| others().any(|other| has(other, light)))
}

/// Adds the looks and groups of a look file.
fn take_looks(path: &Path, file: &Look, view: &mut ShareView<'_>) -> Result<()> {
    let basis = &view.container.job().basis;
    if *file.lighting() != Lighting::of_scene(basis) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        view.looks.push(SharedLook { name, lighting: file.lighting().clone() });
    }
    for name in file.names() {
        view.looks.push(SharedLook { name: name.to_owned(), lighting: file.named(name)?.clone() });
    }
    for (name, columns) in file.groups() {
        let is_free = |light: usize| view.groups.iter().all(|(_, lights)| !lights.contains(&light));
        let lights = (0..basis.lights().len())
            .filter(|&light| columns.contains(&basis.lights()[light].first_column) && is_free(light))
            .collect();
        view.groups.push((name.clone(), lights));
    }
    Ok(())
}
