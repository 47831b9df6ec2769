//! `ltm`: render a scene into its light transport matrix, relight it, look into the files.

#![expect(clippy::print_stdout, reason = "a program's results go to standard output")]

mod console;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum};
use console::{Console, EXIT_CODES};
use ltm::container::ContainerReader;
use ltm::light::{Job, Lighting};
use ltm::pipeline::demo::demo;
use ltm::pipeline::{self, Device, RenderOptions, Watch, human_bytes, parse_bytes};
use ltm::scene::LoadedScene;
use ltm::store::{Precision, StoreReader};
use ltm::view::WindowOptions;
use ltm::{Error, Result};

/// Samples per pixel of the demonstration: what keeps it under a minute on two cores.
const DEMO_SAMPLES: u32 = 256;

/// Light transport matrices: trace a scene once, then relight it at once.
///
/// Without a command, runs the demonstration into the folder `out`.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Threads to use [default: one for each core].
    #[arg(long, global = true)]
    threads: Option<usize>,
}

#[derive(Subcommand)]
enum Command {
    /// Render, pack and relight the embedded room, and print what it cost and what it lost.
    #[command(after_help = "Example: ltm demo --out room --samples 16")]
    Demo(Demo),
    /// Render a scene file into a stored matrix (.ltm). An interrupted render is continued by the same command.
    #[command(after_help = "Examples:
  ltm render room.toml                       writes room.ltm
  ltm render room.toml -o t.ltm --samples 256 --size 1024x768
  ltm render room.toml --blocks 0..100       one part of a farm's work")]
    Render(Render),
    /// Make an image from a container (.ltc) or a stored matrix (.ltm) under a lighting.
    #[command(after_help = "Examples:
  ltm relight room.ltc -o room.exr
  ltm relight room.ltc -o room.png --on desk --on 'ceiling*' --device cpu")]
    Relight(Relight),
    /// Read every byte of a .ltm or .ltc file and list what is damaged.
    #[command(after_help = "Exits with 4 if anything is. Example: ltm verify room.ltm")]
    Verify {
        /// The file.
        file: PathBuf,
    },
    /// Render the damaged and missing blocks of a matrix again.
    #[command(after_help = "Example: ltm repair room.ltm room.toml --samples 256")]
    Repair(Repair),
    /// Join files that hold different blocks of the same job. Doing it again changes nothing.
    #[command(after_help = "Example: ltm merge -o whole.ltm part-*.ltm")]
    Merge {
        /// The parts: all .ltm or all .ltc.
        #[arg(required = true)]
        parts: Vec<PathBuf>,
        /// The joined file.
        #[arg(short, long)]
        output: PathBuf,
        /// Replace a container that is there (a matrix is added to).
        #[arg(long)]
        force: bool,
    },
    /// Open a container in a window: a mixer for its lights.
    #[command(after_help = "Needs a build with --features view. Keys are listed under '?'. Example: ltm view room.ltc")]
    View {
        /// The container; without it, one is dropped on the window.
        file: Option<PathBuf>,
        /// Save a PNG of the window once its picture stands, and close it.
        #[arg(long, value_name = "PNG")]
        screenshot: Option<PathBuf>,
    },
    /// Say what a .ltm or .ltc file is.
    #[command(after_help = "Example: ltm info room.ltc")]
    Info {
        /// The file.
        file: PathBuf,
    },
}

