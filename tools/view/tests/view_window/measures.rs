//! Numbers: what two pictures differ by, light in its units, measured areas, the sun.

use std::path::Path;

use eframe::egui::{Key, Modifiers, vec2};
use ltm::matrix::Feature;
use ltm::pipeline::{Features, PackOptions, RenderOptions, pack, render};
use ltm::resources::NoProgress;
use ltm::scene::BuiltIn;
use ltm::store::StoreReader;
use ltm_view::WindowOptions;

use super::driver::Driver;
use super::{CTRL, container, room};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 11] = [
    ("a_png_reference_is_shown_as_it_is", a_png_reference_is_shown_as_it_is),
    ("the_difference_is_measured_and_shown", the_difference_is_measured_and_shown),
    ("a_light_is_set_in_candela_per_square_metre", a_light_is_set_in_candela_per_square_metre),
    ("an_area_is_measured_in_lux_and_reported", an_area_is_measured_in_lux_and_reported),
    ("false_colour_with_a_legend_takes_the_place_of_the_picture", false_colour_takes_the_place_of_the_picture),
    ("albedo_normals_and_depth_take_the_place_of_the_picture", features_take_the_place_of_the_picture),
    ("the_sun_is_dragged_over_the_sky_and_put_by_date", the_sun_is_dragged_over_the_sky_and_put_by_date),
    ("the_sun_is_put_and_dragged_in_the_picture", the_sun_is_put_and_dragged_in_the_picture),
    ("a_band_in_the_picture_selects_lights", a_band_in_the_picture_selects_lights),
    ("reports_and_sheets_are_written_as_pdf", reports_and_sheets_are_written_as_pdf),
    ("an_animation_is_written_as_numbered_pictures", an_animation_is_written_as_numbered_pictures),
];

fn save(driver: &mut Driver, key: Key, path: &Path) {
    driver.key(key, CTRL);
    driver.settle();
    driver.enter(path.to_str().unwrap());
    driver.settle();
}

fn a_png_reference_is_shown_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let (png, exr) = (folder.path().join("own.png"), folder.path().join("own.exr"));
    let mut driver = Driver::open(room());
    driver.key(Key::E, Modifiers::NONE);
    driver.settle();
    save(&mut driver, Key::S, &png);
    save(&mut driver, Key::E, &exr);
    let own = driver.picture();
    let at = driver.find("picture").center();
    driver.drop_file(&png, at);
    driver.settle();
    driver.find_containing("shown as it is");
    // The file is encoded exactly, the window's picture by tables.
    let as_it_is = driver.texture("compared");
    let apart = as_it_is.iter().zip(&own).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart <= Some(1), "{apart:?}");
    // At another exposure the display's image stays, the radiance follows.
    driver.key(Key::E, Modifiers::NONE);
    driver.settle();
    assert!(driver.texture("compared") == as_it_is && driver.picture() != own);
    driver.drop_file(&exr, at);
    driver.settle();
    assert!(driver.texture("compared") == driver.picture());
    driver.find("Equal, pixel by pixel");
}

fn the_difference_is_measured_and_shown() {
    let mut driver = Driver::open(room());
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    driver.find("Equal, pixel by pixel");
    let fader = driver.find("ceiling, stops").center();
    driver.drag(fader, fader - vec2(6.0, 0.0), 3);
    driver.settle();
    let numbers = driver.widgets().iter().find_map(|(name, _)| name.strip_prefix("FLIP ")?.split_once("PSNR "));
    let (flip, psnr) = numbers.map(|(flip, psnr)| (flip.trim().to_owned(), psnr.to_owned())).unwrap();
    let (flip, psnr): (f32, f32) = (flip.parse().unwrap(), psnr.strip_suffix(" dB").unwrap().parse().unwrap());
    // Two thirds of a stop darker: plain to see, and far from black against white.
    assert!((0.02..0.6).contains(&flip) && (10.0..40.0).contains(&psnr), "{flip} {psnr}");
    let map = driver.texture("difference");
    assert!(map.chunks_exact(4).any(|pixel| pixel[0] > 30));
    driver.key(Key::D, Modifiers::NONE);
    driver.settle();
    driver.find("Difference");
    driver.key(Key::Z, CTRL);
    driver.settle();
    driver.find("Equal, pixel by pixel");
    assert!(driver.texture("difference") != map);
}

