//! Light from every basis light, of emission 1: sampled from a surface (next-event estimation), and found where a ray
//! ends on an emitter or leaves the scene. Both give the density of the sampling, so that they can be weighed.
//!
//! Which light a sample goes to does not depend on any emission: the columns of `T` are lit later, and a lamp that is
//! dim in the scene file may be the only one that burns. All lights get the same share of the samples; one pair of
//! numbers from a net chooses light and point together, so the samples of a pixel cover all texels evenly.

mod area;
mod point;

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::bsdf::cosine_hemisphere;
use super::frame::Frame;
use crate::error::{Error, Result};
use crate::scene::{Emitter, EnvironmentEmitter, Scene};
use area::AreaLight;
use point::PointLight;

/// One light, ready to be sampled.
#[derive(Debug)]
enum Source {
    Area(AreaLight),
    Point(PointLight),
    Environment(EnvironmentEmitter),
}

/// All lights of a scene.
#[derive(Debug)]
pub(super) struct Lights {
    sources: Vec<(Source, u32)>,
    /// Sources that a ray leaving the scene may find.
    distant: Vec<u32>,
}

/// A point on a light as seen from a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// Unit direction to the light.
    pub(super) towards: Vec3,
    /// Distance to the light; infinite for environments and suns.
    pub(super) distance: f32,
    /// Column of `T` that it belongs to.
    pub(super) column: u32,
    /// Radiance (or intensity over squared distance) over the density of this sample, choice of light included.
    pub(super) weight: Vec3,
    /// Density over solid angle, choice of light included; 0 for lights that no ray can find.
    pub(super) pdf: f32,
}

/// Emission that a ray has found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// Column of `T`.
    pub(super) column: u32,
    /// Radiance.
    pub(super) radiance: Vec3,
    /// Density over solid angle with which [`Lights::sample`] would have chosen the direction.
    pub(super) pdf: f32,
}

impl Lights {
    /// Prepares the lights of a scene. Errors: an emitter without area, or that names triangles that are not there.
    pub(super) fn new(scene: &Scene) -> Result<Self> {
        if scene.emitters.len() != scene.basis.lights().len() || scene.emitters.is_empty() {
            return Err(Error::input(
                &scene.name,
                format!("{} emitters for {} lights", scene.emitters.len(), scene.basis.lights().len()),
                "give the scene one emitter for each light, and at least one",
            ));
        }
        let mut sources = Vec::new();
        for (emitter, light) in scene.emitters.iter().zip(scene.basis.lights()) {
            let source = match emitter {
                Emitter::Area(emitter) => Source::Area(AreaLight::new(scene, emitter, &light.name)?),
                Emitter::Point(emitter) => Source::Point(PointLight::new(emitter.clone())),
                Emitter::Environment(emitter) => Source::Environment(*emitter),
            };
            sources.push((source, light.first_column));
        }
        let is_distant = |source: &Source| match source {
            Source::Area(_) => false,
            Source::Point(light) => light.is_disc(),
            Source::Environment(_) => true,
        };
        let distant = (0..sources.len() as u32).filter(|&i| is_distant(&sources[i as usize].0)).collect();
        Ok(Self { sources, distant })
    }

    /// Chance that a sample goes to one light.
    fn chance(&self) -> f32 {
        1.0 / self.sources.len() as f32
    }

    /// Chooses a light and a point on it for a surface at `position` with shading frame `frame`. None where the point
    /// sends nothing there.
    pub(super) fn sample(&self, scene: &Scene, position: Vec3, frame: &Frame, pair: Vec2) -> Option<LightSample> {
        let scaled = pair.x * self.sources.len() as f32;
        let index = (scaled as usize).min(self.sources.len() - 1);
        let pair = Vec2::new((scaled - index as f32).clamp(0.0, 0.999_999_9), pair.y);
        let (source, first_column) = &self.sources[index];
        let chance = self.chance();
        let mut sample = match source {
            Source::Area(light) => light.sample(scene, position, pair)?,
            Source::Point(light) => light.sample(position, pair)?,
            Source::Environment(light) => {
                // Of emission 1 everywhere, so the cosine at the surface is all there is to follow.
                let local = cosine_hemisphere(pair);
                let towards = frame.to_world(local);
                let pdf = local.z * FRAC_1_PI;
                let column = environment_column(light, towards);
                LightSample { towards, distance: f32::INFINITY, column, weight: Vec3::splat(1.0 / pdf), pdf }
            }
        };
        sample.column += first_column;
        sample.weight /= chance;
        sample.pdf *= chance;
        Some(sample)
    }

    /// Emission of light `emitter` where a ray along `direction` hits its triangle at `position`, `distance` from the
    /// surface that scattered it. `normal` is the triangle's front.
    pub(super) fn on_surface(&self, scene: &Scene, emitter: u32, hit: &EmitterHit) -> Option<Found> {
        let (Source::Area(light), first_column) = self.sources.get(emitter as usize)? else { return None };
        let mut found = light.found(scene, hit)?;
        found.column += first_column;
        found.pdf *= self.chance();
        Some(found)
    }

    /// Emission found by a ray that leaves the scene along `direction`, having been scattered at a surface whose
    /// shading normal makes `cosine` with it.
    pub(super) fn beyond(&self, direction: Vec3, cosine: f32) -> impl Iterator<Item = Found> + '_ {
        self.distant.iter().filter_map(move |&i| {
            let (source, first_column) = &self.sources[i as usize];
            let mut found = match source {
                Source::Area(_) => return None,
                Source::Point(light) => light.found(direction)?,
                Source::Environment(light) => Found {
                    column: environment_column(light, direction),
                    radiance: Vec3::ONE,
                    pdf: cosine.max(0.0) * FRAC_1_PI,
                },
            };
            found.column += first_column;
            found.pdf *= self.chance();
            Some(found)
        })
    }
}

/// Where a ray has hit a triangle of an emitter.
#[derive(Clone, Copy, Debug)]
pub(super) struct EmitterHit {
    /// The point.
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

fn environment_column(light: &EnvironmentEmitter, towards: Vec3) -> u32 {
    light.mapping.texel_at(light.world_from_environment.transpose() * towards)
}
