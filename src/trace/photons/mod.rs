//! Light that mirrors and smooth glass throw on surfaces, from the light's side.
//!
//! Camera paths find such light only where a scattered ray happens on a lamp through mirrors and glass: never for lamps
//! without extent, rarely for small ones. So before any block is traced photons leave every light towards the mirrors and the
//! glass, keep the column that they come from, follow them as camera paths do, and are kept where they first come to a
//! surface that scatters (Jensen 1996, *Global illumination using photon maps*: the caustics map). Surfaces on camera paths gather
//! the photons around them. What both ways can find is weighed by the power heuristic with the densities of vertex connection
//! and merging (Georgiev et al. 2012, *Light transport simulation with vertex connection and merging*, §4.2), so that nothing
//! counts twice and large lamps, which paths find well, are left to paths.
//!
//! Photons come in several maps, and each sample of a pixel gathers from one of them: a gathering then costs a share of the
//! photons that the pixel sees in the end, and the two halves of the samples have no photon in common, so that their
//! difference shows the noise of photons as well. The radius follows the photons' density, so that a sharp caustic is gathered from
//! near and a faint reflection from afar; the number in it grows as `N^⅔`, so that its square falls as `N^−⅓`, which lets bias and
//! noise both go to zero (Hachisuka and Jensen 2009, *Stochastic progressive photon mapping*; Knaus and Zwicker 2011, §4) up to
//! the number of photons that memory is given for.

mod follow;
mod radius;
mod targets;
mod tree;

use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;

use super::TraceSettings;
use super::integrator::power_heuristic;
use super::lights::EmitterHit;
use super::sampler::Sampler;
use super::world::World;
use crate::scene::Scene;
use follow::follow;
use radius::RadiusField;
pub(super) use targets::Targets;
use tree::Tree;

/// Photons that leave the lights for each path of the image.
const PER_PATH: f64 = 0.5;

/// Fewest and most photons that leave the lights, as far as there are not more lights than that.
const EMITTED: (u64, u64) = (1 << 16, 1 << 20);

/// Most maps. Even, so that a map serves one half of the samples.
const MAPS: u32 = 16;

/// Photons in a range of a map's tree that is looked through as a whole.
const LEAF: usize = 8;

/// Height of the disc in which photons are gathered, to either side, in units of its radius: on surfaces that are curved.
const THICKNESS: f32 = 0.3;

/// Least cosine between the normals of a photon's surface and of the one that gathers it.
const ALIKE: f32 = 0.8;

/// A photon where it has come to rest.
#[derive(Clone, Copy, Debug)]
struct Photon {
    position: Vec3,
    /// Share of the light's flux, in the units of a light of emission 1.
    power: Vec3,
    column: u32,
    /// Density with which it was emitted, over area times projected solid angle (over directions times area across them from afar);
    /// 0 where no path can find its light.
    density: f32,
    /// Direction that it came along, and normal of the surface on that side.
    direction: [i16; 2],
    normal: [i16; 2],
    /// Segments of its path.
    segments: u32,
}

#[derive(Debug)]
struct Map {
    photons: Vec<Photon>,
    tree: Tree,
}

/// All photons of a job: a function of the scene, the number of pixels and the settings alone.
#[derive(Debug)]
pub(super) struct Photons {
    maps: Vec<Map>,
    radius: RadiusField,
    targets: Targets,
    /// Photons that leave each light, for each sample of a pixel.
    per_sample: f32,
}

/// What sending the photons took, before the first block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotonCost {
    /// Photons that left the lights.
    pub sent: u64,
    /// Rays traced for them.
    pub rays: u64,
    /// Wall-clock seconds, with sorting them.
    pub seconds: f64,
}

/// How many photons leave the lights.
#[derive(Clone, Copy, Debug)]
struct Numbers {
    maps: u32,
    /// From each light into each map.
    per_light: u32,
    lights: u64,
}

/// Where a surface of a camera path gathers photons.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gathering {
    /// Which map.
    pub(super) map: u32,
    pub(super) position: Vec3,
    /// Geometric normal on the viewer's side.
    pub(super) normal: Vec3,
    pub(super) radius: f32,
    /// Most segments that a photon's path may have.
    pub(super) most_segments: u32,
}

