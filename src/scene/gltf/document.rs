//! The frame of GLB and the JSON in it.

use std::borrow::Cow;
use std::path::Path;

use serde_json::Value;

use super::super::memory::MemoryBound;
use super::plain;
use super::tree::JsonTree;
use crate::error::{Error, Result, Warnings};
use crate::files::read_input;

/// Bytes of a file at most: what the lengths of GLB can say.
pub(super) const MAX_BYTES: u64 = 4 << 30;

/// Extensions whose meaning is read.
const READ: &[&str] = &[
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Extensions that change nothing in a picture of what the file shows first, by the beginnings of their names.
const WITHOUT_EFFECT: &[&str] = &[
    "CESIUM_primitive_outline",
    "EXT_feature_metadata",
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "FB_ngon_encoding",
    "GODOT_single_root",
    "KHR_animation_pointer",
    "KHR_audio",
    "KHR_interactivity",
    "KHR_materials_variants",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics",
    "KHR_xmp",
    "MSFT_lod",
    "MSFT_packing_",
    "OMI_",
];

/// A file's tree, and the binary chunk of a GLB.
pub(super) struct GltfFile {
    pub(super) tree: JsonTree,
    pub(super) binary: Option<Vec<u8>>,
}

/// Reads a `.gltf` or `.glb` file, told by its first bytes.
pub(super) fn open(path: &Path, memory: &mut MemoryBound, warnings: &mut Warnings) -> Result<GltfFile> {
    let length = std::fs::metadata(path).map_or(0, |found| found.len());
    memory.check(length, path)?;
    let mut bytes = read_input(path, "read the scene", MAX_BYTES)?;
    let (text, binary) = match bytes.starts_with(b"glTF") {
        true => split(path, &mut bytes)?,
        false => (bytes, None),
    };
    memory.take(tree_bytes(&text), path)?;
    memory.take(binary.as_ref().map_or(0, |b| b.len() as u64), path)?;
    Ok(GltfFile { tree: tree(path, &text, warnings)?, binary })
}

fn refuse(path: &Path, problem: impl Into<String>) -> Error {
    Error::input(path.display().to_string(), problem.into(), "export the file again as glTF 2.0")
}

/// The JSON and the binary chunk of a GLB. Chunks of other kinds are passed over, as the format wants it.
fn split(path: &Path, bytes: &mut Vec<u8>) -> Result<(Vec<u8>, Option<Vec<u8>>)> {
    let number = |bytes: &[u8], at: usize| {
        let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
        four.map(u32::from_le_bytes).ok_or_else(|| refuse(path, "the GLB file ends within a header"))
    };
    let (version, length) = (number(bytes, 4)?, number(bytes, 8)? as usize);
    if version != 2 {
        return Err(refuse(path, format!("is GLB of version {version}; version 2 is read")));
    }
    if length > bytes.len() || length < 20 {
        let problem = format!("is truncated: its header says {length} bytes, and it has {}", bytes.len());
        return Err(refuse(path, problem));
    }
    bytes.truncate(length);
    let chunk = |bytes: &[u8], at: usize| -> Result<([u8; 4], std::ops::Range<usize>)> {
        let (size, kind) = (number(bytes, at)? as usize, number(bytes, at + 4)?.to_le_bytes());
        match at + 8 + size <= bytes.len() {
            true => Ok((kind, at + 8..at + 8 + size)),
            false => Err(refuse(path, format!("is truncated: a chunk of {size} bytes goes past its end"))),
        }
    };
    let (kind, json) = chunk(bytes, 12)?;
    if kind != *b"JSON" {
        return Err(refuse(path, "has another chunk where that of JSON should be"));
    }
    let (mut at, mut binary) = (json.end.next_multiple_of(4), None);
    while binary.is_none() && at + 8 <= bytes.len() {
        let (kind, range) = chunk(bytes, at)?;
        at = range.end.next_multiple_of(4);
        binary = (kind == *b"BIN\0").then(|| bytes[range].to_vec());
    }
    bytes.truncate(json.end);
    bytes.drain(..json.start);
    Ok((std::mem::take(bytes), binary))
}

/// Memory of the tree of a JSON text at most: a node of a map holds eleven members.
fn tree_bytes(text: &[u8]) -> u64 {
    let (mut bytes, mut in_text, mut escaped) = (3 * text.len() as u64, false, false);
    for &byte in text {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = in_text,
            b'"' => {
                in_text = !in_text;
                bytes += 16;
            }
            b'{' if !in_text => bytes += 720,
            b'[' | b',' if !in_text => bytes += 64,
            _ => {}
        }
    }
    bytes
}

/// The tree of a JSON text. No error quotes the text.
fn tree(path: &Path, text: &[u8], warnings: &mut Warnings) -> Result<JsonTree> {
    // A mark of the byte order, and the zeros that fill up a chunk, are no JSON.
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let end = text.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    let text = match std::str::from_utf8(&text[..end]) {
        Ok(text) => Cow::Borrowed(text),
        // Names of exporters that know no UTF-8 are Latin-1.
        Err(_) => text[..end].iter().map(|&byte| char::from(byte)).collect(),
    };
    let root: Value = serde_json::from_str(&text)
        .map_err(|error| refuse(path, format!("is no JSON (line {}, column {})", error.line(), error.column())))?;
    let version = match root.get("asset").and_then(|asset| asset.get("version")) {
        Some(Value::String(version)) => version.clone(),
        Some(Value::Number(version)) => version.to_string(),
        // The lists of glTF 1 are objects.
        _ if root.get("meshes").is_some_and(Value::is_object) => "1".into(),
        _ => return Err(refuse(path, "is no glTF 2.0: its asset states no version")),
    };
    if version != "2" && !version.starts_with("2.") {
        return Err(refuse(path, "is glTF of another version than 2"));
    }
    if let Some(list) = unknown(&root, "extensionsRequired") {
        let hint = "export it without (textures as PNG, JPEG or WebP)";
        let problem = format!("requires extensions that are not read: {list}");
        return Err(Error::input(path.display().to_string(), problem, hint));
    }
    if let Some(list) = unknown(&root, "extensionsUsed") {
        warnings.push(format!("{}: extensions that are not read are left out: {list}", path.display()));
    }
    Ok(JsonTree::new(root, path.display().to_string()))
}

/// The extensions of a list that are not read and may have an effect.
fn unknown(root: &Value, key: &str) -> Option<String> {
    let names = root.get(key).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str);
    let is_known = |name: &str| READ.contains(&name) || WITHOUT_EFFECT.iter().any(|begin| name.starts_with(begin));
    let unknown: Vec<String> = names.filter(|name| !is_known(name)).map(plain).collect();
    let more = unknown.len().saturating_sub(8);
    let list = unknown.iter().take(8).map(String::as_str).collect::<Vec<_>>().join(", ");
    (!unknown.is_empty()).then(|| if more > 0 { format!("{list} and {more} more") } else { list })
}
