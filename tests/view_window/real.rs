//! A real window on a virtual display: this test program starts itself as the viewer under Xvfb.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use ltm::image::{LinearImage, read_image};
use ltm::scene::BuiltIn;
use ltm::view::{RelightOn, WindowOptions, run};

use super::container;

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 4] = [
    (
        "the_device_that_draws_the_window_relights_as_the_cpu_does",
        the_device_that_draws_the_window_relights_as_the_cpu_does,
    ),
    ("a_real_window_shows_the_room", a_real_window_shows_the_room),
    ("without_a_display_one_line_says_so", without_a_display_one_line_says_so),
    ("without_a_driver_one_line_names_the_package", without_a_driver_one_line_names_the_package),
];

/// First argument with which this program is the viewer: container, screenshot, "gpu" to relight there.
const AS_VIEWER: &str = "--act-as-viewer";
/// First argument with which it writes a container: scene file or built-in name, samples per pixel, container.
const AS_TRACER: &str = "--act-as-tracer";

/// Whether a real window can be opened here: with Xvfb and an adapter, or where `LTM_REQUIRE_GPU` says that there must be
/// one.
pub(crate) fn is_possible() -> bool {
    let xvfb = Command::new("xvfb-run").arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    let adapter = || pollster::block_on(wgpu::Instance::default().request_adapter(&Default::default())).is_ok();
    xvfb && (std::env::var_os("LTM_REQUIRE_GPU").is_some_and(|v| v == "1") || adapter())
}

/// Acts as the viewer if that is asked for.
pub(crate) fn act_as_program() -> Option<ExitCode> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, rest @ ..] = arguments.as_slice() else { return None };
    match (mode.as_str(), rest) {
        (AS_VIEWER, [path, rest @ ..]) => {
            let options = WindowOptions {
                path: Some(path.into()),
                screenshot: rest.first().map(PathBuf::from),
                frames: 30,
                relight_on: if rest.get(1).is_some_and(|on| on == "gpu") { RelightOn::Gpu } else { RelightOn::Cpu },
                ..Default::default()
            };
            Some(match run(options) {
                Ok(()) => ExitCode::SUCCESS,
                Err(error) => {
                    eprintln!("{error}");
                    ExitCode::from(error.exit_code())
                }
            })
        }
        (AS_TRACER, [scene, samples, path]) => {
            let loaded = match scene.strip_suffix(".toml") {
                Some(_) => ltm::scene::load(Path::new(scene)).unwrap(),
                None => BuiltIn { width: 480, height: 360, texels: 12 }.named(scene).unwrap(),
            };
            container::write(Path::new(path), loaded, samples.parse().unwrap());
            Some(ExitCode::SUCCESS)
        }
        _ => None,
    }
}

fn this_program() -> PathBuf {
    std::env::current_exe().unwrap()
}

/// What a real window shows of a container, as a picture of the whole window.
fn screenshot(container: &Path, name: &str, on: &str) -> LinearImage {
    let folder = container.parent().unwrap().to_owned();
    let picture = std::env::var_os("LTM_VIEW_PICTURES").map_or(folder, PathBuf::from).join(name);
    let output = Command::new("xvfb-run")
        .args(["-a", "-s", "-screen 0 1600x1000x24"])
        .arg(this_program())
        .args([AS_VIEWER.as_ref(), container.as_os_str(), picture.as_os_str(), on.as_ref()])
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    read_image(&picture).unwrap()
}

fn room(folder: &tempfile::TempDir) -> PathBuf {
    let container = folder.path().join("room.ltc");
    let scene = BuiltIn { width: 192, height: 144, texels: 6 }.named("mixed").unwrap();
    container::write(&container, scene, 16);
    container
}

fn a_real_window_shows_the_room() {
    let folder = tempfile::tempdir().unwrap();
    let seen = screenshot(&room(&folder), "window.png", "cpu");
    // A fitted room fills most of the middle: somewhere there it is bright, and the panels' grey is not all there is.
    let bright = seen.luminances().filter(|&v| v > 0.3).count();
    assert!(bright > seen.pixels.len() / 50, "{bright} bright pixels of {}", seen.pixels.len());
}

fn the_device_that_draws_the_window_relights_as_the_cpu_does() {
    let folder = tempfile::tempdir().unwrap();
    let container = room(&folder);
    let [cpu, gpu] = ["cpu", "gpu"].map(|on| screenshot(&container, &format!("{on}.png"), on));
    assert_eq!((cpu.width, cpu.height), (gpu.width, gpu.height));
    // The middle of the window, without the panels, whose figures differ.
    let (width, height) = (cpu.width as usize, cpu.height as usize);
    let middle = |image: &LinearImage| -> Vec<[f32; 3]> {
        let rows = image.pixels.chunks_exact(width).skip(height / 5).take(height * 3 / 5);
        rows.flat_map(|row| row[width * 2 / 5..width * 3 / 5].to_vec()).collect()
    };
    let pairs = middle(&cpu).into_iter().flatten().zip(middle(&gpu).into_iter().flatten());
    // One step of 8 bits where sRGB is steepest, in linear values.
    let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(most <= 0.01, "{most}");
}

/// The program's exit code and what it said, less what libraries of the system say.
fn ends(command: &mut Command) -> (Option<i32>, String) {
    let output = command.env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET").output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn without_a_display_one_line_says_so() {
    for display in [None, Some(""), Some(":987")] {
        let mut command = Command::new(this_program());
        command.args([AS_VIEWER, "none.ltc"]).env_remove("DISPLAY");
        command.envs(display.map(|display| ("DISPLAY", display)));
        let (code, error) = ends(&mut command);
        assert_eq!(code, Some(3), "{error}");
        assert!(error.contains("no display") && error.trim().lines().count() == 1, "{error}");
        assert!(!error.contains(".rs"), "{error}");
    }
    let mut command = Command::new("xvfb-run");
    command.arg("-a").arg(this_program()).args([AS_VIEWER, "none.ltc"]);
    let output = command.env("WAYLAND_DISPLAY", "nobody").env("XDG_RUNTIME_DIR", "/").output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{error}");
    assert!(error.contains("unset WAYLAND_DISPLAY") && error.trim().lines().count() == 1, "{error}");
}

fn without_a_driver_one_line_names_the_package() {
    let mut command = Command::new("xvfb-run");
    command.arg("-a").arg(this_program()).args([AS_VIEWER, "none.ltc"]);
    for variable in ["VK_ICD_FILENAMES", "VK_DRIVER_FILES", "__EGL_VENDOR_LIBRARY_FILENAMES"] {
        command.env(variable, "/nonexistent");
    }
    let (code, error) = ends(&mut command);
    assert_eq!(code, Some(7), "{error}");
    assert!(error.contains("apt-get install mesa-vulkan-drivers") && error.trim().lines().count() == 1, "{error}");
}
