//! Light groups in OpenEXR files: of one rendering in several files, under other names, and cleaned in a file like their own.

use std::collections::BTreeMap;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes,
    IntegerBounds, Layer, LayerAttributes, LineOrder, SmallVec, Text, Vec2, WritableImage, f16,
    read_all_flat_layers_from_file,
};
use ltm::image::{FeaturePasses, LightRow, LightSet};
use ltm::pipeline::{self, CleanOptions, ImageNoise, ImportedMatrix, PackOptions, SecondImages};
use ltm::resources::NoProgress;
use ltm::{Error, Result};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;
const PIXELS: usize = WIDTH * HEIGHT;

/// A number between 0 and 1 for each index and seed.
fn random(index: usize, seed: usize) -> f32 {
    let mixed = (index as u64 ^ (seed as u64) << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1u64 << 24) as f32
}

/// The light of a lamp at a pixel: a soft spot in its own place.
fn truth(lamp: usize, pixel: usize) -> [f32; 3] {
    let (x, y) = ((pixel % WIDTH) as f32 / WIDTH as f32, (pixel / WIDTH) as f32 / HEIGHT as f32);
    let (from_x, from_y) = ([0.2, 0.8, 0.5][lamp], [0.3, 0.4, 0.8][lamp]);
    let light = 1.0 / (0.1 + (x - from_x).powi(2) + (y - from_y).powi(2));
    [[1.0, 0.8, 0.5], [0.4, 0.6, 1.0], [0.7, 0.7, 0.7]][lamp].map(|c| c * light)
}

/// The same with noise: most samples miss, some find three times the light.
fn noisy(lamp: usize, pixel: usize, seed: usize) -> [f32; 3] {
    let found = (0..8).filter(|sample| random(pixel * 8 + sample, 31 * seed + lamp) < 1.0 / 3.0).count();
    truth(lamp, pixel).map(|c| c * 3.0 * found as f32 / 8.0)
}

const LAMPS: [&str; 3] = ["key", "fill light", "照明"];

fn plane(of: impl Fn(usize) -> f32, is_half: bool) -> FlatSamples {
    let values = (0..PIXELS).map(of);
    if is_half { FlatSamples::F16(values.map(f16::from_f32).collect()) } else { FlatSamples::F32(values.collect()) }
}

fn channel(name: String, samples: FlatSamples) -> AnyChannel<FlatSamples> {
    let mut channel = AnyChannel::new("", samples);
    channel.name = Text::from_slice_unchecked(name.as_bytes());
    channel
}

/// A multi-layer file as Blender writes it, with what is neither light nor sum.
fn write(path: &Path, seed: usize, lamps: &[usize], encoding: Encoding, is_half: bool) {
    let mut channels = Vec::new();
    let rounded = |v: f32| if is_half { f16::from_f32(v).to_f32() } else { v };
    for (colour, letter) in ["R", "G", "B"].into_iter().enumerate() {
        for &lamp in lamps {
            let samples = plane(|pixel| noisy(lamp, pixel, seed)[colour], is_half);
            channels.push(channel(format!("V.Combined_{}.{letter}", LAMPS[lamp]), samples));
        }
        let sum = |pixel| (0..3).map(|lamp| rounded(noisy(lamp, pixel, seed)[colour])).sum::<f32>();
        channels.push(channel(format!("V.Combined.{letter}"), plane(sum, is_half)));
        channels.push(channel(format!("V.Denoising Albedo.{letter}"), plane(|_| 0.5, is_half)));
        channels.push(channel(format!("V.CryptoObject00.{letter}"), plane(|pixel| random(pixel, 99 + colour), false)));
    }
    channels.push(channel("V.Combined.A".into(), plane(|pixel| random(pixel, 77), is_half)));
    channels.push(channel("V.Depth.Z".into(), FlatSamples::U32((0..PIXELS as u32).collect())));
    channels.sort_by(|a, b| a.name.as_slice().cmp(b.name.as_slice()));
    let mut attributes =
        LayerAttributes { software_name: Some("another program".into()), ..LayerAttributes::default() };
    let said = AttributeValue::Text("kept".into());
    attributes.other.insert("cryptomatte/1/name".into(), said);
    let layer = Layer::new((WIDTH, HEIGHT), attributes, encoding, AnyChannels { list: SmallVec::from_vec(channels) });
    let frame = ImageAttributes::new(IntegerBounds::from_dimensions((WIDTH, HEIGHT)));
    Image::new(frame, layer).write().to_file(path).unwrap();
}

