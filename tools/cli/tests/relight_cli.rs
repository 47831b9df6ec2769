//! `ltm relight` from outside: looks, layers, sequences, tone mapping, false colours, budgets, and what it refuses.

mod program;
mod room;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Output;

use exr::prelude::read_all_flat_layers_from_file;
use ltm::image::{LinearImage, read_image};
use room::write_room;
use tempfile::TempDir;

/// A lamp of texels and a sky, neither of which outshines the other.
const LIGHTS: &str = r#"
[render]
samples_per_pixel = 64
block_side = 8

[[light]]
material = "lamp"
texels = [4, 4]

[[light]]
kind = "environment"
texels = [8, 4]
map = "sky.exr"
"#;
const LOOK: &str = r#"
[groups]
room = ["lamp"]
[[look]]
name = "lamp"
[[look.light]]
name = "environment"
on = false
[[look]]
name = "dark"
[[look.light]]
name = "*"
on = false
[[key]]
time_secs = 0
look = "dark"
[[key]]
time_secs = 1
look = "lamp"
"#;

fn run(folder: &Path, program: &str, arguments: &[&str]) -> Output {
    program::command(folder, program, arguments).output().unwrap()
}

fn relight(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, "ltm", &[&["relight", "--device", "cpu"], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn refused(folder: &Path, arguments: &[&str], words: &[&str]) {
    let output = run(folder, "ltm", &[&["relight", "--device", "cpu"], arguments].concat());
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && !error.contains("panicked"), "{arguments:?}: {error}");
    assert!(words.iter().all(|word| error.contains(word)), "{words:?} are not in: {error}");
}

/// A folder with a rendered and packed room.
fn room() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_room(at, LIGHTS);
    fs::write(at.join("look.toml"), LOOK).unwrap();
    // A sky that is bright on one side only.
    let sky = LinearImage { width: 8, height: 4, pixels: (0..32).map(|i| [(i % 8) as f32 / 16.0; 3]).collect() };
    ltm::image::write_exr(&at.join("sky.exr"), &sky).unwrap();
    assert!(run(at, "ltm", &["render", "room.toml"]).status.success());
    assert!(run(at, "ltm-pack", &["room.ltm"]).status.success());
    folder
}

fn largest_difference(a: &LinearImage, b: &LinearImage) -> f32 {
    a.values().iter().zip(b.values()).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

#[test]
fn a_container_is_relit_as_its_matrix_and_as_what_it_unpacks_to_under_any_look() {
    let folder = room();
    let at = folder.path();
    assert!(run(at, "ltm-unpack", &["room.ltc", "-o", "back.ltm"]).status.success());
    let mut seen = Vec::new();
    for look in [&[][..], &["-l", "look.toml"], &["-l", "look.toml", "--look", "lamp"], &["--on", "env*"]] {
        let pixels = |input: &str| {
            relight(at, &[&[input, "-o", "a.exr"], look].concat());
            read_image(&at.join("a.exr")).unwrap()
        };
        let (relit, unpacked, raw) = (pixels("room.ltc"), pixels("back.ltm"), pixels("room.ltm"));
        let norm = |image: &LinearImage| image.values().iter().map(|v| f64::from(v * v)).sum::<f64>().sqrt();
        let distance = |a: &LinearImage, b: &LinearImage| {
            let squares = a.values().iter().zip(b.values()).map(|(a, b)| f64::from((a - b) * (a - b)));
            squares.sum::<f64>().sqrt() / norm(b)
        };
        // Steps are chosen for 45 dB under all lights together: 0.6 % of white, of which the lamp alone, four times
        // dimmer than the sky, has as much in its own picture. Another lighting would be off by as much as there is.
        assert!(distance(&relit, &raw) < 0.2, "{look:?}: {}", distance(&relit, &raw));
        // Holding factors in 8 bits adds a quarter of what their steps did, in each of the two.
        assert!(distance(&relit, &unpacked) < 0.03, "{look:?}: {}", distance(&relit, &unpacked));
        seen.push(raw);
    }
    assert_eq!(seen[0], seen[1], "the file's rules outside of looks change nothing");
    assert!(seen[1] != seen[2] && seen[2] != seen[3]);
}

/// The layers of an EXR, however they are shared out over the parts of the file, by name.
fn layers_of(path: &Path) -> BTreeMap<String, LinearImage> {
    let file = read_all_flat_layers_from_file(path).unwrap();
    let mut images = BTreeMap::new();
    for layer in &file.layer_data {
        for channel in &layer.channel_data.list {
            let name = [layer.attributes.layer_name.as_ref(), Some(&channel.name)].into_iter().flatten();
            let name = name.map(ToString::to_string).collect::<Vec<_>>().join(".");
            let (name, of) = name.rsplit_once('.').unwrap_or(("", &name));
            let ch = ["R", "G", "B"].iter().position(|known| *known == of).unwrap();
            let (width, height) = (layer.size.width() as u32, layer.size.height() as u32);
            let image = images.entry(name.to_owned()).or_insert_with(|| LinearImage::black(width, height));
            for (pixel, value) in image.pixels.iter_mut().zip(channel.sample_data.values_as_f32()) {
                pixel[ch] = value;
            }
        }
    }
    let channels = file.layer_data.iter().map(|layer| layer.channel_data.list.len()).sum::<usize>();
    assert_eq!(channels, 3 * images.len(), "each has red, green and blue");
    images
}

fn sum_of<'a>(images: impl Iterator<Item = &'a LinearImage>, like: &LinearImage) -> LinearImage {
    images.fold(LinearImage::black(like.width, like.height), |mut sum, image| {
        let values = sum.pixels.as_flattened_mut().iter_mut().zip(image.values());
        values.for_each(|(sum, value)| *sum += value);
        sum
    })
}