/// A photon in reach.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gathered {
    pub(super) column: u32,
    /// Unit direction to where it came from.
    pub(super) towards: Vec3,
    /// Irradiance across the surface.
    pub(super) irradiance: Vec3,
    density: f32,
}

impl Numbers {
    fn of(scene: &Scene, pixels: u64, settings: TraceSettings) -> Self {
        let samples = settings.samples_per_pixel;
        let maps = if samples > 1 { (samples & !1).min(MAPS) } else { 1 };
        let lights = scene.emitters.len() as u64;
        let wanted = (pixels as f64 * f64::from(samples) * PER_PATH).clamp(EMITTED.0 as f64, EMITTED.1 as f64);
        // A power of two of points covers a light most evenly.
        let per_light = 1u32 << ((wanted / (u64::from(maps) * lights.max(1)) as f64).max(1.0) as u32).ilog2();
        Self { maps, per_light, lights }
    }

    fn all(self) -> u64 {
        u64::from(self.maps) * u64::from(self.per_light) * self.lights
    }
}

impl Photons {
    /// Sends the photons of a job, and says what that took. None where there is no mirror and no smooth glass, or no light comes
    /// from there to a surface that scatters.
    pub(super) fn new(world: &World, pixels: u64, settings: TraceSettings) -> (Option<Self>, PhotonCost) {
        let begun = Instant::now();
        let Some(targets) = Targets::of(&world.scene) else { return (None, PhotonCost::default()) };
        let numbers = Numbers::of(&world.scene, pixels, settings);
        let send = |map| send(world, &targets, map, numbers, settings);
        let (maps, rays): (Vec<_>, Vec<u64>) = (0..numbers.maps).into_par_iter().map(send).unzip();
        let photons = Self::sorted(maps, targets, numbers, settings);
        let (rays, seconds) = (rays.iter().sum(), begun.elapsed().as_secs_f64());
        (photons, PhotonCost { sent: numbers.all(), rays, seconds })
    }

    fn sorted(mut maps: Vec<Vec<Photon>>, targets: Targets, numbers: Numbers, settings: TraceSettings) -> Option<Self> {
        let radius = RadiusField::of(&maps, targets.scene_radius())?;
        let maps = maps.par_iter_mut().map(|photons| {
            let mut photons = std::mem::take(photons);
            let tree = Tree::sort(&mut photons, LEAF, |photon| photon.position);
            Map { photons, tree }
        });
        let maps = maps.collect();
        let per_sample = f64::from(numbers.maps) * f64::from(numbers.per_light) / f64::from(settings.samples_per_pixel);
        Some(Self { maps, radius, targets, per_sample: per_sample as f32 })
    }

    /// Bytes that the photons of a scene take at most, while they are sorted.
    pub(super) fn needs_bytes(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        let each = (size_of::<Photon>() + RadiusField::BYTES_PER_PHOTON + Tree::bytes_per_point(LEAF)) as u64;
        Self::sent(scene, pixels, settings) * each
    }

    /// How many leave the lights of a scene.
    pub(super) fn sent(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        if Targets::of(scene).is_none() { 0 } else { Numbers::of(scene, pixels, settings).all() }
    }

    /// How many have come to rest.
    pub(super) fn count(&self) -> usize {
        self.maps.iter().map(|map| map.photons.len()).sum()
    }

    /// The map that a sample gathers from.
    pub(super) fn map_of(&self, sample: u32) -> u32 {
        sample % self.maps.len() as u32
    }

    /// How far a surface gathers photons.
    pub(super) fn radius_at(&self, position: Vec3) -> f32 {
        self.radius.at(position)
    }

