//! Camera rays that carry no light: they show more of a pixel than its samples do, where a fine texture, leaves, an edge or sheets that let
//! a part of the light through would leave noise in the features.

use glam::Vec3;

use super::camera_ray::ray_of_pixel;
use super::planes::SampleFeatures;
use super::sampler::{Dimension, KIND_DIMENSION, Sampler};
use super::vertex::{PathRay, PathVertex};
use super::world::{MAX_PASSES, World};

/// Share of light below which what lies behind sheets is not looked at.
const LEAST_SHARE: f32 = 1e-3;

/// The features that one more camera ray through a pixel shows. `None` where it comes to a mirror or to smooth glass.
pub(super) fn features_of_ray(
    world: &World,
    pixel: (u32, u32),
    sampler: &Sampler,
    rays: &mut u64,
) -> Option<SampleFeatures> {
    let ray = ray_of_pixel(&world.scene.camera, pixel, sampler);
    let Some(point) = world.intersect_seen(ray.origin, ray.direction, rays) else {
        return Some(SampleFeatures::default());
    };
    let at = PathVertex::new(world, point, &ray, || sampler.pair(Dimension::Choice, KIND_DIMENSION).x);
    let travelled = at.point.position.distance(ray.origin);
    let kept = at.kept;
    features_through(world, &at, ray, (kept, travelled), sampler, rays)
}

/// The features of the surface at which a camera ray arrives and, as far as it lets light through, of those behind it. `kept` is the
/// throughput of the ray there, `travelled` its length. `None` where it comes to a mirror or to smooth glass.
pub(super) fn features_through(
    world: &World,
    first: &PathVertex,
    mut ray: PathRay,
    (mut kept, mut travelled): (Vec3, f32),
    sampler: &Sampler,
    rays: &mut u64,
) -> Option<SampleFeatures> {
    let mut features = SampleFeatures { is_whole: true, ..SampleFeatures::default() };
    let (mut share, mut behind) = (1.0, None);
    for pass in 1..=MAX_PASSES {
        let at = behind.as_ref().unwrap_or(first);
        let stopped = at.opacity.min(1.0);
        if stopped > 0.0 {
            if !at.shows_no_emitter() {
                return None;
            }
            let albedo = kept * at.bsdf.albedo(at.wo);
            at.show_share(world, &mut features, (albedo, travelled), share * stopped);
            share *= 1.0 - stopped;
        }
        if share < LEAST_SHARE {
            break;
        }
        ray = at.past(&ray);
        let Some(point) = world.intersect_seen(ray.origin, ray.direction, rays) else { break };
        let at = PathVertex::new(world, point, &ray, || sampler.pair(Dimension::Choice, KIND_DIMENSION + pass).x);
        kept *= at.kept;
        travelled += at.point.position.distance(ray.origin);
        behind = Some(at);
    }
    Some(features)
}
