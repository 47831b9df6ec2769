//! Triangles in world space.

use glam::{Vec2, Vec3};

/// Index into [`Scene::materials`](super::Scene::materials).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// A triangle: indices of its vertices, counter-clockwise from its front, and its material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into the mesh's vertex arrays.
    pub vertices: [u32; 3],
    /// Its material.
    pub material: MaterialId,
    /// The light it belongs to, as an index into [`Scene::emitters`](super::Scene::emitters).
    pub emitter: Option<u32>,
}

/// All triangles of a scene. The vertex arrays have one item per vertex each.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Positions in world space.
    pub positions: Vec<Vec3>,
    /// Unit shading normals; zero where the geometric normal is to be used.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; zero where the source has none.
    pub uvs: Vec<Vec2>,
    /// Triangles.
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// Corner positions of a triangle.
    #[inline]
    pub fn corners(&self, triangle: &Triangle) -> [Vec3; 3] {
        let [i, j, k] = triangle.vertices;
        [self.positions[i as usize], self.positions[j as usize], self.positions[k as usize]]
    }
}
