//! Matrices from images that other programs rendered. Real files are read where `LTM_SCENES` names their folder;
//! elsewhere those tests are listed as ignored.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

use libtest_mimic::{Arguments, Trial};
use ltm::compress::Target;
use ltm::container::ContainerReader;
use ltm::image::{
    FeaturePasses, ImageSize, LayerPattern, LayerRole, LightSet, LinearImage, compare, write_exr, write_exr_channels,
    write_exr_rows, write_npy,
};
use ltm::light::{Job, LightBasis, LightKind, Lighting};
use ltm::matrix::{BlockId, BlockSource, ColumnIndex, TracedBlock};
use ltm::pipeline::{self, ImageNoise, ImportedMatrix, PackOptions, SecondImages};
use ltm::relight::{relight_raw, relight_streaming};
use ltm::resources::{NoProgress, Progress, parse_bytes};
use ltm::{Error, Result};

fn main() -> ExitCode {
    let scenes = std::env::var_os("LTM_SCENES").map(|folder| PathBuf::from(folder).join("lightgroups"));
    let real = |name: &str, test: fn(&Path)| {
        let folder = scenes.clone();
        let trial = Trial::test(name, move || {
            test(&folder.expect("ignored without the folder"));
            Ok(())
        });
        trial.with_ignored_flag(scenes.is_none())
    };
    let own = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let tests = vec![
        own("what_is_exported_is_imported", what_is_exported_is_imported),
        own("missing_light_becomes_a_rest", missing_light_becomes_a_rest),
        own("a_group_named_rest_does_not_take_what_is_missing", a_group_named_rest),
        own("layers_of_two_views_are_refused", layers_of_two_views_are_refused),
        own("a_folder_of_files_is_a_light_each", a_folder_of_files_is_a_light_each),
        own("images_of_other_parts_of_the_frame_are_placed", images_of_other_parts_of_the_frame_are_placed),
        own("what_cannot_be_imported_is_refused", what_cannot_be_imported_is_refused),
        own("clamped_and_negative_images_are_warned_about", clamped_and_negative_images_are_warned_about),
        own("the_whole_need_is_said_before_images_are_read", the_whole_need_is_said_before_images_are_read),
        own("a_target_in_bytes_is_that_of_the_file", a_target_in_bytes_is_that_of_the_file),
        own("two_renderings_are_denoised_of_their_noise", two_renderings_are_denoised),
        own("one_rendering_is_denoised_of_what_looks_like_noise", one_rendering_is_denoised),
        own("a_second_rendering_of_other_lights_is_refused", another_second_rendering),
        own("images_of_texels_are_one_light", images_of_texels),
        own("lights_of_an_array_are_placed_by_their_images", lights_by_their_images),
        real("blender_multi_part_groups_add_up", blender_multi_part),
        real("blender_interleaved_half_groups_add_up", blender_interleaved),
        real("mitsuba_files_of_all_kinds_agree", mitsuba),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

fn image(width: u32, height: u32, seed: u32) -> LinearImage {
    let value = |i: u32| ((i * 7919 + seed * 104_729) % 1000) as f32 / 500.0;
    let pixels = (0..width * height).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]).collect();
    LinearImage { width, height, pixels }
}

const NAMES: [&str; 3] = ["fill", "key light", "sun"];

fn images() -> Vec<LinearImage> {
    (0..3).map(|seed| image(20, 9, seed)).collect()
}

fn sum(images: &[LinearImage]) -> LinearImage {
    let mut sum = LinearImage::black(images[0].width, images[0].height);
    for image in images {
        for (total, pixel) in sum.pixels.iter_mut().zip(&image.pixels) {
            (0..3).for_each(|c| total[c] += pixel[c]);
        }
    }
    sum
}

fn size(image: &LinearImage) -> ImageSize {
    ImageSize { width: image.width as usize, height: image.height as usize }
}

/// The row of a channel of one of some images.
fn fetch(images: &[LinearImage]) -> impl FnMut(usize, usize, usize, &mut [f32]) -> Result<()> + '_ {
    |image, channel, y, row| {
        let pixels = images[image].pixels.iter().skip(y * row.len());
        row.iter_mut().zip(pixels).for_each(|(value, pixel)| *value = pixel[channel]);
        Ok(())
    }
}

