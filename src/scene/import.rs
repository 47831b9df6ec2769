//! Geometry files into one mesh, with the material description and the object name of every triangle.

use std::collections::HashMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::folders::Folders;
use super::gltf::{FileExtras, GltfMaterial, is_gltf, read as read_gltf};
use super::memory::Memory;
use super::mtl::{self, MtlMaterial};
use super::names::{self, NameList};
use super::obj::{self, ObjFile, ObjPart};
use super::origin::origin_between;
use super::textures::find_as_elsewhere;
use super::{MaterialId, Mesh, Triangle, Vertex};
use crate::error::{Error, Result};
use crate::files::{open_input, read_input};

/// Bytes of a material file at most.
const MOST_MATERIAL_BYTES: u64 = 256 << 20;

/// Height over longest side below which a triangle is degenerate: its normal would be rounding noise.
const THINNEST: f32 = 1e-6;
/// Names that are compared with misspelt ones, in all: each comparison takes the product of their lengths.
const MOST_GUESSES: usize = 10_000;

/// All geometry of a scene before its materials and lights are made.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    pub(super) mesh: Mesh,
    /// What f32 leaves of each vertex's position.
    residuals: Vec<Vec3>,
    /// What [`MaterialId`]s mean.
    pub(super) materials: Vec<SourceMaterial>,
    /// Object names.
    pub(super) objects: NameList,
    /// Index into `objects` for every triangle.
    pub(super) object_of: Vec<u32>,
}

/// A material as its file describes it.
#[derive(Debug)]
pub(super) struct SourceMaterial {
    pub(super) name: String,
    pub(super) description: Description,
}

/// What a file says of a material.
#[derive(Debug)]
pub(super) enum Description {
    /// An MTL file, with the folder of its textures.
    Mtl(Box<MtlMaterial>, PathBuf),
    /// A glTF file.
    Gltf(Box<GltfMaterial>),
}

impl Geometry {
    /// Reads an OBJ or glTF file with its materials and adds it. Returns what else the file has.
    ///
    /// # Errors
    /// Files that are missing or unreadable, what does not fit `memory`, and those of the format's reader.
    pub(super) fn read(
        &mut self,
        path: &Path,
        folders: &Folders,
        memory: &mut Memory,
        warnings: &mut Vec<String>,
    ) -> Result<FileExtras> {
        if is_gltf(path) {
            return read_gltf(path, self, folders, memory, warnings);
        }
        self.read_obj(path, folders, memory, warnings)?;
        Ok(FileExtras::default())
    }

    fn read_obj(
        &mut self,
        path: &Path,
        folders: &Folders,
        memory: &mut Memory,
        warnings: &mut Vec<String>,
    ) -> Result<()> {
        let mut reader = BufReader::new(open_input(path, "read the geometry")?);
        let file = obj::parse(path, &mut reader, memory)?;
        let first_material = self.materials.len();
        self.describe(path, &file, folders, memory, warnings)?;
        let (mut degenerate, mut turned) = (0, 0);
        let before = self.bytes();
        for part in file.parts() {
            let material = MaterialId((first_material + part.material) as u32);
            let object = &file.objects.as_slice()[part.object];
            self.add(&part, object, material, &mut degenerate, &mut turned);
            memory.check(file.bytes() + self.bytes() - before, path)?;
            if self.mesh.vertices.len() > u32::MAX as usize {
                let problem = "the scene has more vertices than 32-bit numbers count";
                return Err(Error::input(path.display().to_string(), problem, "simplify the geometry"));
            }
        }
        memory.take(self.bytes() - before, path)?;
        if degenerate > 0 {
            warnings.push(format!("{}: {degenerate} triangles without area were left out", path.display()));
        }
        if turned > 0 {
            warnings.push(format!("{}: {turned} triangles wound against their normals were turned", path.display()));
        }
        Ok(())
    }

    /// Bytes that the geometry holds.
    pub(super) fn bytes(&self) -> u64 {
        let Mesh { vertices, triangles } = &self.mesh;
        (vertices.capacity() * size_of::<Vertex>()
            + triangles.capacity() * size_of::<Triangle>()
            + self.residuals.capacity() * size_of::<Vec3>()
            + self.object_of.capacity() * 4) as u64
    }

    /// Chooses the scene's origin, and moves all geometry that has been read so that it lies there. Triangles that have no area left once
    /// their corners are rounded are left out.
    pub(super) fn settle(&mut self, place: &str, warnings: &mut Vec<String>) -> DVec3 {
        let (low, high) = self.mesh.bounds();
        let origin = origin_between(low.as_dvec3(), high.as_dvec3());
        let residuals = std::mem::take(&mut self.residuals);
        if origin != DVec3::ZERO {
            for (vertex, residual) in self.mesh.vertices.iter_mut().zip(residuals) {
                let whole = vertex.position.as_dvec3() + residual.as_dvec3();
                vertex.position = (whole - origin).as_vec3();
            }
        }
        let vertices = std::mem::take(&mut self.mesh.vertices);
        let before = self.mesh.triangles.len();
        self.retain(|triangle| {
            let [a, b, c] = triangle.vertices.map(|vertex| vertices[vertex as usize].position);
            let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            (b - a).cross(c - a).length() > THINNEST * longest
        });
        self.mesh.vertices = vertices;
        let left_out = before - self.mesh.triangles.len();
        if left_out > 0 {
            warnings.push(format!("{place}: {left_out} triangles too small for where they stand were left out"));
        }
        origin
    }

