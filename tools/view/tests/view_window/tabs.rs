//! Several views of one scene as tabs: one mix lights them all.

use std::path::{Path, PathBuf};

use eframe::egui::{Key, Modifiers, Rect, pos2, vec2};
use ltm::container::ContainerReader;
use ltm::image::{LinearImage, write_exr};
use ltm::relight::CpuRelighter;
use ltm::scene::BuiltIn;
use ltm_view::{WindowOptions, looks};

use super::driver::Driver;
use super::{CTRL, container, real};

/// Tests of this file.
pub(crate) const TESTS: [(&str, fn()); 10] = [
    (
        "a_switch_in_one_tab_is_seen_in_the_frame_that_shows_the_other",
        a_switch_in_one_tab_is_seen_in_the_frame_that_shows_the_other,
    ),
    (
        "each_tab_is_lit_as_its_container_alone_is_by_the_same_look",
        each_tab_is_lit_as_its_container_alone_is_by_the_same_look,
    ),
    (
        "each_tab_keeps_its_zoom_and_all_share_exposure_and_selection",
        each_tab_keeps_its_zoom_and_all_share_exposure_and_selection,
    ),
    ("lights_of_one_view_alone_stay_as_they_are_there", lights_of_one_view_alone_stay_as_they_are_there),
    ("snapshots_are_recalled_and_compared_with_in_every_tab", snapshots_are_recalled_and_compared_with_in_every_tab),
    ("views_are_added_and_closed_and_the_mix_stays", views_are_added_and_closed_and_the_mix_stays),
    ("several_files_are_chosen_together", several_files_are_chosen_together),
    ("what_memory_has_no_room_for_is_read_when_it_is_shown", what_memory_has_no_room_for_is_read_when_it_is_shown),
    ("reload_keeps_the_tabs", reload_keeps_the_tabs),
    ("frames_of_an_animation_are_gone_through_under_one_mix", frames_of_an_animation_are_gone_through_under_one_mix),
];

/// Tests that need hands on a real window.
pub(crate) const REAL: [(&str, fn()); 1] =
    [("a_real_window_shows_two_views_under_one_mix", a_real_window_shows_two_views_under_one_mix)];

const SHIFT_CTRL: Modifiers = CTRL.plus(Modifiers::SHIFT);

/// A folder with containers of these lamps by their names.
fn views(views: &[(&str, &[&str])]) -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let write = |(name, lamps): &(&str, &[&str])| {
        let path = folder.path().join(format!("{name}.ltc"));
        container::write_lamps(&path, lamps);
        path
    };
    let paths = views.iter().map(write).collect();
    (folder, paths)
}

/// Two views that have the same lamps in another order.
fn lobby_and_bar() -> (tempfile::TempDir, Vec<PathBuf>) {
    views(&[("lobby", &["desk", "door", "stairs"]), ("bar", &["stairs", "desk", "door"])])
}

fn open(paths: &[PathBuf]) -> Driver {
    Driver::open_tabs(&paths.iter().map(PathBuf::as_path).collect::<Vec<_>>())
}

/// Which of so many strips of the drawn picture are lit.
fn lit(driver: &Driver, count: usize) -> Vec<usize> {
    let width = container::STAGE[0] as usize;
    let picture = driver.picture();
    (0..count).filter(|strip| picture[(width * (2 * strip + 1) / (2 * count)) * 4] > 9).collect()
}

fn press(driver: &mut Driver, name: &str) {
    driver.click(driver.find(name).center());
    driver.settle();
}

fn a_switch_in_one_tab_is_seen_in_the_frame_that_shows_the_other() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = open(&paths);
    assert_eq!((driver.title(), lit(&driver, 3)), ("lobby.ltc – ltm", vec![0, 1, 2]));
    press(&mut driver, "door, on");
    assert_eq!(lit(&driver, 3), [0, 2], "the door is the second of the lobby");
    driver.key(Key::Tab, CTRL);
    assert_eq!((driver.title(), lit(&driver, 3)), ("● bar.ltc – ltm", vec![0, 1]), "and the third of the bar");
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert_eq!(lit(&driver, 3), [0, 1, 2], "what was done in one tab is undone in another");
    driver.click_with(driver.find("stairs, on").center(), Modifiers::ALT);
    driver.settle();
    for (key, modifiers, strips) in
        [(Key::Tab, SHIFT_CTRL, [2]), (Key::Num2, CTRL, [0]), (Key::Num1, CTRL, [2]), (Key::PageDown, CTRL, [0])]
    {
        driver.key(key, modifiers);
        assert_eq!(lit(&driver, 3), strips, "solo is one for all");
    }
    driver.click(driver.find("lobby").center());
    driver.frame(Vec::new());
    assert_eq!((driver.title(), lit(&driver, 3)), ("● lobby.ltc – ltm", vec![2]));
}

