//! Camera rays that carry no light: they show more of a pixel than its samples do, where a fine texture, leaves or an edge
//! would leave noise in the features.

use glam::Vec3;

use super::camera_ray::ray_of_pixel;
use super::planes::SampleFeatures;
use super::sampler::{Dimension, KIND_DIMENSION, Sampler};
use super::vertex::PathVertex;
use super::world::{MAX_PASSES, World};

/// The features that one more camera ray through a pixel shows. `None` where it comes to a mirror or to smooth glass.
pub(super) fn features_of_ray(
    world: &World,
    pixel: (u32, u32),
    sampler: &Sampler,
    rays: &mut u64,
) -> Option<SampleFeatures> {
    let mut ray = ray_of_pixel(&world.scene.camera, pixel, sampler);
    let (mut features, mut kept, mut travelled) = (SampleFeatures::default(), Vec3::ONE, 0.0);
    for pass in 0..MAX_PASSES {
        let Some(point) = world.intersect_seen(ray.origin, ray.direction, rays) else { break };
        let at = PathVertex::new(world, point, &ray, || sampler.pair(Dimension::Choice, KIND_DIMENSION + pass).x);
        kept *= at.kept;
        travelled += at.point.position.distance(ray.origin);
        if at.opacity >= 1.0 || sampler.pair(Dimension::Choice, pass).x < at.opacity {
            if !at.shows_no_emitter() {
                return None;
            }
            at.show(world, &mut features, kept, travelled);
            break;
        }
        ray = at.past(&ray);
    }
    Some(features)
}
