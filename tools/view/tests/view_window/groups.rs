//! Groups of one's own, several lights at once, and one meaning of solo.

use eframe::egui::{Key, Modifiers, Pos2, vec2};

use super::driver::Driver;
use super::{CTRL, container};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 6] = [
    ("the_whole_row_selects_and_several_rows_make_a_group", the_whole_row_selects_and_several_rows_make_a_group),
    ("a_group_dims_switches_and_solos_its_lights", a_group_dims_switches_and_solos_its_lights),
    ("a_light_that_is_off_shines_when_soloed", a_light_that_is_off_shines_when_soloed),
    ("lights_selected_together_are_dimmed_together", lights_selected_together_are_dimmed_together),
    ("settings_are_copied_and_pasted_by_the_menu", settings_are_copied_and_pasted_by_the_menu),
    ("groups_travel_in_the_look", groups_travel_in_the_look),
];

/// Six lamps, each over a sixth of the picture; no groups by name, as all ten of a row would be one.
fn stage(count: usize) -> (tempfile::TempDir, Driver) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, count);
    let driver = Driver::open(&path);
    (folder, driver)
}

/// The strips of the stage that are lit, by their numbers from 1.
fn lit(driver: &Driver, count: usize) -> Vec<usize> {
    let width = container::STAGE[0] as usize;
    let picture = driver.picture();
    (1..=count).filter(|lamp| picture[(width * (2 * lamp - 1) / (2 * count)) * 4] > 9).collect()
}

/// A place on a row beside all of its controls: on the gap before the fader.
fn row(driver: &Driver, lamp: usize) -> Pos2 {
    driver.find(&format!("row 1/{lamp}, stops")).left_center() - vec2(4.0, 0.0)
}

fn press_switch(driver: &mut Driver, name: &str, modifiers: Modifiers) {
    driver.click_with(driver.find(name).center(), modifiers);
    driver.settle();
}

fn make_group(driver: &mut Driver, lamps: [usize; 2], name: &str) {
    driver.click(row(driver, lamps[0]));
    driver.click_with(row(driver, lamps[1]), CTRL);
    driver.key(Key::G, CTRL);
    driver.settle();
    driver.enter(name);
    driver.settle();
}

fn the_whole_row_selects_and_several_rows_make_a_group() {
    let (_folder, mut driver) = stage(6);
    driver.click(row(&driver, 4));
    driver.key(Key::X, Modifiers::NONE);
    driver.settle();
    assert_eq!(lit(&driver, 6), [1, 2, 3, 5, 6], "a click far from the name selects");
    driver.key(Key::X, Modifiers::NONE);
    driver.click_with(row(&driver, 2), Modifiers::SHIFT);
    driver.settle();
    driver.find("3 selected");
    driver.key(Key::X, Modifiers::NONE);
    driver.settle();
    assert_eq!(lit(&driver, 6), [1, 5, 6], "from 4 to 2");
    driver.key(Key::Z, CTRL);
    driver.drag(row(&driver, 5), row(&driver, 6), 6);
    driver.settle();
    driver.find("2 selected");
    make_group(&mut driver, [1, 3], "Counter");
    driver.find("group Counter");
    driver.key(Key::A, CTRL);
    driver.settle();
    driver.find("6 selected");
    driver.key(Key::Z, CTRL);
    driver.settle();
    // The name is a step of its own; before it the group is called what it was made as.
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(!driver.has("group Counter"));
}

fn a_group_dims_switches_and_solos_its_lights() {
    let (_folder, mut driver) = stage(6);
    make_group(&mut driver, [1, 3], "Pair");
    let before = driver.picture();
    let fader = driver.find("Pair, stops").center();
    driver.drag(fader, fader - vec2(40.0, 0.0), 4);
    driver.settle();
    let width = container::STAGE[0] as usize;
    let value = |picture: &[u8], lamp: usize| picture[(width * (2 * lamp - 1) / 12) * 4];
    for lamp in 1..=6 {
        let darker = value(&driver.picture(), lamp) < value(&before, lamp);
        assert_eq!(darker, [1, 3].contains(&lamp), "lamp {lamp}");
    }
    driver.key(Key::Z, CTRL);
    press_switch(&mut driver, "Pair, on", Modifiers::NONE);
    assert_eq!(lit(&driver, 6), [2, 4, 5, 6]);
    press_switch(&mut driver, "Pair, solo", Modifiers::NONE);
    assert_eq!(lit(&driver, 6), [1, 3], "a soloed group shines though it is off");
    driver.click(driver.find("Solo off").center());
    driver.settle();
    assert_eq!(lit(&driver, 6), [2, 4, 5, 6]);
    driver.click(driver.find("All off").center());
    driver.settle();
    assert!(lit(&driver, 6).is_empty());
    driver.click(driver.find("All on").center());
    driver.settle();
    assert_eq!(lit(&driver, 6), [1, 2, 3, 4, 5, 6]);
}

