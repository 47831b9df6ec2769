//! `ltm render`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use ltm::container::ContainerReader;
use ltm::error_estimate::{ErrorMonitor, expected_error};
use ltm::light::{ExposedError, expected_error_line, exposed_error_line};
use ltm::pipeline::{self, PackOptions, PackReport, RenderOptions, RenderReport, SceneView};
use ltm::resources::{MemoryNeed, Progress, human_bytes, parse_bytes};
use ltm::sample_budget::{RenderTo, StopRule, choose_samples, parse_error, parse_seconds};
use ltm::scene::LoadedScene;
use ltm::store::{Precision, StoreReader};
use ltm::{Error, Result};

use crate::input::{Overrides, SceneFiles};
use ltm_cli::compression::{Compression, say_errors};
use ltm_cli::console::{Console, peak_memory_bytes};
use ltm_cli::words::in_flags;
use ltm_cli::{names, say};

#[derive(Args)]
pub(crate) struct Render {
    /// The scene file, or a glTF file (.glb, .gltf) with its own camera and lights, or an OBJ file.
    scene: PathBuf,
    /// The file to write [default: the scene file's name with .ltm, or .ltc with --pack, in this folder].
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
    /// As many samples as bring the expected error of an exposed, relit image down to this, for example 2% (of white; the
    /// worst of 16 lightings): of the packed, denoised matrix, or of the matrix as it is with --denoise off. What was reached is
    /// said, and kept in a container.
    #[arg(long, value_parser = parse_error, conflicts_with_all = ["samples", "blocks"])]
    error: Option<f64>,
    /// As many samples as fit this time, for example 60s or 5min; with --error, at most so many.
    #[arg(long, value_parser = parse_seconds, conflicts_with_all = ["samples", "blocks"])]
    time: Option<f64>,
    /// Precision of the stored entries.
    #[arg(long, value_enum, default_value = "f32")]
    precision: PrecisionName,
    /// Only these blocks, FIRST..END.
    #[arg(long, value_parser = parse_range)]
    blocks: Option<std::ops::Range<u32>>,
    /// First write a small, noisy image of the scene's own lighting beside the matrix (NAME-preview.png), within
    /// seconds, then render on; with --preview=only, write nothing else.
    #[arg(long, value_enum, value_name = "WHEN", num_args = 0..=1, require_equals = true, default_missing_value = "first")]
    preview: Option<Preview>,
    /// Replace a matrix that is there.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    files: SceneFiles,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Compress each block as it is traced, into a container: the same bytes as ltm-pack makes of the f32 matrix, but
    /// the matrix is never stored.
    #[arg(long, conflicts_with_all = ["precision", "blocks"])]
    pack: bool,
    #[command(flatten)]
    compression: Compression,
}

