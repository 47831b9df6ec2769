//! Lights of the basis, each of emission 1. They are sampled from surfaces (next-event estimation), and hit by rays
//! that end on an emitter or leave the scene. Both give the density of light sampling, for MIS weights.
//!
//! The choice of a light does not depend on emission, since the columns of `T` are lit later, and a lamp that is dim in
//! the scene file may be the only one that is on. It depends on the positions of lights and surface (`choice`). One
//! pair of numbers from a (0, 2)-net chooses light and point together, so that the samples of a pixel cover all texels
//! of a light evenly.

mod area;
mod choice;
mod point;
mod suns;

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::bsdf::cosine_hemisphere;
use super::cap::cap_direction;
use super::frame::ShadingFrame;
use super::photon_targets::Targets;
use super::sampler::{Dimension, Sampler};
use super::segment::End;
use crate::error::{Error, Result};
use crate::scene::{Emitter, EnvironmentEmitter, Scene};
use area::AreaLight;
use choice::LightChoice;
pub(super) use choice::LightPmf;
use point::PointLight;
pub(super) use suns::SunShare;
use suns::Suns;

/// One light, ready to be sampled.
#[derive(Debug)]
enum Source {
    Area(AreaLight),
    Point(PointLight),
    Environment(EnvironmentEmitter),
    /// Never drawn: a surface asks for all of them ([`LightSampler::suns`]).
    Suns,
}

/// All lights of a scene.
#[derive(Debug)]
pub(super) struct LightSampler {
    sources: Vec<(Source, u32)>,
    choice: LightChoice,
    /// Lights at infinity, which rays that leave the scene may hit.
    distant: Vec<u32>,
    /// Lights that the camera does not see, ascending.
    unseen: Vec<u32>,
    /// Places of the sun, of which every path's first surface asks for its share.
    suns: Vec<Suns>,
    /// The sky whose reflected light has columns of its own.
    split: Option<SplitSky>,
}

/// A sky with two rows of columns: for what comes straight from it, and for what other surfaces reflect.
#[derive(Clone, Copy, Debug)]
pub(super) struct SplitSky {
    first_column: u32,
    /// Columns of a row.
    count: u32,
}

impl SplitSky {
    /// The column of light that other surfaces reflect.
    #[inline(always)]
    pub(super) fn reflected(self, column: u32) -> u32 {
        let is_its = column.wrapping_sub(self.first_column) < self.count;
        if is_its { column + self.count } else { column }
    }
}

/// A surface that light falls on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver {
    pub(super) position: Vec3,
    /// Shading normal.
    pub(super) normal: Vec3,
    /// Whether light from behind counts as well.
    pub(super) two_sided: bool,
}

/// A light sample: a point on a light, seen from a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// Unit direction to the light.
    pub(super) towards: Vec3,
    /// End of the shadow ray: offset from the light's own surface; at infinity for environments and suns.
    pub(super) end: End,
    /// Column of `T` that it belongs to.
    pub(super) column: u32,
    /// Radiance (or intensity over squared distance) over the density of this sample, the choice of the light included.
    pub(super) weight: Vec3,
    /// Solid-angle density, the choice of the light included; 0 for lights that no ray can hit.
    pub(super) pdf: f32,
}

/// A photon emitted by a light of emission 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Emitted {
    pub(super) origin: Vec3,
    /// Unit direction.
    pub(super) direction: Vec3,
    /// Column of `T` that it belongs to.
    pub(super) column: u32,
    /// Flux over the density of this photon.
    pub(super) power: Vec3,
    /// Its density over area times projected solid angle; for lights at infinity, over solid angle times the area
    /// across. 0 for lights that no ray can hit.
    pub(super) density: f32,
}

/// Emission that a ray has hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenLight {
    /// Index of the light.
    pub(super) source: u32,
    /// Column of `T`.
    pub(super) column: u32,
    /// Radiance.
    pub(super) radiance: Vec3,
    /// Solid-angle density with which [`LightSampler::sample`] would have chosen the direction.
    pub(super) pdf: f32,
}

