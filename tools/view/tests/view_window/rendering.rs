//! A scene that is mixed while it renders: its picture is replaced, and nothing of the work is lost.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui::{Key, Modifiers, vec2};
use ltm::container::ContainerReader;
use ltm::pipeline::early_path;
use ltm_view::WindowOptions;
use ltm_view::live::LiveChoices;

use super::driver::{Driver, PATIENCE};
use super::real::play_rendering;

/// Tests of this file that need no display.
pub(crate) const TESTS: [(&str, fn()); 7] = [
    ("a_scene_is_mixed_while_it_renders", a_scene_is_mixed_while_it_renders),
    ("a_pause_holds_the_work_and_not_the_mixer", a_pause_holds_the_work_and_not_the_mixer),
    ("a_moved_camera_starts_from_the_coarse_picture", a_moved_camera_starts_from_the_coarse_picture),
    ("closing_in_the_middle_asks_what_to_keep", closing_in_the_middle_asks_what_to_keep),
    ("a_scene_that_cannot_be_read_says_so_in_the_window", a_scene_that_cannot_be_read_says_so_in_the_window),
    ("a_scene_that_changes_on_the_disk_is_rendered_anew", a_scene_that_changes_on_the_disk_is_rendered_anew),
    ("a_climate_lights_the_sky_of_an_hour", a_climate_lights_the_sky_of_an_hour),
];

/// Those that need one.
pub(crate) const REAL: [(&str, fn()); 1] = [(
    "a_window_that_is_killed_opens_again_with_what_was_there",
    a_window_that_is_killed_opens_again_with_what_was_there,
)];

/// A room whose ceiling has two lamps, as an OBJ file without a camera.
fn room(folder: &Path) -> PathBuf {
    let mut obj = "mtllib room.mtl\n".to_owned();
    let mut vertices = 0;
    let mut quad = |name: &str, material: &str, corners: [[f32; 3]; 4]| {
        obj += &format!("o {name}\nusemtl {material}\n");
        for [x, y, z] in corners {
            obj += &format!("v {x} {y} {z}\n");
        }
        obj += &format!("f {} {} {} {}\n", vertices + 1, vertices + 2, vertices + 3, vertices + 4);
        vertices += 4;
    };
    quad("floor", "grey", [[-2.0, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0]]);
    quad("back", "grey", [[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 2.5, -2.0], [-2.0, 2.5, -2.0]]);
    quad("side", "red", [[-2.0, 0.0, 2.0], [-2.0, 0.0, -2.0], [-2.0, 2.5, -2.0], [-2.0, 2.5, 2.0]]);
    for (name, x) in [("left lamp", -1.0), ("right lamp", 1.0)] {
        let corners = [[x - 0.3, 2.4, -0.3], [x + 0.3, 2.4, -0.3], [x + 0.3, 2.4, 0.3], [x - 0.3, 2.4, 0.3]];
        quad(name, "lamp", corners);
    }
    let path = folder.join("room.obj");
    fs::write(&path, obj).unwrap();
    fs::write(
        folder.join("room.mtl"),
        "newmtl grey\nKd 0.6 0.6 0.6\nnewmtl red\nKd 0.6 0.1 0.1\nnewmtl lamp\nKd 0 0 0\nKe 8 7 6\n",
    )
    .unwrap();
    path
}

fn choices(folder: &Path, samples: u32) -> LiveChoices {
    let (output, size) = (Some(folder.join("room.ltc")), Some((192, 128)));
    LiveChoices { output, samples: Some(samples), size, ..Default::default() }
}

fn open(folder: &Path, samples: u32) -> Driver {
    let scene = room(folder);
    let live = choices(folder, samples);
    Driver::unseen_with(WindowOptions { path: Some(scene), live, ..Default::default() })
}

/// The first estimate can be mixed at once; when the last stands, the mix, the selection and the zoom are as they were left.
fn a_scene_is_mixed_while_it_renders() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = open(folder.path(), 96);
    driver.frame(Vec::new());
    driver.wait_until("the first estimate", |driver| driver.has("right lamp, on"));
    assert!(driver.says("Early picture") || driver.says("Finished"), "an early picture says that it is one");
    driver.click(driver.find("right lamp, on").center());
    driver.key(Key::Plus, Modifiers::NONE);
    driver.key(Key::K, Modifiers::NONE);
    driver.wait_until("the finished picture", |driver| driver.says("Finished: 192 × 128 pixels, 96 samples"));
    driver.settle();
    let (mixed, container) = (driver.picture(), folder.path().join("room.ltc"));
    assert_eq!(mixed.len(), 4 * 192 * 128);
    assert!(!early_path(&container).exists(), "the early estimate is of no use any more");
    assert!(driver.says("Snapshot 1"), "snapshots stay");

    // What the container shows by itself, under the same mix and exposure.
    driver.key(Key::N, Modifiers::NONE);
    driver.settle();
    let mixed = driver.picture();
    let mut offline = Driver::open(&container);
    offline.click(offline.find("right lamp, on").center());
    offline.settle();
    offline.key(Key::N, Modifiers::NONE);
    offline.settle();
    let apart = offline.picture().iter().zip(&mixed).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    // One is relit whole, the other by the change of a light, which rounds.
    assert!(apart <= 1, "the lamp that was switched off in the early picture is off in the last: {apart}");
    driver.key(Key::Z, Modifiers::CTRL.plus(Modifiers::COMMAND));
    driver.settle();
    assert!(driver.picture() != mixed, "what was done to an early picture can be undone");
}

