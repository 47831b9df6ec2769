//! `ltm info`.

mod scene;

use std::path::{Path, PathBuf};

use clap::Args;
use ltm::container::ContainerReader;
use ltm::error_estimate::expected_error;
use ltm::image::{LinearImage, ToneMapping, false_colour, write_toned_png};
use ltm::light::{
    DenoiseErrors, DenoisedLight, column_name, denoise_errors_line, denoised_light_lines, expected_error_line,
    exposed_error_line, light_errors_lines,
};
use ltm::light::{Job, Light, LightBasis};
use ltm::matrix::{BlockId, ColumnIndex, FactorSource, MatrixShape};
use ltm::pipeline::open_container;
use ltm::resources::{MemoryNeed, hold_to_memory, human_bytes, parse_bytes};
use ltm::store::StoreReader;
use ltm::{Error, Result};
use ltm_cli::console::Console;
use ltm_cli::say;
use serde_json::{Value, json};

use crate::input::{Kind, kind_of, load_look};

/// Entries of a list that are shown to a person.
const MAX_LISTED: usize = 40;
/// Characters of a row of the rank map.
const MAP_CHARACTERS: u32 = 76;
/// Bytes of memory for each colour value of the rank map's image: as ranks, in colours, tone mapped and encoded.
const MAP_BYTES_PER_VALUE: u64 = 16;
/// Bytes of memory for each block that is listed as JSON: as a tree and as text.
const LISTED_BYTES: u64 = 2048;
/// Shades of the rank map, from none to the highest rank.
const SHADES: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

#[derive(Args)]
pub(crate) struct Info {
    /// The file.
    file: PathBuf,
    /// Print everything as JSON, for programs; figures that are not known are null.
    #[arg(long)]
    json: bool,
    /// Write the rank of each block as an image in false colours, black for none, as large as the picture (.ltc).
    #[arg(long, value_name = "FILE.png")]
    rank_map: Option<PathBuf>,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Read files that a scene or look names outside of its folder and of LTM_SCENES: for those whose author you trust.
    #[arg(long)]
    allow_outside: bool,
    /// A look file: with --json, each light's weight under it, the mean over its columns (.ltm, .ltc).
    #[arg(short, long, value_name = "FILE", requires = "json")]
    lighting: Option<PathBuf>,
    /// A named look of the look file [default: its rules outside of named looks].
    #[arg(long, value_name = "NAME", requires = "lighting")]
    look: Option<String>,
}

pub(crate) fn run(options: &Info, console: &Console) -> Result<()> {
    let path = &*options.file;
    if ltm::scene::is_scene_file(path) {
        return scene::run(path, options.json, options.allow_outside, options.memory);
    }
    match kind_of(path)? {
        Kind::Container => {
            let container = open_container(path)?;
            let map_bytes = options.rank_map.as_ref().map_or(0, |_| container.shape().rows() * MAP_BYTES_PER_VALUE);
            let listed_bytes = if options.json { u64::from(container.shape().block_count()) * LISTED_BYTES } else { 0 };
            let bytes = container.fixed_bytes() + map_bytes.max(listed_bytes);
            hold_to_memory("looking into the container", bytes, options.memory)?;
            let figures = Figures::of(&container);
            if let Some(map) = &options.rank_map {
                write_rank_map(map, &container)?;
            }
            if options.json {
                let mut json = container_json(path, &container, &figures);
                add_weights(&mut json, container.job(), options)?;
                print_json(json);
            } else {
                print_job(path, container.job());
                print_container(&container, &figures);
            }
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(path)?;
            let tally = matrix.tally()?;
            // Of damaged blocks `ltm verify` tells; what else is known is said without them.
            let error = expected_error(&matrix, options.memory, console);
            let error = match error {
                Err(Error::Damaged { .. }) => None,
                other => other?,
            };
            if options.json {
                let mut json = job_json(path, matrix.job());
                add_weights(&mut json, matrix.job(), options)?;
                json["kind"] = "matrix".into();
                json["precision"] = matrix.precision().to_string().into();
                json["planes"] = matrix.layout().has_planes().into();
                json["committed_blocks"] = tally.committed.into();
                json["damaged_records"] = tally.damaged.into();
                json["file_bytes"] = tally.stored_bytes.into();
                json["expected_error"] = error.into();
                print_json(json);
            } else {
                print_job(path, matrix.job());
                say!("precision    {}", matrix.precision());
                let planes = if matrix.layout().has_planes() { "layers and features of its samples" } else { "none" };
                say!("planes       {planes}");
                say!("committed    {} of {} blocks", tally.committed, matrix.job().shape.block_count());
                if tally.damaged > 0 {
                    say!("damaged      {} commit records; ltm verify names them", tally.damaged);
                }
                say!("size         {} in the committed blocks", human_bytes(tally.stored_bytes));
                error.iter().for_each(|&error| say!("error        {}", expected_error_line(error)));
            }
        }
    }
    Ok(())
}

