//! The scene for rays: surface points, cut-outs, and transmittance between two points.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::bsdf::Bsdf;
use super::bvh::{Bvh, BvhTriangle, Occlusion, Ray};
use super::lights::LightSampler;
use super::relief::Slopes;
use super::segment::{CLEAR, CUT_OUT, End, ROUNDING};
use crate::error::{Error, Result};
use crate::scene::{Material, Relief, Scene, Surface, TextureId};

/// Largest number of cut-outs and thin sheets that a ray passes straight through. It is more than any scene has in a
/// row, and bounds the time of a bad scene.
pub(super) const MAX_PASSES: u32 = 256;

/// Offset of a ray's origin from its surface, for each axis, in units of the normal times the triangle's largest
/// coordinate.
///
/// A point on a triangle is rounded off its plane by at most seven such roundings, and the offset point by one. Its
/// distances to the planes of this and neighbouring triangles, as the BVH computes them, are rounded by six. That makes
/// fourteen, doubled for safety (the method of Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th edition,
/// §6.8). Along an axis on which a triangle lies at 0 nothing is rounded, and nothing is added.
const OFF_SURFACE: f32 = 32.0 * ROUNDING;

/// Distance that points keep from the edges of their triangle, in units of its largest coordinate. It exceeds the
/// rounding of a point, so that none lies beyond an adjacent wall. Points that are nearer are moved.
const OFF_EDGES: f32 = 64.0 * ROUNDING;

/// Largest amount that a corner's barycentric weight is raised for that, on triangles hardly wider than their rounding.
const MAX_RAISED: f32 = 1.0 / 64.0;

/// A scene with its BVH and lights.
#[derive(Debug)]
pub(super) struct World {
    pub(super) scene: Arc<Scene>,
    pub(super) lights: LightSampler,
    /// Whether any body absorbs light.
    pub(super) absorbs: bool,
    bvh: Bvh,
}

/// A point where a ray hits a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub(super) position: Vec3,
    /// Unit normal of the triangle's front.
    pub(super) normal: Vec3,
    /// Unit shading normal, on the front.
    pub(super) shading_normal: Vec3,
    pub(super) uv: Vec2,
    pub(super) triangle: u32,
    offset: f32,
}

impl World {
    /// Builds the BVH and prepares the lights. Errors: indices out of range, lights without area.
    pub(super) fn new(scene: Arc<Scene>) -> Result<Self> {
        let mesh = &scene.mesh;
        let vertices = mesh.vertices.len();
        let refuse = |problem: String| Err(Error::input(&scene.name, problem, "repair the scene"));
        let inside = |t: &crate::scene::Triangle| {
            t.vertices.iter().all(|&v| (v as usize) < vertices) && (t.material.0 as usize) < scene.materials.len()
        };
        if let Some(at) = mesh.triangles.iter().position(|t| !inside(t)) {
            return refuse(format!("triangle {at} names a vertex or material that is not there"));
        }
        if mesh.triangles.len() >= 1 << 31 {
            return refuse(format!("{} triangles are more than 2,147,483,647", mesh.triangles.len()));
        }
        let see_through: Vec<bool> = scene.materials.iter().map(is_see_through).collect();
        let triangles: Vec<BvhTriangle> = mesh
            .triangles
            .iter()
            .map(|t| BvhTriangle { corners: mesh.corners(t), see_through: see_through[t.material.0 as usize] })
            .collect();
        let (bvh, lights) = (Bvh::build(&triangles), LightSampler::new(&scene)?);
        let absorbs = scene.materials.iter().any(|material| material.absorption != Vec3::ZERO);
        Ok(Self { scene, lights, absorbs, bvh })
    }

    /// The BVH.
    pub(super) fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// The first surface that a ray hits; cut-outs are passed through.
    #[inline(always)]
    pub(super) fn intersect(&self, mut origin: Vec3, direction: Vec3, rays: &mut u64) -> Option<SurfacePoint> {
        for _ in 0..MAX_PASSES {
            *rays += 1;
            let hit = self.bvh.closest(&Ray { origin, direction, t_max: f32::INFINITY })?;
            let point = self.surface_point(hit.triangle, hit.u, hit.v);
            if !self.is_cut_out(&point) {
                return Some(point);
            }
            origin = point.start(direction);
        }
        None
    }

