//! Transforms of nodes as they are written: the crate's own are rounded to f32, which moves what stands in a survey's coordinates.

use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf::Document;
use serde::Deserialize;

/// What of a file is read again.
#[derive(Deserialize)]
struct Written {
    #[serde(default)]
    nodes: Vec<WrittenNode>,
}

#[derive(Default, Deserialize)]
struct WrittenNode {
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

/// The transform of each node relative to the one above, by the text that the document was made from.
pub(super) fn transforms(document: &Document, text: &[u8]) -> Vec<DMat4> {
    let written = gltf::json::deserialize::from_slice::<Written>(text).map(|written| written.nodes).unwrap_or_default();
    let of = |node: gltf::Node<'_>| written.get(node.index()).map_or_else(|| rounded(&node), exact);
    document.nodes().map(of).collect()
}

fn exact(node: &WrittenNode) -> DMat4 {
    match node.matrix {
        Some(matrix) => DMat4::from_cols_array(&matrix),
        None => composed(
            node.translation.unwrap_or_default(),
            node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]),
            node.scale.unwrap_or([1.0; 3]),
        ),
    }
}

/// By the document alone, where the text says it in another way than this room reads.
fn rounded(node: &gltf::Node<'_>) -> DMat4 {
    match node.transform() {
        gltf::scene::Transform::Matrix { matrix } => DMat4::from_cols_array_2d(&matrix.map(|c| c.map(f64::from))),
        gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
            composed(translation.map(f64::from), rotation.map(f64::from), scale.map(f64::from))
        }
    }
}

fn composed(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DMat4 {
    let turn = DQuat::from_vec4(DVec4::from(rotation)).normalize();
    DMat4::from_scale_rotation_translation(DVec3::from(scale), turn, DVec3::from(translation))
}
