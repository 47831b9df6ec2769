//! Primitives of meshes to triangles in world space, once for each node that shows them.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};

use super::super::memory::MemoryBound;
use super::super::obj::ObjPart;
use super::super::source::{Description, Geometry, ImageSource, SourceMaterial};
use super::super::{MaterialId, Texture};
use super::accessors::Accessor;
use super::buffers::Buffers;
use super::colours;
use super::compressed::Draco;
use super::materials::{self, Mapping};
use super::nodes::Placed;
use super::plain;
use super::tree::JsonItem;
use crate::error::{Error, Result, Warnings};

/// Topology of a primitive's triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Counts of what was left out, one message each.
#[derive(Default)]
struct LeftOut {
    lines: usize,
    degenerate: usize,
    turned: usize,
    skins: usize,
    morphs: usize,
    colours: usize,
    unmapped: usize,
    not_repeated: usize,
    not_finite: usize,
}

/// Adds the triangles of all meshes.
pub(super) fn add(
    path: &Path,
    nodes: &[Placed<'_>],
    buffers: &Buffers<'_>,
    first_material: usize,
    geometry: &mut Geometry,
    memory: &mut MemoryBound,
    warnings: &mut Warnings,
) -> Result<()> {
    let mut left_out = LeftOut::default();
    let before = geometry.bytes();
    let without = geometry.materials.len() - 1;
    // Materials with the colours of a primitive, by its mesh, its place there, and whether it is mirrored: then corners change places.
    let mut painted: HashMap<(usize, usize, bool), usize> = HashMap::new();
    for placed in nodes {
        let Some(mesh) = placed.mesh else { continue };
        left_out.skins += usize::from(placed.node.has("skin"));
        let once = [(placed.name.clone(), placed.world)];
        let shown = placed.instances.as_deref().unwrap_or(&once);
        for (index, primitive) in buffers.tree.item("meshes", mesh)?.objects("primitives")?.into_iter().enumerate() {
            let material = primitive.index("material", "materials")?;
            let stated = material.map(|index| buffers.tree.item("materials", index)).transpose()?;
            if stated.as_ref().is_some_and(materials::is_absent) {
                continue;
            }
            let Some(source) = Source::of(primitive, stated, buffers, memory, &mut left_out)? else { continue };
            let own = material.map_or(without, |index| first_material + index);
            for (name, world) in shown {
                // What the accessors say; that the buffers have so much is looked at before it is taken.
                memory.check(geometry.bytes() - before + source.bytes(), path)?;
                let (mut part, colours) = source.part(world, &mut left_out)?;
                let mut id = own;
                if let Some(colours) = colours {
                    memory.check(geometry.bytes() - before + colours::bytes(part.triangles.len()), path)?;
                    let key = (mesh, index, world.determinant() < 0.0);
                    let name = format!("{}, colours of mesh {} part {}", path.display(), key.0, key.1);
                    let texture = colours::paint(&mut part, &colours, name);
                    id = *painted.entry(key).or_insert_with(|| {
                        let material = with_colours(&geometry.materials[id], texture);
                        geometry.materials.push(material);
                        geometry.materials.len() - 1
                    });
                }
                let LeftOut { degenerate, turned, .. } = &mut left_out;
                geometry.add(&part, name, MaterialId(id as u32), degenerate, turned);
                if geometry.mesh.vertices.len() > u32::MAX as usize {
                    let problem = "the scene has more vertices than 32-bit numbers count";
                    return Err(buffers.refuse(problem.into()));
                }
            }
        }
    }
    memory.take(geometry.bytes() - before, path)?;
    left_out.say(path, warnings);
    Ok(())
}

impl LeftOut {
    fn say(self, path: &Path, warnings: &mut Warnings) {
        let Self { lines, degenerate, turned, skins, morphs, colours, unmapped, not_repeated, not_finite } = self;
        for (count, what) in [
            (lines, "meshes of points or lines were left out"),
            (degenerate, "triangles without area were left out"),
            (turned, "triangles wound against their normals were turned"),
            (skins, "skinned meshes are shown as they were modelled, without their bones"),
            (morphs, "meshes are shown without their morph targets"),
            (colours, "textured meshes have vertex colours, which are not used"),
            (unmapped, "textured meshes have no texture coordinates"),
            (not_repeated, "meshes reach beyond a texture that is not to be repeated; it is repeated"),
            (not_finite, "normals or texture coordinates that are no numbers were left out"),
        ] {
            if count > 0 {
                warnings.push(format!("{}: {count} {what}", path.display()));
            }
        }
    }
}

/// A material whose base colour is multiplied by a texture.
fn with_colours(material: &SourceMaterial, texture: Texture) -> SourceMaterial {
    let description = match &material.description {
        Description::Gltf(found) => {
            let mut found = found.clone();
            found.base_image = Some(ImageSource::Colours(Arc::new(texture)));
            Description::Gltf(found)
        }
        Description::Mtl(found, folder, shape) => Description::Mtl(found.clone(), folder.clone(), *shape),
    };
    SourceMaterial { name: material.name.clone(), description }
}

/// The indices of a primitive.
enum Indices<'a> {
    /// No indices: vertices in order.
    None,
    Stated(Accessor<'a>),
    Decoded(Vec<u32>),
}

/// What is decoded of a primitive that Draco compresses, with the ids of its attributes there.
fn draco<'a>(
    primitive: &JsonItem<'a>,
    buffers: &Buffers<'_>,
    memory: &MemoryBound,
) -> Result<Option<(Draco, JsonItem<'a>)>> {
    let Some(stated) = primitive.extension("KHR_draco_mesh_compression")? else { return Ok(None) };
    let view = stated.index("bufferView", "bufferViews")?.ok_or_else(|| stated.refuse("bufferView", "is missing"))?;
    let ids = stated.object("attributes")?.ok_or_else(|| stated.refuse("attributes", "is missing"))?;
    let decoded = Draco::decode(buffers.view(view)?, memory.left()).map_err(|reason| {
        let problem = format!("buffer view {view}: what Draco compresses is damaged ({})", plain(&reason));
        Error::input(buffers.tree.place(), problem, "export the file again without compression")
    })?;
    Ok(Some((decoded, ids)))
}

