//! Traversal with eight lanes at a time: the twin of `scalar`, operation by operation.
#![expect(unsafe_code, reason = "a measured SIMD leaf: a fifth to two fifths of tracing's time is spent here")]

use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use glam::Vec3;

use super::LANES;
use super::scalar::{Prepared, WIDEN, nothing_before, weights};
use super::wide::{LEAF, Packet, SEE_THROUGH, STACK, WideNode, WideTree};
use super::{Hit, Occlusion, Ray};

/// A ray with each component in all lanes.
struct Lanes {
    origin: [__m256; 3],
    direction: [__m256; 3],
    inverse: [__m256; 3],
    near: [usize; 3],
    far: [usize; 3],
    axes: [usize; 3],
    shear: [__m256; 2],
}

impl Lanes {
    #[inline]
    #[target_feature(enable = "avx2")]
    fn new(ray: &Ray) -> Self {
        let prepared = Prepared::new(ray);
        let splat = |v: [f32; 3]| [_mm256_set1_ps(v[0]), _mm256_set1_ps(v[1]), _mm256_set1_ps(v[2])];
        Self {
            origin: splat(prepared.origin),
            direction: splat(prepared.direction),
            inverse: splat(prepared.inverse),
            near: prepared.near,
            far: [prepared.far(0), prepared.far(1), prepared.far(2)],
            axes: prepared.axes,
            shear: [_mm256_set1_ps(prepared.shear[0]), _mm256_set1_ps(prepared.shear[1])],
        }
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load(lanes: &[f32; LANES]) -> __m256 {
    // SAFETY: reads eight floats from an array of eight; nodes and packets are aligned to 32 bytes but it is not relied on.
    unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn enter(node: &WideNode, ray: &Lanes, reach: f32) -> (__m256, u32) {
    let along = |bound: usize, axis: usize| {
        // SAFETY: `near` and `far` hold indices below 6 by construction.
        let bound = unsafe { node.bounds.get_unchecked(bound) };
        _mm256_mul_ps(_mm256_sub_ps(load(bound), ray.origin[axis]), ray.inverse[axis])
    };
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(f32::INFINITY);
    for axis in 0..3 {
        near = _mm256_max_ps(along(ray.near[axis], axis), near);
        far = _mm256_min_ps(along(ray.far[axis], axis), far);
    }
    far = _mm256_min_ps(_mm256_mul_ps(far, _mm256_set1_ps(WIDEN)), _mm256_set1_ps(reach));
    (near, _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32)
}

#[inline]
#[target_feature(enable = "avx2")]
fn dot(a: &[__m256; 3], b: &[__m256; 3]) -> __m256 {
    let xy = _mm256_add_ps(_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1]));
    _mm256_add_ps(xy, _mm256_mul_ps(a[2], b[2]))
}

/// Distances, barycentric shares, and a mask of the lanes hit at `t_last` or nearer.
#[inline]
#[target_feature(enable = "avx2")]
fn intersect(packet: &Packet, ray: &Lanes, t_last: f32) -> (__m256, [__m256; 3], u32) {
    let [x, y, z] = ray.axes;
    let seen = |corner: &[[f32; LANES]; 3]| {
        let from_origin = |axis: usize| {
            // SAFETY: `axes` holds indices below 3 by construction.
            let corner = unsafe { corner.get_unchecked(axis) };
            // SAFETY: as above.
            _mm256_sub_ps(load(corner), unsafe { *ray.origin.get_unchecked(axis) })
        };
        let along = from_origin(z);
        [
            _mm256_sub_ps(from_origin(x), _mm256_mul_ps(ray.shear[0], along)),
            _mm256_sub_ps(from_origin(y), _mm256_mul_ps(ray.shear[1], along)),
        ]
    };
    let [a, b, c] = [seen(&packet.corners[0]), seen(&packet.corners[1]), seen(&packet.corners[2])];
    let left_of =
        |p: &[__m256; 2], q: &[__m256; 2]| _mm256_sub_ps(_mm256_mul_ps(p[0], q[1]), _mm256_mul_ps(p[1], q[0]));
    let (u, v, w) = (left_of(&c, &b), left_of(&a, &c), left_of(&b, &a));
    let zero = _mm256_setzero_ps();
    let (least, most) = (_mm256_min_ps(_mm256_min_ps(u, v), w), _mm256_max_ps(_mm256_max_ps(u, v), w));
    let inside = _mm256_or_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(least, zero), _mm256_cmp_ps::<_CMP_LE_OQ>(most, zero));
    let normal = [load(&packet.normal[0]), load(&packet.normal[1]), load(&packet.normal[2])];
    let t = _mm256_div_ps(_mm256_sub_ps(load(&packet.height), dot(&normal, &ray.origin)), dot(&normal, &ray.direction));
    let between =
        _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(t, zero), _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_set1_ps(t_last)));
    (t, [u, v, w], _mm256_movemask_ps(_mm256_and_ps(inside, between)) as u32)
}

#[inline]
#[target_feature(enable = "avx2")]
fn store(lanes: __m256) -> [f32; LANES] {
    let mut array = [0.0; LANES];
    // SAFETY: writes eight floats into an array of eight.
    unsafe { _mm256_storeu_ps(array.as_mut_ptr(), lanes) };
    array
}

#[inline(always)]
pub(super) fn closest(tree: &WideTree, ray: &Ray) -> Option<Hit> {
    debug_assert!(std::arch::is_x86_feature_detected!("avx2"));
    let Ray { origin: o, direction: d, t_max } = *ray;
    // SAFETY: `Walk::Avx2` is only chosen by `Walk::detect`, where the processor has AVX2.
    unsafe { closest_lanes(tree, o.x, o.y, o.z, d.x, d.y, d.z, t_max) }
}

