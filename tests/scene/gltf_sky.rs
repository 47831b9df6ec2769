//! Surroundings of glTF files, `EXT_lights_image_based`, against surroundings that are known as a formula.

use std::f64::consts::PI;

use glam::{Quat, Vec2, Vec3};
use ltm::light::EnvironmentMapping;
use ltm::scene::{Emitter, Scene};
use serde_json::{Value, json};

use super::Folder;
use super::glb::{Glb, room};
use super::gltf::of;

pub(super) const TESTS: &[(&str, fn())] = &[
    ("a_cube_of_rgbd_images_is_the_environment_that_it_was_made_of", a_cube_is_the_environment),
    ("a_cube_of_plain_images_beside_the_file_is_read", a_cube_of_plain_images),
    ("irradiance_that_is_of_other_images_is_said", other_irradiance_is_said),
    ("bad_image_based_lights_are_one_clear_line", bad_lights),
];

const MAPPING: EnvironmentMapping = EnvironmentMapping::LatLong { across: 32, down: 16 };
/// Lumens of a watt by which lamps of the file are divided.
const LUMENS: f32 = 683.0;

/// Linear in the direction, so that means over parts of the sphere are known; up to 9, which only RGBD can hold.
fn radiance(direction: Vec3) -> Vec3 {
    Vec3::new(5.0, 3.0, 2.0) + Vec3::new(direction.y * 4.0, direction.x * 2.0, direction.z - direction.x)
}

/// What a look along `forward` with `up` above shows, as a picture of `side` × `side` pixels of RGB and alpha in 8 bits.
fn picture(forward: Vec3, up: Vec3, side: u32, with_alpha: bool, of: fn(Vec3) -> Vec3) -> Vec<u8> {
    let right = forward.cross(up);
    let encode = |v: f32| {
        let v = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * v).round().clamp(0.0, 255.0) as u8
    };
    let mut bytes = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let at = (Vec2::new(x as f32, y as f32) + 0.5) * 2.0 / side as f32 - 1.0;
            let value = of((forward + at.x * right - at.y * up).normalize());
            // The largest alpha under which no colour is above 1.
            let alpha = if with_alpha { (255.0 / value.max_element()).floor().min(255.0) as u8 } else { 255 };
            bytes.extend((value * f32::from(alpha) / 255.0).to_array().map(encode));
            bytes.extend(with_alpha.then_some(alpha));
        }
    }
    let colour = if with_alpha { image::ExtendedColorType::Rgba8 } else { image::ExtendedColorType::Rgb8 };
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    image::ImageEncoder::write_image(encoder, &bytes, side, side, colour).unwrap();
    png
}

/// The six pictures in the extension's order.
fn pictures(side: u32, with_alpha: bool, of: fn(Vec3) -> Vec3) -> Vec<Vec<u8>> {
    let looks = [
        (Vec3::X, Vec3::Y),
        (Vec3::NEG_X, Vec3::Y),
        (Vec3::Y, Vec3::NEG_Z),
        (Vec3::NEG_Y, Vec3::Z),
        (Vec3::Z, Vec3::Y),
        (Vec3::NEG_Z, Vec3::Y),
    ];
    looks.iter().map(|&(forward, up)| picture(forward, up, side, with_alpha, of)).collect()
}

/// The coefficients of a mean radiance alone.
fn coefficients(mean: Vec3) -> Value {
    let mut bands = vec![[0.0f64; 3]; 9];
    // π for the cosine, √(4π) for Y₀₀ over the sphere.
    bands[0] = mean.to_array().map(|v| f64::from(v) * PI * (4.0 * PI).sqrt());
    json!(bands)
}

/// The room with an image-based light whose images are the file's.
fn with_light(images: &[Vec<u8>], more: Value) -> Glb {
    let mut file = room();
    let first = file.json["images"].as_array().unwrap().len();
    for bytes in images {
        let view = file.view(bytes);
        file.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    }
    let faces: Vec<usize> = (first..first + images.len()).collect();
    let mut light = json!({ "specularImages": [faces], "specularImageSize": 32,
        "irradianceCoefficients": coefficients(Vec3::new(5.0, 3.0, 2.0)) });
    for (key, value) in more.as_object().unwrap() {
        light[key] = value.clone();
    }
    file.uses("EXT_lights_image_based");
    file.json["extensions"] = json!({ "EXT_lights_image_based": { "lights": [light] } });
    file.json["scenes"][0]["extensions"] = json!({ "EXT_lights_image_based": { "light": 0 } });
    file
}

/// The scene's own weights of a light.
fn weights_of(scene: &Scene, name: &str) -> Vec<[f32; 3]> {
    let columns = scene.basis.find(name).unwrap_or_else(|| panic!("no '{name}'")).columns();
    scene.basis.scene_weights()[columns.start as usize..columns.end as usize].to_vec()
}

/// The mean of the formula over each texel.
fn wanted(of: fn(Vec3) -> Vec3) -> Vec<Vec3> {
    let mean = |texel: u32| {
        let places = (0..64).map(|i| (Vec2::new((i % 8) as f32, (i / 8) as f32) + 0.5) / 8.0);
        places.map(|offset| of(MAPPING.direction_at(texel, offset))).sum::<Vec3>() / 64.0
    };
    (0..MAPPING.texel_count()).map(mean).collect()
}