/// A primitive of triangles, and what its buffers say of it.
struct Source<'a> {
    buffers: &'a Buffers<'a>,
    mode: Mode,
    mapping: Mapping,
    positions: Accessor<'a>,
    indices: Indices<'a>,
    normals: Option<Accessor<'a>>,
    uvs: Option<Accessor<'a>>,
    colours: Option<Accessor<'a>>,
}

impl<'a> Source<'a> {
    /// None where it makes no triangles. What of its attributes is not used is not looked at.
    fn of(
        primitive: JsonItem<'a>,
        material: Option<JsonItem<'a>>,
        buffers: &'a Buffers<'a>,
        memory: &MemoryBound,
        left_out: &mut LeftOut,
    ) -> Result<Option<Self>> {
        let mode = match primitive.whole("mode")?.unwrap_or(4) {
            0..=3 => {
                left_out.lines += 1;
                return Ok(None);
            }
            4 => Mode::Triangles,
            5 => Mode::Strip,
            6 => Mode::Fan,
            _ => return Err(primitive.refuse("mode", "is none that there is")),
        };
        let mapping = Mapping::of(material.as_ref(), buffers.tree)?;
        let attributes = primitive.object("attributes")?.ok_or_else(|| primitive.refuse("attributes", "is missing"))?;
        let draco = draco(&primitive, buffers, memory)?;
        let accessor = |key: &str| {
            let Some(index) = attributes.index(key, "accessors")? else { return Ok(None) };
            let accessor = buffers.accessor(index)?;
            let Some((decoded, ids)) = &draco else { return Ok(Some(accessor)) };
            // What is not compressed with the rest is where it always is.
            let Some(id) = ids.whole(key)? else { return Ok(Some(accessor)) };
            let numbers = decoded.numbers(id, accessor.width);
            let numbers = numbers.ok_or_else(|| ids.refuse(key, "is no attribute of what is decoded"))?;
            Ok(Some(accessor.with(numbers)))
        };
        // A mesh without positions is allowed, and shows nothing.
        let Some(positions) = accessor("POSITION")? else { return Ok(None) };
        let indices = match &draco {
            Some((decoded, _)) => Indices::Decoded(decoded.indices()),
            None => match primitive.index("indices", "accessors")? {
                Some(index) => Indices::Stated(buffers.accessor(index)?),
                None => Indices::None,
            },
        };
        // What is decoded is triangles.
        let mode = if draco.is_some() { Mode::Triangles } else { mode };
        left_out.morphs += usize::from(primitive.has("targets"));
        // A scene file may give a texture to a material that has none; then these count, if they are sound.
        let uvs = match accessor(&format!("TEXCOORD_{}", mapping.set)) {
            Err(_) if !mapping.is_used => None,
            found => found?,
        };
        left_out.unmapped += usize::from(mapping.is_used && uvs.is_none());
        let mut colours = None;
        if !mapping.is_used {
            colours = accessor("COLOR_0")?;
        } else if let Ok(Some(accessor)) = accessor("COLOR_0") {
            let found = colours::of(&accessor, buffers, accessor.count);
            left_out.colours += usize::from(found.is_ok_and(|colours| colours.is_some()));
        }
        let normals = accessor("NORMAL")?;
        Ok(Some(Self { buffers, mode, mapping, positions, indices, normals, uvs, colours }))
    }

