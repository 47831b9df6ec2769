//! `ltm daylight`.

mod blinds;
mod dimming;
mod glare;
mod render;
mod view;

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::daylight::{
    ANNUAL_MEASURES, Climate, MtxFormat, RadianceMatrix, Schedule, SkyModel, SkyOptions, SkyTexels, Thresholds,
    glare_limits_lux,
};
use ltm::files::write_file;
use ltm::light::{EnvironmentMapping, SkyPatches};
use ltm::pipeline::{self, DaylightOptions, DaylightYear};
use ltm::resources::{Progress, parse_bytes};
use ltm::{Error, Result};

use self::blinds::Rule;
use self::dimming::Zone;
use self::view::{OpenMatrix, View, ViewBlinds};
use crate::input::{Overrides, SceneFiles};
use ltm_cli::console::Console;
use ltm_cli::say;

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
    /// The same scene with closed blinds, which all measures but direct sun and the daylight factor then see in the hours in which --close
    /// closes them: a scene file with the same views or, beside a matrix, a matrix.
    #[arg(long, value_name = "FILE")]
    blinds: Option<PathBuf>,
    /// When blinds are closed: [GRID,]LUX,SHARE where direct sun is above LUX on more than a share of the sensors, or GRID:SENSOR,LUX where a
    /// sensor has more [default: 1000lx,2% of each grid itself].
    #[arg(long, value_name = "RULE", requires = "blinds")]
    close: Option<Rule>,
    /// A grid whose sensors are eyes: glare at them by the simplified daylight glare probability; several by an option each.
    #[arg(long, value_name = "GRID")]
    eyes: Vec<String>,
    /// Lamps that a sensor dims to a set point, LAMPS=GRID:SENSOR,SETPOINT,POWER[,LEAST[,POWER THERE]][,off], such as
    /// 'desk-lamps=desk:5,500lx,120W,10%,30W'; several by an option each. lamps.csv has their electric energy.
    #[arg(long = "dim", value_name = "ZONE")]
    zones: Vec<Zone>,
    /// Write all hours too: -hours.npy [places, steps], for grids Radiance's .ill, of --dim lamps-hours.csv, of --blinds blinds-hours.csv.
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
    let names = render::view_names(options)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    dimming::check_views(&options.zones, &names)?;
    glare::check_views(&options.eyes, &names)?;
    let asked = asked(options)?;
    let of_file = |file: &Path, folder: &Path| -> Result<Vec<View>> {
        names.iter().map(|name| render::view_of(options, (file, folder), (name, &names), console)).collect()
    };
    let rule = options.close.clone().unwrap_or_default();
    if options.blinds.is_some() {
        names.iter().try_for_each(|name| rule.decider(name, &names, &options.eyes).map(|_| ()))?;
    }
    let mut views = of_file(&options.input, &options.output)?;
    if let Some(blinds) = &options.blinds {
        let closed = of_file(blinds, &options.output.join("closed"))?;
        blinds::close((&rule, &options.eyes), (&mut views, &closed), &climate, &asked, console)?;
        if options.hourly {
            blinds::write_hours(&options.output.join("blinds-hours.csv"), &views, &climate)?;
        }
    }
    let mut rows = Vec::new();
    for view in &views {
        rows.push(year_of(options, &asked, view, &climate, console)?);
    }
    if !options.zones.is_empty() {
        let target = (&*options.output, options.hourly);
        dimming::dim(&options.zones, (&views, &climate), &asked, target, console)?;
    }
    let summary = options.output.join("summary.csv");
    write_file(&summary, true, format!("{SUMMARY}\n{}", rows.concat()).as_bytes())?;
    say!("{}: {} views", summary.display(), rows.len());
    Ok(())
}

const SUMMARY: &str = "view,places,dark,sda_percent,ase_percent,en_17037_class,da_percent,cda_percent,udi_below_percent,\
udi_supplementary_percent,udi_autonomous_percent,udi_above_percent,mean_lux,daylight_factor_percent,closed_hours,\
dgps_035_percent,dgps_040_percent,dgps_045_percent";

fn check(options: &Daylight) -> Result<()> {
    let refuse = |place: &str, problem: String, hint: &str| Err(Error::input(place, problem, hint));
    if !(options.autonomy > 0.0 && options.autonomy.is_finite()) {
        return refuse("--autonomy", format!("{} is no illuminance", options.autonomy), "give lx above 0");
    }
    let is_scene = ltm::scene::is_scene_file;
    if let Some(blinds) = options.blinds.as_ref().filter(|blinds| is_scene(blinds) != is_scene(&options.input)) {
        let problem = format!("goes with no {}", options.input.display());
        let hint = "give a scene file beside a scene file, or a matrix beside a matrix";
        return refuse(&blinds.display().to_string(), problem, hint);
    }
    SkyOptions { ground_reflectance: options.ground, north_degrees: options.north }.check()
}

/// Choices of the year.
fn asked(options: &Daylight) -> Result<DaylightOptions<'static>> {
    let schedule = match options.months {
        Some((first, last)) => options.schedule.in_months(first, last)?,
        None => options.schedule,
    };
    Ok(DaylightOptions {
        blinds: None,
        sky: SkyOptions { ground_reflectance: options.ground, north_degrees: options.north },
        schedule,
        thresholds: Thresholds { autonomy: options.autonomy, ..Thresholds::default() },
        memory_bytes: options.memory,
        overwrite: true,
    })
}

/// The year of a view: its files, and its row of the summary.
fn year_of(
    options: &Daylight,
    asked: &DaylightOptions<'_>,
    view: &View,
    climate: &Climate,
    console: &Console,
) -> Result<String> {
    let begun = std::time::Instant::now();
    let (name, places) = (&*view.name, view.places.as_deref());
    let stem = options.output.join(name);
    let hours = options.hourly.then(|| options.output.join(format!("{name}-hours.npy")));
    let (matrix, place) = (OpenMatrix::open(&view.matrix)?, view.matrix.display().to_string());
    let is_of_eyes = options.eyes.contains(&view.name);
    let thresholds = Thresholds { glare: is_of_eyes.then(glare_limits_lux), ..asked.thresholds };
    let asked = DaylightOptions { blinds: view.blinds.as_ref().map(ViewBlinds::blinds), thresholds, ..*asked };
    let year = pipeline::daylight(&matrix.source(), &place, climate, &asked, hours.as_deref(), console)?;
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
    let closed = view.blinds.as_ref().map(|blinds| format!("{:.3}", blinds.closed_hours(climate, &asked)));
    let row = format!("{},{}", told(name, &year), closed.unwrap_or_default());
    let glare = match is_of_eyes {
        true => glare::write((view, &year), (&stem, hours.as_deref()), climate, console)?,
        false => ",,".into(),
    };
    Ok(format!("{row},{glare}\n"))
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
    format!("{name},{places},{:.3},{exposure},{class},{}", space.spatial_autonomy(), means.join(","))
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
