//! Finding the rectangle that a texelled emitter lies on.

use glam::{Vec2, Vec3};

/// A rectangle `origin + u · edge_u + v · edge_v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    pub(super) origin: Vec3,
    pub(super) edge_u: Vec3,
    pub(super) edge_v: Vec3,
    /// Unit normal of the triangles' front.
    pub(super) normal: Vec3,
}

/// A corner of an emitter's triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) position: Vec3,
    pub(super) uv: Vec2,
}

/// Deviation from a rectangle that is let pass, relative to its size. Exported corners carry four to six digits.
const TOLERANCE: f32 = 2e-3;

/// The rectangle that these triangles fill exactly.
///
/// With texture coordinates, `u` and `v` run as they do. Without (all the same), `u` runs along the longer side and `v`
/// along the shorter, each in the direction in which its largest coordinate grows. Errors: the reason why there is
/// none.
pub(super) fn find(triangles: &[[Corner; 3]]) -> Result<Rectangle, &'static str> {
    let normals = triangles.iter().map(|[a, b, c]| (b.position - a.position).cross(c.position - a.position));
    let doubled: Vec3 = normals.clone().sum();
    let area: f32 = normals.clone().map(|n| 0.5 * n.length()).sum();
    let normal = doubled.try_normalize().ok_or("it has no area")?;
    if normals.clone().any(|n| n.normalize_or_zero().dot(normal) < 1.0 - TOLERANCE) {
        return Err("its faces do not lie in one plane with the front on one side");
    }
    let corners = || triangles.iter().flatten();
    let without_uv = corners().all(|c| c.uv == triangles[0][0].uv);
    let found = if without_uv { from_edges(triangles, normal, area) } else { from_uvs(triangles) };
    let (origin, edge_u, edge_v) = found?;
    let fills = (edge_u.cross(edge_v).length() / area - 1.0).abs() < 2.0 * TOLERANCE;
    let square = edge_u.normalize().dot(edge_v.normalize()).abs() < TOLERANCE;
    let size = edge_u.length() + edge_v.length();
    let flat = corners().all(|c| (c.position - origin).dot(normal).abs() < TOLERANCE * size);
    match fills && square && flat {
        true => Ok(Rectangle { origin, edge_u, edge_v, normal }),
        false if without_uv => Err("it is not a rectangle"),
        false => Err("its texture coordinates do not lay one rectangle over it"),
    }
}

type Edges = (Vec3, Vec3, Vec3);

/// The affine map from texture coordinates, as the largest triangle states it, over the range that all corners use.
fn from_uvs(triangles: &[[Corner; 3]]) -> Result<Edges, &'static str> {
    let determinant = |[a, b, c]: &[Corner; 3]| (b.uv - a.uv).perp_dot(c.uv - a.uv);
    let largest = triangles.iter().max_by(|a, b| determinant(a).abs().total_cmp(&determinant(b).abs()));
    let [a, b, c] = largest.ok_or("it has no faces")?;
    let ((p, q), (s, t)) = ((b.position - a.position, c.position - a.position), (b.uv - a.uv, c.uv - a.uv));
    let inverse = 1.0 / s.perp_dot(t);
    if !inverse.is_finite() {
        return Err("its texture coordinates have no area");
    }
    let (along_u, along_v) = ((p * t.y - q * s.y) * inverse, (q * s.x - p * t.x) * inverse);
    let corners = || triangles.iter().flatten();
    let low = corners().fold(Vec2::INFINITY, |m, c| m.min(c.uv));
    let high = corners().fold(Vec2::NEG_INFINITY, |m, c| m.max(c.uv));
    let at = |uv: Vec2| a.position + along_u * (uv.x - a.uv.x) + along_v * (uv.y - a.uv.y);
    let size = along_u.length() * (high.x - low.x) + along_v.length() * (high.y - low.y);
    if corners().any(|c| (at(c.uv) - c.position).length() > TOLERANCE * size) {
        return Err("its texture coordinates do not lay one rectangle over it");
    }
    Ok((at(low), along_u * (high.x - low.x), along_v * (high.y - low.y)))
}