/// While the work is paused nothing is rendered, and the mixer goes on.
fn a_pause_holds_the_work_and_not_the_mixer() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = open(folder.path(), 4096);
    driver.frame(Vec::new());
    driver.wait_until("the first estimate", |driver| driver.has("right lamp, on") && driver.has("Pause"));
    driver.click(driver.find("Pause").center());
    driver.wait_until("the pause", |driver| driver.has("Go on") && driver.says("paused"));
    let newest = || fs::metadata(early_path(&folder.path().join("room.ltc"))).unwrap().modified().unwrap();
    driver.settle();
    let (before, at) = (driver.picture(), newest());
    driver.click(driver.find("left lamp, on").center());
    driver.settle();
    assert!(driver.picture() != before && newest() == at);
    driver.click(driver.find("Go on").center());
    driver.wait_until("the work", |driver| driver.has("Pause"));
    driver.click(driver.find("Stop here").center());
    driver.wait_until("the end", |driver| driver.says("stopped"));
    assert!(!folder.path().join("room.ltc").exists() && newest() >= at);
}

/// A drag with the other button moves the camera: an outline at once, then estimates of the new view, in a container of its own.
fn a_moved_camera_starts_from_the_coarse_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = open(folder.path(), 48);
    driver.frame(Vec::new());
    driver.wait_until("the first picture", |driver| driver.says("Finished"));
    driver.settle();
    let before = driver.picture();
    driver.click(driver.find("left lamp, on").center());
    driver.settle();
    let middle = driver.find("picture").center();
    driver.drag_secondary(middle, middle + vec2(90.0, -40.0), 6);
    let moved = Instant::now();
    driver.wait_until("the outline", |driver| driver.says("Outline of the new view") || driver.says("Early picture"));
    assert!(moved.elapsed() < PATIENCE);
    driver.wait_until("the new view", |driver| driver.says("Finished"));
    driver.settle();
    assert!(driver.picture() != before);
    let view = folder.path().join("room-view.ltc");
    let [own, other] = [folder.path().join("room.ltc"), view].map(|path| ContainerReader::open(&path).unwrap());
    let words = |container: &ContainerReader| container.job().provenance.settings.clone();
    assert!(words(&own) != words(&other), "the scene's own view is as it was");
    // It can be saved beside the scene, and taken back.
    choose(&mut driver, "Save the view");
    driver.wait_until("the file", |driver| driver.says("Saved the view in"));
    let saved = ltm::scene::load(&folder.path().join("room.toml")).unwrap();
    let camera = ltm::scene::Camera::of_words(&words(&other), (192, 128)).unwrap();
    // The file has the digits of f32.
    assert!((saved.scene.camera.eye - camera.eye).length() < 1e-4);
    assert!((saved.scene.camera.forward - camera.forward).length() < 1e-5);
    choose(&mut driver, "Undo the move");
    driver.wait_until("the old view", |driver| driver.says("Finished"));
    driver.settle();
    driver.click(driver.find("left lamp, on").center());
    driver.settle();
    assert_eq!(driver.picture().len(), before.len());
}

/// Chooses an item of the menu of views.
fn choose(driver: &mut Driver, item: &str) {
    driver.click(driver.find("Camera").center());
    driver.wait_until("the menu", |driver| driver.has(item));
    driver.click(driver.find(item).center());
}

fn closing_in_the_middle_asks_what_to_keep() {
    let folder = tempfile::tempdir().unwrap();
    let container = folder.path().join("room.ltc");
    let names = || fs::read_dir(folder.path()).unwrap().count();
    for (answer, is_kept) in [("Keep", true), ("Discard", false)] {
        let mut driver = open(folder.path(), 1 << 16);
        driver.frame(Vec::new());
        driver.wait_until("an estimate", |driver| driver.has("right lamp, on"));
        assert!(!driver.ask_to_close(), "it asks first");
        driver.wait_until("the question", |driver| driver.has(answer));
        driver.click(driver.find(answer).center());
        driver.wait_until("the end", |driver| driver.is_closed());
        drop(driver);
        let is_there = ContainerReader::open(&early_path(&container)).is_ok();
        assert!(is_there == is_kept && !container.exists(), "{answer}");
    }
    assert_eq!(names(), 2, "the scene's two files are all that is left");
}

