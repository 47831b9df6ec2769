//! The picture that a scene shows before any light is traced: what lies at each pixel, as a lamp at the camera would light it.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Tracer;
use super::sampler::{Dimension, KIND_DIMENSION, Sampler};
use super::vertex::{PathRay, PathVertex};
use super::world::{MAX_PASSES, World};
use crate::scene::Camera;

/// Radiance where a ray leaves the scene.
const BACKGROUND: Vec3 = Vec3::splat(0.02);
/// Least albedo that is shown: also a black surface has a shape.
const LEAST_ALBEDO: f32 = 0.04;
/// Albedo by which mirrors and glass are shown, which have none of their own.
const SPECULAR_ALBEDO: f32 = 0.5;
/// What is seen of a surface that the view grazes.
const GRAZED: f32 = 0.25;

impl Tracer {
    /// The image of the scene from any camera under a light at the camera that does not fade with distance: for each pixel, row by row, the
    /// albedo of the first surface times the cosine to the viewer, raised so that grazed surfaces are seen; linear RGB from 0 to 1. One
    /// ray a pixel, without lens and shadows, on all threads. `None` if `stop` returns true.
    pub fn outline(&self, camera: &Camera, stop: impl Fn() -> bool + Sync) -> Option<Vec<[f32; 3]>> {
        let world = self.world();
        let row = |y: u32| {
            let pixel = |x: u32| {
                let (origin, direction) = camera.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                let key = u64::from(y) * u64::from(camera.width) + u64::from(x);
                shown(world, PathRay::new(origin, direction).of_camera(), &Sampler::new(0, key, 0)).to_array()
            };
            (!stop()).then(|| (0..camera.width).map(pixel).collect::<Vec<_>>())
        };
        let rows: Option<Vec<_>> = (0..camera.height).into_par_iter().with_min_len(4).map(row).collect();
        rows.map(|rows| rows.concat())
    }

    /// Distance from the camera along the ray through an image position in pixels to the first surface. `None` where there is none.
    pub fn distance(&self, camera: &Camera, position: Vec2) -> Option<f32> {
        let (origin, direction) = camera.ray(position);
        let point = self.world().intersect_seen(origin, direction, &mut 0)?;
        Some(point.position.distance(origin))
    }
}

fn shown(world: &World, mut ray: PathRay, sampler: &Sampler) -> Vec3 {
    for pass in 0..MAX_PASSES {
        let Some(point) = world.intersect_seen(ray.origin, ray.direction, &mut 0) else { return BACKGROUND };
        let at = PathVertex::new(world, point, &ray, || sampler.pair(Dimension::Choice, KIND_DIMENSION + pass).x);
        let meets = at.opacity >= 1.0 || sampler.pair(Dimension::Choice, pass).x < at.opacity;
        if meets && !at.may_be_passed() {
            let albedo = if at.shows_no_emitter() { at.bsdf.albedo(at.wo) } else { Vec3::splat(SPECULAR_ALBEDO) };
            let cosine = at.frame.z.dot(ray.direction).abs();
            return albedo.clamp(Vec3::splat(LEAST_ALBEDO), Vec3::ONE) * (GRAZED + (1.0 - GRAZED) * cosine);
        }
        ray = at.past(&ray);
    }
    BACKGROUND
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::MatrixShape;
    use crate::scene::{BuiltIn, Paint, Surface};
    use crate::trace::TraceSettings;

    /// A wall that faces the camera shows its albedo, whatever the lamps do.
    #[test]
    fn an_outline_shows_the_albedo_of_what_is_seen() {
        let loaded = BuiltIn { width: 40, height: 30, texels: 2 }.named("diffuse").unwrap();
        let (camera, columns) = (loaded.scene.camera, loaded.scene.basis.column_count() as u32);
        let shape = MatrixShape::new(40, 30, columns, 32).unwrap();
        let albedos: Vec<Vec3> = loaded
            .scene
            .materials
            .iter()
            .filter_map(|material| match &material.surface {
                Surface::Lambert { reflectance: Paint::Constant(albedo) } => Some(*albedo),
                _ => None,
            })
            .collect();
        let settings = TraceSettings { samples_per_pixel: 1, seed: 0, max_depth: 4 };
        let tracer = Tracer::new(loaded.scene, shape, settings).unwrap();
        let pixels = tracer.outline(&camera, || false).unwrap();
        assert_eq!(pixels.len(), 1200);
        let is_shown = |pixel: &[f32; 3]| {
            let pixel = Vec3::from(*pixel);
            albedos.iter().any(|albedo| {
                let shade = pixel.dot(*albedo) / albedo.dot(*albedo);
                (GRAZED..=1.001).contains(&shade) && (pixel - shade * *albedo).length() < 1e-3
            })
        };
        let known = pixels.iter().filter(|pixel| is_shown(pixel)).count();
        assert!(known > 1000, "{known} of 1200 pixels show the albedo of a material");
        let middle = Vec2::new(20.0, 15.0);
        let (eye, direction) = camera.ray(middle);
        let distance = tracer.distance(&camera, middle).unwrap();
        let (low, high) = tracer.scene().mesh.bounds();
        let hit = eye + distance * direction;
        assert!(hit.cmpge(low - 1e-3).all() && hit.cmple(high + 1e-3).all(), "{hit} in {low} to {high}");
        assert!(tracer.outline(&camera, || true).is_none());
    }
}
