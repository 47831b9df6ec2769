//! Whether a transparent material lies on bodies, on panes or on sheets: files do not say.

use std::collections::HashMap;

use glam::{DMat3, DVec3, Vec3};

use super::super::bounds;

/// Open edges, and edges whose two sides wind against each other, that a closed surface may have, as a share of all: exporters
/// leave out what has no area.
const MENDED: f64 = 0.02;
/// Thickness over width up to which something is flat.
const FLAT: f64 = 0.05;
/// Thickness of walls, twice their volume over their area, over the width, up to which a body is hollow: a ball has a third, a
/// drinking glass a fiftieth.
const WALL: f64 = 0.05;

/// Corners nearer to each other than this, in widths of the whole, are at the same place.
const NEAR: f32 = 1e-5;

/// Bytes for each triangle that is looked at: its corners, their places, its edges in a table with room to grow.
pub(in super::super) const SHAPE_BYTES: usize = 400;

/// Shape that most of a material's surface belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(in super::super) enum MaterialShape {
    /// A surface with edges that is not flat.
    #[default]
    Sheet,
    /// A flat surface with edges.
    Pane,
    /// Two flat faces, closed at their edges.
    Slab,
    /// A closed surface whose walls are thin: a vessel.
    Vessel,
    /// Any other closed surface.
    Body,
}

impl MaterialShape {
    /// Whether light passes two faces of it.
    pub(super) fn has_two_faces(self) -> bool {
        matches!(self, Self::Slab | Self::Vessel)
    }

    /// Whether glass of this shape refracts light.
    pub(super) fn is_solid(self) -> bool {
        matches!(self, Self::Vessel | Self::Body)
    }
}

/// Sums over what hangs together.
#[derive(Clone, Default)]
struct Component {
    area: f64,
    /// Six times the signed volume under the surface.
    volume: f64,
    /// Sum of the normals' outer products, by area.
    spread: DMat3,
    low: DVec3,
    high: DVec3,
    corners: Vec<u32>,
    edges: usize,
    odd_edges: usize,
}

/// The shape that most of the triangles' area belongs to; corners at the same place are one.
pub(in super::super) fn shape_of(triangles: &[[Vec3; 3]]) -> MaterialShape {
    let mut places: HashMap<[i64; 3], u32> = HashMap::new();
    let mut points: Vec<DVec3> = Vec::new();
    let (low, high) = bounds(triangles.iter().flatten().copied());
    let rounding = 4.0 * f32::EPSILON * low.abs().max(high.abs()).max_element();
    let grain = f64::from(rounding.max(NEAR * (high - low).length())).max(f64::MIN_POSITIVE);
    let mut corner = |point: Vec3| {
        let key = (point.as_dvec3() / grain).round().to_array().map(|at| at as i64);
        *places.entry(key).or_insert_with(|| {
            points.push(point.as_dvec3());
            points.len() as u32 - 1
        })
    };
    let indices: Vec<[u32; 3]> = triangles.iter().map(|triangle| triangle.map(&mut corner)).collect();
    let mut parents: Vec<u32> = (0..points.len() as u32).collect();
    let mut edges: HashMap<[u32; 2], [i32; 2]> = HashMap::new();
    for &[a, b, c] in &indices {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let [one, other] = [root(&mut parents, from), root(&mut parents, to)];
            parents[one as usize] = other;
            let [count, balance] = edges.entry([from.min(to), from.max(to)]).or_default();
            *count += 1;
            *balance += if from < to { 1 } else { -1 };
        }
    }
    let mut components: HashMap<u32, Component> = HashMap::new();
    for &[a, b, c] in &indices {
        let [p, q, r] = [a, b, c].map(|at| points[at as usize]);
        let found = components.entry(root(&mut parents, a)).or_insert_with(|| Component {
            low: p,
            high: p,
            ..Component::default()
        });
        // About a corner of the component: volumes far from the origin would drown.
        let origin = points[found.corners.first().copied().unwrap_or(a) as usize];
        let normal = (q - p).cross(r - p);
        let doubled = normal.length();
        found.area += 0.5 * doubled;
        found.volume += (p - origin).dot((q - origin).cross(r - origin));
        if doubled > 0.0 {
            let unit = normal / doubled;
            found.spread += DMat3::from_cols(unit * unit.x, unit * unit.y, unit * unit.z) * doubled;
        }
        for point in [p, q, r] {
            found.low = found.low.min(point);
            found.high = found.high.max(point);
        }
        found.corners.extend([a, b, c]);
    }
    for (&[from, _], &[count, balance]) in &edges {
        let found = components.get_mut(&root(&mut parents, from)).expect("an edge has a triangle");
        found.edges += 1;
        found.odd_edges += usize::from(count < 2 || balance != 0);
    }
    // All that is of one shape, by its area. What has none says nothing.
    let order =
        [MaterialShape::Sheet, MaterialShape::Pane, MaterialShape::Slab, MaterialShape::Vessel, MaterialShape::Body];
    let mut areas = [0.0; 5];
    for component in components.values() {
        areas[component.shape(&points) as usize] += component.area;
    }
    let largest = (0..5).max_by(|&a, &b| areas[a].total_cmp(&areas[b]).then(b.cmp(&a))).unwrap_or(0);
    order[largest]
}