fn a_scene_that_cannot_be_read_says_so_in_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("room.toml");
    fs::write(&scene, "geometry = [\"nowhere.obj\"]\n").unwrap();
    let mut driver = Driver::unseen_with(WindowOptions { path: Some(scene), ..Default::default() });
    driver.frame(Vec::new());
    driver.wait_until("the message", |driver| driver.says("nowhere.obj"));
}

/// A change of the scene's file is told; rendering anew has its new lamp, and the mix of those that are left.
fn a_scene_that_changes_on_the_disk_is_rendered_anew() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = open(folder.path(), 16);
    driver.frame(Vec::new());
    driver.wait_until("the first picture", |driver| driver.says("Finished"));
    driver.click(driver.find("left lamp, on").center());
    let scene = folder.path().join("room.obj");
    let text = fs::read_to_string(&scene).unwrap().replace("right lamp", "another lamp");
    fs::write(&scene, text).unwrap();
    driver.wait_until("the news", |driver| driver.has("Scene changed: render anew"));
    driver.click(driver.find("Scene changed: render anew").center());
    driver.wait_until("the new lamp", |driver| driver.has("another lamp, on") && driver.says("Finished"));
    assert!(!driver.has("Scene changed: render anew"));
    driver.settle();
    let sum = |driver: &Driver| driver.picture().iter().map(|&v| u64::from(v)).sum::<u64>();
    let before = sum(&driver);
    driver.click(driver.find("left lamp, on").center());
    driver.settle();
    assert!(sum(&driver) > before, "the lamp that was switched off was off still");
}

/// A climate that is dropped lights the sky, and its hours are chosen by sliders; lamps stay as they are.
fn a_climate_lights_the_sky_of_an_hour() {
    let folder = tempfile::tempdir().unwrap();
    room(folder.path());
    let scene = folder.path().join("day.toml");
    let lights = "[[light]]\nkind = \"environment\"\nname = \"sky\"\ntexels = [16, 8]\nemission = [0.01, 0.01, 0.01]\n";
    let text = format!(
        "geometry = [\"room.obj\"]\n[camera]\neye = [0.5, 1.2, 4]\nlook_at = [0, 1, 0]\nwidth = 96\nheight = 64\n{lights}"
    );
    fs::write(&scene, text).unwrap();
    let climate = folder.path().join("city.wea");
    let site = "place Testville\nlatitude 48.1\nlongitude -11.6\ntime_zone -15\nsite_elevation 515\nweather_data_file_units 3\n";
    fs::write(&climate, format!("{site}6 21 11.5 80000 12000\n6 21 12.5 60000 20000\n")).unwrap();
    let live = LiveChoices { output: Some(folder.path().join("day.ltc")), samples: Some(8), ..Default::default() };
    let mut driver = Driver::unseen_with(WindowOptions { path: Some(scene), live, ..Default::default() });
    driver.frame(Vec::new());
    driver.wait_until("the picture", |driver| driver.says("Finished"));
    driver.settle();
    let before = driver.picture();
    driver.click(driver.find_containing("sky").center());
    driver.drop_file(&climate, driver.find("picture").center());
    driver.wait_until("the climate", |driver| driver.says("Testville") && driver.says("21 Jun"));
    driver.settle();
    assert!(driver.picture() != before, "the sky is that of noon");
    assert!(driver.says("12:00") && driver.has("Climate…"));
}

/// A real window is killed in the middle; the next one shows at once what was there, goes on, and asks what to keep when it is closed by keys.
fn a_window_that_is_killed_opens_again_with_what_was_there() {
    const SCRIPT: &str = r#"
        open_window() { "$VIEWER" --act-as-viewer "$CONTAINER" & viewer=$!
                        window=$(xdotool search --sync --onlyvisible --name "room.obj" | tail -1)
                        sleep 1; xdotool windowfocus "$window"; sleep 0.5; }
        early="${RESULT%.ltc}.early.ltc"
        open_window
        wait_for "$early"; sleep 1
        kill -9 $viewer; wait $viewer
        cp "$early" "$early.copy"
        open_window
        sleep 3
        xdotool key ctrl+q; sleep 1
        kill -0 $viewer || { echo "closed without a question" >&2; exit 8; }
        xdotool key Return
        wait $viewer"#;
    let folder = tempfile::tempdir().unwrap();
    let (scene, container) = (room(folder.path()), folder.path().join("room.ltc"));
    play_rendering(SCRIPT, &scene, &container, (192, 128), 1 << 16);
    let early = early_path(&container);
    let kept = ContainerReader::open(&early).unwrap();
    let killed = ContainerReader::open(&early.with_extension("ltc.copy")).unwrap();
    let size = |container: &ContainerReader| container.job().shape.width();
    assert!(size(&kept) >= size(&killed) && !container.exists(), "what was there is not rendered anew more coarsely");
}
