//! `ltm plan`, and the file that it writes: what every machine of a farm reads before it builds a range.

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::{Args, Parser};
use ltm::farm::{FarmJob, Probe, Round};
use ltm::files::{read_input_text, write_file};
use ltm::matrix::MatrixShape;
use ltm::pipeline::{self, PackOptions};
use ltm::resources::{human_bytes, parse_bytes};
use ltm::sample_budget::parse_seconds;
use ltm::scene::LoadOptions;
use ltm::{Error, Result};
use serde_json::{Value, json};

use crate::input::{Overrides, SceneFiles};
use ltm_cli::compression::Compression;
use ltm_cli::console::Console;
use ltm_cli::say;
use ltm_cli::words::in_flags;

/// What the file says that it is.
const FORMAT: &str = "ltm plan 1";
/// Most bytes of a plan that are read.
const MAX_BYTES: u64 = 64 << 20;

#[derive(Args)]
pub(crate) struct Plan {
    /// The scene file, or a glTF file (.glb, .gltf) with its own camera and lights.
    scene: PathBuf,
    /// The plan to write [default: the scene file's name with .plan.json, in this folder].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Work of a range on one core, for example 5min.
    #[arg(long, value_parser = parse_seconds, default_value = "5min")]
    each: f64,
    /// Bytes that a range leaves for the next round at most, for example 256MiB.
    #[arg(long, value_parser = parse_bytes, default_value = "1GiB")]
    each_bytes: u64,
    /// Blocks of a range, in place of --each and --each-bytes.
    #[arg(long, conflicts_with_all = ["each", "each_bytes"])]
    blocks: Option<u32>,
    #[command(flatten)]
    overrides: Overrides,
    #[command(flatten)]
    files: SceneFiles,
    /// Replace a plan that is there.
    #[arg(long)]
    force: bool,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    compression: Compression,
}

/// A plan that was read.
pub(crate) struct Planned {
    path: PathBuf,
    value: Value,
    pub(crate) ranges: Vec<Range<u32>>,
    pub(crate) fingerprint: String,
}

pub(crate) fn run(options: &Plan, console: &Console) -> Result<()> {
    let scene = std::fs::canonicalize(&options.scene).map_err(Error::io(&options.scene, "find"))?;
    let stem = PathBuf::from(options.scene.file_stem().unwrap_or(options.scene.as_os_str()));
    let output = options.output.clone().unwrap_or_else(|| stem.with_extension("plan.json"));
    ltm::files::check_output(&output, options.force)?;
    let value = json!({
        "format": FORMAT,
        "program": format!("ltm {}", env!("CARGO_PKG_VERSION")),
        "scene": scene.to_string_lossy(),
        "samples": options.overrides.samples,
        "seed": options.overrides.seed,
        "size": options.overrides.size.map(|(width, height)| [width, height]),
        "camera": options.files.one_camera()?,
        "grid": options.files.grid,
        "allow_missing": options.files.allow_missing,
        "allow_outside": options.files.allow_outside,
        "compression": options.compression.arguments(),
    });
    let mut plan = Planned { path: output.clone(), value, ranges: Vec::new(), fingerprint: String::new() };
    let begun = std::time::Instant::now();
    let job = plan.load(None, options.memory, false, console)?;
    let loading_seconds = begun.elapsed().as_secs_f64();
    let (shape, denoises) = (job.job().shape, job.denoises());
    plan.fingerprint = job.fingerprint();
    plan.value["fingerprint"] = json!(plan.fingerprint);
    plan.value["job"] = json!(job.job().hash().0.iter().map(|byte| format!("{byte:02x}")).collect::<String>());
    plan.value["shape"] = json!({
        "width": shape.width(), "height": shape.height(), "columns": shape.columns(),
        "block_side": shape.block_side(), "blocks": shape.block_count(), "raw_bytes": shape.raw_bytes(),
        "windows": ltm::farm::windows(shape).len(),
    });
    plan.value["cleaned"] = json!(denoises);
    let probe = job.probe(console)?;
    let costs = Costs { probe: &probe, blocks: shape.block_count() };
    let target = options.each.max(1e-3);
    let ranges = match options.blocks {
        Some(side) => (0..shape.block_count())
            .step_by(side.max(1) as usize)
            .map(|first| first..first.saturating_add(side.max(1)).min(shape.block_count()))
            .collect(),
        None => costs.ranges(target, options.each_bytes as f64),
    };
    let setup_seconds = loading_seconds + probe.setup_seconds;
    let whole = costs.of(0..shape.block_count());
    plan.value["estimate"] = json!({
        "core_seconds": rounded(whole.0), "bytes": whole.1, "setup_seconds": rounded(setup_seconds),
        "memory_bytes": probe.memory_bytes, "thread_memory_bytes": probe.thread_memory_bytes,
        "merge_memory_bytes": probe.merge_memory_bytes,
    });
    plan.value["ranges"] = ranges.iter().map(|range: &Range<u32>| {
        let (seconds, bytes) = costs.of(range.clone());
        json!({ "blocks": format!("{}..{}", range.start, range.end), "core_seconds": rounded(seconds), "bytes": bytes })
    }).collect();
    let text = serde_json::to_string_pretty(&plan.value).unwrap_or_default() + "\n";
    write_file(&output, options.force, text.as_bytes())?;
    say!(
        "{}: {} blocks in {} ranges, {:.0} s of one core and {:.0} s before each range, {} of memory and {} more for each thread, \
         {} of shards",
        output.display(),
        shape.block_count(),
        ranges.len(),
        whole.0,
        setup_seconds,
        human_bytes(probe.memory_bytes),
        human_bytes(probe.thread_memory_bytes),
        human_bytes(whole.1),
    );
    say!(
        "next: ltm build --plan {} --range 0 --out shards, for each range; then ltm merge --plan {} shards -o {}, which does the rest \
         here, or with --rounds lists what ltm build --round can do of it elsewhere",
        output.display(),
        output.display(),
        stem.with_extension("ltc").display()
    );
    Ok(())
}

