//! Traversal in plain loops: the twin of `avx2`, operation by operation.

use super::LANES;
use super::wide::{LEAF, Packet, SEE_THROUGH, WideNode, WideTree};
use super::{Hit, Occlusion, Ray};

/// Values of a ray that are computed once.
pub(super) struct Prepared {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
    pub(super) inverse: [f32; 3],
    /// For each axis, the index of the nearer of a node's bounds; the farther one is three before or after.
    pub(super) near: [usize; 3],
    /// The two axes across the ray's longest one, and that axis.
    pub(super) axes: [usize; 3],
    /// Slopes of the ray across its longest axis.
    pub(super) shear: [f32; 2],
}

/// Factor that widens far distances by more than the rounding of the two operations before. A ray along a box's face
/// then cannot slip between two boxes (Ize 2013, *Robust BVH ray traversal*), and a box whose triangle is as far as the
/// nearest hit is entered.
pub(super) const WIDEN: f32 = 1.000_000_5;

impl Prepared {
    #[inline(always)]
    pub(super) fn new(ray: &Ray) -> Self {
        let direction = ray.direction.to_array();
        let inverse = direction.map(|d| 1.0 / d);
        let near = std::array::from_fn(|axis| if direction[axis].is_sign_negative() { 3 + axis } else { axis });
        let [x, y, z] = direction.map(f32::abs);
        let axes = match () {
            () if x >= y && x >= z => [1, 2, 0],
            () if y >= z => [2, 0, 1],
            () => [0, 1, 2],
        };
        let shear = [0, 1].map(|across| direction[axes[across]] * inverse[axes[2]]);
        Self { origin: ray.origin.to_array(), direction, inverse, near, axes, shear }
    }

    #[inline(always)]
    pub(super) fn far(&self, axis: usize) -> usize {
        if self.near[axis] >= 3 { axis } else { 3 + axis }
    }
}

/// Maximum that returns the second argument for NaN, as the instruction does.
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Minimum that returns the second argument for NaN, as the instruction does.
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Entry distances of a node's children, and a mask of those hit up to `reach`.
fn enter(node: &WideNode, ray: &Prepared, reach: f32) -> ([f32; LANES], u32) {
    let mut distances = [0.0; LANES];
    let mut mask = 0;
    for (lane, distance) in distances.iter_mut().enumerate() {
        let (mut near, mut far) = (0.0, f32::INFINITY);
        for axis in 0..3 {
            near = max((node.bounds[ray.near[axis]][lane] - ray.origin[axis]) * ray.inverse[axis], near);
            far = min((node.bounds[ray.far(axis)][lane] - ray.origin[axis]) * ray.inverse[axis], far);
        }
        far = min(far * WIDEN, reach);
        *distance = near;
        mask |= u32::from(near <= far) << lane;
    }
    (distances, mask)
}

/// The intersection with a lane's triangle at `t_last` or nearer: the distance, and the shares of the corners, whose
/// quotients by their sum are the barycentric weights.
///
/// Edges are tested as in Woop, Benthin and Wald 2013, *Watertight ray/triangle intersection*. Corners are transformed
/// to ray space by the same operations in every triangle that has them. The sign of an edge function is then never
/// wrong, but may be 0, which counts as inside for both triangles. The distance is that to the triangle's plane. Its
/// error depends on the coordinates of the ray's origin alone, not on the triangle's size or shape nor on the angle.
fn intersect(packet: &Packet, lane: usize, ray: &Prepared, t_last: f32) -> Option<(f32, [f32; 3])> {
    let [x, y, z] = ray.axes;
    let seen = |corner: &[[f32; LANES]; 3]| {
        let along = corner[z][lane] - ray.origin[z];
        [
            (corner[x][lane] - ray.origin[x]) - ray.shear[0] * along,
            (corner[y][lane] - ray.origin[y]) - ray.shear[1] * along,
        ]
    };
    let [a, b, c] = packet.corners.each_ref().map(seen);
    let left_of = |p: [f32; 2], q: [f32; 2]| p[0] * q[1] - p[1] * q[0];
    let shares = [left_of(c, b), left_of(a, c), left_of(b, a)];
    let [u, v, w] = shares;
    let inside = min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0;
    let normal: [f32; 3] = std::array::from_fn(|axis| packet.normal[axis][lane]);
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let t = (packet.height[lane] - dot(normal, ray.origin)) / dot(normal, ray.direction);
    (inside && t > 0.0 && t <= t_last).then_some((t, shares))
}

