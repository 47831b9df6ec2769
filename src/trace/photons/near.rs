//! Finds the points of a tree within a disc: boxes of eight children at a time, then eight points at a time.
//!
//! Points come in the order of the tree, as the sums over them depend on it, and the same points on every machine. The
//! distance to a box is computed with the operations of that to a point, each of which rounds monotonically. So no box
//! that contains a point within reach is skipped.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::pages::{Items, Pages, Place, WrittenPages};
use super::tree::part_at;
use crate::error::Result;

/// Children of a node, and most points of a leaf.
pub(in crate::trace) const LANES: usize = 8;

/// Levels of nodes: enough for more points than there are indices.
const MAX_LEVELS: usize = 12;

/// The disc to search: within `radius`, and at most `height` above or below the plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub(super) centre: Vec3,
    pub(super) normal: Vec3,
    /// Square of the radius.
    pub(super) square: f32,
    pub(super) height: f32,
}

/// Boxes of eight children: minima by axis, then maxima. An absent child is never near.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Boxes([[f32; LANES]; 6]);

/// Eight points by axis; absent ones are at infinity.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Leaf {
    points: [[f32; LANES]; 3],
    /// Padding to the next cache line.
    unused: [f32; LANES],
}

/// A receiver of leaves that have points in the disc.
pub(super) trait LeafVisitor {
    /// A leaf, the squared distances of its points, and a mask of those in the disc. In the order of the points.
    fn leaf(&mut self, leaf: usize, distances: &[f32; LANES], mask: u32);
    /// A leaf that will follow soon, to be prefetched.
    fn ahead(&self, leaf: usize);
}

/// Sorted points for spatial search.
#[derive(Debug)]
pub(super) struct Near {
    leaves: Items<Leaf>,
    /// Levels of nodes, from those above the leaves to the root.
    levels: Vec<Items<Boxes>>,
}

/// The same in a file that is being written.
#[derive(Debug)]
pub(super) struct NearInFile {
    leaves: Place<Leaf>,
    levels: Vec<Place<Boxes>>,
}

impl NearInFile {
    /// To be looked for in the file.
    pub(super) fn open(self, pages: &WrittenPages) -> Near {
        let levels = self.levels.into_iter().map(|level| pages.items(level)).collect();
        Near { leaves: pages.items(self.leaves), levels }
    }
}

const NOTHING: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];

impl Near {
    /// Sorts `points` and builds the tree. Also returns the range of points of each leaf.
    pub(super) fn sort<T>(points: &mut [T], position: impl Fn(&T) -> Vec3 + Copy) -> (Self, Vec<Range<usize>>) {
        part(points, position);
        // At least one leaf, even without points.
        let starts = (0..points.len().max(1)).step_by(LANES);
        let ranges: Vec<Range<usize>> = starts.map(|start| start..points.len().min(start + LANES)).collect();
        let leaf = |range: &Range<usize>| {
            let mut leaf = Leaf { points: [[f32::INFINITY; LANES]; 3], unused: [0.0; LANES] };
            for (lane, point) in points[range.clone()].iter().enumerate() {
                (0..3).for_each(|axis| leaf.points[axis][lane] = position(point)[axis]);
            }
            leaf
        };
        let around = |range: &Range<usize>| {
            let places = points[range.clone()].iter().map(position);
            places.fold(NOTHING, |[low, high], place| [low.min(place), high.max(place)])
        };
        let leaves = ranges.iter().map(leaf).collect();
        let mut below: Vec<[Vec3; 2]> = ranges.iter().map(around).collect();
        let mut levels = Vec::new();
        loop {
            levels.push(below.chunks(LANES).map(Boxes::of).collect());
            let union = |[low, high]: [Vec3; 2], other: &[Vec3; 2]| [low.min(other[0]), high.max(other[1])];
            below = below.chunks(LANES).map(|boxes| boxes.iter().fold(NOTHING, union)).collect();
            if below.len() <= 1 {
                return (Self { leaves, levels }, ranges);
            }
        }
    }

    /// Bytes for each point; all leaves are full except the last.
    pub(super) const BYTES_PER_POINT: usize = (size_of::<Leaf>() + size_of::<Boxes>() / 7) / LANES + 8;

