//! Look files: what a designer writes becomes the weights that it means, and errors say what to write instead.

use std::fs;
use std::path::PathBuf;

use ltm::image::{LinearImage, luminance, write_exr};
use ltm::light::{Light, LightBasis, LightKind, LightUnit};
use ltm::look::{self, Look};

/// Two lamps, a panel of 4 × 4 texels, and a sky of 8 × 4.
fn basis() -> LightBasis {
    let mut basis = LightBasis::new();
    let light = |name: &str, kind, count: usize| Light {
        name: name.into(),
        kind,
        unit: LightUnit::Radiance,
        emission: [2.0; 3],
        first_column: 0,
        places: vec![[0.0; 3]; count],
        extents: vec![1.0; count],
    };
    basis.push(light("lamp left", LightKind::Lamp, 1)).unwrap();
    basis.push(light("lamp right", LightKind::Lamp, 1)).unwrap();
    basis.push(light("panel", LightKind::AreaTexels { across: 4, down: 4 }, 16)).unwrap();
    let mut sky = light("sky", LightKind::LatLong { across: 8, down: 4 }, 32);
    for (texel, (place, extent)) in sky.places.iter_mut().zip(&mut sky.extents).enumerate() {
        let (turn, polar) = ((texel % 8) as f32 + 0.5, (texel / 8) as f32 + 0.5);
        let (turn, polar) = (turn * std::f32::consts::TAU / 8.0, polar * std::f32::consts::PI / 4.0);
        *place = [polar.sin() * turn.sin(), polar.cos(), -polar.sin() * turn.cos()];
        let edge = std::f32::consts::PI / 8.0;
        *extent = std::f32::consts::TAU / 8.0 * ((polar - edge).cos() - (polar + edge).cos());
    }
    basis.push(sky).unwrap();
    basis
}

fn folder_with(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    (folder, path)
}

fn load(text: &str) -> ltm::Result<Look> {
    let (_folder, path) = folder_with("look.toml", text);
    look::load(&path, &basis())
}

fn refused(text: &str) -> String {
    load(text).expect_err("must be refused").to_string()
}

#[test]
fn an_empty_file_is_the_light_of_the_scene() {
    assert!(load("").unwrap().lighting().weights().iter().all(|w| *w == [2.0; 3]));
    assert!(load("base = \"off\"").unwrap().lighting().weights().iter().all(|w| *w == [0.0; 3]));
}

#[test]
fn rules_name_lights_globs_and_groups() {
    let look = load(
        "[groups]\nboth = ['lamp left', 'panel']\n[[light]]\nname = 'lamp*'\nstops = 1\n[[light]]\nname = 'both'\non = false\n",
    )
    .unwrap();
    let weights = look.lighting().weights();
    assert_eq!((weights[0], weights[1], weights[2], weights[18]), ([0.0; 3], [4.0; 3], [0.0; 3], [2.0; 3]));
}

#[test]
fn a_colour_keeps_the_luminance_and_an_intensity_sets_it() {
    for color in ["{ kelvin = 2700 }", "{ srgb = '#ff8800' }", "{ linear = [3, 2, 1] }"] {
        let look = load(&format!("[[light]]\nname = 'lamp left'\ncolor = {color}\n")).unwrap();
        let [r, g, b] = look.lighting().weights()[0];
        assert!(r > g && g > b && (luminance([r, g, b]) - 2.0).abs() < 1e-4, "{color}: {r} {g} {b}");
    }
    let look = load("base = 'off'\n[[light]]\nname = 'lamp left'\nintensity = 40\n").unwrap();
    assert!(look.lighting().weights()[0].iter().all(|v| (v - 40.0).abs() < 1e-4));
}

