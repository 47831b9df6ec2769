//! `ltm-view`, which `ltm view` starts.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::{Args, Parser, ValueEnum};
use ltm::resources::parse_bytes;
use ltm::scene::LoadOptions;
use ltm::{Error, Result};
use ltm_cli::console::{EXIT_CODES, finish, use_threads};
use ltm_cli::documentation;
use ltm_cli::words::parse_size;
use ltm_view::live::LiveChoices;
use ltm_view::{RelightOn, WindowOptions};

/// Open a container in a window: a mixer for its lights. Or render a scene and mix while it renders. Keys are listed under '?'.
#[derive(Parser)]
#[command(name = "ltm view", version, after_help = format!("Examples:
  ltm view room.ltc
  ltm view hotel-lobby.ltc hotel-bar.ltc     views of one scene, as tabs under one mix
  ltm view 'shot.####.ltc'                   the frames of an animation under one mix
  ltm view room.glb                          renders into room.ltc, mixed from the first seconds
  ltm view scene.toml --samples 256 --size 1024x768

{EXIT_CODES}"))]
struct Arguments {
    /// The container, or several of one scene, which are tabs under one mix; or a scene to render: .toml, .glb, .gltf, .obj. Without it, one is
    /// dropped on the window.
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    scene: SceneArguments,
    /// Save a PNG of the window once its picture stands, and close it.
    #[arg(long, value_name = "PNG")]
    screenshot: Option<PathBuf>,
    /// Where to relight: on the device that draws the window unless it is a software one, on the CPU, or there anyway.
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceName,
    /// Memory for the container's factors, and for rendering a scene; of a larger container, what is shown is read as it is
    /// needed [default: half of the machine's for factors, what the system has for rendering].
    #[arg(long, value_parser = parse_bytes)]
    memory: Option<u64>,
    /// Threads to use [default: one for each core].
    #[arg(long)]
    threads: Option<usize>,
}

/// How a scene is rendered.
#[derive(Args)]
struct SceneArguments {
    /// The container that a scene is rendered into [default: the scene file's name with .ltc, in this folder].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Samples per pixel [default: the scene file's].
    #[arg(long)]
    samples: Option<u32>,
    /// Seed of the samples [default: the scene file's].
    #[arg(long)]
    seed: Option<u64>,
    /// Image size, WIDTHxHEIGHT [default: the scene file's].
    #[arg(long, value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Which camera of a glTF file is seen first [default: the first].
    #[arg(long)]
    camera: Option<String>,
    /// Render although textures are missing, with the materials' colours in their place.
    #[arg(long)]
    allow_missing: bool,
    /// Read files that the scene names outside of its folder and of LTM_SCENES: for scenes whose author you trust.
    #[arg(long)]
    allow_outside: bool,
    /// Replace a container that is there, and what an interrupted render of something else has left.
    #[arg(long)]
    force: bool,
}

impl SceneArguments {
    fn choices(self) -> LiveChoices {
        let Self { output, samples, seed, size, camera, allow_missing, allow_outside, force } = self;
        let load = LoadOptions { allow_missing, allow_outside, memory_bytes: None, camera, grid: None };
        LiveChoices { output, samples, size, seed, overwrite: force, load }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum DeviceName {
    Auto,
    Cpu,
    Gpu,
}

/// Longest time in which a display that works opens a window, on a machine that does other things as well.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> ExitCode {
    finish("ltm view", run(documentation::parse("ltm-view")))
}

fn run(options: Arguments) -> Result<()> {
    use_threads(options.threads)?;
    let opened = Arc::new(AtomicBool::new(false));
    give_up_unless(opened.clone());
    let mut files = options.files.into_iter();
    ltm_view::run(WindowOptions {
        path: files.next(),
        beside: files.collect(),
        live: options.scene.choices(),
        screenshot: options.screenshot,
        frames: 10,
        budget_bytes: options.memory,
        opened,
        relight_on: match options.device {
            DeviceName::Auto => RelightOn::Auto,
            DeviceName::Cpu => RelightOn::Cpu,
            DeviceName::Gpu => RelightOn::Gpu,
        },
        state_folder: state_folder(),
        native_dialogs: is_desktop(),
        ..Default::default()
    })
}

/// Ends the program, as any error does, if the window does not open. Nothing else can, since the system's libraries
/// wait indefinitely for a display or driver that does not answer.
fn give_up_unless(opened: Arc<AtomicBool>) {
    std::thread::spawn(move || {
        std::thread::sleep(PATIENCE);
        if !opened.load(Ordering::Relaxed) {
            let display = std::env::var("DISPLAY").unwrap_or_default();
            let error = Error::NoGpu(format!(
                "the display (DISPLAY={display}) or its driver does not answer; apt-get install mesa-vulkan-drivers \
                 gives a driver in software, `xvfb-run` (apt-get install xvfb) a display"
            ));
            eprintln!("ltm view: {error}");
            std::process::exit(i32::from(error.exit_code()));
        }
    });
}

/// Whether a desktop runs here that may have dialogues for files. Elsewhere asking for one can take long.
fn is_desktop() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    // macOS wants its dialogues on the main thread, which draws.
    !cfg!(target_os = "macos") && (cfg!(windows) || is_set("XDG_CURRENT_DESKTOP"))
}

/// Where programs keep what a user would not miss: the XDG base directories' state folder.
fn state_folder() -> Option<PathBuf> {
    let folder = |name| std::env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let state = folder("XDG_STATE_HOME").or_else(|| Some(folder("HOME")?.join(".local/state")))?;
    Some(state.join("ltm"))
}
