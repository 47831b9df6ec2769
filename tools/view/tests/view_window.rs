//! The window: driven through egui without a display, and opened for real where a virtual display can be had.
//!
//! `cargo test -p ltm-view --test view_window`; the real window needs Xvfb and a Vulkan adapter (lavapipe does),
//! to be driven xdotool, and is listed as ignored without them. `LTM_VIEW_PICTURES` names a folder to keep its screenshots in.

#[path = "view_window/container.rs"]
mod container;
#[path = "view_window/controls.rs"]
mod controls;
#[path = "view_window/device.rs"]
mod device;
#[path = "view_window/driver.rs"]
mod driver;
#[path = "view_window/groups.rs"]
mod groups;
#[path = "view_window/kept.rs"]
mod kept;
#[path = "view_window/measures.rs"]
mod measures;
#[path = "view_window/panoramas.rs"]
mod panoramas;
#[path = "view_window/real.rs"]
mod real;
#[path = "view_window/rendering.rs"]
mod rendering;
#[path = "view_window/tabs.rs"]
mod tabs;
#[path = "../../../tests/relight_source/texels.rs"]
mod texels;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use driver::{Driver, PATIENCE};
use eframe::egui::{Key, Modifiers, vec2};
use libtest_mimic::{Arguments, Trial};
use ltm::container::ContainerReader;
use ltm::image::{LightSet, LinearImage};
use ltm::light::Lighting;
use ltm::relight::CpuRelighter;
use ltm::scene::BuiltIn;
use ltm_view::display::Display;
use ltm_view::worker::{Event, Means, Picture, Request, Seen, Session};

/// Ctrl as the system sends it.
const CTRL: Modifiers = Modifiers::CTRL.plus(Modifiers::COMMAND);

/// A room with one texelled light, traced once for all tests.
fn room() -> &'static Path {
    static ROOM: OnceLock<PathBuf> = OnceLock::new();
    ROOM.get_or_init(|| {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("view-room.ltc");
        let scene = BuiltIn { width: 96, height: 72, texels: 6 }.named("mixed").unwrap();
        container::write(&path, scene, 16);
        path
    })
}

/// A drag on a fader changes the picture within a few frames, and one undo takes all of it back.
fn a_fader_drag_relights_and_is_one_undo() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    let fader = driver.find("ceiling, stops");
    driver.drag(fader.center(), fader.center() + vec2(20.0, 0.0), 12);
    driver.settle();
    let brighter = driver.picture();
    assert_ne!(before, brighter, "the picture follows the fader");
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert_eq!(driver.picture(), before, "twelve frames of dragging are one step");
    driver.key(Key::Z, CTRL.plus(Modifiers::SHIFT));
    driver.settle();
    assert_eq!(driver.picture(), brighter);
}

/// A light that is switched off leaves a black room; on again it is as before.
fn a_switch_turns_the_light_off_and_on() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    let switch = driver.find("ceiling, on");
    driver.click(switch.center());
    driver.settle();
    assert!(driver.picture().chunks_exact(4).all(|pixel| pixel[..3] == [0, 0, 0]), "no light, no picture");
    driver.click(switch.center());
    driver.settle();
    assert_eq!(driver.picture(), before);
}

/// The picture follows while the fader is still held, and the last one is that of the last position.
fn pictures_come_during_a_drag_and_the_last_is_that_of_its_end() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    let start = driver.find("ceiling, stops").center();
    let end = start + vec2(30.0, 0.0);
    driver.press(start);
    driver.move_to(start + vec2(15.0, 0.0));
    driver.settle();
    let held = driver.picture();
    assert_ne!(held, before, "before the button is let go");
    (16..=30).for_each(|step| driver.move_to(start + vec2(step as f32, 0.0)));
    driver.release(end);
    driver.settle();
    let slowly = driver.picture();
    assert_ne!(slowly, held);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert_eq!(driver.picture(), before);
    driver.drag(start, end, 1);
    driver.settle();
    assert_eq!(driver.picture(), slowly);
}

/// Keys act on the picture, and `?` lists them.
fn keys_expose_and_help_lists_them() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    driver.key(Key::E, Modifiers::NONE);
    driver.settle();
    let brighter = driver.picture();
    let sum = |bytes: &[u8]| bytes.iter().map(|&b| u64::from(b)).sum::<u64>();
    assert!(sum(&brighter) > sum(&before));
    driver.key(Key::E, Modifiers::SHIFT);
    driver.settle();
    assert_eq!(driver.picture(), before);
    driver.key(Key::Questionmark, Modifiers::NONE);
    driver.settle();
    driver.find("Undo; a drag is one step");
}

