//! Choice of the light for a light sample.
//!
//! Every light gets at least a part of the even share. The rest goes to lights at finite distance, in proportion to
//! their unoccluded contribution to the surface for each unit of their own size. Noise counts relative to a column's
//! own light, so a large lamp gets no more than a small one. Lights at infinity, which all surfaces see alike, keep the
//! even share.
//!
//! Half of the samples are shared evenly: decision 5. Learning which lights are visible from where was rejected:
//! decision 6.

use glam::Vec3;

use super::Source;
use crate::scene::{AreaLayout, Scene, bounds};

/// Part of the samples that is shared evenly.
const EVEN: f32 = 0.5;

/// Largest number of lights with a probability of their own at every surface; beyond it all share the samples evenly.
const MAX_WEIGHED: usize = 64;

/// Lights that are processed at once.
const LANES: usize = 8;

/// Position and orientation of a light.
#[derive(Clone, Copy, Debug)]
struct Bound {
    centre: Vec3,
    radius: f32,
    /// Zero if it emits to all sides.
    axis: Vec3,
    /// Whether it is at finite distance.
    near: bool,
}

/// The choice between all lights.
#[derive(Debug)]
pub(super) struct LightChoice {
    /// The bounds of all lights, and the same in groups of eight.
    bounds: Vec<Bound>,
    eights: Vec<LightBounds>,
    /// Share of the samples that goes to lights at finite distance.
    near: f32,
}

/// Probability of each light at a surface.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct LightPmf {
    /// Probability of each of the first `count` lights, if `even` is `None`.
    each: [f32; MAX_WEIGHED],
    /// Probability of every light, if all are equal.
    even: Option<f32>,
    count: usize,
}

impl Bound {
    fn of(scene: &Scene, source: &Source) -> Self {
        let unplaced = Self { centre: Vec3::ZERO, radius: 0.0, axis: Vec3::ZERO, near: false };
        match source {
            Source::Environment(_) | Source::Suns => unplaced,
            Source::Point(light) => {
                let placed = |centre| Self { centre, radius: light.radius(), near: true, ..unplaced };
                light.position().map_or(unplaced, placed)
            }
            Source::Area(light) => {
                if let AreaLayout::Texels { origin, edge_u, edge_v, normal, .. } = light.layout() {
                    let (centre, radius) = (origin + 0.5 * (edge_u + edge_v), 0.5 * (edge_u + edge_v).length());
                    let axis = if light.is_two_sided() { Vec3::ZERO } else { normal };
                    return Self { centre, radius, axis, near: true };
                }
                let corners =
                    || light.triangles().iter().map(|&t| scene.mesh.corners(&scene.mesh.triangles[t as usize]));
                let (low, high) = bounds(corners().flatten());
                // Area times normal of each triangle. The sum is as long as the total area only if the light is flat.
                let areas = corners().map(|[a, b, c]| (b - a).cross(c - a));
                let (sum, total) = areas.fold((Vec3::ZERO, 0.0), |(sum, total), n| (sum + n, total + n.length()));
                let is_flat = sum.length() > 0.99 * total && !light.is_two_sided();
                let axis = if is_flat { sum.normalize_or_zero() } else { Vec3::ZERO };
                Self { centre: 0.5 * (low + high), radius: 0.5 * (high - low).length(), axis, near: true }
            }
        }
    }
}

/// Eight lights in structure-of-arrays layout.
#[derive(Clone, Copy, Debug, Default)]
struct LightBounds {
    centre: [[f32; LANES]; 3],
    radius: [f32; LANES],
    axis: [[f32; LANES]; 3],
    /// Whether it emits to all sides.
    is_round: [bool; LANES],
    near: [bool; LANES],
}

impl LightBounds {
    fn of(bounds: &[Bound]) -> Self {
        let mut eight = Self::default();
        for (lane, bound) in bounds.iter().enumerate() {
            for axis in 0..3 {
                (eight.centre[axis][lane], eight.axis[axis][lane]) = (bound.centre[axis], bound.axis[axis]);
            }
            (eight.radius[lane], eight.is_round[lane]) = (bound.radius, bound.axis == Vec3::ZERO);
            eight.near[lane] = bound.near;
        }
        eight
    }

