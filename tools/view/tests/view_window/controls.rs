//! The controls one by one, as hands use them.

use std::path::Path;

use eframe::egui::{Key, Modifiers, Pos2, pos2, vec2};
use ltm::image::{LinearImage, write_exr};
use ltm::scene::BuiltIn;
use ltm_view::WindowOptions;

use super::driver::Driver;
use super::{CTRL, container, room};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 11] = [
    ("windows_of_any_size_keep_picture_and_panels", windows_of_any_size_keep_picture_and_panels),
    ("a_fader_is_fine_with_shift_resets_and_takes_numbers", a_fader_is_fine_with_shift_resets_and_takes_numbers),
    ("kelvin_and_colour_change_the_light_and_scene_brings_it_back", kelvin_and_colour),
    ("dropped_files_do_what_the_hint_says", dropped_files_do_what_the_hint_says),
    ("the_wipe_is_dragged_and_the_picture_beside_it_panned", the_wipe_is_dragged_and_the_picture_beside_it_panned),
    ("the_wheel_zooms_and_keys_fit", the_wheel_zooms_and_keys_fit),
    ("an_environment_is_turned_by_dragging", an_environment_is_turned_by_dragging),
    ("lights_are_sorted_by_effect", lights_are_sorted_by_effect),
    ("recent_files_are_offered_again", recent_files_are_offered_again),
    ("clicks_of_one_slow_frame_are_all_taken", clicks_of_one_slow_frame_are_all_taken),
    ("a_click_before_the_first_frame_is_taken", a_click_before_the_first_frame_is_taken),
];

fn options(path: &Path) -> WindowOptions {
    WindowOptions { path: Some(path.to_owned()), ..Default::default() }
}

/// From the smallest window up, the picture is the largest thing in it, and every control of the panels can be reached
/// without one lying on another.
fn windows_of_any_size_keep_picture_and_panels() {
    // The last as on a display of twice the pixels.
    for (width, height, scale) in [
        (560.0, 360.0, 1.0),
        (560.0, 380.0, 1.0),
        (640.0, 400.0, 1.0),
        (800.0, 500.0, 1.0),
        (1024.0, 700.0, 1.0),
        (1280.0, 500.0, 1.0),
        (1280.0, 800.0, 1.0),
        (1440.0, 900.0, 1.0),
        (1920.0, 1080.0, 1.0),
        (960.0, 540.0, 2.0),
    ] {
        let size = vec2(width, height);
        let mut driver = Driver::open_scaled(options(room()), size, scale);
        assert_eq!(driver.pixels_per_point(), scale);
        let picture = driver.find("picture");
        assert!(picture.width() >= 0.42 * size.x && picture.height() >= 0.7 * size.y, "{size}: {picture}");
        assert!(driver.has("ceiling, stops"), "{size}");
        for (tab, controls) in [
            ("Lights", &["ceiling, on", "ceiling, stops", "Reset"][..]),
            ("Light", &["Kelvin", "Brush", "texture"]),
            ("View", &["Fit", "1:1", "False colour", "Auto"]),
        ] {
            if driver.has(tab) {
                driver.click(driver.find(tab).center());
                driver.settle();
            }
            let places: Vec<_> = controls.iter().map(|name| (name, driver.find(name))).collect();
            for (at, (name, place)) in places.iter().enumerate() {
                assert!(place.left() >= 0.0 && place.right() <= size.x, "{size}: {name} at {place}");
                assert!(place.intersect(driver.find("picture")).is_negative(), "{size}: {name} on the picture");
                for (other, beside) in &places[at + 1..] {
                    let overlap = place.shrink(1.0).intersect(*beside);
                    assert!(overlap.is_negative(), "{size}: {name} lies on {other}");
                }
            }
        }
    }
}

/// The place where a fader's stops stand as a number.
fn number(driver: &Driver, name: &str) -> Pos2 {
    driver.find(name).right_center() + vec2(29.0, 0.0)
}

fn a_fader_is_fine_with_shift_resets_and_takes_numbers() {
    let mut driver = Driver::open(room());
    let scene = driver.picture();
    let fader = driver.find("ceiling, stops");
    let middle = fader.center();
    let way = vec2(fader.width() / 8.0, 0.0);
    driver.drag_with(middle, middle + way, 8, Modifiers::SHIFT);
    driver.settle();
    let sum = |driver: &Driver| driver.picture().iter().map(|&byte| u64::from(byte)).sum::<u64>();
    let fine = sum(&driver);
    driver.double_click(middle);
    driver.settle();
    assert!(driver.picture() == scene, "a double click is back at 0");
    driver.drag(middle, middle + way, 8);
    driver.settle();
    let base: u64 = scene.iter().map(|&byte| u64::from(byte)).sum();
    assert!(base < fine && fine < sum(&driver), "shift goes less far");
    driver.click(number(&driver, "ceiling, stops"));
    driver.enter("-1");
    driver.settle();
    let typed = driver.picture();
    driver.key(Key::R, Modifiers::SHIFT);
    driver.settle();
    assert!(driver.picture() == scene && typed != scene);
    // The same stop by the arrows, a quarter at a time.
    while driver.focused() != Some("ceiling, stops") {
        driver.key(Key::Tab, Modifiers::NONE);
        driver.frame(Vec::new());
    }
    (0..4).for_each(|_| driver.key(Key::ArrowLeft, Modifiers::NONE));
    driver.settle();
    assert!(driver.picture() == typed);
}

