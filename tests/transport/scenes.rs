//! Small scenes put together by hand.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use ltm::light::{Light, LightBasis, LightKind, LightUnit};
use ltm::matrix::{MatrixShape, TracedBlock};
use ltm::scene::{
    AreaEmitter, AreaLayout, Camera, Emitter, Material, MaterialId, Mesh, Paint, PixelFilter, Scene, Surface, Triangle,
    Vertex,
};
use ltm::trace::{BlockStats, TraceSettings, Tracer};
use rayon::prelude::*;

/// A scene of quads, built piece by piece.
pub(crate) struct Builder {
    scene: Scene,
}

/// A camera of `side × side` pixels.
pub(crate) fn camera(eye: Vec3, target: Vec3, fov_degrees: f32, side: u32) -> Camera {
    let direction = target - eye;
    let up = if direction.normalize().y.abs() > 0.9 { Vec3::Z } else { Vec3::Y };
    Camera::looking(eye, direction, up, fov_degrees.to_radians(), (side, side), PixelFilter::Box).unwrap()
}

/// A white or grey diffuse surface.
pub(crate) fn lambert(reflectance: f32) -> Surface {
    Surface::Lambert { reflectance: Paint::Constant(Vec3::splat(reflectance)) }
}

impl Builder {
    pub(crate) fn new(camera: Camera) -> Self {
        let scene = Scene {
            name: "test".into(),
            origin: DVec3::ZERO,
            mesh: Mesh::default(),
            materials: Vec::new(),
            textures: Vec::new(),
            camera,
            emitters: Vec::new(),
            unseen_lights: Vec::new(),
            sensors: None,
            shows_irradiance: false,
            basis: LightBasis::new(),
            metres_per_unit: 1.0,
        };
        Self { scene }
    }

    pub(crate) fn triangle(&mut self, corners: [Vec3; 3], uvs: [Vec2; 3], normals: [Vec3; 3], surface: Surface) -> u32 {
        let material = self.material(surface);
        let mesh = &mut self.scene.mesh;
        let first = mesh.vertices.len() as u32;
        let vertex = |at: usize| Vertex { position: corners[at], normal: normals[at], uv: uvs[at] };
        mesh.vertices.extend([0, 1, 2].map(vertex));
        mesh.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material, emitter: None });
        mesh.triangles.len() as u32 - 1
    }

    fn material(&mut self, surface: Surface) -> MaterialId {
        let materials = &mut self.scene.materials;
        let found = materials.iter().position(|m| m.surface == surface);
        let id = found.unwrap_or_else(|| {
            materials.push(Material::new(format!("m{}", materials.len()), surface));
            materials.len() - 1
        });
        MaterialId(id as u32)
    }

    /// A parallelogram; its front is the side of `edge_u × edge_v`. Returns its two triangles.
    pub(crate) fn quad(&mut self, origin: Vec3, edge_u: Vec3, edge_v: Vec3, surface: Surface) -> [u32; 2] {
        let corners = [origin, origin + edge_u, origin + edge_u + edge_v, origin + edge_v];
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let none = [Vec3::ZERO; 3];
        [[0, 1, 2], [0, 2, 3]].map(|i| self.triangle(i.map(|k| corners[k]), i.map(|k| uvs[k]), none, surface))
    }

    /// A box seen from inside, between two corners. Returns its twelve triangles.
    pub(crate) fn room(&mut self, min: Vec3, max: Vec3, surface: Surface) -> Vec<u32> {
        let d = max - min;
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        let sides = [(min, z, x), (min, x, y), (min, y, z), (max, -x, -z), (max, -y, -x), (max, -z, -y)];
        sides.into_iter().flat_map(|(o, u, v)| self.quad(o, u, v, surface)).collect()
    }

    /// A sphere of triangles with smooth normals, front outside.
    pub(crate) fn sphere(&mut self, centre: Vec3, radius: f32, rings: u32, surface: Surface) -> Vec<u32> {
        let at = |i: u32, j: u32| {
            let (st, ct) = (std::f32::consts::PI * i as f32 / rings as f32).sin_cos();
            let (sp, cp) = (std::f32::consts::PI * j as f32 / rings as f32).sin_cos();
            Vec3::new(st * cp, ct, st * sp)
        };
        let mut triangles = Vec::new();
        for i in 0..rings {
            for j in 0..2 * rings {
                let n = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
                for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                    let normals = [n[a], n[b], n[c]];
                    let corners = normals.map(|n| centre + radius * n);
                    if (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() > 1e-9 * radius * radius {
                        triangles.push(self.triangle(corners, [Vec2::ZERO; 3], normals, surface));
                    }
                }
            }
        }
        triangles
    }

    fn light(&mut self, name: &str, kind: LightKind, emitter: Emitter) -> u32 {
        let (across, down) = kind.layout();
        let columns = (across * down) as usize;
        let light = Light {
            name: name.into(),
            kind,
            unit: LightUnit::Radiance,
            emission: [1.0; 3],
            first_column: 0,
            places: vec![[0.0; 3]; columns],
            extents: vec![0.0; columns],
        };
        self.scene.basis.push(light).unwrap();
        self.scene.emitters.push(emitter);
        self.scene.emitters.len() as u32 - 1
    }

    /// Makes triangles one lamp.
    pub(crate) fn lamp(&mut self, name: &str, triangles: &[u32]) {
        let emitter =
            AreaEmitter { triangles: triangles.to_vec(), layout: AreaLayout::Whole, two_sided: false, pattern: None };
        let index = self.light(name, LightKind::Lamp, Emitter::Area(emitter));
        triangles.iter().for_each(|&t| self.scene.mesh.triangles[t as usize].emitter = Some(index));
    }

    /// As [`lamp`](Self::lamp), shining from both sides of its triangles.
    pub(crate) fn two_sided_lamp(&mut self, name: &str, triangles: &[u32]) {
        self.lamp(name, triangles);
        let Some(Emitter::Area(emitter)) = self.scene.emitters.last_mut() else { unreachable!("a lamp was added") };
        emitter.two_sided = true;
    }

    /// A black quad that is a light of `across × down` texels.
    pub(crate) fn panel(&mut self, name: &str, origin: Vec3, edge_u: Vec3, edge_v: Vec3, (across, down): (u32, u32)) {
        let triangles = self.quad(origin, edge_u, edge_v, Surface::Black).to_vec();
        let normal = edge_u.cross(edge_v).normalize();
        let layout = AreaLayout::Texels { origin, edge_u, edge_v, normal, across, down };
        let emitter = AreaEmitter { triangles: triangles.clone(), layout, two_sided: false, pattern: None };
        let index = self.light(name, LightKind::AreaTexels { across, down }, Emitter::Area(emitter));
        triangles.iter().for_each(|&t| self.scene.mesh.triangles[t as usize].emitter = Some(index));
    }

    /// A light that is no geometry.
    pub(crate) fn bodiless(&mut self, name: &str, kind: LightKind, emitter: Emitter) {
        self.light(name, kind, emitter);
    }

    /// Hides the last light from the camera.
    pub(crate) fn unseen(&mut self) {
        self.scene.unseen_lights.push(self.scene.emitters.len() as u32 - 1);
    }

    pub(crate) fn build(self) -> Scene {
        self.scene
    }
}

