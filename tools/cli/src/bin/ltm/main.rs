//! `ltm`: render a scene into its light transport matrix, relight it, look into the files.

#![expect(clippy::print_stdout, reason = "a program's results go to standard output")]

mod completions;
mod daylight;
mod demo;
mod doctor;
mod farm;
mod first_steps;
mod glare;
mod info;
mod input;
#[path = "../ltm-pack/main.rs"]
mod ltm_pack;
#[path = "../ltm-unpack/main.rs"]
mod ltm_unpack;
mod maintain;
mod moment;
mod picture;
mod plan;
mod relight;
mod render;
mod share;
mod sibling;
mod verify;

use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use ltm::Result;
use ltm_cli::console::{self, Console, EXIT_CODES};
use ltm_cli::documentation;

/// Light transport matrices: trace a scene once, then relight it at once.
///
/// Without a command, says what can be done next with the files of this folder.
#[derive(Parser)]
#[command(name = "ltm", version, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// Threads to use [default: one for each core].
    #[arg(long, global = true)]
    threads: Option<usize>,
    /// Write progress as lines to standard error, `progress: STAGE DONE/TOTAL`, for a program that shows it.
    #[arg(long, global = true)]
    progress: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Render, pack, relight and show a furnished room, and print what it cost and what it lost.
    #[command(after_help = "Example: ltm demo --out room --samples 16")]
    Demo(demo::Demo),
    /// Render a scene file into a stored matrix (.ltm). An interrupted render is continued by the same command.
    #[command(after_help = "Examples:
  ltm render room.toml                       writes room.ltm
  ltm render room.toml -o t.ltm --samples 256 --size 1024x768
  ltm render room.toml --blocks 0..100       one part of a farm's work
  ltm render room.toml --pack --target 45dB  writes room.ltc, and no matrix
  ltm render room.glb --pack --camera door --camera desk    room-door.ltc and room-desk.ltc, with one tree")]
    Render(render::Render),
    /// Plan the work of many machines: ranges of blocks, and what each will take, in a file that they all read.
    #[command(after_help = "Examples:
  ltm plan room.toml                         writes room.plan.json, ranges of five minutes of one core
  ltm plan room.toml -o p.json --each 20min --samples 1024 --target 45dB")]
    Plan(plan::Plan),
    /// Build one range of a plan into a shard. A range that is there already costs one look.
    #[command(after_help = "Examples:
  ltm build --plan room.plan.json --range 7 --out shards
  ltm build --plan room.plan.json --blocks 0..64 --out /shared/shards
  ltm build --plan room.plan.json --range 7 --out s3://bucket/room
  ltm build --plan room.plan.json --round clean --range 0 --out shards    a unit that ltm merge --rounds lists")]
    Build(farm::Build),
    /// Make an image from a container (.ltc) or a stored matrix (.ltm) under a lighting.
    #[command(after_help = "Examples:
  ltm relight room.ltc -o room.exr
  ltm relight room.ltc -o room.png --on desk --on 'ceiling*' --device cpu
  ltm relight room.ltc --lighting look.toml --look night -o night.png --tone agx
  ltm relight room.ltc --lighting look.toml -o frame-####.png --fps 24
  ltm relight room.ltc -o lights.exr --layers lights
  ltm relight room.ltc -o lux.png --false-colour illuminance --reflectance 0.5")]
    Relight(relight::Relight),
    /// A year of daylight: autonomy, useful illuminance and sun of every sensor and pixel of a scene under a climate.
    #[command(after_help = "Examples:
  ltm daylight room.toml --climate city.epw -o year    its grids and its camera
  ltm daylight room.toml --climate city.epw --view desk --hourly
  ltm daylight year/camera.ltc --climate other.epw -o other")]
    Daylight(daylight::Daylight),
    /// Say how likely daylight glares in pictures of what an eye sees: the daylight glare probability, and its sources.
    #[command(after_help = "Examples:
  ltm glare eye.exr                                    a fisheye, or a panorama that looks where the eye does
  ltm glare panorama.exr --turn -90                    the eye looks to the left of its middle
  ltm glare day-*.exr -o glare.csv                     a line for each picture")]
    Glare(glare::Glare),
    /// Write a container as a web page: a picture whose lights its viewers mix, on any static host or from a disk.
    #[command(after_help = "Examples:
  ltm share room.ltc -o site                    a folder to put on a static host
  ltm share room.ltc -o site --lighting looks.toml --title 'Meeting room'
  ltm share hotel-lobby.ltc hotel-bar.ltc -o site   views of one scene, as tabs under one mix
  ltm share room.ltc -o room.html --single      one file to send")]
    Share(share::Share),
    /// Open a container in a window, a mixer for its lights, or render a scene in it and mix meanwhile. A program of its own, ltm-view.
    #[command(disable_help_flag = true)]
    View(sibling::Arguments),
    /// Say what a .ltm or .ltc file is, or what a scene or glTF file holds.
    #[command(after_help = "Examples:
  ltm info room.ltc
  ltm info s3://bucket/room.ltc              only its index is fetched
  ltm info room.ltc --json -l look.toml      what each light gives under a look
  ltm info room.glb                          cameras, lights, materials, and what is left out")]
    Info(info::Info),
    /// Read every byte of a .ltm or .ltc file and list what is damaged.
    #[command(after_help = "Exits with 4 if anything is. Example: ltm verify room.ltm")]
    Verify(verify::Verify),
    /// Render the damaged and missing blocks of a matrix again.
    #[command(after_help = "Example: ltm repair room.ltm room.toml --samples 256")]
    Repair(maintain::Repair),
    /// Join files that hold different blocks of the same job, or the shards of a plan. Doing it again changes nothing.
    #[command(
        after_help = "Exits with 4 where a block is damaged in every file, with 3 where one is missing; with --plan with 8 where \
one is missing, after a line FIRST..END for each range to build. Examples:
  ltm merge -o whole.ltm part-*.ltm
  ltm merge --plan room.plan.json shards -o room.ltc
  ltm merge --plan room.plan.json shards -o room.ltc --list=array     for Slurm's --array
  ltm merge --plan room.plan.json shards -o room.ltc --rounds         units of the next round for ltm build, or the container"
    )]
    Merge(maintain::Merge),
    /// Measure what the program reaches: each study writes CSV, a plot and a table. A program of its own, ltm-study.
    #[command(disable_help_flag = true)]
    Study(sibling::Arguments),
    /// Print the machine, its GPU, what the programs find of it, and what is missing for what: for a report of a fault.
    Doctor,
    /// Print a shell's completions of ltm and of the programs beside it.
    #[command(after_help = "Examples:
  source <(ltm completions bash)             in ~/.bashrc; in ~/.zshrc with zsh, after compinit
  ltm completions fish > ~/.config/fish/completions/ltm.fish")]
    Completions(completions::Completions),
}