fn a_light_that_is_off_shines_when_soloed() {
    let (_folder, mut driver) = stage(6);
    driver.click(row(&driver, 2));
    driver.key(Key::X, Modifiers::NONE);
    driver.key(Key::X, Modifiers::SHIFT);
    driver.settle();
    assert_eq!(lit(&driver, 6), [2]);
    driver.key(Key::X, Modifiers::SHIFT);
    driver.settle();
    assert_eq!(lit(&driver, 6), [1, 3, 4, 5, 6], "and is off again after it");
    press_switch(&mut driver, "row 1/2, on", CTRL);
    assert_eq!(lit(&driver, 6), [2], "as by its switch with Ctrl");
    press_switch(&mut driver, "row 1/4, solo", Modifiers::SHIFT);
    assert_eq!(lit(&driver, 6), [2, 4]);
}

fn lights_selected_together_are_dimmed_together() {
    let (_folder, mut driver) = stage(6);
    driver.click(row(&driver, 2));
    driver.click_with(row(&driver, 5), CTRL);
    let fader = driver.find("row 1/5, stops").center();
    driver.drag(fader, fader - vec2(70.0, 0.0), 4);
    driver.settle();
    let width = container::STAGE[0] as usize;
    let value = |driver: &Driver, lamp: usize| driver.picture()[(width * (2 * lamp - 1) / 12) * 4];
    assert_eq!(value(&driver, 2), value(&driver, 5));
    assert!(value(&driver, 2) < value(&driver, 1));
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert_eq!(value(&driver, 2), value(&driver, 1), "one step");
}

fn settings_are_copied_and_pasted_by_the_menu() {
    let (_folder, mut driver) = stage(6);
    let fader = driver.find("row 1/1, stops").center();
    driver.drag(fader, fader - vec2(70.0, 0.0), 4);
    driver.settle();
    driver.right_click(row(&driver, 1));
    driver.settle();
    driver.click(driver.find("Copy settings").center());
    driver.settle();
    driver.click(row(&driver, 3));
    driver.click_with(row(&driver, 4), CTRL);
    driver.right_click(row(&driver, 4));
    driver.settle();
    driver.click(driver.find("Paste settings").center());
    driver.settle();
    let width = container::STAGE[0] as usize;
    let values: Vec<u8> = (1..=6).map(|lamp| driver.picture()[(width * (2 * lamp - 1) / 12) * 4]).collect();
    assert!(values[0] == values[2] && values[0] == values[3] && values[0] < values[1] && values[1] == values[5]);
}

fn groups_travel_in_the_look() {
    let (folder, mut driver) = stage(6);
    make_group(&mut driver, [1, 3], "Pair");
    press_switch(&mut driver, "Pair, on", Modifiers::NONE);
    let look = folder.path().join("pair.toml");
    driver.key(Key::K, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
    let text = std::fs::read_to_string(&look).unwrap();
    assert!(text.contains("[groups]") && text.contains("Pair = [\"row 1/1\", \"row 1/3\"]"), "{text}");
    let mut again = Driver::open(&folder.path().join("stage.ltc"));
    assert!(!again.has("Pair, on"));
    again.drop_file(&look, again.find("picture").center());
    again.settle();
    assert_eq!(lit(&again, 6), [2, 4, 5, 6]);
    press_switch(&mut again, "Pair, on", Modifiers::NONE);
    assert_eq!(lit(&again, 6), [1, 2, 3, 4, 5, 6]);
}
