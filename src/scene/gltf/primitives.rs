//! Primitives of meshes to triangles in world space, once for each node that shows them.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};
use gltf::mesh::Mode;
use gltf::{Primitive, Semantic};

use super::super::import::{Description, Geometry, SourceMaterial};
use super::super::memory::Memory;
use super::super::obj::ObjPart;
use super::super::{MaterialId, Texture};
use super::buffers::Buffers;
use super::colours;
use super::materials::{self, ImageSource, Mapping};
use super::nodes::Placed;
use crate::error::Result;

/// What was left out, for one line each.
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
}

/// Adds the triangles of all meshes.
pub(super) fn add(
    path: &Path,
    nodes: &[Placed<'_>],
    buffers: &Buffers,
    first_material: usize,
    geometry: &mut Geometry,
    memory: &mut Memory,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let mut left_out = LeftOut::default();
    let before = geometry.bytes();
    let without = geometry.materials.len() - 1;
    // Materials with the colours of a primitive, by its mesh, its place there, and whether it is mirrored: then corners change places.
    let mut painted: HashMap<(usize, usize, bool), usize> = HashMap::new();
    for placed in nodes {
        let Some(mesh) = placed.node.mesh() else { continue };
        left_out.skins += usize::from(placed.node.skin().is_some());
        for primitive in mesh.primitives() {
            let material = primitive.material();
            if materials::is_absent(&material) {
                continue;
            }
            let count = primitive.get(&Semantic::Positions).map_or(0, |a| a.count() as u64);
            let indices = primitive.indices().map_or(0, |a| a.count() as u64);
            // What the accessors say; that the buffers have so much is looked at before it is taken.
            let needed = count.min(buffers.len() as u64) * 100 + indices.min(buffers.len() as u64) * 40;
            memory.check(geometry.bytes() - before + needed, path)?;
            let Some(mut part) = part(&primitive, &placed.world, buffers, &mut left_out)? else { continue };
            let mut id = material.index().map_or(without, |index| first_material + index);
            if let Some(colours) = colours::of(&primitive, buffers, part.positions.len())? {
                if Mapping::of(&material).is_used {
                    left_out.colours += 1;
                } else {
                    memory.check(geometry.bytes() - before + colours::bytes(part.triangles.len()), path)?;
                    let key = (mesh.index(), primitive.index(), placed.world.determinant() < 0.0);
                    let name = format!("{}, colours of mesh {} part {}", path.display(), key.0, key.1);
                    let texture = colours::paint(&mut part, &colours, name);
                    id = *painted.entry(key).or_insert_with(|| {
                        let material = with_colours(&geometry.materials[id], texture);
                        geometry.materials.push(material);
                        geometry.materials.len() - 1
                    });
                }
            }
            let LeftOut { degenerate, turned, .. } = &mut left_out;
            geometry.add(&part, &placed.name, MaterialId(id as u32), degenerate, turned);
            if geometry.mesh.vertices.len() > u32::MAX as usize {
                let problem = "the scene has more vertices than 32-bit numbers count";
                return Err(buffers.refuse(problem.into()));
            }
        }
    }
    memory.take(geometry.bytes() - before, path)?;
    let LeftOut { lines, degenerate, turned, skins, morphs, colours, unmapped, not_repeated } = left_out;
    for (count, what) in [
        (lines, "meshes of points or lines were left out"),
        (degenerate, "triangles without area were left out"),
        (turned, "triangles wound against their normals were turned"),
        (skins, "skinned meshes are shown as they were modelled, without their bones"),
        (morphs, "meshes are shown without their morph targets"),
        (colours, "textured meshes have vertex colours, which are not used"),
        (unmapped, "textured meshes have no texture coordinates"),
        (not_repeated, "meshes reach beyond a texture that is not to be repeated; it is repeated"),
    ] {
        if count > 0 {
            warnings.push(format!("{}: {count} {what}", path.display()));
        }
    }
    Ok(())
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

/// The triangles of a primitive; none where it makes none.
fn part(
    primitive: &Primitive<'_>,
    world: &DMat4,
    buffers: &Buffers,
    left_out: &mut LeftOut,
) -> Result<Option<ObjPart>> {
    if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        left_out.lines += 1;
        return Ok(None);
    }
    // A mesh without positions is allowed, and shows nothing.
    let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(None) };
    let positions: Vec<[f32; 3]> = buffers.vectors(&positions, "position")?;
    let count = positions.len();
    let indices = match primitive.indices() {
        Some(accessor) => buffers.indices(&accessor, count)?,
        None => (0..count as u32).collect(),
    };
    let mut triangles = triangles(primitive.mode(), &indices);
    // Which side is the front is said by the winding as it is seen in the world.
    if world.determinant() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    left_out.morphs += usize::from(primitive.morph_targets().next().is_some());
    let same_count = |found: usize, what: &str| match found == count {
        true => Ok(()),
        false => Err(buffers.refuse(format!("a mesh has {count} positions and {found} {what}"))),
    };
    let normals = match primitive.get(&Semantic::Normals) {
        Some(accessor) => {
            let normals: Vec<[f32; 3]> = buffers.vectors(&accessor, "normal")?;
            same_count(normals.len(), "normals")?;
            let turn = cofactors(world);
            normals.into_iter().map(|n| unit(turn * Vec3::from(n).as_dvec3())).collect()
        }
        None => Vec::new(),
    };
    let mapping = Mapping::of(&primitive.material());
    let uvs = match primitive.get(&Semantic::TexCoords(mapping.set)) {
        Some(accessor) => {
            let uvs: Vec<[f32; 2]> = buffers.vectors(&accessor, "texture coordinate")?;
            same_count(uvs.len(), "texture coordinates")?;
            let uvs: Vec<Vec2> = uvs.into_iter().map(|uv| mapping.apply(uv.into())).collect();
            if let Some(at) = uvs.iter().position(|uv| !uv.is_finite()) {
                return Err(buffers.refuse(format!("texture coordinate {at} of a mesh is not finite")));
            }
            let inside = |uv: &Vec2| uv.cmpge(Vec2::splat(-1e-3)).all() && uv.cmple(Vec2::splat(1.001)).all();
            left_out.not_repeated += usize::from(!mapping.repeats && !uvs.iter().all(inside));
            uvs
        }
        None => {
            left_out.unmapped += usize::from(mapping.is_used);
            Vec::new()
        }
    };
    let positions: Vec<Vec3> =
        positions.into_iter().map(|p| world.transform_point3(Vec3::from(p).as_dvec3()).as_vec3()).collect();
    if let Some(at) = positions.iter().position(|p| !p.is_finite()) {
        return Err(buffers.refuse(format!("position {at} of a mesh is not finite in the world")));
    }
    Ok(Some(ObjPart { object: 0, material: 0, positions, normals, uvs, triangles }))
}

/// The triangles that indices make in a mode.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => {
            let Some((&first, rest)) = indices.split_first() else { return Vec::new() };
            rest.windows(2).map(|w| [first, w[0], w[1]]).collect()
        }
        _ => indices.as_chunks::<3>().0.to_vec(),
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
        assert_eq!(triangles(Mode::TriangleStrip, &[0, 1, 2, 3]), [[0, 1, 2], [2, 1, 3]]);
        assert_eq!(triangles(Mode::TriangleFan, &[0, 1, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3]), [[0, 1, 2]]);
        for mode in [Mode::TriangleStrip, Mode::TriangleFan, Mode::Triangles] {
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
