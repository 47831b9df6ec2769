//! Camera rays that carry no light: they show more of a pixel than its samples do, where a fine texture, leaves or an edge
//! would leave noise in the features.

use glam::{Vec2, Vec3};

use super::camera_ray::camera_ray;
use super::pixel_filter::filter_offset;
use super::planes::SampleFeatures;
use super::sampler::{Dimension, KIND_DIMENSION, LENS_DIMENSION, Sampler};
use super::vertex::PathVertex;
use super::world::{MAX_PASSES, World};

/// What one more camera ray through the pixel at (x, y) shows. `None` where it comes to a mirror or to smooth glass.
pub(super) fn look(world: &World, (x, y): (u32, u32), sampler: &Sampler, rays: &mut u64) -> Option<SampleFeatures> {
    let camera = &world.scene.camera;
    let position = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + filter_offset(camera, sampler.pair(Dimension::Pixel, 0));
    let mut ray = camera_ray(camera, position, || sampler.pair(Dimension::Pixel, LENS_DIMENSION));
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