#[test]
fn shapes_light_the_texels_that_they_cover() {
    let shape = |shape: &str| {
        let look = load(&format!("[[light]]\nname = 'panel'\nshape = {shape}\n")).unwrap();
        look.lighting().weights()[2..18].iter().map(|w| w[0]).collect::<Vec<_>>()
    };
    let rectangle = shape("{ kind = 'rectangle', center = [0.25, 0.5], size = [0.5, 1.0] }");
    assert!(rectangle.iter().enumerate().all(|(i, v)| *v == if i % 4 < 2 { 2.0 } else { 0.0 }), "{rectangle:?}");
    let disc: f32 = shape("{ kind = 'disc', center = [0.5, 0.5], radius = 0.4 }").iter().sum();
    // 16 texels of weight 2 times the disc's area, which 32 × 32 points find to about a hundredth.
    assert!((disc / 32.0 - std::f32::consts::PI * 0.16).abs() < 0.01, "{disc}");
    let gradient = shape("{ kind = 'gradient', from = [0, 0], to = [1, 0] }");
    assert!(gradient.windows(2).take(3).all(|w| w[0] < w[1]));
}

#[test]
fn an_image_lies_over_the_texels_where_it_is_put() {
    let (folder, path) = folder_with(
        "look.toml",
        "[[light]]\nname = 'panel'\nimage = { file = 'pattern.exr', place = [0, 0, 1, 0.5] }\n",
    );
    let pattern = LinearImage { width: 2, height: 1, pixels: vec![[1.0, 0.0, 0.0], [0.0, 0.0, 3.0]] };
    write_exr(&folder.path().join("pattern.exr"), &pattern).unwrap();
    let look = look::load(&path, &basis()).unwrap();
    let weights = &look.lighting().weights()[2..18];
    assert_eq!((weights[1], weights[6], weights[12]), ([2.0, 0.0, 0.0], [0.0, 0.0, 6.0], [0.0; 3]));
}

#[test]
fn an_environment_keeps_its_energy_under_any_rotation() {
    let map = LinearImage {
        width: 16,
        height: 8,
        pixels: (0..128).map(|i| [1.0 + i as f32, (i % 16) as f32, if i == 37 { 1000.0 } else { 0.0 }]).collect(),
    };
    let basis = basis();
    let sky = basis.find("sky").unwrap();
    let energy = |degrees: f32| {
        let text =
            format!("[[light]]\nname = 'sky'\nenvironment = {{ file = 'sky.exr', rotation_degrees = {degrees} }}\n");
        let (folder, path) = folder_with("look.toml", &text);
        write_exr(&folder.path().join("sky.exr"), &map).unwrap();
        let look = look::load(&path, &basis).unwrap();
        let weights = &look.lighting().weights()[18..];
        [0, 1, 2].map(|ch: usize| weights.iter().zip(&sky.extents).map(|(w, e)| f64::from(w[ch] * e)).sum::<f64>())
    };
    let mut expected = [0.0; 3];
    for (i, pixel) in map.pixels.iter().enumerate() {
        let row = (i / 16) as f64;
        let solid = std::f64::consts::TAU / 16.0
            * ((row * std::f64::consts::PI / 8.0).cos() - ((row + 1.0) * std::f64::consts::PI / 8.0).cos());
        (0..3).for_each(|ch| expected[ch] += f64::from(pixel[ch]) * solid);
    }
    for degrees in [0.0, 10.0, 45.0, 200.0, -77.0] {
        for (has, expected) in energy(degrees).into_iter().zip(expected) {
            // Weights are rounded to 32 bits.
            assert!((has / expected - 1.0).abs() < 1e-6, "{degrees}: {has} for {expected}");
        }
    }
}

/// A room under an environment of this mapping, turned, that the scene file lights by its map.
fn lit_by_a_map(folder: &std::path::Path, mapping: &str) -> ltm::scene::LoadedScene {
    fs::write(folder.join("floor.obj"), "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 4 3 2\n").unwrap();
    let text = format!(
        "geometry = [\"floor.obj\"]\n[camera]\neye = [0, 1, 4]\nlook_at = [0, 0, 0]\nwidth = 8\nheight = 8\n\
         [[light]]\nkind = \"environment\"\nname = \"sky\"\nmap = \"sky.exr\"\nturn_degrees = 70\n{mapping}\n"
    );
    fs::write(folder.join("scene.toml"), text).unwrap();
    ltm::scene::load(&folder.join("scene.toml")).unwrap()
}

