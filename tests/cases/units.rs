//! The unit of a scene decides nothing about which of its lamps are kept.

use std::path::Path;

use ltm::MemoryMatrix;
use ltm::compress::{CompressSettings, Method, Target};
use ltm::container::ContainerReader;
use ltm::error::Error;
use ltm::image::LinearImage;
use ltm::light::{Light, LightBasis, LightKind, Lighting};
use ltm::matrix::CHANNELS;
use ltm::pipeline::{self, PackOptions, RenderOptions};
use ltm::relight::{CpuRelighter, relight_raw};
use ltm::resources::NoProgress;
use ltm::store::StoreReader;

use super::Collection;

pub(super) const TESTS: &[(&str, fn())] = &[
    ("a room is the same in any unit", a_room_is_the_same_in_any_unit),
    ("scaled lights change no picture and no size", scaled_lights_change_no_picture_and_no_size),
    ("a lost light is refused, a hurt one is named", a_lost_light_is_refused),
];

pub(super) const COLLECTIONS: &[Collection] =
    &[Collection { folder: "35-units", test: metres_centimetres_millimetres }];

/// A room of 6 × 3 × 6 m with an open front: a panel of radiance 4, a bulb of 1 W/sr, a spot of 6 W/sr; lengths in units of `metres`.
fn room(folder: &Path, metres: f32) -> ltm::scene::LoadedScene {
    let unit = 1.0 / metres;
    let points = [[-3, 0, -3], [3, 0, -3], [3, 0, 3], [-3, 0, 3], [-3, 3, -3], [3, 3, -3], [3, 3, 3], [-3, 3, 3]];
    let vertices: String =
        points.map(|p: [i32; 3]| p.map(|v| v as f32 * unit)).map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let walls = "usemtl wall\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 1 5 8 4\nf 2 3 7 6\n";
    std::fs::write(folder.join("room.obj"), format!("mtllib room.mtl\n{vertices}{walls}")).unwrap();
    std::fs::write(folder.join("room.mtl"), "newmtl wall\nKd 0.6 0.6 0.6\n").unwrap();
    let place = |place: [f32; 3]| format!("{:?}", place.map(|v| v * unit));
    let watts = |per_steradian: f32| format!("{:?}", [per_steradian * unit * unit; 3]);
    let scene = format!(
        "geometry = [\"room.obj\"]\n[camera]\neye = {}\nlook_at = {}\nwidth = 64\nheight = 48\n[render]\nsamples_per_pixel = 32\nmax_depth = 12\n\
         [[light]]\nkind = \"panel\"\nname = \"panel\"\norigin = {}\nedge_u = {}\nedge_v = {}\nfaces = [0, -1, 0]\ntexels = [4, 4]\n\
         emission = [4, 4, 4]\n\
         [[light]]\nkind = \"point\"\nname = \"bulb\"\nposition = {}\nemission = {}\n\
         [[light]]\nkind = \"spot\"\nname = \"spot\"\nposition = {}\ndirection = [1, -2, -1]\nouter_degrees = 30\nemission = {}\n",
        place([0.0, 1.7, 5.5]),
        place([0.0, 1.2, 0.0]),
        place([-0.5, 2.99, -0.5]),
        place([1.0, 0.0, 0.0]),
        place([0.0, 0.0, 1.0]),
        place([1.5, 2.0, 1.0]),
        watts(1.0),
        place([-1.5, 2.8, 1.0]),
        watts(6.0)
    );
    let path = folder.join("room.toml");
    std::fs::write(&path, scene).unwrap();
    ltm::scene::load(&path).unwrap()
}

fn mean(image: &LinearImage) -> f64 {
    image.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (CHANNELS * image.pixels.len()) as f64
}

/// Relative L2 distance of an image from another.
fn distance(image: &LinearImage, from: &LinearImage) -> f64 {
    let values = || image.pixels.iter().flatten().zip(from.pixels.iter().flatten());
    let squares: f64 = values().map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (squares / from.pixels.iter().flatten().map(|b| f64::from(*b).powi(2)).sum::<f64>()).sqrt()
}

/// The raw image under each light alone, in the scene's own lighting.
fn alone(basis: &LightBasis) -> Vec<(String, Lighting)> {
    let scene = Lighting::of_scene(basis);
    basis.lights().iter().map(|light| (light.name.clone(), scene.only(light.columns()))).collect()
}

