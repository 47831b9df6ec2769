//! Polygons into triangles.

use glam::{DVec2, DVec3};

/// Largest share of a polygon's area by which its triangles may differ: rounding of f32 corners, and no more.
const AREA_SLACK: f64 = 1e-3;

/// Height over width up to which a polygon is flat.
const FLAT: f64 = 0.01;
/// Corners of a polygon above which it is not looked at: cutting it would take minutes.
const MAX_CORNERS: usize = 1 << 16;

/// A polygon's triangles.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Triangulation {
    /// Places among its corners, wound as it is.
    pub(super) triangles: Vec<[usize; 3]>,
    /// Whether they do not fill it, since its edges cross.
    pub(super) crosses: bool,
}

/// Cuts a polygon of at least three corners: a convex one into the fan about its first corner, others by their ears, as they
/// look along their normal (Newell's). A quad that is not flat and seems to cross itself is folded, not crossed: a fan again.
pub(super) fn cut(corners: &[DVec3]) -> Triangulation {
    let count = corners.len();
    if count == 3 {
        return Triangulation { triangles: vec![[0, 1, 2]], crosses: false };
    }
    let Flattened { flat, height, length } = Flattened::of(corners);
    let fan = || (1..count - 1).map(|i| [0, i, i + 1]).collect();
    if count > MAX_CORNERS {
        return Triangulation { triangles: fan(), crosses: true };
    }
    if is_convex(&flat) {
        return Triangulation { triangles: fan(), crosses: false };
    }
    let mut places: Vec<usize> = Vec::new();
    earcut::Earcut::new().earcut(flat.iter().map(|p| p.to_array()), &[], &mut places);
    let mut triangles: Vec<[usize; 3]> = places.as_chunks::<3>().0.to_vec();
    if triangles.is_empty() {
        triangles = fan();
    }
    let area = doubled_area(&flat);
    let mut filled = 0.0;
    for triangle in &mut triangles {
        let [a, b, c] = triangle.map(|at| flat[at]);
        let doubled = (b - a).perp_dot(c - a);
        if (doubled < 0.0) != (area < 0.0) {
            triangle.swap(1, 2);
        }
        filled += doubled.abs();
    }
    let crosses = (filled - area.abs()).abs() > AREA_SLACK * filled.max(area.abs());
    // Beside its width: a long strip that is twisted is not flat.
    let is_folded = crosses && height > FLAT * filled / length;
    if is_folded && count == 4 {
        triangles = fan();
    }
    Triangulation { triangles, crosses: crosses && !is_folded }
}

/// A polygon as it looks along its normal.
struct Flattened {
    /// The corners, in the two axes in which it is widest.
    flat: Vec<DVec2>,
    /// How far they stand off the plane of the first one.
    height: f64,
    /// Diagonal of the bounding box.
    length: f64,
}

impl Flattened {
    fn of(corners: &[DVec3]) -> Self {
        let next = corners.iter().cycle().skip(1);
        let origin = corners[0];
        let normal = corners.iter().zip(next).fold(DVec3::ZERO, |sum, (a, b)| sum + (*a - origin).cross(*b - origin));
        let low = corners.iter().fold(DVec3::INFINITY, |low, corner| low.min(*corner));
        let extent = corners.iter().fold(DVec3::NEG_INFINITY, |high, corner| high.max(*corner)) - low;
        // Without area, as of a bow whose halves cancel: along the axis in which it is thinnest.
        let has_area = normal.length() > 1e-9 * extent.length_squared();
        let size = if has_area { normal.abs() } else { -extent };
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let along = if has_area { normal.normalize_or_zero() } else { DVec3::AXES[axis] };
        let height = corners.iter().map(|corner| (*corner - origin).dot(along).abs()).fold(0.0, f64::max);
        let seen = |corner: &DVec3| {
            let DVec3 { x, y, z } = *corner - origin;
            [DVec2::new(y, z), DVec2::new(z, x), DVec2::new(x, y)][axis]
        };
        Self { flat: corners.iter().map(seen).collect(), height, length: extent.length() }
    }
}

/// Twice the area, positive where the corners run counter-clockwise.
fn doubled_area(flat: &[DVec2]) -> f64 {
    flat.iter().zip(flat.iter().cycle().skip(1)).map(|(a, b)| a.perp_dot(*b)).sum()
}