#[derive(Args)]
struct Demo {
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

#[derive(Args)]
struct Render {
    /// The scene file.
    scene: PathBuf,
    /// The matrix to write [default: the scene file's name with .ltm, in this folder].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Samples per pixel [default: the scene file's].
    #[arg(long)]
    samples: Option<u32>,
    /// Image size, WIDTHxHEIGHT [default: the scene file's].
    #[arg(long, value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Precision of the stored entries.
    #[arg(long, value_enum, default_value = "f32")]
    precision: PrecisionName,
    /// Only these blocks, FIRST..END.
    #[arg(long, value_parser = parse_range)]
    blocks: Option<std::ops::Range<u32>>,
    /// Replace a matrix that is there.
    #[arg(long)]
    force: bool,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
}

#[derive(Args)]
struct Repair {
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
}

#[derive(Args)]
struct Relight {
    /// The container or matrix.
    input: PathBuf,
    /// The image to write, .exr or .png.
    #[arg(short, long)]
    output: PathBuf,
    /// Only lights whose name matches this (`*` stands for anything); may be given several times [default: all].
    #[arg(long)]
    on: Vec<String>,
    /// Where to compute.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceName,
}

#[derive(Clone, Copy, ValueEnum)]
enum PrecisionName {
    F32,
    F16,
    Bf16,
}

#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    Auto,
    Cpu,
    Gpu,
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').ok_or("write WIDTHxHEIGHT, for example 1024x768")?;
    let side = |s: &str| s.parse().map_err(|e| format!("'{s}' is not a size ({e})"));
    Ok((side(width)?, side(height)?))
}

fn parse_range(text: &str) -> Result<std::ops::Range<u32>, String> {
    let (first, end) = text.split_once("..").ok_or("write FIRST..END, for example 0..100")?;
    let index = |s: &str| s.parse().map_err(|e| format!("'{s}' is not a block index ({e})"));
    Ok(index(first)?..index(end)?)
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let console = Console::new();
    console::finish("ltm", run(arguments, &console))
}

fn run(arguments: Arguments, console: &Console) -> Result<()> {
    console::use_threads(arguments.threads)?;
    let default_demo = || Command::Demo(Demo { out: "out".into(), samples: None, size: None });
    match arguments.command.unwrap_or_else(default_demo) {
        Command::Demo(options) => run_demo(&options, console),
        Command::Render(options) => run_render(&options, console),
        Command::Relight(options) => run_relight(&options, console),
        Command::Verify { file } => run_verify(&file),
        Command::Repair(options) => run_repair(&options, console),
        Command::Merge { parts, output, force } => run_merge(&parts, &output, force),
        Command::View { file, screenshot } => {
            let options = WindowOptions { path: file, screenshot, frames: 10, ..Default::default() };
            ltm::view::run(options)
        }
        Command::Info { file } => run_info(&file),
    }
}

fn run_demo(options: &Demo, console: &Console) -> Result<()> {
    let loaded = with_overrides(ltm::scene::built_in(), options.samples.or(Some(DEMO_SAMPLES)), options.size);
    let report = demo(loaded, &options.out, console)?;
    let out = options.out.display();
    println!("{report}\n");
    println!("The images are in {out}/. Next:");
    println!("  ltm info {out}/demo.ltc                       what the container is");
    println!("  ltm relight {out}/demo.ltc -o relit.png       relight it in milliseconds");
    println!("  ltm render SCENE.toml                     your own scene; formats/scene.md says how to write one");
    Ok(())
}

fn run_render(options: &Render, console: &Console) -> Result<()> {
    let loaded = with_overrides(ltm::scene::load(&options.scene)?, options.samples, options.size);
    for warning in &loaded.warnings {
        console.note(&format!("warning: {warning}"));
    }
    let output = options.output.clone().unwrap_or_else(|| beside(&options.scene, "ltm"));
    let store = ltm::store::StoreOptions {
        overwrite: options.force,
        precision: match options.precision {
            PrecisionName::F32 => Precision::F32,
            PrecisionName::F16 => Precision::F16,
            PrecisionName::Bf16 => Precision::Bf16,
        },
        ..Default::default()
    };
    let render = RenderOptions { store, blocks: options.blocks.clone(), memory_bytes: options.memory };
    let report = pipeline::render(loaded, &output, &render, console)?;
    println!(
        "{}: {} blocks in {:.1} s, {:.2} M rays/s, peak memory {}",
        output.display(),
        report.blocks_traced,
        report.seconds,
        report.rays as f64 / report.seconds / 1e6,
        report.peak_memory_bytes.map_or("unknown".into(), human_bytes),
    );
    if report.non_finite > 0 {
        println!("{} contributions were not finite and were dropped", report.non_finite);
    }
    match report.blocks_missing {
        0 => println!("next: ltm-pack {}", output.display()),
        missing => println!("{missing} blocks are still missing: render them too, then ltm merge"),
    }
    Ok(())
}