/// Painting on the light's texture darkens or colours the room.
fn painting_on_the_light_changes_the_room() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    let dark = driver.find("Black");
    driver.click(dark.center());
    driver.settle();
    assert!(driver.picture().chunks_exact(4).all(|pixel| pixel[..3] == [0, 0, 0]));
    let texture = driver.find("texture");
    driver.drag(texture.center() - vec2(30.0, 0.0), texture.center() + vec2(30.0, 0.0), 6);
    driver.settle();
    let painted = driver.picture();
    assert!(painted.chunks_exact(4).any(|pixel| pixel[0] > 20), "painted light lights the room");
    assert_ne!(painted, before);
}

/// A disc on the light is dragged and scaled, each a step of its own.
fn a_shape_is_laid_dragged_and_scaled() {
    let mut driver = Driver::open(room());
    driver.click(driver.find("Disc").center());
    let texture = driver.find("texture");
    let mut pictures = vec![driver.picture()];
    let mut next = |driver: &mut Driver| {
        driver.settle();
        let picture = driver.picture();
        assert!(!pictures.contains(&picture), "step {} shows something new", pictures.len());
        pictures.push(picture);
    };
    let middle = texture.center();
    driver.click(middle);
    next(&mut driver);
    driver.drag(middle, middle - vec2(texture.width() / 4.0, 0.0), 5);
    next(&mut driver);
    // The disc is half as wide as the light: its corner is a quarter away on each axis.
    let corner = middle - vec2(texture.width() / 2.0, texture.height() / 4.0);
    driver.drag(corner + vec2(1.0, 0.0), middle - vec2(texture.width() / 2.0, texture.height() / 2.5), 5);
    next(&mut driver);
    for picture in pictures[..3].iter().rev() {
        driver.key(Key::Z, CTRL);
        driver.settle();
        assert!(driver.picture() == *picture, "one step back");
    }
}

/// A lighting is saved and loaded through the list of files, and is what `ltm relight` reads.
fn a_lighting_is_saved_and_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(room());
    let scene = driver.picture();
    let fader = driver.find("ceiling, stops").center();
    driver.drag(fader, fader - vec2(12.0, 0.0), 3);
    driver.settle();
    let dimmed = driver.picture();
    let look = folder.path().join("dim.toml");
    driver.key(Key::K, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
    assert!(std::fs::read_to_string(&look).unwrap().contains("stops = -"));
    driver.key(Key::R, Modifiers::SHIFT);
    driver.settle();
    assert!(driver.picture() == scene);
    driver.key(Key::L, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
    assert!(driver.picture() == dimmed);
    driver.find_containing("Loaded");
}

/// The command that is copied writes the very picture that the window writes.
fn the_copied_command_makes_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(room());
    driver.click(driver.find("Disc").center());
    driver.click(driver.find("texture").center());
    driver.click(driver.find("AgX").center());
    driver.settle();
    let look = folder.path().join("a disc.toml");
    driver.key(Key::K, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
    let png = folder.path().join("window.png");
    for way in ["AgX", "False colour"] {
        driver.click(driver.find(way).center());
        driver.key(Key::S, CTRL);
        driver.settle();
        driver.enter(png.to_str().unwrap());
        driver.settle();
        let window = std::fs::read(&png).unwrap();
        std::fs::remove_file(&png).unwrap();
        driver.click(driver.find("Command").center());
        driver.settle();
        let line = driver.copied().unwrap().strip_prefix("ltm ").unwrap().to_owned();
        let line = format!("'{}' {line} --device=cpu", ltm_program().display());
        let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        let bytes = |png: &[u8]| image::load_from_memory(png).unwrap().to_rgb8().into_raw();
        let pairs = bytes(&window).into_iter().zip(bytes(&std::fs::read(&png).unwrap()));
        // Stops and textures take a few roundings on their way through the file.
        let most = pairs.map(|(a, b)| a.abs_diff(b)).max().unwrap();
        assert!(most <= 1, "{way}: {most}");
    }
}

/// The program that a copied command line is for, where the workspace's programs were built beside this one.
fn ltm_program() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_ltm-view")).with_file_name("ltm")
}