#[test]
fn a_map_gives_the_same_weights_from_a_look_as_from_the_scene_file() {
    let folder = tempfile::tempdir().unwrap();
    // Coarser and finer than the texels, with a sun.
    for (width, height) in [(20, 10), (150, 75)] {
        let pixels =
            (0..width * height).map(|i| [1.0 + (i % 17) as f32, if i == 37 { 1e4 } else { 0.5 }, 0.25]).collect();
        write_exr(&folder.path().join("sky.exr"), &LinearImage { width, height, pixels }).unwrap();
        for mapping in ["texels = [12, 6]", "mapping = \"octahedral\"\ntexels = [9, 9]"] {
            let loaded = lit_by_a_map(folder.path(), mapping);
            let path = folder.path().join("look.toml");
            fs::write(&path, "[[light]]\nname = 'sky'\nenvironment = { file = 'sky.exr' }\n").unwrap();
            let look = look::load(&path, &loaded.scene.basis).unwrap();
            assert_eq!(look.lighting().weights(), loaded.lighting.weights(), "{width} × {height}, {mapping}");
        }
    }
}

#[test]
fn a_sun_stands_in_the_column_nearest_to_its_direction() {
    let look = load("[[light]]\nname = 'sky'\nsun = [0, 1, -0.5]\n").unwrap();
    let lit: Vec<_> = look.lighting().weights()[18..].iter().enumerate().filter(|(_, w)| w[0] > 0.0).collect();
    assert_eq!(lit.len(), 1);
    // All the sky's irradiance, 2 over 4π, is in it.
    let basis = basis();
    let energy = lit[0].1[0] * basis.find("sky").unwrap().extents[lit[0].0];
    assert!((energy - 8.0 * std::f32::consts::PI).abs() < 1e-3, "{energy}");
}

#[test]
fn of_several_suns_the_nearest_one_shines() {
    let mut basis = basis();
    for (i, place) in [[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.8, 0.0, 0.6]].into_iter().enumerate() {
        let (kind, unit) = (LightKind::Sun, LightUnit::Irradiance);
        let (emission, places, extents) = ([if i == 1 { 0.0 } else { 5.0 }; 3], vec![place], vec![1e-4]);
        basis.push(Light { name: format!("sun {i}"), kind, unit, emission, first_column: 0, places, extents }).unwrap();
    }
    let ruled = |direction: &str, rule: &str| {
        let (_folder, path) =
            folder_with("look.toml", &format!("[[light]]\nname = 'sun *'\nsun = {direction}\n{rule}\n"));
        look::load(&path, &basis).unwrap().lighting().weights()[50..].iter().map(|w| w[0]).collect::<Vec<_>>()
    };
    let with = |direction: &str| ruled(direction, "stops = 1");
    assert_eq!(with("[0, 3, 0.1]"), [10.0, 0.0, 0.0]);
    assert_eq!(with("[4, 0.5, 4]"), [0.0, 0.0, 10.0]);
    // One that is dark in the scene stays what the scene makes of it.
    assert_eq!(with("[0.7, 0.7, 0]"), [0.0, 0.0, 0.0]);
    // What else the rule says is of the one that shines.
    assert_eq!(ruled("[0, 3, 0.1]", "on = true"), [5.0, 0.0, 0.0]);
    assert_eq!(ruled("[0, 3, 0.1]", "intensity = 4.0"), [4.0, 0.0, 0.0]);
}

