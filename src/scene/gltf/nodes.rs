//! The tree of nodes, with each node's place in the world.

use std::path::Path;

use glam::{DMat4, DQuat, DVec3};

use super::super::memory::MemoryBound;
use super::super::names::UniqueNames;
use super::buffers::Buffers;
use super::plain;
use super::tree::{JsonItem, JsonTree};
use crate::error::{Error, Result, Warnings};

/// Memory of an instance that a node shows: its transform and its name.
const INSTANCE_BYTES: u64 = 256;

/// A node that stands in the scene.
pub(super) struct Placed<'a> {
    pub(super) node: JsonItem<'a>,
    /// Its name, or that of what it carries; no two are the same.
    pub(super) name: String,
    pub(super) world: DMat4,
    /// The mesh that it shows.
    pub(super) mesh: Option<usize>,
    /// The lamp that it carries, as the file's list has it.
    pub(super) light: Option<JsonItem<'a>>,
    /// Where its mesh stands, instead of once at the node: names and transforms (`EXT_mesh_gpu_instancing`).
    pub(super) instances: Option<Vec<(String, DMat4)>>,
}

/// The scene that the file shows first, if it has any.
pub(super) fn shown(tree: &JsonTree) -> Result<Option<JsonItem<'_>>> {
    match tree.root().index("scene", "scenes")? {
        None if tree.count("scenes") == 0 => Ok(None),
        index => tree.item("scenes", index.unwrap_or(0)).map(Some),
    }
}

/// The nodes of the scene that the file shows first, parents before their children, but those that are not visible. Errors: a
/// node that is reached twice, as in a cycle, and transforms that are not finite.
pub(super) fn walk<'a>(
    path: &Path,
    buffers: &Buffers<'a>,
    memory: &mut MemoryBound,
    warnings: &mut Warnings,
) -> Result<Vec<Placed<'a>>> {
    let tree = buffers.tree;
    let refuse = |problem: String| Error::input(path.display().to_string(), problem, "export the file again");
    let lights = match tree.root().extension("KHR_lights_punctual")? {
        Some(all) => all.objects("lights")?,
        None => Vec::new(),
    };
    let mut reached = vec![false; tree.count("nodes")];
    let mut names = UniqueNames::default();
    let mut placed = Vec::new();
    let mut waiting: Vec<(usize, DMat4)> =
        roots(path, tree, warnings)?.into_iter().map(|n| (n, DMat4::IDENTITY)).collect();
    waiting.reverse();
    while let Some((index, above)) = waiting.pop() {
        let node = tree.item("nodes", index)?;
        if std::mem::replace(&mut reached[index], true) {
            return Err(refuse(format!("node {index} is reached twice: nodes must form a tree, without cycles")));
        }
        let visibility = node.extension("KHR_node_visibility")?;
        if let Some(visibility) = visibility
            && visibility.flag("visible")? == Some(false)
        {
            continue;
        }
        let world = above * matrix(&node)?;
        if !is_usable(&world) {
            return Err(refuse(format!("the transform of node {index} is not finite")));
        }
        let below = waiting.len();
        waiting.extend(node.indices("children", "nodes")?.into_iter().map(|child| (child, world)));
        waiting[below..].reverse();
        let mesh = node.index("mesh", "meshes")?;
        let light = light(&node, &lights)?;
        let name = match (node.name(), mesh, &light, node.index("camera", "cameras")?) {
            (Some(name), ..) => Some(name),
            (_, Some(mesh), ..) => tree.item("meshes", mesh)?.name(),
            (_, _, Some(light), _) => light.name(),
            (_, _, _, Some(camera)) => tree.item("cameras", camera)?.name(),
            _ => None,
        };
        let name = names.unique(name.map_or_else(|| format!("node {index}"), plain));
        let instances = match mesh.and(node.extension("EXT_mesh_gpu_instancing")?) {
            Some(stated) => Some(instances(path, &stated, buffers, &name, world, &mut names, memory)?),
            None => None,
        };
        placed.push(Placed { node, name, world, mesh, light, instances });
    }
    Ok(placed)
}