fn a_cube_is_the_environment() {
    let turned = Quat::from_rotation_y(0.5) * Quat::from_rotation_x(-0.3);
    let more = json!({ "name": "dusk", "intensity": 2.0, "rotation": turned.to_array() });
    let loaded = of(&with_light(&pictures(64, true, radiance), more)).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let scene = &loaded.scene;
    assert_eq!(scene.basis.find("dusk").expect("its name").kind, MAPPING.into());
    let Some(Emitter::Environment(emitter)) = scene.emitters.last() else { panic!("{:?}", scene.emitters.last()) };
    let turns = emitter.world_from_environment * Vec3::X - turned * Vec3::X;
    assert!(turns.length() < 1e-5, "{turns}");
    let weights = weights_of(scene, "dusk");
    let mut worst = 0.0f32;
    for (weight, wanted) in weights.iter().zip(wanted(radiance)) {
        worst = worst.max((Vec3::from(*weight) * LUMENS / 2.0 / wanted - 1.0).abs().max_element());
    }
    // Half a step of 8 bits is 0.9 % of radiance at mid-scale and less than 2.5 % of what is dark here, a tenth of the texel's
    // largest; pixels of a texel, of which there are 12 at least, have errors of their own. The cube's pixels at a texel's
    // edge add 1/64 of the radiance's slope.
    assert!(worst < 0.015, "{worst}");
    // In the whole they average out.
    let energy = |of: &dyn Fn(usize) -> Vec3| -> Vec3 {
        (0..weights.len()).map(|texel| of(texel) * MAPPING.solid_angle(texel as u32)).sum()
    };
    let formula = wanted(radiance);
    let ratio = energy(&|texel| Vec3::from(weights[texel])) * LUMENS / 2.0 / energy(&|texel| formula[texel]);
    assert!((ratio - 1.0).abs().max_element() < 2e-3, "{ratio}");
}

/// Without alpha, below 1, in files; without a name or intensity.
fn a_cube_of_plain_images() {
    let dim = |direction| radiance(direction) / 10.0;
    let mut file = with_light(&[], json!({ "irradianceCoefficients": coefficients(Vec3::new(0.5, 0.3, 0.2)) }));
    let mut folder = Folder::new();
    for (face, bytes) in pictures(32, false, dim).iter().enumerate() {
        file.push("images", json!({ "uri": format!("face%20{face}.png") }));
        folder = folder.with(&format!("face {face}.png"), bytes);
    }
    file.json["extensions"]["EXT_lights_image_based"]["lights"][0]["specularImages"] = json!([[0, 1, 2, 3, 4, 5]]);
    // A node of the name that the light would have.
    file.root(json!({ "name": "environment" }));
    let folder = folder.with("room.glb", file.to_glb());
    let loaded = ltm::scene::load(&folder.path("room.glb")).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let weights = weights_of(&loaded.scene, "environment sky");
    for (weight, wanted) in weights.iter().zip(wanted(dim)) {
        // As above; at 0.05 a step is 2 % of radiance, and half of it is what rounding leaves.
        let off = (Vec3::from(*weight) * LUMENS / wanted - 1.0).abs().max_element();
        assert!(off < 0.03, "{weight:?} for {wanted}");
    }
}

fn other_irradiance_is_said() {
    let more = json!({ "irradianceCoefficients": coefficients(Vec3::splat(7.0)) });
    let loaded = of(&with_light(&pictures(8, true, radiance), more)).unwrap();
    let [line] = &loaded.warnings.lines()[..] else { panic!("{:?}", loaded.warnings) };
    assert!(line.contains("'environment'") && line.contains("mean of 3.3") && line.contains("7.000"), "{line}");
    let none = of(&with_light(&pictures(8, true, radiance), json!({ "irradianceCoefficients": [] }))).unwrap();
    assert_eq!(none.warnings.len(), 1, "{:?}", none.warnings);
}

fn bad_lights() {
    let images = pictures(4, true, radiance);
    let refused = |file: Glb, words: &str| {
        let error = of(&file).map(|loaded| loaded.warnings).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("room.glb") && !error.contains('\n'), "'{words}': {error}");
    };
    let with = |more: Value| with_light(&images, more);
    refused(with(json!({ "intensity": -1.0 })), "intensity");
    refused(with(json!({ "intensity": "bright" })), "intensity");
    refused(with(json!({ "rotation": [0.0, 0.0, 0.0, 0.0] })), "rotation");
    refused(with(json!({ "rotation": [1.0] })), "rotation");
    refused(with(json!({ "specularImages": [] })), "six images");
    refused(with(json!({ "specularImages": [[0, 1, 2, 3, 4]] })), "six images");
    refused(with(json!({ "specularImages": [[0, 1, 2, 3, 4, 6]] })), "not there");
    refused(with(json!({ "specularImages": [[0, 1, 2, 3, 4, -1]] })), "not there");
    let mut mixed = images.clone();
    mixed[3] = picture(Vec3::NEG_Y, Vec3::Z, 8, true, radiance);
    refused(with_light(&mixed, json!({})), "one size");
    let mut broken = images.clone();
    broken[3] = b"DDS ".to_vec();
    refused(with_light(&broken, json!({})), "it is DDS");
    let large = vec![picture(Vec3::X, Vec3::Y, 2049, false, |_| Vec3::ONE); 6];
    refused(with_light(&large, json!({})), "at most 2048");
    let mut nowhere = with(json!({}));
    nowhere.json["scenes"][0]["extensions"]["EXT_lights_image_based"]["light"] = json!(1);
    refused(nowhere, "not there");
    let mut missing = with(json!({}));
    missing.json["images"][2] = json!({ "uri": "up.png" });
    refused(missing, "up.png");
}
