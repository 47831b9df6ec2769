//! `ltm daylight`.

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::container::ContainerReader;
use ltm::daylight::{
    ANNUAL_MEASURES, Climate, MtxFormat, RadianceMatrix, Schedule, SkyModel, SkyOptions, SkyTexels, Thresholds,
};
use ltm::files::write_file;
use ltm::light::{EnvironmentMapping, SkyPatches};
use ltm::pipeline::{self, DaylightOptions, DaylightSource, DaylightYear, PackOptions, RenderOptions};
use ltm::resources::{Progress, parse_bytes};
use ltm::scene::{LoadedScene, grid_names, in_file, shows_irradiance};
use ltm::store::StoreReader;
use ltm::{Error, Result};

use crate::input::{Kind, Overrides, SceneFiles, kind_of};
use ltm_cli::console::Console;
use ltm_cli::say;
use ltm_cli::words::in_flags;

#[derive(Args)]
pub(crate) struct Daylight {
    /// A scene file, whose grids and camera are rendered, or a matrix (.ltm, .ltc) whose rows are irradiance.
    input: PathBuf,
    /// The climate: an EPW or a WEA file.
    #[arg(long)]
    climate: PathBuf,
    /// The folder to write.
    #[arg(short, long, default_value = "year")]
    output: PathBuf,
    /// The time of use, hours of the day FROM-TO on all days.
    #[arg(long, value_parser = parse_schedule, default_value = "8-18")]
    schedule: Schedule,
    /// Months of use, FIRST-LAST of 1 to 12 [default: all].
    #[arg(long, value_parser = parse_months)]
    months: Option<(u8, u8)>,
    /// Illuminance of daylight autonomy in lx.
    #[arg(long, default_value = "300")]
    autonomy: f32,
    /// Reflectance of the ground that is seen below the horizon.
    #[arg(long, default_value = "0.2")]
    ground: f64,
    /// How far the scene's north (−z) is turned towards east, in degrees.
    #[arg(long, default_value = "0", allow_negative_numbers = true)]
    north: f64,
    /// Write all hours too: -hours.npy [places, steps], and for grids Radiance's .ill.
    #[arg(long)]
    hourly: bool,
    /// Write the skies of the climate as gendaymtx does, sky.mtx, without its tint, of patches with this subdivision.
    #[arg(long, value_name = "MF")]
    sky_matrix: Option<u32>,
    /// Keep the camera's matrix as it is rendered, neither denoised nor packed: only so do its pixels tell hours of direct sun.
    #[arg(long)]
    no_pack: bool,
    /// Only this grid of the scene file, or with "camera" only its camera.
    #[arg(long)]
    view: Option<String>,
    /// Samples of a sensor; --samples is for the camera's pixels.
    #[arg(long, default_value = "4096")]
    sensor_samples: u32,
    #[command(flatten)]
    overrides: Overrides,
    #[command(flatten)]
    files: SceneFiles,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Render again, and replace matrices that are there; results are replaced in any case.
    #[arg(long)]
    force: bool,
}

fn parse_schedule(text: &str) -> Result<Schedule, String> {
    Schedule::parse_hours(text).map_err(|error| error.to_string())
}

fn parse_months(text: &str) -> Result<(u8, u8), String> {
    let months = text.split_once('-').and_then(|(first, last)| Some((first.parse().ok()?, last.parse().ok()?)));
    let (first, last) = months.ok_or("write FIRST-LAST, such as 4-9")?;
    Schedule::default().in_months(first, last).map(|_| (first, last)).map_err(|error| error.to_string())
}

pub(crate) fn run(options: &Daylight, console: &Console) -> Result<()> {
    let climate = Climate::read(&options.climate)?;
    climate.warnings.iter().for_each(|warning| console.note(&format!("warning: {warning}")));
    check(options)?;
    options.files.one_camera()?;
    std::fs::create_dir_all(&options.output).map_err(Error::io(&options.output, "make the folder"))?;
    if let Some(subdivision) = options.sky_matrix {
        write_sky_matrix(options, &climate, subdivision)?;
    }
    let mut rows = Vec::new();
    if ltm::scene::is_scene_file(&options.input) {
        for view in views(options)? {
            rows.push(of_view(options, view.as_deref(), &climate, console)?);
        }
    } else {
        let name = options.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let row = of_matrix(options, &options.input, &name, None, &climate, console)?;
        rows.push(row);
    }
    let summary = options.output.join("summary.csv");
    write_file(&summary, true, format!("{SUMMARY}\n{}", rows.concat()).as_bytes())?;
    say!("{}: {} views", summary.display(), rows.len());
    Ok(())
}

