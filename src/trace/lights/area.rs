//! Emitting surfaces: a rectangle cut into texels, or any set of triangles.

use glam::{Vec2, Vec3};

use super::super::photon_targets::Targets;
use super::super::segment::{CUT_OUT, End, OFF_LIGHT};
use super::{Emitted, EmitterHit, LightSample, SeenLight};
use crate::error::{Error, Result};
use crate::scene::{AreaEmitter, AreaLayout, Paint, Scene, TextureId};

/// A diffusely emitting surface.
#[derive(Debug)]
pub(super) struct AreaLight {
    layout: AreaLayout,
    two_sided: bool,
    pattern: Option<Paint>,
    /// Texture coordinates of the rectangle's corner with texel (0, 0), and the difference to the opposite corner.
    uvs: [Vec2; 2],
    /// The same of the cut-out map; one point if the surface has no coordinates.
    hole_uvs: [Vec2; 2],
    cutout: Option<TextureId>,
    triangles: Vec<u32>,
    /// The triangles of a light that is sampled by triangles.
    shapes: Vec<SampledTriangle>,
    /// Cumulative share of the area up to each triangle, ending at 1.
    cumulative: Vec<f32>,
    area: f32,
    /// Largest distance that a rectangle's points lie below its triangles on the sides that emit. An exported rectangle
    /// is one only to some digits.
    lift: f32,
}

/// A triangle in the form that sampling reads, in one place instead of the mesh's arrays.
#[derive(Clone, Copy, Debug)]
struct SampledTriangle {
    corner: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
    uvs: [Vec2; 3],
    cutout: Option<TextureId>,
    lift: f32,
}

/// A point on a light.
struct LightPoint {
    position: Vec3,
    /// Normal of the front.
    normal: Vec3,
    /// Largest distance that it may lie below the surface.
    lift: f32,
    uv: Vec2,
    /// The cut-out map, and texture coordinates in it.
    cutout: Option<(TextureId, Vec2)>,
    column: u32,
}

impl LightPoint {
    /// The point offset from the surface to the side of `away`, for a ray whose other end has coordinates up to
    /// `other`.
    #[inline(always)]
    fn off_surface(&self, away: Vec3, other: Vec3) -> Vec3 {
        let rounded = OFF_LIGHT * self.normal.abs().dot(self.position.abs() + other);
        self.position + self.normal * (self.lift + rounded).copysign(self.normal.dot(away))
    }
}

/// Largest rounding error of points of a triangle or parallelogram, along its normal.
fn rounded(normal: Vec3, corners: [Vec3; 3]) -> f32 {
    let [a, b, c] = corners.map(Vec3::abs);
    OFF_LIGHT * normal.abs().dot(a.max(b).max(c))
}

impl SampledTriangle {
    fn of(scene: &Scene, triangle: u32) -> Self {
        let triangle = &scene.mesh.triangles[triangle as usize];
        let [a, b, c] = scene.mesh.corners(triangle);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let uvs = scene.mesh.vertices_of(triangle).map(|vertex| vertex.uv);
        let cutout = scene.materials[triangle.material.0 as usize].cutout;
        Self { corner: a, edges: [b - a, c - a], normal, uvs, cutout, lift: rounded(normal, [a, b, c]) }
    }
}