    /// Memory of what is made of it at most, as far as the buffers have bytes for it.
    fn bytes(&self) -> u64 {
        let most = self.buffers.len();
        let indices = match &self.indices {
            Indices::None => 0,
            Indices::Stated(accessor) => accessor.paid(most),
            Indices::Decoded(indices) => indices.len(),
        };
        self.positions.paid(most) as u64 * 100 + indices as u64 * 40
    }

    /// Its triangles in the world, and the colours of its vertices.
    fn part(&self, world: &DMat4, left_out: &mut LeftOut) -> Result<(ObjPart, Option<Vec<Vec3>>)> {
        let buffers = self.buffers;
        let positions: Vec<[f32; 3]> = buffers.finite(&self.positions, "position")?;
        let count = positions.len();
        let indices = match &self.indices {
            Indices::None => (0..count as u32).collect(),
            Indices::Stated(accessor) => buffers.indices(accessor, count)?,
            Indices::Decoded(indices) if indices.iter().all(|&index| (index as usize) < count) => indices.clone(),
            Indices::Decoded(_) => return Err(buffers.refuse("what Draco compresses is damaged".into())),
        };
        let mut triangles = triangles(self.mode, &indices);
        // Which side is the front is said by the winding as it is seen in the world.
        if world.determinant() < 0.0 {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let positions: Vec<DVec3> =
            positions.into_iter().map(|p| world.transform_point3(Vec3::from(p).as_dvec3())).collect();
        if let Some(at) = positions.iter().position(|p| !p.as_vec3().is_finite()) {
            return Err(buffers.refuse(format!("position {at} of a mesh is not finite in the world")));
        }
        let normals = self.normals(world, count, left_out)?;
        let uvs = match self.uvs(count, left_out) {
            Err(_) if !self.mapping.is_used => Vec::new(),
            found => found?,
        };
        let colours = self.colours.as_ref().map(|accessor| colours::of(accessor, buffers, count)).transpose()?;
        let part = ObjPart { object: 0, material: 0, positions, normals, is_smoothed: false, uvs, triangles };
        Ok((part, colours.flatten()))
    }

    fn same_count(&self, found: usize, count: usize, what: &str) -> Result<()> {
        match found == count {
            true => Ok(()),
            false => Err(self.buffers.refuse(format!("a mesh has {count} positions and {found} {what}"))),
        }
    }

    /// Unit normals in the world; zero where the file's is none, or has no length.
    fn normals(&self, world: &DMat4, count: usize, left_out: &mut LeftOut) -> Result<Vec<Vec3>> {
        let Some(accessor) = &self.normals else { return Ok(Vec::new()) };
        let normals: Vec<[f32; 3]> = self.buffers.vectors(accessor, "normal")?;
        self.same_count(normals.len(), count, "normals")?;
        let turn = cofactors(world);
        let mut normal = |n: [f32; 3]| {
            let n = Vec3::from(n);
            left_out.not_finite += usize::from(!n.is_finite());
            if n.is_finite() { unit(turn * n.as_dvec3()) } else { Vec3::ZERO }
        };
        Ok(normals.into_iter().map(&mut normal).collect())
    }

    /// Texture coordinates as the material lays its texture.
    fn uvs(&self, count: usize, left_out: &mut LeftOut) -> Result<Vec<Vec2>> {
        let Some(accessor) = &self.uvs else { return Ok(Vec::new()) };
        let uvs: Vec<[f32; 2]> = self.buffers.vectors(accessor, "texture coordinate")?;
        self.same_count(uvs.len(), count, "texture coordinates")?;
        let mut uv = |uv: [f32; 2]| {
            let uv = self.mapping.apply(uv.into());
            left_out.not_finite += usize::from(!uv.is_finite());
            if uv.is_finite() { uv } else { Vec2::ZERO }
        };
        let uvs: Vec<Vec2> = uvs.into_iter().map(&mut uv).collect();
        let inside = |uv: &Vec2| uv.cmpge(Vec2::splat(-1e-3)).all() && uv.cmple(Vec2::splat(1.001)).all();
        left_out.not_repeated += usize::from(!self.mapping.repeats && !uvs.iter().all(inside));
        Ok(uvs)
    }
}

/// The triangles that indices make in a mode.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Strip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::Fan => {
            let Some((&first, rest)) = indices.split_first() else { return Vec::new() };
            rest.windows(2).map(|w| [first, w[0], w[1]]).collect()
        }
        Mode::Triangles => indices.as_chunks::<3>().0.to_vec(),
    }
}