fn main() -> ExitCode {
    match documentation::asked_program().as_deref() {
        Some("ltm-pack") => return ltm_pack::main(),
        Some("ltm-unpack") => return ltm_unpack::main(),
        _ => {}
    }
    let arguments: Arguments = documentation::parse("ltm");
    let console = Console::new().telling(arguments.progress);
    console::finish("ltm", run(arguments, &console))
}

fn run(arguments: Arguments, console: &Console) -> Result<()> {
    console::use_threads(arguments.threads)?;
    let Some(command) = arguments.command else { return first_steps::run(Path::new(".")) };
    match command {
        Command::Demo(options) => demo::run(&options, arguments.threads, console),
        Command::Render(options) => render::run(&options, console),
        Command::Plan(options) => plan::run(&options, console),
        Command::Build(options) => farm::build(&options, console),
        Command::Relight(options) => relight::run(&options, console),
        Command::Daylight(options) => daylight::run(&options, console),
        Command::Share(options) => share::run(&options, console),
        Command::View(options) => sibling::run("ltm-view", arguments.threads, &options),
        Command::Glare(options) => glare::run(&options, console),
        Command::Info(options) => info::run(&options, console),
        Command::Verify(options) => verify::run(&options, console),
        Command::Repair(options) => maintain::repair(&options, console),
        Command::Merge(options) => maintain::merge(&options, console),
        Command::Study(options) => sibling::run("ltm-study", arguments.threads, &options),
        Command::Doctor => doctor::run(),
        Command::Completions(options) => completions::run(&options),
    }
}