/// How light came, of a matrix: emission, direct and indirect light under any look.
#[test]
fn passes_add_up_to_the_picture() {
    let folder = room();
    let at = folder.path();
    for look in [&[][..], &["-l", "look.toml", "--look", "lamp"], &["--on", "env*"]] {
        relight(at, &[&["room.ltm", "-o", "whole.exr"], look].concat());
        let said = relight(at, &[&["room.ltm", "-o", "passes.exr", "--layers", "passes"], look].concat());
        assert!(said.contains("direct and indirect"), "{said}");
        let whole = read_image(&at.join("whole.exr")).unwrap();
        let mut passes = layers_of(&at.join("passes.exr"));
        let picture = passes.remove("").expect("the picture itself");
        assert!(largest_difference(&picture, &whole) < 1e-4, "{look:?}");
        assert_eq!(passes.keys().map(String::as_str).collect::<Vec<_>>(), ["Direct", "Emission", "Indirect"]);
        assert!(largest_difference(&sum_of(passes.values(), &whole), &whole) < 1e-4, "{look:?}");
        // The floor is seen under the sky, and nothing stands around that could send light back to it.
        let light = |name: &str| passes[name].values().iter().sum::<f32>() / whole.values().iter().sum::<f32>();
        assert!(light("Direct") > 0.02 && light("Indirect").abs() < 1e-4, "{look:?}: {}", light("Indirect"));
        assert_eq!(light("Emission") > 0.02, !look.contains(&"lamp"), "{look:?}: {}", light("Emission"));
    }
}

#[test]
fn layers_add_up_to_the_picture() {
    let folder = room();
    let at = folder.path();
    relight(at, &["room.ltc", "-o", "whole.exr"]);
    let whole = read_image(&at.join("whole.exr")).unwrap();
    for layers in [&["--layers", "lights"][..], &["--layers", "groups", "-l", "look.toml"]] {
        relight(at, &[&["room.ltc", "-o", "layers.exr"], layers].concat());
        let mut images = layers_of(&at.join("layers.exr"));
        let picture = images.remove("").expect("the picture itself");
        assert_eq!(images.len(), 2);
        let sum = sum_of(images.values(), &whole);
        assert!(largest_difference(&sum, &picture) < 1e-6, "{layers:?}");
        // Each is a sum of the same f32 products.
        assert!(largest_difference(&sum, &whole) < 1e-4, "{layers:?}");
    }
}

#[test]
fn a_sequence_goes_from_key_to_key() {
    let folder = room();
    let at = folder.path();
    let said = relight(at, &["room.ltc", "-l", "look.toml", "-o", "f-###.png", "--fps", "2"]);
    assert!(said.contains("3 frames"), "{said}");
    let brightness = |frame: &str| read_image(&at.join(frame)).unwrap().luminances().map(f64::from).sum::<f64>();
    let frames = ["f-000.png", "f-001.png", "f-002.png"].map(brightness);
    assert!(frames[0] < 1e-6 && frames[0] < frames[1] && frames[1] < frames[2], "{frames:?}");
    assert!(!at.join("f-003.png").exists());
    relight(at, &["room.ltc", "-l", "look.toml", "-o", "g-#.exr", "--fps", "2", "--frames", "2..3"]);
    assert!(at.join("g-2.exr").exists() && !at.join("g-1.exr").exists());
}