/// The nodes that the scene begins with; without a scene, all that are nobody's children.
fn roots(path: &Path, tree: &JsonTree, warnings: &mut Warnings) -> Result<Vec<usize>> {
    let scenes = tree.count("scenes");
    if let Some(scene) = shown(tree)? {
        if scenes > 1 && !tree.root().has("scene") {
            warnings.push(format!(
                "{}: does not say which of its {scenes} scenes it shows; the first is taken",
                path.display()
            ));
        }
        return scene.indices("nodes", "nodes");
    }
    if tree.count("nodes") == 0 {
        return Err(Error::input(path.display().to_string(), "has no scene", "export the file again"));
    }
    warnings.push(format!("{}: has no scene; all of its nodes are shown", path.display()));
    let mut is_child = vec![false; tree.count("nodes")];
    for index in 0..is_child.len() {
        for child in tree.item("nodes", index)?.indices("children", "nodes")? {
            is_child[child] = true;
        }
    }
    Ok((0..is_child.len()).filter(|&index| !is_child[index]).collect())
}

/// The lamp of a node.
fn light<'a>(node: &JsonItem<'a>, lights: &[JsonItem<'a>]) -> Result<Option<JsonItem<'a>>> {
    let Some(stated) = node.extension("KHR_lights_punctual")? else { return Ok(None) };
    let Some(index) = stated.whole("light")? else { return Ok(None) };
    match lights.get(index) {
        Some(light) => Ok(Some(light.clone())),
        None => Err(stated.refuse("light", &format!("lights[{index}] is not there"))),
    }
}

/// The places of a mesh that a node shows many times: the node's own transform after that of each instance. Errors: lists of
/// different lengths, transforms that are not finite.
fn instances(
    path: &Path,
    stated: &JsonItem<'_>,
    buffers: &Buffers<'_>,
    name: &str,
    world: DMat4,
    names: &mut UniqueNames,
    memory: &mut MemoryBound,
) -> Result<Vec<(String, DMat4)>> {
    let attributes = stated.object("attributes")?.ok_or_else(|| stated.refuse("attributes", "is missing"))?;
    let accessor = |key: &str| attributes.index(key, "accessors")?.map(|index| buffers.accessor(index)).transpose();
    let (translations, rotations, scales) = (accessor("TRANSLATION")?, accessor("ROTATION")?, accessor("SCALE")?);
    let counts = [&translations, &rotations, &scales].map(|accessor| accessor.as_ref().map(|accessor| accessor.count));
    let count = counts.into_iter().flatten().next().unwrap_or(0);
    if counts.into_iter().flatten().any(|other| other != count) {
        return Err(stated.refuse("attributes", "have different numbers of instances"));
    }
    // No more than the file has bytes for is read.
    memory.take((count.min(buffers.len()) as u64).saturating_mul(INSTANCE_BYTES), path)?;
    let translations: Option<Vec<[f32; 3]>> = translations.map(|a| buffers.finite(&a, "translation")).transpose()?;
    let rotations: Option<Vec<[f32; 4]>> = rotations.map(|a| buffers.finite(&a, "rotation")).transpose()?;
    let scales: Option<Vec<[f32; 3]>> = scales.map(|a| buffers.finite(&a, "scale")).transpose()?;
    let instance = |i: usize| {
        let translation = translations.as_ref().map_or([0.0; 3], |list| list[i]);
        let rotation = rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |list| list[i]);
        let scale = scales.as_ref().map_or([1.0; 3], |list| list[i]);
        let world = world * decomposed(translation.map(f64::from), rotation.map(f64::from), scale.map(f64::from));
        match is_usable(&world) {
            true => Ok((if i == 0 { name.to_owned() } else { names.unique(name.to_owned()) }, world)),
            false => Err(stated.refuse("attributes", &format!("the transform of instance {i} is not finite"))),
        }
    };
    (0..count).map(instance).collect()
}

fn is_usable(world: &DMat4) -> bool {
    world.to_cols_array().iter().all(|v| v.is_finite() && v.abs() <= f64::from(f32::MAX))
}

fn matrix(node: &JsonItem<'_>) -> Result<DMat4> {
    if let Some(matrix) = node.exact_numbers::<16>("matrix")? {
        return Ok(DMat4::from_cols_array(&matrix));
    }
    let translation = node.exact_numbers("translation")?.unwrap_or([0.0; 3]);
    let rotation = node.exact_numbers("rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let scale = node.exact_numbers("scale")?.unwrap_or([1.0; 3]);
    Ok(decomposed(translation, rotation, scale))
}

fn decomposed(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DMat4 {
    let turn = DQuat::from_array(rotation).normalize();
    DMat4::from_scale_rotation_translation(DVec3::from_array(scale), turn, DVec3::from_array(translation))
}
