//! Small glTF files, written byte by byte.

use serde_json::{Value, json};

/// A file under construction: its JSON, and its one buffer.
pub(super) struct Glb {
    pub(super) json: Value,
    pub(super) bytes: Vec<u8>,
}

pub(super) const F32: u32 = 5126;
pub(super) const U8: u32 = 5121;
pub(super) const U16: u32 = 5123;
pub(super) const U32: u32 = 5125;
pub(super) const I16: u32 = 5122;

impl Glb {
    pub(super) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [], "materials": [], "images": [], "textures": [],
            "cameras": [], "extensionsUsed": [], "extensionsRequired": [],
        });
        Self { json, bytes: Vec::new() }
    }

    /// Adds to a list of the file and returns the place there.
    pub(super) fn push(&mut self, list: &str, item: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    }

    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    pub(super) fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }))
    }

    pub(super) fn vectors<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, F32, &format!("VEC{N}"), values.len())
    }

    pub(super) fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        self.accessor(&bytes, U16, "SCALAR", indices.len())
    }

    /// A mesh of one quadrilateral, without normals.
    pub(super) fn quad(&mut self, corners: [[f32; 3]; 4], material: usize) -> usize {
        let positions = self.vectors(&corners);
        let indices = self.indices(&[0, 1, 2, 0, 2, 3]);
        let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
        self.push("meshes", json!({ "primitives": [primitive] }))
    }

    /// A node at the root of the scene.
    pub(super) fn root(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(index));
        index
    }

    pub(super) fn uses(&mut self, extension: &str) {
        self.push("extensionsUsed", json!(extension));
    }

    /// The JSON, with the bounds that positions must state, and without the lists that are empty, which the format does not
    /// allow.
    pub(super) fn document(&self) -> Value {
        let mut json = self.json.clone();
        let primitives =
            self.json["meshes"].as_array().unwrap().iter().flat_map(|m| m["primitives"].as_array().unwrap());
        for accessor in primitives.filter_map(|p| p["attributes"]["POSITION"].as_u64()) {
            let accessor = &mut json["accessors"][accessor as usize];
            (accessor["min"], accessor["max"]) = (json!([-1e3, -1e3, -1e3]), json!([1e3, 1e3, 1e3]));
        }
        json.as_object_mut().unwrap().retain(|_, v| v.as_array().is_none_or(|list| !list.is_empty()));
        json
    }

    pub(super) fn to_glb(&self) -> Vec<u8> {
        let mut json = self.document();
        if json.get("buffers").is_none() {
            json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        glb(json.to_string().as_bytes(), &self.bytes)
    }
}

/// The frame of a GLB file.
pub(super) fn glb(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, binary) = (padded(json, b' '), padded(binary, 0));
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((12 + 8 + json.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

/// The room of `room("")` in one file, with its camera.
pub(super) fn room() -> Glb {
    let mut file = Glb::new();
    let pbr = |base: [f32; 4]| json!({ "baseColorFactor": base, "metallicFactor": 0, "roughnessFactor": 0.5 });
    let ground = file.push("materials", json!({ "name": "ground", "pbrMetallicRoughness": pbr([0.5, 0.4, 0.3, 1.0]) }));
    let lamp = json!({
        "name": "lamp", "pbrMetallicRoughness": pbr([0.0, 0.0, 0.0, 1.0]), "emissiveFactor": [1.0, 0.5, 0.25],
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 } },
    });
    let lamp = file.push("materials", lamp);
    file.uses("KHR_materials_emissive_strength");
    let floor = [[-5.0, 0.0, -5.0], [-5.0, 0.0, 5.0], [5.0, 0.0, 5.0], [5.0, 0.0, -5.0]];
    let floor = file.quad(floor, ground);
    let bulb = file.quad([[-1.0, 3.0, 0.0], [1.0, 3.0, 0.0], [1.0, 3.0, 1.0], [-1.0, 3.0, 1.0]], lamp);
    file.root(json!({ "name": "floor", "mesh": floor }));
    file.root(json!({ "name": "bulb", "mesh": bulb }));
    let lens = json!({ "yfov": std::f32::consts::FRAC_PI_4, "znear": 0.1, "aspectRatio": 4.0 / 3.0 });
    let camera = file.push("cameras", json!({ "name": "lens", "type": "perspective", "perspective": lens }));
    file.root(json!({ "name": "eye", "camera": camera, "translation": [0.0, 1.0, 4.0] }));
    file
}
