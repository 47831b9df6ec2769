//! `ltm-pack`: a stored matrix or images of single lights in, a container out.

mod tables;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser};
use ltm::container::ContainerReader;
use ltm::files::check_output;
use ltm::image::{FeaturePasses, LayerPattern, LightSet};
use ltm::light::{Job, LightKind};
use ltm::matrix::{BlockSource, MatrixShape};
use ltm::pipeline::{self, CleanOptions, ImageNoise, ImportedMatrix, PackOptions, SecondImages};
use ltm::resources::{Progress, human_bytes, parse_bytes};
use ltm::store::StoreReader;
use ltm::{Error, Result};
use ltm_cli::compression::{Compression, say_errors};
use ltm_cli::console::{self, Console, EXIT_CODES, peak_memory_bytes};
use ltm_cli::words::in_flags;
use ltm_cli::{documentation, names, say, sequence};

/// Compress a stored light transport matrix (.ltm), or images of single lights that other programs rendered, into a
/// container (.ltc).
#[derive(Clone, Parser)]
#[command(name = "ltm-pack", version, after_help = format!("Examples:
  ltm-pack room.ltm                      writes room.ltc
  ltm-pack room.ltm -o small.ltc --target 1MiB --force
  ltm-pack room.ltm -o paper.ltc --method proposed --rank 32
  ltm-pack room.ltm -o global.ltc --method algorithm4 --scope global --rank 64
  ltm-pack room.ltm --verify             compares every entry with the matrix afterwards
  ltm-pack room.ltm --basis clean.exr    with images that another denoiser has made
  ltm-pack blender.exr -o room.ltc       light groups of Blender, Arnold, V-Ray, Karma and others
  ltm-pack seed1.exr --second seed2.exr -o room.ltc   rendered twice: denoised of noise
  ltm-pack blender.exr --clean-to clean.exr   no container, but the same file with clean light groups
  ltm-pack any.exr -o room.ltc --layers '^beauty_(.+)$'
  ltm-pack 'renders/room_{{light}}.exr' -o room.ltc
  ltm-pack 'render-*.exr' -o room.ltc    light groups of one rendering in several files
  ltm-pack shot.####.exr                 a sequence: shot.0001.ltc and so on, one container for each frame
  ltm-pack lights.npz -o room.ltc        images [lights, height, width, 3], lights: their names
  ltm-pack panel.npy -o room.ltc --texels 32x32       the lights are the texels of one panel

{EXIT_CODES}"))]
struct Arguments {
    /// A stored matrix (.ltm), an OpenEXR file with light groups (several with `*`), a folder or pattern with {light} (.exr, .hdr,
    /// .pfm), or an array (.npy, .npz). `#` stands for the digits of a frame's number: each frame becomes a container of its own, and
    /// other names with `#` are those of the frame too.
    input: PathBuf,
    /// Only these frames of a sequence, FIRST..END.
    #[arg(long, value_parser = sequence::parse_range)]
    frames: Option<Range<usize>>,
    /// The container to write [default: the input's name with .ltc].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace a container that is there.
    #[arg(long)]
    force: bool,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Compare every entry with the input afterwards; prints the error of each block and the worst place.
    #[arg(long)]
    verify: bool,
    /// Take the images of `ltm-unpack --basis` back, denoised by a denoiser of your choice, in place of denoising them here.
    #[arg(long, value_name = "EXR")]
    basis: Option<PathBuf>,
    #[command(flatten)]
    images: Images,
    #[command(flatten)]
    compression: Compression,
    /// Threads to use [default: one for each core].
    #[arg(long)]
    threads: Option<usize>,
    /// Write progress as lines to standard error, `progress: STAGE DONE/TOTAL`, for a program that shows it.
    #[arg(long)]
    progress: bool,
}

