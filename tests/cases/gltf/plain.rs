//! A plain glTF file, what changes are made of, and what is seen of it.

use std::f32::consts::{FRAC_1_SQRT_2, PI};

use glam::Vec3;
use ltm::matrix::{MatrixShape, TracedBlock};
use ltm::scene::{LoadedScene, Projection, Scene, load};
use ltm::trace::{TraceSettings, Tracer};
use serde_json::{Value, json};

/// The floor's four corners and its indices, 16 bits each.
pub(super) fn floor_bytes() -> Vec<u8> {
    let corners = [[-10.0f32, 0.0, -10.0], [-10.0, 0.0, 10.0], [10.0, 0.0, 10.0], [10.0, 0.0, -10.0]];
    let indices = [0u16, 1, 2, 0, 2, 3];
    let corners = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes());
    corners.chain(indices.iter().flat_map(|i| i.to_le_bytes())).collect()
}

/// Turns −z down, and y to −z.
pub(super) fn down() -> Value {
    json!([-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2])
}

pub(super) fn data_uri(bytes: &[u8]) -> String {
    let letter =
        |bits: u32| b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"[bits as usize & 63] as char;
    let mut text = String::from("data:application/octet-stream;base64,");
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0u32, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        (0..group.len() + 1).for_each(|i| text.push(letter(bits >> (18 - 6 * i))));
    }
    text
}

/// The floor, its lamp, and a camera that sees the floor's middle from above.
pub(super) fn plain() -> Value {
    let bytes = floor_bytes();
    json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [
            { "name": "floor", "mesh": 0 },
            { "name": "bulb", "translation": [0, 2, 0], "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "name": "cam", "camera": 0, "translation": [0, 10, 0], "rotation": down() },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{
            "name": "floor",
            "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0 },
            "extensions": { "KHR_materials_specular": { "specularFactor": 0 } },
        }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-10, 0, -10], "max": [10, 0, 10] },
            { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 12 },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": data_uri(&bytes) }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.002, "znear": 0.1, "aspectRatio": 1.0 } }],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_specular"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 683.0 }] } },
    })
}

pub(super) const PLAIN: f32 = 0.5 / PI / 4.0;

pub(super) fn changed(change: impl FnOnce(&mut Value)) -> Value {
    let mut json = plain();
    change(&mut json);
    json
}

pub(super) fn push(json: &mut Value, list: &str, item: Value) -> usize {
    if json[list].is_null() {
        json[list] = json!([]);
    }
    let list = json[list].as_array_mut().unwrap();
    list.push(item);
    list.len() - 1
}

/// A view of bytes that come along in a buffer of their own.
pub(super) fn view(json: &mut Value, bytes: &[u8]) -> usize {
    let buffer = push(json, "buffers", json!({ "byteLength": bytes.len(), "uri": data_uri(bytes) }));
    push(json, "bufferViews", json!({ "buffer": buffer, "byteLength": bytes.len() }))
}

pub(super) fn vectors<const N: usize>(json: &mut Value, values: &[[f32; N]]) -> usize {
    let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = view(json, &bytes);
    let kind = format!("VEC{N}");
    push(json, "accessors", json!({ "bufferView": view, "componentType": 5126, "count": values.len(), "type": kind }))
}

pub(super) fn opened(bytes: impl AsRef<[u8]>) -> ltm::Result<LoadedScene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, bytes).unwrap();
    load(&path)
}

pub(super) fn read(json: &Value) -> LoadedScene {
    opened(json.to_string()).unwrap_or_else(|error| panic!("{error}"))
}

/// What the middle of the picture shows, under all lights as the file states them.
pub(super) fn middle(scene: Scene) -> Vec3 {
    let weights: Vec<_> = scene.basis.scene_weights();
    let shape = MatrixShape::new(3, 3, weights.len() as u32, 4).unwrap();
    let settings = TraceSettings { samples_per_pixel: 1024, seed: 1, max_depth: 2 };
    let (width, height) = (scene.camera.width, scene.camera.height);
    assert_eq!(width, height, "the camera is square");
    let scene = LoadedScene::new(scene, Default::default(), Default::default()).sized(3, 3).scene;
    let tracer = Tracer::new(scene, shape, settings).unwrap();
    let mut traced = TracedBlock::default();
    tracer.trace_block(shape.blocks().next().unwrap(), &mut traced);
    let rows = traced.block.rows();
    // Rows are channel by channel; all pixels of this small picture are alike.
    let middle = |channel: usize| {
        let of_column = |column: usize| {
            let entries = &traced.block.entries()[column * rows..][channel * rows / 3..(channel + 1) * rows / 3];
            entries.iter().map(|v| f64::from(*v)).sum::<f64>() / entries.len() as f64
        };
        weights.iter().enumerate().map(|(column, weight)| of_column(column) * f64::from(weight[channel])).sum::<f64>()
            as f32
    };
    Vec3::new(middle(0), middle(1), middle(2))
}

pub(super) fn near(found: Vec3, wanted: Vec3) {
    // The lamp's light falls off by less than a ten thousandth over the little that the picture shows.
    assert!((found - wanted).length() <= 1e-3 * wanted.length(), "{found} for {wanted}");
}

/// It shows what the plain file shows, and says nothing.
pub(super) fn as_plain(json: &Value) {
    let loaded = read(json);
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    near(middle(loaded.scene), Vec3::splat(PLAIN));
}

/// It shows what the plain file shows, and says these words once.
pub(super) fn as_plain_but_says(json: &Value, words: &str) {
    let loaded = read(json);
    let said = loaded.warnings.iter().filter(|warning| warning.text.contains(words)).count();
    assert_eq!(said, 1, "'{words}' in {:?}", loaded.warnings);
    near(middle(loaded.scene), Vec3::splat(PLAIN));
}

pub(super) fn refused(json: &Value, words: &[&str]) {
    let error = opened(json.to_string()).map(|_| ()).expect_err("it is to be refused").to_string();
    assert!(!error.contains('\n'), "{error}");
    for word in words {
        assert!(error.contains(word), "'{word}' is missing in: {error}");
    }
}

/// A GLB of these chunks.
pub(super) fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, chunk) in chunks {
        body.extend((chunk.len() as u32).to_le_bytes());
        body.extend(*kind);
        body.extend(*chunk);
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((12 + body.len() as u32).to_le_bytes());
    file.extend(body);
    file
}

pub(super) fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// With a camera that sees the floor's middle alone.
pub(super) fn narrowed(mut scene: Scene) -> Scene {
    scene.camera.projection = Projection::Perspective { vertical_fov_radians: 0.002 };
    scene
}