/// What the index of a container says as a whole. Unknown figures are NaN.
struct Figures {
    present_blocks: usize,
    mean_rank: f64,
    largest_rank: usize,
    sparse_entries: u64,
    /// Of the matrix's entries.
    relative_l2: f64,
    /// Block of the largest relative error, and that error.
    worst: Option<(BlockId, f64)>,
    /// Largest relative error of a block's pixels with all lights on.
    worst_uniform: f64,
    /// Root mean square of a stored entry and of its noise.
    signal_rms: f64,
    noise_rms: f64,
    base_bytes: u64,
}

impl Figures {
    fn of(container: &ContainerReader) -> Self {
        let shape = container.shape();
        let blocks: Vec<BlockId> = shape.blocks().filter(|&id| container.has_block(id)).collect();
        let sum = |part: &dyn Fn(BlockId) -> f64| blocks.iter().map(|&id| part(id)).sum::<f64>();
        let entries = |id: BlockId| (shape.rect(id).rows() * shape.columns()) as f64;
        let report = |id: BlockId| container.block_report(id);
        let (squared_error, squared_norm) = (sum(&|id| report(id).squared_error), sum(&|id| report(id).squared_norm));
        let known = blocks.iter().map(|&id| (id, report(id).relative_error())).filter(|(_, error)| error.is_finite());
        let uniform = blocks.iter().map(|&id| report(id).uniform_error);
        let count = sum(&entries).max(1.0);
        Self {
            present_blocks: blocks.len(),
            mean_rank: sum(&|id| container.rank(id) as f64) / blocks.len().max(1) as f64,
            largest_rank: blocks.iter().map(|&id| container.rank(id)).max().unwrap_or(0),
            sparse_entries: blocks.iter().map(|&id| container.sparse_entries(id) as u64).sum(),
            relative_l2: if squared_error == 0.0 { 0.0 } else { (squared_error / squared_norm).sqrt() },
            worst: known.max_by(|a, b| a.1.total_cmp(&b.1)),
            worst_uniform: uniform.filter(|e| e.is_finite()).reduce(f64::max).unwrap_or(f64::NAN),
            signal_rms: (squared_norm / count).sqrt(),
            noise_rms: (sum(&|id| report(id).noise_variance * entries(id)) / count).sqrt(),
            base_bytes: container.base_bytes(),
        }
    }
}

fn print_job(path: &Path, job: &Job) {
    let shape = job.shape;
    say!("{}", path.display());
    say!("source       {} ({})", job.provenance.source, job.provenance.program);
    if !job.provenance.settings.is_empty() {
        say!("settings     {}", job.provenance.settings);
    }
    say!("job          {}", job.hash());
    say!("image        {} × {} pixels", shape.width(), shape.height());
    say!("matrix       {} rows × {} columns, {} in f32", shape.rows(), shape.columns(), human_bytes(shape.raw_bytes()));
    say!("blocks       {} of {side} × {side} pixels", shape.block_count(), side = shape.block_side());
    print_lights(&job.basis);
}

