//! Geometry files into one mesh, with the material description and the object name of every triangle.

use std::collections::{HashMap, HashSet};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::folders::Folders;
use super::gltf::{FileExtras, is_gltf, read as read_gltf};
use super::lines::unquoted;
use super::memory::MemoryBound;
use super::mtl::{self, MaterialShape, MtlMap, MtlMaterial};
use super::names::{self};
use super::obj::{self, ObjFile, ObjPart};
use super::origin::origin_between;
use super::source::{Description, Geometry, SourceMaterial};
use super::textures::{find_as_elsewhere, find_moved};
use super::{MaterialId, Mesh, Triangle, Vertex};
use crate::error::{Error, Result, Warnings};
use crate::files::{open_input, read_input};

/// Bytes of a material file at most.
const MAX_MATERIAL_BYTES: u64 = 256 << 20;

/// Height over longest side below which a triangle is degenerate: its normal would be rounding noise.
const THINNEST: f32 = 1e-6;
/// Names that are compared with misspelt ones, in all: each comparison takes the product of their lengths.
const MAX_GUESSES: usize = 10_000;

impl Geometry {
    /// Reads an OBJ or glTF file with its materials and adds it. Returns what else the file has.
    ///
    /// # Errors
    /// Files that are missing or unreadable, what does not fit `memory`, and those of the format's reader.
    pub(super) fn read(
        &mut self,
        path: &Path,
        folders: &Folders,
        memory: &mut MemoryBound,
        warnings: &mut Warnings,
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
        memory: &mut MemoryBound,
        warnings: &mut Warnings,
    ) -> Result<()> {
        let mut reader = BufReader::new(open_input(path, "read the geometry")?);
        let file = obj::parse(path, &mut reader, memory)?;
        let first_material = self.materials.len();
        self.describe(path, &file, folders, memory, warnings)?;
        let (mut degenerate, mut turned, mut faults) = (0, 0, file.faults.clone());
        let (before, first_triangle) = (self.bytes(), self.mesh.triangles.len());
        for (mut part, more) in file.parts() {
            faults.add(&more);
            self.lay_map(&mut part, first_material);
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
        if self.mesh.triangles.len() == first_triangle && degenerate == 0 {
            let mut left_out = Warnings::new();
            faults.report(path, &mut left_out);
            let problem = "nothing is left of the faces of the OBJ file";
            return Err(Error::input(path.display().to_string(), problem, left_out.lines().join("; ")));
        }
        faults.report(path, warnings);
        self.look_at_shapes(first_material, first_triangle, memory, path)?;
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
    pub(super) fn settle(&mut self, place: &str, warnings: &mut Warnings) -> DVec3 {
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
        memory: &mut MemoryBound,
        warnings: &mut Warnings,
    ) -> Result<()> {
        let beside = folders.beside(path);
        let mut library: Vec<(MtlMaterial, PathBuf)> = Vec::new();
        for mtl_path in find_libraries(&file.libraries, &beside, path, warnings)? {
            // The text, and the materials that it describes: fewer bytes than 32 for each of it.
            let text = read_input(&mtl_path, "read the materials", MAX_MATERIAL_BYTES)?;
            memory.take((text.len() as u64).saturating_mul(32), &mtl_path)?;
            let folder = mtl_path.parent().unwrap_or(Path::new("")).to_owned();
            let described = mtl::parse(&mtl_path, &text, warnings)?;
            library.extend(described.into_iter().map(|material| (material, folder.clone())));
        }
        // The first of several of one name counts.
        let mut described: HashMap<&str, usize> = HashMap::new();
        for (index, (material, _)) in library.iter().enumerate() {
            described.entry(&material.name).or_insert(index);
        }
        let mut guesses = MAX_GUESSES;
        for name in file.materials.as_slice() {
            let found = spellings(name).find_map(|name| described.get(name)).map(|&index| &library[index]);
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
            let description = Description::Mtl(Box::new(description), folder, MaterialShape::default());
            self.materials.push(SourceMaterial { name, description });
        }
        Ok(())
    }

    /// Lays the texture coordinates of a part as the first map of its material says.
    fn lay_map(&self, part: &mut ObjPart, first_material: usize) {
        let Description::Mtl(material, ..) = &self.materials[first_material + part.material].description else {
            return;
        };
        if let Some(MtlMap { scale, offset, .. }) = material.maps().next().filter(|map| !map.is_plain()) {
            part.uvs.iter_mut().for_each(|uv| *uv = *uv * *scale + *offset);
        }
    }

    /// Notes the shape of what has each material that something shows through.
    fn look_at_shapes(
        &mut self,
        first_material: usize,
        first_triangle: usize,
        memory: &MemoryBound,
        path: &Path,
    ) -> Result<()> {
        let triangles = &self.mesh.triangles[first_triangle..];
        let mut corners: Vec<Option<Vec<[Vec3; 3]>>> = Vec::new();
        for material in &self.materials[first_material..] {
            let Description::Mtl(material, ..) = &material.description else { continue };
            corners.push(material.is_see_through().then(Vec::new));
        }
        for triangle in triangles {
            if let Some(Some(found)) = corners.get_mut(triangle.material.0 as usize - first_material) {
                found.push(self.mesh.corners(triangle));
            }
        }
        let count: usize = corners.iter().flatten().map(Vec::len).sum();
        memory.check((count * mtl::SHAPE_BYTES) as u64, path)?;
        for (material, found) in self.materials[first_material..].iter_mut().zip(corners) {
            if let (Description::Mtl(_, _, shape), Some(found)) = (&mut material.description, found) {
                *shape = mtl::shape_of(&found);
            }
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
            if !part.is_smoothed && stated.as_dvec3().dot(normal) < 0.0 {
                vertices.swap(1, 2);
                *turned += 1;
            }
            self.mesh.triangles.push(Triangle { vertices, material, emitter: None });
            self.object_of.push(object as u32);
        }
    }
}

/// A material's name as it stands, without the comment that may follow it, and without quotation marks.
fn spellings(name: &str) -> impl Iterator<Item = &str> {
    let bare = name.split(" #").next().unwrap_or_default().trim_end();
    [name, bare, unquoted(name)].into_iter()
}

/// File names that a statement `mtllib` may mean, in the order of the search: the whole statement as one name; parts in
/// quotation marks or with escaped blanks; parts that end in `.mtl`; and each word.
fn library_names(statement: &str) -> [Vec<String>; 3] {
    let statement = statement.trim();
    let mut quoted = vec![String::new()];
    let (mut in_quotes, mut letters) = (false, statement.chars().peekable());
    while let Some(letter) = letters.next() {
        match letter {
            '"' => in_quotes = !in_quotes,
            '\\' if letters.peek() == Some(&' ') => quoted.last_mut().expect("one").extend(letters.next()),
            letter if letter.is_whitespace() && !in_quotes => quoted.push(String::new()),
            letter => quoted.last_mut().expect("one").push(letter),
        }
    }
    quoted.retain(|name| !name.is_empty());
    let mut ended: Vec<String> = Vec::new();
    let mut rest = statement;
    while let Some(end) = rest.to_ascii_lowercase().find(".mtl ") {
        ended.push(unquoted(&rest[..end + 4]).to_owned());
        rest = rest[end + 4..].trim_start();
    }
    ended.push(unquoted(rest).to_owned());
    [vec![unquoted(statement).to_owned()], ended, quoted]
}

/// The material files that an OBJ file names. Others than those of the very names are taken with a warning: of other upper and
/// lower case, with backslashes, moved beside the OBJ file, or of its own name. The absence of all is one.
fn find_libraries(
    statements: &[String],
    beside: &Folders,
    path: &Path,
    warnings: &mut Warnings,
) -> Result<Vec<PathBuf>> {
    let place = path.display().to_string();
    let mut missing: Vec<String> = Vec::new();
    let mut files: Vec<PathBuf> = Vec::new();
    // The file, and whether it is not that of the very name.
    let find = |name: &str| -> Result<Option<(PathBuf, bool)>> {
        if let Some(found) = beside.look_up(name, &place)? {
            return Ok(Some((found, false)));
        }
        let found = find_as_elsewhere(beside.own(), name).or_else(|| find_moved(beside.own(), name));
        found.map(|found| beside.reach.admit(&found, &place).map(|()| (found, true))).transpose()
    };
    for statement in statements {
        // The reading that finds most, the first of several.
        let mut best: Vec<(String, Option<(PathBuf, bool)>)> = Vec::new();
        let count =
            |names: &[(String, Option<(PathBuf, bool)>)]| names.iter().filter(|(_, found)| found.is_some()).count();
        for names in library_names(statement) {
            let mut found = Vec::new();
            for name in names.into_iter().filter(|name| !name.is_empty()) {
                let file = find(&name)?;
                found.push((name, file));
            }
            if best.is_empty() || count(&found) > count(&best) {
                best = found;
            }
        }
        for (name, found) in best {
            match found {
                None => missing.push(name),
                Some((file, false)) => files.push(file),
                Some((file, true)) => {
                    warnings.push(format!("{place}: the material file \"{name}\" is read from {}", file.display()));
                    files.push(file);
                }
            }
        }
    }
    let of_its_own = || find_as_elsewhere(beside.own(), &path.with_extension("mtl").file_name()?.to_string_lossy());
    let list = missing.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    match (missing.len(), files.is_empty()) {
        (0, _) => {}
        (_, true) if let Some(found) = of_its_own() => {
            beside.reach.admit(&found, &place)?;
            warnings.push(format!(
                "{place}: the material file {list} is missing; {} is read in its place",
                found.display()
            ));
            files.push(found);
        }
        (1, true) => warnings.push(format!("{place}: the material file {list} is missing; its materials are grey")),
        (_, true) => warnings.push(format!("{place}: the material files {list} are missing; their materials are grey")),
        (_, false) => warnings.push(format!("{place}: of several material files these are missing: {list}")),
    }
    let mut seen = HashSet::new();
    files.retain(|file| seen.insert(file.clone()));
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn material_files_are_named_in_many_ways() {
        let [whole, ended, words] = library_names("a.mtl my room.MTL c.mtl");
        assert_eq!(whole, ["a.mtl my room.MTL c.mtl"]);
        assert_eq!(ended, ["a.mtl", "my room.MTL", "c.mtl"]);
        assert_eq!(words, ["a.mtl", "my", "room.MTL", "c.mtl"]);
        assert_eq!(library_names(r#""my room.mtl""#)[0], ["my room.mtl"]);
        assert_eq!(library_names(r"a\ b.mtl  c.mtl")[2], ["a b.mtl", "c.mtl"]);
        assert_eq!(library_names(r#""a b.mtl" c.mtl"#)[2], ["a b.mtl", "c.mtl"]);
        assert_eq!(library_names(r".\plain.mtl")[0], [r".\plain.mtl"]);
    }
}