#[inline(always)]
pub(super) fn occlusion(tree: &WideTree, ray: &Ray) -> Occlusion {
    debug_assert!(std::arch::is_x86_feature_detected!("avx2"));
    let Ray { origin: o, direction: d, t_max } = *ray;
    // SAFETY: as in `closest`.
    unsafe { occlusion_lanes(tree, o.x, o.y, o.z, d.x, d.y, d.z, t_max) }
}

/// Stack of pending entries, the deepest first. The array is left uninitialised, since filling it would cost as much as
/// the traversal.
struct Stack<T: Copy> {
    entries: [MaybeUninit<T>; STACK],
    height: usize,
}

impl<T: Copy> Stack<T> {
    #[inline(always)]
    fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK], height: 0 }
    }

    #[inline(always)]
    fn push(&mut self, entry: T) {
        self.entries[self.height].write(entry);
        self.height += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<T> {
        self.height = self.height.checked_sub(1)?;
        // SAFETY: every entry below the height has been written by `push` or `sort_above`.
        Some(unsafe { self.entries[self.height].assume_init() })
    }
}

impl Stack<(u32, f32)> {
    /// Sorts the entries from `base` up, with the nearest on top; of equal ones, the one pushed later.
    #[inline(always)]
    fn sort_above(&mut self, base: usize) {
        // SAFETY: every entry below the height has been written.
        let at = |entries: &[MaybeUninit<(u32, f32)>; STACK], i: usize| unsafe { entries[i].assume_init() };
        for next in base + 1..self.height {
            let entry = at(&self.entries, next);
            let mut i = next;
            while i > base && at(&self.entries, i - 1).1 < entry.1 {
                self.entries[i] = self.entries[i - 1];
                i -= 1;
            }
            self.entries[i].write(entry);
        }
    }
}

#[expect(
    clippy::too_many_arguments,
    reason = "a ray that comes in memory is read in wider pieces than it was just written in, for which the processor waits: \
              1.15 of the time of tracing the diffuse room"
)]
#[inline]
#[target_feature(enable = "avx2")]
fn closest_lanes(tree: &WideTree, x: f32, y: f32, z: f32, dx: f32, dy: f32, dz: f32, t_max: f32) -> Option<Hit> {
    let lanes = Lanes::new(&Ray { origin: Vec3::new(x, y, z), direction: Vec3::new(dx, dy, dz), t_max });
    let (mut best, mut reach) = (nothing_before(t_max), t_max);
    let mut stack = Stack::<(u32, f32)>::new();
    let mut code = if tree.nodes.is_empty() { return None } else { 0 };
    loop {
        if code & LEAF == 0 {
            let node = &tree.nodes[code as usize];
            let (distances, mut mask) = enter(node, &lanes, reach);
            if mask != 0 {
                let first = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                if mask == 0 {
                    code = node.children[first];
                    continue;
                }
                let distances = store(distances);
                let base = stack.height;
                stack.push((node.children[first], distances[first]));
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    stack.push((node.children[lane], distances[lane]));
                }
                stack.sort_above(base);
            }
        } else {
            let packet = &tree.packets[(code & !LEAF) as usize];
            let (t, [u, v, w], mut mask) = intersect(packet, &lanes, best.t);
            if mask != 0 {
                let (t, u, v, w) = (store(t), store(u), store(v), store(w));
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let triangle = packet.triangles[lane] & !SEE_THROUGH;
                    let is_nearer = t[lane] < best.t || t[lane] == best.t && triangle < best.triangle;
                    if is_nearer && let Some((u, v)) = weights([u[lane], v[lane], w[lane]]) {
                        best = Hit { t: t[lane], triangle, u, v };
                        reach = best.t * WIDEN;
                    }
                }
            }
        }
        code = loop {
            match stack.pop() {
                None => return (best.triangle != u32::MAX).then_some(best),
                Some((code, distance)) if distance <= reach => break code,
                Some(_) => {}
            }
        };
    }
}

#[expect(clippy::too_many_arguments, reason = "as above")]
#[inline]
#[target_feature(enable = "avx2")]
fn occlusion_lanes(tree: &WideTree, x: f32, y: f32, z: f32, dx: f32, dy: f32, dz: f32, t_max: f32) -> Occlusion {
    let lanes = Lanes::new(&Ray { origin: Vec3::new(x, y, z), direction: Vec3::new(dx, dy, dz), t_max });
    let (mut found, t_last) = (Occlusion::Clear, t_max.next_down());
    let mut stack = Stack::<u32>::new();
    let mut code = if tree.nodes.is_empty() { return found } else { 0 };
    loop {
        if code & LEAF == 0 {
            let node = &tree.nodes[code as usize];
            let mut mask = enter(node, &lanes, t_max).1;
            if mask != 0 {
                // The last one is entered at once, as if it were pushed and popped.
                let last = mask.ilog2();
                mask ^= 1 << last;
                while mask != 0 {
                    stack.push(node.children[mask.trailing_zeros() as usize]);
                    mask &= mask - 1;
                }
                code = node.children[last as usize];
                continue;
            }
        } else {
            let packet = &tree.packets[(code & !LEAF) as usize];
            let (_, [u, v, w], mut mask) = intersect(packet, &lanes, t_last);
            if mask != 0 {
                // Triangles seen edge-on are no hits.
                let sum = _mm256_add_ps(_mm256_add_ps(u, v), w);
                mask &= _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(sum, _mm256_setzero_ps())) as u32;
            }
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                if packet.triangles[lane] & SEE_THROUGH == 0 {
                    return Occlusion::Opaque;
                }
                found = Occlusion::Perhaps;
            }
        }
        code = match stack.pop() {
            Some(code) => code,
            None => return found,
        };
    }
}