#[test]
fn the_scenes_own_map_is_its_lighting() {
    let mut basis = basis();
    basis.set_scene_weights(18, (0..32).map(|i| [i as f32; 3]).collect()).unwrap();
    let (_folder, path) = folder_with("look.toml", "[[light]]\nname = 'sky'\nstops = 1\n");
    let look = look::load(&path, &basis).unwrap();
    assert_eq!((look.lighting().weights()[0], look.lighting().weights()[18 + 7]), ([2.0; 3], [14.0; 3]));
    let (_folder, path) = folder_with("look.toml", "base = 'off'\n[[light]]\nname = 'sky'\non = true\n");
    assert_eq!(look::load(&path, &basis).unwrap().lighting().weights()[18 + 7], [7.0; 3]);
}

#[test]
fn groups_share_out_the_columns() {
    let look = load("[groups]\na = ['lamp*']\nb = ['lamp left', 'panel']\n").unwrap();
    assert_eq!(look.groups()[0], ("a".to_owned(), vec![0, 1]));
    assert_eq!(look.groups()[1], ("b".to_owned(), (2..18).collect()));
    assert!(refused("[groups]\na = ['lmap left']\n").contains("'lamp left'"));
    // A light that fits two patterns of a group gets its rule once.
    let twice = load("[groups]\nc = ['lamp*', 'lamp left']\n[[light]]\nname = 'c'\nstops = -1\n").unwrap();
    assert_eq!(twice.lighting().weights()[..2], [[1.0; 3]; 2]);
}

#[test]
fn named_looks_stand_on_the_rules_above_and_keys_blend_them() {
    let look = load(
        "[[light]]\nname = 'panel'\non = false\n[[look]]\nname = 'day'\n[[look]]\nname = 'night'\n[[look.light]]\nname = '*'\nstops = -1\n\
         [[key]]\ntime_secs = 0\nlook = 'day'\n[[key]]\ntime_secs = 1\nlook = 'night'\n",
    )
    .unwrap();
    assert_eq!(look.names().collect::<Vec<_>>(), ["day", "night"]);
    let night = look.named("night").unwrap().weights();
    assert_eq!((night[0], night[2]), ([1.0; 3], [0.0; 3]));
    let frames = look.frames(4.0).unwrap();
    let weight = |frame: usize| frames.lighting(frame).unwrap().weights()[0][0];
    assert_eq!((0..frames.count()).map(weight).collect::<Vec<_>>(), [2.0, 1.75, 1.5, 1.25, 1.0]);
    assert!(frames.lighting(5).is_err());
    // Times that are no binary fractions: the last key has its frame.
    let text = "[[look]]\nname = 'a'\n[[look]]\nname = 'b'\n[[look.light]]\nname = '*'\nstops = -1\n\
                [[key]]\ntime_secs = 0.3\nlook = 'a'\n[[key]]\ntime_secs = 0.9\nlook = 'b'\n";
    let tenths = load(text).unwrap();
    let frames = tenths.frames(10.0).unwrap();
    assert_eq!(frames.count(), 7);
    let last = frames.lighting(6).unwrap().weights()[0][0];
    assert!((last - 1.0).abs() < 1e-4, "{last}");
    let late = load(&text.replace("0.3", "0").replace("0.9", "600.1")).unwrap();
    assert_eq!(late.frames(60.0).unwrap().count(), 36_007);
    assert!(look.named("nigth").err().unwrap().to_string().contains("'night'"));
    assert!(look.frames(0.0).is_err());
}