    /// Bytes of the tree.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.leaves) + self.levels.iter().map(|level| size_of_val(&**level)).sum::<usize>()
    }

    /// The same in a file.
    pub(super) fn put(self, pages: &mut Pages) -> Result<NearInFile> {
        let leaves = pages.put(&self.leaves)?;
        let levels = self.levels.iter().map(|level| pages.put(level)).collect::<Result<_>>()?;
        Ok(NearInFile { leaves, levels })
    }

    /// Visits every leaf with points in the disc, in order: its index, the squared distances, and a mask.
    #[inline]
    pub(super) fn find(&self, disc: &Disc, each: impl LeafVisitor) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(
                unsafe_code,
                reason = "a measured SIMD leaf: gathering was two fifths of tracing a room with glass"
            )]
            // SAFETY: the processor has AVX2.
            return unsafe { avx2::find(self, disc, each) };
        }
        self.walk(|boxes| boxes.near(disc), |leaf| leaf.near(disc), each);
    }

    /// The traversal, generic over how eight boxes and eight points are tested.
    #[inline(always)]
    fn walk(
        &self,
        boxes_near: impl Fn(&Boxes) -> u32,
        points_near: impl Fn(&Leaf) -> ([f32; LANES], u32),
        mut each: impl LeafVisitor,
    ) {
        let top = self.levels.len() - 1;
        let (leaves, mut levels) = (&*self.leaves, [&[][..]; MAX_LEVELS]);
        levels.iter_mut().zip(&self.levels).for_each(|(into, level)| *into = level);
        let mut waiting = [(0usize, 0u32); MAX_LEVELS];
        let (mut level, mut node, mut mask) = (top, 0, boxes_near(&levels[top][0]));
        loop {
            if mask == 0 {
                if level == top {
                    return;
                }
                level += 1;
                (node, mask) = waiting[level];
                continue;
            }
            let child = node * LANES + mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if level > 0 {
                waiting[level] = (node, mask);
                level -= 1;
                (node, mask) = (child, boxes_near(&levels[level][child]));
                ahead(leaves, &levels, level, node, mask, &each);
                continue;
            }
            let (distances, found) = points_near(&leaves[child]);
            if found != 0 {
                each.leaf(child, &distances, found);
            }
        }
    }
}

/// Prefetches the children of the node that is visited next.
#[inline(always)]
fn ahead(
    leaves: &[Leaf],
    levels: &[&[Boxes]; MAX_LEVELS],
    level: usize,
    node: usize,
    mut mask: u32,
    each: &impl LeafVisitor,
) {
    while mask != 0 {
        let child = node * LANES + mask.trailing_zeros() as usize;
        mask &= mask - 1;
        match level.checked_sub(1) {
            Some(below) => fetch(levels[below], child),
            None => {
                fetch(leaves, child);
                each.ahead(child);
            }
        }
    }
}

/// Sorts points so that eight consecutive ones are close together, and so are eight consecutive such leaves, eight of
/// these, and so on. Ranges are split as near to the middle as whole nodes allow, along their longest axis.
fn part<T>(points: &mut [T], position: impl Fn(&T) -> Vec3 + Copy) {
    let leaves = points.len().div_ceil(LANES);
    if leaves <= 1 {
        return;
    }
    // Leaves below one child of the node that contains them all.
    let whole = LANES.pow((leaves - 1).ilog(LANES));
    let middle = ((leaves + whole) / (2 * whole)).max(1) * whole * LANES;
    part_at(points, middle, position);
    let (left, right) = points.split_at_mut(middle);
    part(left, position);
    part(right, position);
}