fn a_light_is_set_in_candela_per_square_metre() {
    let mut driver = Driver::open(room());
    let scene = driver.picture();
    let number = driver.find("cd/m²");
    driver.click(number.center());
    driver.settle();
    // The panel's own: 179 lm/W times the luminance of (12, 11, 9), at half.
    let own = 179.0 * (0.2126 * 12.0 + 0.7152 * 11.0 + 0.0722 * 9.0);
    driver.enter(&format!("{}", own / 2.0));
    driver.settle();
    let half = driver.picture();
    assert!(half != scene);
    driver.click(driver.find("ceiling, stops").right_center() + vec2(29.0, 0.0));
    driver.settle();
    driver.enter("-1");
    driver.settle();
    let apart = half.iter().zip(&driver.picture()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart <= Some(1), "{apart:?}");
    driver.click(driver.find("cd/m²").center());
    driver.settle();
    driver.enter("1e9");
    driver.settle();
    driver.find_containing("no further");
}

fn draw_area(driver: &mut Driver) {
    driver.click(driver.find("Draw area").center());
    let middle = driver.find("picture").center();
    for corner in [vec2(-60.0, 20.0), vec2(60.0, 20.0), vec2(80.0, 80.0), vec2(-80.0, 80.0)] {
        driver.click(middle + corner);
    }
    driver.key(Key::Enter, Modifiers::NONE);
    driver.settle();
}

fn an_area_is_measured_in_lux_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.csv");
    let mut driver = Driver::open(room());
    draw_area(&mut driver);
    let figures = |driver: &Driver| -> Vec<f32> {
        let found = driver.widgets().iter().find(|(name, _)| name.starts_with("Ē ")).unwrap().0.clone();
        found.replace('≥', " ").split_whitespace().filter_map(|word| word.parse().ok()).collect()
    };
    let before = figures(&driver);
    let [average, least, most, uniformity] = before[..] else { panic!("{before:?}") };
    assert!(0.0 < least && least <= average && average <= most && (uniformity - least / average).abs() < 0.02);
    driver.find("At least: surfaces are taken for white");
    // A stop up doubles it.
    driver.click(driver.find("ceiling, stops").right_center() + vec2(29.0, 0.0));
    driver.settle();
    driver.enter("1");
    driver.settle();
    assert!((figures(&driver)[0] / average - 2.0).abs() < 0.02);
    driver.click(driver.find("Report…").center());
    driver.settle();
    driver.enter(report.to_str().unwrap());
    driver.settle();
    let text = std::fs::read_to_string(&report).unwrap();
    let light = text.lines().find(|line| line.starts_with("ceiling,area,")).unwrap();
    assert!(light.contains(",yes,1.000,100.00,") && light.contains("cd/m²") && light.contains(",lm"), "{light}");
    assert!(text.lines().any(|line| line.contains(",lx,at least")), "{text}");
}

fn false_colour_takes_the_place_of_the_picture() {
    let mut driver = Driver::open(room());
    driver.click(driver.find("Luminance").center());
    driver.settle();
    let shown = driver.texture("meter");
    assert!(shown.len() == driver.picture().len() && shown != driver.picture());
    driver.click(driver.find("Lines").center());
    driver.settle();
    let plain = driver.texture("meter");
    let white = |picture: &[u8]| picture.chunks_exact(4).filter(|pixel| pixel[..3] == [255; 3]).count();
    assert!(white(&shown) > white(&plain) + 20, "lines of equal value");
    let fader = driver.find("ceiling, stops").center();
    driver.drag(fader, fader - vec2(30.0, 0.0), 3);
    driver.settle();
    // The scale follows: the same picture, but for the rounding of its ends.
    driver.find("Fit");
    let folder = tempfile::tempdir().unwrap();
    let png = folder.path().join("lux.png");
    save(&mut driver, Key::S, &png);
    let saved = image::open(&png).unwrap().to_rgba8().into_raw();
    assert!(saved == driver.texture("meter"), "what is shown is what is saved");
}