/// Whether the corners turn one way only, and once around.
fn is_convex(flat: &[DVec2]) -> bool {
    let count = flat.len();
    let edge = |i: usize| flat[(i + 1) % count] - flat[i % count];
    let (mut left, mut right) = (false, false);
    let mut turned = 0.0;
    for i in 0..count {
        let (a, b) = (edge(i), edge(i + 1));
        let (cross, dot) = (a.perp_dot(b), a.dot(b));
        // Corners that lie on a straight line turn by rounding alone.
        let slack = 1e-6 * a.length() * b.length();
        left |= cross > slack;
        right |= cross < -slack;
        // A spike goes back the way it came.
        if dot < 0.0 && cross.abs() <= slack {
            return false;
        }
        turned += cross.atan2(dot);
    }
    !(left && right) && turned.abs() < 1.5 * std::f64::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3], cut: &Triangulation) -> f64 {
        let doubled = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| corners[i]);
            (b - a).cross(c - a).length()
        };
        0.5 * cut.triangles.iter().map(doubled).sum::<f64>()
    }

    /// A U: a square of side 3 with a bay of 1 by 2, of area 7.
    const U: [[f64; 2]; 8] =
        [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];

    #[test]
    fn a_concave_polygon_keeps_its_bay_wherever_it_begins_and_however_it_lies() {
        let planes: [fn([f64; 2]) -> DVec3; 4] = [
            |[x, y]| DVec3::new(x, y, 5.0),
            |[x, y]| DVec3::new(5.0, x, y),
            |[x, y]| DVec3::new(y, 5.0, x),
            |[x, y]| DVec3::new(x, -y, y),
        ];
        for (plane, scale) in planes.into_iter().zip([1.0, 1.0, 1.0, 2f64.sqrt()]) {
            for first in 0..8 {
                for turned in [false, true] {
                    let mut corners: Vec<DVec3> = (0..8).map(|i| plane(U[(i + first) % 8])).collect();
                    if turned {
                        corners.reverse();
                    }
                    let found = cut(&corners);
                    assert_eq!((found.triangles.len(), found.crosses), (6, false));
                    assert!((area(&corners, &found) - 7.0 * scale).abs() < 1e-4);
                    // Each is wound as the whole is.
                    let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
                    let whole = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| a.cross(*b));
                    let whole: DVec3 = whole.sum();
                    for triangle in &found.triangles {
                        assert!(normal(triangle.map(|i| corners[i])).dot(whole) > 0.0);
                    }
                }
            }
        }
    }

    #[test]
    fn convex_polygons_are_fans_about_their_first_corner() {
        let corners: Vec<DVec3> = (0..5).map(|i| DVec3::new(f64::from(i).cos(), f64::from(i).sin(), 0.0)).collect();
        assert_eq!(cut(&corners).triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    }

    #[test]
    fn any_corners_make_triangles_of_them() {
        let mut state = 1u64;
        let mut below = |end: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % end
        };
        for _ in 0..3000 {
            let (count, grid) = (3 + below(20), 1 + below(6));
            let corners: Vec<DVec3> =
                (0..count).map(|_| DVec3::from([0; 3].map(|_| below(grid) as f64 * 1e3))).collect();
            let found = cut(&corners);
            assert!(found.triangles.iter().flatten().all(|&at| at < corners.len()));
            assert!(found.triangles.len() <= corners.len());
        }
    }

    #[test]
    fn polygons_that_cross_themselves_or_have_no_area_are_told() {
        let bow = [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
        assert!(cut(&bow).crosses);
        assert!(cut(&[DVec3::ONE; 4]).triangles.len() <= 2);
        // Folded along a diagonal, as of leaves: seen from above its edges cross.
        let leaf = [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.4, 0.1, 1.0), DVec3::new(0.6, 0.6, 1.0)];
        assert!(!cut(&leaf).crosses);
        // Bridged: a square of side 4 with a hole of side 2, of area 12.
        let ring = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]];
        let ring: Vec<DVec3> = ring.iter().map(|&[x, y]| DVec3::new(f64::from(x), f64::from(y), 0.0)).collect();
        let found = cut(&ring);
        assert!(!found.crosses && (area(&ring, &found) - 12.0).abs() < 1e-4, "{found:?}");
    }
}
