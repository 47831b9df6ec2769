//! No work is lost: questions, autosave and recovery, reload, commands that write.

use std::fs;
use std::path::{Path, PathBuf};

use eframe::egui::{Key, Modifiers, vec2};
use ltm_view::WindowOptions;

use super::driver::Driver;
use super::{CTRL, container, room};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 8] = [
    ("closing_asks_while_work_is_not_saved", closing_asks_while_work_is_not_saved),
    ("what_would_replace_the_mix_asks_first", what_would_replace_the_mix_asks_first),
    ("a_copied_command_writes_a_look_of_its_own", a_copied_command_writes_a_look_of_its_own),
    ("reload_keeps_the_mix_and_its_undo", reload_keeps_the_mix_and_its_undo),
    ("a_file_changed_on_disk_is_noticed", a_file_changed_on_disk_is_noticed),
    ("work_of_a_window_that_ended_by_force_is_recovered", work_of_a_window_that_ended_by_force_is_recovered),
    ("saved_or_discarded_work_is_not_offered_again", saved_or_discarded_work_is_not_offered_again),
    ("a_loaded_look_is_one_step", a_loaded_look_is_one_step),
];

fn dim(driver: &mut Driver) -> Vec<u8> {
    dim_by(driver, 12.0)
}

/// Takes the fader to a place left of its middle, in points.
fn dim_by(driver: &mut Driver, points: f32) -> Vec<u8> {
    let fader = driver.find("ceiling, stops").center();
    driver.drag(fader, fader - vec2(points, 0.0), 3);
    driver.settle();
    driver.picture()
}

fn says(driver: &mut Driver, button: &str) {
    driver.click(driver.find(button).center());
    driver.settle();
}

fn save_as(driver: &mut Driver, look: &Path) {
    driver.key(Key::K, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
}

fn closing_asks_while_work_is_not_saved() {
    let folder = tempfile::tempdir().unwrap();
    let mut driver = Driver::open(room());
    assert_eq!(driver.title(), "view-room.ltc – ltm");
    dim(&mut driver);
    assert_eq!(driver.title(), "● view-room.ltc – ltm");
    driver.find("• Not saved");
    assert!(!driver.close());
    driver.find_containing("Save your mix before closing?");
    driver.key(Key::Escape, Modifiers::NONE);
    driver.settle();
    assert!(!driver.is_closed() && !driver.has("Discard"));
    // Without a file it asks for one, and giving up there keeps the window.
    assert!(!driver.close());
    says(&mut driver, "Save");
    says(&mut driver, "Cancel");
    assert!(!driver.is_closed());
    let look = folder.path().join("dim.toml");
    driver.key(Key::Q, CTRL);
    driver.settle();
    says(&mut driver, "Save");
    driver.enter(look.to_str().unwrap());
    driver.settle();
    assert!(driver.is_closed() && fs::read_to_string(&look).unwrap().contains("stops = -"));
    // Nothing to lose, nothing to ask; and a mix that was taken back is nothing to lose.
    assert!(Driver::open(room()).close());
    let mut driver = Driver::open(room());
    dim(&mut driver);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(!driver.title().contains('●') && driver.close());
    let mut driver = Driver::open(room());
    dim(&mut driver);
    assert!(!driver.close());
    says(&mut driver, "Discard");
    assert!(driver.is_closed());
}

fn what_would_replace_the_mix_asks_first() {
    let folder = tempfile::tempdir().unwrap();
    let [stage, look] = ["stage.ltc", "l.toml"].map(|name| folder.path().join(name));
    container::write_stage(&stage, 3);
    fs::write(&look, "[[light]]\nname = \"ceiling\"\nstops = -2.0\n").unwrap();
    let mut driver = Driver::open(room());
    let dimmed = dim(&mut driver);
    let picture = driver.find("picture").center();
    for (file, question) in [(&stage, "opening another container"), (&look, "loading another look")] {
        driver.drop_file(file, picture);
        driver.settle();
        driver.find_containing(question);
        says(&mut driver, "Cancel");
        assert!(driver.picture() == dimmed && driver.has("ceiling, stops"));
    }
    for (key, file) in [(Key::L, &look), (Key::O, &stage)] {
        driver.key(key, CTRL);
        driver.settle();
        driver.enter(file.to_str().unwrap());
        driver.settle();
        says(&mut driver, "Cancel");
        assert!(driver.picture() == dimmed);
    }
    // Saved first, then opened.
    let own = folder.path().join("own.toml");
    driver.drop_file(&stage, picture);
    driver.settle();
    says(&mut driver, "Save");
    driver.enter(own.to_str().unwrap());
    driver.settle();
    assert!(own.is_file() && driver.has("row 1/2, on"));
}

fn a_copied_command_writes_a_look_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let container = folder.path().join("room.ltc");
    fs::copy(room(), &container).unwrap();
    let mut driver = Driver::open(&container);
    dim(&mut driver);
    let look = folder.path().join("room.toml");
    save_as(&mut driver, &look);
    let saved = fs::read(&look).unwrap();
    let copy = |driver: &mut Driver| {
        driver.key(Key::C, CTRL.plus(Modifiers::SHIFT));
        driver.settle();
        driver.copied().unwrap().to_owned()
    };
    assert!(copy(&mut driver).contains("room.toml"), "what stands in a file is not written again");
    dim_by(&mut driver, 20.0);
    let line = copy(&mut driver);
    driver.find_containing("Wrote room-command1.toml and copied:");
    assert!(line.contains("room-command1.toml") && folder.path().join("room-command1.toml").is_file());
    assert_eq!(copy(&mut driver), line, "the same mix, the same file");
    let first = fs::read(folder.path().join("room-command1.toml")).unwrap();
    dim_by(&mut driver, 25.0);
    assert!(copy(&mut driver).contains("room-command2.toml"));
    assert_eq!(
        fs::read(folder.path().join("room-command1.toml")).unwrap(),
        first,
        "an older command means what it meant"
    );
    assert_eq!(fs::read(&look).unwrap(), saved);
    assert!(driver.title().contains('●'), "a command is no saving");
}

