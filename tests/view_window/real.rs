//! A real window on a virtual display: this test program starts itself as the viewer under Xvfb.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use ltm::scene::BuiltIn;
use ltm::view::{WindowOptions, run};

use super::container;

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 2] = [
    ("a_real_window_shows_the_room", a_real_window_shows_the_room),
    ("without_a_display_one_line_says_so", without_a_display_one_line_says_so),
];

/// First argument with which this program is the viewer: container, screenshot.
const AS_VIEWER: &str = "--act-as-viewer";
/// First argument with which it writes a container: scene file or built-in name, samples per pixel, container.
const AS_TRACER: &str = "--act-as-tracer";

pub(crate) fn has_xvfb() -> bool {
    Command::new("xvfb-run").arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
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

fn a_real_window_shows_the_room() {
    let folder = tempfile::tempdir().unwrap();
    let container = folder.path().join("room.ltc");
    let scene = BuiltIn { width: 192, height: 144, texels: 6 }.named("mixed").unwrap();
    container::write(&container, scene, 16);
    let kept = std::env::var_os("LTM_VIEW_PICTURES").map_or(folder.path().to_owned(), PathBuf::from);
    let picture = kept.join("window.png");
    let output = Command::new("xvfb-run")
        .args(["-a", "-s", "-screen 0 1600x1000x24"])
        .arg(this_program())
        .args([AS_VIEWER.as_ref(), container.as_os_str(), picture.as_os_str()])
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let seen = ltm::image::read_image(&picture).unwrap();
    // A fitted room fills most of the middle: somewhere there it is bright, and the panels' grey is not all there is.
    let bright = seen.luminances().filter(|&v| v > 0.3).count();
    assert!(bright > seen.pixels.len() / 50, "{bright} bright pixels of {}", seen.pixels.len());
}

fn without_a_display_one_line_says_so() {
    let output = Command::new(this_program())
        .args([AS_VIEWER, "none.ltc"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{error}");
    assert!(error.contains("no display") && error.trim().lines().count() == 1, "{error}");
}
