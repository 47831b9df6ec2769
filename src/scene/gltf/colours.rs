//! Vertex colours as a texture: four texels for each triangle, whose corners are three of their centres.
//!
//! Bilinear lookup between four texels is linear across the triangle, as vertex colours are, if the fourth texel
//! continues the other three linearly.

use glam::{Vec2, Vec3};

use super::super::obj::ObjPart;
use super::super::{Placing, Texels, Texture};
use super::accessors::Accessor;
use super::buffers::Buffers;
use crate::error::Result;

/// The colours of `count` vertices, linear, from 0 to 1; none where all are white.
pub(super) fn of(accessor: &Accessor<'_>, buffers: &Buffers<'_>, count: usize) -> Result<Option<Vec<Vec3>>> {
    let colours: Vec<Vec3> = if accessor.width == 4 {
        let colours: Vec<[f32; 4]> = buffers.finite(accessor, "colour")?;
        colours.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect()
    } else {
        let colours: Vec<[f32; 3]> = buffers.finite(accessor, "colour")?;
        colours.into_iter().map(Vec3::from).collect()
    };
    if colours.len() != count {
        return Err(buffers.refuse(format!("a mesh has {count} positions and {} colours", colours.len())));
    }
    let colours: Vec<Vec3> = colours.into_iter().map(|c| c.clamp(Vec3::ZERO, Vec3::ONE)).collect();
    Ok(colours.iter().any(|c| *c != Vec3::ONE).then_some(colours))
}

/// Bytes of the texture of so many triangles, and of the vertices that they no longer share.
pub(super) fn bytes(triangles: usize) -> u64 {
    triangles as u64 * (4 * size_of::<[f32; 4]>() + 3 * 32) as u64
}

/// Gives each triangle vertices of its own with places in the texture, and returns that.
pub(super) fn paint(part: &mut ObjPart, colours: &[Vec3], name: String) -> Texture {
    let count = part.triangles.len();
    let across = (count as f64).sqrt().ceil().max(1.0) as usize;
    let (width, height) = (2 * across, 2 * count.div_ceil(across).max(1));
    let mut texels = vec![[0.0; 4]; width * height];
    let vertices: Vec<usize> = part.triangles.iter().flatten().map(|&v| v as usize).collect();
    part.positions = vertices.iter().map(|&v| part.positions[v]).collect();
    if !part.normals.is_empty() {
        part.normals = vertices.iter().map(|&v| part.normals[v]).collect();
    }
    part.uvs.clear();
    for (index, [a, b, c]) in part.triangles.iter().map(|t| t.map(|v| colours[v as usize])).enumerate() {
        let (x, y) = (2 * (index % across), 2 * (index / across));
        for (dx, dy, colour) in [(0, 0, a), (1, 0, b), (0, 1, c), (1, 1, b + c - a)] {
            texels[(y + dy) * width + x + dx] = [colour.x, colour.y, colour.z, 1.0];
        }
        let middle = |dx: usize, dy: usize| {
            let place =
                Vec2::new((x + dx) as f32 + 0.5, (y + dy) as f32 + 0.5) / Vec2::new(width as f32, height as f32);
            Vec2::new(place.x, 1.0 - place.y)
        };
        part.uvs.extend([middle(0, 0), middle(1, 0), middle(0, 1)]);
    }
    part.triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let (width, height) = (width as u32, height as u32);
    Texture { name, width, height, texels: Texels::Floats(texels), placing: Placing::PLAIN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_linear_across_every_triangle() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        let colours = [Vec3::X, Vec3::Y, Vec3::new(0.2, 0.4, 0.6), Vec3::ONE];
        let triangles = vec![[0, 1, 2], [2, 1, 3], [3, 1, 0]];
        let (normals, uvs) = (vec![Vec3::Z; 4], Vec::new());
        let mut part = ObjPart {
            object: 0,
            material: 0,
            positions: corners.map(|c| c.as_dvec3()).into(),
            normals,
            is_smoothed: false,
            uvs,
            triangles: triangles.clone(),
        };
        let texture = paint(&mut part, &colours, "a".into());
        for (old, new) in triangles.iter().zip(&part.triangles) {
            for weights in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::splat(1.0 / 3.0), Vec3::new(0.1, 0.2, 0.7)] {
                let mean = |of: &dyn Fn(usize) -> Vec3| (0..3).map(|i| of(i) * weights[i]).sum::<Vec3>();
                let uv: Vec2 = (0..3).map(|i| part.uvs[new[i] as usize] * weights[i]).sum();
                let [r, g, b, _] = texture.sample(uv);
                assert!((Vec3::new(r, g, b) - mean(&|i| colours[old[i] as usize])).length() < 1e-4);
                let place = mean(&|i| part.positions[new[i] as usize].as_vec3());
                assert!((place - mean(&|i| corners[old[i] as usize])).length() < 1e-6);
            }
        }
    }
}