/// A scene with the samples and size that the command line asks for, and the identity that goes with them.
fn with_overrides(mut loaded: LoadedScene, samples: Option<u32>, size: Option<(u32, u32)>) -> LoadedScene {
    loaded.settings.samples_per_pixel = samples.unwrap_or(loaded.settings.samples_per_pixel);
    if let Some((width, height)) = size {
        (loaded.scene.camera.width, loaded.scene.camera.height) = (width, height);
    }
    loaded.content = ltm::scene::content_hash(&loaded.scene, loaded.settings.max_depth);
    loaded
}

fn run_relight(options: &Relight, console: &Console) -> Result<()> {
    let device = match options.device {
        DeviceName::Auto => Device::Auto,
        DeviceName::Cpu => Device::Cpu,
        DeviceName::Gpu => Device::Gpu,
    };
    let (image, by) = match kind_of(&options.input)? {
        Kind::Container => {
            let container = ContainerReader::open(&options.input)?;
            let lighting = chosen(container.job(), &options.on)?;
            let (mut images, by) = pipeline::relight(&container, &[lighting], device, console)?;
            (images.remove(0), by)
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(&options.input)?;
            let lighting = chosen(matrix.job(), &options.on)?;
            (ltm::relight::relight_raw(&matrix, &[lighting])?.remove(0), "the raw matrix".to_owned())
        }
    };
    match options.output.extension().and_then(|e| e.to_str()) {
        Some("exr") => ltm::image::write_exr(&options.output, &image)?,
        Some("png") => ltm::image::write_png(&options.output, &image, 0.9)?,
        _ => {
            let problem = "the name ends neither in .exr nor in .png";
            return Err(Error::input(options.output.display().to_string(), problem, "name the image x.exr or x.png"));
        }
    }
    println!("{}: relit by {by}", options.output.display());
    Ok(())
}

/// The scene's own lighting, with only the lights on whose names match one of the patterns.
fn chosen(job: &Job, patterns: &[String]) -> Result<Lighting> {
    if patterns.is_empty() {
        return Ok(Lighting::of_scene(&job.basis));
    }
    let mut weights = vec![[0.0; 3]; job.shape.columns()];
    for pattern in patterns {
        let mut found = false;
        for light in job.basis.lights().iter().filter(|light| matches(pattern, &light.name)) {
            found = true;
            light.columns().for_each(|column| weights[column as usize] = light.emission);
        }
        if !found {
            let names: Vec<_> = job.basis.lights().iter().take(12).map(|light| light.name.as_str()).collect();
            let problem = "no light matches";
            return Err(Error::input(
                format!("light '{pattern}'"),
                problem,
                format!("the lights are {}", names.join(", ")),
            ));
        }
    }
    Lighting::new(weights)
}

/// Whether `name` matches `pattern`, in which `*` stands for any run of characters.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, tail)) => name
            .strip_prefix(head)
            .is_some_and(|rest| rest.char_indices().any(|(i, _)| matches(tail, &rest[i..])) || matches(tail, "")),
    }
}

fn run_verify(path: &Path) -> Result<()> {
    let (faults, missing) = match kind_of(path)? {
        Kind::Container => {
            let found = ltm::container::verify(path)?;
            println!("{}: {} blocks, {} chunks read", path.display(), found.blocks, found.chunks);
            let place = |block: Option<_>| block.map_or("header".to_owned(), |id| format!("{id}"));
            (found.faults.iter().map(|fault| format!("{}: {}", place(fault.block), fault.problem)).collect(), 0)
        }
        Kind::Matrix => {
            let found = ltm::store::verify(path, |_, _| {})?;
            println!("{}: {} blocks, {} read", path.display(), found.blocks, human_bytes(found.verified_bytes));
            let damaged = found.damaged.iter().map(|damage| format!("{}: {}", damage.block, damage.problem));
            (damaged.chain(found.stray.iter().cloned()).collect::<Vec<_>>(), found.missing.len())
        }
    };
    faults.iter().for_each(|fault| println!("damaged: {fault}"));
    if missing > 0 {
        println!("{missing} blocks were never written");
    }
    if faults.is_empty() {
        println!("sound");
        return Ok(());
    }
    let hint = "the other blocks can be read; repair it with ltm repair, or make it again";
    Err(Error::damaged(path, format!("{} places are damaged", faults.len()), hint))
}

