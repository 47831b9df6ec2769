//! Guiding of paths towards surfaces that a lamp lights from close by, such as the inside of its shade.
//!
//! Seen from the room such a surface is a small solid angle of large radiance, which scattered rays find rarely: the
//! image gets few samples of great weight. So before any block is traced, rays from each lamp show where much of its
//! flux arrives close to it, in shells around the lamp. From each diffuse vertex of a path one more ray is then sent
//! into the cone around such a place, straight through thin sheets (decision 52), and followed on if it arrives there. Light that the path's
//! own ray finds there is weighted against it by the balance heuristic (Veach 1997, §9.2.2), so that the mean is unchanged. A scene without
//! such places is traced as if there were no guiding.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::bsdf::{Bsdf, Lobes, cosine_hemisphere};
use super::cap::{cap_direction, cap_height_of};
use super::frame::ShadingFrame;
use super::sampler::{Dimension, Sampler};
use super::segment::End;
use super::vertex::{PathRay, PathVertex};
use super::world::{MAX_PASSES, SurfacePoint, World};
use crate::scene::{Emitter, PointEmitter};

/// Largest number of places. Every diffuse vertex goes through all of them.
const MAX_PLACES: usize = 64;

/// Rays from each lamp, and from the camera to learn how far from a lamp the picture is.
const RAYS: u32 = 2048;

/// Largest distance of a lit surface from its lamp, in units of the median distance between the lamp and what the camera
/// sees.
const NEAR: f32 = 0.125;

/// Shells around a lamp, each of half the radius of the one before. Irradiance grows as the inverse square of the
/// distance, and with it the weight of a path that finds the surface.
const SHELLS: u32 = 7;

/// Least relative variance that a shell adds to the picture of its lamp, if paths find it by chance.
const MIN_VARIANCE: f32 = 0.05;

/// Probability that a guided ray leaves the first diffuse vertex of a path, and a later one. Tuned: decision 47.
pub(super) const FIRST: f32 = 1.0;
pub(super) const LATER: f32 = 0.5;

/// Survival probability of a path that a guided ray has begun, in units of its throughput and that of other paths. Tuned:
/// decision 47.
pub(super) const SURVIVAL: f32 = 8.0;

/// Seed of the rays. It is fixed, so that the places depend on the scene alone.
const SEED: u64 = 0x0067_7569_6465;

/// A sphere around surfaces that a lamp lights from close by.
#[derive(Clone, Copy, Debug)]
struct Place {
    centre: Vec3,
    radius: f32,
    /// Part of the lamp's flux that arrives in it.
    share: f32,
}

/// The places of a scene.
#[derive(Debug)]
pub(super) struct PathGuide {
    places: Vec<Place>,
}

/// A place as a vertex sees it: directions are uniform over its cone.
struct Cone {
    axis: Vec3,
    /// `1 − cos` of the half angle.
    drop: f32,
    /// Weight of its choice.
    weight: f32,
}

/// A guided ray.
#[derive(Clone, Copy)]
pub(super) struct Guided {
    /// Position and normal that it leaves.
    from: (Vec3, Vec3),
    pub(super) direction: Vec3,
    /// BSDF times cosine.
    value: Vec3,
    /// Density of the direction by the BSDF.
    pub(super) pdf: f32,
    /// Probability that it is sent.
    chance: f32,
}

impl PathGuide {
    /// The places of a scene; `None` if no lamp has any.
    pub(super) fn of(world: &World) -> Option<Self> {
        let emitters = &world.scene.emitters;
        if emitters.iter().all(|emitter| !is_near(emitter)) {
            return None;
        }
        let seen = seen_points(world);
        if seen.is_empty() {
            return None;
        }
        let lamps: Vec<usize> = (0..emitters.len()).filter(|&i| is_near(&emitters[i])).collect();
        let mut places: Vec<Place> =
            lamps.into_par_iter().flat_map_iter(|lamp| Place::of(world, lamp, &seen)).collect();
        places.sort_by(|a, b| b.share.total_cmp(&a.share));
        places.truncate(MAX_PLACES);
        (!places.is_empty()).then_some(Self { places })
    }

    /// Whether rays are guided from a surface: a diffuse one that scatters to one side.
    #[inline(always)]
    pub(super) fn serves(bsdf: &Bsdf) -> bool {
        bsdf.lobes().has(Lobes::DIFFUSE_REFLECTION) && !bsdf.lobes().is_two_sided()
    }

    /// A ray into a place from a diffuse vertex, sent with a probability of `chance`. `None` if it is not sent.
    #[inline(always)]
    pub(super) fn sample(&self, from: &PathVertex, chance: f32, sampler: Sampler) -> Option<Guided> {
        if chance < 1.0 && sampler.pair(Dimension::Choice, 0).x >= chance {
            return None;
        }
        let direction = self.direction((from.point.position, from.frame.z), sampler.pair(Dimension::Light, 0))?;
        let (value, pdf) = from.bsdf.eval(from.wo, from.frame.to_local(direction));
        if value == Vec3::ZERO || direction.dot(from.normal) <= 0.0 {
            return None;
        }
        Some(Guided { from: (from.point.position, from.frame.z), direction, value, pdf, chance })
    }

