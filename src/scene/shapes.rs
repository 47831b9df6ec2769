//! Simple shapes as triangles: rectangles, boxes, balls.

use std::collections::HashMap;

use glam::{Quat, Vec2, Vec3};

use super::Vertex;

/// Triangles of their own vertex list.
#[derive(Clone, Debug, Default)]
pub(super) struct TriangleList {
    pub(super) vertices: Vec<Vertex>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TriangleList {
    /// Makes the front the back.
    pub(super) fn turn_over(&mut self) {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self.vertices.iter_mut().for_each(|v| v.normal = -v.normal);
    }

    fn append(&mut self, other: Self) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|v| v + first)));
    }
}

/// A flat rectangle with the front towards `edge_u × edge_v`, texture coordinates along its edges.
pub(super) fn rectangle(origin: Vec3, edge_u: Vec3, edge_v: Vec3) -> TriangleList {
    let corner = |position, uv| Vertex { position, normal: Vec3::ZERO, uv };
    TriangleList {
        vertices: vec![
            corner(origin, Vec2::ZERO),
            corner(origin + edge_u, Vec2::X),
            corner(origin + edge_u + edge_v, Vec2::ONE),
            corner(origin + edge_v, Vec2::Y),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// A box of these half sides, turned about the vertical through its centre, front outwards.
pub(super) fn cuboid(centre: Vec3, half: Vec3, turn_radians: f32) -> TriangleList {
    let turn = Quat::from_rotation_y(turn_radians);
    let mut shape = TriangleList::default();
    for (normal, u) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for side in [-1.0, 1.0] {
            let (edge_u, edge_v) = (u * half * 2.0, (normal * side).cross(u) * half * 2.0);
            let corner = normal * side * half - 0.5 * (edge_u + edge_v);
            shape.append(rectangle(centre + turn * corner, turn * edge_u, turn * edge_v));
        }
    }
    shape
}

/// A ball with smooth normals, front outwards: an icosahedron whose faces are cut in four `levels` times
/// (20 · 4^levels triangles).
pub(super) fn ball(centre: Vec3, radius: f32, levels: u32) -> TriangleList {
    let golden = 0.5 * (1.0 + 5f32.sqrt());
    let mut points = Vec::new();
    for (a, b) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        points.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)]);
    }
    points.iter_mut().for_each(|p| *p = p.normalize());
    let mut triangles = icosahedron_faces(&points);
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let vertex = |normal| Vertex { position: centre + normal * radius, normal, uv: Vec2::ZERO };
    TriangleList { vertices: points.into_iter().map(vertex).collect(), triangles }
}

/// A surface of revolution about the vertical through `foot`: `profile` has (radius, height above the foot) from one end to the other, and
/// the front is to the right of its way, seen with the axis at the left: outwards where it leads up. Smooth around, with edges between the
/// pieces of the profile.
pub(super) fn turned(foot: Vec3, profile: &[(f32, f32)], sides: u32) -> TriangleList {
    let mut shape = TriangleList::default();
    for piece in profile.windows(2) {
        let [(lower, begin), (upper, end)] = [piece[0], piece[1]];
        let slope = Vec2::new(end - begin, lower - upper).normalize_or_zero();
        let first = shape.vertices.len() as u32;
        for side in 0..=sides {
            let (sin, cos) = (std::f32::consts::TAU * (side % sides) as f32 / sides as f32).sin_cos();
            let normal = Vec3::new(slope.x * cos, slope.y, slope.x * sin);
            for (radius, height, v) in [(lower, begin, 0.0), (upper, end, 1.0)] {
                let position = foot + Vec3::new(radius * cos, height, radius * sin);
                shape.vertices.push(Vertex { position, normal, uv: Vec2::new(side as f32 / sides as f32, v) });
            }
        }
        for side in 0..sides {
            let [a, b, d, c] = std::array::from_fn(|corner| first + 2 * side + corner as u32);
            // At the axis one of the two triangles has no area.
            shape.triangles.extend((upper > 0.0).then_some([a, b, c]));
            shape.triangles.extend((lower > 0.0).then_some([a, c, d]));
        }
    }
    shape
}

/// The faces of an icosahedron are the triples of its corners that are mutually nearest.
fn icosahedron_faces(points: &[Vec3]) -> Vec<[u32; 3]> {
    // Neighbours have a cosine of 1/√5 ≈ 0.447, the next nearest −0.447.
    let near = |a: usize, b: usize| points[a].dot(points[b]) > 0.0;
    let mut faces = Vec::new();
    for a in 0..points.len() {
        for b in a + 1..points.len() {
            for c in b + 1..points.len() {
                if near(a, b) && near(b, c) && near(a, c) {
                    let outwards = points[a].cross(points[b]).dot(points[c]) > 0.0;
                    faces.push([a, b, c].map(|i| i as u32));
                    if !outwards {
                        faces.last_mut().expect("just pushed").swap(1, 2);
                    }
                }
            }
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(shape: &TriangleList) -> f32 {
        let corner = |i: u32| shape.vertices[i as usize].position;
        shape.triangles.iter().map(|t| corner(t[0]).cross(corner(t[1])).dot(corner(t[2])) / 6.0).sum()
    }

    #[test]
    fn a_box_is_closed_and_faces_outwards() {
        let shape = cuboid(Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.5, 1.0, 1.5), 0.7);
        assert_eq!(shape.triangles.len(), 12);
        // The divergence theorem gives the volume only of a closed surface whose front is outside.
        assert!((volume(&shape) - 6.0).abs() < 1e-4);
    }

    #[test]
    fn a_ball_is_closed_and_faces_outwards() {
        let shape = ball(Vec3::new(1.0, 2.0, 3.0), 2.0, 4);
        assert_eq!(shape.triangles.len(), 20 * 256);
        assert_eq!(shape.vertices.len(), 10 * 256 + 2);
        let ball = 4.0 / 3.0 * std::f32::consts::PI * 8.0;
        // An inscribed polyhedron of 5,120 faces is 0.4 % smaller than its ball.
        assert!((volume(&shape) / ball - 1.0).abs() < 0.005, "{}", volume(&shape));
    }

    #[test]
    fn a_turned_shape_is_closed_at_its_axis_and_faces_outwards() {
        let foot = Vec3::new(1.0, 2.0, 3.0);
        let cone = turned(foot, &[(0.0, 0.0), (1.0, 0.0), (0.0, 3.0)], 512);
        // A polygon of 512 sides is 2.5e-5 smaller than its circle.
        assert!((volume(&cone) - std::f32::consts::PI).abs() < 1e-3, "{}", volume(&cone));
        for triangle in &cone.triangles {
            let [a, b, c] = triangle.map(|i| &cone.vertices[i as usize]);
            let front = (b.position - a.position).cross(c.position - a.position);
            assert!([a, b, c].iter().all(|vertex| vertex.normal.dot(front) > 0.0));
        }
    }
}