/// Renders a scene, packs it, and holds the image under each light alone against that of the raw matrix. Gives the images and the sizes
/// of the packs: denoised, and not.
fn packed_alone(loaded: ltm::scene::LoadedScene, folder: &Path) -> (Vec<LinearImage>, [u64; 2]) {
    let raw = folder.join("room.ltm");
    pipeline::render(loaded, &raw, &RenderOptions::default(), &NoProgress).unwrap();
    let matrix = StoreReader::open(&raw).unwrap();
    let mut images = Vec::new();
    let sizes = [true, false].map(|denoise| {
        let path = folder.join(format!("{denoise}.ltc"));
        let report =
            pipeline::pack(&matrix, matrix.job(), &path, &PackOptions { denoise, ..Default::default() }, &NoProgress);
        let container = ContainerReader::open(&path).unwrap();
        let relighter = CpuRelighter::load(&container).unwrap();
        for (name, lighting) in alone(&matrix.job().basis) {
            let (packed, expected) = (
                relighter.relight(&lighting).unwrap(),
                relight_raw(&matrix, std::slice::from_ref(&lighting)).unwrap().remove(0),
            );
            // Denoising and leaving out noise keep the mean: within a hundredth, as noise of the samples goes one way or the other.
            let ratio = mean(&packed) / mean(&expected);
            assert!((ratio - 1.0).abs() < 0.01, "{name} alone, denoise {denoise}: {ratio} of its light");
            images.push(packed);
        }
        report.unwrap().packed_bytes
    });
    (images, sizes)
}

fn a_room_is_the_same_in_any_unit() {
    let packed = [1.0, 1e-2, 1e-3, 1e3].map(|metres| {
        let folder = tempfile::tempdir().unwrap();
        packed_alone(room(folder.path(), metres), folder.path())
    });
    let (images, sizes) = &packed[0];
    for (others, other_sizes) in &packed[1..] {
        for (image, of_metres) in others.iter().zip(images) {
            // Another unit rounds vertices and directions otherwise, so that single samples fall elsewhere: a fifth of the noise of
            // the spot's samples, which is 0.16.
            let distance = distance(image, of_metres);
            assert!(distance < 0.03, "{distance}");
        }
        for (size, of_metres) in other_sizes.iter().zip(sizes) {
            let ratio = *size as f64 / *of_metres as f64;
            assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
        }
    }
}

fn metres_centimetres_millimetres(folder: &Path) {
    for unit in ["m", "cm", "mm"] {
        let mut loaded = ltm::scene::load(&folder.join(format!("{unit}.toml"))).unwrap();
        loaded.settings.samples_per_pixel = 32;
        let work = tempfile::tempdir().unwrap();
        let (images, _) = packed_alone(loaded, work.path());
        // What the collection's note says of the raw images.
        for (image, expected) in images.iter().zip([0.0795, 0.0475, 0.0104].repeat(2)) {
            let mean = mean(image);
            assert!((mean / expected - 1.0).abs() < 0.015, "{unit}: {mean} for {expected}");
        }
    }
}

/// A matrix whose columns are smooth images, each of its own, with single bright entries.
fn smooth(basis: &LightBasis, scales: &[f32]) -> MemoryMatrix<'static> {
    let pixel = |x: u32, y: u32, column: usize| {
        let (a, b) = (0.05 + 0.011 * column as f32, 0.21 - 0.007 * column as f32);
        let is_spot = (x as usize * 31 + y as usize * 17 + column * 7).is_multiple_of(211);
        let spot = if is_spot { 40.0 } else { 0.0 };
        [0, 1, 2].map(|channel| {
            let smooth = 1.2
                + (a * x as f32 + 0.3 * channel as f32).sin()
                + 0.4 * (b * y as f32 + 0.1 * (column * column) as f32).cos();
            scales[column] * (smooth + spot) / (1.0 + 0.1 * column as f32)
        })
    };
    MemoryMatrix::from_fn((40, 32), basis.clone(), pixel).unwrap().with_block_side(16).unwrap()
}

fn light(name: &str, kind: LightKind, place: [f32; 3]) -> Light {
    let mut light = Light::unplaced(name, kind);
    light.places.iter_mut().enumerate().for_each(|(i, p)| *p = [place[0] + 0.1 * i as f32, place[1], place[2]]);
    light
}

/// Lamps, a panel of texels and a sky, each where it is.
fn placed() -> LightBasis {
    let mut basis = LightBasis::new();
    let kinds = [
        LightKind::Lamp,
        LightKind::AreaTexels { across: 4, down: 4 },
        LightKind::Point,
        LightKind::LatLong { across: 4, down: 3 },
        LightKind::Sun,
    ];
    for (i, kind) in kinds.into_iter().enumerate() {
        basis.push(light(&i.to_string(), kind, [i as f32, 2.0, 1.0])).unwrap();
    }
    basis
}

