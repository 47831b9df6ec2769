//! Looking around in panoramas.

use std::path::Path;

use eframe::egui::{Key, Modifiers, Rect, TextureOptions, vec2};
use ltm::scene::{BuiltIn, Projection};
use ltm_view::panorama::LookAround;

use super::controls::pixel_at;
use super::driver::Driver;
use super::{CTRL, container, room};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 3] = [
    ("a_panorama_is_looked_around_in_and_read_where_it_is_seen", a_panorama_is_looked_around_in),
    ("lights_are_selected_and_compared_in_a_panorama", lights_are_selected_and_compared_in_a_panorama),
    ("looking_around_is_offered_where_the_picture_may_be_a_panorama", looking_around_is_offered),
];

/// The panorama of a room.
const SIZE: [u32; 2] = [192, 96];

/// Writes its container.
pub(crate) fn write_panorama(path: &Path) {
    let mut loaded = BuiltIn { width: SIZE[0], height: SIZE[1], texels: 6 }.named("mixed").unwrap();
    loaded.scene.camera = loaded.scene.camera.projected(Projection::Panorama).unwrap();
    container::write(path, loaded, 8);
}

/// What the probe says of a pixel.
fn said([x, y]: [u32; 2]) -> String {
    format!("{x}, {y}")
}

/// The pixel that is seen some points beside the middle.
fn seen(look: LookAround, view: Rect, offset: [f32; 2]) -> [u32; 2] {
    look.sight(view.size().into(), SIZE).pixel_at(offset)
}

fn a_panorama_is_looked_around_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("around.ltc");
    write_panorama(&path);
    let mut driver = Driver::open(&path);
    let (view, flat) = (driver.find("picture"), driver.picture());
    let middle = view.center();
    assert!(driver.says("80° wide") && driver.sampled() == TextureOptions::LINEAR_REPEAT);
    // A point right of and below the middle of the panorama.
    assert_eq!(pixel_at(&mut driver, middle + vec2(1.0, 1.0)), "96, 48");
    let mut look = LookAround::default();
    for offset in [vec2(-200.0, 120.0), vec2(250.0, -150.0)] {
        assert_eq!(pixel_at(&mut driver, middle + offset), said(seen(look, view, offset.into())), "{offset}");
    }
    // Half a turn by keys: what lies behind is both edges of the panorama.
    (0..27).for_each(|_| driver.key(Key::ArrowRight, CTRL));
    driver.settle();
    assert_eq!(pixel_at(&mut driver, middle + vec2(3.0, 3.0)), "0, 48");
    assert_eq!(pixel_at(&mut driver, middle + vec2(-3.0, 3.0)), "191, 48");
    // What is clicked is what is seen.
    driver.click(middle + vec2(-3.0, 3.0));
    driver.settle();
    assert!(driver.says("LIGHT AT 191, 48"), "{:?}", driver.widgets());
    assert!(driver.picture() == flat, "the picture itself stays");
    // Ahead again; then what is taken hold of in the middle goes with the pointer.
    driver.key(Key::F, Modifiers::NONE);
    driver.drag(middle, middle + vec2(-60.0, 30.0), 6);
    look.drag([-60.0, 30.0], view.size().into());
    assert_eq!(pixel_at(&mut driver, middle + vec2(80.0, 60.0)), said(seen(look, view, [80.0, 60.0])));
    driver.scroll(middle, 1000.0);
    assert!(driver.says("30° wide"));
    driver.key(Key::Minus, Modifiers::NONE);
    driver.settle();
    assert!(!driver.says("30° wide"));
    // Up as far as it goes, by the keyboard alone.
    driver.key(Key::F, Modifiers::NONE);
    while driver.focused() != Some("picture") {
        driver.key(Key::Tab, Modifiers::NONE);
        driver.frame(Vec::new());
    }
    // A field for a number that the keyboard passes takes what it shows, rounded.
    driver.settle();
    let flat = driver.picture();
    (0..20).for_each(|_| driver.key(Key::ArrowUp, Modifiers::NONE));
    driver.key(Key::ArrowRight, Modifiers::SHIFT);
    assert_eq!(driver.focused(), Some("picture"));
    driver.settle();
    let above = pixel_at(&mut driver, middle + vec2(1.0, 2.0));
    assert!(above.ends_with(", 0"), "{above}");
    // Flat, pixels are squares, and it is fitted.
    driver.key(Key::P, Modifiers::NONE);
    driver.settle();
    assert!(!driver.says("° wide") && driver.sampled() != TextureOptions::LINEAR_REPEAT);
    let zoom = (view.width() - 24.0) / SIZE[0] as f32;
    assert_eq!(pixel_at(&mut driver, middle + vec2(10.5 * zoom, -20.5 * zoom)), "106, 27");
    assert!(driver.picture() == flat);
}

fn lights_are_selected_and_compared_in_a_panorama() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("around.ltc");
    write_panorama(&path);
    let mut driver = Driver::open(&path);
    let view = driver.find("picture");
    // All lights that are before the view, and none behind it.
    driver.drag_with(view.min + vec2(5.0, 5.0), view.max - vec2(5.0, 5.0), 6, Modifiers::SHIFT);
    driver.settle();
    assert!(driver.says("selected") || driver.says("No light"));
    driver.key(Key::K, Modifiers::NONE);
    driver.key(Key::E, Modifiers::NONE);
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    // The wipe stands in the view, not in the panorama: turning leaves it.
    let middle = view.center();
    driver.drag(middle, middle + vec2(100.0, 0.0), 6);
    assert_eq!(pixel_at(&mut driver, middle + vec2(1.0, 1.0)), "96, 48", "the wipe moves, not the picture");
    driver.key(Key::ArrowLeft, CTRL);
    driver.settle();
    let turned = pixel_at(&mut driver, middle + vec2(1.0, 1.0));
    driver.drag(middle + vec2(100.0, 0.0), middle - vec2(50.0, 0.0), 6);
    assert_eq!(pixel_at(&mut driver, middle + vec2(1.0, 1.0)), turned);
}

fn looking_around_is_offered() {
    // A picture of another camera is none, whatever its shape.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wide.ltc");
    container::write(&path, BuiltIn { width: 64, height: 32, texels: 4 }.named("diffuse").unwrap(), 2);
    for plain in [room(), &path] {
        let mut driver = Driver::open(plain);
        driver.key(Key::P, Modifiers::NONE);
        driver.settle();
        assert!(!driver.says("° wide") && !driver.has("Look around"), "{}", plain.display());
    }
    // Of one without a camera the shape decides: flat until it is asked for.
    let path = folder.path().join("strips.ltc");
    container::write_sized_lamps(&path, [160, 80], &["left", "right"]);
    let mut driver = Driver::open(&path);
    assert!(!driver.says("° wide"));
    driver.click(driver.find("Look around").center());
    driver.settle();
    assert!(driver.says("80° wide") && driver.sampled() == TextureOptions::LINEAR_REPEAT);
    let middle = driver.find("picture").center();
    driver.click(middle + vec2(20.0, 5.0));
    driver.settle();
    assert!(driver.says("LIGHT AT 81, "), "{:?}", driver.widgets());
}