/// The values of a file's channels, as they are stored.
fn channels_of(path: &Path) -> BTreeMap<String, FlatSamples> {
    let image = read_all_flat_layers_from_file(path).unwrap();
    let list = image.layer_data.into_iter().flat_map(|layer| layer.channel_data.list);
    list.map(|channel| (String::from_utf8(channel.name.as_slice().to_vec()).unwrap(), channel.sample_data)).collect()
}

fn clean(first: &Path, second: Option<&Path>, to: &Path) -> Result<()> {
    let set = LightSet::open(first, None)?;
    let other = second.map(|path| LightSet::open(path, None)).transpose()?;
    let passes = FeaturePasses::find(first)?;
    let noise = match &other {
        Some(set) => ImageNoise::Measured(SecondImages { set, features: [passes.as_ref(), None] }),
        None => ImageNoise::Estimated(passes.as_ref()),
    };
    let matrix = ImportedMatrix::read(
        &set,
        noise,
        "test",
        to,
        32,
        &PackOptions { denoise: true, ..Default::default() },
        &NoProgress,
    )?;
    pipeline::clean_images(&matrix, &set, to, CleanOptions::default(), &NoProgress)
}

const ENCODINGS: [Encoding; 2] = [
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing },
    Encoding { compression: Compression::PIZ, blocks: Blocks::Tiles(Vec2(48, 40)), line_order: LineOrder::Increasing },
];

/// Root mean square of what a light of a file is from the truth, over that of the truth.
fn error_of(found: &BTreeMap<String, FlatSamples>, lamp: usize) -> f64 {
    let (mut square, mut whole) = (0.0, 0.0);
    for (colour, letter) in ["R", "G", "B"].into_iter().enumerate() {
        let name = format!("V.Combined_{}.{letter}", LAMPS[lamp]);
        for (pixel, value) in found[&name].values_as_f32().enumerate() {
            let wanted = f64::from(truth(lamp, pixel)[colour]);
            square += (f64::from(value) - wanted).powi(2);
            whole += wanted * wanted;
        }
    }
    (square / whole).sqrt()
}

#[test]
fn cleaning_gives_the_same_file_back_with_clean_groups_that_add_up() {
    for (encoding, is_half) in [(ENCODINGS[0], false), (ENCODINGS[1], true)] {
        let folder = tempfile::tempdir().unwrap();
        let [first, second, to] = ["1.exr", "2.exr", "clean.exr"].map(|name| folder.path().join(name));
        write(&first, 1, &[0, 1, 2], encoding, is_half);
        write(&second, 2, &[0, 1, 2], encoding, is_half);
        clean(&first, Some(&second), &to).unwrap();
        let (before, after) = (channels_of(&first), channels_of(&to));
        assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
        for (name, samples) in &before {
            let is_lit = name.starts_with("V.Combined") && name != "V.Combined.A";
            assert_eq!(samples != &after[name], is_lit, "{name}");
        }
        for (lamp, name) in LAMPS.iter().enumerate() {
            let errors = [error_of(&before, lamp), error_of(&after, lamp)];
            // Two renderings alone would leave 1/√2 of the noise of one.
            assert!(errors[1] < 0.25 * errors[0], "{name} {errors:?}");
        }
        for letter in ["R", "G", "B"] {
            let value = |name: String, pixel: usize| f64::from(after[&name].values_as_f32().nth(pixel).unwrap());
            for pixel in (0..PIXELS).step_by(251) {
                let sum: f64 = LAMPS.iter().map(|lamp| value(format!("V.Combined_{lamp}.{letter}"), pixel)).sum();
                let stored = if is_half { f64::from(f16::from_f64(sum).to_f32()) } else { f64::from(sum as f32) };
                assert_eq!(value(format!("V.Combined.{letter}"), pixel), stored, "{letter} at {pixel}");
            }
        }
        let [old, new] = [&first, &to].map(|path| exr::meta::MetaData::read_from_file(path, true).unwrap());
        assert_eq!(old.headers, new.headers, "attributes, types, tiles and compression");
        // Nothing else is left in the folder, and a file that is there is kept.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
        assert!(clean(&first, None, &to).unwrap_err().to_string().contains("exists already"));
    }
}