    /// As [`intersect`](Self::intersect), of a ray of the camera: lights that it does not see are passed through as well.
    #[inline(always)]
    pub(super) fn intersect_seen(&self, origin: Vec3, direction: Vec3, rays: &mut u64) -> Option<SurfacePoint> {
        let point = self.intersect(origin, direction, rays)?;
        if self.lights.all_are_seen() { Some(point) } else { self.past_unseen(point, direction, rays) }
    }

    #[cold]
    fn past_unseen(&self, mut point: SurfacePoint, direction: Vec3, rays: &mut u64) -> Option<SurfacePoint> {
        for _ in 0..MAX_PASSES {
            let light = self.scene.mesh.triangles[point.triangle as usize].emitter;
            if light.is_none_or(|light| self.lights.is_seen(light)) {
                return Some(point);
            }
            point = self.intersect(point.start(direction), direction, rays)?;
        }
        None
    }

    /// Transmittance from `origin` to `end`: 1 if unoccluded, that of thin sheets, 0 behind anything else.
    #[inline(always)]
    pub(super) fn transmittance(&self, origin: Vec3, end: End, rays: &mut u64) -> Vec3 {
        *rays += 1;
        match self.bvh.occlusion(&end.ray_from(origin)) {
            Occlusion::Clear => Vec3::ONE,
            Occlusion::Opaque => Vec3::ZERO,
            Occlusion::Perhaps => self.walk_transmittance(origin, end, rays),
        }
    }

    #[cold]
    fn walk_transmittance(&self, origin: Vec3, end: End, rays: &mut u64) -> Vec3 {
        let (mut ray, mut kept) = (end.ray_from(origin), Vec3::ONE);
        for _ in 0..MAX_PASSES {
            *rays += 1;
            let Some(hit) = self.bvh.closest(&ray) else { return kept };
            let point = self.surface_point(hit.triangle, hit.u, hit.v);
            if !self.is_cut_out(&point) {
                let cosine = point.shading_normal.dot(ray.direction.normalize_or_zero()).abs();
                let opacity = self.opacity(&point);
                kept *= (1.0 - opacity) + opacity * self.straight_transmittance(&point, cosine);
                if kept == Vec3::ZERO {
                    return kept;
                }
            }
            let next = end.ray_from(point.start(ray.direction));
            if next.direction.dot(ray.direction) <= 0.0 {
                // The last surface was at the end itself.
                return kept;
            }
            ray = next;
        }
        Vec3::ZERO
    }

    /// Index of a point's material in the scene.
    pub(super) fn material_index(&self, point: &SurfacePoint) -> u32 {
        self.scene.mesh.triangles[point.triangle as usize].material.0
    }

    /// Material of a point.
    pub(super) fn material(&self, point: &SurfacePoint) -> &Material {
        &self.scene.materials[self.material_index(point) as usize]
    }

    /// The BSDF at a point seen from its front or back. `chance` gives a uniform number, where a surface is of two kinds.
    #[inline(always)]
    pub(super) fn bsdf(&self, point: &SurfacePoint, front: bool, chance: impl FnOnce() -> f32) -> Bsdf {
        let surface = &self.material(point).surface;
        let chance = match surface {
            Surface::Principled(surface) if surface.is_mixed() => chance(),
            _ => 0.0,
        };
        Bsdf::resolve(surface, &self.scene.textures, point.uv, front, chance)
    }

    /// What passes straight of light that meets a surface.
    fn straight_transmittance(&self, point: &SurfacePoint, cosine: f32) -> Vec3 {
        let share = match &self.material(point).surface {
            Surface::Principled(surface) => surface.glass_at(&self.scene.textures, point.uv),
            _ => 1.0,
        };
        if share > 0.0 { share * self.bsdf(point, true, || 0.0).straight_transmittance(cosine) } else { Vec3::ZERO }
    }

    /// Share of the light that meets the surface.
    #[inline(always)]
    pub(super) fn opacity(&self, point: &SurfacePoint) -> f32 {
        let Material { opacity, opacity_map, .. } = self.material(point);
        let map = |id: TextureId| self.scene.textures[id.0 as usize].sample(point.uv)[3].clamp(0.0, 1.0);
        opacity_map.map_or(*opacity, |id| opacity * map(id))
    }

