//! Which light a sample goes to.
//!
//! Every light gets a share of the samples that does not fall below a part of the even one. The rest goes to the lights at some
//! distance by what each would send to the surface if nothing stood between, per unit of its own size: noise counts in
//! each column beside the column's own light, so a large lamp gets no more than a small one. Lights afar, which all surfaces
//! see alike, keep the even share.
//!
//! Of the Conference Room's 24 lamps (16 samples, equal time) each column's squared error is 0.47 to 0.91 of what even shares
//! leave. With less than half shared out evenly the mean gains no more, and columns begin to lose.

use glam::Vec3;

use super::Source;
use crate::scene::{AreaLayout, Scene};

/// Part of the samples that is shared out evenly.
const EVEN: f32 = 0.5;

/// Most lights that are weighed at every surface; more share the samples evenly.
const MOST: usize = 64;

/// Where a light is and where it faces.
#[derive(Clone, Copy, Debug)]
struct Bound {
    centre: Vec3,
    radius: f32,
    /// Zero where it sends light to all sides.
    axis: Vec3,
    /// Whether it has a place at all.
    near: bool,
}

/// The choice between all lights.
#[derive(Debug)]
pub(super) struct Choice {
    bounds: Vec<Bound>,
    /// Share of the samples that goes to lights at some distance.
    near: f32,
}

/// The chance of each light at a surface.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct Chances {
    /// Of the first lights, if they are weighed.
    each: [f32; MOST],
    /// Of every light, if they are not.
    even: Option<f32>,
    count: usize,
}

impl Bound {
    fn of(scene: &Scene, source: &Source) -> Self {
        let unplaced = Self { centre: Vec3::ZERO, radius: 0.0, axis: Vec3::ZERO, near: false };
        match source {
            Source::Environment(_) => unplaced,
            Source::Point(light) => light.position().map_or(unplaced, |centre| Self { centre, near: true, ..unplaced }),
            Source::Area(light) => {
                if let AreaLayout::Texels { origin, edge_u, edge_v, normal, .. } = light.layout() {
                    let (centre, radius) = (origin + 0.5 * (edge_u + edge_v), 0.5 * (edge_u + edge_v).length());
                    let axis = if light.is_two_sided() { Vec3::ZERO } else { normal };
                    return Self { centre, radius, axis, near: true };
                }
                let corners =
                    || light.triangles().iter().map(|&t| scene.mesh.corners(&scene.mesh.triangles[t as usize]));
                let low = corners().flatten().fold(Vec3::INFINITY, Vec3::min);
                let high = corners().flatten().fold(Vec3::NEG_INFINITY, Vec3::max);
                // Area times normal of each: as long as all areas together only where the light is flat.
                let areas = corners().map(|[a, b, c]| (b - a).cross(c - a));
                let (sum, total) = areas.fold((Vec3::ZERO, 0.0), |(sum, total), n| (sum + n, total + n.length()));
                let is_flat = sum.length() > 0.99 * total && !light.is_two_sided();
                let axis = if is_flat { sum.normalize_or_zero() } else { Vec3::ZERO };
                Self { centre: 0.5 * (low + high), radius: 0.5 * (high - low).length(), axis, near: true }
            }
        }
    }

    /// What it sends to a surface if nothing stands between, per unit of its size, and no less than any point of it does.
    fn weight(&self, position: Vec3, normal: Vec3) -> f32 {
        let offset = self.centre - position;
        let square = offset.length_squared() + self.radius * self.radius;
        let here = (offset.dot(normal) + self.radius).max(0.0);
        let there =
            if self.axis == Vec3::ZERO { square.sqrt() } else { (self.radius - offset.dot(self.axis)).max(0.0) };
        if self.near && square > 0.0 { here * there / (square * square) } else { 0.0 }
    }
}

impl Choice {
    pub(super) fn new(scene: &Scene, sources: &[(Source, u32)]) -> Self {
        let bounds: Vec<Bound> = sources.iter().map(|(source, _)| Bound::of(scene, source)).collect();
        let near = bounds.iter().filter(|bound| bound.near).count() as f32 / bounds.len().max(1) as f32;
        Self { bounds, near }
    }

    /// The chances at a surface.
    pub(super) fn at(&self, position: Vec3, normal: Vec3) -> Chances {
        let count = self.bounds.len();
        let (mut each, share) = ([0.0f32; MOST], 1.0 / count.max(1) as f32);
        if !(2..=MOST).contains(&count) {
            return Chances { each, even: Some(share), count };
        }
        let mut sum = 0.0;
        for (weight, bound) in each.iter_mut().zip(&self.bounds) {
            *weight = bound.weight(position, normal);
            sum += *weight;
        }
        if !(sum > 0.0 && sum.is_finite()) {
            return Chances { each, even: Some(share), count };
        }
        let scale = (1.0 - EVEN) * self.near / sum;
        for (weight, bound) in each.iter_mut().zip(&self.bounds) {
            *weight = if bound.near { EVEN * share + scale * *weight } else { share };
        }
        Chances { each, even: None, count }
    }
}

impl Chances {
    /// The chance of one light.
    pub(super) fn of(&self, light: usize) -> f32 {
        self.even.unwrap_or_else(|| self.each.get(light).copied().unwrap_or(0.0))
    }

    /// The light that a number chooses, its chance, and the number stretched to its share again.
    pub(super) fn choose(&self, x: f32) -> (usize, f32, f32) {
        let last = self.count - 1;
        if let Some(share) = self.even {
            let scaled = x * self.count as f32;
            let index = (scaled as usize).min(last);
            return (index, share, (scaled - index as f32).clamp(0.0, 0.999_999_9));
        }
        let mut before = 0.0;
        for (index, &chance) in self.each[..last].iter().enumerate() {
            if x < before + chance {
                return (index, chance, ((x - before) / chance).clamp(0.0, 0.999_999_9));
            }
            before += chance;
        }
        let chance = self.each[last];
        (last, chance, ((x - before) / chance).clamp(0.0, 0.999_999_9))
    }
}