/// The representative of a point's component, with its path halved.
fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        let above = parents[parents[at as usize] as usize];
        parents[at as usize] = above;
        at = above;
    }
    at
}

impl Component {
    fn shape(&self, points: &[DVec3]) -> MaterialShape {
        let width = (self.high - self.low).length();
        // The direction that most normals have, by power iteration from the axis that has most of it.
        let diagonal = [self.spread.x_axis.x, self.spread.y_axis.y, self.spread.z_axis.z];
        let most = (0..3).max_by(|&a, &b| diagonal[a].total_cmp(&diagonal[b])).unwrap_or(0);
        let mut normal = DVec3::AXES[most];
        for _ in 0..32 {
            normal = (self.spread * normal).normalize_or(normal);
        }
        let heights = self.corners.iter().map(|&at| points[at as usize].dot(normal));
        let (least, greatest) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, g), h| (l.min(h), g.max(h)));
        let is_flat = greatest - least <= FLAT * width;
        // An inside that is wound outwards, or a surface turned inside out, is no boundary of a body.
        let is_closed = self.odd_edges as f64 <= MENDED * self.edges as f64 && self.volume > 0.0;
        let wall = self.volume / 3.0 / self.area;
        match (is_closed, is_flat) {
            (true, true) => MaterialShape::Slab,
            (true, false) if wall <= WALL * width => MaterialShape::Vessel,
            (true, false) => MaterialShape::Body,
            (false, true) => MaterialShape::Pane,
            (false, false) => MaterialShape::Sheet,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::shapes::{TriangleList as Made, ball, cuboid, rectangle};
    use super::*;

    fn triangles(made: &Made) -> Vec<[Vec3; 3]> {
        made.triangles.iter().map(|t| t.map(|v| made.vertices[v as usize].position)).collect()
    }

    #[test]
    fn panes_slabs_vessels_bodies_and_sheets_are_told_apart() {
        let pane = triangles(&rectangle(Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, 1.0)));
        assert_eq!(shape_of(&pane), MaterialShape::Pane);
        let slab = triangles(&cuboid(Vec3::splat(1000.0), Vec3::new(0.5, 0.7, 0.01), 0.3));
        assert_eq!(shape_of(&slab), MaterialShape::Slab);
        let block = triangles(&cuboid(Vec3::splat(1000.0), Vec3::new(0.5, 0.7, 0.3), 0.3));
        assert_eq!(shape_of(&block), MaterialShape::Body);
        assert_eq!(shape_of(&triangles(&ball(Vec3::ONE, 0.1, 2))), MaterialShape::Body);
        // Open by a sixth of its faces, and wound inside out.
        assert_eq!(shape_of(&block[..10]), MaterialShape::Sheet);
        let turned: Vec<_> = block.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert_eq!(shape_of(&turned), MaterialShape::Sheet);
        assert_eq!(shape_of(&[]), MaterialShape::Sheet);
    }

    #[test]
    fn a_glass_to_drink_from_is_a_vessel() {
        // Turned about the axis: the outer wall, the rim, the inner wall and its floor, and the floor below.
        let profile = [[0.0, 0.0], [1.0, 0.0], [1.0, 3.0], [0.96, 3.0], [0.96, 0.04], [0.0, 0.04]];
        let around = 24;
        let point = |[r, y]: [f32; 2], i: usize| {
            let (sin, cos) = (std::f32::consts::TAU * (i % around) as f32 / around as f32).sin_cos();
            Vec3::new(r * cos, y, r * sin)
        };
        let mut found = Vec::new();
        for edge in profile.windows(2) {
            for i in 0..around {
                let [a, b, c, d] = [point(edge[0], i), point(edge[1], i), point(edge[1], i + 1), point(edge[0], i + 1)];
                found.extend(
                    [[a, b, c], [a, c, d]].into_iter().filter(|[a, b, c]| (*b - *a).cross(*c - *a) != Vec3::ZERO),
                );
            }
        }
        assert_eq!(shape_of(&found), MaterialShape::Vessel);
        // Panes of a window in one material: the larger ones count.
        let mut window = triangles(&rectangle(Vec3::X * 20.0, Vec3::X * 9.0, Vec3::Y * 9.0));
        window.extend(found);
        assert_eq!(shape_of(&window), MaterialShape::Pane);
    }
}