#[test]
fn pictures_are_exposed_balanced_and_shown_in_false_colours() {
    let folder = room();
    let at = folder.path();
    let png = |arguments: &[&str]| {
        let said = relight(at, &[&["room.ltc", "-o", "a.png"], arguments].concat());
        (fs::read(at.join("a.png")).unwrap(), said)
    };
    let (automatic, said) = png(&[]);
    let stops = said.split("exposed by ").nth(1).unwrap().split(' ').next().unwrap().to_owned();
    assert!(stops.parse::<f32>().is_ok(), "{said}");
    let mut seen = vec![automatic];
    for arguments in [
        &["--tone", "agx"][..],
        &["--tone", "filmic"],
        &["--tone", "neutral"],
        &["--exposure", "-2"],
        &["--white-balance", "3000"],
        &["--false-colour", "luminance"],
        &["--false-colour", "illuminance", "--reflectance", "0.5", "--scale", "1..100"],
    ] {
        let (bytes, _) = png(arguments);
        assert!(!seen.contains(&bytes), "{arguments:?} changes the picture");
        seen.push(bytes);
    }
}

/// What a picture shows is what its options say, measured in the PNG that was written.
#[test]
fn pictures_show_what_was_asked_for() {
    let folder = room();
    let at = folder.path();
    fs::write(at.join("warm.toml"), "base = 'off'\n[[light]]\nname = 'lamp'\non = true\ncolor = { kelvin = 3000 }\n")
        .unwrap();
    let show = |name: &str, arguments: &[&str]| {
        relight(at, &[&["room.ltc", "-o", name, "-l", "warm.toml"], arguments].concat());
        read_image(&at.join(name)).unwrap()
    };
    let radiance = show("a.exr", &[]);
    let stops = (0.5 / radiance.luminances().fold(0.0, f32::max)).log2();
    let [bright, dark] = [stops, stops - 2.0].map(|stops| show("a.png", &["--exposure", &stops.to_string()]));
    let gain = stops.exp2();
    let mut compared = 0;
    for ((linear, bright), dark) in radiance.values().iter().zip(bright.values()).zip(dark.values()) {
        // One of 255 steps of sRGB is at most 1 % of white, and less of what is dark.
        let expected = linear * gain;
        if (0.0..0.99).contains(&expected) {
            assert!((bright - expected).abs() < 0.006, "{bright} for {expected}");
            assert!((dark - expected / 4.0).abs() < 0.006, "{dark} for a quarter of {expected}");
            compared += usize::from(expected > 0.1);
        }
    }
    assert!(compared > 50, "{compared} values were bright enough to tell");
    // Light of 3000 K is orange, and white where the eye is used to it.
    let stops = (stops - 2.0).to_string();
    let balanced = show("b.png", &["--exposure", &stops, "--white-balance", "3000"]);
    let orange = dark.pixels.iter().filter(|[r, _, b]| *r > 0.03 && r > &(2.0 * b)).count();
    let grey = |[r, g, b]: &[f32; 3]| (r - g).abs() < 0.01 && (g - b).abs() < 0.01;
    assert!(orange > 20 && balanced.pixels.iter().all(grey), "{orange} pixels were orange");
    assert!(balanced.luminances().fold(0.0, f32::max) > 0.05);
    // False colours stand for luminance in cd/m²: above the scale all are one colour, below it another.
    let nits: Vec<f32> = radiance.luminances().map(|v| v * ltm::image::LUMENS_PER_WATT).collect();
    // Much of the picture is dark.
    let mut sorted: Vec<f32> = nits.iter().copied().filter(|v| *v > 0.0).collect();
    sorted.sort_by(f32::total_cmp);
    let (low, high) = (sorted[sorted.len() / 4], sorted[sorted.len() * 3 / 4]);
    assert!(low < 0.9 * high, "{low} {high}");
    let shown = show("c.png", &["--false-colour", "luminance", "--scale", &format!("{low}..{high}")]);
    let colours = |of: &dyn Fn(f32) -> bool| {
        let mut colours: Vec<_> = nits.iter().zip(&shown.pixels).filter(|(v, _)| of(**v)).map(|(_, p)| *p).collect();
        colours.sort_by(|a, b| a.partial_cmp(b).unwrap());
        colours.dedup();
        colours
    };
    let (top, bottom) = (colours(&|v| v > 1.001 * high), colours(&|v| v < 0.999 * low));
    assert!(top.len() == 1 && bottom.len() == 1 && top != bottom, "{top:?} {bottom:?}");
    assert!(
        colours(&|v| v > 1.1 * low && v < 0.9 * high).iter().all(|colour| *colour != top[0] && *colour != bottom[0])
    );
}