fn write_layers(path: &Path, layers: &[&str], images: &[LinearImage]) {
    let layers: Vec<String> = layers.iter().map(ToString::to_string).collect();
    write_exr_rows(path, true, &layers, size(&images[0]), &mut fetch(images)).unwrap();
}

fn import(path: &Path, layers: Option<&str>) -> Result<ImportedMatrix> {
    let layers = layers.map(|layers| layers.parse::<LayerPattern>().unwrap());
    let beside = tempfile::tempdir().unwrap();
    let set = LightSet::open(path, layers.as_ref())?;
    ImportedMatrix::read(
        &set,
        ImageNoise::Unknown,
        "test",
        &beside.path().join("x"),
        8,
        &PackOptions::default(),
        &NoProgress,
    )
}

fn names(matrix: &ImportedMatrix) -> Vec<String> {
    matrix.job().basis.lights().iter().map(|light| light.name.clone()).collect()
}

/// The image of a column, put together from the matrix's blocks.
fn column_of(matrix: &ImportedMatrix, column: ColumnIndex) -> LinearImage {
    let shape = matrix.shape();
    let mut image = LinearImage::black(shape.width(), shape.height());
    let mut block = TracedBlock::default();
    for id in shape.blocks() {
        matrix.read_block(id, &mut block).unwrap();
        let rect = shape.rect(id);
        let values = block.block.view().column(column);
        for y in 0..rect.height {
            for x in 0..rect.width {
                let at = (y * rect.width + x) as usize;
                let pixel = &mut image.pixels[((rect.y + y) * shape.width() + rect.x + x) as usize];
                *pixel = [0, 1, 2].map(|c| values[c * rect.pixels() + at]);
            }
        }
    }
    image
}

fn columns_of(matrix: &ImportedMatrix) -> Vec<LinearImage> {
    (0..matrix.shape().columns()).map(|column| column_of(matrix, ColumnIndex(column as u32))).collect()
}

fn what_is_exported_is_imported() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let all = images();
    let with_sum = [all.as_slice(), &[sum(&all)]].concat();
    for (layers, what) in [
        (["fill", "key light", "sun", "Combined"], "plain"),
        (["V.Combined_fill", "V.Combined_key light", "V.Combined_sun", "V.Combined"], "Blender"),
        (["RGBA_fill", "RGBA_key light", "RGBA_sun", "RGBA"], "Arnold"),
        (["VRayLightSelect_fill", "VRayLightSelect_key light", "VRayLightSelect_sun", ""], "V-Ray"),
        (["RADIANCE_GROUP_fill", "RADIANCE_GROUP_key light", "RADIANCE_GROUP_sun", "RGB"], "LuxCore"),
    ] {
        write_layers(&at("a.exr"), &layers, &with_sum);
        let found = import(&at("a.exr"), None).unwrap();
        assert_eq!((names(&found), columns_of(&found)), (NAMES.map(String::from).to_vec(), all.clone()), "{what}");
        // Rounding of a few sums in f32.
        assert!(found.sum_difference.unwrap() < 1e-6, "{what}");
    }
    write_npy(&at("a.npy"), true, 3, size(&all[0]), &mut fetch(&all)).unwrap();
    let found = import(&at("a.npy"), None).unwrap();
    assert_eq!((columns_of(&found), found.sum_difference), (all.clone(), None));
    // A file for each light, named by a pattern.
    for (name, image) in NAMES.iter().zip(&all) {
        write_exr(&at(&format!("room_{name}_v1.exr")), image).unwrap();
    }
    let found = import(&at("room_{light}_v*.exr"), None).unwrap();
    assert_eq!((names(&found), columns_of(&found)), (NAMES.map(String::from).to_vec(), all));
    assert!(found.matches.iter().any(|m| m.layer == "a.exr" && m.role == LayerRole::Ignored));
}

fn a_folder_of_files_is_a_light_each() {
    let folder = tempfile::tempdir().unwrap();
    let all = images();
    write_exr(&folder.path().join("fill.exr"), &all[0]).unwrap();
    // A portable float map, from the bottom up.
    let mut map = b"PF\n20 9\n-1\n".to_vec();
    let rows = all[1].pixels.chunks_exact(20).rev();
    map.extend(rows.flatten().flatten().flat_map(|v| v.to_le_bytes()));
    std::fs::write(folder.path().join("key light.pfm"), map).unwrap();
    std::fs::write(folder.path().join("notes.txt"), "not an image").unwrap();
    let found = import(folder.path(), None).unwrap();
    assert_eq!((names(&found).as_slice(), columns_of(&found).as_slice()), (&NAMES.map(String::from)[..2], &all[..2]));
}

