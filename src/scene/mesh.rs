//! Triangles in world space.

use glam::{Vec2, Vec3};

/// Index into [`Scene::materials`](super::Scene::materials).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// A triangle: indices of its vertices, counter-clockwise from its front, and its material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into the mesh's vertices.
    pub vertices: [u32; 3],
    /// Material of the triangle.
    pub material: MaterialId,
    /// The light it belongs to, as an index into [`Scene::emitters`](super::Scene::emitters).
    pub emitter: Option<u32>,
}

/// A vertex. All that a hit reads of it lies in one half of a cache line, which is faster than an array for each
/// attribute (decision 4).
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertex {
    /// Position in world space.
    pub position: Vec3,
    /// Unit shading normal; zero where the geometric normal is to be used.
    pub normal: Vec3,
    /// Texture coordinates; zero where the source has none.
    pub uv: Vec2,
}

/// All triangles of a scene.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertices, in any order.
    pub vertices: Vec<Vertex>,
    /// Triangles.
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// The vertices of a triangle.
    #[inline(always)]
    pub fn vertices_of(&self, triangle: &Triangle) -> [&Vertex; 3] {
        triangle.vertices.map(|vertex| &self.vertices[vertex as usize])
    }

    /// Corner positions of a triangle.
    #[inline]
    pub fn corners(&self, triangle: &Triangle) -> [Vec3; 3] {
        self.vertices_of(triangle).map(|vertex| vertex.position)
    }

    /// Makes the front of a triangle the back, with vertices of its own: others may share those that it had.
    pub(crate) fn turn_over(&mut self, triangle: u32) {
        let [a, b, c] = self.triangles[triangle as usize].vertices;
        for (place, vertex) in [a, c, b].into_iter().enumerate() {
            let vertex = self.vertices[vertex as usize];
            self.triangles[triangle as usize].vertices[place] = self.vertices.len() as u32;
            self.vertices.push(Vertex { normal: -vertex.normal, ..vertex });
        }
    }

    /// The box around all vertices, as [`bounds`] gives it.
    pub(crate) fn bounds(&self) -> (Vec3, Vec3) {
        bounds(self.vertices.iter().map(|vertex| vertex.position))
    }
}

/// The box around points: its least corner and its greatest; infinite the wrong way round where there are none.
pub(crate) fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)))
}
