//! A balanced k-d tree (Bentley 1975, *Multidimensional binary search trees used for associative searching*). Each node
//! splits the points of its range at the median along their longest axis.

use glam::Vec3;

use crate::scene::bounds;

/// The planes of a tree in heap order: node `i` has the children `2i + 1` and `2i + 2`. A node's points are a range of
/// the sorted points, split in the middle.
#[derive(Debug)]
pub(super) struct PhotonTree {
    planes: Vec<(f32, u32)>,
    points: usize,
    depth: u32,
}

impl PhotonTree {
    /// Sorts `points` into a tree whose leaves have at most `leaf` points.
    pub(super) fn sort<T>(points: &mut [T], leaf: usize, position: impl Fn(&T) -> Vec3 + Copy) -> Self {
        let depth = points.len().div_ceil(leaf.max(1)).max(1).next_power_of_two().ilog2();
        let mut tree = Self { planes: vec![(0.0, 0); (1 << depth) - 1], points: points.len(), depth };
        tree.part(0, points, position);
        tree
    }

    fn part<T>(&mut self, node: usize, points: &mut [T], position: impl Fn(&T) -> Vec3 + Copy) {
        if node >= self.planes.len() {
            return;
        }
        let middle = points.len() / 2;
        if middle < points.len() {
            let axis = part_at(points, middle, position);
            self.planes[node] = (position(&points[middle])[axis], axis as u32);
        }
        let (left, right) = points.split_at_mut(middle);
        self.part(2 * node + 1, left, position);
        self.part(2 * node + 2, right, position);
    }

    /// Index of the leaf that contains a position.
    pub(super) fn leaf_of(&self, place: Vec3) -> usize {
        let mut node = 0;
        while let Some(&(at, axis)) = self.planes.get(node) {
            node = 2 * node + 1 + usize::from(place[axis as usize] >= at);
        }
        node - self.planes.len()
    }

    /// The ranges of all leaves, in order.
    pub(super) fn leaves(&self) -> Vec<std::ops::Range<usize>> {
        let mut leaves = Vec::from([std::ops::Range { start: 0, end: self.points }]);
        for _ in 0..self.depth {
            let halves = |range: std::ops::Range<usize>| {
                let middle = range.start + range.len() / 2;
                [range.start..middle, middle..range.end]
            };
            leaves = leaves.into_iter().flat_map(halves).collect();
        }
        leaves
    }
}

/// Partitions points around the index `middle` along their longest axis: those before it lie no farther than those from
/// it on. Returns the axis.
pub(super) fn part_at<T>(points: &mut [T], middle: usize, position: impl Fn(&T) -> Vec3 + Copy) -> usize {
    let (low, high) = bounds(points.iter().map(position));
    let extent = high - low;
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    points.select_nth_unstable_by(middle, |a, b| position(a)[axis].total_cmp(&position(b)[axis]));
    axis
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn leaves_hold_what_lies_in_them() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for count in [0usize, 1, 2, 7, 8, 9, 1000] {
            // Some lie on planes, as photons do, and some coincide.
            let mut place = || Vec3::new(random.random(), random.random(), (random.random::<f32>() * 4.0).floor());
            let mut points: Vec<Vec3> = (0..count).map(|_| place()).collect();
            let tree = PhotonTree::sort(&mut points, 8, |&point| point);
            let leaves = tree.leaves();
            assert!(leaves.iter().all(|leaf| leaf.len() <= 8) && leaves.last().unwrap().end == count);
            for (leaf, range) in leaves.into_iter().enumerate() {
                // Points on a plane between two leaves may be in either.
                let strays = points[range].iter().filter(|&&point| tree.leaf_of(point) != leaf).count();
                assert!(strays <= 8, "{strays} of leaf {leaf}");
            }
        }
    }
}