    /// All photons in reach of a surface.
    #[inline]
    pub(super) fn gather(&self, at: &Gathering, mut each: impl FnMut(Gathered)) {
        let Some(Map { photons, tree }) = self.maps.get(at.map as usize) else { return };
        let square = at.radius * at.radius;
        // The kernel of Epanechnikov: `2/(π r²) (1 − d²/r²)`.
        let peak = std::f32::consts::FRAC_2_PI / square;
        tree.near(at.position, at.radius, |range| {
            for photon in &photons[range] {
                let offset = photon.position - at.position;
                let distance2 = offset.length_squared();
                if distance2 < square
                    && photon.segments <= at.most_segments
                    && offset.dot(at.normal).abs() < THICKNESS * at.radius
                    && unfold(photon.normal).dot(at.normal) > ALIKE
                {
                    let irradiance = photon.power * (peak * (1.0 - distance2 / square));
                    let (column, towards) = (photon.column, -unfold(photon.direction));
                    each(Gathered { column, towards, irradiance, density: photon.density });
                }
            }
        });
    }

    /// Weight of a gathered photon beside a path that is scattered along its way with density `spread` over projected solid
    /// angle.
    pub(super) fn weight(&self, photon: &Gathered, radius: f32, spread: f32) -> f32 {
        let expected = self.expected(photon.density, radius);
        // Where no path can find the light.
        if photon.density > 0.0 { power_heuristic(expected, spread) } else { 1.0 }
    }

    /// Weight of a path that was scattered with density `spread` over projected solid angle at a surface that gathered within
    /// `radius`, and has then found light `source` by mirrors and glass alone.
    pub(super) fn weight_of_path(
        &self,
        world: &World,
        source: u32,
        hit: &EmitterHit,
        (radius, spread): (f32, f32),
    ) -> f32 {
        let density = world.lights.emitted_density(&self.targets, source, hit);
        power_heuristic(spread, self.expected(density, radius))
    }

    /// Photons of a density that come within a radius for each sample.
    fn expected(&self, density: f32, radius: f32) -> f32 {
        self.per_sample * std::f32::consts::PI * radius * radius * density
    }
}

/// The photons of one map, and the rays that they took.
fn send(world: &World, targets: &Targets, map: u32, numbers: Numbers, settings: TraceSettings) -> (Vec<Photon>, u64) {
    let (mut rays, share) = (0, 1.0 / numbers.per_light as f32);
    let mut photons = Vec::with_capacity(numbers.per_light as usize * numbers.lights as usize);
    for light in 0..numbers.lights as u32 {
        let key = u64::from(map) * numbers.lights + u64::from(light);
        for index in 0..numbers.per_light {
            // A seed of its own, so that photons share no numbers with the pixels.
            let sampler = Sampler::new(!settings.seed, key, index << 1);
            let Some(emitted) = world.lights.emit(&world.scene, targets, light, &sampler) else { continue };
            photons.extend(follow(world, settings.max_depth, emitted, (&sampler, share), &mut rays));
        }
    }
    photons.shrink_to_fit();
    (photons, rays)
}

/// A unit vector as a point of the square that an octahedron unfolds to (Cigolle et al. 2014).
fn fold(v: Vec3) -> [i16; 2] {
    let v = v / (v.x.abs() + v.y.abs() + v.z.abs());
    let outside = |a: f32, b: f32| (1.0 - b.abs()) * 1.0f32.copysign(a);
    let (x, y) = if v.z >= 0.0 { (v.x, v.y) } else { (outside(v.x, v.y), outside(v.y, v.x)) };
    [x, y].map(|t| (t * 32_767.0).round() as i16)
}

fn unfold(folded: [i16; 2]) -> Vec3 {
    let [x, y] = folded.map(|t| f32::from(t) / 32_767.0);
    let z = 1.0 - x.abs() - y.abs();
    let below = (-z).max(0.0);
    Vec3::new(x - below.copysign(x), y - below.copysign(y), z).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folded_directions_are_kept_to_a_ten_thousandth() {
        for i in 0..2000 {
            let (z, turn) = (f64::from(i) / 1000.0 - 0.9995, f64::from(i) * 2.4);
            let across = (1.0 - z * z).sqrt();
            let v = Vec3::new((across * turn.cos()) as f32, (across * turn.sin()) as f32, z as f32);
            assert!(unfold(fold(v)).distance(v) < 1e-4, "{v}");
        }
    }
}