fn each_tab_is_lit_as_its_container_alone_is_by_the_same_look() {
    let (folder, paths) = lobby_and_bar();
    let mut driver = open(&paths);
    let fader = driver.find("desk, stops").center();
    driver.drag(fader, fader + vec2(14.0, 0.0), 4);
    let fader = driver.find("stairs, stops").center();
    driver.drag(fader, fader - vec2(9.0, 0.0), 4);
    driver.settle();
    let look = folder.path().join("evening.toml");
    driver.key(Key::K, CTRL);
    driver.settle();
    driver.enter(look.to_str().unwrap());
    driver.settle();
    for path in &paths {
        let reader = ContainerReader::open(path).unwrap();
        let saved = looks::load(&look, &reader.job().basis).unwrap();
        let lighting = saved.mix.lighting(&reader.job().basis).unwrap();
        let image = CpuRelighter::load(&reader).unwrap().relight(&lighting).unwrap();
        let expected = saved.display.unwrap().show(&image).rgba;
        let name = path.file_stem().unwrap().to_str().unwrap();
        driver.click(driver.find(name).center());
        driver.settle();
        let pairs = driver.picture().into_iter().zip(expected);
        // The stops were rounded on their way through the file.
        assert!(pairs.clone().count() > 0 && pairs.into_iter().all(|(a, b)| a.abs_diff(b) <= 1), "{name}");
    }
}

fn each_tab_keeps_its_zoom_and_all_share_exposure_and_selection() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = open(&paths);
    assert!(!driver.has("100 %"));
    driver.key(Key::Num0, CTRL);
    driver.key(Key::ArrowDown, Modifiers::NONE);
    driver.key(Key::E, Modifiers::NONE);
    driver.settle();
    let bright = driver.picture().iter().map(|&v| u64::from(v)).sum::<u64>();
    assert!(driver.has("100 %"));
    driver.key(Key::Tab, CTRL);
    assert!(!driver.has("100 %"), "the bar is fitted");
    let same = driver.picture().iter().map(|&v| u64::from(v)).sum::<u64>();
    // Strips of a third of the width differ by a column.
    assert!(same.abs_diff(bright) * 50 < bright, "{same} {bright}");
    driver.key(Key::X, Modifiers::NONE);
    driver.settle();
    assert_eq!(lit(&driver, 3), [0, 1], "the door, which was selected in the lobby, is the third here");
    driver.key(Key::Tab, CTRL);
    assert!(driver.has("100 %"));
    assert_eq!(lit(&driver, 3), [0, 2]);
}

fn lights_of_one_view_alone_stay_as_they_are_there() {
    let (_folder, paths) = views(&[
        ("lobby", &["desk", "door", "sign"]),
        ("bar", &["bottles 1", "bottles 2", "desk"]),
        ("garden", &["moon"]),
    ]);
    let mut driver = open(&paths[..2]);
    driver.find_containing("4 of 5 lights are not in every view");
    driver.find("3 of 3 on");
    assert!(driver.has("sign, on") && !driver.has("bottles 1, on") && !driver.has("group bottles, row"));
    press(&mut driver, "desk, on");
    driver.key(Key::Tab, CTRL);
    assert!(!driver.has("sign, on") && driver.has("group bottles, row"));
    assert_eq!(lit(&driver, 3), [0, 1]);
    press(&mut driver, "bottles 1, on");
    driver.key(Key::Tab, CTRL);
    assert_eq!(lit(&driver, 3), [1, 2]);
    driver.key(Key::Z, CTRL);
    driver.key(Key::Tab, CTRL);
    driver.settle();
    assert_eq!(lit(&driver, 3), [0, 1], "the step of the bar was undone in the lobby");
    // Solo on a light that this view lacks leaves it dark.
    driver.key(Key::Tab, CTRL);
    driver.click_with(driver.find("sign, on").center(), Modifiers::ALT);
    driver.settle();
    driver.key(Key::Tab, CTRL);
    assert_eq!((lit(&driver, 3), driver.has("Not in this view")), (vec![], false));
    driver.key(Key::Z, CTRL);
    driver.settle();
    // Another scene: said, and no more.
    let mut driver = open(&paths[1..]);
    driver.find_containing("garden has no light in common with the other views");
    driver.key(Key::Tab, CTRL);
    assert_eq!(lit(&driver, 1), [0]);
}

