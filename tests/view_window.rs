//! The window: driven through egui without a display, and opened for real where a virtual display can be had.
//!
//! `cargo test --features view --test view_window`; the real window needs Xvfb and a Vulkan adapter (lavapipe does)
//! and is listed as ignored without Xvfb. `LTM_VIEW_PICTURES` names a folder to keep its screenshots in.

#[path = "view_window/container.rs"]
mod container;
#[path = "view_window/driver.rs"]
mod driver;
#[path = "view_window/real.rs"]
mod real;

use std::path::PathBuf;
use std::process::ExitCode;

use driver::Driver;
use eframe::egui::{Key, Modifiers, vec2};
use libtest_mimic::{Arguments, Trial};
use ltm::scene::BuiltIn;

/// Ctrl as the system sends it.
const CTRL: Modifiers = Modifiers::CTRL.plus(Modifiers::COMMAND);

fn room(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("room.ltc");
    let scene = BuiltIn { width: 96, height: 72, texels: 6 }.named("mixed").unwrap();
    container::write(&path, scene, 16);
    path
}

/// A drag on a fader changes the picture within a few frames, and one undo takes all of it back.
fn a_fader_drag_relights_and_is_one_undo() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(&room(&folder));
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
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(&room(&folder));
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
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(&room(&folder));
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
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(&room(&folder));
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
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(&room(&folder));
    let before = driver.picture();
    let dark = driver.find("Dark");
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
    let tests: [(&str, fn()); 6] = [
        ("a_fader_drag_relights_and_is_one_undo", a_fader_drag_relights_and_is_one_undo),
        ("a_switch_turns_the_light_off_and_on", a_switch_turns_the_light_off_and_on),
        (
            "pictures_come_during_a_drag_and_the_last_is_that_of_its_end",
            pictures_come_during_a_drag_and_the_last_is_that_of_its_end,
        ),
        ("keys_expose_and_help_lists_them", keys_expose_and_help_lists_them),
        ("painting_on_the_light_changes_the_room", painting_on_the_light_changes_the_room),
        ("a_file_that_is_no_container_is_told", a_file_that_is_no_container_is_told),
    ];
    let trial = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let mut trials: Vec<Trial> = tests.into_iter().map(|(name, test)| trial(name, test)).collect();
    let without = !real::has_xvfb();
    for (name, test) in real::TESTS {
        trials.push(trial(name, test).with_ignored_flag(without));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}