/// The EXR's layers are named after the lights and add up to the radiance.
fn layers_add_up_to_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 7);
    let mut driver = Driver::open(&path);
    let (layers, radiance) = (folder.path().join("layers.exr"), folder.path().join("all.exr"));
    driver.click(driver.find("Layers…").center());
    driver.settle();
    driver.enter(layers.to_str().unwrap());
    driver.key(Key::E, CTRL);
    driver.settle();
    driver.enter(radiance.to_str().unwrap());
    driver.settle();
    let set = LightSet::open(&layers, None).unwrap();
    assert_eq!(set.lights.len(), 7);
    assert!(set.lights.iter().any(|light| light == "row 1/7"));
    let whole = ltm::image::read_image(&radiance).unwrap();
    let mut sums = vec![[0.0; 3]; whole.pixels.len()];
    set.read(&mut |row| {
        // What is under all lights, if anything is found to be that, is no light.
        if row.image < 7 {
            for (i, value) in row.values.iter().enumerate() {
                sums[row.y * whole.width as usize + row.x + i][row.channel] += value;
            }
        }
        Ok(())
    })
    .unwrap();
    for (sum, pixel) in sums.iter().flatten().zip(whole.values()) {
        // Seven sums in f32 of values near a half.
        assert!((sum - pixel).abs() < 1e-5);
    }
}

/// Among hundreds of lights, those searched for are shown; Alt-click hears one alone, a click on the picture selects.
fn hundreds_of_lights_are_searched_soloed_and_picked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 320);
    let mut driver = Driver::open(&path);
    driver.key(Key::P, CTRL);
    driver.settle();
    driver.enter("row 17/");
    driver.settle();
    assert!(driver.has("row 17/3, on") && !driver.has("row 18/3, on"));
    let all = driver.picture();
    driver.click_with(driver.find("row 17/3, on").center(), Modifiers::ALT);
    driver.settle();
    let lit = |picture: &[u8]| -> Vec<usize> {
        let row = &picture[..container::STAGE[0] as usize * 4];
        row.chunks_exact(4).enumerate().filter(|(_, pixel)| pixel[0] > 9).map(|(x, _)| x).collect()
    };
    assert_eq!(lit(&all).len(), 160);
    // Two lamps to a pixel's width: lamp 163 of 320 has no pixel, or the whole of one.
    assert!(lit(&driver.picture()).len() <= 1);
    driver.click_with(driver.find("row 17/3, on").center(), Modifiers::ALT);
    driver.settle();
    assert!(driver.picture() == all);
    driver.key(Key::P, CTRL);
    driver.key(Key::A, CTRL);
    driver.key(Key::Backspace, Modifiers::NONE);
    driver.key(Key::Enter, Modifiers::NONE);
    driver.settle();
    let sees_row_17 = |driver: &Driver| driver.widgets().iter().any(|(name, _)| name.starts_with("row 17/"));
    assert!(!sees_row_17(&driver), "so many groups are folded");
    let picture = driver.find("picture");
    driver.click(picture.center() + vec2(5.0, 0.0));
    driver.settle();
    assert!(sees_row_17(&driver), "its group has opened");
    driver.key(Key::X, Modifiers::NONE);
    driver.settle();
    assert_eq!(lit(&driver.picture()).len(), 159, "the light that matters there was selected and switched off");
}

/// A snapshot is compared with, and recalled by its own button.
fn a_snapshot_is_compared_with_and_recalled() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    driver.click(driver.find("ceiling, on").center());
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    assert!(driver.picture() != before && driver.texture("compared") == before);
    driver.click(driver.find("Recall").center());
    driver.settle();
    assert!(driver.picture() == before);
}

/// Tab reaches the fader, arrows move it.
fn the_keyboard_alone_moves_a_fader() {
    let mut driver = Driver::open(room());
    let before = driver.picture();
    for _ in 0..80 {
        driver.key(Key::Tab, Modifiers::NONE);
        driver.frame(Vec::new());
        if driver.focused() == Some("ceiling, stops") {
            break;
        }
    }
    assert_eq!(driver.focused(), Some("ceiling, stops"));
    driver.key(Key::ArrowLeft, Modifiers::NONE);
    driver.settle();
    assert!(driver.picture() != before);
}