    /// Unoccluded contribution of each light to a surface, per unit of its size; an upper bound over the light's
    /// points.
    #[inline(always)]
    fn weights(&self, position: Vec3, normal: Vec3) -> [f32; LANES] {
        let mut weights = [0.0; LANES];
        for (lane, weight) in weights.iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| self.centre[axis][lane] - position[axis]);
            let radius = self.radius[lane];
            let square = x * x + y * y + z * z + radius * radius;
            let here = (x * normal.x + y * normal.y + z * normal.z + radius).max(0.0);
            let along = x * self.axis[0][lane] + y * self.axis[1][lane] + z * self.axis[2][lane];
            let there = if self.is_round[lane] { square.sqrt() } else { (radius - along).max(0.0) };
            let sent = here * there / (square * square);
            *weight = if self.near[lane] && square > 0.0 { sent } else { 0.0 };
        }
        weights
    }
}

/// [`LightBounds::weights`] of all groups.
#[inline(always)]
fn weigh_lanes(bounds: &[LightBounds], position: Vec3, normal: Vec3, weights: &mut [f32; MAX_WEIGHED]) {
    for (bounds, weights) in bounds.iter().zip(weights.as_chunks_mut::<LANES>().0) {
        *weights = bounds.weights(position, normal);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn weigh_avx2(bounds: &[LightBounds], position: Vec3, normal: Vec3, weights: &mut [f32; MAX_WEIGHED]) {
    weigh_lanes(bounds, position, normal, weights);
}

/// [`weigh_lanes`] with the widest vectors of the processor. Lanes never mix, so the result is the same with any width.
fn weigh(bounds: &[LightBounds], position: Vec3, normal: Vec3, weights: &mut [f32; MAX_WEIGHED]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(unsafe_code, reason = "a measured SIMD leaf: the plain body compiled for wider vectors")]
        // SAFETY: the processor has AVX2.
        return unsafe { weigh_avx2(bounds, position, normal, weights) };
    }
    weigh_lanes(bounds, position, normal, weights);
}

impl LightChoice {
    pub(super) fn new(scene: &Scene, sources: &[(Source, u32)]) -> Self {
        let bounds: Vec<Bound> = sources.iter().map(|(source, _)| Bound::of(scene, source)).collect();
        let near = bounds.iter().filter(|bound| bound.near).count() as f32 / bounds.len().max(1) as f32;
        let eights = bounds.chunks(LANES).map(LightBounds::of).collect();
        Self { bounds, eights, near }
    }

    /// The probabilities at a surface.
    #[inline(always)]
    pub(super) fn at(&self, position: Vec3, normal: Vec3) -> LightPmf {
        let count = self.bounds.len();
        let (mut each, share) = ([0.0f32; MAX_WEIGHED], 1.0 / count.max(1) as f32);
        if !(2..=MAX_WEIGHED).contains(&count) {
            return LightPmf { each, even: Some(share), count };
        }
        weigh(&self.eights, position, normal, &mut each);
        let sum = each[..count].iter().fold(0.0, |sum, weight| sum + weight);
        if !(sum > 0.0 && sum.is_finite()) {
            return LightPmf { each, even: Some(share), count };
        }
        let scale = (1.0 - EVEN) * self.near / sum;
        for (weight, bound) in each.iter_mut().zip(&self.bounds) {
            *weight = if bound.near { EVEN * share + scale * *weight } else { share };
        }
        LightPmf { each, even: None, count }
    }
}

impl LightPmf {
    /// The mean of this and another.
    pub(super) fn mean(mut self, other: &Self) -> Self {
        let all: [f32; MAX_WEIGHED] = std::array::from_fn(|light| 0.5 * (self.of(light) + other.of(light)));
        if self.count <= MAX_WEIGHED {
            (self.each, self.even) = (all, None);
        }
        self
    }

    /// The probability of one light.
    pub(super) fn of(&self, light: usize) -> f32 {
        self.even.unwrap_or_else(|| self.each.get(light).copied().unwrap_or(0.0))
    }

    /// The light that a uniform number chooses, its probability, and the number rescaled to be uniform again. None where there is
    /// no light to choose.
    #[inline(always)]
    pub(super) fn choose(&self, x: f32) -> Option<(usize, f32, f32)> {
        let last = self.count.checked_sub(1)?;
        if let Some(share) = self.even {
            let scaled = x * self.count as f32;
            let index = (scaled as usize).min(last);
            return Some((index, share, (scaled - index as f32).clamp(0.0, 0.999_999_9)));
        }
        let mut before = 0.0;
        for (index, &chance) in self.each[..last].iter().enumerate() {
            if x < before + chance {
                return Some((index, chance, ((x - before) / chance).clamp(0.0, 0.999_999_9)));
            }
            before += chance;
        }
        let chance = self.each[last];
        Some((last, chance, ((x - before) / chance).clamp(0.0, 0.999_999_9)))
    }
}
