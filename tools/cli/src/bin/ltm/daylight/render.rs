//! Which views there are, and their matrices, rendered where they are not there.

use std::path::Path;

use ltm::container::ContainerReader;
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::resources::Progress;
use ltm::scene::{LoadOptions, LoadedScene, grid_names, in_file, is_scene_file};
use ltm::store::StoreReader;
use ltm::{Error, Result};

use super::view::{CAMERA, OpenMatrix, View};
use super::{Daylight, dimming};
use ltm_cli::console::Console;
use ltm_cli::say;
use ltm_cli::words::in_flags;

/// The views that are wanted: grids of a scene file by their names, and its camera; of a matrix what its file is called.
pub(super) fn view_names(options: &Daylight) -> Result<Vec<String>> {
    if !is_scene_file(&options.input) {
        return Ok(vec![options.input.file_stem().unwrap_or_default().to_string_lossy().into_owned()]);
    }
    let (grids, has_camera) = grid_names(&options.input)?;
    Ok(match options.view.as_deref() {
        Some(name) => vec![name.to_owned()],
        None => grids.into_iter().chain(has_camera.then(|| CAMERA.to_owned())).collect(),
    })
}

/// A view of a file, which is the matrix or a scene file; of a scene file the matrix is in the folder, rendered where it is not there.
/// `names` are those of all views.
pub(super) fn view_of(
    options: &Daylight,
    (file, folder): (&Path, &Path),
    (name, names): (&str, &[&str]),
    console: &Console,
) -> Result<View> {
    if is_scene_file(file) {
        std::fs::create_dir_all(folder).map_err(Error::io(folder, "make the folder"))?;
        return rendered(options, (file, folder), (name, names), console);
    }
    dimming::check_job(&options.zones, names, name, OpenMatrix::open(file)?.job())?;
    Ok(View { name: name.to_owned(), matrix: file.to_owned(), places: None, blinds: None })
}

fn rendered(
    options: &Daylight,
    (file, folder): (&Path, &Path),
    (name, names): (&str, &[&str]),
    console: &Console,
) -> Result<View> {
    let grid = (name != CAMERA).then(|| name.to_owned());
    let is_grid = grid.is_some();
    let load = LoadOptions { grid, ..options.files.load_options(options.memory) };
    let mut loaded = options.overrides.of(pipeline::load_scene(file, load)?);
    for warning in loaded.warnings.worded(in_flags) {
        console.note(&format!("warning: {warning}"));
    }
    let extension = if is_grid || options.no_pack { "ltm" } else { "ltc" };
    let matrix = folder.join(format!("{name}.{extension}"));
    match is_grid {
        true => loaded.settings.samples_per_pixel = options.sensor_samples,
        false => loaded = loaded.showing_irradiance(),
    }
    let job = pipeline::job_of(&loaded)?;
    dimming::check_job(&options.zones, names, name, &job)?;
    let is_there = matrix.exists()
        && match extension {
            "ltm" => StoreReader::open(&matrix)?.job().provenance == job.provenance,
            _ => ContainerReader::open(&matrix)?.job().provenance == job.provenance,
        };
    if matrix.exists() && !is_there && !options.force {
        let problem = "is of another scene, or was rendered with other settings";
        return Err(Error::input(matrix.display().to_string(), problem, "--force renders it again"));
    }
    let scene = loaded.scene.clone();
    if !is_there || options.force {
        render(options, loaded, &matrix, console)?;
    }
    let places = scene.sensors.as_ref().map(|sensors| {
        let points = sensors.points().iter();
        points.map(|p| (in_file(scene.origin, p.position).as_vec3().to_array(), p.normal.to_array())).collect()
    });
    Ok(View { name: name.to_owned(), matrix, places, blinds: None })
}

/// Sensors are kept as they are rendered; a picture is denoised and packed, unless it is not to be.
fn render(options: &Daylight, loaded: LoadedScene, matrix: &Path, console: &Console) -> Result<()> {
    let memory_bytes = options.memory;
    if loaded.scene.sensors.is_some() || options.no_pack {
        let store = ltm::store::StoreOptions { overwrite: options.force, ..Default::default() };
        let render = RenderOptions { store, memory_bytes, ..Default::default() };
        let report = pipeline::render(loaded, matrix, &render, console)?;
        say!("{}: rendered in {:.1} s", matrix.display(), report.seconds);
        return Ok(());
    }
    let mut pack = PackOptions { memory_bytes, ..Default::default() };
    pack.container.overwrite = options.force;
    let (render, _) = pipeline::render_packed(loaded, matrix, &pack, console)?;
    say!("{}: rendered and packed in {:.1} s", matrix.display(), render.seconds);
    Ok(())
}