/// The first picture is there before the whole container is, and the last is that of all its layers.
fn a_picture_streams_in_and_ends_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 40);
    let session = Session::open(&path, Means { device: None, budget_bytes: u64::MAX }, Arc::new(|| ())).unwrap();
    let lighting = Arc::new(Lighting::of_scene(session.basis()));
    session.worker.request(request(1, &lighting));
    let picture = whole_picture(&session);
    let whole = CpuRelighter::load(&*session.container).unwrap().relight(&lighting).unwrap();
    assert_eq!(*values(&session, &picture), whole);
}

fn request(generation: u64, lighting: &Arc<Lighting>) -> Request {
    let (display, looked_at) = (Display::default(), [0.0; 2]);
    Request { generation, lighting: lighting.clone(), display, compared: None, looked_at }
}

/// What is found in the first event of a worker that has it; events before it are lost.
fn await_event<T>(session: &Session, what: &str, mut find: impl FnMut(Event) -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(found) = session.worker.events().find_map(&mut find) {
            return found;
        }
        assert!(begun.elapsed() < PATIENCE, "{what} does not come");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The picture in which all layers are; those before it have ever more of them.
fn whole_picture(session: &Session) -> Picture {
    let mut last: Option<Picture> = None;
    await_event(session, "the whole picture", |event| {
        let Event::Picture(picture) = event else { return None };
        if let Some(before) = last.as_ref().filter(|before| before.generation == picture.generation) {
            let (before, now) = (before.progress, picture.progress);
            assert!(now.base >= before.base && now.whole >= before.whole, "{before:?}, {now:?}");
        }
        if picture.progress.is_complete() {
            return Some(*picture);
        }
        last = Some(*picture);
        None
    })
}

/// The linear values of a picture, which come later where a device shows it.
fn values(session: &Session, picture: &Picture) -> Arc<LinearImage> {
    if let Seen::Bytes(_, image) = &picture.seen {
        return image.clone();
    }
    let (image, histogram) = values_of(session, picture.generation);
    assert_eq!(histogram, Display::default().histogram(&image));
    image
}

/// The values of the picture of a generation, and their histogram.
fn values_of(session: &Session, wanted: u64) -> (Arc<LinearImage>, Vec<[f32; 3]>) {
    await_event(session, "the picture's values", |event| match event {
        Event::Values { generation, image, histogram } if generation == wanted => Some((image, histogram)),
        _ => None,
    })
}

/// A container larger than its budget is shown all the same: with the same values, and within the budget. What is held is
/// read once, the rest again for each lighting.
fn a_container_larger_than_its_budget_is_shown_within_it() {
    let reader = ContainerReader::open(room()).unwrap();
    let whole = CpuRelighter::load(&reader).unwrap();
    let budget_bytes = whole.factor_bytes() / 2;
    let session = Session::open(room(), Means { device: None, budget_bytes }, Arc::new(|| ())).unwrap();
    let scene = Lighting::of_scene(session.basis());
    let half = Lighting::new(scene.weights().iter().map(|weight| weight.map(|v| v / 2.0)).collect()).unwrap();
    let read = || session.worker.meter().bytes_read.load(Ordering::Relaxed);
    let mut bytes = Vec::new();
    for (generation, lighting) in [(1, &scene), (2, &half), (3, &scene)] {
        let lighting = Arc::new(lighting.clone());
        session.worker.request(request(generation, &lighting));
        let picture = whole_picture(&session);
        assert_eq!(picture.generation, generation);
        assert_eq!(*values(&session, &picture), whole.relight(&lighting).unwrap());
        let resident = session.worker.meter().resident_bytes.load(Ordering::Relaxed);
        assert!(resident <= budget_bytes && resident > budget_bytes / 3, "{resident} of {budget_bytes}");
        bytes.push(read());
    }
    let file: u64 = session.container.file_bytes();
    assert!(bytes[0] >= file / 2 && bytes[1] - bytes[0] < bytes[0], "{bytes:?} of {file}");
    assert_eq!(bytes[2] - bytes[1], bytes[1] - bytes[0], "the same blocks pass through for each lighting");
}

/// What the lights bring to a pixel is that of the picture that was asked for last, not of the first.
fn a_pixel_is_asked_under_the_newest_lighting() {
    let session = Session::open(room(), Means { device: None, budget_bytes: u64::MAX }, Arc::new(|| ())).unwrap();
    let scene = Lighting::of_scene(session.basis());
    let dark = Lighting::new(vec![[0.0; 3]; scene.weights().len()]).unwrap();
    for (generation, lighting, shines) in [(1, scene.clone(), true), (2, dark, false), (3, scene, true)] {
        session.worker.request(request(generation, &Arc::new(lighting)));
        while whole_picture(&session).generation < generation {}
        session.worker.ask_pixel([40, 30]);
        let lights = await_event(&session, "the pixel", |event| match event {
            Event::Pixel { lights, .. } => Some(lights),
            _ => None,
        });
        assert_eq!(lights.iter().any(|v| *v > 0.0), shines, "{lights:?}");
    }
}

/// What is no container is told in the window, in one line.
fn a_file_that_is_no_container_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.ltc");
    std::fs::write(&path, [7; 500]).unwrap();
    let mut driver = Driver::open(&path);
    driver.settle();
    driver.find_containing("noise.ltc: is not a container");
}