#[test]
fn one_rendering_is_cleaned_and_what_its_groups_lack_stays_in_the_sum() {
    let folder = tempfile::tempdir().unwrap();
    let [first, to] = ["1.exr", "clean.exr"].map(|name| folder.path().join(name));
    // The third lamp is in no group.
    write(&first, 1, &[0, 1], ENCODINGS[0], false);
    clean(&first, None, &to).unwrap();
    let (before, after) = (channels_of(&first), channels_of(&to));
    for lamp in 0..2 {
        assert!(error_of(&after, lamp) < 0.5 * error_of(&before, lamp));
    }
    let mean = |found: &BTreeMap<String, FlatSamples>, name: &str| {
        found[name].values_as_f32().map(f64::from).sum::<f64>() / PIXELS as f64
    };
    for letter in ["R", "G", "B"] {
        let name = format!("V.Combined.{letter}");
        assert!((mean(&after, &name) / mean(&before, &name) - 1.0).abs() < 0.02, "{letter}");
    }
}

/// More groups than traced lights have clusters: each is still denoised for itself.
#[test]
fn forty_groups_are_cleaned() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, to] = ["1.exr", "2.exr", "clean.exr"].map(|name| folder.path().join(name));
    let name = |group: usize, letter: &str| format!("V.Combined_lamp {group:02}.{letter}");
    let write = |path: &Path, seed: usize| {
        let mut channels = Vec::new();
        for (colour, letter) in ["R", "G", "B"].into_iter().enumerate() {
            let light = |group: usize, pixel: usize| noisy(group % 3, pixel, 2 * group + seed)[colour];
            channels.extend((0..40).map(|group| channel(name(group, letter), plane(|p| light(group, p), false))));
            let sum = plane(|pixel| (0..40).map(|group| light(group, pixel)).sum(), false);
            channels.push(channel(format!("V.Combined.{letter}"), sum));
        }
        channels.sort_by(|a, b| a.name.as_slice().cmp(b.name.as_slice()));
        let channels = AnyChannels { list: SmallVec::from_vec(channels) };
        let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), ENCODINGS[0], channels);
        let frame = ImageAttributes::new(IntegerBounds::from_dimensions((WIDTH, HEIGHT)));
        Image::new(frame, layer).write().to_file(path).unwrap();
    };
    write(&first, 0);
    write(&second, 1);
    clean(&first, Some(&second), &to).unwrap();
    let (before, after) = (channels_of(&first), channels_of(&to));
    for group in 0..40 {
        let [old, new] = [&before, &after].map(|found| {
            let values = found[&name(group, "R")].values_as_f32();
            let square = |(pixel, value): (usize, f32)| (value - truth(group % 3, pixel)[0]).powi(2);
            values.enumerate().map(square).sum::<f32>().sqrt()
        });
        assert!(new < 0.25 * old, "group {group}: {new} of {old}");
    }
}

/// Primaries of ACEScg: what is read as Rec. 709 comes back in the file's own colours.
#[test]
fn cleaned_files_keep_their_colour_space() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, to] = ["1.exr", "2.exr", "clean.exr"].map(|name| folder.path().join(name));
    let write = |path: &Path, seed: usize| {
        let mut channels = Vec::new();
        for (colour, letter) in ["R", "G", "B"].into_iter().enumerate() {
            let level = [0.9, 0.2, 0.05][colour];
            let light = move |pixel: usize| level * (0.9 + 0.2 * random(pixel, seed));
            channels.push(channel(letter.into(), plane(light, false)));
            channels.push(channel(format!("RGBA_red.{letter}"), plane(light, false)));
        }
        channels.sort_by(|a, b| a.name.as_slice().cmp(b.name.as_slice()));
        let channels = AnyChannels { list: SmallVec::from_vec(channels) };
        let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), ENCODINGS[0], channels);
        let mut frame = ImageAttributes::new(IntegerBounds::from_dimensions((WIDTH, HEIGHT)));
        frame.chromaticities = Some(exr::meta::attribute::Chromaticities {
            red: Vec2(0.713, 0.293),
            green: Vec2(0.165, 0.830),
            blue: Vec2(0.128, 0.044),
            white: Vec2(0.32168, 0.33767),
        });
        Image::new(frame, layer).write().to_file(path).unwrap();
    };
    write(&first, 1);
    write(&second, 2);
    clean(&first, Some(&second), &to).unwrap();
    let after = channels_of(&to);
    for (letter, level) in [("R", 0.9), ("G", 0.2), ("B", 0.05)] {
        for name in [letter.to_owned(), format!("RGBA_red.{letter}")] {
            let mean = after[&name].values_as_f32().sum::<f32>() / PIXELS as f32;
            assert!((mean / level - 1.0).abs() < 0.01, "{name}: {mean}");
        }
    }
}