    /// Whether nothing is there: cut out, or wholly transparent by a map.
    #[inline(always)]
    fn is_cut_out(&self, point: &SurfacePoint) -> bool {
        let Material { cutout, opacity_map, .. } = self.material(point);
        if cutout.is_none() && opacity_map.is_none() {
            return false;
        }
        let alpha = |id: TextureId| self.scene.textures[id.0 as usize].sample(point.uv)[3];
        cutout.is_some_and(|id| alpha(id) < CUT_OUT) || opacity_map.is_some_and(|id| alpha(id) < CLEAR)
    }

    /// Absorption behind the front of a surface.
    #[inline(always)]
    pub(super) fn absorption(&self, point: &SurfacePoint) -> Vec3 {
        if self.absorbs { self.material(point).absorption } else { Vec3::ZERO }
    }

    /// The shading normal on the front, with the relief of the material.
    #[cold]
    pub(super) fn relief(&self, point: &SurfacePoint, relief: Relief) -> Vec3 {
        let [p, q, r] = self.scene.mesh.vertices_of(&self.scene.mesh.triangles[point.triangle as usize]);
        let (edges, steps) = ([q.position - p.position, r.position - p.position], [q.uv - p.uv, r.uv - p.uv]);
        let slopes = Slopes::of(edges, steps);
        let texture = |id: TextureId| &self.scene.textures[id.0 as usize];
        slopes.map_or(point.shading_normal, |slopes| match relief {
            Relief::Normals(id, scale) => slopes.mapped(point.shading_normal, texture(id).normal(point.uv), scale),
            Relief::Heights(id, scale) => slopes.raised(point.shading_normal, texture(id).slope(point.uv) * scale),
        })
    }

    #[inline(always)]
    fn surface_point(&self, index: u32, u: f32, v: f32) -> SurfacePoint {
        let mesh = &self.scene.mesh;
        let triangle = &mesh.triangles[index as usize];
        let [p, q, r] = mesh.vertices_of(triangle);
        let [a, b, c] = [p.position, q.position, r.position];
        let (edge1, edge2) = (b - a, c - a);
        let across = edge1.cross(edge2);
        let double_area = across.length();
        let largest = a.abs().max(b.abs()).max(c.abs());
        let longest = edge1.length_squared().max(edge2.length_squared()).max((c - b).length_squared());
        let least = (OFF_EDGES * largest.max_element()) * longest.sqrt() / double_area;
        let (mut u, mut v) = (u, v);
        if u.min(v).min(1.0 - u - v) < least {
            (u, v) = off_edges(u, v, least);
        }
        let w = 1.0 - u - v;
        let position = a + edge1 * u + edge2 * v;
        let normal = if double_area > 0.0 { across / double_area } else { Vec3::Z };
        let shading = p.normal * w + q.normal * u + r.normal * v;
        SurfacePoint {
            position,
            normal,
            shading_normal: shading.try_normalize().unwrap_or(normal),
            uv: p.uv * w + q.uv * u + r.uv * v,
            triangle: index,
            offset: OFF_SURFACE * normal.abs().dot(largest),
        }
    }
}

/// Barycentric weights of the second and third corner, raised so that no weight of the three is much below `least`.
#[cold]
fn off_edges(u: f32, v: f32, least: f32) -> (f32, f32) {
    let raised = |weight: f32| weight.max(least.min(MAX_RAISED));
    let (u, v, w) = (raised(u), raised(v), raised(1.0 - u - v));
    let sum = u + v + w;
    (u / sum, v / sum)
}

impl SurfacePoint {
    /// The place of a sensor, which is on no triangle.
    pub(super) fn of_sensor(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, shading_normal: normal, uv: Vec2::ZERO, triangle: u32::MAX, offset: 0.0 }
    }

    /// Origin of a ray that leaves along `direction`: offset from the surface to that side.
    #[inline(always)]
    pub(super) fn start(&self, direction: Vec3) -> Vec3 {
        self.position + self.normal * self.offset.copysign(self.normal.dot(direction))
    }
}

fn is_see_through(material: &Material) -> bool {
    let passes = match &material.surface {
        Surface::ThinDielectric { .. } => true,
        Surface::Principled(surface) => surface.is_thin && !surface.transmission.is(0.0),
        _ => false,
    };
    passes || material.cutout.is_some() || material.opacity_map.is_some() || material.opacity < 1.0
}