/// Prefetches an item, which takes some hundred cycles.
#[inline(always)]
pub(super) fn fetch<T>(items: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(item) = items.get(index) {
        let line = std::ptr::from_ref(item).cast::<i8>();
        for at in (0..size_of::<T>()).step_by(64) {
            #[expect(unsafe_code, reason = "a hint to the processor, of which nothing is read")]
            // SAFETY: every processor of this architecture has the instruction, and the address lies inside of the item.
            unsafe {
                std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(line.add(at));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (items, index);
}

impl Boxes {
    fn of(around: &[[Vec3; 2]]) -> Self {
        let mut boxes = Self(std::array::from_fn(|at| [if at < 3 { f32::INFINITY } else { f32::NEG_INFINITY }; LANES]));
        for (lane, [low, high]) in around.iter().enumerate() {
            for axis in 0..3 {
                (boxes.0[axis][lane], boxes.0[3 + axis][lane]) = (low[axis], high[axis]);
            }
        }
        boxes
    }

    /// Which of them come nearer than the radius.
    fn near(&self, disc: &Disc) -> u32 {
        let lane = |lane: usize| {
            let beyond = |axis: usize| {
                let centre = disc.centre[axis];
                (self.0[axis][lane] - centre).max(centre - self.0[3 + axis][lane]).max(0.0)
            };
            let [x, y, z] = [beyond(0), beyond(1), beyond(2)];
            u32::from(x * x + y * y + z * z < disc.square) << lane
        };
        (0..LANES).map(lane).sum()
    }
}

impl Leaf {
    /// Squares of distances, and which points are in the disc.
    fn near(&self, disc: &Disc) -> ([f32; LANES], u32) {
        let mut mask = 0;
        let distances = std::array::from_fn(|lane| {
            let [x, y, z] = std::array::from_fn(|axis| self.points[axis][lane] - disc.centre[axis]);
            let distance = x * x + y * y + z * z;
            let above = x * disc.normal.x + y * disc.normal.y + z * disc.normal.z;
            mask |= u32::from(distance < disc.square && above.abs() < disc.height) << lane;
            distance
        });
        (distances, mask)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    #![expect(unsafe_code, reason = "loads and stores of eight floats")]

    use std::arch::x86_64::*;

    use super::{Disc, LANES, LeafVisitor, Near};

    #[inline]
    #[target_feature(enable = "avx2")]
    fn load(lanes: &[f32; LANES]) -> __m256 {
        // SAFETY: reads eight floats from an array of eight.
        unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn dot(a: [__m256; 3], b: [__m256; 3]) -> __m256 {
        let xy = _mm256_add_ps(_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1]));
        _mm256_add_ps(xy, _mm256_mul_ps(a[2], b[2]))
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn find(near: &Near, disc: &Disc, each: impl LeafVisitor) {
        let centre = [0, 1, 2].map(|axis| _mm256_set1_ps(disc.centre[axis]));
        let normal = [0, 1, 2].map(|axis| _mm256_set1_ps(disc.normal[axis]));
        let (square, height) = (_mm256_set1_ps(disc.square), _mm256_set1_ps(disc.height));
        let zero = _mm256_setzero_ps();
        let sign = _mm256_set1_ps(-0.0);
        near.walk(
            |boxes| {
                let beyond = [0, 1, 2].map(|axis| {
                    let below = _mm256_sub_ps(load(&boxes.0[axis]), centre[axis]);
                    let above = _mm256_sub_ps(centre[axis], load(&boxes.0[3 + axis]));
                    _mm256_max_ps(_mm256_max_ps(below, above), zero)
                });
                let near = _mm256_cmp_ps::<_CMP_LT_OQ>(dot(beyond, beyond), square);
                _mm256_movemask_ps(near) as u32
            },
            |leaf| {
                let offset = [0, 1, 2].map(|axis| _mm256_sub_ps(load(&leaf.points[axis]), centre[axis]));
                let distance = dot(offset, offset);
                let above = _mm256_andnot_ps(sign, dot(offset, normal));
                let inside = _mm256_and_ps(
                    _mm256_cmp_ps::<_CMP_LT_OQ>(distance, square),
                    _mm256_cmp_ps::<_CMP_LT_OQ>(above, height),
                );
                let mut distances = [0.0; LANES];
                // SAFETY: writes eight floats into an array of eight.
                unsafe { _mm256_storeu_ps(distances.as_mut_ptr(), distance) };
                (distances, _mm256_movemask_ps(inside) as u32)
            },
            each,
        );
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Indices and squared distances.
    struct Put<'a>(&'a [Range<usize>], &'a mut Vec<(u32, f32)>);

    impl LeafVisitor for Put<'_> {
        fn leaf(&mut self, leaf: usize, distances: &[f32; LANES], mask: u32) {
            let lanes = (0..LANES).filter(|lane| mask >> lane & 1 == 1);
            self.1.extend(lanes.map(|lane| ((self.0[leaf].start + lane) as u32, distances[lane])));
        }

        fn ahead(&self, _: usize) {}
    }

    #[test]
    fn a_disc_finds_all_points_in_it_in_their_order_however_they_are_tested() {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for count in [0usize, 1, 2, 7, 8, 9, 65, 1000, 5000] {
            // Some lie on planes, as photons do; and some in one place.
            let mut place = || Vec3::new(random.random(), random.random(), (random.random::<f32>() * 4.0).floor());
            let mut points: Vec<Vec3> = (0..count).map(|_| place()).collect();
            let (near, ranges) = Near::sort(&mut points, |&point| point);
            for turn in 0..60 {
                let normal = [Vec3::Z, Vec3::X, Vec3::new(0.6, 0.0, 0.8)][turn % 3];
                let disc = Disc { centre: place(), normal, square: 0.09, height: 0.1 };
                let inside = |point: &Vec3| {
                    let offset = *point - disc.centre;
                    offset.length_squared() < disc.square && offset.dot(normal).abs() < disc.height
                };
                let expected: Vec<(u32, f32)> = (0..count)
                    .filter(|&i| inside(&points[i]))
                    .map(|i| (i as u32, (points[i] - disc.centre).length_squared()))
                    .collect();
                let (mut found, mut plain) = (Vec::new(), Vec::new());
                near.find(&disc, Put(&ranges, &mut found));
                near.walk(|boxes| boxes.near(&disc), |leaf| leaf.near(&disc), Put(&ranges, &mut plain));
                assert_eq!(found, expected);
                assert_eq!(plain, expected);
            }
        }
    }
}
