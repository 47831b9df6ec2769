//! The path of a photon through mirrors and glass.

use glam::{Vec2, Vec3};

use super::super::lights::Emitted;
use super::super::sampler::{Dimension, KIND_DIMENSION, Sampler};
use super::super::vertex::{PathRay, PathVertex};
use super::super::world::{MAX_PASSES, World};
use super::{Photon, fold};

/// Upper bound of the factor where the shading normal is nearly across the surface: at borders of coarse meshes.
const MAX_GAIN: f32 = 4.0;

/// Follows a photon to the first surface that scatters. `None` if it arrives there straight, which light samples cover,
/// or not at all. `share` is its part of the light's flux; `rays` counts the rays traced.
pub(super) fn follow(
    world: &World,
    max_depth: u32,
    emitted: Emitted,
    sampler: &Sampler,
    share: f32,
    rays: &mut u64,
) -> Option<Photon> {
    let Emitted { origin, direction, column, mut power, density } = emitted;
    let mut ray = PathRay::new(origin, direction);
    let (mut segments, mut passes) = (1, 0);
    // The camera path to its surface has at least one segment.
    while segments < max_depth && passes < MAX_PASSES {
        let point = world.intersect(ray.origin, ray.direction, rays)?;
        let kind = || sampler.pair(Dimension::Choice, KIND_DIMENSION + segments + passes).x;
        let at = PathVertex::new(world, point, &ray, kind);
        power *= at.kept;
        let mut choice = sampler.pair(Dimension::Choice, segments + passes);
        if choice.x >= at.opacity {
            passes += 1;
            ray = at.past(&ray);
            continue;
        }
        choice.x /= at.opacity;
        if at.bsdf.lobes().is_non_specular() {
            let folded = (fold(ray.direction), fold(at.normal));
            let rests = segments > 1 && power.is_finite();
            return rests.then_some(Photon {
                position: at.point.position,
                power: power * share,
                column,
                density,
                direction: folded.0,
                normal: folded.1,
                segments,
            });
        }
        let next = at.bsdf.sample(at.wo, Vec2::splat(0.5), choice.x)?;
        // Photons carry flux, which the index of a medium does not change.
        power *= next.weight * next.eta_scale;
        if next.pass_through {
            passes += 1;
            ray = at.past(&ray);
        } else {
            let leaving = at.leaving(&next)?;
            power *= gain(&at, ray.direction, leaving, next.wi.z.abs());
            ray = at.ray(world, leaving);
            segments += 1;
        }
        if power == Vec3::ZERO {
            return None;
        }
    }
    None
}

/// The factor by which photons differ from camera paths under shading normals: `|ωi·Ns| |ωo·Ng| / (|ωi·Ng| |ωo·Ns|)`
/// (Veach 1997, §5.3.2).
fn gain(at: &PathVertex, direction: Vec3, leaving: Vec3, cosine: f32) -> f32 {
    let gain = at.wo.z * leaving.dot(at.normal).abs() / (direction.dot(at.normal).abs() * cosine);
    if gain.is_finite() { gain.min(MAX_GAIN) } else { 1.0 }
}