fn snapshots_are_recalled_and_compared_with_in_every_tab() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = open(&paths);
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    press(&mut driver, "desk, on");
    driver.key(Key::Tab, CTRL);
    driver.settle();
    assert_eq!(lit(&driver, 3), [0, 2]);
    driver.find("Snapshot 1");
    driver.key(Key::C, Modifiers::NONE);
    driver.settle();
    let compared = driver.texture("compared");
    press(&mut driver, "Recall");
    assert_eq!(lit(&driver, 3), [0, 1, 2]);
    assert!(driver.picture() == compared, "its picture is that of this view");
    driver.key(Key::K, Modifiers::NONE);
    driver.settle();
    driver.key(Key::Tab, CTRL);
    driver.settle();
    assert!(driver.has("Snapshot 1") && driver.has("Snapshot 2"));
    assert!(driver.picture() == driver.texture("compared"), "and here it is that of the lobby");
}

fn views_are_added_and_closed_and_the_mix_stays() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = Driver::open(&paths[0]);
    press(&mut driver, "desk, on");
    assert!(!driver.has("bar"));
    let add = |driver: &mut Driver, path: &Path| {
        driver.key(Key::O, SHIFT_CTRL);
        driver.settle();
        driver.enter(path.to_str().unwrap());
        driver.settle();
    };
    add(&mut driver, &paths[1]);
    assert_eq!((driver.title(), lit(&driver, 3)), ("● bar.ltc – ltm", vec![0, 2]));
    add(&mut driver, &paths[0]);
    driver.find_containing("lobby.ltc is open already");
    assert_eq!((driver.title(), lit(&driver, 3)), ("● lobby.ltc – ltm", vec![1, 2]));
    driver.key(Key::Z, CTRL);
    driver.key(Key::Y, CTRL);
    press(&mut driver, "close lobby");
    assert_eq!((driver.title(), lit(&driver, 3)), ("● bar.ltc – ltm", vec![0, 2]));
    assert!(!driver.has("close bar") && !driver.has("lobby"), "one view has no tabs");
    driver.key(Key::W, CTRL);
    driver.key(Key::Tab, CTRL);
    driver.key(Key::Z, CTRL);
    driver.settle();
    assert_eq!((driver.title(), lit(&driver, 3)), ("bar.ltc – ltm", vec![0, 1, 2]));
    // What is none is told, and what is open stays.
    let noise = paths[0].with_file_name("noise.ltc");
    std::fs::write(&noise, [7; 500]).unwrap();
    add(&mut driver, &noise);
    driver.find_containing("noise.ltc: is not a container");
    assert_eq!(lit(&driver, 3), [0, 1, 2]);
}

fn several_files_are_chosen_together() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = Driver::open(&paths[0]);
    driver.key(Key::O, CTRL);
    driver.settle();
    // In the middle of the window, where nothing else has such a name.
    let middle = Rect::from_center_size(pos2(640.0, 400.0), vec2(540.0, 400.0));
    let row = |driver: &Driver, name: &str| {
        let is_row = |(row, place): &&(String, Rect)| row.starts_with(name) && middle.contains(place.center());
        driver.widgets().iter().find(is_row).unwrap_or_else(|| panic!("{name}: {:?}", driver.widgets())).1
    };
    let bar = row(&driver, "bar.ltc").center();
    driver.click(bar);
    driver.settle();
    // The one that is chosen is let go, and taken again.
    for _ in 0..2 {
        driver.click_with(bar, CTRL);
        driver.settle();
        assert!(!driver.says("2 files"));
    }
    driver.click_with(row(&driver, "lobby.ltc").center(), CTRL);
    driver.settle();
    driver.find_containing("2 files");
    press(&mut driver, "Open");
    assert!(driver.has("close bar") && driver.has("close lobby"));
    assert_eq!(driver.title(), "bar.ltc – ltm");
    // Files that are dropped together, too.
    let mut driver = Driver::open(&paths[1]);
    let picture = driver.find("picture").center();
    driver.drop_files(&[&paths[0], &paths[1]], picture);
    driver.settle();
    assert!(driver.has("close bar") && driver.title() == "lobby.ltc – ltm");
}

