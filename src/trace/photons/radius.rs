//! The gathering radius: a field over space that follows the density of photons.

use glam::Vec3;

use super::tree::PhotonTree;
use crate::scene::bounds;

/// Number of photons, of all maps, within a radius if `AT` are stored. With more it grows as `N^⅔`.
const HELD: f64 = 32.0;
const AT: f64 = 65_536.0;

/// Smallest and largest radius, in units of the scene's.
const RANGE: (f32, f32) = (1e-5, 0.05);

/// Radii for the leaves of a tree over photons.
#[derive(Debug)]
pub(super) struct RadiusField {
    tree: PhotonTree,
    radii: Vec<f32>,
}

/// Number of photons within a radius if `photons` are stored.
fn held(photons: usize) -> f64 {
    HELD * (photons as f64 / AT).powf(2.0 / 3.0)
}

impl RadiusField {
    /// Bytes for each photon while the field is built: its position, and its part of the tree.
    pub(super) const BYTES_PER_PHOTON: usize = size_of::<Vec3>() + 2;

    /// The field for `photons` photons in all, of which `places` are a sample; `None` without any.
    pub(super) fn of(places: &mut [Vec3], photons: usize, scene_radius: f32) -> Option<Self> {
        if places.is_empty() {
            return None;
        }
        let tree = PhotonTree::sort(places, (held(places.len()) as usize).max(16), |&place| place);
        // The same share of the sample.
        let held = held(photons) * places.len() as f64 / photons as f64;
        let radius = |range: std::ops::Range<usize>| {
            let count = range.len().max(1) as f64;
            let square = held * f64::from(area(&places[range])) / (count * std::f64::consts::PI);
            (square.sqrt() as f32).clamp(RANGE.0 * scene_radius, RANGE.1 * scene_radius)
        };
        let radii = tree.leaves().into_iter().map(radius).collect();
        Some(Self { tree, radii })
    }

    /// The largest radius.
    pub(super) fn largest(&self) -> f32 {
        self.radii.iter().copied().fold(0.0, f32::max)
    }

    pub(super) fn at(&self, position: Vec3) -> f32 {
        self.radii[self.tree.leaf_of(position)]
    }
}

/// Area of the surface that points lie on: that of a plane, from the faces of their bounding box.
fn area(points: &[Vec3]) -> f32 {
    let (low, high) = bounds(points.iter().copied());
    let d = high - low;
    Vec3::new(d.x * d.y, d.y * d.z, d.z * d.x).length()
}