fn kelvin_and_colour() {
    let mut driver = Driver::open(room());
    let mut seen = vec![driver.picture()];
    for way in ["Kelvin", "Colour", "Scene"] {
        driver.click(driver.find(way).center());
        driver.settle();
        seen.push(driver.picture());
    }
    assert!(seen[1] != seen[0] && seen[3] == seen[0]);
    // The colour begins as what the light has; nothing jumps.
    let apart = seen[2].iter().zip(&seen[1]).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart <= Some(1), "{apart:?}");
}

fn dropped_files_do_what_the_hint_says() {
    let folder = tempfile::tempdir().unwrap();
    let [image, reference, look, stage] =
        ["a.exr", "b.exr", "l.toml", "stage.ltc"].map(|name| folder.path().join(name));
    write_exr(&image, &LinearImage { width: 2, height: 1, pixels: vec![[1.0, 0.0, 0.0], [0.0; 3]] }).unwrap();
    write_exr(&reference, &LinearImage { width: 96, height: 72, pixels: vec![[0.5; 3]; 96 * 72] }).unwrap();
    std::fs::write(&look, "[[light]]\nname = \"ceiling\"\nstops = -2.0\n").unwrap();
    container::write_stage(&stage, 3);
    let mut driver = Driver::open(room());
    let scene = driver.picture();
    let (mixer, picture) = (driver.find("ceiling, stops").center(), driver.find("picture").center());
    driver.drop_file(&image, mixer);
    driver.settle();
    driver.find_containing("is on ceiling now");
    let red = driver.picture();
    assert!(red != scene);
    driver.drop_file(&reference, picture);
    driver.settle();
    driver.find_containing("Comparing with b.exr");
    assert!(driver.picture() == red && driver.texture("compared").chunks_exact(4).all(|pixel| pixel[0] == pixel[1]));
    driver.drop_file(&image, picture);
    driver.settle();
    driver.find_containing("choose an image of the picture's size");
    driver.drop_file(&look, picture);
    driver.settle();
    driver.click(driver.find("Discard").center());
    driver.settle();
    driver.find_containing("Loaded");
    assert!(driver.picture() != red && driver.picture() != scene);
    driver.drop_file(&stage, picture);
    driver.settle();
    assert!(driver.has("row 1/2, on"));
}

/// The pixel under the pointer, as the probe says it.
pub(crate) fn pixel_at(driver: &mut Driver, at: Pos2) -> String {
    driver.move_to(at);
    driver.frame(Vec::new());
    let is_pixel =
        |name: &str| name.split_once(", ").is_some_and(|(x, y)| x.parse::<u32>().is_ok() && y.parse::<u32>().is_ok());
    let found = driver.widgets().iter().find(|(name, _)| is_pixel(name));
    found.map_or_else(String::new, |(name, _)| name.clone())
}

fn the_wipe_is_dragged_and_the_picture_beside_it_panned() {
    let mut driver = Driver::open(room());
    driver.key(Key::K, Modifiers::NONE);
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    let middle = driver.find("picture").center();
    let before = pixel_at(&mut driver, middle);
    assert!(!before.is_empty());
    driver.drag(middle, middle + vec2(100.0, 0.0), 6);
    assert_eq!(pixel_at(&mut driver, middle), before, "the wipe moves, not the picture");
    driver.drag(middle, middle + vec2(60.0, 30.0), 6);
    assert_ne!(pixel_at(&mut driver, middle), before, "where it stood before is nothing to hold");
}

fn the_wheel_zooms_and_keys_fit() {
    let mut driver = Driver::open(room());
    let middle = driver.find("picture").center();
    let off = middle + vec2(80.0, -40.0);
    let percent = |driver: &Driver| {
        let found = driver.widgets().iter().find_map(|(name, _)| name.strip_suffix(" %")?.parse::<f32>().ok());
        found.unwrap()
    };
    let (fitted, pixel) = (percent(&driver), pixel_at(&mut driver, off));
    driver.scroll(off, 200.0);
    assert!(percent(&driver) > 1.5 * fitted);
    assert_eq!(pixel_at(&mut driver, off), pixel, "the pixel under the pointer stays");
    driver.key(Key::Num0, CTRL);
    driver.settle();
    assert_eq!(percent(&driver), 100.0);
    driver.key(Key::F, Modifiers::NONE);
    driver.settle();
    assert_eq!(percent(&driver), fitted);
    driver.double_click(pos2(middle.x, middle.y));
    assert_eq!(percent(&driver), fitted);
}