impl AreaLight {
    pub(super) fn new(scene: &Scene, emitter: &AreaEmitter, name: &str) -> Result<Self> {
        let refuse = |problem: &str, hint: &str| Err(Error::input(format!("light '{name}'"), problem, hint));
        let triangle_area = |&t: &u32| {
            let [a, b, c] = scene.mesh.corners(&scene.mesh.triangles[t as usize]);
            f64::from((b - a).cross(c - a).length() * 0.5)
        };
        if emitter.triangles.iter().any(|&t| t as usize >= scene.mesh.triangles.len()) {
            return refuse("names a triangle that is not there", "");
        }
        let areas: Vec<f64> = emitter.triangles.iter().map(triangle_area).collect();
        let total: f64 = areas.iter().sum();
        let area = match emitter.layout {
            AreaLayout::Whole => total as f32,
            AreaLayout::Texels { edge_u, edge_v, .. } => edge_u.cross(edge_v).length(),
        };
        if !(area > 0.0 && area.is_finite() && total > 0.0 && total.is_finite()) {
            return refuse("has no area", "give it triangles that are not degenerate, or leave it out");
        }
        let mut sum = 0.0;
        let cumulative = areas.iter().map(|a| {
            sum += a;
            (sum / total) as f32
        });
        let shapes: Vec<_> = emitter.triangles.iter().map(|&triangle| SampledTriangle::of(scene, triangle)).collect();
        let corners = || shapes.iter().flat_map(|shape| shape.uvs);
        let low = corners().fold(Vec2::INFINITY, Vec2::min);
        let size = corners().fold(Vec2::NEG_INFINITY, Vec2::max) - low;
        // A rectangle without coordinates gets the unit square.
        let uvs = if size.cmpgt(Vec2::ZERO).all() { [low, size] } else { [Vec2::ZERO, Vec2::ONE] };
        // One map for the whole rectangle; other scenes are refused when they are read.
        let cutout = shapes.first().and_then(|shape| shape.cutout);
        let is_whole = matches!(emitter.layout, AreaLayout::Whole);
        Ok(Self {
            shapes: if is_whole { shapes } else { Vec::new() },
            uvs,
            hole_uvs: [low, size],
            cutout,
            layout: emitter.layout,
            two_sided: emitter.two_sided,
            pattern: emitter.pattern,
            cumulative: cumulative.collect(),
            triangles: emitter.triangles.clone(),
            area,
            lift: lift(scene, emitter),
        })
    }

    pub(super) fn layout(&self) -> AreaLayout {
        self.layout
    }

    pub(super) fn is_two_sided(&self) -> bool {
        self.two_sided
    }

    pub(super) fn triangles(&self) -> &[u32] {
        &self.triangles
    }

    /// Cosine at the light towards a surface; 0 behind a one-sided light.
    #[inline(always)]
    fn cosine(&self, normal: Vec3, away: Vec3) -> f32 {
        let cosine = normal.dot(away);
        if self.two_sided { cosine.abs() } else { cosine.max(0.0) }
    }

    #[inline(always)]
    fn colour(&self, scene: &Scene, uv: Vec2) -> Vec3 {
        self.pattern.map_or(Vec3::ONE, |paint| paint.at(&scene.textures, uv))
    }

    /// Whether the light is cut out there.
    #[inline(always)]
    fn is_hole(scene: &Scene, at: &LightPoint) -> bool {
        at.cutout.is_some_and(|(id, uv)| scene.textures[id.0 as usize].sample(uv)[3] < CUT_OUT)
    }

    /// A point on the light, uniform over its area, so that every texel gets the same number of samples.
    #[inline(always)]
    fn point(&self, pair: Vec2) -> LightPoint {
        match self.layout {
            AreaLayout::Texels { origin, edge_u, edge_v, normal, across, down } => {
                let texel = |x: f32, n: u32| ((x * n as f32) as u32).min(n - 1);
                LightPoint {
                    position: origin + edge_u * pair.x + edge_v * pair.y,
                    normal,
                    lift: self.lift,
                    uv: self.uvs[0] + pair * self.uvs[1],
                    cutout: self.cutout.map(|id| (id, self.hole_uvs[0] + pair * self.hole_uvs[1])),
                    column: texel(pair.y, down) * across + texel(pair.x, across),
                }
            }
            AreaLayout::Whole => {
                let (index, x) = self.choose(pair.x);
                let SampledTriangle { corner, edges, normal, uvs, cutout, lift } = &self.shapes[index];
                let (u, v) = uniform_triangle(Vec2::new(x, pair.y));
                let uv = uvs[0] * (1.0 - u - v) + uvs[1] * u + uvs[2] * v;
                LightPoint {
                    position: *corner + edges[0] * u + edges[1] * v,
                    normal: *normal,
                    lift: *lift,
                    uv,
                    cutout: cutout.map(|id| (id, uv)),
                    column: 0,
                }
            }
        }
    }

    /// A light sample for a surface at `position`.
    #[inline(always)]
    pub(super) fn sample(&self, scene: &Scene, position: Vec3, pair: Vec2) -> Option<LightSample> {
        let at = self.point(pair);
        let offset = at.position - position;
        let distance2 = offset.length_squared();
        let distance = distance2.sqrt();
        let towards = offset / distance;
        let cosine = self.cosine(at.normal, -towards);
        if !(cosine > 0.0 && distance2 > 0.0) || Self::is_hole(scene, &at) {
            return None;
        }
        let pdf = distance2 / (cosine * self.area);
        let end = End::At(at.off_surface(-towards, position.abs()));
        Some(LightSample { towards, end, column: at.column, weight: self.colour(scene, at.uv) / pdf, pdf })
    }