/// What turns normals: the inverse transpose, times the determinant's size, so that flat transforms have one too.
fn cofactors(world: &DMat4) -> DMat3 {
    let m = DMat3::from_mat4(*world);
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(b.cross(c) * sign, c.cross(a) * sign, a.cross(b) * sign)
}

fn unit(normal: DVec3) -> Vec3 {
    normal.normalize_or_zero().as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_wind_all_triangles_alike() {
        assert_eq!(triangles(Mode::Strip, &[0, 1, 2, 3]), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangles(Mode::Fan, &[0, 1, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3]), [[0, 1, 2]]);
        for mode in [Mode::Strip, Mode::Fan, Mode::Triangles] {
            assert!(triangles(mode, &[]).is_empty() && triangles(mode, &[0, 1]).is_empty());
        }
    }

    #[test]
    fn normals_stay_normal_under_stretching_and_mirroring() {
        let along = DVec3::new(1.0, -1.0, 0.0);
        let normal = DVec3::new(1.0, 1.0, 0.0);
        for scale in [DVec3::new(3.0, 1.0, 1.0), DVec3::new(-3.0, 1.0, 2.0), DVec3::splat(-1.0)] {
            let world = DMat4::from_scale(scale);
            let turned = cofactors(&world) * normal;
            assert!(turned.dot(world.transform_vector3(along)).abs() < 1e-12);
            assert!(turned.dot(world.transform_vector3(normal)) > 0.0);
        }
    }
}