/// The bounding rectangle along one of the edges that has the triangles' area.
fn from_edges(triangles: &[[Corner; 3]], normal: Vec3, area: f32) -> Result<Edges, &'static str> {
    let corners = || triangles.iter().flatten().map(|c| c.position);
    let edges = triangles.iter().flat_map(|[a, b, c]| [b.position - a.position, c.position - b.position]);
    for axis in edges.filter_map(|edge| edge.try_normalize()) {
        let other = normal.cross(axis);
        let range = |along: Vec3| {
            let values = corners().map(move |p| p.dot(along));
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        };
        let ((a0, a1), (b0, b1)) = (range(axis), range(other));
        if ((a1 - a0) * (b1 - b0) / area - 1.0).abs() < 2.0 * TOLERANCE {
            let height = corners().next().map_or(0.0, |p| p.dot(normal));
            let corner = |a: f32, b: f32| axis * a + other * b + normal * height;
            let (mut origin, mut u, mut v) = (corner(a0, b0), axis * (a1 - a0), other * (b1 - b0));
            // Of equal sides, u is the one nearer to the x axis, then to the y axis.
            let (longer, equal) = (v.length() > u.length() * 1.0001, (v.length() / u.length() - 1.0).abs() < 1e-4);
            let first = |e: Vec3| (e.x.abs(), e.y.abs());
            if longer || (equal && first(v) > first(u)) {
                (u, v) = (v, u);
            }
            for edge in [&mut u, &mut v] {
                let largest = edge.to_array().into_iter().max_by(|a, b| a.abs().total_cmp(&b.abs()));
                if largest.is_some_and(|value| value < 0.0) {
                    origin += *edge;
                    *edge = -*edge;
                }
            }
            return Ok((origin, u, v));
        }
    }
    Err("it is not a rectangle")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(position: [f32; 3], uv: [f32; 2]) -> Corner {
        Corner { position: position.into(), uv: uv.into() }
    }

    fn near(found: Rectangle, origin: [f32; 3], edge_u: [f32; 3], edge_v: [f32; 3], normal: [f32; 3]) {
        let pairs = [(found.origin, origin), (found.edge_u, edge_u), (found.edge_v, edge_v), (found.normal, normal)];
        for (found, wanted) in pairs {
            assert!((found - Vec3::from(wanted)).length() < 1e-5, "{found} for {wanted:?}");
        }
    }

    /// A 2 × 1 rectangle at height 3 that faces down, cut along a diagonal.
    fn lamp(uv: impl Fn(f32, f32) -> [f32; 2]) -> [[Corner; 3]; 2] {
        let at = |x: f32, z: f32| corner([x, 3.0, z], uv(x, z));
        [[at(0.0, 0.0), at(2.0, 0.0), at(2.0, 1.0)], [at(0.0, 0.0), at(2.0, 1.0), at(0.0, 1.0)]]
    }

    #[test]
    fn without_texture_coordinates_the_sides_give_the_directions() {
        let found = find(&lamp(|_, _| [0.0; 2])).unwrap();
        near(found, [0.0, 3.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]);
    }

    #[test]
    fn texture_coordinates_give_the_directions_where_there_are_some() {
        let found = find(&lamp(|x, z| [1.0 - z, 0.25 + x / 4.0])).unwrap();
        near(found, [0.0, 3.0, 1.0], [0.0, 0.0, -1.0], [2.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
    }

    #[test]
    fn what_is_no_rectangle_is_refused() {
        let bare = |x: f32, y: f32, z: f32| corner([x, y, z], [0.0; 2]);
        let triangle = [[bare(0.0, 0.0, 0.0), bare(1.0, 0.0, 0.0), bare(0.0, 1.0, 0.0)]];
        assert_eq!(find(&triangle), Err("it is not a rectangle"));
        let bent = [
            [bare(0.0, 0.0, 0.0), bare(1.0, 0.0, 0.0), bare(1.0, 1.0, 0.0)],
            [bare(0.0, 0.0, 0.0), bare(1.0, 1.0, 0.0), bare(0.0, 1.0, 0.5)],
        ];
        assert!(find(&bent).is_err());
        assert!(find(&lamp(|x, z| [x * z, z])).is_err());
        assert!(find(&lamp(|x, _| [x, 0.0])).is_err());
        // A rhombus through its texture coordinates.
        assert!(find(&lamp(|x, z| [x + z, z])).is_err());
        assert!(find(&[]).is_err());
    }
}
