//! `ltm-unpack`: a container in, a stored matrix, images or an array out.

#![expect(clippy::print_stdout, reason = "a program's results go to standard output")]

#[path = "../console.rs"]
mod console;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use console::{Console, EXIT_CODES};
use ltm::container::ContainerReader;
use ltm::pipeline::{self, UnpackOptions};
use ltm::{Error, Result};

/// Multiply a container (.ltc) out: into a stored matrix, one image for each light, or an array.
#[derive(Parser)]
#[command(version, after_help = format!("Examples:
  ltm-unpack room.ltc -o room.ltm        the whole matrix
  ltm-unpack room.ltc -o lights.exr      one EXR layer for each light, as the scene lights it
  ltm-unpack room.ltc -o lights.npy      array [lights, height, width, 3] of the same images

{EXIT_CODES}"))]
struct Arguments {
    /// The container.
    input: PathBuf,
    /// What to write; the extension decides: .ltm, .exr or .npy.
    #[arg(short, long)]
    output: PathBuf,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
    /// Threads to use [default: one for each core].
    #[arg(long)]
    threads: Option<usize>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let console = Console::new();
    console::finish("ltm-unpack", run(&arguments, &console))
}

fn run(arguments: &Arguments, console: &Console) -> Result<()> {
    console::use_threads(arguments.threads)?;
    let container = ContainerReader::open(&arguments.input)?;
    let output = &arguments.output;
    let overwrite = arguments.force;
    if output.exists() && !overwrite {
        return Err(Error::input(output.display().to_string(), "is there already", "give --force to replace it"));
    }
    let job = container.job();
    match output.extension().and_then(|e| e.to_str()) {
        Some("ltm") => {
            let options = UnpackOptions { overwrite, ..Default::default() };
            pipeline::unpack_to_store(&container, job, output, &options, console)?;
        }
        Some("exr") => pipeline::unpack_to_exr(&container, job, output, console)?,
        Some("npy") => pipeline::unpack_to_npy(&container, job, output, console)?,
        _ => {
            let problem = "the name ends in none of .ltm, .exr, .npy";
            return Err(Error::input(output.display().to_string(), problem, "choose the output by its extension"));
        }
    }
    println!("{}: written", output.display());
    Ok(())
}
