//! A real window on a virtual display: this test program starts itself as the viewer under Xvfb.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use eframe::egui::vec2;
use ltm::container::ContainerReader;
use ltm::image::{LinearImage, ToneMapping, read_image};
use ltm::light::Lighting;
use ltm::relight::CpuRelighter;
use ltm::scene::BuiltIn;
use ltm_view::live::LiveChoices;
use ltm_view::{RelightOn, WindowOptions, looks, run};

use super::container;
use super::driver::Driver;

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

/// First argument with which this program is the viewer: container, screenshot, "gpu" to relight there, "screen" to show
/// it there too, width and height of the window in points.
const AS_VIEWER: &str = "--act-as-viewer";
/// Names the state folder of such a viewer.
const STATE: &str = "LTM_VIEW_TEST_STATE";
/// Says how such a viewer renders a scene: container, width, height, samples, apart by `|`.
const LIVE: &str = "LTM_VIEW_TEST_LIVE";
/// Names the container that such a viewer has as a second tab.
const BESIDE: &str = "LTM_VIEW_TEST_BESIDE";
/// Names that such a viewer asks the desktop for its dialogues.
const DIALOGUES: &str = "LTM_VIEW_TEST_DIALOGUES";
/// First argument with which it writes a container: scene file or built-in name, samples per pixel, container.
const AS_TRACER: &str = "--act-as-tracer";

/// Whether there is an adapter, or `LTM_REQUIRE_GPU` says that there must be one.
pub(crate) fn has_adapter() -> bool {
    let adapter = || pollster::block_on(wgpu::Instance::default().request_adapter(&Default::default())).is_ok();
    std::env::var_os("LTM_REQUIRE_GPU").is_some_and(|v| v == "1") || adapter()
}

/// Whether a real window can be opened here: with Xvfb and an adapter.
pub(crate) fn is_possible() -> bool {
    let xvfb = Command::new("xvfb-run").arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
    xvfb && has_adapter()
}

