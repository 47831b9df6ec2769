//! Matrices from images that other programs rendered. Real files are read where `LTM_SCENES` names their folder;
//! elsewhere those tests are listed as ignored.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};
use ltm::image::{
    LayerRole, LightImage, LightImages, LinearImage, read_light_array, read_light_layers, write_exr_layers, write_npy,
};
use ltm::matrix::{BlockSource, ColumnIndex, TracedBlock};
use ltm::pipeline::{ImportedMatrix, read_lights};

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
        own("a_matrix_of_images_has_their_pixels_in_its_blocks", blocks_hold_the_pixels),
        own("what_cannot_be_imported_is_refused", what_cannot_be_imported_is_refused),
        own("clamped_and_negative_images_are_warned_about", clamped_and_negative_images_are_warned_about),
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

fn lights() -> Vec<LightImage> {
    ["fill", "key light", "sun"]
        .iter()
        .zip(0..)
        .map(|(name, seed)| LightImage { name: (*name).into(), image: image(20, 9, seed) })
        .collect()
}

fn sum(lights: &[LightImage]) -> LinearImage {
    let mut sum = LinearImage::black(lights[0].image.width, lights[0].image.height);
    for light in lights {
        for (total, pixel) in sum.pixels.iter_mut().zip(&light.image.pixels) {
            (0..3).for_each(|c| total[c] += pixel[c]);
        }
    }
    sum
}

fn what_is_exported_is_imported() {
    let folder = tempfile::tempdir().unwrap();
    let (exr, npy) = (folder.path().join("a.exr"), folder.path().join("a.npy"));
    let (all, total) = (lights(), sum(&lights()));
    let named = all.iter().map(|light| (light.name.as_str(), &light.image));
    write_exr_layers(&exr, &named.chain([("Combined", &total)]).collect::<Vec<_>>()).unwrap();
    let found = read_light_layers(&exr, None).unwrap();
    assert_eq!(found.lights, lights());
    assert_eq!(found.sum.as_ref(), Some(&sum(&lights())));
    write_npy(&npy, &lights().into_iter().map(|light| light.image).collect::<Vec<_>>()).unwrap();
    let found = read_light_array(&npy).unwrap();
    assert!(found.lights.iter().zip(lights()).all(|(a, b)| a.image == b.image));
    // A file for each light, named by a pattern.
    for light in lights() {
        ltm::image::write_exr(&folder.path().join(format!("room_{}_v1.exr", light.name)), &light.image).unwrap();
    }
    let found = read_lights(&folder.path().join("room_{light}_v*.exr"), None).unwrap();
    assert_eq!(found.lights, lights());
    assert!(found.matches.iter().any(|m| m.layer == "a.exr" && m.role == LayerRole::Ignored));
}

fn missing_light_becomes_a_rest() {
    let all = lights();
    let found = LightImages { lights: all[..2].to_vec(), sum: Some(sum(&all)), matches: vec![] };
    let matrix = ImportedMatrix::new(found, "test", 32).unwrap();
    let names: Vec<_> = matrix.job().basis.lights().iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["fill", "key light", "Rest"]);
    assert!(matrix.warnings[0].contains("Rest"), "{:?}", matrix.warnings);
    let mut block = TracedBlock::default();
    matrix.read_block(ltm::matrix::BlockId(0), &mut block).unwrap();
    let (rest, missing) = (block.block.view().column(ColumnIndex(2))[0], all[2].image.pixels[0][0]);
    // Two subtractions in f32 of values below 8.
    assert!((rest - missing).abs() < 1e-5);
}

fn blocks_hold_the_pixels() {
    let found = LightImages { lights: lights(), ..Default::default() };
    let matrix = ImportedMatrix::new(found, "test", 8).unwrap();
    let shape = matrix.shape();
    assert_eq!((shape.width(), shape.height(), shape.columns()), (20, 9, 3));
    let mut block = TracedBlock::default();
    for id in shape.blocks() {
        matrix.read_block(id, &mut block).unwrap();
        let rect = shape.rect(id);
        for (i, light) in lights().iter().enumerate() {
            let column = block.block.view().column(ColumnIndex(i as u32));
            for y in 0..rect.height {
                for x in 0..rect.width {
                    let pixel = light.image.pixels[((rect.y + y) * 20 + rect.x + x) as usize];
                    let at = (y * rect.width + x) as usize;
                    assert_eq!([0, 1, 2].map(|c| column[c * rect.pixels() + at]), pixel);
                }
            }
        }
    }
}