fn reload_keeps_the_mix_and_its_undo() {
    let mut driver = Driver::open(room());
    let scene = driver.picture();
    let dimmed = dim(&mut driver);
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    for _ in 0..2 {
        driver.key(Key::F5, Modifiers::NONE);
        driver.settle();
        assert!(driver.picture() == dimmed && driver.title().contains('●'));
    }
    driver.find("Snapshot 1");
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == scene);
    driver.click(driver.find("Recall").center());
    driver.settle();
    assert!(driver.picture() == dimmed);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == scene);
}

fn a_file_changed_on_disk_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let [container, other] = ["room.ltc", "new.ltc"].map(|name| folder.path().join(name));
    fs::copy(room(), &container).unwrap();
    fs::copy(room(), &other).unwrap();
    let mut driver = Driver::open(&container);
    let dimmed = dim(&mut driver);
    fs::rename(&other, &container).unwrap();
    driver.wait_until("the notice", |driver| driver.has("Reload and keep my mix"));
    says(&mut driver, "Reload and keep my mix");
    assert!(driver.picture() == dimmed && !driver.has("Reload and keep my mix"));
    fs::remove_file(&container).unwrap();
    driver.wait_until("the notice", |driver| {
        driver.widgets().iter().any(|(name, _)| name.contains("room.ltc is no longer on disk"))
    });
    driver.key(Key::R, CTRL);
    driver.settle();
    driver.find_containing("cannot be reloaded");
    assert!(driver.picture() == dimmed && driver.has("ceiling, stops"));
}

fn with_state(folder: &Path) -> WindowOptions {
    let state_folder = Some(folder.join("state"));
    WindowOptions { path: Some(room().to_owned()), state_folder, ..Default::default() }
}