#[test]
fn a_budget_gives_the_same_picture_and_one_that_is_too_small_is_refused() {
    let folder = room();
    let at = folder.path();
    relight(at, &["room.ltc", "-o", "a.exr"]);
    let said = relight(at, &["room.ltc", "-o", "b.exr", "--memory", "64MiB"]);
    assert!(said.contains("chunks") && said.contains("read"), "{said}");
    assert_eq!(fs::read(at.join("a.exr")).unwrap(), fs::read(at.join("b.exr")).unwrap());
    relight(at, &["room.ltm", "-o", "c.exr", "--memory", "64MiB"]);
    for input in ["room.ltc", "room.ltm"] {
        refused(at, &[input, "-o", "d.exr", "--memory", "1MiB"], &["1.0 MiB", "memory"]);
    }
}

#[test]
fn damage_is_reported_and_the_rest_is_shown() {
    let folder = room();
    let at = folder.path();
    relight(at, &["room.ltc", "-o", "a.exr"]);
    let mut bytes = fs::read(at.join("room.ltc")).unwrap();
    // The first chunk stands behind the header.
    bytes[70] ^= 0xff;
    fs::write(at.join("bad.ltc"), bytes).unwrap();
    for budget in [&[][..], &["--memory", "64MiB"]] {
        let command = [&["relight", "--device", "cpu", "bad.ltc", "-o", "b.exr"], budget].concat();
        refused(at, &[&["bad.ltc", "-o", "b.exr"], budget].concat(), &["block 0", "--allow-damage"]);
        assert!(!at.join("b.exr").exists(), "only where it is asked for");
        let output = run(at, "ltm", &[&command[..], &["--allow-damage"]].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(4) && error.contains("block 0"), "{error}");
        let (whole, hurt) = (read_image(&at.join("a.exr")).unwrap(), read_image(&at.join("b.exr")).unwrap());
        let differ = whole.pixels.iter().zip(&hurt.pixels).filter(|(a, b)| a != b).count();
        assert!((1..=64).contains(&differ), "{differ} pixels differ, of a block of 8 × 8");
        fs::remove_file(at.join("b.exr")).unwrap();
    }
}

#[test]
fn what_does_not_go_together_is_refused_in_one_line() {
    let folder = room();
    let at = folder.path();
    let look = ["-l", "look.toml"];
    refused(at, &["room.ltc", "-o", "a.png", "--on", "lmap"], &["'lmap'", "'lamp'"]);
    refused(at, &[&["room.ltc", "-o", "a.png", "--look", "lmap"][..], &look].concat(), &["'lmap'", "'lamp'"]);
    refused(at, &["room.ltc", "-o", "a.jpg"], &["a.jpg", ".exr", ".png"]);
    refused(at, &["room.ltc", "-o", "a.exr", "--tone", "agx"], &["EXR"]);
    refused(at, &["room.ltc", "-o", "a.png", "--layers", "lights"], &["EXR"]);
    refused(at, &["room.ltc", "-o", "a.exr", "--layers", "groups"], &["[groups]"]);
    refused(at, &["room.ltc", "-o", "a.exr", "--layers", "passes"], &["room.ltc", "no passes", ".ltm"]);
    refused(at, &["room.ltc", "-o", "a-##.png"], &["[[key]]"]);
    refused(at, &[&["room.ltc", "-o", "a-##.png", "--frames", "20..40"][..], &look].concat(), &["20..40", "0..26"]);
    refused(at, &["room.ltc", "-o", "a.png", "--false-colour", "illuminance"], &["--reflectance"]);
    refused(at, &["room.ltc", "-o", "a.png", "--white-balance", "3"], &["3 K"]);
    // What colours of black bodies are not told apart beyond.
    refused(at, &["room.ltc", "-o", "a.png", "--white-balance", "1200"], &["1200 K", "1667"]);
    fs::create_dir(at.join("folder.png")).unwrap();
    refused(at, &["room.ltc", "-o", "folder.png"], &["folder.png", "is a folder"]);
    assert!(!at.join("a.png").exists() && !at.join("a.exr").exists());
}