fn print_lights(basis: &LightBasis) {
    say!("lights       {}", basis.lights().len());
    for light in basis.lights().iter().take(MAX_LISTED) {
        let [r, g, b] = light.emission;
        say!("  {:<24} {}, emission {r:.3} {g:.3} {b:.3} {}", light.name, light.kind, light.unit);
    }
    print_more(basis.lights().len());
}

/// Says how many of a list were left out.
fn print_more(count: usize) {
    if count > MAX_LISTED {
        say!("  … and {} more (all with --json)", count - MAX_LISTED);
    }
}

fn print_container(container: &ContainerReader, figures: &Figures) {
    let (shape, report) = (container.shape(), container.report());
    let said = |text: &str| if text.is_empty() { "not said".to_owned() } else { text.to_owned() };
    let known = |figure: f64, text: String| if figure.is_nan() { "not known".to_owned() } else { text };
    let (bytes, base) = (container.file_bytes(), figures.base_bytes);
    say!(
        "packed by    {}: method {}, for {}, prior {}",
        said(&report.program),
        said(&report.method),
        said(&report.target),
        said(&report.prior)
    );
    say!("size         {}, {:.0}× smaller than f32", human_bytes(bytes), shape.raw_bytes() as f64 / bytes as f64);
    say!(
        "base layer   {}, {:.1} % of the file, gives the first whole image",
        human_bytes(base),
        100.0 * base as f64 / bytes as f64
    );
    if figures.present_blocks < shape.block_count() as usize {
        say!(
            "holds        {} of {} blocks; ltm merge joins it with the others",
            figures.present_blocks,
            shape.block_count()
        );
    }
    say!(
        "rank         mean {:.2}, largest {}; {} sparse entries",
        figures.mean_rank,
        figures.largest_rank,
        figures.sparse_entries
    );
    say!(
        "error        {}",
        known(
            figures.relative_l2,
            format!("{:.2e} relative L2 of the matrix, measured to about 1 %", figures.relative_l2)
        )
    );
    if let Some((id, error)) = figures.worst {
        let rect = shape.rect(id);
        say!("  worst      {error:.2e} in {id} (pixels from {}, {})", rect.x, rect.y);
    }
    say!(
        "  all on     {}",
        known(figures.worst_uniform, format!("at most {:.2e} relative L2 of a block's pixels", figures.worst_uniform))
    );
    if let Some(errors) = &container.errors().denoising {
        say!("  {}", denoise_errors_line(errors));
    }
    let of_lights = denoised_light_lines(&container.errors().denoised_lights, &container.job().basis);
    of_lights.iter().for_each(|line| say!("    {line}"));
    if let Some(error) = &container.errors().exposed {
        say!("  {}", exposed_error_line(error));
    }
    match &container.errors().lights {
        Some(errors) => {
            let lines = light_errors_lines(errors, &container.job().basis);
            lines.iter().for_each(|line| say!("  {line}"));
        }
        None => say!("  images under single lights and at random: not known"),
    }
    let noise = figures.noise_rms / figures.signal_rms;
    say!("noise        {}", known(noise, format!("{noise:.2e} of the matrix's root mean square, before packing")));
    say!("rank map     ' ' is 0, '█' is {}", figures.largest_rank);
    rank_map(container, figures.largest_rank.max(1)).iter().for_each(|row| say!("  {row}"));
}