/// Writes an image as a part of a frame of 64 × 48 pixels, from the corner `x, y` on.
fn write_part(path: &Path, image: &LinearImage, (x, y): (i32, i32)) {
    use exr::prelude::{Encoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels};
    use exr::prelude::{Vec2, WritableImage};
    let pixel = |at: Vec2<usize>| {
        let [r, g, b] = image.pixels[at.y() * image.width as usize + at.x()];
        (r, g, b)
    };
    let attributes = LayerAttributes { layer_position: Vec2(x, y), ..LayerAttributes::default() };
    let size = Vec2(image.width as usize, image.height as usize);
    let layer = Layer::new(size, attributes, Encoding::UNCOMPRESSED, SpecificChannels::rgb(pixel));
    let frame = ImageAttributes::new(IntegerBounds::from_dimensions((64, 48)));
    Image::new(frame, layer).write().to_file(path).unwrap();
}

fn images_of_other_parts_of_the_frame_are_placed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let all = images();
    write_part(&at("x_fill.exr"), &all[0], (8, 4));
    write_part(&at("x_sun.exr"), &all[1], (8, 4));
    let found = import(&at("x_{light}.exr"), None).unwrap();
    assert_eq!(columns_of(&found), all[..2], "the same part is one image");
    write_part(&at("x_sun.exr"), &all[1], (9, 4));
    let found = import(&at("x_{light}.exr"), None).unwrap();
    for (light, (x, y)) in [(0, (8, 4)), (1, (9, 4))] {
        let mut placed = LinearImage::black(64, 48);
        for (row, pixels) in all[light].pixels.chunks_exact(20).enumerate() {
            placed.pixels[(y + row) * 64 + x..][..20].copy_from_slice(pixels);
        }
        assert_eq!(columns_of(&found)[light], placed, "light {light}");
    }
    // A whole frame of the part's size is another picture.
    write_exr(&at("x_sun.exr"), &all[1]).unwrap();
    assert!(import(&at("x_{light}.exr"), None).unwrap_err().to_string().contains("display window"));
}

fn missing_light_becomes_a_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let all = images();
    write_layers(&path, &["fill", "key light", "Combined"], &[all[0].clone(), all[1].clone(), sum(&all)]);
    let matrix = import(&path, None).unwrap();
    assert_eq!(names(&matrix), ["fill", "key light", "Rest"]);
    assert!(matrix.warnings[0].text.contains("Rest"), "{:?}", matrix.warnings);
    let rest = column_of(&matrix, ColumnIndex(2));
    // Two subtractions in f32 of values below 8.
    assert!(rest.values().iter().zip(all[2].values()).all(|(a, b)| (a - b).abs() < 1e-5));
}

/// A light may have the name that what is missing would get.
fn a_group_named_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let all = images();
    write_layers(
        &path,
        &["V.Combined_fill", "V.Combined_Rest", "V.Combined"],
        &[all[0].clone(), all[1].clone(), sum(&all)],
    );
    let matrix = import(&path, None).unwrap();
    assert_eq!(names(&matrix), ["Rest", "fill", "Rest 2"]);
    assert!(matrix.warnings[0].text.contains("'Rest 2'"), "{:?}", matrix.warnings);
    let [rest, missing] = [0, 2].map(|column| column_of(&matrix, ColumnIndex(column)));
    assert_eq!(rest, all[1]);
    assert!(missing.values().iter().zip(all[2].values()).all(|(a, b)| (a - b).abs() < 1e-5));
}

/// Which of two images under all lights belongs to which lights is not guessed.
fn layers_of_two_views_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let all = images();
    let four = [all[0].clone(), all[0].clone(), all[1].clone(), all[1].clone()];
    write_layers(&path, &["A.Combined_a", "A.Combined", "B.Combined_b", "B.Combined"], &four);
    let error = import(&path, None).unwrap_err().to_string();
    assert!(error.contains("'A.Combined' and 'B.Combined'") && error.contains("`LayerPattern`"), "{error}");
    let one = import(&path, Some("^B.Combined_(.+)$")).unwrap();
    assert_eq!((names(&one), column_of(&one, ColumnIndex(0))), (vec!["b".to_owned()], all[1].clone()));
}