fn main() -> ExitCode {
    if let Some(code) = real::act_as_program() {
        return code;
    }
    let arguments = Arguments::from_args();
    let tests: [(&str, fn()); 16] = [
        ("a_fader_drag_relights_and_is_one_undo", a_fader_drag_relights_and_is_one_undo),
        ("a_switch_turns_the_light_off_and_on", a_switch_turns_the_light_off_and_on),
        (
            "pictures_come_during_a_drag_and_the_last_is_that_of_its_end",
            pictures_come_during_a_drag_and_the_last_is_that_of_its_end,
        ),
        ("keys_expose_and_help_lists_them", keys_expose_and_help_lists_them),
        ("painting_on_the_light_changes_the_room", painting_on_the_light_changes_the_room),
        ("a_shape_is_laid_dragged_and_scaled", a_shape_is_laid_dragged_and_scaled),
        ("a_lighting_is_saved_and_loaded", a_lighting_is_saved_and_loaded),
        ("the_copied_command_makes_the_picture", the_copied_command_makes_the_picture),
        ("layers_add_up_to_the_picture", layers_add_up_to_the_picture),
        ("hundreds_of_lights_are_searched_soloed_and_picked", hundreds_of_lights_are_searched_soloed_and_picked),
        ("a_snapshot_is_compared_with_and_recalled", a_snapshot_is_compared_with_and_recalled),
        ("the_keyboard_alone_moves_a_fader", the_keyboard_alone_moves_a_fader),
        ("a_picture_streams_in_and_ends_whole", a_picture_streams_in_and_ends_whole),
        (
            "a_container_larger_than_its_budget_is_shown_within_it",
            a_container_larger_than_its_budget_is_shown_within_it,
        ),
        ("a_pixel_is_asked_under_the_newest_lighting", a_pixel_is_asked_under_the_newest_lighting),
        ("a_file_that_is_no_container_is_told", a_file_that_is_no_container_is_told),
    ];
    let trial = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let mut trials: Vec<Trial> = tests
        .into_iter()
        .chain(controls::TESTS)
        .chain(kept::TESTS)
        .chain(groups::TESTS)
        .chain(measures::TESTS)
        .chain(panoramas::TESTS)
        .chain(rendering::TESTS)
        .chain(tabs::TESTS)
        .map(|(name, test)| trial(name, test))
        .collect();
    let without = !real::is_possible();
    for (name, test) in real::TESTS {
        trials.push(trial(name, test).with_ignored_flag(without));
    }
    let has_adapter = real::has_adapter();
    for (name, test) in device::TESTS {
        trials.push(trial(name, test).with_ignored_flag(!has_adapter));
    }
    let driven =
        trial("a_real_window_is_driven_by_pointer_and_keys", real::a_real_window_is_driven_by_pointer_and_keys);
    trials.push(driven.with_ignored_flag(without || !real::has_hands()));
    let killed = trial("a_killed_window_loses_no_work", real::a_killed_window_loses_no_work);
    trials.push(killed.with_ignored_flag(without || !real::has_hands()));
    for (name, test) in rendering::REAL.into_iter().chain(tabs::REAL) {
        trials.push(trial(name, test).with_ignored_flag(without || !real::has_hands()));
    }
    let undesktopped =
        trial("a_desktop_without_dialogues_is_done_without", real::a_desktop_without_dialogues_is_done_without);
    trials.push(undesktopped.with_ignored_flag(without || !real::has_hands()));
    let video = trial("an_animation_is_written_as_a_video", measures::an_animation_is_written_as_a_video);
    trials.push(video.with_ignored_flag(!measures::has_encoder()));
    libtest_mimic::run(&arguments, trials).exit_code()
}