#[derive(Args, Clone)]
#[command(next_help_heading = "Images of single lights")]
struct Images {
    /// Which layers of an OpenEXR file are lights, as a regular expression; its group (`light`, else the first) is the
    /// light's name [default: the conventions of Blender, Arnold, V-Ray, Corona, LuxCore, Karma, RenderMan, Redshift,
    /// Octane].
    #[arg(long, value_name = "REGEX")]
    layers: Option<LayerPattern>,
    /// A JSON object of names: `{"light's name by its layer": "its name in the container"}`.
    #[arg(long, value_name = "JSON")]
    names: Option<PathBuf>,
    /// The same lights rendered once more with another seed, given as the first are: from the two the noise is known, and the
    /// images, whose mean is taken, are denoised of it.
    #[arg(long, value_name = "IMAGES")]
    second: Option<PathBuf>,
    /// Clean images that were rendered once: their noise is estimated from what each pixel differs by from those beside it. A texture that
    /// no albedo tells of is taken for noise; --second knows better.
    #[arg(long, conflicts_with = "second")]
    estimate_noise: bool,
    /// In place of a container, write the OpenEXR file once more with its light groups cleaned of noise and their sum as the picture under
    /// all lights; all other layers stay. The noise is that of --second, else estimated.
    #[arg(long, value_name = "EXR", conflicts_with_all = ["output", "verify", "basis", "texels", "sky", "names"])]
    clean_to: Option<PathBuf>,
    /// An OpenEXR file with albedo, normal and depth of what is seen, which denoising heeds [default: the layers of the images'
    /// own files].
    #[arg(long, value_name = "EXR")]
    features: Option<PathBuf>,
    /// The images are those of the texels of one area light, so many across and down, row by row: ACROSSxDOWN [default: each is a light
    /// of its own; of 48 and more, which are alike is looked for].
    #[arg(long, value_name = "TEXELS", value_parser = parse_texels, conflicts_with = "sky")]
    texels: Option<(u32, u32)>,
    /// The images are those of the texels of a sky, by longitude and latitude: the first row is the zenith, its first texel begins
    /// at -z and turns towards +x; +y is up.
    #[arg(long, value_name = "TEXELS", value_parser = parse_texels)]
    sky: Option<(u32, u32)>,
    /// Side of a block in pixels [default: 32].
    #[arg(long)]
    block_side: Option<u32>,
}

impl Images {
    /// The lights of a rendering, by the names that are asked for.
    fn open(&self, path: &Path) -> Result<LightSet> {
        let mut set = LightSet::open(path, self.layers.as_ref())?;
        if let Some(file) = &self.names {
            let text = std::fs::read(file).map_err(Error::io(file, "read"))?;
            let names: BTreeMap<String, String> = serde_json::from_slice(&text).map_err(|error| {
                Error::input(
                    file.display().to_string(),
                    error.to_string(),
                    "write an object of texts: {\"old\": \"new\"}",
                )
            })?;
            set.rename(&names, path)?;
        }
        Ok(set)
    }

    fn light(&self) -> Option<LightKind> {
        let area = self.texels.map(|(across, down)| LightKind::AreaTexels { across, down });
        area.or(self.sky.map(|(across, down)| LightKind::LatLong { across, down }))
    }
}

fn parse_texels(text: &str) -> std::result::Result<(u32, u32), String> {
    let count = |text: &str| text.trim().parse().ok().filter(|count| (1..=65_536).contains(count));
    let both = text.split_once(['x', '×']).and_then(|(across, down)| Some((count(across)?, count(down)?)));
    both.ok_or_else(|| format!("'{text}' is not a number of texels across and down, such as 32x16"))
}

pub(crate) fn main() -> ExitCode {
    let arguments: Arguments = documentation::parse("ltm-pack");
    let console = Console::new().telling(arguments.progress);
    console::finish("ltm-pack", run(&arguments, &console))
}

fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    console::use_threads(arguments.threads)?;
    let Some(found) = sequence::frames(&arguments.input, arguments.frames.as_ref())? else {
        if arguments.frames.is_some() {
            let hint = "put #### where the frames' names have their number";
            return Err(Error::input("--frames", "is of a sequence", hint));
        }
        return pack_one(arguments, true, console);
    };
    let frames: Vec<_> = found.iter().map(|(frame, _)| arguments.of_frame(*frame)).collect::<Result<_>>()?;
    for frame in &frames {
        // Before the first is packed, and once more when its turn has come.
        frame.check_output()?;
    }
    for ((number, input), frame) in found.iter().zip(&frames) {
        if console.interrupted() {
            let end = found[found.len() - 1].0 + 1;
            let kept = format!("the frames before {number}, and --frames {number}..{end} goes on");
            return Err(Error::interrupted(kept));
        }
        say!("{}: frame {number}, {} in all", input.display(), frames.len());
        pack_one(frame, *number == found[0].0, console)?;
    }
    Ok(())
}

impl Arguments {
    /// The arguments of one frame of a sequence.
    fn of_frame(&self, frame: usize) -> Result<Self> {
        let numbered = |path: &Path| sequence::frame_path(path, frame).unwrap_or_else(|| path.to_owned());
        let written = |path: &Path| {
            let hint = "put #### into it";
            sequence::frame_path(path, frame)
                .ok_or_else(|| Error::input(path.display().to_string(), "would be the name of every frame", hint))
        };
        let mut own = self.clone();
        own.output = Some(written(&self.container())?);
        own.input = numbered(&self.input);
        own.basis = self.basis.as_deref().map(numbered);
        own.images.second = self.images.second.as_deref().map(numbered);
        own.images.features = self.images.features.as_deref().map(numbered);
        own.images.clean_to = self.images.clean_to.as_deref().map(written).transpose()?;
        Ok(own)
    }

    /// The container's name.
    fn container(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| default_output(&self.input))
    }

    /// Refuses to write over what is there.
    fn check_output(&self) -> Result<()> {
        match &self.images.clean_to {
            Some(clean) => check_output(clean, self.force),
            None => pipeline::check_container_output(&self.container(), self.force),
        }
    }
}

/// Packs one matrix, or the images of one picture. What layers were taken for is said where `is_first`.
fn pack_one(arguments: &Arguments, is_first: bool, console: &Console) -> Result<()> {
    let (input, images) = (&*arguments.input, &arguments.images);
    let output = arguments.container();
    names::check_container(&output)?;
    if input.extension().is_some_and(|e| e == "ltm" || e == "part") {
        let for_images = [
            (images.layers.is_some(), "--layers"),
            (images.names.is_some(), "--names"),
            (images.second.is_some(), "--second"),
            (images.estimate_noise, "--estimate-noise"),
            (images.clean_to.is_some(), "--clean-to"),
            (images.features.is_some(), "--features"),
            (images.texels.is_some(), "--texels"),
            (images.sky.is_some(), "--sky"),
            (images.block_side.is_some(), "--block-side"),
        ];
        if let Some((_, name)) = for_images.iter().find(|(given, _)| *given) {
            return Err(Error::input(*name, "is for images of single lights; a matrix has its own", "leave it out"));
        }
        let matrix = StoreReader::open(input)?;
        if arguments.compression.denoise() && has_other_groups(&matrix)? {
            console.note(
                "warning: not denoised: an earlier program rendered this matrix, and grouped its columns in another way; render it again",
            );
        }
        return pack(&matrix, matrix.job(), &output, arguments, console);
    }
    let set = images.open(input)?;
    arguments.check_output()?;
    if images.clean_to.is_some() {
        set.check_rewrite(input)?;
    }
    let name = input.file_name().unwrap_or(input.as_os_str()).to_string_lossy().into_owned();
    let side = images.block_side.unwrap_or(MatrixShape::DEFAULT_BLOCK_SIDE);
    let second_set = images.second.as_deref().map(|path| images.open(path)).transpose()?;
    let denoises = images.second.is_some() || images.estimate_noise || images.clean_to.is_some();
    if images.features.is_some() && !denoises {
        let hint = "give --second or --estimate-noise too";
        return Err(Error::input("--features", "is for denoising, which wants to know the noise", hint));
    }
    let passes = match (&images.features, denoises) {
        (_, false) => [None, None],
        (Some(path), true) => [Some(FeaturePasses::open(path)?), None],
        (None, true) => {
            let second = images.second.as_deref().map_or(Ok(None), FeaturePasses::find);
            [FeaturePasses::find(input)?, second?]
        }
    };
    let features = passes.each_ref().map(Option::as_ref);
    let noise = match &second_set {
        Some(set) => ImageNoise::Measured(SecondImages { set, features }),
        None if denoises => ImageNoise::Estimated(features[0]),
        None => ImageNoise::Unknown,
    };
    let beside = images.clean_to.as_ref().unwrap_or(&output);
    let mut matrix = ImportedMatrix::read(&set, noise, &name, beside, side, &pack_options(arguments), console)?;
    if let Some(clean) = &images.clean_to {
        tables::print_matches(&matrix, is_first);
        let options = CleanOptions { overwrite: arguments.force, memory_bytes: arguments.memory };
        pipeline::clean_images(&matrix, &set, clean, options, console)?;
        let sum = if set.has_sum { ", which add up to the picture under all lights" } else { "" };
        say!("{}: {} clean light groups{sum}", clean.display(), set.lights.len());
        return Ok(());
    }
    images.light().map_or(Ok(()), |texels| matrix.take_for_texels(texels))?;
    tables::print_matches(&matrix, is_first);
    if is_first && matrix.wants_noise() && arguments.compression.denoise() {
        say!(
            "not denoised: the noise of images rendered once is not known; --estimate-noise guesses it, --second measures it"
        );
    }
    pack(&matrix, matrix.job(), &output, arguments, console)
}