/// A character for each block, or for as many blocks as it takes to fit: their highest rank.
fn rank_map(container: &ContainerReader, largest: usize) -> Vec<String> {
    let shape = container.shape();
    // Characters are about twice as high as wide: each block is two of them where there is room.
    let (wide, step) = match shape.blocks_across() {
        across if across * 2 <= MAP_CHARACTERS => (2, 1),
        across => (1, across.div_ceil(MAP_CHARACTERS)),
    };
    let step_down = if wide == 2 { 1 } else { 2 * step };
    let rank = |x: u32, y: u32| block_at(shape, x, y).map_or(0, |id| container.rank(id));
    let row = |y: u32| {
        let cells = (0..shape.blocks_across()).step_by(step as usize).map(|x| {
            let ranks = (y..y + step_down).flat_map(|y| (x..x + step).map(move |x| (x, y))).map(|(x, y)| rank(x, y));
            let highest = ranks.max().unwrap_or(0);
            SHADES[(highest * (SHADES.len() - 1)).div_ceil(largest).min(SHADES.len() - 1)].to_string().repeat(wide)
        });
        cells.collect::<String>()
    };
    (0..shape.blocks_down()).step_by(step_down as usize).map(row).collect()
}

fn block_at(shape: MatrixShape, x: u32, y: u32) -> Option<BlockId> {
    (x < shape.blocks_across() && y < shape.blocks_down()).then(|| BlockId(y * shape.blocks_across() + x))
}

fn write_rank_map(path: &Path, container: &ContainerReader) -> Result<()> {
    let shape = container.shape();
    let mut map = LinearImage::black(shape.width(), shape.height());
    for (i, pixel) in map.pixels.iter_mut().enumerate() {
        let (x, y) = (i as u32 % shape.width(), i as u32 / shape.width());
        *pixel = [shape.block_at(x, y).map_or(0.0, |(id, _)| container.rank(id) as f32); 3];
    }
    let largest = map.values().iter().copied().fold(1.0, f32::max);
    // Shades from half a rank up, so that rank 0 alone is black.
    let coloured = false_colour(&map, 0.5, largest)?;
    write_toned_png(path, &coloured, ToneMapping::default())
}

fn job_json(path: &Path, job: &Job) -> Value {
    let (shape, provenance) = (job.shape, &job.provenance);
    json!({
        "file": path.display().to_string(),
        "job": job.hash().0.iter().map(|byte| format!("{byte:02x}")).collect::<String>(),
        "width": shape.width(), "height": shape.height(), "rows": shape.rows(), "columns": shape.columns(),
        "block_side": shape.block_side(), "blocks_across": shape.blocks_across(), "blocks": shape.block_count(),
        "raw_bytes": shape.raw_bytes(),
        "provenance": {
            "source": provenance.source, "program": provenance.program, "settings": provenance.settings,
            "samples_per_pixel": provenance.samples_per_pixel, "seed": provenance.seed,
            "metres_per_unit": provenance.metres_per_unit,
        },
        "lights": lights_json(&job.basis),
    })
}

fn lights_json(basis: &LightBasis) -> Value {
    let light = |light: &Light| {
        let (across, down) = light.layout();
        json!({
            "name": light.name, "kind": light.kind.name(), "unit": light.unit.to_string(),
            "emission": light.emission, "first_column": light.first_column, "columns": light.places.len(),
            "across": across, "down": down,
        })
    };
    basis.lights().iter().map(light).collect()
}

/// Adds to each light its weight under the look that is asked for, and in the scene's own lighting: the means over its columns
/// by their extents; and whether the first is the same in all.
fn add_weights(json: &mut Value, job: &Job, options: &Info) -> Result<()> {
    let Some(path) = &options.lighting else { return Ok(()) };
    let look = load_look(path, &job.basis, options.allow_outside)?;
    let lighting = match &options.look {
        Some(name) => look.named(name)?,
        None => look.lighting(),
    };
    let (weights, scene_weights) = (lighting.weights(), job.basis.scene_weights());
    for (index, light) in job.basis.lights().iter().enumerate() {
        let columns = light.columns().start as usize..light.columns().end as usize;
        let (own, scene) = (&weights[columns.clone()], &scene_weights[columns]);
        let whole: f64 = light.extents.iter().map(|e| f64::from(*e)).sum();
        let share = |e: f32| if whole > 0.0 { f64::from(e) / whole } else { 1.0 / own.len() as f64 };
        let mean = |weights: &[[f32; 3]]| {
            let channel =
                |c: usize| weights.iter().zip(&light.extents).map(|(w, e)| f64::from(w[c]) * share(*e)).sum::<f64>();
            [0, 1, 2].map(channel)
        };
        json["lights"][index]["weight"] = json!(mean(own));
        json["lights"][index]["scene_weight"] = json!(mean(scene));
        json["lights"][index]["is_even"] = own.iter().all(|weight| *weight == own[0]).into();
    }
    let groups = look.groups().iter().map(|(name, columns)| {
        let lights = job.basis.lights().iter().filter(|light| columns.contains(&light.first_column));
        (name.clone(), lights.map(|light| light.name.as_str()).collect::<Value>())
    });
    json["groups"] = Value::Object(groups.collect());
    Ok(())
}