#[test]
fn json_says_the_same() {
    let (_folder, path) = folder_with("look.json", r#"{"light": [{"name": "lamp left", "stops": 1}]}"#);
    assert_eq!(look::load(&path, &basis()).unwrap().lighting().weights()[0], [4.0; 3]);
}

/// Whoever wrote a look may be a stranger: it reads its own folder, and nothing else unless that is allowed.
#[test]
fn images_outside_of_the_looks_folder_are_read_only_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("looks/below")).unwrap();
    let image = LinearImage { width: 1, height: 1, pixels: vec![[0.5; 3]] };
    for name in ["outside.exr", "looks/inside.exr", "looks/below/deep.exr"] {
        write_exr(&at(name), &image).unwrap();
    }
    std::os::unix::fs::symlink(at("outside.exr"), at("looks/link.exr")).unwrap();
    let path = at("looks/look.toml");
    let write = |file: &str| {
        let sky = format!("[[light]]\nname = 'sky'\nenvironment = {{ file = '{file}' }}\n");
        fs::write(&path, format!("[[light]]\nname = 'panel'\nimage = {{ file = '{file}' }}\n{sky}")).unwrap();
    };
    for file in ["inside.exr", "below/deep.exr", "../looks/inside.exr"] {
        write(file);
        assert_eq!(look::load(&path, &basis()).unwrap().lighting().weights()[2], [1.0; 3], "{file}");
    }
    for file in ["../outside.exr", "link.exr", &at("outside.exr").display().to_string()] {
        write(file);
        let said = look::load(&path, &basis()).unwrap_err().to_string();
        assert!(said.contains("outside") && said.contains("`allow_outside`"), "{file}: {said}");
        let allowed = look::load_reaching_outside(&path, &basis()).unwrap();
        assert_eq!(allowed.lighting().weights()[2], [1.0; 3], "{file}");
    }
}

#[test]
fn images_that_are_pipes_or_too_large_are_refused_at_once() {
    let (folder, path) = folder_with("look.toml", "[[light]]\nname = 'panel'\nimage = { file = 'x.tga' }\n");
    let image = folder.path().join("x.tga");
    assert!(std::process::Command::new("mkfifo").arg(&image).status().unwrap().success());
    let said = look::load(&path, &basis()).unwrap_err().to_string();
    assert!(said.contains("x.tga") && said.contains("is a pipe"), "{said}");
    fs::remove_file(&image).unwrap();
    // Uncompressed true colour of 16,384² pixels, without any: 18 bytes for 4 GiB.
    let mut header = [0u8; 18];
    (header[2], header[16], header[13], header[15]) = (2, 24, 0x40, 0x40);
    fs::write(&image, header).unwrap();
    let error = look::load(&path, &basis()).unwrap_err();
    assert!(matches!(error, ltm::Error::Resources { .. }) && error.to_string().contains("x.tga"), "{error}");
}

#[test]
fn a_group_of_groups_is_refused_by_name() {
    let said = refused("[groups]\na = ['b']\nb = ['a']\n[[light]]\nname = 'a'\nstops = 1\n");
    assert!(said.contains("'a' names 'b', a group") && !said.contains("nearest"), "{said}");
}

#[test]
fn errors_name_the_light_and_the_nearest_names() {
    assert!(refused("[[light]]\nname = 'pannel'\n").contains("nearest names are 'panel'"));
    assert!(refused("[[light]]\nname = 'panel'\nbrightness = 3\n").contains("brightness"));
    let rules = [
        "color = { linear = [0, 0, 0] }",
        "color = { srgb = 'red' }",
        "color = { kelvin = 3 }",
        "intensity = -1",
        "intensity = nan",
        "stops = 1000",
        "sun = [0, 1, 0]",
        "environment = { file = 'x.exr' }",
        "image = { file = 'x.exr', place = [1, 0, 0, 1] }",
    ];
    for rule in rules {
        assert!(refused(&format!("[[light]]\nname = 'panel'\n{rule}\n")).contains("'panel'"), "{rule}");
    }
    assert!(refused("[[light]]\nname = 'panel'\nimage = { file = 'x.exr' }\n").contains("x.exr"));
    assert!(refused("[[key]]\ntime_secs = 0\nlook = 'x'\n").contains("'x'"));
    assert!(refused("[[light]\n").contains("line 1"));
    for color in ["2700", "'#ffcc88'", "{ kelvins = 2700 }", "[1, 1, 1]"] {
        let error = refused(&format!("[[light]]\nname = 'panel'\ncolor = {color}\n"));
        assert!(error.contains("line 3") && error.contains("{ kelvin = 2700 }"), "{color}: {error}");
    }
}
