//! The frame of GLB and the JSON in it.

use std::path::Path;

use glam::DMat4;
use gltf::Document;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;

use super::super::memory::Memory;
use super::{exact, plain};
use crate::error::{Error, Result};
use crate::files::read_input;

/// Bytes of a file at most: what the lengths of GLB can say.
pub(super) const MOST_BYTES: u64 = 4 << 30;
/// Memory of the tree for each byte of its text.
const TREE_BYTES: u64 = 24;

/// Extensions whose meaning is read, or that change nothing here.
const KNOWN: [&str; 11] = [
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// A file's tree, and the binary chunk of a GLB.
pub(super) struct Opened {
    pub(super) document: Document,
    /// Of each node, relative to the one above.
    pub(super) transforms: Vec<DMat4>,
    pub(super) binary: Option<Vec<u8>>,
}

/// Reads a `.gltf` or `.glb` file, told by its first bytes.
pub(super) fn open(path: &Path, memory: &mut Memory, warnings: &mut Vec<String>) -> Result<Opened> {
    let length = std::fs::metadata(path).map_or(0, |found| found.len());
    memory.check(length, path)?;
    let mut bytes = read_input(path, "read the scene", MOST_BYTES)?;
    let (text, binary) = match bytes.starts_with(b"glTF") {
        true => split(path, &mut bytes)?,
        false => (bytes, None),
    };
    memory.take((text.len() as u64).saturating_mul(TREE_BYTES), path)?;
    memory.take(binary.as_ref().map_or(0, |b| b.len() as u64), path)?;
    let document = tree(path, &text, warnings)?;
    Ok(Opened { transforms: exact::transforms(&document, &text), document, binary })
}

fn refuse(path: &Path, problem: impl Into<String>) -> Error {
    Error::input(path.display().to_string(), problem.into(), "export the file again as glTF 2.0")
}

/// The JSON and the binary chunk of a GLB.
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
    let chunk = |bytes: &[u8], at: usize, kind: &[u8; 4]| -> Result<std::ops::Range<usize>> {
        let size = number(bytes, at)? as usize;
        if bytes.get(at + 4..at + 8) != Some(kind) {
            let kind = String::from_utf8_lossy(kind).trim_end_matches('\0').to_owned();
            return Err(refuse(path, format!("has another chunk where that of {kind} should be")));
        }
        match at + 8 + size <= bytes.len() {
            true => Ok(at + 8..at + 8 + size),
            false => Err(refuse(path, format!("is truncated: a chunk of {size} bytes goes past its end"))),
        }
    };
    let json = chunk(bytes, 12, b"JSON")?;
    let after = json.end.next_multiple_of(4);
    let binary = if after + 8 <= bytes.len() { Some(chunk(bytes, after, b"BIN\0")?) } else { None };
    let binary = binary.map(|range| bytes[range].to_vec());
    bytes.truncate(json.end);
    bytes.drain(..json.start);
    Ok((std::mem::take(bytes), binary))
}

/// The tree of a JSON text, whose indices are all in range. No error quotes the text.
fn tree(path: &Path, text: &[u8], warnings: &mut Vec<String>) -> Result<Document> {
    let parsed = gltf::json::deserialize::from_slice::<gltf::json::Root>(text);
    let mut root = parsed.map_err(|error| {
        let what = if error.is_data() { "is no glTF 2.0" } else { "is no JSON" };
        refuse(path, format!("{what} (line {}, column {})", error.line(), error.column()))
    })?;
    if !root.asset.version.starts_with("2.") {
        return Err(refuse(path, "is glTF of another version than 2"));
    }
    let unknown = |names: &[String]| {
        let unknown: Vec<String> = names.iter().filter(|n| !KNOWN.contains(&n.as_str())).map(|n| plain(n)).collect();
        let more = unknown.len().saturating_sub(8);
        let list = unknown.iter().take(8).map(String::as_str).collect::<Vec<_>>().join(", ");
        (!unknown.is_empty()).then(|| if more > 0 { format!("{list} and {more} more") } else { list })
    };
    if let Some(list) = unknown(&root.extensions_required) {
        let hint = "export it without (no Draco or meshopt compression, textures as PNG or JPEG)";
        let problem = format!("requires extensions that are not read: {list}");
        return Err(Error::input(path.display().to_string(), problem, hint));
    }
    if let Some(list) = unknown(&root.extensions_used) {
        warnings.push(format!("{}: extensions that are not read are left out: {list}", path.display()));
    }
    // The crate looks these up before it checks them.
    let position = Checked::Valid(Semantic::Positions);
    let positions = root.meshes.iter().flat_map(|mesh| &mesh.primitives).filter_map(|p| p.attributes.get(&position));
    if positions.into_iter().any(|index| index.value() >= root.accessors.len()) {
        return Err(refuse(path, "breaks the rules of glTF (positions of a mesh name an accessor that is not there)"));
    }
    // Checked above, by a list that has more in it than the crate's.
    root.extensions_required.clear();
    Document::from_json(root).map_err(|error| match error {
        gltf::Error::Validation(faults) => {
            let first = faults.first().map_or(String::new(), |(at, fault)| format!("{at}: {fault}"));
            refuse(path, format!("breaks the rules of glTF ({})", plain(&first)))
        }
        _ => refuse(path, "breaks the rules of glTF"),
    })
}