fn what_memory_has_no_room_for_is_read_when_it_is_shown() {
    let (_folder, paths) = lobby_and_bar();
    let needs = |path: &PathBuf| {
        let options = WindowOptions { path: Some(path.clone()), ..Default::default() };
        let mut driver = Driver::open_with(options, vec2(1280.0, 800.0));
        driver.settle();
        resident(&driver)
    };
    let (all, one) = (open(&paths), needs(&paths[0]));
    assert!(all.has_picture_of("bar") && resident(&all) == one, "the status line speaks of the view in front");
    let budget_bytes =
        Some(ltm_view::worker::Session::open_asleep(&paths[0], std::sync::Arc::new(|| ())).unwrap().needed_bytes());
    let options =
        WindowOptions { path: Some(paths[0].clone()), beside: paths[1..].to_vec(), budget_bytes, ..Default::default() };
    let mut driver = Driver::open_with(options, vec2(1280.0, 800.0));
    assert!(!driver.has_picture_of("bar"), "there is no room for it beside the lobby");
    press(&mut driver, "door, on");
    for strips in [[0, 1], [0, 2], [0, 1]] {
        driver.key(Key::Tab, CTRL);
        driver.settle();
        assert_eq!(lit(&driver, 3), strips);
        assert_eq!(resident(&driver), one);
    }
}

/// What the status line says of memory.
fn resident(driver: &Driver) -> String {
    let found = driver.widgets().iter().find(|(name, _)| name.ends_with(" resident"));
    found.unwrap_or_else(|| panic!("{:?}", driver.widgets())).0.clone()
}

fn reload_keeps_the_tabs() {
    let (_folder, paths) = lobby_and_bar();
    let mut driver = open(&paths);
    let reference = paths[0].with_file_name("photo.exr");
    write_exr(&reference, &LinearImage::black(container::STAGE[0], container::STAGE[1])).unwrap();
    let picture = driver.find("picture").center();
    driver.drop_file(&reference, picture);
    driver.settle();
    assert!(driver.has("photo.exr"));
    driver.key(Key::Tab, CTRL);
    driver.key(Key::Num0, CTRL);
    press(&mut driver, "desk, on");
    // One lamp fewer, in another order.
    container::write_lamps(&paths[0], &["stairs", "desk"]);
    driver.key(Key::F5, Modifiers::NONE);
    driver.settle();
    driver.find_containing("Reloaded with your mix");
    assert_eq!((driver.title(), lit(&driver, 3), driver.has("100 %")), ("● bar.ltc – ltm", vec![0, 2], true));
    driver.key(Key::Tab, CTRL);
    assert_eq!((lit(&driver, 2), driver.has("100 %")), (vec![0], false));
    assert!(driver.has("photo.exr"), "the reference of the tab behind");
}