/// To the precision that an estimate has.
fn rounded(seconds: f64) -> f64 {
    (seconds * 1000.0).round() / 1000.0
}

/// What blocks cost, by those that were probed: a line from each to the next.
struct Costs<'a> {
    probe: &'a Probe,
    blocks: u32,
}

impl Costs<'_> {
    /// Seconds of one core, and bytes, for a block.
    fn of_block(&self, block: u32) -> (f64, f64) {
        let probed = &self.probe.blocks;
        let after = probed.partition_point(|p| p.block.0 < block);
        let (before, after) = (&probed[after.saturating_sub(1)], &probed[after.min(probed.len() - 1)]);
        let apart = f64::from(after.block.0 - before.block.0);
        let share = if apart > 0.0 { f64::from(block - before.block.0) / apart } else { 0.0 };
        let between = |a: f64, b: f64| a + share * (b - a);
        (between(before.seconds, after.seconds), between(before.bytes as f64, after.bytes as f64))
    }

    fn of(&self, blocks: Range<u32>) -> (f64, u64) {
        let (seconds, bytes) = blocks.map(|b| self.of_block(b)).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (seconds, bytes as u64)
    }

    /// Ranges of about as many seconds each, none above `most` seconds or `most_bytes` but for single blocks.
    fn ranges(&self, most: f64, most_bytes: f64) -> Vec<Range<u32>> {
        let whole = self.of(0..self.blocks).0;
        let each = whole / (whole / most).ceil().max(1.0);
        let (mut ranges, mut first, mut sum) = (Vec::new(), 0, (0.0, 0.0));
        for block in 0..self.blocks {
            let (seconds, bytes) = self.of_block(block);
            if block > first && (sum.0 + seconds > each * 1.001 || sum.1 + bytes > most_bytes) {
                ranges.push(first..block);
                (first, sum) = (block, (0.0, 0.0));
            }
            sum = (sum.0 + seconds, sum.1 + bytes);
        }
        ranges.push(first..self.blocks);
        ranges
    }
}

/// The compression of a plan, read as a command line.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    compression: Compression,
}

