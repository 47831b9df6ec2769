//! `ltm-unpack`: a container or a stored matrix in, a stored matrix, images or an array out.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use ltm::matrix::PixelRect;
use ltm::pipeline::{self, Selection, UnpackOptions, UnpackSource};
use ltm::resources::{PeakMemory, human_bytes, parse_bytes};
use ltm::store::StoreReader;
use ltm::{Error, Result};
use ltm_cli::console::{self, Console, EXIT_CODES};
use ltm_cli::{documentation, say};

/// Take a container (.ltc) or a stored matrix (.ltm) apart: into one image for each light, an array, one relit image, or a
/// stored matrix, multiplied out or a part.
#[derive(Parser)]
#[command(name = "ltm-unpack", version, after_help = format!("Examples:
  ltm-unpack room.ltc -o room.ltm              the whole matrix
  ltm-unpack room.ltc -o lights.exr            one EXR layer for each light, as the scene lights it
  ltm-unpack room.ltc -o 'lights/{{light}}.exr'  one file for each light
  ltm-unpack room.ltc -o lights.npy            array [lights, height, width, 3] of the same images
  ltm-unpack room.ltc -o room.exr --relit      one image with all lights on
  ltm-unpack room.ltc -o desk.exr --on 'desk*' one image with some lights on
  ltm-unpack room.ltc -o part.npy --crop 64,32,256x128 --lights 'sun,key*'
  ltm-unpack room.ltm -o lights.npy            the same of a stored matrix, as it was rendered
  ltm-unpack room.ltm -o desk.ltm --lights 'desk*' --crop 64,32,256x128
  ltm-unpack room.ltm --basis b.exr            images to denoise elsewhere, for ltm-pack --basis

{EXIT_CODES}"))]
struct Arguments {
    /// The container (.ltc) or the stored matrix (.ltm).
    input: PathBuf,
    /// What to write; the extension decides: .ltm, .exr or .npy. With {light} in the name: a file for each light.
    #[arg(short, long, required_unless_present = "basis")]
    output: Option<PathBuf>,
    /// Write the images that denoising works on, with albedo and normals, as one EXR: to be denoised by a denoiser of your choice
    /// and given to ltm-pack --basis.
    #[arg(long, value_name = "EXR", conflicts_with_all = ["output", "relit", "on", "lights", "crop", "blocks"])]
    basis: Option<PathBuf>,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
    /// Write one image under all (selected) lights instead of one layer for each (.exr).
    #[arg(long)]
    relit: bool,
    /// Write one image with only the lights on whose names match this (.exr); may be given several times.
    #[arg(long, value_name = "PATTERN", conflicts_with = "lights")]
    on: Vec<String>,
    /// Only lights whose names match (`*` stands for anything); separated by commas, or given several times.
    #[arg(long, value_name = "PATTERN", value_delimiter = ',')]
    lights: Vec<String>,
    /// Only these pixels, X,Y,WIDTHxHEIGHT: the result is as large as they are.
    #[arg(long, value_name = "X,Y,WxH", value_parser = parse_crop)]
    crop: Option<PixelRect>,
    /// Only blocks FIRST..END: the rest stays black, or missing in a stored matrix.
    #[arg(long, value_name = "FIRST..END", value_parser = parse_range)]
    blocks: Option<Range<u32>>,
    /// Memory to stay within, for example 1GiB [default: what the system has].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Threads to use [default: one for each core].
    #[arg(long)]
    threads: Option<usize>,
}

fn parse_crop(text: &str) -> Result<PixelRect, String> {
    let wrong = || format!("'{text}' is no X,Y,WIDTHxHEIGHT, for example 64,32,256x128");
    let numbers: Vec<u32> =
        text.split([',', 'x']).map(|part| part.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong())?;
    let &[x, y, width, height] = numbers.as_slice() else { return Err(wrong()) };
    Ok(PixelRect { x, y, width, height })
}

fn parse_range(text: &str) -> Result<Range<u32>, String> {
    let wrong = || format!("'{text}' is no FIRST..END, for example 0..100");
    let (start, end) = text.split_once("..").ok_or_else(wrong)?;
    Ok(start.parse().map_err(|_| wrong())?..end.parse().map_err(|_| wrong())?)
}

pub(crate) fn main() -> ExitCode {
    let arguments: Arguments = documentation::parse("ltm-unpack");
    let console = Console::new();
    console::finish("ltm-unpack", run(&arguments, &console))
}

fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    console::use_threads(arguments.threads)?;
    let Some(output) = arguments.output.as_deref() else { return write_basis(arguments, console) };
    let source = open(&arguments.input)?;
    let relit = arguments.relit || !arguments.on.is_empty();
    let lights = if arguments.on.is_empty() { arguments.lights.clone() } else { arguments.on.clone() };
    let selection = Selection { blocks: arguments.blocks.clone(), crop: arguments.crop, lights };
    let options = UnpackOptions { selection, overwrite: arguments.force, memory_bytes: arguments.memory };
    let memory = PeakMemory::start();
    let refuse = |problem: &str, hint: &str| Err(Error::input(output.display().to_string(), problem, hint));
    match output.extension().and_then(|e| e.to_str()) {
        Some("exr") if relit => {
            pipeline::unpack_relit(&*source, output, &options, console)?;
            say!("{}: written", output.display());
        }
        _ if relit => return refuse("one relit image is an OpenEXR file", "name it x.exr, or use ltm relight"),
        Some("exr") => {
            let written = pipeline::unpack_to_exr(&*source, output, &options, console)?;
            written.iter().for_each(|path| say!("{}: written", path.display()));
        }
        Some("ltm") if is_matrix(&arguments.input) && options.selection == Selection::default() => {
            return refuse(
                "it would be the matrix as it is",
                "copy the file, or choose a part by --lights, --crop or --blocks",
            );
        }
        Some("ltm") => {
            let blocks = pipeline::unpack_to_store(&*source, output, &options, console)?;
            say!("{}: {blocks} blocks written, without what was known of their noise", output.display());
        }
        Some("npy") => {
            pipeline::unpack_to_npy(&*source, output, &options, console)?;
            say!("{}: written", output.display());
        }
        _ => return refuse("the name ends in none of .ltm, .exr, .npy", "choose the output by its extension"),
    }
    say!("peak memory {}", memory.stop().map_or("unknown".into(), human_bytes));
    Ok(())
}

/// Whether a file is a stored matrix, by its name.
fn is_matrix(input: &Path) -> bool {
    input.extension().is_some_and(|extension| extension == "ltm")
}

fn open(input: &Path) -> Result<Box<dyn UnpackSource>> {
    Ok(match is_matrix(input) {
        true => Box::new(StoreReader::open(input)?),
        false => Box::new(pipeline::open_container(input)?),
    })
}

fn write_basis(arguments: &Arguments, console: &Console) -> Result<()> {
    let Some(output) = arguments.basis.as_deref() else { return Ok(()) };
    let memory = PeakMemory::start();
    ltm::files::check_output(output, arguments.force)?;
    let matrix = StoreReader::open(&arguments.input)?;
    let images = pipeline::write_basis(&matrix, output, arguments.memory, console)?;
    say!("{}: {images} images and what their pixels show", output.display());
    say!("peak memory {}", memory.stop().map_or("unknown".into(), human_bytes));
    say!("next: denoise them into clean.exr, say, then ltm-pack {} --basis clean.exr", arguments.input.display());
    Ok(())
}
