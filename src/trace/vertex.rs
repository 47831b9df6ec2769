//! Vertices of paths: surfaces as a ray meets them.

use glam::Vec3;

use super::bsdf::{Bsdf, Lambert, Lobes, Scattered};
use super::frame::ShadingFrame;
use super::lights::Receiver;
use super::planes::SampleFeatures;
use super::world::{SurfacePoint, World};
use crate::scene::Sensor;

/// Sine of the elevation that a direction below the surface is raised to.
const GRAZING: f32 = 1e-3;

/// A vertex of a path, seen from the vertex before.
pub(super) struct PathVertex {
    pub(super) point: SurfacePoint,
    pub(super) bsdf: Bsdf,
    /// Geometric normal on the viewer's side.
    pub(super) normal: Vec3,
    pub(super) frame: ShadingFrame,
    /// Direction to the viewer in the frame.
    pub(super) wo: Vec3,
    /// Probability that a ray hits the surface; otherwise it passes straight through.
    pub(super) opacity: f32,
    /// What is kept of light on the segment to the viewer.
    pub(super) kept: Vec3,
}

/// A ray of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathRay {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
    /// Absorption of the body that it leaves into, per unit length.
    pub(super) absorption: Vec3,
    /// Whether it left the camera, and passed what it met since straight. Unseen lights are not there for it.
    pub(super) is_cameras: bool,
}

impl PathRay {
    pub(super) fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, absorption: Vec3::ZERO, is_cameras: false }
    }

    /// The ray as one that leaves the camera.
    pub(super) fn of_camera(self) -> Self {
        Self { is_cameras: true, ..self }
    }
}

impl PathVertex {
    #[inline(always)]
    pub(super) fn new(world: &World, mut point: SurfacePoint, ray: &PathRay, chance: impl FnOnce() -> f32) -> Self {
        let direction = ray.direction;
        let front = point.normal.dot(direction) < 0.0;
        let bsdf = world.bsdf(&point, front, chance);
        if let Some(relief) = world.material(&point).relief {
            point.shading_normal = seen(world.relief(&point, relief), if front { -direction } else { direction });
        }
        let (normal, frame) = facing(&point, direction, front, bsdf.lobes().has_direction());
        let opacity = world.opacity(&point);
        let mut kept = Vec3::ONE;
        if world.absorbs {
            // A ray that ends on the back of a body has come through it, wherever it began.
            let behind = if front { Vec3::ZERO } else { world.absorption(&point) };
            kept = (-ray.absorption.max(behind) * point.position.distance(ray.origin)).exp();
        }
        Self { point, bsdf, normal, frame, wo: frame.to_local(-direction), opacity, kept }
    }

    /// A sensor: a white surface of its place and normal, seen from before it.
    pub(super) fn of_sensor(sensor: &Sensor) -> Self {
        Self {
            point: SurfacePoint::of_sensor(sensor.position, sensor.normal),
            bsdf: Bsdf::Lambert(Lambert { reflectance: Vec3::ONE }),
            normal: sensor.normal,
            frame: ShadingFrame::around(sensor.normal),
            wo: Vec3::Z,
            opacity: 1.0,
            kept: Vec3::ONE,
        }
    }

    /// Makes the surface a white one, which sends 1/π of what it receives. Returns the factor from its radiance to its irradiance.
    pub(super) fn whiten(&mut self) -> f32 {
        self.bsdf = Bsdf::Lambert(Lambert { reflectance: Vec3::ONE });
        std::f32::consts::PI
    }

    /// Whether a path may pass straight through, as through a thin sheet, and is not scattered otherwise.
    #[inline(always)]
    pub(super) fn may_be_passed(&self) -> bool {
        let lobes = self.bsdf.lobes();
        lobes.has(Lobes::STRAIGHT) && !lobes.is_non_specular()
    }

    /// Whether the surface has no delta lobe, so that no ray from it shows an emitter unfiltered.
    #[inline(always)]
    pub(super) fn shows_no_emitter(&self) -> bool {
        self.bsdf.lobes().is_non_specular() || matches!(self.bsdf, Bsdf::Black)
    }

    /// The features of a sample at its first non-specular vertex.
    #[inline(always)]
    pub(super) fn show(&self, world: &World, features: &mut SampleFeatures, throughput: Vec3, depth: f32) {
        features.albedo = throughput * self.bsdf.albedo(self.wo);
        if !features.is_whole {
            self.show_share(world, features, (features.albedo, depth), 1.0);
        }
    }

