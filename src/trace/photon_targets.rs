//! Targets of photons: spheres around mirrors and glass, so that no photon is spent where it cannot make a caustic.

use glam::{Vec2, Vec3};

use super::bsdf::concentric_disc;
use super::cap::{cap_direction, cap_height_of};
use super::frame::ShadingFrame;
use crate::scene::{Mesh, Scene, Surface, bounds};

/// Largest number of spheres. Every photon tests each of them for its density.
const MAX_SPHERES: usize = 32;

/// A group of triangles is split if the cross-sections of its parts' spheres sum to less than this share of its own.
const WORTH_PARTING: f32 = 0.8;

/// Planes tested along each axis to split a group.
const PLANES: usize = 5;

#[derive(Clone, Copy, Debug)]
struct Sphere {
    centre: Vec3,
    radius: f32,
}

/// Spheres that contain all surfaces that reflect or refract specularly.
#[derive(Debug)]
pub(super) struct Targets {
    spheres: Vec<Sphere>,
    /// Sum of the spheres' cross-sections.
    sections: f32,
    /// A sphere around the whole scene.
    scene: Sphere,
}

/// A sphere and the triangles in it.
type Group = (Sphere, Vec<u32>);

/// The targets seen from a point: directions are uniform over each cone, and cones are chosen by solid angle.
struct Cones {
    /// Axis, `1 − cos` of the half angle, and the cumulative sum of the latter.
    cones: [(Vec3, f32, f32); MAX_SPHERES],
    count: usize,
}

impl Targets {
    /// The targets of a scene; `None` if nothing reflects or refracts specularly.
    pub(super) fn of(scene: &Scene) -> Option<Self> {
        let mesh = &scene.mesh;
        let triangles: Vec<u32> = (0..mesh.triangles.len() as u32)
            .filter(|&t| is_delta(&scene.materials[mesh.triangles[t as usize].material.0 as usize].surface))
            .collect();
        let whole = Sphere::around(mesh, &triangles)?;
        let mut groups = vec![(whole, triangles)];
        let mut done = Vec::new();
        while let Some((sphere, triangles)) = groups.pop() {
            match part(mesh, &sphere, &triangles).filter(|_| groups.len() + done.len() + 2 <= MAX_SPHERES) {
                // The larger part goes last, to be split next.
                Some(parts) => groups.extend(parts),
                None => done.push(sphere),
            }
        }
        let sections = done.iter().map(Sphere::section).sum();
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let scene = Sphere::around(mesh, &all)?;
        (scene.radius.is_finite() && sections > 0.0).then_some(Self { spheres: done, sections, scene })
    }

    /// Radius of a sphere around the scene.
    pub(super) fn scene_radius(&self) -> f32 {
        self.scene.radius
    }

    /// The cones seen from `position`; with `normal`, only those that reach above its plane.
    fn cones(&self, position: Vec3, normal: Option<Vec3>) -> Cones {
        let mut seen = Cones { cones: [(Vec3::Z, 0.0, 0.0); MAX_SPHERES], count: 0 };
        let mut sum = 0.0;
        for sphere in &self.spheres {
            let offset = sphere.centre - position;
            if normal.is_some_and(|normal| offset.dot(normal) + sphere.radius <= 0.0) {
                continue;
            }
            let distance = offset.length();
            let sine = sphere.radius / distance;
            let (axis, drop) = match (sine < 1.0, normal) {
                (true, _) => (offset / distance, sine * sine / (1.0 + (1.0 - sine * sine).sqrt())),
                // Inside the sphere every direction may hit it.
                (false, Some(normal)) => (normal, 1.0),
                (false, None) => (Vec3::Z, 2.0),
            };
            sum += drop;
            seen.cones[seen.count] = (axis, drop, sum);
            seen.count += 1;
        }
        seen
    }

    /// A direction to a target from `position`, and its density over solid angle.
    pub(super) fn sample_direction(&self, position: Vec3, normal: Option<Vec3>, pair: Vec2) -> Option<(Vec3, f32)> {
        let cones = self.cones(position, normal);
        let all = &cones.cones[..cones.count];
        let sum = all.last()?.2;
        let wanted = pair.x * sum;
        let index = all.partition_point(|cone| cone.2 <= wanted).min(all.len() - 1);
        let (axis, drop, upper) = all[index];
        let x = ((wanted - (upper - drop)) / drop).clamp(0.0, 0.999_999_9);
        let direction = cap_direction(axis, drop, Vec2::new(x, pair.y));
        Some((direction, cones.density(direction)))
    }

    /// Density over solid angle with which [`Self::sample_direction`] chooses `direction`.
    pub(super) fn direction_density(&self, position: Vec3, normal: Option<Vec3>, direction: Vec3) -> f32 {
        self.cones(position, normal).density(direction)
    }