fn what_cannot_be_imported_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    std::fs::write(&path, "no image").unwrap();
    assert!(read_lights(&path, None).is_err());
    assert!(read_lights(&folder.path().join("none_{light}.exr"), None).is_err());
    ltm::image::write_exr(&path, &image(4, 4, 1)).unwrap();
    let error = read_lights(&path, None).unwrap_err().to_string();
    assert!(error.contains("no layer looks like a light's"), "{error}");
    let npy = folder.path().join("a.npy");
    write_npy(&npy, &lights().into_iter().map(|light| light.image).collect::<Vec<_>>()).unwrap();
    let bytes = std::fs::read(&npy).unwrap();
    for length in (0..bytes.len()).step_by(97) {
        std::fs::write(&npy, &bytes[..length]).unwrap();
        assert!(read_lights(&npy, None).is_err(), "cut at {length}");
    }
    let mut bad = lights();
    bad[1].image.pixels[21][2] = f32::NAN;
    let error = ImportedMatrix::new(LightImages { lights: bad, ..Default::default() }, "test", 8).unwrap_err();
    assert!(error.to_string().contains("'key light' is not finite at pixel 1, 1"), "{error}");
}

fn clamped_and_negative_images_are_warned_about() {
    let mut all = lights();
    all[0].image.pixels.iter_mut().flatten().for_each(|v| *v = v.min(1.0));
    all[1].image.pixels[3][0] = -0.5;
    let matrix = ImportedMatrix::new(LightImages { lights: all, ..Default::default() }, "test", 8).unwrap();
    assert_eq!(matrix.warnings.len(), 2, "{:?}", matrix.warnings);
    assert!(matrix.warnings[0].contains("'fill' looks clamped") && matrix.warnings[1].contains("below zero"));
}

fn mean_red(image: &LinearImage) -> f64 {
    image.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() / image.pixels.len() as f64
}

fn check_means(found: &LightImages, means: &[(&str, f64)], tolerance: f64) {
    let names: Vec<_> = found.lights.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names.len(), means.len(), "{names:?}");
    for (name, mean) in means {
        let light = found.lights.iter().find(|l| l.name == *name).unwrap_or_else(|| panic!("{name} in {names:?}"));
        assert!((mean_red(&light.image) - mean).abs() < tolerance, "{name}: {}", mean_red(&light.image));
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
    let found = read_lights(&folder.join("blender_lightgroups_160x120.exr"), None).unwrap();
    check_means(&found, &BLENDER, 6e-6);
    assert!(found.matches.iter().any(|m| m.layer == "ViewLayer.Combined" && m.role == LayerRole::Sum));
    let matrix = ImportedMatrix::new(found, "blender", 32).unwrap();
    // Cycles' groups add up to rounding of f32.
    assert!(matrix.sum_difference.unwrap() < 1e-6);
    assert_eq!(matrix.job().basis.lights().len(), 6);
}

fn blender_interleaved(folder: &Path) {
    let path = folder.join("blender_lightgroups_interleaved_half_160x120.exr");
    let found = read_lights(&path, None).unwrap();
    // The mean of values that are rounded to 11 bits each.
    check_means(&found, &BLENDER, 1e-4);
    let matrix = ImportedMatrix::new(found, "blender", 32).unwrap();
    let difference = matrix.sum_difference.unwrap();
    assert!(difference > 1e-6 && difference < 1e-3, "{difference}");
    assert_eq!(matrix.job().basis.lights().len(), 6, "no rest for what 16-bit floats lose");
    let named = read_lights(&path, Some("*.Combined_{light}")).unwrap();
    check_means(&named, &BLENDER, 1e-4);
}

fn mitsuba(folder: &Path) {
    let means = [("ceiling", 0.17996), ("fill", 0.04918), ("spot", 0.05737), ("env", 0.13094)];
    let layers = read_lights(&folder.join("mitsuba_lightgroups_multichannel_160x120.exr"), None).unwrap();
    check_means(&layers, &means, 6e-6);
    assert!(layers.sum.is_some());
    let files = read_lights(&folder.join("mitsuba_olat_{light}_160x120.exr"), None).unwrap();
    check_means(&files, &means, 1e-4);
    let npz = read_lights(&folder.join("mitsuba_olat_160x120.npz"), None).unwrap();
    check_means(&npz, &means, 1e-4);
    let npy = read_lights(&folder.join("mitsuba_olat_160x120.npy"), None).unwrap();
    // The NPZ file holds 16-bit floats of the NPY file's values: each is off by at most 2⁻¹¹ of itself.
    for (a, b) in npy.lights.iter().zip(&npz.lights) {
        let pairs = a.image.values().iter().zip(b.image.values());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() <= a.abs() / 2048.0 + 1e-7), "{}", b.name);
    }
    let matrix = ImportedMatrix::new(layers, "mitsuba", 32).unwrap();
    assert!(matrix.sum_difference.unwrap() < 1e-6);
}