const SUMMARY: &str = "view,places,dark,sda_percent,ase_percent,en_17037_class,da_percent,cda_percent,udi_below_percent,\
udi_supplementary_percent,udi_autonomous_percent,udi_above_percent,mean_lux,daylight_factor_percent";

fn check(options: &Daylight) -> Result<()> {
    let refuse = |place: &str, problem: String, hint: &str| Err(Error::input(place, problem, hint));
    if !(options.autonomy > 0.0 && options.autonomy.is_finite()) {
        return refuse("--autonomy", format!("{} is no illuminance", options.autonomy), "give lx above 0");
    }
    SkyOptions { ground_reflectance: options.ground, north_degrees: options.north }.check()
}

/// The views that are wanted: grids by name, none for the camera.
fn views(options: &Daylight) -> Result<Vec<Option<String>>> {
    let (grids, has_camera) = grid_names(&options.input)?;
    match options.view.as_deref() {
        Some("camera") => Ok(vec![None]),
        Some(name) => Ok(vec![Some(name.to_owned())]),
        None => Ok(grids.into_iter().map(Some).chain(has_camera.then_some(None)).collect()),
    }
}

/// Renders a view where its matrix is not there, and gives its row of the summary.
fn of_view(options: &Daylight, grid: Option<&str>, climate: &Climate, console: &Console) -> Result<String> {
    let load = ltm::scene::LoadOptions { grid: grid.map(str::to_owned), ..options.files.load_options(options.memory) };
    let mut loaded = options.overrides.of(pipeline::load_scene(&options.input, load)?);
    for warning in loaded.warnings.worded(in_flags) {
        console.note(&format!("warning: {warning}"));
    }
    let name = grid.unwrap_or("camera");
    let extension = if grid.is_some() || options.no_pack { "ltm" } else { "ltc" };
    let matrix = options.output.join(format!("{name}.{extension}"));
    match grid {
        Some(_) => loaded.settings.samples_per_pixel = options.sensor_samples,
        None => loaded = loaded.showing_irradiance(),
    }
    let wanted = pipeline::job_of(&loaded)?.provenance;
    let is_there = matrix.exists()
        && match extension {
            "ltm" => StoreReader::open(&matrix)?.job().provenance == wanted,
            _ => ContainerReader::open(&matrix)?.job().provenance == wanted,
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
        points
            .map(|p| (in_file(scene.origin, p.position).as_vec3().to_array(), p.normal.to_array()))
            .collect::<Vec<_>>()
    });
    of_matrix(options, &matrix, name, places.as_deref(), climate, console)
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