/// Acts as the viewer if that is asked for.
pub(crate) fn act_as_program() -> Option<ExitCode> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, rest @ ..] = arguments.as_slice() else { return None };
    match (mode.as_str(), rest) {
        (AS_VIEWER, [path, rest @ ..]) => {
            let options = WindowOptions {
                path: Some(path.into()),
                beside: std::env::var_os(BESIDE).map(PathBuf::from).into_iter().collect(),
                live: std::env::var(LIVE).map_or_else(|_| LiveChoices::default(), |text| live_choices(&text)),
                screenshot: rest.first().map(PathBuf::from),
                frames: 30,
                relight_on: if rest.get(1).is_some_and(|on| on != "cpu") { RelightOn::Gpu } else { RelightOn::Cpu },
                shown_on_device: Some(rest.get(1).is_some_and(|on| on == "screen")),
                size: match rest {
                    [_, _, width, height] => Some([width, height].map(|points| points.parse().unwrap())),
                    _ => None,
                },
                native_dialogs: std::env::var_os(DIALOGUES).is_some(),
                state_folder: std::env::var_os(STATE).map(PathBuf::from),
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

fn live_choices(text: &str) -> LiveChoices {
    let parts: Vec<&str> = text.split('|').collect();
    let [output, width, height, samples] = parts[..] else { panic!("{text}") };
    let [width, height, samples] = [width, height, samples].map(|number| number.parse().unwrap());
    LiveChoices {
        output: Some(output.into()),
        size: Some((width, height)),
        samples: Some(samples),
        ..Default::default()
    }
}

fn this_program() -> PathBuf {
    std::env::current_exe().unwrap()
}

/// What a real window of the usual size shows of a container, as a picture of the whole window.
fn screenshot(container: &Path, name: &str, on: &str) -> LinearImage {
    screenshot_on(container, name, on, [1440, 900], 1)
}

/// As [`screenshot`], of a window of some points on a display that has `scale` pixels for each and little room beside it.
fn screenshot_on(container: &Path, name: &str, on: &str, points: [u32; 2], scale: u32) -> LinearImage {
    let [width, height] = points.map(|points| (points * scale).to_string());
    let folder = container.parent().unwrap().to_owned();
    let picture = std::env::var_os("LTM_VIEW_PICTURES").map_or(folder, PathBuf::from).join(name);
    let output = Command::new("xvfb-run")
        .args(["-a", "-s", &format!("-screen 0 {width}x{height}x24")])
        .arg(this_program())
        .args([AS_VIEWER.as_ref(), container.as_os_str(), picture.as_os_str(), on.as_ref()])
        .args(points.map(|points| points.to_string()))
        .env("WINIT_X11_SCALE_FACTOR", scale.to_string())
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

/// The bytes of a PNG, with its width.
fn bytes(path: &Path) -> (usize, Vec<[u8; 3]>) {
    let image = image::open(path).unwrap().to_rgb8();
    (image.width() as usize, image.into_raw().as_chunks().0.to_vec())
}

/// What the window shows without being asked for anything else: the scene's own light, exposed for it.
fn expected(container: &ContainerReader) -> (LinearImage, ToneMapping) {
    let lighting = Lighting::of_scene(&container.job().basis);
    let image = CpuRelighter::load(container).unwrap().relight(&lighting).unwrap();
    let tone = ToneMapping { exposure_stops: ltm::image::exposure_for(&image), ..Default::default() };
    (image, tone)
}

/// Every pixel of the picture stands on the screen in its place and in its colour: in windows of several sizes, the larger
/// ones filling their display, and on one with two pixels for each point.
fn a_real_window_shows_the_room() {
    let folder = tempfile::tempdir().unwrap();
    let container = room(&folder);
    // Across less than half of the window of 960 points, of which the panels take the same as of others.
    let windows = [([1440, 900], 1, 3.0), ([1920, 1080], 1, 3.0), ([960, 540], 2, 4.0), ([1440, 900], 2, 6.0)];
    for (points, scale, least_zoom) in windows {
        let [width, height] = points;
        let seen = screenshot_on(&container, &format!("window-{width}x{height}-{scale}.png"), "cpu", points, scale);
        assert_eq!([seen.width, seen.height], points.map(|points| points * scale));
        room_is_shown(&container, &seen, least_zoom);
    }
}

fn room_is_shown(container: &Path, seen: &LinearImage, least_zoom: f32) {
    let (across, seen) = (seen.width as usize, ToneMapping::default().bytes(seen));
    let (image, tone) = expected(&ContainerReader::open(container).unwrap());
    let shown = tone.bytes(&image);
    // The picture fills what is between the panels up to a margin of the surround's grey. From the middle, where it
    // certainly is, to where a whole line of it ends.
    const SURROUND: [u8; 3] = [18; 3];
    let [x, y] = [across / 2, seen.len() / across / 2];
    let column = |x: usize| (0..40).all(|i| seen[(y - 20 + i) * across + x] == SURROUND);
    let row = |y: usize| (0..40).all(|i| seen[y * across + x - 20 + i] == SURROUND);
    let [left, right] = [(0..x).rev().find(|&x| column(x)).unwrap() + 1, (x..).find(|&x| column(x)).unwrap()];
    let [top, bottom] = [(0..y).rev().find(|&y| row(y)).unwrap() + 1, (y..).find(|&y| row(y)).unwrap()];
    let (width, height) = (image.width as usize, image.height as usize);
    let zoom = (right - left) as f32 / width as f32;
    assert!(
        zoom > least_zoom && ((bottom - top) as f32 / height as f32 - zoom).abs() < 0.02,
        "{left}–{right}, {top}–{bottom}"
    );
    for y in 0..height {
        for x in 0..width {
            let place = |v: usize, from: usize| from + ((v as f32 + 0.5) * zoom) as usize;
            let (here, there) = (seen[place(y, top) * across + place(x, left)], shown[y * width + x]);
            // The window shows through tables, the image was read from 8 bits.
            let apart = here.iter().zip(there).map(|(a, b)| a.abs_diff(b)).max().unwrap();
            assert!(apart <= 2, "pixel {x}, {y}: {here:?} for {there:?}");
        }
    }
}

/// Whether hands can be played to a real window here.
pub(crate) fn has_hands() -> bool {
    Command::new("xdotool").arg("version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// What every script of hands begins with.
const WAIT_FOR: &str = r#"
    wait_for() { for i in $(seq 300); do [ -s "$1" ] && return; sleep 0.1; done; echo "no $1" >&2; exit 9; }"#;

/// Runs a script of hands on a display of its own. It knows the program, the container, and where the ceiling's fader stands,
/// which is asked of the same window without a display; and these files by their names.
fn play(script: &str, container: &Path, files: &[(&str, &Path)]) {
    let options = WindowOptions { path: Some(container.to_owned()), ..Default::default() };
    let fader = Driver::open_with(options, vec2(1440.0, 900.0)).find("ceiling, stops").center();
    let place = [("FADER_X", fader.x.round().to_string()), ("FADER_Y", fader.y.round().to_string())];
    play_at(script, container, files, &place);
}

/// As [`play`], with a second container as a tab beside the first.
pub(crate) fn play_tabs(script: &str, [container, beside]: [&Path; 2], files: &[(&str, &Path)]) {
    let fader = Driver::open_tabs_sized(&[container, beside], vec2(1440.0, 900.0)).find("ceiling, stops").center();
    let place = [("FADER_X", fader.x.round().to_string()), ("FADER_Y", fader.y.round().to_string())];
    play_at(script, container, &[files, &[(BESIDE, beside)]].concat(), &place);
}

/// As [`play`], of a scene that is rendered into a container of some pixels with some samples.
pub(crate) fn play_rendering(script: &str, scene: &Path, container: &Path, size: (u32, u32), samples: u32) {
    let live = format!("{}|{}|{}|{samples}", container.display(), size.0, size.1);
    play_at(script, scene, &[("RESULT", container)], &[(LIVE, live)]);
}

fn play_at(script: &str, container: &Path, files: &[(&str, &Path)], variables: &[(&str, String)]) {
    let output = Command::new("timeout")
        .args(["100", "xvfb-run", "-a", "-s", "-screen 0 1600x1000x24", "bash", "-c"])
        .arg([WAIT_FOR, script].concat())
        .env_remove("WAYLAND_DISPLAY")
        .env("VIEWER", this_program())
        .env("CONTAINER", container)
        .envs(files.iter().copied())
        .envs(variables.iter().map(|(name, value)| (*name, value)))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// A real window is driven by pointer and keys alone: a fader is dragged, the lighting and the picture are saved. The
/// picture is that of the lighting, as another program makes it.
pub(crate) fn a_real_window_is_driven_by_pointer_and_keys() {
    const SCRIPT: &str = r#"
        save() { xdotool key "$1"; sleep 1; xdotool key ctrl+a; xdotool type --delay 20 "$2"; sleep 0.3
                 xdotool key Return; wait_for "$2"; }
        "$VIEWER" --act-as-viewer "$CONTAINER" & viewer=$!
        window=$(xdotool search --sync --onlyvisible --name "room.ltc" | tail -1)
        sleep 2
        xdotool windowfocus "$window"; sleep 0.5
        eval "$(xdotool getwindowgeometry --shell "$window")"
        x=$((X + FADER_X)); y=$((Y + FADER_Y))
        xdotool mousemove $x $y; sleep 0.2; xdotool mousedown 1
        for i in 3 6 9 12 15; do sleep 0.1; xdotool mousemove $((x - i)) $y; done
        sleep 0.2; xdotool mouseup 1; sleep 0.5
        save ctrl+k "$LOOK"
        save ctrl+s "$PNG"
        xdotool key ctrl+q
        wait $viewer"#;
    let folder = tempfile::tempdir().unwrap();
    let (container, look, png) = (room(&folder), folder.path().join("l.toml"), folder.path().join("p.png"));
    play(SCRIPT, &container, &[("LOOK", &look), ("PNG", &png)]);
    let reader = ContainerReader::open(&container).unwrap();
    let basis = &reader.job().basis;
    let mix = looks::load(&look, basis).unwrap().mix;
    // 15 points of a fader of some hundred, on which 16 stops lie.
    assert!((-6.0..-1.0).contains(&mix.lights[0].stops), "{:?}", mix.lights[0].stops);
    let image = CpuRelighter::load(&reader).unwrap().relight(&mix.lighting(basis).unwrap()).unwrap();
    // The exposure stays what it was when the picture first stood.
    let expected = expected(&reader).1.bytes(&image);
    let (_, saved) = bytes(&png);
    let pairs = saved.as_flattened().iter().zip(expected.as_flattened());
    // The stops were rounded on their way through the file.
    assert!(pairs.clone().all(|(a, b)| a.abs_diff(*b) <= 1) && saved.len() == expected.len());
}

/// A real window is killed with work that no file has; the next one offers it, Enter takes it back, and it is saved.
pub(crate) fn a_killed_window_loses_no_work() {
    const SCRIPT: &str = r#"
        open_window() { "$VIEWER" --act-as-viewer "$CONTAINER" & viewer=$!
                        window=$(xdotool search --sync --onlyvisible --name "room.ltc" | tail -1)
                        sleep 2; xdotool windowfocus "$window"; sleep 0.5; }
        open_window
        eval "$(xdotool getwindowgeometry --shell "$window")"
        x=$((X + FADER_X)); y=$((Y + FADER_Y))
        # A window that is not drawn yet may miss the pointer.
        for attempt in 1 2 3 4 5; do
            xdotool mousemove $x $y; sleep 0.2; xdotool mousedown 1
            for i in 5 10 15; do sleep 0.1; xdotool mousemove $((x - i)) $y; done
            sleep 0.2; xdotool mouseup 1
            for i in $(seq 40); do [ -s "$LTM_VIEW_TEST_STATE/unsaved/0/work.toml" ] && break 2; sleep 0.1; done
        done
        wait_for "$LTM_VIEW_TEST_STATE/unsaved/0/work.toml"
        kill -9 $viewer; wait $viewer
        open_window
        xdotool key Return; sleep 2
        xdotool key ctrl+k; sleep 1; xdotool key ctrl+a; xdotool type --delay 20 "$LOOK"; sleep 0.3
        xdotool key Return; wait_for "$LOOK"; sleep 1
        xdotool key ctrl+q
        wait $viewer"#;
    let folder = tempfile::tempdir().unwrap();
    let (container, look, state) = (room(&folder), folder.path().join("l.toml"), folder.path().join("state"));
    play(SCRIPT, &container, &[("LOOK", &look), (STATE, &state)]);
    let reader = ContainerReader::open(&container).unwrap();
    let mix = looks::load(&look, &reader.job().basis).unwrap().mix;
    assert!((-6.0..-1.0).contains(&mix.lights[0].stops), "{:?}", mix.lights[0].stops);
    assert_eq!(std::fs::read_dir(state.join("unsaved")).unwrap().count(), 0, "what is saved is not kept twice");
}

/// Where a desktop is named that has no dialogues, the window's own list takes their place.
pub(crate) fn a_desktop_without_dialogues_is_done_without() {
    const SCRIPT: &str = r#"
        export PATH="$TOOLS" DBUS_SESSION_BUS_ADDRESS=unix:path=/nonexistent
        "$VIEWER" --act-as-viewer "$CONTAINER" & viewer=$!
        window=$(xdotool search --sync --onlyvisible --name "room.ltc" | tail -1)
        sleep 2; xdotool windowfocus "$window"; sleep 0.5
        for look in "$LOOK" "$SECOND"; do
            xdotool key ctrl+k; sleep 2; xdotool key ctrl+a; xdotool type --delay 20 "$look"; sleep 0.3
            xdotool key Return; wait_for "$look"; sleep 1
        done
        xdotool key ctrl+q
        wait $viewer"#;
    let folder = tempfile::tempdir().unwrap();
    let (container, tools) = (room(&folder), folder.path().join("bin"));
    // Without the programs by which dialogues are shown where no portal answers.
    std::fs::create_dir(&tools).unwrap();
    for tool in ["xdotool", "sleep", "seq", "tail"] {
        let found = Command::new("sh").args(["-c", &format!("command -v {tool}")]).output().unwrap();
        let found = String::from_utf8(found.stdout).unwrap();
        std::os::unix::fs::symlink(found.trim(), tools.join(tool)).unwrap();
    }
    let [look, second] = ["l.toml", "m.toml"].map(|name| folder.path().join(name));
    let yes = PathBuf::from("1");
    play(SCRIPT, &container, &[("LOOK", &look), ("SECOND", &second), ("TOOLS", &tools), (DIALOGUES, &yes)]);
    let basis = ContainerReader::open(&container).unwrap().job().basis.clone();
    assert!(looks::load(&look, &basis).is_ok() && looks::load(&second, &basis).is_ok());
}

fn the_device_that_draws_the_window_relights_as_the_cpu_does() {
    let folder = tempfile::tempdir().unwrap();
    let container = room(&folder);
    let [cpu, gpu, screen] = ["cpu", "gpu", "screen"].map(|on| screenshot(&container, &format!("{on}.png"), on));
    assert_eq!((cpu.width, cpu.height), (gpu.width, gpu.height));
    // The middle of the window, without the panels, whose figures differ.
    let (width, height) = (cpu.width as usize, cpu.height as usize);
    let middle = |image: &LinearImage| -> Vec<[f32; 3]> {
        let rows = image.pixels.chunks_exact(width).skip(height / 5).take(height * 3 / 5);
        rows.flat_map(|row| row[width * 2 / 5..width * 3 / 5].to_vec()).collect()
    };
    for other in [gpu, screen] {
        let pairs = middle(&cpu).into_iter().flatten().zip(middle(&other).into_iter().flatten());
        // One step of 8 bits where sRGB is steepest, in linear values.
        let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(most <= 0.01, "{most}");
    }
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