fn frames_of_an_animation_are_gone_through_under_one_mix() {
    let folder = tempfile::tempdir().unwrap();
    // A lamp that goes through the picture, before one that stands.
    let path = |frame: usize| folder.path().join(format!("shot.{frame:04}.ltc"));
    for frame in 7..19 {
        let lamps = if frame % 2 == 0 { ["car", "house"] } else { ["house", "car"] };
        container::write_lamps(&path(frame), &lamps);
    }
    let mut driver = Driver::open(&folder.path().join("shot.####.ltc"));
    driver.find("Frame 7  (1 of 12)");
    press(&mut driver, "car, on");
    assert_eq!((driver.title(), lit(&driver, 2)), ("● shot.0007.ltc – ltm", vec![0]));
    driver.key(Key::Num0, CTRL);
    for frame in 8..19 {
        driver.key(Key::PageDown, Modifiers::NONE);
        // There is always a picture, if not at once its own.
        driver.find("100 %");
        driver.settle();
        assert_eq!(lit(&driver, 2), [usize::from(frame % 2 == 0)], "frame {frame}");
        driver.find(&format!("Frame {frame}  ({} of 12)", frame - 6));
    }
    driver.key(Key::PageDown, Modifiers::NONE);
    driver.settle();
    assert_eq!(driver.title(), "● shot.0018.ltc – ltm", "that was the last");
    driver.key(Key::Z, CTRL);
    driver.settle();
    let slider = driver.find("frame");
    driver.click(slider.left_center() + vec2(2.0, 0.0));
    driver.settle();
    assert_eq!((driver.title(), lit(&driver, 2)), ("shot.0007.ltc – ltm", vec![0, 1]));
    std::fs::remove_file(path(8)).unwrap();
    driver.key(Key::PageDown, Modifiers::NONE);
    driver.settle();
    assert_eq!(driver.title(), "shot.0007.ltc – ltm");
    driver.find_containing("shot.0008.ltc");
    let mut driver =
        Driver::unseen_with(WindowOptions { path: Some(folder.path().join("none.##.ltc")), ..Default::default() });
    driver.settle();
    driver.find_containing("no file has such a name");
}

/// Hands drag a fader over one view, go to the other by a key, and save its picture: it is lit by the look that is saved there.
fn a_real_window_shows_two_views_under_one_mix() {
    const SCRIPT: &str = r#"
        save() { xdotool key "$1"; sleep 3; xdotool key ctrl+a; sleep 0.5; xdotool type --delay 40 "$2"; sleep 1
                 xdotool key Return; wait_for "$2"; sleep 1; }
        "$VIEWER" --act-as-viewer "$CONTAINER" & viewer=$!
        window=$(xdotool search --sync --onlyvisible --name "front.ltc" | tail -1)
        sleep 4
        xdotool windowfocus "$window"; sleep 1
        eval "$(xdotool getwindowgeometry --shell "$window")"
        x=$((X + FADER_X)); y=$((Y + FADER_Y))
        # A window that is not drawn yet may miss the pointer; its title says when something has changed.
        for attempt in 1 2 3 4 5; do
            xdotool mousemove $x $y; sleep 0.5; xdotool mousedown 1
            for i in 3 6 9 12 15; do sleep 0.3; xdotool mousemove $((x - i)) $y; done
            sleep 0.5; xdotool mouseup 1; sleep 2
            case "$(xdotool getwindowname "$window")" in ●*) break;; esac
        done
        xdotool key ctrl+Tab; sleep 2
        save ctrl+s "$PNG"
        save ctrl+k "$LOOK"
        xdotool key ctrl+q
        wait $viewer"#;
    let folder = tempfile::tempdir().unwrap();
    let [front, side, look, png] = ["front.ltc", "side.ltc", "l.toml", "p.png"].map(|name| folder.path().join(name));
    for (path, aside) in [(&front, 0.0), (&side, 0.4)] {
        let mut scene = BuiltIn { width: 192, height: 144, texels: 6 }.named("mixed").unwrap();
        scene.scene.camera.eye.x += aside;
        container::write(path, scene, 16);
    }
    real::play_tabs(SCRIPT, [&front, &side], &[("LOOK", &look), ("PNG", &png)]);
    let reader = ContainerReader::open(&side).unwrap();
    let saved = looks::load(&look, &reader.job().basis).unwrap();
    assert!((-6.0..-1.0).contains(&saved.mix.lights[0].stops), "{:?}", saved.mix.lights[0].stops);
    let lighting = saved.mix.lighting(&reader.job().basis).unwrap();
    let image = CpuRelighter::load(&reader).unwrap().relight(&lighting).unwrap();
    let expected = saved.display.unwrap().tone.bytes(&image);
    let written = image::open(&png).unwrap().to_rgb8().into_raw();
    let pairs = written.iter().zip(expected.as_flattened());
    // The stops were rounded on their way through the file.
    assert!(written.len() == expected.as_flattened().len() && pairs.into_iter().all(|(a, b)| a.abs_diff(*b) <= 1));
}