/// Barycentric weights of the second and third corner from the shares of all; `None` if the triangle is seen edge-on.
pub(super) fn weights([u, v, w]: [f32; 3]) -> Option<(f32, f32)> {
    let sum = u + v + w;
    (sum != 0.0).then(|| (v / sum, w / sum))
}

/// Stack entries without an allocation. Zeroing the deepest possible stack would cost as much as the traversal.
const IN_PLACE: usize = 48;

/// Stack of pending entries, the deepest first: a few in place, enough for most rays, the rest on the heap.
struct Stack<T: Copy> {
    first: [T; IN_PLACE],
    rest: Vec<T>,
    height: usize,
}

impl<T: Copy> Stack<T> {
    fn of(empty: T) -> Self {
        Self { first: [empty; IN_PLACE], rest: Vec::new(), height: 0 }
    }

    fn push(&mut self, entry: T) {
        match self.first.get_mut(self.height) {
            Some(slot) => *slot = entry,
            None => self.rest.push(entry),
        }
        self.height += 1;
    }

    fn pop(&mut self) -> Option<T> {
        self.height = self.height.checked_sub(1)?;
        self.first.get(self.height).copied().or_else(|| self.rest.pop())
    }
}

/// No hit yet. A hit before `t_max` is nearer; one at `t_max` has a lower index.
pub(super) fn nothing_before(t_max: f32) -> Hit {
    Hit { t: t_max.next_down(), triangle: u32::MAX, u: 0.0, v: 0.0 }
}

pub(super) fn closest(tree: &WideTree, ray: &Ray) -> Option<Hit> {
    let prepared = Prepared::new(ray);
    let (mut best, mut reach) = (nothing_before(ray.t_max), ray.t_max);
    let mut stack = Stack::of((0u32, 0.0f32));
    if !tree.nodes.is_empty() {
        stack.push((0, 0.0));
    }
    while let Some((code, distance)) = stack.pop() {
        if distance > reach {
            continue;
        }
        if code & LEAF != 0 {
            let packet = &tree.packets[(code & !LEAF) as usize];
            for lane in 0..LANES {
                if let Some((t, shares)) = intersect(packet, lane, &prepared, best.t)
                    && let Some((u, v)) = weights(shares)
                {
                    let triangle = packet.triangles[lane] & !SEE_THROUGH;
                    if t < best.t || triangle < best.triangle {
                        best = Hit { t, triangle, u, v };
                        reach = t * WIDEN;
                    }
                }
            }
            continue;
        }
        let node = &tree.nodes[code as usize];
        let (distances, mut mask) = enter(node, &prepared, reach);
        // The farthest first, so that the nearest is on top; of equal ones, the later.
        let (mut sorted, mut count) = ([(0u32, 0.0f32); LANES], 0);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let mut at = count;
            while at > 0 && sorted[at - 1].1 < distances[lane] {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = (node.children[lane], distances[lane]);
            count += 1;
        }
        sorted[..count].iter().for_each(|&entry| stack.push(entry));
    }
    (best.triangle != u32::MAX).then_some(best)
}

pub(super) fn occlusion(tree: &WideTree, ray: &Ray) -> Occlusion {
    let prepared = Prepared::new(ray);
    let (mut found, t_last) = (Occlusion::Clear, ray.t_max.next_down());
    let mut stack = Stack::of(0u32);
    if !tree.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(code) = stack.pop() {
        if code & LEAF != 0 {
            let packet = &tree.packets[(code & !LEAF) as usize];
            for lane in 0..LANES {
                if intersect(packet, lane, &prepared, t_last).is_some_and(|(_, shares)| weights(shares).is_some()) {
                    if packet.triangles[lane] & SEE_THROUGH == 0 {
                        return Occlusion::Opaque;
                    }
                    found = Occlusion::Perhaps;
                }
            }
            continue;
        }
        let node = &tree.nodes[code as usize];
        let (_, mut mask) = enter(node, &prepared, ray.t_max);
        while mask != 0 {
            stack.push(node.children[mask.trailing_zeros() as usize]);
            mask &= mask - 1;
        }
    }
    found
}