fn the_sun_is_dragged_over_the_sky_and_put_by_date() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.ltc");
    container::write(&path, BuiltIn { width: 64, height: 48, texels: 8 }.named("environment").unwrap(), 8);
    let mut driver = Driver::open(&path);
    let scene = driver.picture();
    driver.click(driver.find("Sun").center());
    driver.settle();
    let texture = driver.find("texture");
    let high = texture.center() - vec2(0.0, texture.height() * 0.3);
    driver.click(high);
    driver.settle();
    let first = driver.picture();
    assert!(first != scene);
    driver.drag(high, high + vec2(texture.width() * 0.3, 0.0), 5);
    driver.settle();
    assert!(driver.picture() != first);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == first, "a drag of the sun is one step");
    driver.click(driver.find("Put the sun there").center());
    driver.settle();
    assert!(driver.picture() != first);
    driver.find_containing("° high");
}

fn the_sun_is_put_and_dragged_in_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.ltc");
    let loaded = BuiltIn { width: 64, height: 48, texels: 16 }.named("environment").unwrap();
    let (camera, basis) = (loaded.scene.camera, loaded.scene.basis.clone());
    container::write(&path, loaded, 8);
    let mut driver = Driver::open(&path);
    let scene = driver.picture();
    let view = driver.find("picture");
    let middle = view.center();
    // The sun stands in the middle of the texel that a look straight ahead meets; the picture fits its room but for a margin.
    let sky = basis.lights().iter().find(|light| light.kind.is_environment()).unwrap();
    let direction = glam::Vec3::from(sky.places[sky.nearest_texel(camera.forward.to_array())]);
    let at = camera.position(direction.normalize()).unwrap();
    let zoom = ((view.width() - 24.0) / 64.0).min((view.height() - 24.0) / 48.0);
    let sun = middle + vec2(at.x - 32.0, at.y - 24.0) * zoom;
    assert!(view.contains(sun), "{sun} in {view}");
    driver.click(driver.find("Sun").center());
    driver.settle();
    driver.find("Click on the map below or in the picture");
    driver.click(middle);
    driver.settle();
    let ahead = driver.picture();
    assert!(ahead != scene);
    driver.find_containing("° high");
    // By whichever tool: what is taken hold of is the sun.
    driver.click(driver.find("Brush").center());
    driver.settle();
    // Some texels to the side: further than the sun is wide.
    driver.drag(sun, sun + (middle - sun) * 2.0 + vec2(0.0, -150.0), 6);
    driver.settle();
    let aside = driver.picture();
    assert!(aside != ahead);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == ahead, "a drag in the picture is one step");
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert!(driver.picture() == scene);
}

fn a_band_in_the_picture_selects_lights() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("band.ltc");
    let mut scene = BuiltIn { width: 64, height: 48, texels: 2 }.named("mixed").unwrap();
    // Straight at the ceiling's light.
    let light = scene.scene.basis.lights()[0].clone();
    let middle =
        light.places.iter().map(|place| glam::Vec3::from(*place)).sum::<glam::Vec3>() / light.places.len() as f32;
    let camera = &scene.scene.camera;
    let (eye, size, fov) = (camera.eye, (camera.width, camera.height), camera.vertical_fov_radians().unwrap());
    scene.scene.camera =
        ltm::scene::Camera::looking(eye, middle - eye, glam::Vec3::Y, fov, size, camera.filter).unwrap();
    container::write(&path, scene, 4);
    let mut driver = Driver::open(&path);
    let picture = driver.find("picture");
    let before = driver.picture();
    let at = picture.center();
    driver.drag_with(at - vec2(30.0, 30.0), at + vec2(30.0, 30.0), 5, Modifiers::SHIFT);
    driver.settle();
    driver.find("One light selected");
    assert!(driver.picture() == before, "nothing but the selection changes");
    driver.drag_with(at + vec2(60.0, 60.0), at + vec2(90.0, 90.0), 5, Modifiers::SHIFT);
    driver.settle();
    driver.find("No light has its middle there");
    // A container that does not say how its camera stood.
    let path = folder.path().join("stage.ltc");
    container::write_stage(&path, 3);
    let mut driver = Driver::open(&path);
    driver.drag_with(at - vec2(30.0, 30.0), at + vec2(30.0, 30.0), 5, Modifiers::SHIFT);
    driver.settle();
    driver.find_containing("does not say how its camera stood");
}