/// Images of nobody knows which lights, as an array has them.
fn unplaced() -> LightBasis {
    let mut basis = LightBasis::new();
    (0..18).for_each(|i| basis.push(Light::unplaced(i.to_string(), LightKind::Image)).unwrap());
    basis
}

/// A container of the matrix with its lights scaled: its size, and its image under the lighting that makes up for the scales.
fn packed(basis: &LightBasis, scales: &[f32], compress: &CompressSettings, weights: &[f32]) -> (u64, LinearImage) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scaled.ltc");
    let options = PackOptions { compress: compress.clone(), allow_lost_lights: true, ..Default::default() };
    let report = ltm::pack(&smooth(basis, scales), &path, &options).unwrap();
    let container = ContainerReader::open(&path).unwrap();
    let lighting = weights.iter().zip(scales).map(|(weight, scale)| [weight / scale; 3]).collect();
    let image = CpuRelighter::load(&container).unwrap().relight(&Lighting::new(lighting).unwrap()).unwrap();
    (report.packed_bytes, image)
}

fn scaled_lights_change_no_picture_and_no_size() {
    let methods = [
        Method::Auto,
        Method::Algorithm1,
        Method::Algorithm2,
        Method::Algorithm3,
        Method::Algorithm4,
        Method::Proposed,
        Method::BlockPca,
        Method::BlockSvd,
    ];
    for basis in [placed(), unplaced()] {
        let columns = basis.column_count();
        let powers = [9, -9, 4, -6, 0, 7, -3];
        let scales = |base: f32| -> Vec<f32> {
            let lights = basis.lights().iter().enumerate();
            lights.flat_map(|(i, light)| vec![base.powi(powers[i % powers.len()]); light.places.len()]).collect()
        };
        for method in methods {
            // Powers of ten round entries in f32. Where k-means finds two choices equally good, that decides, so that methods that
            // choose by it are scaled by powers of two.
            let chooses =
                matches!(method, Method::Algorithm1 | Method::Algorithm2 | Method::Algorithm4 | Method::Proposed);
            let scales = scales(if chooses { 8.0 } else { 10.0 });
            let settings = match method {
                Method::Auto => CompressSettings { target: Target::PsnrDb(60.0), ..Default::default() },
                method => CompressSettings { rank: 6, ..CompressSettings::of_method(method) },
            };
            for weights in [vec![1.0; columns], (0..columns).map(|j| if j == 1 { 3.0 } else { 0.0 }).collect()] {
                let (size, image) = packed(&basis, &vec![1.0; columns], &settings, &weights);
                let (scaled_size, scaled) = packed(&basis, &scales, &settings, &weights);
                // Seven digits of each entry stay, a quantiser may take the next step.
                let (apart, ratio) = (distance(&scaled, &image), scaled_size as f64 / size as f64);
                assert!(apart < 1e-3, "{method}, {columns} columns: {apart:e}");
                assert!((ratio - 1.0).abs() < 0.01, "{method}, {columns} columns: {scaled_size} for {size} bytes");
            }
        }
    }
}

/// Of few bytes little is left of a light: it is named, and where hardly anything is left nothing is written.
fn a_lost_light_is_refused() {
    let basis = unplaced();
    let source = smooth(&basis, &vec![1.0; basis.column_count()]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let pack = |target: Target, allow_lost_lights: bool| {
        let compress = CompressSettings { target, ..Default::default() };
        let mut options = PackOptions { compress, allow_lost_lights, ..Default::default() };
        options.container.overwrite = allow_lost_lights;
        ltm::pack(&source, &path, &options)
    };
    let error = pack(Target::PsnrDb(3.0), false).unwrap_err();
    assert!(matches!(error, Error::Input { .. }) && error.to_string().contains(" alone is "), "{error}");
    assert!(!path.exists());
    let report = pack(Target::PsnrDb(3.0), true).unwrap();
    assert!(report.lossy_lights[0].is_severe() && path.exists(), "{:?}", report.lossy_lights);
    let hurt = pack(Target::PsnrDb(22.0), true).unwrap().lossy_lights;
    assert!(!hurt.is_empty() && !hurt[0].is_severe(), "{hurt:?}");
    assert_eq!(pack(Target::PsnrDb(60.0), true).unwrap().lossy_lights, []);
}