    /// Origin of a photon from the direction `towards`, and its density over the area across its path.
    pub(super) fn sample_beam(&self, towards: Vec3, pair: Vec2) -> Option<(Vec3, f32)> {
        let wanted = pair.x * self.sections;
        let mut sum = 0.0;
        let mut chosen = self.spheres.last()?;
        let mut x = pair.x;
        for sphere in &self.spheres {
            let section = sphere.section();
            if wanted < sum + section {
                (chosen, x) = (sphere, (wanted - sum) / section);
                break;
            }
            sum += section;
        }
        let disc = chosen.radius * concentric_disc(Vec2::new(x.clamp(0.0, 0.999_999_9), pair.y));
        let middle = chosen.centre + ShadingFrame::around(towards).to_world(Vec3::new(disc.x, disc.y, 0.0));
        let outside = 2.0 * self.scene.radius + middle.distance(self.scene.centre);
        Some((middle + towards * outside, self.beam_density(middle, towards)))
    }

    /// Density with which [`Self::sample_beam`] chooses the line through `position` along `towards`.
    pub(super) fn beam_density(&self, position: Vec3, towards: Vec3) -> f32 {
        let met = |sphere: &&Sphere| {
            let offset = sphere.centre - position;
            (offset - offset.dot(towards) * towards).length_squared() <= sphere.radius * sphere.radius
        };
        self.spheres.iter().filter(met).count() as f32 / self.sections
    }
}

impl Cones {
    fn density(&self, direction: Vec3) -> f32 {
        let all = &self.cones[..self.count];
        let Some(&(_, _, sum)) = all.last() else { return 0.0 };
        let holds = all.iter().filter(|(axis, drop, _)| cap_height_of(*axis, direction) <= *drop).count();
        holds as f32 / (std::f32::consts::TAU * sum)
    }
}

impl Sphere {
    fn around(mesh: &Mesh, triangles: &[u32]) -> Option<Self> {
        let corners = || triangles.iter().flat_map(|&t| mesh.corners(&mesh.triangles[t as usize]));
        let first = corners().next()?;
        let (low, high) = corners().fold((first, first), |(low, high), corner| (low.min(corner), high.max(corner)));
        let centre = 0.5 * (low + high);
        let square = corners().map(|corner| corner.distance_squared(centre)).fold(0.0, f32::max);
        // Rounding must leave no corner outside.
        let radius = square.sqrt() * (1.0 + 1e-4) + 1e-6 * centre.abs().max_element();
        Some(Self { centre, radius })
    }

    fn section(&self) -> f32 {
        std::f32::consts::PI * self.radius * self.radius
    }
}

/// Splits a group into two whose spheres are smaller together; the one with the larger sphere comes last.
fn part(mesh: &Mesh, sphere: &Sphere, triangles: &[u32]) -> Option<[Group; 2]> {
    let middle = |t: u32| {
        let [a, b, c] = mesh.corners(&mesh.triangles[t as usize]);
        (a + b + c) / 3.0
    };
    let (low, high) = bounds(triangles.iter().map(|&t| middle(t)));
    let mut best: Option<(f32, [Group; 2])> = None;
    for axis in 0..3 {
        for plane in 1..=PLANES {
            let at = low[axis] + (high[axis] - low[axis]) * plane as f32 / (PLANES + 1) as f32;
            let (left, right): (Vec<u32>, Vec<u32>) = triangles.iter().partition(|&&t| middle(t)[axis] < at);
            let (Some(a), Some(b)) = (Sphere::around(mesh, &left), Sphere::around(mesh, &right)) else { continue };
            let size = a.section() + b.section();
            if size < best.as_ref().map_or(WORTH_PARTING * sphere.section(), |(size, _)| *size) {
                let mut parts = [(a, left), (b, right)];
                parts.sort_by(|(a, _), (b, _)| a.radius.total_cmp(&b.radius));
                best = Some((size, parts));
            }
        }
    }
    best.map(|(_, parts)| parts)
}

/// Whether a surface scatters light in single directions other than straight on.
fn is_delta(surface: &Surface) -> bool {
    match *surface {
        Surface::Mirror { .. } | Surface::Dielectric { .. } => true,
        // Without a change of index, a sheet reflects nothing.
        Surface::ThinDielectric { ior, .. } => ior != 1.0,
        Surface::Principled(ref surface) => {
            !surface.transmission.is(0.0) && (!surface.is_thin || surface.ior != 1.0) && surface.may_be_smooth()
        }
        Surface::Lambert { .. } | Surface::RoughConductor { .. } | Surface::Coated { .. } | Surface::Black => false,
    }
}