    /// The factor on the throughput of a guided ray that arrives at a point; 0 beside the places that it was sent to.
    #[inline(always)]
    pub(super) fn weight_of_guided(&self, ray: &Guided, position: Vec3) -> Vec3 {
        let guided = ray.chance * self.pdf(ray.from, ray.direction, position);
        if guided > 0.0 { ray.value / (ray.pdf + guided) } else { Vec3::ZERO }
    }

    /// The weight of a path whose own ray, scattered with the density `pdf` at a diffuse vertex, arrives at a point, where
    /// guided rays leave the vertex with a probability of `chance`.
    #[inline(always)]
    pub(super) fn weight(&self, from: (Vec3, Vec3), chance: f32, pdf: f32, direction: Vec3, position: Vec3) -> f32 {
        match self.places.iter().any(|place| place.encloses(position)) {
            true => pdf / (pdf + chance * self.pdf(from, direction, position)),
            false => 1.0,
        }
    }

    /// A direction into the cone of a place, which is chosen by its weight. `None` if no place lies above the vertex.
    #[inline(always)]
    fn direction(&self, from: (Vec3, Vec3), pair: Vec2) -> Option<Vec3> {
        // Weighted reservoir sampling (Chao 1982) with one number, rescaled at each choice.
        let (mut sum, mut x, mut chosen) = (0.0, pair.x, None);
        for cone in self.places.iter().filter_map(|place| place.cone(from)) {
            sum += cone.weight;
            let chance = cone.weight / sum;
            if x < chance || chosen.is_none() {
                x = (x / chance).min(0.999_999_9);
                chosen = Some(cone);
            } else {
                x = (x - chance) / (1.0 - chance);
            }
        }
        chosen.map(|cone| cap_direction(cone.axis, cone.drop, Vec2::new(x, pair.y)))
    }

    /// Solid-angle density of the directions into the cones of those places that a point lies in.
    fn pdf(&self, from: (Vec3, Vec3), direction: Vec3, position: Vec3) -> f32 {
        let (mut sum, mut own) = (0.0, 0.0);
        for place in &self.places {
            let Some(cone) = place.cone(from) else { continue };
            sum += cone.weight;
            if cap_height_of(cone.axis, direction) <= cone.drop && place.encloses(position) {
                own += cone.weight / (TAU * cone.drop);
            }
        }
        if own > 0.0 { own / sum } else { 0.0 }
    }
}

impl Place {
    /// The cone seen from a vertex with a normal. `None` if it lies inside the place, or the place below its surface.
    #[inline(always)]
    fn cone(&self, (position, normal): (Vec3, Vec3)) -> Option<Cone> {
        let offset = self.centre - position;
        let (square, above) = (offset.length_squared(), offset.dot(normal) + self.radius);
        if square <= self.radius * self.radius || above <= 0.0 {
            return None;
        }
        let (sine2, distance) = (self.radius * self.radius / square, square.sqrt());
        let drop = sine2 / (1.0 + (1.0 - sine2).max(0.0).sqrt());
        let weight = self.share * above / (square * distance);
        (weight > 0.0).then_some(Cone { axis: offset / distance, drop, weight })
    }

    #[inline(always)]
    fn encloses(&self, position: Vec3) -> bool {
        position.distance_squared(self.centre) <= self.radius * self.radius
    }

    /// Where much of a lamp's flux arrives close to it. `seen` is what the camera sees.
    fn of(world: &World, lamp: usize, seen: &[SurfacePoint]) -> Vec<Self> {
        let rays: Vec<(Vec3, Vec3)> = (0..RAYS).filter_map(|ray| emitted(world, lamp, ray)).collect();
        let middle = rays.iter().map(|ray| ray.0).sum::<Vec3>() / rays.len() as f32;
        let mut distances: Vec<f32> = seen.iter().map(|point| point.position.distance(middle)).collect();
        let half = distances.len() / 2;
        let usual = *distances.select_nth_unstable_by(half, f32::total_cmp).1;
        let near = NEAR * usual;
        let mut shells = [const { Vec::new() }; SHELLS as usize];
        for &ray in &rays {
            if let Some((point, distance)) = lit_point(world, ray, near) {
                let shell = (near / distance.max(1e-9 * near)).log2() as usize;
                shells[shell.min(SHELLS as usize - 1)].push(point);
            }
        }
        let place = |lit: &Vec<LitPoint>| {
            let arrived = lit.len() as f32 / rays.len() as f32;
            let centre = lit.iter().map(|lit| lit.position).sum::<Vec3>() / lit.len() as f32;
            let radius = lit.iter().map(|lit| lit.position.distance(centre)).fold(0.0, f32::max);
            // A path that finds the shell has the weight `share (usual / radius)²`, with a chance of `(radius / usual)² / 4`.
            let variance = |visible: f32| 0.25 * visible * (arrived * usual / radius).powi(2);
            // Most shells are left out before it is asked who sees them.
            if radius == 0.0 || variance(1.0) < MIN_VARIANCE {
                return None;
            }
            let visible = visible_part(world, lit, seen);
            let share = visible * lit.len() as f32 / rays.len() as f32;
            (variance(visible) >= MIN_VARIANCE).then_some(Self { centre, radius, share })
        };
        shells.iter().filter_map(place).collect()
    }
}