impl LightSampler {
    /// Prepares the lights of a scene. Errors: an emitter without area, or with triangles that do not exist.
    pub(super) fn new(scene: &Scene) -> Result<Self> {
        if scene.emitters.len() != scene.basis.lights().len() || scene.emitters.is_empty() {
            return Err(Error::input(
                &scene.name,
                format!("{} emitters for {} lights", scene.emitters.len(), scene.basis.lights().len()),
                "give the scene one emitter for each light, and at least one",
            ));
        }
        let (mut sources, mut suns, mut split) = (Vec::new(), Vec::new(), None);
        for (emitter, light) in scene.emitters.iter().zip(scene.basis.lights()) {
            let source = match emitter {
                Emitter::Area(emitter) => Source::Area(AreaLight::new(scene, emitter, &light.name)?),
                Emitter::Point(emitter) => Source::Point(PointLight::new(emitter.clone())),
                Emitter::Environment(emitter) => {
                    if emitter.is_split {
                        let count = emitter.mapping.texel_count();
                        split = Some(SplitSky { first_column: light.first_column, count });
                    }
                    Source::Environment(*emitter)
                }
                Emitter::Suns(places) => {
                    suns.push(Suns::new(places, light.first_column));
                    Source::Suns
                }
            };
            sources.push((source, light.first_column));
        }
        let is_distant = |source: &Source| match source {
            Source::Area(_) | Source::Suns => false,
            Source::Point(light) => light.is_disc(),
            Source::Environment(_) => true,
        };
        let distant = (0..sources.len() as u32).filter(|&i| is_distant(&sources[i as usize].0)).collect();
        // Places of the sun are the last lights, and are not drawn.
        let drawn = sources.iter().take_while(|(source, _)| !matches!(source, Source::Suns)).count();
        if sources[drawn..].iter().any(|(source, _)| !matches!(source, Source::Suns)) {
            return Err(Error::input(&scene.name, "has a light behind places of the sun", "put these last"));
        }
        let choice = LightChoice::new(scene, &sources[..drawn]);
        let mut unseen = scene.unseen_lights.clone();
        unseen.sort_unstable();
        Ok(Self { sources, choice, distant, unseen, suns, split })
    }

    /// Whether the camera sees a light.
    #[inline(always)]
    pub(super) fn is_seen(&self, source: u32) -> bool {
        self.unseen.binary_search(&source).is_err()
    }

    /// Whether the camera sees every light.
    #[inline(always)]
    pub(super) fn all_are_seen(&self) -> bool {
        self.unseen.is_empty()
    }

    /// Places of the sun.
    #[inline(always)]
    pub(super) fn suns(&self) -> &[Suns] {
        &self.suns
    }

    /// The sky whose reflected light has columns of its own.
    pub(super) fn split_sky(&self) -> Option<SplitSky> {
        self.split
    }

    /// The probabilities of all lights at a surface.
    #[inline(always)]
    pub(super) fn chances(&self, at: &Receiver) -> LightPmf {
        let before = self.choice.at(at.position, at.normal);
        if at.two_sided { before.mean(&self.choice.at(at.position, -at.normal)) } else { before }
    }

    /// Chooses a light, by the probabilities of a surface with the given shading frame, and a point on it. `None` if the
    /// point emits nothing to the surface.
    #[inline(always)]
    pub(super) fn sample(
        &self,
        scene: &Scene,
        at: &Receiver,
        frame: &ShadingFrame,
        chances: &LightPmf,
        pair: Vec2,
    ) -> Option<LightSample> {
        let position = at.position;
        let (index, chance, x) = chances.choose(pair.x)?;
        let pair = Vec2::new(x, pair.y);
        let (source, first_column) = &self.sources[index];
        let mut sample = match source {
            Source::Area(light) => light.sample(scene, position, pair)?,
            Source::Point(light) => light.sample(position, pair)?,
            Source::Suns => return None,
            Source::Environment(light) => {
                // Emission is 1 everywhere, so directions follow the cosine at the surface alone.
                let (side, pair) = if at.two_sided { side_of(pair) } else { (1.0, pair) };
                let mut local = cosine_hemisphere(pair);
                local.z *= side;
                let towards = frame.to_world(local);
                let pdf = environment_pdf(at, local.z);
                let column = environment_column(light, towards);
                LightSample { towards, end: End::Beyond(towards), column, weight: Vec3::splat(1.0 / pdf), pdf }
            }
        };
        sample.column += first_column;
        sample.weight /= chance;
        sample.pdf *= chance;
        Some(sample)
    }