fn what_cannot_be_imported_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    std::fs::write(&path, "no image").unwrap();
    assert!(import(&path, None).is_err());
    assert!(import(&folder.path().join("none_{light}.exr"), None).is_err());
    write_exr(&path, &image(4, 4, 1)).unwrap();
    let error = import(&path, None).unwrap_err().to_string();
    assert!(error.contains("no layer looks like a light's"), "{error}");
    let npy = folder.path().join("a.npy");
    write_npy(&npy, true, 3, size(&images()[0]), &mut fetch(&images())).unwrap();
    let bytes = std::fs::read(&npy).unwrap();
    for length in (0..bytes.len()).step_by(97) {
        std::fs::write(&npy, &bytes[..length]).unwrap();
        assert!(import(&npy, None).is_err(), "cut at {length}");
    }
    let mut bad = images();
    bad[1].pixels[21][2] = f32::NAN;
    write_layers(&path, &NAMES, &bad);
    let error = import(&path, None).unwrap_err().to_string();
    assert!(error.contains("'key light' is not finite at pixel 1, 1"), "{error}");
    let set = LightSet::open(&path, None).unwrap();
    let options = PackOptions { memory_bytes: Some(1 << 20), ..Default::default() };
    let error = ImportedMatrix::read(&set, ImageNoise::Unknown, "test", &path, 8, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, Error::Resources { .. }), "{error}");
}

fn clamped_and_negative_images_are_warned_about() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut all = images();
    all[0].pixels.iter_mut().flatten().for_each(|v| *v = v.min(1.0));
    all[1].pixels[3][0] = -0.5;
    write_layers(&path, &NAMES, &all);
    let matrix = import(&path, None).unwrap();
    assert_eq!(matrix.warnings.len(), 2, "{:?}", matrix.warnings);
    assert!(matrix.warnings[0].text.contains("'fill' looks clamped") && matrix.warnings[1].text.contains("below zero"));
}

/// Keeps what is said, in order.
#[derive(Default)]
struct Notes(Mutex<Vec<String>>);

impl Notes {
    fn add(&self, line: &str) {
        self.0.lock().unwrap().push(line.to_owned());
    }
}

impl Progress for Notes {
    fn begin(&self, stage: &str, _: u64, _: &str) {
        self.add(stage);
    }
    fn advance(&self, _: u64, _: u64, _: &str) {}
    fn end(&self) {}
    fn note(&self, line: &str) {
        self.add(line);
    }
    fn interrupted(&self) -> bool {
        false
    }
}

fn the_whole_need_is_said_before_images_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write_layers(&path, &NAMES, &images());
    let set = LightSet::open(&path, None).unwrap();
    let (notes, output) = (Notes::default(), folder.path().join("a.ltc"));
    let matrix =
        ImportedMatrix::read(&set, ImageNoise::Unknown, "test", &output, 8, &PackOptions::default(), &notes).unwrap();
    pipeline::pack(&matrix, matrix.job(), &output, &PackOptions::default(), &notes).unwrap();
    let said = notes.0.into_inner().unwrap();
    assert!(said[0].contains("reading the images, then packing") && said[0].contains("of disk"), "{said:?}");
    assert_eq!(said[1], "reading images");
    // What packing says later is a part of that.
    let disk = |line: &str| {
        let (likely, most) = line.split(" and likely ").nth(1).unwrap().split_once(" of disk, ").unwrap();
        [likely, most.strip_suffix(" at most").unwrap()].map(|bytes| parse_bytes(bytes).unwrap())
    };
    let packing = said.iter().find(|line| line.contains(": packing")).unwrap();
    let (whole, part) = (disk(&said[0]), disk(packing));
    assert!(whole[0] > part[0] && whole[1] > part[1] && whole[1] > whole[0], "{said:?}");
}