fn features_take_the_place_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (matrix, packed) = (folder.path().join("room.ltm"), folder.path().join("room.ltc"));
    let mut room = BuiltIn { width: 48, height: 32, texels: 2 }.named("mixed").unwrap();
    room.settings.samples_per_pixel = 4;
    render(room, &matrix, &RenderOptions::default(), &NoProgress).unwrap();
    let matrix = StoreReader::open(&matrix).unwrap();
    pack(&matrix, matrix.job(), &packed, &PackOptions::default(), &NoProgress).unwrap();
    let features = Features::read(&matrix).unwrap();
    let mut driver = Driver::open(&packed);
    for (name, feature) in [("Albedo", Feature::Albedo), ("Normals", Feature::Normal), ("Depth", Feature::Depth)] {
        driver.click(driver.find(name).center());
        driver.settle();
        driver.frame(Vec::new());
        let shown = driver.texture("features");
        let share: Vec<f32> = features.planes_of(Feature::Surface).flatten().copied().collect();
        let plane: Vec<f32> = features.planes_of(feature).next().unwrap().to_vec();
        // Red of the pixels with the least and the most of it: in their order, and for depth the other way round.
        let surfaces = (0..share.len()).filter(|&pixel| share[pixel] > 0.99);
        let by_value = |a: &usize, b: &usize| plane[*a].total_cmp(&plane[*b]);
        let (least, most) = (surfaces.clone().min_by(by_value).unwrap(), surfaces.max_by(by_value).unwrap());
        let (least, most) = (shown[4 * least], shown[4 * most]);
        assert!(if feature == Feature::Depth { least > most } else { least < most }, "{name}: {least}, {most}");
    }
    let png = folder.path().join("depth.png");
    save(&mut driver, Key::S, &png);
    let saved = image::open(&png).unwrap().to_rgba8().into_raw();
    assert!(saved == driver.texture("features"), "a PNG is the picture as it is shown");
    driver.move_to(driver.find("picture").center());
    driver.settle();
    driver.click(driver.find("Image").center());
    driver.settle();
    // Without the matrix nothing is known, and that is said.
    std::fs::remove_file(folder.path().join("room.ltm")).unwrap();
    let mut driver = Driver::open(&packed);
    driver.click(driver.find("Albedo").center());
    driver.settle();
    driver.find_containing("Not known");
}

fn reports_and_sheets_are_written_as_pdf() {
    let folder = tempfile::tempdir().unwrap();
    let (report, sheet) = (folder.path().join("report.pdf"), folder.path().join("sheet.pdf"));
    // Tall enough for all of the panel.
    let options = WindowOptions { path: Some(room().to_owned()), ..Default::default() };
    let mut driver = Driver::open_with(options, vec2(1280.0, 1500.0));
    driver.click(driver.find("Illuminance").center());
    driver.settle();
    draw_area(&mut driver);
    driver.click(driver.find("Report…").center());
    driver.settle();
    driver.enter(report.to_str().unwrap());
    driver.settle();
    for _ in 0..2 {
        driver.key(Key::K, Modifiers::NONE);
        driver.settle();
    }
    driver.click(driver.find("Sheet…").center());
    driver.settle();
    driver.enter(sheet.to_str().unwrap());
    driver.settle();
    let holds = |path: &Path, text: &str| {
        let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(bytes.starts_with(b"%PDF"));
        bytes.windows(text.len()).any(|part| part == text.as_bytes())
    };
    for text in ["(ceiling)", "uniformity U0", "Colours from", "at least: surfaces taken for white", "/Subtype /Image"]
    {
        assert!(holds(&report, text), "{text}");
    }
    assert!(holds(&sheet, "(Snapshot 1)") && holds(&sheet, "(Snapshot 2)") && holds(&sheet, "/Subtype /Image"));
    if let Some(kept) = std::env::var_os("LTM_VIEW_PICTURES").map(std::path::PathBuf::from) {
        std::fs::copy(&report, kept.join("report.pdf")).unwrap();
        std::fs::copy(&sheet, kept.join("sheet.pdf")).unwrap();
    }
}