/// Lighting files of unsaved work.
fn unsaved(folder: &Path) -> Vec<PathBuf> {
    let folders = fs::read_dir(folder.join("state/unsaved")).into_iter().flatten();
    folders.map(|entry| entry.unwrap().path().join("work.toml")).filter(|look| look.is_file()).collect()
}

fn work_of_a_window_that_ended_by_force_is_recovered() {
    let folder = tempfile::tempdir().unwrap();
    let size = vec2(1280.0, 800.0);
    let mut driver = Driver::open_with(with_state(folder.path()), size);
    let scene = driver.picture();
    driver.click(driver.find("Black").center());
    let texture = driver.find("texture").center();
    driver.drag(texture - vec2(30.0, 0.0), texture, 4);
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    let painted = driver.picture();
    driver.wait_until("autosave", |_| !unsaved(folder.path()).is_empty());
    // What it wrote while it lived is offered to no other window.
    assert!(!Driver::open_with(with_state(folder.path()), size).has("Recover"));
    // Gone without a word, as after a signal that nothing can catch: its lock is all that the system takes back.
    drop(driver);
    let mut driver = Driver::open_with(with_state(folder.path()), size);
    driver.find_containing("before its mix was saved");
    says(&mut driver, "Later");
    assert!(driver.picture() == scene);
    drop(driver);
    let mut driver = Driver::open_with(with_state(folder.path()), size);
    says(&mut driver, "Recover");
    assert!(driver.picture() == painted && driver.title().contains('●'));
    driver.find("Snapshot 1");
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == scene, "recovery is one step");
    driver.key(Key::Z, CTRL.plus(Modifiers::SHIFT));
    driver.settle();
    driver.wait_until("the work in one place", |_| unsaved(folder.path()).len() == 1);
    assert!(!driver.close());
    says(&mut driver, "Discard");
    assert!(unsaved(folder.path()).is_empty());
}

fn saved_or_discarded_work_is_not_offered_again() {
    let folder = tempfile::tempdir().unwrap();
    let size = vec2(1280.0, 800.0);
    let mut driver = Driver::open_with(with_state(folder.path()), size);
    dim(&mut driver);
    driver.wait_until("autosave", |_| !unsaved(folder.path()).is_empty());
    save_as(&mut driver, &folder.path().join("saved.toml"));
    driver.wait_until("an end of it", |_| unsaved(folder.path()).is_empty());
    dim_by(&mut driver, 20.0);
    driver.wait_until("autosave", |_| !unsaved(folder.path()).is_empty());
    drop(driver);
    let mut driver = Driver::open_with(with_state(folder.path()), size);
    says(&mut driver, "Discard");
    assert!(unsaved(folder.path()).is_empty());
    assert!(!Driver::open_with(with_state(folder.path()), size).has("Recover"));
}

fn a_loaded_look_is_one_step() {
    let folder = tempfile::tempdir().unwrap();
    let look = folder.path().join("l.toml");
    fs::write(&look, "[[light]]\nname = \"ceiling\"\nstops = -2.0\n[[look]]\nname = \"half\"\n[[look.light]]\nname = \"*\"\nstops = 1.0\n")
        .unwrap();
    let mut driver = Driver::open(room());
    let dimmed = dim(&mut driver);
    driver.drop_file(&look, driver.find("picture").center());
    driver.settle();
    says(&mut driver, "Discard");
    let loaded = driver.picture();
    assert!(loaded != dimmed && !driver.title().contains('●'));
    driver.find("l.toml");
    // Its further look is a snapshot, whose picture is made when it is needed.
    driver.find("half");
    driver.click(driver.find("Compare").center());
    driver.settle();
    let sum = |bytes: &[u8]| bytes.iter().map(|&byte| u64::from(byte)).sum::<u64>();
    assert!(sum(&driver.texture("compared")) > sum(&loaded));
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == dimmed && driver.title().contains('●'));
}