/// The file is at most as large as wanted, and not much smaller.
fn a_target_in_bytes_is_that_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    // Soft lights from several sides, and a grain that only large files have room for.
    let shade = |light: u32, i: u32| {
        let (x, y) = ((i % 96) as f32 / 96.0, (i / 96) as f32 / 64.0);
        let wave = (3.0 * x + light as f32).sin() * (4.0 * y - 0.7 * light as f32).cos();
        1.2 + wave + 0.02 * ((i * 7919 + light * 104_729) % 1000) as f32 / 1000.0
    };
    let lit = |light: u32| {
        let pixels = (0..96 * 64).map(|i| [0.9, 1.0, 0.8].map(|tint| tint * shade(light, i))).collect();
        LinearImage { width: 96, height: 64, pixels }
    };
    let images: Vec<LinearImage> = (0..6).map(lit).collect();
    write_npy(&path, true, 6, size(&images[0]), &mut fetch(&images)).unwrap();
    let set = LightSet::open(&path, None).unwrap();
    for wanted in [6_000, 20_000, 40_000] {
        let mut options = PackOptions::default();
        options.compress.target = Target::Bytes(wanted);
        let output = folder.path().join(format!("{wanted}.ltc"));
        let matrix =
            ImportedMatrix::read(&set, ImageNoise::Unknown, "test", &output, 32, &options, &NoProgress).unwrap();
        let report = pipeline::pack(&matrix, matrix.job(), &output, &options, &NoProgress).unwrap();
        assert_eq!(report.packed_bytes, std::fs::metadata(&output).unwrap().len());
        // All six blocks are encoded for each guess. Steps are powers of 2^(1/8), so that not every size can be had.
        let share = report.packed_bytes as f64 / wanted as f64;
        assert!((0.9..=1.0).contains(&share), "{} of {wanted}", report.packed_bytes);
    }
}

/// A checkered floor before a wall under two lights, one of which has a shadow: light, then the rest of what a file has.
fn room(noise: impl Fn(usize) -> f32) -> Vec<(String, Vec<f32>)> {
    let (width, height) = (64, 48);
    let mut channels: Vec<(String, Vec<f32>)> = Vec::new();
    let mut add = |name: &str, value: &dyn Fn(usize, usize) -> f32| {
        channels.push((name.to_owned(), (0..width * height).map(|i| value(i % width, i / width)).collect()));
    };
    let albedo = |x: usize, y: usize| if y >= 24 && (x / 4 + y / 4).is_multiple_of(2) { 0.8 } else { 0.3 };
    for (light, name) in ["key", "fill"].into_iter().enumerate() {
        for (channel, colour) in ["R", "G", "B"].into_iter().enumerate() {
            add(&format!("V.Combined_{name}.{colour}"), &|x, y| {
                let lit = if light == 0 && x < 20 { 0.1 } else { 1.0 + 0.01 * x as f32 };
                let at = ((light * 3 + channel) * height + y) * width + x;
                lit * albedo(x, y) * (1.0 + noise(at)).max(0.0)
            });
        }
    }
    ["R", "G", "B"].iter().for_each(|c| add(&format!("V.Denoising Albedo.{c}"), &albedo));
    add("V.Denoising Normal.X", &|_, _| 0.0);
    add("V.Denoising Normal.Y", &|_, y| f32::from(u8::from(y >= 24)));
    add("V.Denoising Normal.Z", &|_, y| f32::from(u8::from(y < 24)));
    add("V.Denoising Depth.Z", &|_, _| 4.0);
    channels
}

fn write_room(path: &Path, channels: &[(String, Vec<f32>)]) {
    let names: Vec<String> = channels.iter().map(|(name, _)| name.clone()).collect();
    let size = ImageSize { width: 64, height: 48 };
    let mut fetch = |channel: usize, y: usize, row: &mut [f32]| -> Result<()> {
        row.copy_from_slice(&channels[channel].1[y * 64..][..64]);
        Ok(())
    };
    write_exr_channels(path, &names, size, &mut fetch).unwrap();
}