/// The year of a matrix: its files, and its row of the summary.
fn of_matrix(
    options: &Daylight,
    path: &Path,
    name: &str,
    places: Option<&[([f32; 3], [f32; 3])]>,
    climate: &Climate,
    console: &Console,
) -> Result<String> {
    let begun = std::time::Instant::now();
    let stem = options.output.join(name);
    let hours = options.hourly.then(|| options.output.join(format!("{name}-hours.npy")));
    let schedule = match options.months {
        Some((first, last)) => options.schedule.in_months(first, last)?,
        None => options.schedule,
    };
    let asked = DaylightOptions {
        sky: SkyOptions { ground_reflectance: options.ground, north_degrees: options.north },
        schedule,
        thresholds: Thresholds { autonomy: options.autonomy, ..Thresholds::default() },
        memory_bytes: options.memory,
        overwrite: true,
    };
    let place = path.display().to_string();
    let of = |source: DaylightSource<'_>, settings: &str| {
        if !shows_irradiance(settings) {
            let problem = "shows radiance, and not the irradiance of surfaces";
            let hint = "give the scene file, or render with irradiance = true in its [camera]";
            return Err(Error::input(&place, problem, hint));
        }
        pipeline::daylight(&source, &place, climate, &asked, hours.as_deref(), console)
    };
    let year = match kind_of(path)? {
        Kind::Container => {
            let container = ContainerReader::open(path)?;
            of(DaylightSource::Container(&container), &container.job().provenance.settings)?
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(path)?;
            of(DaylightSource::Stored(&matrix), &matrix.job().provenance.settings)?
        }
    };
    let written = pipeline::write_measures(&year, &stem, places, true)?;
    if let (Some(hours), true) = (&hours, year.size.1 == 1 || places.is_some()) {
        let ill = options.output.join(format!("{name}.ill"));
        pipeline::write_ill(&ill, hours, climate, year.measures.len(), true)?;
        say!("{}: lux of {} places at {} steps", ill.display(), year.measures.len(), climate.steps.len());
    }
    say!(
        "{}-*: {} files, the year in {:.1} s ({} × {} places, {} of {} steps lit)",
        stem.display(),
        written.len(),
        begun.elapsed().as_secs_f64(),
        year.size.0,
        year.size.1,
        year.lit_steps,
        climate.steps.len()
    );
    if year.dark > 0 && places.is_some() {
        let all = year.measures.len();
        let text = "no light reaches them; they may stand in walls or in sealed rooms, and are left out of the shares";
        console.note(&format!("warning: {name}: {} of {all} sensors: {text}", year.dark));
    }
    Ok(told(name, &year))
}

/// Says what a year gave; returns its row of the summary.
fn told(name: &str, year: &DaylightYear) -> String {
    let space = &year.space;
    let class = ["none", "minimum", "medium", "high"][space.en_17037_class()];
    let exposure = space.sunlight_exposure().map_or("unknown".to_owned(), |percent| format!("{percent:.1} %"));
    say!("{name}: sDA300,50 {:.1} %, ASE1000,250 {exposure}, EN 17037 {class}", space.spatial_autonomy());
    let mut means = Vec::new();
    for measure in (0..7).chain([ANNUAL_MEASURES.len() - 1]) {
        let ((measure, unit), mean) = (ANNUAL_MEASURES[measure], format!("{:.3}", space.mean(measure)));
        say!("{name}: mean {measure} {mean} {unit}");
        means.push(mean);
    }
    if space.sunlight_exposure().is_none() {
        say!("{name}: direct sun is told of a sky with split = true alone, by sensors and by pictures with --no-pack");
    }
    let exposure = space.sunlight_exposure().map(|percent| format!("{percent:.3}")).unwrap_or_default();
    let places = format!("{},{}", year.measures.len(), year.dark);
    format!("{name},{places},{:.3},{exposure},{class},{}\n", space.spatial_autonomy(), means.join(","))
}

/// Writes the skies of the climate in the form of `gendaymtx -of -c 1 1 1`.
fn write_sky_matrix(options: &Daylight, climate: &Climate, subdivision: u32) -> Result<()> {
    let patches = SkyPatches::of_subdivision(subdivision).ok_or_else(|| {
        let hint = format!("give 1 to {}", SkyPatches::MAX_SUBDIVISION);
        Error::input("--sky-matrix", format!("{subdivision} is no subdivision"), hint)
    })?;
    let sky = SkyOptions { ground_reflectance: options.ground, north_degrees: options.north };
    let model = SkyModel::new(climate, sky);
    let (rows, columns) = (patches.count() as usize, climate.steps.len());
    let mut values = vec![0.0; rows * columns * 3];
    let texels = SkyTexels::of_mapping(EnvironmentMapping::Patches(patches));
    for step in 0..columns {
        let sky = model.sky(step, &texels);
        for (patch, radiance) in sky.into_iter().enumerate() {
            values[(patch * columns + step) * 3..][..3].fill(radiance);
        }
    }
    let matrix = RadianceMatrix { rows, columns, components: 3, values };
    let path = options.output.join("sky.mtx");
    matrix.write(&path, MtxFormat::Float, &format!("ltm daylight --sky-matrix {subdivision}"), true)?;
    say!("{}: {rows} patches × {columns} steps", path.display());
    Ok(())
}