/// A point on a surface, and the normal on its lit side.
#[derive(Clone, Copy, Debug)]
struct LitPoint {
    position: Vec3,
    normal: Vec3,
    point: SurfacePoint,
}

/// Part of what the camera sees that sees a lit point.
fn visible_part(world: &World, lit: &[LitPoint], seen: &[SurfacePoint]) -> f32 {
    let sees = |(at, from): (usize, &SurfacePoint)| {
        let lit = &lit[at * lit.len() / seen.len()];
        let way = from.position - lit.position;
        let side = from.normal * from.normal.dot(world.scene.camera.towards(from.position)).signum();
        if way.dot(lit.normal) <= 0.0 || way.dot(side) >= 0.0 {
            return false;
        }
        let end = End::At(from.start(-way));
        world.transmittance(lit.point.start(way), end, &mut 0) != Vec3::ZERO
    };
    seen.iter().enumerate().filter(|&pair| sees(pair)).count() as f32 / seen.len() as f32
}

/// Whether a light may have surfaces close by.
fn is_near(emitter: &Emitter) -> bool {
    !matches!(emitter, Emitter::Environment(_) | Emitter::Suns(_) | Emitter::Point(PointEmitter::Sun { .. }))
}

/// A ray that leaves a lamp, of nearly equal flux each. `None` for a spot's ray beside its cone.
fn emitted(world: &World, lamp: usize, ray: u32) -> Option<(Vec3, Vec3)> {
    let sampler = Sampler::new(SEED, lamp as u64, ray);
    let [place, way] = [Dimension::Light, Dimension::Scatter].map(|of| sampler.pair(of, 0));
    match &world.scene.emitters[lamp] {
        Emitter::Point(PointEmitter::Spot { position, direction, outer_radians, .. }) => {
            Some((*position, cap_direction(*direction, 1.0 - outer_radians.cos(), way)))
        }
        Emitter::Point(PointEmitter::Ball { position, cone: Some(cone), .. }) => {
            Some((*position, cap_direction(cone.direction, 1.0 - cone.outer_radians.cos(), way)))
        }
        Emitter::Point(
            PointEmitter::Point { position }
            | PointEmitter::Ies { position, .. }
            | PointEmitter::Ball { position, cone: None, .. },
        ) => Some((*position, cap_direction(Vec3::Z, 2.0, way))),
        Emitter::Area(light) => {
            let mesh = &world.scene.mesh;
            // Triangles of a lamp are alike enough to take each as often.
            let at = (place.x * light.triangles.len() as f32) as usize;
            let triangle = *light.triangles.get(at.min(light.triangles.len() - 1))?;
            let [a, b, c] = mesh.corners(&mesh.triangles[triangle as usize]);
            let inside = (place.x * light.triangles.len() as f32).fract().sqrt();
            let position = a + (b - a) * (inside * (1.0 - place.y)) + (c - a) * (inside * place.y);
            let front = (b - a).cross(c - a).try_normalize()?;
            let choice = sampler.pair(Dimension::Choice, 0).x;
            let normal = if light.two_sided && choice < 0.5 { -front } else { front };
            Some((position, ShadingFrame::around(normal).to_world(cosine_hemisphere(way))))
        }
        Emitter::Point(PointEmitter::Sun { .. }) | Emitter::Environment(_) | Emitter::Suns(_) => None,
    }
}

/// Where a ray from a lamp arrives on a surface that scatters, if that is within a distance, and the distance.
fn lit_point(world: &World, (origin, direction): (Vec3, Vec3), near: f32) -> Option<(LitPoint, f32)> {
    // Beside the lamp's own surface.
    let start = origin + direction * (1e-4 * near);
    let mut ray = PathRay::new(start, direction);
    for _ in 0..MAX_PASSES {
        let point = world.intersect(ray.origin, direction, &mut 0)?;
        let distance = point.position.distance(origin);
        let at = PathVertex::new(world, point, &ray, || 0.5);
        if at.may_be_passed() && distance < near {
            ray = at.past(&ray);
            continue;
        }
        let is_lamp = world.scene.mesh.triangles[point.triangle as usize].emitter.is_some();
        let scatters = at.bsdf.lobes().is_non_specular() && !is_lamp && at.bsdf.albedo(at.wo) != Vec3::ZERO;
        let lit = LitPoint { position: point.position, normal: at.normal, point };
        return (scatters && distance < near).then_some((lit, distance));
    }
    None
}

/// What the camera sees.
fn seen_points(world: &World) -> Vec<SurfacePoint> {
    let camera = &world.scene.camera;
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let point = |ray: u32| {
        let place = Sampler::new(SEED, u64::MAX >> 1, ray).pair(Dimension::Pixel, 0) * size;
        let (origin, direction) = camera.ray(place);
        world.intersect_seen(origin, direction, &mut 0)
    };
    (0..RAYS).filter_map(point).collect()
}