/// Noise of half the light, of one rendering.
fn grain(seed: usize) -> impl Fn(usize) -> f32 {
    move |at| {
        let mut hash = (at as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (seed as u64) << 32;
        hash = (hash ^ hash >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((hash >> 40) as f32 / (1u64 << 24) as f32 - 0.5) * 1.7
    }
}

/// Squared errors of the images of the lights, as they are in a matrix and packed from it.
fn errors_before_and_after(matrix: &ImportedMatrix, output: &Path) -> (f64, f64) {
    let truth = room(|_| 0.0);
    let squared_error = |light: &str, image: &LinearImage| -> f64 {
        let each = ["R", "G", "B"].into_iter().enumerate().map(|(channel, colour)| {
            let name = format!("V.Combined_{light}.{colour}");
            let (_, light) = truth.iter().find(|(n, _)| *n == name).expect("it is there");
            image.pixels.iter().zip(light).map(|(p, v)| f64::from(p[channel] - v).powi(2)).sum::<f64>()
        });
        each.sum()
    };
    let options = PackOptions { denoise: true, ..Default::default() };
    let report = pipeline::pack(matrix, matrix.job(), output, &options, &NoProgress).unwrap();
    assert!(report.denoising.is_some());
    let container = ContainerReader::open(output).unwrap();
    let (mut before, mut after) = (0.0, 0.0);
    for (light, name) in names(matrix).iter().enumerate() {
        let lighting = Lighting::uniform(2, [1.0; 3]).unwrap().only([light as u32]);
        let (image, _) = relight_streaming(&container, &lighting).unwrap();
        before += squared_error(name, &column_of(matrix, ColumnIndex(light as u32)));
        after += squared_error(name, &image);
    }
    (before, after)
}

fn two_renderings_are_denoised() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (seed, name) in ["a.exr", "b.exr"].into_iter().enumerate() {
        write_room(&at(name), &room(grain(seed)));
    }
    let sets = ["a.exr", "b.exr"].map(|name| LightSet::open(&at(name), None).unwrap());
    let passes = ["a.exr", "b.exr"].map(|name| FeaturePasses::find(&at(name)).unwrap().expect("it has passes"));
    let errors = |features: [Option<&FeaturePasses>; 2]| {
        let output = at(&format!("{}.ltc", features[0].is_some()));
        let second = ImageNoise::Measured(SecondImages { set: &sets[1], features });
        let options = PackOptions { denoise: true, ..Default::default() };
        let matrix = ImportedMatrix::read(&sets[0], second, "test", &output, 16, &options, &NoProgress).unwrap();
        assert!(matrix.warnings.is_empty(), "{:?}", matrix.warnings);
        errors_before_and_after(&matrix, &output)
    };
    let ((raw, bare), (_, denoised)) = (errors([None, None]), errors(passes.each_ref().map(Some)));
    assert!(bare < raw / 2.0, "{bare} of {raw}: the images alone say much");
    assert!(denoised < bare / 2.0, "{denoised} of {bare}: what is seen says more");
}

fn one_rendering_is_denoised() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let read = |name: &str, noise: &dyn Fn(usize) -> f32, knows_noise: bool| {
        write_room(&at(name), &room(noise));
        let set = LightSet::open(&at(name), None).unwrap();
        let passes = FeaturePasses::find(&at(name)).unwrap();
        let noise = if knows_noise { ImageNoise::Estimated(passes.as_ref()) } else { ImageNoise::Unknown };
        let options = PackOptions { denoise: true, ..Default::default() };
        ImportedMatrix::read(&set, noise, "test", &at("x.ltc"), 16, &options, &NoProgress).unwrap()
    };
    let noisy = read("noisy.exr", &grain(0), true);
    let (raw, denoised) = errors_before_and_after(&noisy, &at("noisy.ltc"));
    assert!(denoised < raw / 4.0, "{denoised} of {raw}");
    // The entries are those of the images, whatever is said of their noise.
    let plain = read("noisy.exr", &grain(0), false);
    assert!(plain.wants_noise() && !noisy.wants_noise());
    assert_eq!(column_of(&plain, ColumnIndex(1)).pixels, column_of(&noisy, ColumnIndex(1)).pixels);
    assert_ne!(plain.job().provenance.content, noisy.job().provenance.content);
    // A pack that was interrupted goes on with the same noise.
    let block = |matrix: &ImportedMatrix| {
        let mut block = TracedBlock::default();
        matrix.read_block(BlockId(3), &mut block).unwrap();
        block
    };
    assert_eq!(block(&noisy).noise, block(&read("noisy.exr", &grain(0), true)).noise);
    // What is denoised is as bright as the entries, also where there is hardly any light: to the rounding of two halves.
    // Planes are of columns divided by their scales.
    let mut divided = block(&noisy);
    divided.divide_columns(noisy.job().basis.column_scales());
    let TracedBlock { block: entries, planes, .. } = divided;
    let planes = planes.unwrap();
    // Direct and indirect light together, in each half.
    let [first, other] = [0, 1].map(|half| planes.direct[half].iter().zip(&planes.indirect[half]).map(|(d, i)| d + i));
    for ((a, b), entry) in first.zip(other).zip(entries.entries()) {
        assert!((0.5 * (a + b) - entry).abs() <= entry / 256.0, "{a} and {b} of {entry}");
    }
    // What has no noise stays what it is.
    let clean = read("clean.exr", &|_| 0.0, true);
    let (_, error) = errors_before_and_after(&clean, &at("clean.ltc"));
    assert!(error < raw / 100.0, "{error}, of noise there was {raw}");
}