#[derive(Clone, Copy, ValueEnum)]
enum PrecisionName {
    F32,
    F16,
    Bf16,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Preview {
    /// Before the render.
    First,
    /// Instead of the render.
    Only,
}

pub(crate) fn run(options: &Render, console: &Console) -> Result<()> {
    let allowed = options.files.load_options(options.memory);
    let mut loaded = options.overrides.of(pipeline::load_scene(&options.scene, allowed)?);
    for warning in loaded.warnings.worded(in_flags) {
        console.note(&format!("warning: {warning}"));
    }
    let extension = if options.pack { "ltc" } else { "ltm" };
    let output = options.output.clone().unwrap_or_else(|| beside(&options.scene, extension));
    check_name(&output, options.pack)?;
    if options.files.cameras.len() > 1 {
        return render_views(options, loaded, &output, console);
    }
    if let Some(when) = options.preview {
        let name = format!("{}-preview.png", output.file_stem().unwrap_or_default().to_string_lossy());
        let report = pipeline::preview(&loaded, &output.with_file_name(name), console)?;
        say!(
            "{}: {}×{} pixels, {} samples per pixel, {:.1} s (the first after {:.1} s)",
            report.path.display(),
            report.width,
            report.height,
            report.samples_per_pixel,
            report.seconds,
            report.first_secs,
        );
        if when == Preview::Only {
            return Ok(());
        }
    }
    let rule = StopRule { error: options.error, seconds: options.time, packs: options.pack };
    let (compress, denoise) = (options.compression.settings(), options.compression.denoise());
    let mut pack = PackOptions { compress, denoise, memory_bytes: options.memory, ..Default::default() };
    let has_rule = rule.error.is_some() || rule.seconds.is_some();
    if has_rule {
        let to = if options.force { RenderTo::Anew(&output) } else { RenderTo::GoOn(&output) };
        let chosen = choose_samples(loaded, to, rule, &pack, console)?;
        (loaded, pack.promise) = (chosen.loaded, chosen.promise.map(Arc::new));
    }
    let (samples, promise) = (loaded.settings.samples_per_pixel, pack.promise.clone());
    if options.pack {
        pack.container.overwrite = options.force;
        pack.allow_lost_lights = options.force;
        let (render, packed) = pipeline::render_packed(loaded, &output, &pack, console)?;
        print_report(&output, &render);
        print_packed(&output, &packed)?;
        packed.exposed.iter().for_each(|error| say_reached(error, samples));
        return Ok(());
    }
    let store = ltm::store::StoreOptions {
        overwrite: options.force,
        precision: match options.precision {
            PrecisionName::F32 => Precision::F32,
            PrecisionName::F16 => Precision::F16,
            PrecisionName::Bf16 => Precision::Bf16,
        },
        ..Default::default()
    };
    let held = promise.as_ref().map_or(0, |promise| promise.fixed_bytes());
    let memory_bytes = options.memory.map(|bytes| bytes.saturating_sub(held));
    let render = RenderOptions { store, blocks: options.blocks.clone(), memory_bytes };
    let report = pipeline::render(loaded, &output, &render, console)?;
    print_report(&output, &report);
    if let Some(promise) = &promise {
        let of = if promise.denoises() { "as ltm-pack will denoise it" } else { "of the matrix as it is" };
        let error = promise.reached_by(&StoreReader::open(&output)?, options.memory, console)?;
        say!("{of}:");
        say_reached(&error, samples);
    } else if has_rule && let Some(error) = expected_error(&StoreReader::open(&output)?, options.memory, console)? {
        say!("{}", expected_error_line(error));
    }
    match report.blocks_missing {
        0 => say!("next: ltm-pack {}", output.display()),
        missing => say!("{missing} blocks are still missing: render them too, then ltm merge"),
    }
    Ok(())
}

/// Renders several views, a container each, named after their cameras.
fn render_views(options: &Render, loaded: LoadedScene, output: &Path, console: &Console) -> Result<()> {
    let refuse = |hint: &str| Err(Error::input("--camera", "is given several times", hint));
    if !options.pack || options.error.is_some() || options.time.is_some() || options.preview.is_some() {
        return refuse("say --pack, with --samples and without --error, --time and --preview; or give one");
    }
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let view = |name: &String| -> Result<SceneView> {
        let camera = *loaded.camera_named(&options.scene.display().to_string(), name)?;
        let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
        let name: String = name.chars().map(plain).collect();
        Ok(SceneView { camera, path: output.with_file_name(format!("{stem}-{name}.ltc")) })
    };
    let views = options.files.cameras.iter().map(view).collect::<Result<Vec<_>>>()?;
    if let Some(at) = (1..views.len()).find(|&at| views[..at].iter().any(|view| view.path == views[at].path)) {
        let problem = format!("two views would both be {}", views[at].path.display());
        return Err(Error::input("--camera", problem, "give each camera once"));
    }
    let (compress, denoise) = (options.compression.settings(), options.compression.denoise());
    let mut pack = PackOptions { compress, denoise, memory_bytes: options.memory, ..Default::default() };
    (pack.container.overwrite, pack.allow_lost_lights) = (options.force, options.force);
    pipeline::render_views(loaded, &views, &pack, console, |view, render, packed| {
        print_report(&view.path, &render);
        print_packed(&view.path, &packed)
    })
}

/// What a render has reached of the error that was asked for, and what to do where it missed that by far.
fn say_reached(error: &ExposedError, samples: u32) {
    say!("{}", exposed_error_line(error));
    if let Some(instead) = ErrorMonitor::samples_instead(error, samples) {
        say!("that misses it by far: render again with --samples {instead} --force, or ask for less");
    }
}

/// What a container is worth that was made of a scene.
pub(crate) fn print_packed(output: &Path, packed: &PackReport) -> Result<()> {
    packed.worded(in_flags).lines().for_each(|line| say!("{line}"));
    say_errors(packed, &ContainerReader::open(output)?.job().basis);
    say!("next: ltm relight {} -o relit.png", output.display());
    Ok(())
}

fn print_report(output: &Path, report: &RenderReport) {
    say!(
        "{}: {} blocks in {:.1} s, {:.2} M rays/s, peak memory {}",
        output.display(),
        report.blocks_traced,
        report.seconds,
        report.rays as f64 / report.seconds / 1e6,
        peak_memory_bytes().map_or("unknown".into(), human_bytes),
    );
    if report.non_finite > 0 {
        say!("{} contributions were not finite and were dropped", report.non_finite);
    }
}

pub(crate) fn parse_range(text: &str) -> Result<std::ops::Range<u32>, String> {
    let (first, end) = text.split_once("..").ok_or("write FIRST..END, for example 0..100")?;
    let index = |s: &str| s.parse().map_err(|e| format!("'{s}' is not a block index ({e})"));
    Ok(index(first)?..index(end)?)
}

/// Errors: the name is that of the other kind of file.
fn check_name(output: &Path, pack: bool) -> Result<()> {
    let (other, problem, hint) = if pack {
        ("ltm", "with --pack a container is written, not a matrix", "name it x.ltc, or leave --pack out")
    } else {
        ("ltc", "without --pack a matrix is written, not a container", "name it x.ltm, or say --pack")
    };
    names::refuse_extension(output, other, problem, hint)
}

/// `path`'s file name with another extension, in the current folder.
fn beside(path: &Path, extension: &str) -> PathBuf {
    PathBuf::from(path.file_stem().unwrap_or(path.as_os_str())).with_extension(extension)
}