    /// Emission of light `emitter` at a ray's hit on its triangle. `from` is the origin of the ray.
    #[inline(always)]
    pub(super) fn on_surface(
        &self,
        scene: &Scene,
        emitter: u32,
        hit: &EmitterHit,
        from: &Receiver,
    ) -> Option<SeenLight> {
        let (Source::Area(light), first_column) = self.sources.get(emitter as usize)? else { return None };
        let mut found = light.found(scene, hit)?;
        found.source = emitter;
        found.column += first_column;
        found.pdf *= self.chances(from).of(emitter as usize);
        Some(found)
    }

    /// Emission hit by a ray that leaves the scene along `direction`. `cosine` is that of the scattering surface's
    /// shading normal.
    pub(super) fn beyond(&self, direction: Vec3, cosine: f32, from: &Receiver) -> impl Iterator<Item = SeenLight> + '_ {
        let chances = (!self.distant.is_empty()).then(|| self.chances(from));
        let sky = environment_pdf(from, cosine);
        self.distant.iter().filter_map(move |&i| {
            let (source, first_column) = &self.sources[i as usize];
            let mut found = match source {
                Source::Area(_) | Source::Suns => return None,
                Source::Point(light) => light.found(direction)?,
                Source::Environment(light) => {
                    SeenLight { source: 0, column: environment_column(light, direction), radiance: Vec3::ONE, pdf: sky }
                }
            };
            found.source = i;
            found.column += first_column;
            found.pdf *= chances.map_or(0.0, |chances| chances.of(i as usize));
            Some(found)
        })
    }

    /// Emits a photon from a light towards the targets. `None` if the light emits nothing along the direction drawn.
    pub(super) fn emit(&self, scene: &Scene, targets: &Targets, source: u32, sampler: &Sampler) -> Option<Emitted> {
        let (source, first_column) = &self.sources[source as usize];
        let pairs = [sampler.pair(Dimension::Light, 0), sampler.pair(Dimension::Scatter, 0)];
        let mut emitted = match source {
            Source::Area(light) => light.emit(scene, targets, pairs)?,
            Source::Point(light) => light.emit(targets, pairs)?,
            // What mirrors and glass throw on is no light that comes straight.
            Source::Suns => return None,
            Source::Environment(light) => {
                let towards = cap_direction(Vec3::Z, 2.0, pairs[0]);
                let (origin, across) = targets.sample_beam(towards, pairs[1])?;
                let density = across * EVERYWHERE;
                let column = environment_column(light, towards);
                Emitted { origin, direction: -towards, column, power: Vec3::splat(1.0 / density), density }
            }
        };
        emitted.column += first_column;
        Some(emitted)
    }

    /// Density of photons that [`Self::emit`] sends back along a ray from its hit.
    pub(super) fn emitted_density(&self, targets: &Targets, source: u32, hit: &EmitterHit) -> f32 {
        match self.sources.get(source as usize) {
            Some((Source::Area(light), _)) => light.emitted_density(targets, hit),
            Some((Source::Point(light), _)) => light.emitted_density(targets, hit),
            Some((Source::Environment(_), _)) => EVERYWHERE * targets.beam_density(hit.position, hit.direction),
            Some((Source::Suns, _)) | None => 0.0,
        }
    }
}

/// The side that a number chooses, as the sign of its cosine, and the pair with that number uniform again.
fn side_of(pair: Vec2) -> (f32, Vec2) {
    let (side, x) = if pair.x < 0.5 { (1.0, 2.0 * pair.x) } else { (-1.0, 2.0 * pair.x - 1.0) };
    (side, Vec2::new(x, pair.y))
}

