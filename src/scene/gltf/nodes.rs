//! The tree of nodes, with each node's place in the world.

use std::path::Path;

use glam::DMat4;
use gltf::{Document, Node};

use super::super::names::UniqueNames;
use super::plain;
use crate::error::{Error, Result};

/// A node that stands in the scene.
pub(super) struct Placed<'a> {
    pub(super) node: Node<'a>,
    /// Its name, or that of what it carries; no two are the same.
    pub(super) name: String,
    pub(super) world: DMat4,
}

/// The nodes of the scene that the file shows first, parents before their children, by their transforms. Errors: a node that is reached twice, as in
/// a cycle, and transforms that are not finite.
pub(super) fn walk<'a>(path: &Path, document: &'a Document, transforms: &[DMat4]) -> Result<Vec<Placed<'a>>> {
    let refuse = |problem: String| Error::input(path.display().to_string(), problem, "export the file again");
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let scene = scene.ok_or_else(|| refuse("has no scene".into()))?;
    let mut reached = vec![false; document.nodes().len()];
    let mut names = UniqueNames::default();
    let mut placed = Vec::new();
    let mut waiting: Vec<(Node<'a>, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    waiting.reverse();
    while let Some((node, above)) = waiting.pop() {
        let index = node.index();
        if std::mem::replace(&mut reached[index], true) {
            return Err(refuse(format!("node {index} is reached twice: nodes must form a tree, without cycles")));
        }
        let world = above * transforms.get(index).copied().unwrap_or_default();
        if !world.is_finite() || world.to_cols_array().iter().any(|v| v.abs() > f64::from(f32::MAX)) {
            return Err(refuse(format!("the transform of node {index} is not finite")));
        }
        let below = waiting.len();
        waiting.extend(node.children().map(|child| (child, world)));
        waiting[below..].reverse();
        let carried = || {
            let mesh = node.mesh().and_then(|mesh| mesh.name());
            let light = node.light().and_then(|light| light.name());
            mesh.or(light).or(node.camera().and_then(|camera| camera.name()))
        };
        let name = node.name().filter(|name| !name.is_empty()).or_else(carried).filter(|name| !name.is_empty());
        let name = names.unique(name.map_or_else(|| format!("node {index}"), plain));
        placed.push(Placed { node, name, world });
    }
    Ok(placed)
}
