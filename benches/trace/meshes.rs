//! Meshes and rays that the benchmarks share.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use ltm::trace::bvh::{Bvh, BvhTriangle, Ray};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A mesh to trace, a place inside it to look from, and where to look.
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) triangles: Vec<BvhTriangle>,
    pub(crate) eye: Vec3,
    pub(crate) target: Vec3,
}

/// Spheres in a closed box with flat, regularly tessellated walls: about `count` triangles, a third of them in walls.
pub(crate) fn spheres_in_walls(count: usize) -> Subject {
    let mut triangles = Vec::new();
    let mut quad = |corners: [Vec3; 4]| {
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            triangles.push(BvhTriangle { corners: [corners[a], corners[b], corners[c]], see_through: false });
        }
    };
    let side = ((count / 3) as f32 / 12.0).sqrt() as i32;
    let (x, y, z) = (Vec3::X * 10.0, Vec3::Y * 10.0, Vec3::Z * 10.0);
    for (origin, u, v) in [(Vec3::ZERO, x, y), (z, x, y), (Vec3::ZERO, y, z), (x, y, z), (Vec3::ZERO, z, x), (y, z, x)]
    {
        for (i, j) in (0..side * side).map(|k| (k % side, k / side)) {
            let at = |a: i32, b: i32| origin + u * ((i + a) as f32 / side as f32) + v * ((j + b) as f32 / side as f32);
            quad([at(0, 0), at(1, 0), at(1, 1), at(0, 1)]);
        }
    }
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let spheres = 60;
    let rings = ((2 * count / 3) as f32 / (spheres * 4) as f32).sqrt() as i32;
    for _ in 0..spheres {
        let centre = Vec3::from_array(std::array::from_fn(|_| random.random_range(1.5..8.5)));
        let radius = random.random_range(0.3..1.0);
        for (i, j) in (0..2 * rings * rings).map(|k| (k / (2 * rings), k % (2 * rings))) {
            let at = |a: i32, b: i32| {
                let (st, ct) = (std::f32::consts::PI * (i + a) as f32 / rings as f32).sin_cos();
                let (sp, cp) = (std::f32::consts::PI * (j + b) as f32 / rings as f32).sin_cos();
                centre + radius * Vec3::new(st * cp, ct, st * sp)
            };
            quad([at(0, 0), at(0, 1), at(1, 1), at(1, 0)]);
        }
    }
    let name = format!("spheres in walls, {}", triangles.len());
    Subject { name, triangles, eye: Vec3::new(0.5, 6.0, 0.5), target: Vec3::new(6.0, 4.0, 7.0) }
}

/// An OBJ file as bare triangles.
pub(crate) fn object(path: &Path, eye: Vec3, target: Vec3) -> Option<Subject> {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let (models, _) = tobj::load_obj(path, &options).ok()?;
    let mut triangles = Vec::new();
    for model in models {
        let at = |i: u32| Vec3::from_slice(&model.mesh.positions[3 * i as usize..][..3]);
        let faces = model.mesh.indices.chunks_exact(3);
        triangles.extend(faces.map(|f| BvhTriangle { corners: [at(f[0]), at(f[1]), at(f[2])], see_through: false }));
    }
    let name = format!("{}, {}", path.file_stem()?.display(), triangles.len());
    Some(Subject { name, triangles, eye, target })
}

/// Three sets of rays over the same mesh: coherent from a camera, incoherent diffuse bounces from where those end, and
/// shadow segments from there to a square of light in the upper middle of the box.
pub(crate) struct RaySets {
    pub(crate) primary: Vec<Ray>,
    pub(crate) bounce: Vec<Ray>,
    pub(crate) shadow: Vec<Ray>,
}

impl RaySets {
    pub(crate) fn new(subject: &Subject, bvh: &Bvh, side: u32) -> Self {
        let forward = (subject.target - subject.eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let up = right.cross(forward);
        let bounds = subject
            .triangles
            .iter()
            .flat_map(|t| t.corners)
            .fold((Vec3::MAX, Vec3::MIN), |b, c| (b.0.min(c), b.1.max(c)));
        let (size, middle) = (bounds.1 - bounds.0, 0.5 * (bounds.0 + bounds.1));
        let mut random = Pcg64Mcg::seed_from_u64(2);
        let mut sets = Self { primary: Vec::new(), bounce: Vec::new(), shadow: Vec::new() };
        for (x, y) in (0..side * side).map(|k| (k % side, k / side)) {
            let at = (Vec2::new(x as f32, y as f32) + Vec2::new(random.random(), random.random())) / side as f32;
            let direction = (forward + right * (at.x * 1.6 - 0.8) + up * (0.8 - at.y * 1.6)).normalize();
            sets.primary.push(Ray { origin: subject.eye, direction, t_max: f32::INFINITY });
            let Some(hit) = bvh.closest(sets.primary.last().unwrap()) else { continue };
            let [a, b, c] = subject.triangles[hit.triangle as usize].corners;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
            let origin = subject.eye + direction * hit.t + normal * (1e-4 * size.max_element());
            let z: f32 = random.random_range(-1.0..1.0);
            let (sin, cos) = random.random_range(0.0..std::f32::consts::TAU).sin_cos();
            let ring = (1.0 - z * z).sqrt();
            let direction = (normal + Vec3::new(ring * cos, z, ring * sin)).normalize_or(normal);
            sets.bounce.push(Ray { origin, direction, t_max: f32::INFINITY });
            let lamp = Vec3::new(random.random_range(-0.1..0.1), 0.42, random.random_range(-0.1..0.1));
            sets.shadow.push(Ray { origin, direction: middle + size * lamp - origin, t_max: 0.999 });
        }
        sets
    }
}

/// Writes a mesh and its rays as raw little-endian f32 for other programs: `triangles` (9 a triangle), and 7 a ray. Returns the
/// folder that has them.
pub(crate) fn dump(folder: &Path, subject: &Subject, sets: &RaySets) -> std::io::Result<PathBuf> {
    let name: String = subject.name.chars().filter(|c| c.is_alphanumeric()).collect();
    let folder = folder.join(name);
    std::fs::create_dir_all(&folder)?;
    let triangles: Vec<f32> = subject.triangles.iter().flat_map(|t| t.corners).flat_map(|c| c.to_array()).collect();
    std::fs::write(folder.join("triangles"), bytemuck::cast_slice::<f32, u8>(&triangles))?;
    for (name, rays) in [("primary", &sets.primary), ("bounce", &sets.bounce), ("shadow", &sets.shadow)] {
        let ray = |r: &Ray| [r.origin.to_array().as_slice(), &r.direction.to_array(), &[r.t_max]].concat();
        let rays: Vec<f32> = rays.iter().flat_map(ray).collect();
        std::fs::write(folder.join(name), bytemuck::cast_slice::<f32, u8>(&rays))?;
    }
    Ok(folder)
}