/// Solid-angle density of a sample of the environment with a cosine at the surface.
#[inline(always)]
fn environment_pdf(at: &Receiver, cosine: f32) -> f32 {
    if at.two_sided { 0.5 * cosine.abs() * FRAC_1_PI } else { cosine.max(0.0) * FRAC_1_PI }
}

/// Solid-angle density that is uniform over all directions.
const EVERYWHERE: f32 = 0.25 * FRAC_1_PI;

/// A ray's hit on a triangle of an emitter, or the ray leaving the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct EmitterHit {
    /// The point; any point of the ray if it has left the scene.
    pub(super) position: Vec3,
    /// Unit normal of the triangle's front.
    pub(super) normal: Vec3,
    /// Texture coordinates.
    pub(super) uv: Vec2,
    /// Unit direction of the ray.
    pub(super) direction: Vec3,
    /// Distance from where the ray was scattered.
    pub(super) distance: f32,
}

impl EmitterHit {
    /// The hit of a ray that has left the scene.
    pub(super) fn beyond(origin: Vec3, direction: Vec3) -> Self {
        Self { position: origin, normal: Vec3::ZERO, uv: Vec2::ZERO, direction, distance: f32::INFINITY }
    }
}

fn environment_column(light: &EnvironmentEmitter, towards: Vec3) -> u32 {
    light.mapping.texel_at(light.world_from_environment.transpose() * towards)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{PI, TAU};
    use std::sync::Arc;

    use glam::Mat3;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::statistics::chi_square_p_value;
    use super::super::world::World;
    use super::*;
    use crate::light::{EnvironmentMapping, Light, LightBasis, LightKind, LightUnit};
    use crate::scene::{
        AreaEmitter, AreaLayout, Camera, Material, MaterialId, Mesh, PixelFilter, PointEmitter, Surface, Triangle,
        Vertex,
    };

    /// A scene of black triangles that together are one light, without a camera view of it.
    fn scene(triangles: &[[Vec3; 3]], kind: LightKind, emitter: Emitter) -> Arc<Scene> {
        let mut mesh = Mesh::default();
        for (index, corners) in triangles.iter().enumerate() {
            let first = 3 * index as u32;
            mesh.vertices.extend(corners.map(|position| Vertex { position, ..Vertex::default() }));
            mesh.triangles.push(Triangle {
                vertices: [first, first + 1, first + 2],
                material: MaterialId(0),
                emitter: Some(0),
            });
        }
        let (across, down) = kind.layout();
        let columns = (across * down) as usize;
        let mut basis = LightBasis::new();
        let light = Light {
            name: "light".into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![0.0; columns],
        };
        basis.push(light).unwrap();
        let materials = vec![Material::new("black", Surface::Black)];
        let camera = Camera::looking(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, (1, 1), PixelFilter::Box).unwrap();
        let (textures, emitters, metres_per_unit) = (Vec::new(), vec![emitter], 1.0);
        let name = "test".into();
        Arc::new(Scene {
            name,
            origin: glam::DVec3::ZERO,
            mesh,
            materials,
            textures,
            camera,
            emitters,
            unseen_lights: Vec::new(),
            sensors: None,
            shows_irradiance: false,
            basis,
            metres_per_unit,
        })
    }

    fn area(triangles: &[[Vec3; 3]], layout: AreaLayout, two_sided: bool) -> Arc<Scene> {
        let kind = match layout {
            AreaLayout::Whole => LightKind::Lamp,
            AreaLayout::Texels { across, down, .. } => LightKind::AreaTexels { across, down },
        };
        let members = (0..triangles.len() as u32).collect();
        let emitter = AreaEmitter { triangles: members, layout, two_sided, pattern: None };
        scene(triangles, kind, Emitter::Area(emitter))
    }

    fn receiver(position: Vec3, frame: &ShadingFrame) -> Receiver {
        Receiver { position, normal: frame.z, two_sided: false }
    }

    /// The hit of a ray from `position` along `direction`: column, and density of light sampling.
    fn found(world: &World, position: Vec3, frame: &ShadingFrame, direction: Vec3) -> Option<SeenLight> {
        let lights = &world.lights;
        let Some(point) = world.intersect(position, direction, &mut 0) else {
            return lights.beyond(direction, frame.to_local(direction).z, &receiver(position, frame)).next();
        };
        let (position_hit, normal, uv) = (point.position, point.normal, point.uv);
        let distance = position.distance(position_hit);
        let hit = EmitterHit { position: position_hit, normal, uv, direction, distance };
        let emitter = world.scene.mesh.triangles[point.triangle as usize].emitter.unwrap_or(0);
        lights.on_surface(&world.scene, emitter, &hit, &receiver(position, frame))
    }

    /// Compares light samples, binned by direction around `axis` within `reach` radians, with the density reported to
    /// rays along those directions. Columns must agree as well.
    fn holds(name: &str, scene: Arc<Scene>, axis: Vec3, reach: f32) {
        const RINGS: usize = 16;
        const TURNS: usize = 32;
        const FINE: usize = 40;
        let world = World::new(scene).unwrap();
        let (position, shading) =
            (Vec3::new(0.1, 0.2, -0.3), ShadingFrame::around(Vec3::new(0.3, 0.9, -0.2).normalize()));
        let around = ShadingFrame::around(axis.normalize());
        let cap = 2.0 * (0.5 * reach).sin().powi(2);
        let direction = |ring: f32, turn: f32| {
            let drop = cap * ring / RINGS as f32;
            let across = (drop * (2.0 - drop)).max(0.0).sqrt();
            let (sin, cos) = (TAU * turn / TURNS as f32).sin_cos();
            around.to_world(Vec3::new(across * cos, across * sin, 1.0 - drop))
        };
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let draws = 200_000u32;
        let mut counts = vec![0u32; RINGS * TURNS + 1];
        let mut strangers = 0;
        for _ in 0..draws {
            let pair = Vec2::new(random.random(), random.random());
            let at = receiver(position, &shading);
            let bin = match world.lights.sample(&world.scene, &at, &shading, &world.lights.chances(&at), pair) {
                Some(sample) => {
                    let back = found(&world, position, &shading, sample.towards);
                    // At a texel's or the light's own edge, rounding may put the ray on the other side.
                    let same =
                        back.is_some_and(|f| f.column == sample.column && (f.pdf / sample.pdf - 1.0).abs() < 1e-2);
                    strangers += u32::from(!same);
                    let local = around.to_local(sample.towards);
                    // 1 − z, precise also if z is nearly 1.
                    let drop = (local.x * local.x + local.y * local.y) / (1.0 + local.z);
                    let ring = (drop / cap * RINGS as f32) as usize;
                    let turn = local.y.atan2(local.x).rem_euclid(TAU) / TAU * TURNS as f32;
                    ring.min(RINGS - 1) * TURNS + (turn as usize).min(TURNS - 1)
                }
                None => RINGS * TURNS,
            };
            counts[bin] += 1;
        }
        assert!(strangers < draws / 500, "{name}: {strangers} samples are not what a ray finds there");
        let bin_angle = f64::from(cap * TAU) / (RINGS * TURNS) as f64;
        let mut expected: Vec<f64> = (0..RINGS * TURNS)
            .map(|bin| {
                let inside = |k: usize| (k as f32 + 0.5) / FINE as f32;
                let sum: f64 = (0..FINE * FINE)
                    .map(|k| {
                        direction((bin / TURNS) as f32 + inside(k / FINE), (bin % TURNS) as f32 + inside(k % FINE))
                    })
                    .filter_map(|d| found(&world, position, &shading, d))
                    .map(|f| f64::from(f.pdf))
                    .sum();
                sum / (FINE * FINE) as f64 * bin_angle * f64::from(draws)
            })
            .collect();
        let inside: f64 = expected.iter().sum();
        expected.push((f64::from(draws) - inside).max(0.0));
        let p = chi_square_p_value(&counts, &expected);
        assert!(p > 1e-4, "{name}: p = {p:.2e}, {inside} of {draws} inside");
    }

    fn rectangle(origin: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
        [[origin, origin + u, origin + u + v], [origin, origin + u + v, origin + v]]
    }

    #[test]
    fn area_lights_are_sampled_with_the_density_that_rays_are_told() {
        let (origin, u, v) = (Vec3::new(-0.6, 1.4, 0.5), Vec3::Z * -1.1, Vec3::X * 1.7);
        let panel = rectangle(origin, u, v);
        let normal = u.cross(v).normalize();
        let layout = AreaLayout::Texels { origin, edge_u: u, edge_v: v, normal, across: 7, down: 5 };
        holds("texels", area(&panel, layout, false), normal * -1.0, 1.2);
        // A tent of four triangles of different sizes, some facing away; then the same lit on both sides.
        let roof = rectangle(Vec3::new(-0.5, 1.5, -0.5), Vec3::new(1.0, 0.4, 0.0), Vec3::Z * 0.9);
        let wall = rectangle(Vec3::new(0.8, 0.3, -1.0), Vec3::Y * 0.6, Vec3::Z * 1.4);
        let tent = [roof[0], roof[1], wall[0], wall[1]];
        holds("triangles", area(&tent, AreaLayout::Whole, false), Vec3::new(0.5, 1.0, 0.2), 1.9);
        holds("triangles, both sides", area(&tent, AreaLayout::Whole, true), Vec3::new(0.5, 1.0, 0.2), 1.9);
    }

    #[test]
    fn lights_are_chosen_with_the_chances_that_rays_are_told() {
        let panel = |x: f32, y: f32| rectangle(Vec3::new(x, y, 0.3), Vec3::Z * -0.6, Vec3::X * 0.5);
        // None occludes another, or the sun.
        let panels = [panel(-0.4, 0.9), panel(0.7, 1.6), panel(-2.6, 2.5)];
        let place = |members: [u32; 2]| AreaEmitter {
            triangles: members.to_vec(),
            layout: AreaLayout::Whole,
            two_sided: true,
            pattern: None,
        };
        let mut lit = Arc::unwrap_or_clone(area(panels.as_flattened(), AreaLayout::Whole, true));
        let sun = PointEmitter::Sun { towards: Vec3::new(-0.2, 0.5, -0.9).normalize(), angular_radius_radians: 0.3 };
        lit.emitters = (0..3).map(|i| Emitter::Area(place([2 * i, 2 * i + 1]))).collect();
        lit.emitters.push(Emitter::Point(sun));
        let light = lit.basis.lights()[0].clone();
        for (index, triangle) in lit.mesh.triangles.iter_mut().enumerate() {
            triangle.emitter = Some(index as u32 / 2);
        }
        for column in 1..4 {
            let (name, kind) = (format!("light {column}"), if column < 3 { LightKind::Lamp } else { LightKind::Sun });
            lit.basis.push(Light { name, kind, first_column: column, ..light.clone() }).unwrap();
        }
        holds("several", Arc::new(lit), Vec3::Y, 1.7);
    }

    #[test]
    fn environments_and_suns_are_sampled_with_the_density_that_rays_are_told() {
        let turned = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(0.3);
        for (mapping, kind) in [
            (EnvironmentMapping::Octahedral { side: 6 }, LightKind::Octahedral { side: 6 }),
            (EnvironmentMapping::LatLong { across: 9, down: 4 }, LightKind::LatLong { across: 9, down: 4 }),
        ] {
            let sky = EnvironmentEmitter { mapping, world_from_environment: turned, is_split: false };
            holds("environment", scene(&[], kind, Emitter::Environment(sky)), Vec3::Y, PI);
        }
        for radius in [0.004_651, 0.4] {
            let towards = Vec3::new(0.4, 0.8, 0.3).normalize();
            let sun = PointEmitter::Sun { towards, angular_radius_radians: radius };
            holds("sun", scene(&[], LightKind::Sun, Emitter::Point(sun)), towards, radius * 1.25);
        }
    }
}
