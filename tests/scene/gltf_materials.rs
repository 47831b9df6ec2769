//! What materials of glTF files become.

use glam::{Vec2, Vec3};
use ltm::scene::{FloatTexture, Material, Paint, Relief, Surface};
use serde_json::{Value, json};

use super::glb::room;
use super::gltf::{near, png, scene, textured};

pub(super) const TESTS: &[(&str, fn())] = &[
    ("materials_become_surfaces", materials_become_surfaces),
    ("materials_are_mixed_as_they_are_stated", materials_are_mixed_as_they_are_stated),
    ("textures_of_numbers_are_read_as_numbers", textures_of_numbers_are_read_as_numbers),
];

fn material(stated: Value) -> Material {
    let mut file = room();
    for extension in ["ior", "transmission", "specular", "volume", "diffuse_transmission"] {
        file.uses(&format!("KHR_materials_{extension}"));
    }
    file.json["materials"][0] = stated;
    scene(&file).materials[0].clone()
}

fn surface(stated: Value) -> Surface {
    material(stated).surface
}

fn materials_become_surfaces() {
    let pbr = |metallic: f32, roughness: f32| json!({ "baseColorFactor": [0.8, 0.6, 0.4, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness });
    let colour = Vec3::new(0.8, 0.6, 0.4);
    let base = Paint::Constant(colour);
    assert_eq!(
        surface(json!({ "pbrMetallicRoughness": pbr(1.0, 0.5) })),
        Surface::RoughConductor { specular: base, alpha: 0.25 }
    );
    assert_eq!(surface(json!({ "pbrMetallicRoughness": pbr(1.0, 0.0) })), Surface::Mirror { reflectance: base });
    let Surface::Coated { reflectance, specular, alpha } = surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5) }))
    else {
        panic!("not coated")
    };
    assert_eq!((reflectance, alpha), (base, 0.25));
    near(specular, [0.04; 3]);
    let none = json!({ "KHR_materials_specular": { "specularFactor": 0.0 } });
    assert_eq!(
        surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5), "extensions": none })),
        Surface::Lambert { reflectance: base }
    );
    let tinted = json!({ "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1.0, 0.5, 0.0] },
        "KHR_materials_ior": { "ior": 2.0 } });
    let Surface::Coated { specular, .. } =
        surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5), "extensions": tinted }))
    else {
        panic!("not coated")
    };
    near(specular, [0.5 / 9.0, 0.25 / 9.0, 0.0]);
    // A layer of its own.
    let clear = json!({ "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.2 } });
    let Surface::Principled(clear) = surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5), "extensions": clear }))
    else {
        panic!("not layered")
    };
    let Paint::Constant(specular) = clear.specular else { panic!("a texture") };
    near(specular, [0.04; 3]);
    assert_eq!((clear.coat, clear.roughness), ((0.5, 0.2), FloatTexture::Constant(0.5)));
    let glass = |volume: Value| {
        let mut extensions =
            json!({ "KHR_materials_transmission": { "transmissionFactor": 1.0 }, "KHR_materials_ior": { "ior": 1.4 } });
        if !volume.is_null() {
            extensions["KHR_materials_volume"] = volume;
        }
        surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.0), "extensions": extensions }))
    };
    // Both crossings of a body have the whole colour.
    let root = colour.map(f32::sqrt);
    assert_eq!(glass(json!({ "thicknessFactor": 1.0 })), Surface::Dielectric { ior: 1.4, transmittance: root });
    assert_eq!(glass(Value::Null), Surface::ThinDielectric { ior: 1.4, transmittance: colour });
}

/// What is stated together counts together: alpha on top of all, metal before glass, glass before the base.
fn materials_are_mixed_as_they_are_stated() {
    let pbr = |metallic: f32, roughness: f32| json!({ "baseColorFactor": [0.8, 0.6, 0.4, 0.25], "metallicFactor": metallic, "roughnessFactor": roughness });
    let glass = json!({ "KHR_materials_transmission": { "transmissionFactor": 0.75 } });
    // A table top whose metal is not stated is metal, and a quarter of it is there.
    for metallic in [0.0, 1.0] {
        let found =
            material(json!({ "pbrMetallicRoughness": pbr(metallic, 0.5), "alphaMode": "BLEND", "extensions": glass }));
        assert_eq!(found.opacity, 0.25);
        match found.surface {
            Surface::RoughConductor { .. } => assert_eq!(metallic, 1.0),
            Surface::Principled(found) => {
                assert_eq!((found.transmission, found.is_thin, metallic), (FloatTexture::Constant(0.75), true, 0.0));
            }
            other => panic!("{other:?}"),
        }
    }
    let half = surface(json!({ "pbrMetallicRoughness": pbr(0.5, 0.25) }));
    let Surface::Principled(half) = half else { panic!("{half:?}") };
    assert_eq!((half.metallic, half.roughness), (FloatTexture::Constant(0.5), FloatTexture::Constant(0.25)));
    let volume = json!({ "KHR_materials_transmission": { "transmissionFactor": 1.0 },
        "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [1.0, 0.5, 0.25] } });
    let found = material(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5), "extensions": volume }));
    let Surface::Principled(rough) = found.surface else { panic!("{:?}", found.surface) };
    assert!(!rough.is_thin && rough.roughness.is(0.5));
    near(found.absorption, [0.0, 0.5f32.ln() / -2.0, 0.25f32.ln() / -2.0]);
    let leaf = json!({ "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [0.1, 0.9, 0.1] } });
    let leaf = surface(json!({ "pbrMetallicRoughness": pbr(0.0, 0.5), "extensions": leaf }));
    let Surface::Principled(leaf) = leaf else { panic!("{leaf:?}") };
    assert_eq!(
        (leaf.translucency, leaf.translucent),
        (FloatTexture::Constant(0.5), Paint::Constant(Vec3::new(0.1, 0.9, 0.1)))
    );
}

/// Roughness and metal, normals and transmission come from their textures, of eight bits that mean numbers.
fn textures_of_numbers_are_read_as_numbers() {
    let mut file = room();
    let view = file.view(&png([128, 64, 255, 255], [255, 255, 0, 255]));
    textured(&mut file, json!({ "bufferView": view, "mimeType": "image/png" }));
    file.json["materials"][0]["normalTexture"] = json!({ "index": 0, "scale": 0.5 });
    file.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": 0 });
    file.json["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = json!(0.5);
    file.json["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = json!(1);
    let scene = scene(&file);
    let Surface::Principled(found) = scene.materials[0].surface else { panic!("not mixed") };
    let top = Vec2::new(0.5, 0.75);
    let at = |level: FloatTexture| level.at(&scene.textures, top);
    assert!((at(found.metallic) - 0.5).abs() < 1e-6 && (at(found.roughness) - 64.0 / 255.0).abs() < 1e-6);
    let Some(Relief::Normals(id, scale)) = scene.materials[0].relief else { panic!("no normals") };
    assert_eq!((scale, scene.textures[id.0 as usize].texels.at(0)[0]), (0.5, 128.0 / 255.0));
    // The colours are those of sRGB, and both images are of four bytes a texel.
    let bytes: u64 = scene.textures.iter().map(|texture| texture.texels.bytes()).sum();
    let count: usize = scene.textures.iter().map(|texture| texture.texels.count()).sum();
    assert_eq!(bytes, 4 * count as u64);
}