fn run_repair(options: &Repair, console: &Console) -> Result<()> {
    let loaded = with_overrides(ltm::scene::load(&options.scene)?, options.samples, options.size);
    let repaired = pipeline::repair(loaded, &options.file, console)?;
    println!("{}: {} blocks rendered again", options.file.display(), repaired.len());
    Ok(())
}

fn run_merge(parts: &[PathBuf], output: &Path, force: bool) -> Result<()> {
    match kind_of(output)? {
        Kind::Container => {
            let paths: Vec<&Path> = parts.iter().map(PathBuf::as_path).collect();
            let summary = ltm::container::merge(&paths, output, force)?;
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

enum Kind {
    Container,
    Matrix,
}

fn kind_of(path: &Path) -> Result<Kind> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("ltc") => Ok(Kind::Container),
        Some("ltm") | Some("part") => Ok(Kind::Matrix),
        _ => Err(Error::input(
            path.display().to_string(),
            "the name ends neither in .ltc nor in .ltm",
            "give a container made by ltm-pack or a matrix made by ltm render",
        )),
    }
}

fn run_info(path: &Path) -> Result<()> {
    match kind_of(path)? {
        Kind::Container => {
            let container = ContainerReader::open(path)?;
            print_job(path, container.job());
            println!("size         {}", human_bytes(container.file_bytes()));
            let ratio = container.job().shape.raw_bytes() as f64 / container.file_bytes() as f64;
            println!("ratio        {ratio:.0}× of f32");
        }
        Kind::Matrix => {
            let matrix = StoreReader::open(path)?;
            print_job(path, matrix.job());
            let shape = matrix.job().shape;
            let committed = shape.blocks().filter(|&id| matrix.is_committed(id)).count();
            println!("committed    {committed} of {} blocks", shape.block_count());
            println!("size         {} on disk", human_bytes(matrix.stored_bytes()?));
        }
    }
    Ok(())
}

fn print_job(path: &Path, job: &Job) {
    let shape = job.shape;
    println!("{}", path.display());
    println!("source       {} ({})", job.provenance.source, job.provenance.program);
    println!("settings     {}", job.provenance.settings);
    println!("job          {}", job.hash());
    println!("image        {} × {} pixels", shape.width(), shape.height());
    println!(
        "matrix       {} rows × {} columns, {} in f32",
        shape.rows(),
        shape.columns(),
        human_bytes(shape.raw_bytes())
    );
    println!("blocks       {} of {side} × {side} pixels", shape.block_count(), side = shape.block_side());
    println!("lights       {}", job.basis.lights().len());
    for light in job.basis.lights().iter().take(40) {
        let (across, down) = light.layout();
        println!(
            "  {:<24} {across} × {down}  {:?}, emission {:?} {:?}",
            light.name, light.kind, light.emission, light.unit
        );
    }
}

/// `path`'s file name with another extension, in the current folder.
fn beside(path: &Path, extension: &str) -> PathBuf {
    PathBuf::from(path.file_stem().unwrap_or(path.as_os_str())).with_extension(extension)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_stand_for_anything() {
        assert!(matches("lamp", "lamp") && matches("*", "") && matches("l*p", "lamp") && matches("l*", "lamp"));
        assert!(matches("*lamp*", "a lamp here") && !matches("lamp", "lamps") && !matches("l*x", "lamp"));
    }
}
