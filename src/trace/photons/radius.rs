//! How far photons are gathered: a field over space, by how densely they lie.

use glam::Vec3;

use super::Photon;
use super::tree::{Tree, bounds};

/// Photons of all maps that a radius holds where `AT` are kept; with more, `N^⅔` as many.
const HELD: f64 = 32.0;
const AT: f64 = 65_536.0;

/// Largest and smallest radius, in units of the scene's.
const RANGE: (f32, f32) = (1e-5, 0.05);

/// Radii by the leaves of a tree over all photons.
#[derive(Debug)]
pub(super) struct RadiusField {
    tree: Tree,
    radii: Vec<f32>,
}

impl RadiusField {
    /// Bytes that making it takes for each photon: its position, and its share of the tree.
    pub(super) const BYTES_PER_PHOTON: usize = size_of::<Vec3>() + 2;

    /// None where there are no photons.
    pub(super) fn of(maps: &[Vec<Photon>], scene_radius: f32) -> Option<Self> {
        let mut positions = Vec::new();
        positions.reserve_exact(maps.iter().map(Vec::len).sum());
        positions.extend(maps.iter().flatten().map(|photon| photon.position));
        if positions.is_empty() {
            return None;
        }
        let held = HELD * (positions.len() as f64 / AT).powf(2.0 / 3.0);
        let tree = Tree::sort(&mut positions, (held as usize).max(16), |&position| position);
        let radius = |range: std::ops::Range<usize>| {
            let count = range.len().max(1) as f64;
            let square = held * f64::from(area(&positions[range])) / (count * std::f64::consts::PI);
            (square.sqrt() as f32).clamp(RANGE.0 * scene_radius, RANGE.1 * scene_radius)
        };
        let radii = tree.leaves().into_iter().map(radius).collect();
        Some(Self { tree, radii })
    }

    pub(super) fn at(&self, position: Vec3) -> f32 {
        self.radii[self.tree.leaf_of(position)]
    }
}

/// Area of a surface that points lie on: that of a plane, from the faces of the box around them.
fn area(points: &[Vec3]) -> f32 {
    let (low, high) = bounds(points.iter().copied());
    let d = high - low;
    Vec3::new(d.x * d.y, d.y * d.z, d.z * d.x).length()
}