fn container_json(path: &Path, container: &ContainerReader, figures: &Figures) -> Value {
    let (shape, report) = (container.shape(), container.report());
    let mut json = job_json(path, container.job());
    json["kind"] = "container".into();
    json["file_bytes"] = container.file_bytes().into();
    json["base_layer_bytes"] = figures.base_bytes.into();
    json["ratio"] = (shape.raw_bytes() as f64 / container.file_bytes() as f64).into();
    json["mean_rank"] = figures.mean_rank.into();
    json["sparse_entries"] = figures.sparse_entries.into();
    json["relative_l2"] = figures.relative_l2.into();
    json["signal_rms"] = figures.signal_rms.into();
    json["noise_rms"] = figures.noise_rms.into();
    json["packing"] = json!({
        "program": report.program, "method": report.method, "target": report.target, "prior": report.prior,
        "settings": report.settings, "provenance": report.provenance,
    });
    let of_denoising = |errors: &DenoiseErrors| {
        let DenoiseErrors { noise_before, noise_after, bias } = errors;
        json!({ "noise_before": noise_before, "noise_after": noise_after, "bias": bias })
    };
    json["cleaning_errors"] = container.errors().denoising.as_ref().map_or(Value::Null, of_denoising);
    let lights = container.job().basis.lights().iter().zip(&container.errors().denoised_lights);
    json["cleaning_errors_of_lights"] = lights
        .map(|(light, DenoisedLight { errors, light_kept })| {
            let mut of_light = of_denoising(errors);
            of_light["light"] = light.name.as_str().into();
            of_light["light_kept"] = (*light_kept).into();
            of_light
        })
        .collect::<Vec<_>>()
        .into();
    json["exposed_error"] = (container.errors().exposed)
        .map_or(Value::Null, |error| json!({ "asked": error.asked, "reached": error.reached }));
    json["light_errors"] = container.errors().lights.map_or(Value::Null, |errors| {
        let basis = &container.job().basis;
        json!({
            "prior_expected": errors.prior, "all_on": errors.all_on, "random": errors.random,
            "single_mean": errors.single_mean, "single_worst": errors.single_worst,
            "worst_column": errors.worst_column, "worst_light": column_name(ColumnIndex(errors.worst_column), basis),
            "noise_mean": errors.noise_mean, "noise_worst": errors.noise_worst,
        })
    });
    let blocks = shape.blocks().map(|id| {
        let report = container.block_report(id);
        json!({
            "present": container.has_block(id), "rank": container.rank(id), "sparse_entries": container.sparse_entries(id),
            "bytes": container.encoded_bytes(id, 0..container.layer_count(id)), "layers": container.layer_count(id),
            "relative_l2": report.relative_error(), "all_on_relative_l2": report.uniform_error,
            "noise_variance": report.noise_variance,
        })
    });
    json["block_list"] = blocks.collect::<Vec<_>>().into();
    json
}

fn print_json(json: Value) {
    println!("{}", serde_json::to_string_pretty(&json).expect("values of ours can be written"));
}
