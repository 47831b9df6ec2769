//! The binary tree: binned surface area heuristic (Wald 2007, *On fast construction of SAH-based bounding volume
//! hierarchies*) on all three axes, one triangle for each leaf.

use glam::Vec3;

const BINS: usize = 32;
/// Levels of the deepest tree allowed.
pub(super) const DEEPEST: u32 = 80;
/// From this depth on ranges are halved, which takes at most 32 levels for the largest number of triangles.
const DEEPEST_HEURISTIC: u32 = DEEPEST - 33;
/// Ranges above this many triangles are built by two threads; the tree does not depend on it.
const PARALLEL_ABOVE: usize = 8_192;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeBounds {
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

impl NodeBounds {
    pub(super) const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    fn of_points(points: &[Vec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Half the surface area; 0 for the empty box.
    pub(super) fn half_area(self) -> f32 {
        let d = (self.max - self.min).max(Vec3::ZERO);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A node: a range of `order` and, unless it is a leaf, two children.
#[derive(Clone, Copy, Debug)]
pub(super) struct BinaryNode {
    pub(super) bounds: NodeBounds,
    pub(super) start: u32,
    pub(super) count: u32,
    /// Index of the second child; the first follows its parent. 0 for a leaf.
    pub(super) second: u32,
}

/// The tree in depth-first order, and the order of triangles that its ranges index.
pub(super) struct BinaryTree {
    pub(super) nodes: Vec<BinaryNode>,
    pub(super) order: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Item {
    bounds: NodeBounds,
    centre: Vec3,
    triangle: u32,
}

impl BinaryTree {
    /// Builds over triangles given by their corners, leaving out those that are not finite.
    pub(super) fn build(triangles: impl Iterator<Item = [Vec3; 3]>) -> Self {
        let mut items: Vec<Item> = triangles
            .enumerate()
            .filter(|(_, corners)| corners.iter().all(|c| c.is_finite()))
            .map(|(triangle, corners)| {
                let bounds = NodeBounds::of_points(&corners);
                Item { bounds, centre: 0.5 * (bounds.min + bounds.max), triangle: triangle as u32 }
            })
            .collect();
        let nodes = if items.is_empty() { Vec::new() } else { build_range(&mut items, 0, 0) };
        Self { nodes, order: items.iter().map(|item| item.triangle).collect() }
    }
}

/// Builds the subtree over `items`, which begin at `start` of the whole; child indices count from its own root.
fn build_range(items: &mut [Item], start: u32, depth: u32) -> Vec<BinaryNode> {
    let bounds = items.iter().fold(NodeBounds::EMPTY, |b, item| b.union(item.bounds));
    let mut nodes = vec![BinaryNode { bounds, start, count: items.len() as u32, second: 0 }];
    if items.len() == 1 {
        return nodes;
    }
    let middle = if depth < DEEPEST_HEURISTIC { split(items) } else { halve(items) };
    let (first, second) = items.split_at_mut(middle);
    let (second_start, depth) = (start + middle as u32, depth + 1);
    let (mut a, mut b) = if first.len() + second.len() > PARALLEL_ABOVE {
        rayon::join(|| build_range(first, start, depth), || build_range(second, second_start, depth))
    } else {
        (build_range(first, start, depth), build_range(second, second_start, depth))
    };
    let shift = |nodes: &mut [BinaryNode], by: u32| {
        nodes.iter_mut().filter(|n| n.second != 0).for_each(|n| n.second += by);
    };
    let second_at = 1 + a.len() as u32;
    shift(&mut a, 1);
    shift(&mut b, second_at);
    nodes[0].second = second_at;
    nodes.append(&mut a);
    nodes.append(&mut b);
    nodes
}

/// Reorders `items` around the cheapest of all bin boundaries and returns the size of the first part.
fn split(items: &mut [Item]) -> usize {
    let centres = items.iter().fold(NodeBounds::EMPTY, |b, i| b.union(NodeBounds { min: i.centre, max: i.centre }));
    let extent = centres.max - centres.min;
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if extent[axis] <= 0.0 {
            continue;
        }
        let bin_of = binning(centres.min[axis], extent[axis], axis);
        let mut bins = [(NodeBounds::EMPTY, 0u32); BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(item)];
            *bin = (bin.0.union(item.bounds), bin.1 + 1);
        }
        let mut cost_after = [0.0; BINS];
        let (mut bounds, mut count) = (NodeBounds::EMPTY, 0);
        for (i, bin) in bins.iter().enumerate().rev() {
            (bounds, count) = (bounds.union(bin.0), count + bin.1);
            cost_after[i] = if count == 0 { f32::INFINITY } else { bounds.half_area() * count as f32 };
        }
        let (mut bounds, mut count) = (NodeBounds::EMPTY, 0);
        for boundary in 1..BINS {
            (bounds, count) = (bounds.union(bins[boundary - 1].0), count + bins[boundary - 1].1);
            if count == 0 {
                continue;
            }
            let cost = bounds.half_area() * count as f32 + cost_after[boundary];
            if cost < best.map_or(f32::INFINITY, |b| b.0) {
                best = Some((cost, axis, boundary));
            }
        }
    }
    let Some((_, axis, boundary)) = best else { return halve(items) };
    let bin_of = binning(centres.min[axis], extent[axis], axis);
    let mut middle = 0;
    for i in 0..items.len() {
        if bin_of(&items[i]) < boundary {
            items.swap(i, middle);
            middle += 1;
        }
    }
    if middle == 0 || middle == items.len() { halve(items) } else { middle }
}

fn binning(min: f32, extent: f32, axis: usize) -> impl Fn(&Item) -> usize {
    let scale = BINS as f32 / extent;
    move |item| (((item.centre[axis] - min) * scale) as usize).min(BINS - 1)
}

/// Halves at the median along the longest axis of the centres: for coinciding centres and for excessive depth.
fn halve(items: &mut [Item]) -> usize {
    let centres = items.iter().fold(NodeBounds::EMPTY, |b, i| b.union(NodeBounds { min: i.centre, max: i.centre }));
    let axis = (centres.max - centres.min).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.centre[axis].total_cmp(&b.centre[axis]).then(a.triangle.cmp(&b.triangle))
    });
    middle
}