impl Planned {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = read_input_text(path, "read the plan", MAX_BYTES)?;
        let refuse = |problem: String| Error::input(path.display().to_string(), problem, "make it again with ltm plan");
        let value: Value = serde_json::from_str(&text).map_err(|e| refuse(format!("is no plan ({e})")))?;
        if value["format"] != FORMAT {
            return Err(refuse(format!("is no plan of this version, which is '{FORMAT}'")));
        }
        let fingerprint = value["fingerprint"].as_str().unwrap_or_default().to_owned();
        let range = |value: &Value| value["blocks"].as_str().and_then(|text| crate::render::parse_range(text).ok());
        let ranges: Option<Vec<_>> = value["ranges"].as_array().and_then(|ranges| ranges.iter().map(range).collect());
        let ranges = ranges.ok_or_else(|| refuse("has no ranges, or such that are none".to_owned()))?;
        Ok(Self { path: path.to_owned(), value, ranges, fingerprint })
    }

    /// The job of the plan, from the scene file that it names, or from another place. Refused where it is not the plan's any more.
    pub(crate) fn load(
        &self,
        scene: Option<&Path>,
        memory_bytes: Option<u64>,
        overwrite: bool,
        console: &Console,
    ) -> Result<FarmJob> {
        use ltm::resources::Progress;
        let place = || self.path.display().to_string();
        let refuse = |what: &str| Error::input(place(), format!("has no usable {what}"), "make it again with ltm plan");
        let named = PathBuf::from(self.value["scene"].as_str().ok_or_else(|| refuse("scene"))?);
        // A plan that was taken elsewhere with its scene.
        let beside = self.path.with_file_name(named.file_name().unwrap_or_default());
        let scene =
            scene.map_or_else(|| if !named.exists() && beside.exists() { beside } else { named }, Path::to_owned);
        let number = |value: &Value| value.as_u64().and_then(|number| u32::try_from(number).ok());
        let size = match &self.value["size"] {
            Value::Null => None,
            size => Some(number(&size[0]).zip(number(&size[1])).ok_or_else(|| refuse("size"))?),
        };
        let load = LoadOptions {
            allow_missing: self.value["allow_missing"] == true,
            allow_outside: self.value["allow_outside"] == true,
            memory_bytes,
            camera: self.value["camera"].as_str().map(str::to_owned),
            grid: self.value["grid"].as_str().map(str::to_owned),
        };
        let overrides = Overrides { samples: number(&self.value["samples"]), seed: self.value["seed"].as_u64(), size };
        let loaded = overrides.of(pipeline::load_scene(&scene, load)?);
        loaded.warnings.worded(in_flags).iter().for_each(|warning| console.note(&format!("warning: {warning}")));
        let words = self.value["compression"].as_array().ok_or_else(|| refuse("compression"))?;
        let words = words.iter().filter_map(Value::as_str);
        let line =
            Line::try_parse_from(std::iter::once("compression").chain(words)).map_err(|_| refuse("compression"))?;
        let (compress, denoise) = (line.compression.settings(), line.compression.denoise());
        let mut options = PackOptions { compress, denoise, memory_bytes, ..Default::default() };
        options.container.overwrite = overwrite;
        options.allow_lost_lights = overwrite;
        let job = FarmJob::new(loaded, &options)?;
        if !self.fingerprint.is_empty() && job.fingerprint() != self.fingerprint {
            let problem = format!("is not of what {} is now, or of another version of the program", scene.display());
            return Err(Error::input(
                place(),
                problem,
                "make it again with ltm plan, or take the scene that it was made of",
            ));
        }
        Ok(job)
    }

    /// The units of a round.
    pub(crate) fn units(&self, round: Round) -> Result<Vec<Range<u32>>> {
        let number = |name: &str| self.value["shape"][name].as_u64().and_then(|number| u32::try_from(number).ok());
        let sides = number("width").zip(number("height")).zip(number("columns").zip(number("block_side")));
        let ((width, height), (columns, side)) = sides.ok_or_else(|| {
            Error::input(self.path.display().to_string(), "has no usable shape", "make it again with ltm plan")
        })?;
        Ok(round.units(MatrixShape::new(width, height, columns, side)?, &self.ranges))
    }

    /// Numbers of the ranges that have a block in one of these.
    pub(crate) fn having(&self, blocks: &[Range<u32>]) -> Vec<usize> {
        let touches =
            |range: &Range<u32>| blocks.iter().any(|other| other.start < range.end && range.start < other.end);
        (0..self.ranges.len()).filter(|&number| touches(&self.ranges[number])).collect()
    }
}