fn another_second_rendering() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_layers(&at("a.exr"), &["RGBA_fill", "RGBA_key"], &images()[..2]);
    write_layers(&at("b.exr"), &["RGBA_fill", "RGBA_sun"], &images()[..2]);
    let [a, b] = ["a.exr", "b.exr"].map(|name| LightSet::open(&at(name), None).unwrap());
    let second = ImageNoise::Measured(SecondImages { set: &b, features: [None, None] });
    let error =
        ImportedMatrix::read(&a, second, "test", &at("x"), 8, &PackOptions::default(), &NoProgress).unwrap_err();
    assert!(error.to_string().contains("has light 'sun' where the first has 'key'"), "{error}");
    assert!(FeaturePasses::open(&at("a.exr")).unwrap_err().to_string().contains("no layers of albedo"));
}

fn mean_red(image: &LinearImage) -> f64 {
    image.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() / image.pixels.len() as f64
}

fn check_means(found: &ImportedMatrix, means: &[(&str, f64)], tolerance: f64) {
    let lights = found.job().basis.lights();
    assert_eq!(lights.len(), means.len(), "{:?}", names(found));
    for (name, mean) in means {
        let light = found.job().basis.find(name).unwrap_or_else(|| panic!("{name} in {:?}", names(found)));
        let found = mean_red(&column_of(found, ColumnIndex(light.first_column)));
        assert!((found - mean).abs() < tolerance, "{name}: {found}");
    }
}

/// Means of the red channel as the renders' own notes give them, to five digits.
const BLENDER: [(&str, f64); 6] = [
    ("key", 0.23865),
    ("fill", 0.07344),
    ("rim", 0.01946),
    ("ceiling lamp", 0.18492),
    ("screen_emissive", 0.02003),
    ("env", 0.08305),
];

fn blender_multi_part(folder: &Path) {
    let found = import(&folder.join("blender_lightgroups_160x120.exr"), None).unwrap();
    check_means(&found, &BLENDER, 6e-6);
    assert!(found.matches.iter().any(|m| m.layer == "ViewLayer.Combined" && m.role == LayerRole::Sum));
    // Cycles' groups add up to rounding of f32.
    assert!(found.sum_difference.unwrap() < 1e-6);
}

fn blender_interleaved(folder: &Path) {
    let path = folder.join("blender_lightgroups_interleaved_half_160x120.exr");
    let found = import(&path, None).unwrap();
    // The mean of values that are rounded to 11 bits each; no rest for what 16-bit floats lose.
    check_means(&found, &BLENDER, 1e-4);
    let difference = found.sum_difference.unwrap();
    assert!(difference > 1e-6 && difference < 1e-3, "{difference}");
    let named = import(&path, Some(r"\.Combined_(.+)$")).unwrap();
    check_means(&named, &BLENDER, 1e-4);
}

fn mitsuba(folder: &Path) {
    let means = [("ceiling", 0.17996), ("fill", 0.04918), ("spot", 0.05737), ("env", 0.13094)];
    let layers = import(&folder.join("mitsuba_lightgroups_multichannel_160x120.exr"), None).unwrap();
    check_means(&layers, &means, 6e-6);
    assert!(layers.sum_difference.unwrap() < 1e-6);
    let files = import(&folder.join("mitsuba_olat_{light}_160x120.exr"), None).unwrap();
    check_means(&files, &means, 1e-4);
    let npz = import(&folder.join("mitsuba_olat_160x120.npz"), None).unwrap();
    check_means(&npz, &means, 1e-4);
    let npy = import(&folder.join("mitsuba_olat_160x120.npy"), None).unwrap();
    // The NPZ file holds 16-bit floats of the NPY file's values: each is off by at most 2⁻¹¹ of itself.
    for (a, b) in columns_of(&npy).iter().zip(&columns_of(&npz)) {
        let mut pairs = a.values().iter().zip(b.values());
        assert!(pairs.all(|(a, b)| (a - b).abs() <= a.abs() / 2048.0 + 1e-7));
    }
    assert_eq!(npy.shape().rect(BlockId(0)).rows(), 3 * 8 * 8);
}