/// Two snapshots, the second a stop and a half darker, and the animation between them under this name.
fn animation(path: &Path) {
    let mut driver =
        Driver::open_with(WindowOptions { path: Some(room().to_owned()), ..Default::default() }, vec2(1280.0, 1500.0));
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    driver.click(driver.find("ceiling, stops").right_center() + vec2(29.0, 0.0));
    driver.settle();
    driver.enter("-1.5");
    driver.settle();
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    driver.click(driver.find("Animation…").center());
    driver.settle();
    driver.enter(path.to_str().unwrap());
    driver.settle();
    // Two seconds of 24 frames, and the last.
    driver.find_containing("49 frames");
}

/// Mean of all values of the first and the last picture of several, each of so many values.
fn ends(values: &[u8], of_picture: usize) -> [f64; 2] {
    let mean = |part: &[u8]| part.iter().map(|&value| f64::from(value)).sum::<f64>() / part.len() as f64;
    [mean(&values[..of_picture]), mean(&values[values.len() - of_picture..])]
}

fn an_animation_is_written_as_numbered_pictures() {
    let folder = tempfile::tempdir().unwrap();
    animation(&folder.path().join("night.png"));
    let picture = |number: u32| image::open(folder.path().join(format!("night-{number:04}.png"))).unwrap().into_rgb8();
    let [first, middle, last] = [0, 24, 48].map(|number| {
        let picture = picture(number).into_raw();
        ends(&picture, picture.len())[0]
    });
    assert!(first > middle + 5.0 && middle > last + 5.0, "{first} {middle} {last}");
    assert!(!folder.path().join("night-0049.png").exists());
}

pub(crate) fn has_encoder() -> bool {
    ltm_view::animation::endings().contains(&"mp4")
}

pub(crate) fn an_animation_is_written_as_a_video() {
    let folder = tempfile::tempdir().unwrap();
    animation(&folder.path().join("night.png"));
    let shown = image::open(folder.path().join("night-0000.png")).unwrap().into_rgb8();
    let (width, height) = (shown.width() as usize & !1, shown.height() as usize & !1);
    let last = image::open(folder.path().join("night-0048.png")).unwrap().into_rgb8();
    let wanted = [shown, last].map(|picture| ends(picture.as_raw(), picture.as_raw().len())[0]);
    for name in ["night.mp4", "night.webm"] {
        let path = folder.path().join(name);
        animation(&path);
        let decoded = std::process::Command::new("ffmpeg")
            .args(["-v", "error", "-i", path.to_str().unwrap(), "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-sws_flags", "accurate_rnd+full_chroma_int", "-"])
            .output()
            .unwrap();
        assert!(decoded.status.success(), "{}", String::from_utf8_lossy(&decoded.stderr));
        let of_picture = width * height * 3;
        assert_eq!(decoded.stdout.len(), 49 * of_picture, "{name}");
        // Means of the pictures: a matrix or range of colours that is taken for another moves them by 3 and more, as does rounding down
        // on the way by 1; coding by a tenth.
        for (found, wanted) in ends(&decoded.stdout, of_picture).into_iter().zip(wanted) {
            assert!((found - wanted).abs() < 0.5, "{name}: {found} {wanted}");
        }
        if let Some(kept) = std::env::var_os("LTM_VIEW_PICTURES").map(std::path::PathBuf::from) {
            std::fs::copy(&path, kept.join(name)).unwrap();
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 49 + 2, "nothing but pictures and videos is left");
}