#[test]
fn what_cannot_be_cleaned_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("clean.exr");
    for half in ["a-1.exr", "a-2.exr"] {
        write(&folder.path().join(half), 1, if half == "a-1.exr" { &[0] } else { &[1] }, ENCODINGS[0], false);
    }
    let said = clean(&folder.path().join("a-*.exr"), None, &to).unwrap_err().to_string();
    assert!(said.contains("only the lights of one OpenEXR file"), "{said}");
    assert!(!to.exists());
}

fn images_of(set: &LightSet) -> Vec<Vec<f32>> {
    let mut images = vec![vec![0.0; 3 * PIXELS]; set.images()];
    set.read(&mut |row: LightRow<'_>| {
        let first = row.channel * PIXELS + row.y * WIDTH + row.x;
        images[row.image][first..first + row.values.len()].copy_from_slice(row.values);
        Ok(())
    })
    .unwrap();
    images
}

#[test]
fn several_files_are_one_set_of_lights() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write(&at("whole.exr"), 1, &[0, 1, 2], ENCODINGS[0], false);
    write(&at("render-2.exr"), 1, &[1], ENCODINGS[0], false);
    write(&at("render-10.exr"), 1, &[2], ENCODINGS[1], false);
    write(&at("render-1.exr"), 1, &[0], ENCODINGS[0], false);
    std::fs::write(at(".render-3.exr"), "no image").unwrap();
    let set = LightSet::open(&at("render-*.exr"), None).unwrap();
    // In the order of their numbers.
    assert_eq!((set.lights.as_slice(), set.has_sum), (&LAMPS.map(String::from)[..], true));
    let whole = LightSet::open(&at("whole.exr"), None).unwrap();
    let order: Vec<usize> =
        set.lights.iter().map(|light| whole.lights.iter().position(|other| other == light).unwrap()).collect();
    let (found, wanted) = (images_of(&set), images_of(&whole));
    for (image, other) in order.into_iter().chain([3]).enumerate() {
        assert!(found[image] == wanted[other], "image {image}");
    }
    assert!(FeaturePasses::find(&at("render-*.exr")).unwrap().is_some());
    // A light in two of them, none of them, and another size are refused.
    let refused = |pattern: &str| LightSet::open(&at(pattern), None).unwrap_err().to_string();
    assert!(refused("*e*.exr").contains("two layers are of light"));
    assert!(refused("nothing-*.exr").contains("no file matches"));
    // A picture without light groups beside them changes nothing; one of another size with some is refused.
    let small = ltm::LinearImage::black(8, 8);
    ltm::image::write_exr(&at("render-3.exr"), &small).unwrap();
    assert_eq!(LightSet::open(&at("render-*.exr"), None).unwrap().lights, set.lights);
    ltm::image::write_exr_layers(&at("render-3.exr"), &[("V.Combined_a", &small)]).unwrap();
    assert!(refused("render-*.exr").contains("8 × 8"));
}

#[test]
fn lights_get_other_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write(&path, 1, &[0, 1], ENCODINGS[0], false);
    let names = |pairs: &[(&str, &str)]| pairs.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
    let mut set = LightSet::open(&path, None).unwrap();
    let mut wanted = set.lights.clone();
    set.rename(&names(&[("key", "Küche.001")]), &path).unwrap();
    wanted.iter_mut().filter(|light| *light == "key").for_each(|light| *light = "Küche.001".into());
    assert_eq!(set.lights, wanted);
    let refused = |pairs: &[(&str, &str)]| -> Error {
        LightSet::open(&path, None).unwrap().rename(&names(pairs), &path).unwrap_err()
    };
    assert!(refused(&[("none", "x")]).to_string().contains("no light 'none'"));
    assert!(refused(&[("key", "")]).to_string().contains("is empty"));
    assert!(refused(&[("key", "fill light")]).to_string().contains("'fill light'"));
}