/// A panel of 8 × 6 texels above a floor of 64 × 32 pixels: a soft spot for each.
fn panel() -> Vec<LinearImage> {
    let spot = |texel: u32| {
        let (x, y) = (8.0 * (texel % 8) as f32 + 4.0, 5.0 * (texel / 8) as f32 + 3.0);
        let value = |p: u32| 1.0 / (1.0 + 0.01 * (((p % 64) as f32 - x).powi(2) + ((p / 64) as f32 - y).powi(2)));
        LinearImage { width: 64, height: 32, pixels: (0..64 * 32).map(|p| [value(p); 3]).collect() }
    };
    (0..48).map(spot).collect()
}

fn images_of_texels() {
    let folder = tempfile::tempdir().unwrap();
    let (npy, out) = (folder.path().join("a.npy"), folder.path().join("a.ltc"));
    let images = panel();
    write_npy(&npy, true, images.len(), size(&images[0]), &mut fetch(&images)).unwrap();
    let set = LightSet::open(&npy, None).unwrap();
    let mut matrix =
        ImportedMatrix::read(&set, ImageNoise::Unknown, "a.npy", &out, 32, &PackOptions::default(), &NoProgress)
            .unwrap();
    for wrong in [LightKind::AreaTexels { across: 8, down: 5 }, LightKind::LatLong { across: 0, down: 6 }] {
        let error = matrix.take_for_texels(wrong).unwrap_err().to_string();
        assert!(error.contains("48 images"), "{error}");
    }
    matrix.take_for_texels(LightKind::LatLong { across: 8, down: 6 }).unwrap();
    let sky = &matrix.job().basis.lights()[0];
    assert!(sky.name == "sky" && sky.places[0][1] > 0.9 && sky.extents.iter().sum::<f32>() > 12.5, "{sky:?}");
    matrix.take_for_texels(LightKind::AreaTexels { across: 8, down: 6 }).unwrap();
    assert_eq!(matrix.job().basis.lights().len(), 1);
    pipeline::pack(&matrix, matrix.job(), &out, &PackOptions::default(), &NoProgress).unwrap();
    let packed = ContainerReader::open(&out).unwrap();
    assert_eq!(packed.job().basis.lights()[0].layout(), (8, 6));
}

/// Half of a panel lit, at equal bytes: nearer where images may say which lights are alike than where all but one are taken for
/// lights at one place.
fn lights_by_their_images() {
    let folder = tempfile::tempdir().unwrap();
    let (npy, out) = (folder.path().join("a.npy"), folder.path().join("a.ltc"));
    let images = panel();
    write_npy(&npy, true, images.len(), size(&images[0]), &mut fetch(&images)).unwrap();
    let set = LightSet::open(&npy, None).unwrap();
    let matrix =
        ImportedMatrix::read(&set, ImageNoise::Unknown, "a.npy", &out, 32, &PackOptions::default(), &NoProgress)
            .unwrap();
    let mut apart = LightBasis::new();
    for (index, light) in matrix.job().basis.lights().iter().enumerate() {
        let mut light = light.clone();
        light.places[0][0] = if index == 0 { 1.0 } else { 0.0 };
        apart.push(light).unwrap();
    }
    let half = Lighting::new((0..48).map(|texel| [if texel % 8 < 4 { 1.0 } else { 0.0 }; 3]).collect()).unwrap();
    let truth = &relight_raw(&matrix, std::slice::from_ref(&half)).unwrap()[0];
    let error = |basis: &LightBasis| {
        let mut options = PackOptions::default();
        options.compress.target = Target::Bytes(3000);
        options.container.overwrite = true;
        let job = Job { basis: basis.clone(), ..matrix.job().clone() };
        pipeline::pack(&matrix, &job, &out, &options, &NoProgress).unwrap();
        let image = relight_streaming(&ContainerReader::open(&out).unwrap(), &half).unwrap().0;
        compare(&image, truth).relative_l2
    };
    let (by_images, by_nothing) = (error(&matrix.job().basis), error(&apart));
    assert!(by_images < 0.8 * by_nothing, "{by_images} {by_nothing}");
}