    /// Adds a share of a surface with this albedo at this depth.
    #[inline(always)]
    pub(super) fn show_share(
        &self,
        world: &World,
        features: &mut SampleFeatures,
        (albedo, depth): (Vec3, f32),
        share: f32,
    ) {
        features.pixel_albedo += share * albedo;
        features.normal += share * self.frame.z;
        features.depth += share * depth;
        features.surface += share;
        if share > features.largest {
            (features.largest, features.material) = (share, world.material_index(&self.point) + 1);
        }
    }

    /// The ray that leaves along a direction.
    #[inline(always)]
    pub(super) fn ray(&self, world: &World, direction: Vec3) -> PathRay {
        let is_inside = world.absorbs && direction.dot(self.point.normal) < 0.0;
        let absorption = if is_inside { world.absorption(&self.point) } else { Vec3::ZERO };
        PathRay { absorption, ..PathRay::new(self.point.start(direction), direction) }
    }

    /// The ray that passes straight through, as if the surface were absent.
    #[inline(always)]
    pub(super) fn past(&self, ray: &PathRay) -> PathRay {
        PathRay { origin: self.point.start(ray.direction), ..*ray }
    }

    /// As a receiver of light.
    #[inline(always)]
    pub(super) fn receiver(&self) -> Receiver {
        let two_sided = self.bsdf.lobes().is_two_sided();
        Receiver { position: self.point.position, normal: self.frame.z, two_sided }
    }

    /// The world direction of a scattered direction. `None` if it is above the shading normal's plane but not above the
    /// surface.
    #[inline(always)]
    pub(super) fn leaving(&self, next: &Scattered) -> Option<Vec3> {
        let direction = self.frame.to_world(next.wi).normalize();
        if (direction.dot(self.normal) > 0.0) == (next.wi.z > 0.0) {
            return Some(direction);
        }
        next.singular.then(|| lifted(direction, self.normal * next.wi.z.signum()))
    }
}

/// The geometric normal on the viewer's side, and the shading frame there.
///
/// At the border of a coarse mesh an interpolated normal may turn away from the viewer, or mirror the view into the
/// surface. Surfaces with a lobe about the mirror direction then get the nearest normal that mirrors it just above the
/// surface (Keller et al. 2017, *The Iray light transport simulation and rendering system*, §A.3), so that no
/// reflection is lost. Other surfaces get the geometric normal if theirs turns away.
#[inline(always)]
fn facing(point: &SurfacePoint, direction: Vec3, front: bool, has_direction: bool) -> (Vec3, ShadingFrame) {
    let side = if front { 1.0 } else { -1.0 };
    let (normal, shading) = (point.normal * side, point.shading_normal * side);
    if !has_direction {
        return (normal, ShadingFrame::around(if shading.dot(direction) < -1e-4 { shading } else { normal }));
    }
    let mirrored = direction - 2.0 * shading.dot(direction) * shading;
    if mirrored.dot(normal) >= GRAZING && shading.dot(direction) < 0.0 {
        return (normal, ShadingFrame::around(shading));
    }
    (normal, ShadingFrame::around((lifted(mirrored, normal) - direction).try_normalize().unwrap_or(normal)))
}

/// A normal of a relief that the viewer sees: one that turns away is turned just far enough.
#[inline(always)]
fn seen(normal: Vec3, viewer: Vec3) -> Vec3 {
    let cosine = normal.dot(viewer);
    if cosine >= GRAZING { normal } else { (normal + (GRAZING - cosine) * viewer).try_normalize().unwrap_or(viewer) }
}

/// The direction nearest to one below the surface that is just above it.
#[inline(always)]
fn lifted(direction: Vec3, normal: Vec3) -> Vec3 {
    (direction + (GRAZING - direction.dot(normal)) * normal).try_normalize().unwrap_or(normal)
}

/// Power heuristic: weight of the technique with expected density `a` beside one with `b`, each a count times a
/// density.
#[inline(always)]
pub(super) fn power_heuristic(a: f32, b: f32) -> f32 {
    // As a ratio, so that large densities do not overflow.
    let ratio = b / a;
    if a > 0.0 { 1.0 / (1.0 + ratio * ratio) } else { 0.0 }
}