/// Whether a matrix holds sums over its samples that are not used: those of other groups of columns than today's.
fn has_other_groups(matrix: &StoreReader) -> Result<bool> {
    let Some(first) = matrix.shape().blocks().find(|&id| matrix.is_committed(id)) else { return Ok(false) };
    Ok(matrix.layout().has_planes() && matrix.read_planes(first, None)?.is_none())
}

/// The container beside the input: its name with the other extension; of a pattern, what stands before `{light}` or `*`.
fn default_output(input: &Path) -> PathBuf {
    let text = input.display().to_string();
    let star = text.split_once('*').filter(|_| !input.exists());
    match text.split_once("{light}").or(star) {
        Some((before, _)) => {
            let stem = before.trim_end_matches(|c: char| !c.is_alphanumeric());
            PathBuf::from(if stem.is_empty() { "lights" } else { stem }).with_extension("ltc")
        }
        None => input.with_extension("ltc"),
    }
}

fn pack_options(arguments: &Arguments) -> PackOptions {
    let compress = arguments.compression.settings();
    let denoise = arguments.compression.denoise();
    let basis = arguments.basis.clone();
    let mut options = PackOptions { compress, denoise, basis, memory_bytes: arguments.memory, ..Default::default() };
    options.container.overwrite = arguments.force;
    options.allow_lost_lights = arguments.force;
    options
}

fn pack(matrix: &dyn BlockSource, job: &Job, output: &Path, arguments: &Arguments, console: &Console) -> Result<()> {
    let report = pipeline::pack(matrix, job, output, &pack_options(arguments), console)?;
    format!("{}: {}", output.display(), report.worded(in_flags)).lines().for_each(|line| say!("{line}"));
    say_errors(&report, &job.basis);
    say!(
        "{:.1} s, {}/s of raw input, peak memory {}",
        report.seconds,
        human_bytes((report.raw_bytes as f64 / report.seconds) as u64),
        peak_memory_bytes().map_or("unknown".into(), human_bytes),
    );
    if arguments.verify {
        let packed = ContainerReader::open(output)?;
        tables::print_comparison(&pipeline::compare_matrices(matrix, &packed, console)?, job);
    }
    say!("next: ltm relight {} -o relit.png", output.display());
    Ok(())
}