    /// The normal of the side that it emits to, if it is one-sided.
    fn side(&self, normal: Vec3) -> Option<Vec3> {
        (!self.two_sided).then_some(normal)
    }

    /// Emits a photon from a point on it towards the targets.
    pub(super) fn emit(&self, scene: &Scene, targets: &Targets, [place, way]: [Vec2; 2]) -> Option<Emitted> {
        let at = self.point(place);
        if Self::is_hole(scene, &at) {
            return None;
        }
        let LightPoint { position: point, normal, uv, column, .. } = at;
        let (direction, density) = targets.sample_direction(point, self.side(normal), way)?;
        let cosine = self.cosine(normal, direction);
        let density = density / self.area;
        let origin = at.off_surface(direction, point.abs());
        let power = self.colour(scene, uv) * (cosine / density);
        (cosine > 0.0).then_some(Emitted { origin, direction, column, power, density: density / cosine })
    }

    /// Density of photons emitted from `hit` towards the origin of its ray, over area and projected solid angle.
    pub(super) fn emitted_density(&self, targets: &Targets, hit: &EmitterHit) -> f32 {
        let normal = match self.layout {
            AreaLayout::Whole => hit.normal,
            AreaLayout::Texels { normal, .. } => normal,
        };
        let cosine = self.cosine(normal, -hit.direction);
        if cosine <= 0.0 {
            return 0.0;
        }
        targets.direction_density(hit.position, self.side(normal), -hit.direction) / (self.area * cosine)
    }

    /// Emission at a ray's hit on one of its triangles.
    #[inline(always)]
    pub(super) fn found(&self, scene: &Scene, hit: &EmitterHit) -> Option<SeenLight> {
        let (normal, uv, column) = match self.layout {
            AreaLayout::Whole => (hit.normal, hit.uv, 0),
            AreaLayout::Texels { origin, edge_u, edge_v, normal, .. } => {
                let offset = hit.position - origin;
                let along = |edge: Vec3| offset.dot(edge) / edge.length_squared();
                (
                    normal,
                    self.uvs[0] + self.uvs[1] * Vec2::new(along(edge_u), along(edge_v)),
                    self.layout.column_at(hit.position),
                )
            }
        };
        let cosine = self.cosine(normal, -hit.direction);
        (cosine > 0.0).then(|| SeenLight {
            source: 0,
            column,
            radiance: self.colour(scene, uv),
            pdf: hit.distance * hit.distance / (cosine * self.area),
        })
    }

    /// Chooses a triangle by area, and rescales the number to be uniform again.
    #[inline(always)]
    fn choose(&self, x: f32) -> (usize, f32) {
        let index = self.cumulative.partition_point(|&c| c <= x).min(self.cumulative.len() - 1);
        let before = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let share = self.cumulative[index] - before;
        (index, ((x - before) / share.max(f32::MIN_POSITIVE)).clamp(0.0, 0.999_999_9))
    }
}

/// Distance that the triangles of a rectangle of texels stand out from it, plus the rounding of its points; 0 for other
/// lights.
fn lift(scene: &Scene, emitter: &AreaEmitter) -> f32 {
    let AreaLayout::Texels { origin, edge_u, edge_v, normal, .. } = emitter.layout else { return 0.0 };
    let corners = emitter.triangles.iter().flat_map(|&t| scene.mesh.corners(&scene.mesh.triangles[t as usize]));
    let out = corners.map(|corner| (corner - origin).as_dvec3().dot(normal.as_dvec3()) as f32);
    let out = out.fold(0.0f32, |most, out| most.max(if emitter.two_sided { out.abs() } else { out }));
    out + rounded(normal, [origin, origin + edge_u, origin + edge_v])
}

/// Uniform barycentric weights of the second and third corner, keeping strata together (Heitz 2019, *A low-distortion
/// map between triangle and square*).
#[inline(always)]
pub(in crate::trace) fn uniform_triangle(pair: Vec2) -> (f32, f32) {
    let (x, y) = (0.5 * pair.x, 0.5 * pair.y);
    let offset = y - x;
    if offset > 0.0 { (x, y + offset) } else { (x - offset, y) }
}