fn an_environment_is_turned_by_dragging() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.ltc");
    container::write(&path, BuiltIn { width: 64, height: 48, texels: 8 }.named("environment").unwrap(), 8);
    let mut driver = Driver::open(&path);
    // A painted spot, so that turning shows.
    let texture = driver.find("texture");
    driver.click(texture.center());
    driver.settle();
    let painted = driver.picture();
    driver.click(driver.find("Rotate").center());
    driver.drag(texture.center(), texture.center() + vec2(texture.width() / 4.0, 0.0), 10);
    driver.settle();
    assert!(driver.picture() != painted);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == painted, "one drag is one step");
}

fn lights_are_sorted_by_effect() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 5);
    let mut driver = Driver::open(&path);
    let fader = driver.find("row 1/4, stops").center();
    driver.drag(fader, fader + vec2(20.0, 0.0), 4);
    driver.settle();
    driver.click(driver.find("as in file").center());
    driver.settle();
    driver.click(driver.find("by effect").center());
    driver.settle();
    let top = |driver: &Driver, lamp: u32| driver.find(&format!("row 1/{lamp}, stops")).top();
    let others = [1, 2, 3, 5];
    assert!(others.iter().all(|&lamp| top(&driver, lamp) > top(&driver, 4)));
    // While it is dragged down, the light stays where it is, and no other takes its place under the pointer.
    let (before, fader) = (driver.picture(), driver.find("row 1/4, stops").center());
    driver.press(fader);
    for points in 1..=30 {
        driver.move_to(fader - vec2(points as f32, 0.0));
        driver.settle();
    }
    driver.release(fader - vec2(30.0, 0.0));
    driver.settle();
    assert!(others.iter().all(|&lamp| top(&driver, lamp) > top(&driver, 4)));
    let width = container::STAGE[0] as usize;
    let pairs = before.chunks_exact(4).zip(driver.picture().chunks_exact(4).map(<[u8]>::to_vec).collect::<Vec<_>>());
    let changed = |at: usize| at % width * 5 / width;
    let lamps: Vec<usize> = pairs.enumerate().filter(|(_, (a, b))| a != b).map(|(at, _)| changed(at) + 1).collect();
    assert!(!lamps.is_empty() && lamps.iter().all(|&lamp| lamp == 4));
    driver.move_to(driver.find("picture").center());
    driver.settle();
    assert!(others.iter().all(|&lamp| top(&driver, lamp) < top(&driver, 4)), "it has less effect than the others");
}

fn recent_files_are_offered_again() {
    let folder = tempfile::tempdir().unwrap();
    let stage = folder.path().join("stage.ltc");
    container::write_stage(&stage, 3);
    let state_folder = Some(folder.path().join("state"));
    for _ in 0..2 {
        let options = WindowOptions { state_folder: state_folder.clone(), ..options(&stage) };
        let mut driver = Driver::open_with(options, vec2(1280.0, 800.0));
        let picture = driver.find("picture").center();
        driver.drop_file(room(), picture);
        driver.settle();
        driver.click(driver.find("File").center());
        driver.settle();
        driver.click(driver.find("Open recent").center());
        driver.settle();
        let again = driver.widgets().iter().rfind(|(name, _)| name == "stage.ltc").unwrap().1;
        driver.click(again.center());
        driver.settle();
        assert!(driver.has("row 1/2, on"));
    }
}

/// Two clicks that come in one frame, as on a machine under load, do what they do in two: the first asks the picture, the
/// second selects a row.
fn clicks_of_one_slow_frame_are_all_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 8);
    let mut driver = Driver::open(&path);
    let all = driver.picture();
    let [first, second] = ["row 1/2, on", "row 1/5, on"].map(|name| driver.find(name).center());
    driver.clicks_in_one_frame(&[first, second]);
    driver.settle();
    let together = driver.picture();
    assert!(together != all);
    for at in [first, second] {
        driver.click(at);
        driver.settle();
        assert!(driver.picture() != together, "each of the two had switched its light");
    }
    assert!(driver.picture() == all);
}

/// What is pressed before the window is drawn reaches what is drawn there.
fn a_click_before_the_first_frame_is_taken() {
    let drawn = Driver::open(room());
    let (switch, lit) = (drawn.find("ceiling, on").center(), drawn.picture());
    let mut driver = Driver::open_unseen(room());
    driver.clicks_in_one_frame(&[switch]);
    driver.settle();
    assert!(driver.picture() != lit && driver.picture().chunks_exact(4).all(|pixel| pixel[..3] == [0; 3]));
}
