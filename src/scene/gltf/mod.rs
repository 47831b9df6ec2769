//! glTF 2.0: from `.gltf` and `.glb` files to triangles, materials, cameras and lamps.
//!
//! Values are validated where they are used, within bounds: no accessor is trusted, and no allocation exceeds what the
//! file's own bytes and the memory allow. Parts that are not used, such as animations, are not read.

mod accessors;
mod base64;
mod buffers;
mod cameras;
mod colours;
mod compressed;
mod document;
mod ies;
mod lamps;
mod materials;
mod nodes;
mod primitives;
mod skies;
mod tree;

use std::path::Path;

pub(super) use cameras::{FileCamera, seeing_all};

use super::file::LightEntry;
use super::folders::Folders;
use super::memory::MemoryBound;
use super::source::Geometry;
use crate::error::{Result, Warnings};

/// What a file has beside its geometry and its materials.
#[derive(Debug, Default)]
pub(super) struct FileExtras {
    /// Cameras, in the order of the nodes.
    pub(super) cameras: Vec<FileCamera>,
    /// Its lamps, in the form of scene file entries.
    pub(super) lamps: Vec<LightEntry>,
}

/// Whether a path names a glTF file.
pub(super) fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

/// Reads a file and adds its geometry and materials.
///
/// # Errors
/// One line that names the file, what is wrong in it and where.
pub(super) fn read(
    path: &Path,
    geometry: &mut Geometry,
    folders: &Folders,
    memory: &mut MemoryBound,
    warnings: &mut Warnings,
) -> Result<FileExtras> {
    let mut file = document::open(path, memory, warnings)?;
    let buffers = buffers::load(path, &file.tree, file.binary.take(), folders, memory)?;
    let nodes = nodes::walk(path, &buffers, memory, warnings)?;
    let materials = materials::describe(path, &buffers, warnings)?;
    let first_material = geometry.materials.len();
    geometry.materials.extend(materials);
    primitives::add(path, &nodes, &buffers, first_material, geometry, memory, warnings)?;
    let mut lamps = lamps::of(path, &nodes, warnings)?;
    lamps.extend(ies::of(path, &file.tree, &nodes, &buffers, folders, warnings)?);
    let sky = skies::of(path, &file.tree, &buffers, folders, memory, warnings)?;
    // A node may have its name.
    lamps.extend(sky.map(|sky| named_apart(sky, &nodes)));
    Ok(FileExtras { cameras: cameras::of(path, &file.tree, &nodes, warnings)?, lamps })
}

/// A light that no node carries, under a name that no node has.
fn named_apart(mut light: LightEntry, nodes: &[nodes::Placed<'_>]) -> LightEntry {
    if let Some(name) = &mut light.name {
        while nodes.iter().any(|placed| placed.name == *name) {
            name.push_str(" sky");
        }
    }
    light
}

/// A name from the file as one line of bounded length.
fn plain(name: &str) -> String {
    name.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect()
}