/// Settings with a seed of their own.
pub(crate) fn settings(samples_per_pixel: u32, max_depth: u32) -> TraceSettings {
    TraceSettings { samples_per_pixel, seed: 1, max_depth }
}

/// A tracer over blocks of eight pixels, of 32 for larger images.
pub(crate) fn tracer(scene: impl Into<Arc<Scene>>, settings: TraceSettings) -> Tracer {
    let scene = scene.into();
    let (width, height) = (scene.camera.width, scene.camera.height);
    let side = if width > 64 { 32 } else { 8 };
    let shape = MatrixShape::new(width, height, scene.basis.column_count() as u32, side).unwrap();
    Tracer::new(scene, shape, settings).unwrap()
}

/// All blocks of renders with these seeds, one after the other, over a tree that is built once. The tracer's own settings do not
/// matter: with one sample it has sent few photons in vain.
pub(crate) fn renders(
    tracer: Tracer,
    settings: TraceSettings,
    seeds: Range<u64>,
) -> impl Iterator<Item = Vec<TracedBlock>> {
    let mut before = Some(tracer);
    seeds.map(move |seed| {
        let tracer = before.take().expect("put back below").with_settings(TraceSettings { seed, ..settings }).unwrap();
        let blocks = blocks(&tracer);
        before = Some(tracer);
        blocks
    })
}

/// All blocks of a tracer.
pub(crate) fn blocks(tracer: &Tracer) -> Vec<TracedBlock> {
    let traced = |id| {
        let mut block = TracedBlock::default();
        tracer.trace_block(id, &mut block);
        block
    };
    let ids: Vec<_> = ltm::matrix::BlockSource::shape(tracer).blocks().collect();
    ids.into_par_iter().map(traced).collect()
}

/// All blocks of a scene.
pub(crate) fn trace(scene: impl Into<Arc<Scene>>, settings: TraceSettings) -> Vec<(TracedBlock, BlockStats)> {
    let tracer = tracer(scene, settings);
    let shape = ltm::matrix::BlockSource::shape(&tracer);
    let traced = |id| {
        let mut block = TracedBlock::default();
        let stats = tracer.trace_block(id, &mut block);
        (block, stats)
    };
    shape.blocks().collect::<Vec<_>>().into_par_iter().map(traced).collect()
}

/// Sum over columns for every row of every block.
pub(crate) fn all_on(blocks: &[(TracedBlock, BlockStats)]) -> Vec<f32> {
    let mut sums = Vec::new();
    for (traced, _) in blocks {
        let view = traced.block.view();
        let first = sums.len();
        sums.resize(first + view.rows(), 0.0);
        for column in 0..view.columns() {
            (0..view.rows()).for_each(|row| sums[first + row] += view.at(row, column));
        }
    }
    sums
}

/// Mean of all values.
pub(crate) fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}