    /// Leaves out the triangles for which `keep` says no.
    pub(super) fn retain(&mut self, keep: impl Fn(&Triangle) -> bool) {
        let kept: Vec<bool> = self.mesh.triangles.iter().map(keep).collect();
        let mut each = kept.iter();
        self.mesh.triangles.retain(|_| *each.next().unwrap_or(&true));
        let mut each = kept.iter();
        self.object_of.retain(|_| *each.next().unwrap_or(&true));
    }

    fn describe(
        &mut self,
        path: &Path,
        file: &ObjFile,
        folders: &Folders,
        memory: &mut Memory,
        warnings: &mut Vec<String>,
    ) -> Result<()> {
        let beside = folders.beside(path);
        let mut library: Vec<(MtlMaterial, PathBuf)> = Vec::new();
        for name in &file.libraries {
            let Some(mtl_path) = find_library(name, &beside, path, warnings)? else { continue };
            // The text, and the materials that it describes: fewer bytes than 32 for each of it.
            let text = read_input(&mtl_path, "read the materials", MOST_MATERIAL_BYTES)?;
            memory.take((text.len() as u64).saturating_mul(32), &mtl_path)?;
            let folder = mtl_path.parent().unwrap_or(Path::new("")).to_owned();
            let described = mtl::parse(&mtl_path, &String::from_utf8_lossy(&text))?;
            library.extend(described.into_iter().map(|material| (material, folder.clone())));
        }
        // The first of several of one name counts.
        let mut described: HashMap<&str, usize> = HashMap::new();
        for (index, (material, _)) in library.iter().enumerate() {
            described.entry(&material.name).or_insert(index);
        }
        let mut guesses = MOST_GUESSES;
        for name in file.materials.as_slice() {
            let found = described.get(name.as_str()).map(|&index| &library[index]);
            let (mut description, folder) = found.cloned().unwrap_or_else(|| {
                if !library.is_empty() {
                    let known = library.iter().map(|(material, _)| material.name.as_str()).take(guesses);
                    guesses -= guesses.min(library.len());
                    let hint =
                        names::nearest(name, known).map(|n| format!(" (did you mean '{n}'?)")).unwrap_or_default();
                    warnings.push(format!("{}: material '{name}' is not described{hint}; it is grey", path.display()));
                }
                (MtlMaterial { name: name.clone(), ..Default::default() }, PathBuf::new())
            });
            if description.name.is_empty() {
                description.name = "unnamed".into();
            }
            let name = description.name.clone();
            self.materials.push(SourceMaterial { name, description: Description::Mtl(Box::new(description), folder) });
        }
        Ok(())
    }

    /// Adds the triangles of a part, and counts those that are left out or turned.
    pub(super) fn add(
        &mut self,
        part: &ObjPart,
        object: &str,
        material: MaterialId,
        degenerate: &mut usize,
        turned: &mut usize,
    ) {
        let first = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(part.vertices());
        self.residuals.extend(part.positions.iter().map(|p| (p - p.as_vec3().as_dvec3()).as_vec3()));
        let object = self.objects.position(object);
        for indices in &part.triangles {
            let [a, b, c] = indices.map(|i| part.positions[i as usize]);
            let normal = (b - a).cross(c - a);
            let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            if normal.length().partial_cmp(&(f64::from(THINNEST) * longest)) != Some(std::cmp::Ordering::Greater) {
                *degenerate += 1;
                continue;
            }
            let mut vertices = indices.map(|i| i + first);
            // Glass and lamps ask which side is the front; normals are stated on purpose, winding often by accident.
            let stated: Vec3 = vertices.iter().map(|&v| self.mesh.vertices[v as usize].normal).sum();
            if stated.as_dvec3().dot(normal) < 0.0 {
                vertices.swap(1, 2);
                *turned += 1;
            }
            self.mesh.triangles.push(Triangle { vertices, material, emitter: None });
            self.object_of.push(object as u32);
        }
    }
}

/// The material file that an OBJ file names; the same in other upper and lower case or with backslashes is taken with a warning,
/// its absence is one.
fn find_library(name: &str, beside: &Folders, path: &Path, warnings: &mut Vec<String>) -> Result<Option<PathBuf>> {
    let place = path.display().to_string();
    if let Some(found) = beside.look_up(name, &place)? {
        return Ok(Some(found));
    }
    let found = find_as_elsewhere(beside.own(), name);
    match &found {
        Some(found) => {
            beside.reach.admit(found, &place)?;
            warnings.push(format!("{place}: the material file \"{name}\" is read from {}", found.display()));
        }
        None => warnings.push(format!("{place}: the material file \"{name}\" is missing; its materials are grey")),
    }
    Ok(found)
}
