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
//! noise both go to zero (Hachisuka and Jensen 2009, *Stochastic progressive photon mapping*; Knaus and Zwicker 2011, §4). Maps beyond what
//! memory is given for lie in a file ([`pages`]): neighbouring pixels gather from the same few pages of each.

mod follow;
mod near;
mod pages;
mod radius;
mod targets;
mod tree;

use std::path::Path;
use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

use super::TraceSettings;
use super::integrator::power_heuristic;
use super::lights::EmitterHit;
use super::sampler::Sampler;
use super::world::World;
use crate::error::{Error, Result};
use crate::matrix::CHANNELS;
use crate::scene::Scene;
use follow::follow;
pub(super) use near::LANES;
use near::{Disc, Near, NearInFile};
use pages::{Items, Pages, Place, WrittenPages};
use radius::RadiusField;
pub(super) use targets::Targets;

/// Photons that leave the lights for each path of the image.
const PER_PATH: f64 = 0.5;

/// Fewest photons that leave the lights, as far as there are not more lights than that.
const LEAST_EMITTED: u64 = 1 << 16;

/// Most photons that leave the lights for a map, likewise: more than so many come in more maps.
const OF_MAP: u64 = 1 << 16;

/// Maps that there are with few photons. Even, so that a map serves one half of the samples. More maps make a gathering cheaper and what
/// it finds noisier: with as many photons, 128 in place of 16 take 0.66 to 0.90 of the time at 256 samples, and lights by water or a mirror
/// have 1.23 to 1.31 times the squared error once exposed and clipped. With more photons both even out: at 256 samples of 128 × 128
/// pixels 32 maps of 2¹⁶ photons in place of 16 take 1.06 to 1.13 times the time for 0.94 to 1.00 of the squared error.
const FEW_MAPS: u32 = 16;

/// Maps for gathering at the second and later surfaces of a path, which lie anywhere in the scene: few enough for the processor's
/// cache. Even, as above. At 64 samples of 256 × 256 pixels lit through water, 16 in place of all take 0.96 of the time, 4 take
/// 0.95. But all pixels have what these few do not know in common, so that no filter averages it: with 4, 40 single texels of 256
/// had 1.02 times the ꟻLIP once cleaned, and the worst of them 2 dB less. Tracing eight pixels together, a sample of each in turn, so
/// that all gather from one map, took 1.00 to 1.06 of the time (three rooms, 64 samples), and was left. Nor does gathering at half of
/// these surfaces pay, chosen by chance, for twice as much: squared error × time with all lights on 1.14 (mixed materials) and 1.16
/// (caustics).
const LATER_MAPS: u32 = 16;

/// Maps that are made at once. Where the first of these stay empty, so would all others: no light reaches the mirrors and the glass, or
/// what they send on comes to no surface.
const AT_ONCE: u32 = 4;

/// Segments of the shortest path with a photon: from the light to a mirror, on to a surface, and to the camera.
const LEAST_DEPTH: u32 = 3;

/// Most that maps may take in memory: more lie in a file.
pub(super) const MAP_BYTES: usize = 192 << 20;

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
    count: usize,
    leaves: Items<Leaf>,
    near: Near,
}

impl Map {
    fn sort(mut photons: Vec<Photon>) -> Self {
        let (near, ranges) = Near::sort(&mut photons, |photon| photon.position);
        let leaves = ranges.into_iter().map(|range| Leaf::of(&photons[range])).collect();
        Self { count: photons.len(), leaves, near }
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.leaves) + self.near.bytes()
    }

    /// The same in a file.
    fn put(self, pages: &mut Pages) -> Result<MapInFile> {
        Ok(MapInFile { count: self.count, leaves: pages.put(&self.leaves)?, near: self.near.put(pages)? })
    }
}

/// A map in a file that is being written.
struct MapInFile {
    count: usize,
    leaves: Place<Leaf>,
    near: NearInFile,
}

impl MapInFile {
    fn open(self, pages: &WrittenPages) -> Map {
        Map { count: self.count, leaves: pages.items(self.leaves), near: self.near.open(pages) }
    }
}

/// What is read of the photons of a leaf: four lines of the cache.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Leaf {
    power: [[f32; LANES]; CHANNELS],
    column: [u32; LANES],
    density: [f32; LANES],
    direction: [[i16; LANES]; 2],
    normal: [[i16; LANES]; 2],
    segments: [u32; LANES],
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

/// What a tracer that sends photons is given beside the scene.
#[derive(Clone, Copy)]
pub struct Sending<'a> {
    /// The folder for a file without a name, of photons for which there is no memory; none for the system's folder of temporary files.
    pub folder: Option<&'a Path>,
    /// Hears how many more have been sent, and says whether to go on.
    pub goes_on: &'a (dyn Fn(u64) -> bool + Sync),
}

impl Default for Sending<'_> {
    fn default() -> Self {
        Self { folder: None, goes_on: &|_| true }
    }
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

/// Photons in reach that lie together, in the lanes that `mask` names.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gathered {
    pub(super) mask: u32,
    pub(super) column: [u32; LANES],
    /// Unit directions to where they came from, by axis.
    pub(super) towards: [[f32; LANES]; 3],
    /// Irradiance across the surface, by channel.
    pub(super) irradiance: [[f32; LANES]; CHANNELS],
    density: [f32; LANES],
}

/// What takes photons in reach.
pub(super) trait Gather {
    /// Takes some that lie together.
    fn take(&mut self, gathered: &Gathered);
}

/// The leaves of a map on the way to what gathers from them.
struct Leaves<'a, G> {
    leaves: &'a [Leaf],
    at: &'a Gathering,
    square: f32,
    into: &'a mut G,
}

impl<G: Gather> near::Each for Leaves<'_, G> {
    #[inline(always)]
    fn leaf(&mut self, leaf: usize, distances: &[f32; LANES], mask: u32) {
        let gathered = self.leaves[leaf].within(self.at, self.square, distances, mask);
        if gathered.mask != 0 {
            self.into.take(&gathered);
        }
    }

    #[inline(always)]
    fn ahead(&self, leaf: usize) {
        near::fetch(self.leaves, leaf);
    }
}

impl Leaf {
    fn of(photons: &[Photon]) -> Self {
        let nothing = [[0; LANES]; 2];
        let mut leaf = Self {
            power: [[0.0; LANES]; CHANNELS],
            column: [0; LANES],
            density: [0.0; LANES],
            direction: nothing,
            normal: nothing,
            segments: [0; LANES],
        };
        for (lane, photon) in photons.iter().enumerate() {
            (0..CHANNELS).for_each(|channel| leaf.power[channel][lane] = photon.power[channel]);
            for at in 0..2 {
                (leaf.direction[at][lane], leaf.normal[at][lane]) = (photon.direction[at], photon.normal[at]);
            }
            (leaf.column[lane], leaf.density[lane], leaf.segments[lane]) =
                (photon.column, photon.density, photon.segments);
        }
        leaf
    }

    /// Those of `mask` that lie on a surface alike and whose paths are not too long, at these squared distances.
    #[inline(always)]
    fn within(&self, at: &Gathering, square: f32, distances: &[f32; LANES], mask: u32) -> Gathered {
        // The kernel of Epanechnikov: `2/(π r²) (1 − d²/r²)`.
        let peak = std::f32::consts::FRAC_2_PI / square;
        let (normal, direction) = (unfold_lanes(&self.normal), unfold_lanes(&self.direction));
        let mut alike = [0u32; LANES];
        let mut share = [0.0; LANES];
        for lane in 0..LANES {
            let cosine = normal[0][lane] * at.normal.x + normal[1][lane] * at.normal.y + normal[2][lane] * at.normal.z;
            alike[lane] = u32::from(cosine > ALIKE) & u32::from(self.segments[lane] <= at.most_segments);
            share[lane] = peak * (1.0 - distances[lane] / square);
        }
        let mut gathered = Gathered {
            mask: (0..LANES).fold(0, |bits, lane| bits | alike[lane] << lane) & mask,
            column: self.column,
            towards: direction,
            irradiance: self.power,
            density: self.density,
        };
        for lane in 0..LANES {
            (0..3).for_each(|axis| gathered.towards[axis][lane] = -direction[axis][lane]);
            (0..CHANNELS).for_each(|channel| gathered.irradiance[channel][lane] *= share[lane]);
        }
        gathered
    }
}

impl Gathered {
    /// Weights beside paths that are scattered along the photons' ways with densities `spread` over projected solid angle.
    /// `expected` is what a photon of density one is expected to bring ([`Photons::expected_of`]).
    #[inline(always)]
    pub(super) fn weights(&self, expected: f32, spread: &[f32; LANES]) -> [f32; LANES] {
        let mut weights = [0.0; LANES];
        for lane in 0..LANES {
            let weight = power_heuristic(expected * self.density[lane], spread[lane]);
            // Where no path can find the light.
            weights[lane] = if self.density[lane] > 0.0 { weight } else { 1.0 };
        }
        weights
    }
}

impl Numbers {
    fn of(scene: &Scene, pixels: u64, settings: TraceSettings) -> Self {
        let samples = settings.samples_per_pixel;
        let lights = scene.emitters.len() as u64;
        let wanted = (pixels as f64 * f64::from(samples) * PER_PATH).max(LEAST_EMITTED as f64);
        // No more than there are samples to gather from them.
        let pairs = (0.5 * wanted / OF_MAP as f64).ceil().max(f64::from(FEW_MAPS / 2)).min(f64::from(samples / 2));
        let maps = (2.0 * pairs).max(1.0);
        // A power of two of points covers a light most evenly.
        let of_light = (wanted / maps).min(OF_MAP as f64) / lights.max(1) as f64;
        let (maps, per_light) = (maps as u32, 1u32 << (of_light.max(1.0) as u32).ilog2());
        Self { maps, per_light, lights }
    }

    fn all(self) -> u64 {
        u64::from(self.maps) * u64::from(self.per_light) * self.lights
    }
}

impl Photons {
    /// Sends the photons of a job, of which so many bytes may stay in memory, and says what that took. None where there is no mirror and no
    /// smooth glass, or no light comes from there to a surface that scatters.
    ///
    /// # Errors
    /// The file cannot be written; [`Error::Interrupted`] where it should not go on.
    pub(super) fn new(
        world: &World,
        pixels: u64,
        settings: TraceSettings,
        sending: Sending<'_>,
        most_bytes: usize,
    ) -> Result<(Option<Self>, PhotonCost)> {
        let begun = Instant::now();
        let Some(targets) = Targets::of(&world.scene).filter(|_| settings.max_depth >= LEAST_DEPTH) else {
            return Ok((None, PhotonCost::default()));
        };
        let numbers = Numbers::of(&world.scene, pixels, settings);
        let (mut maps, mut places, mut rays, mut held) = (Vec::new(), Vec::new(), 0, 0);
        let (mut pages, mut maps_in_file) = (None, Vec::new());
        loop {
            let made = (maps.len() + maps_in_file.len()) as u32;
            if made >= numbers.maps {
                break;
            }
            let some = made..numbers.maps.min(made + AT_ONCE);
            let count = some.len() as u32;
            let send = |map| send(world, &targets, map, numbers, settings);
            let (photons, of_each): (Vec<_>, Vec<u64>) = some.into_par_iter().map(send).unzip();
            rays += of_each.iter().sum::<u64>();
            if made < FEW_MAPS {
                places.extend(photons.iter().flatten().map(|photon| photon.position));
            }
            let sorted: Vec<Map> = photons.into_par_iter().map(Map::sort).collect();
            for map in sorted {
                held += map.bytes();
                match &mut pages {
                    None if held <= most_bytes => maps.push(map),
                    None => maps_in_file.push(map.put(pages.insert(Pages::begin(sending.folder)?))?),
                    Some(pages) => maps_in_file.push(map.put(pages)?),
                }
            }
            if places.is_empty() {
                break;
            }
            if !(sending.goes_on)(Numbers { maps: count, ..numbers }.all()) {
                return Err(Error::Interrupted("while photons were sent; the same command goes on".into()));
            }
        }
        if let Some(pages) = pages {
            let pages = pages.finish()?;
            maps.extend(maps_in_file.into_iter().map(|map| map.open(&pages)));
        }
        let sent = Numbers { maps: maps.len() as u32, ..numbers };
        let per_sample = f64::from(sent.maps) * f64::from(sent.per_light) / f64::from(settings.samples_per_pixel);
        // The first maps show where photons lie densely.
        let all = maps.iter().map(|map| map.count).sum();
        let radius = RadiusField::of(&mut places, all, targets.scene_radius());
        let photons = radius.map(|radius| Self { maps, radius, targets, per_sample: per_sample as f32 });
        Ok((photons, PhotonCost { sent: sent.all(), rays, seconds: begun.elapsed().as_secs_f64() }))
    }

    /// Bytes of memory that the photons of a scene take at most, while the last of them are sorted.
    pub(super) fn needs_bytes(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        if Self::sent(scene, pixels, settings) == 0 {
            return 0;
        }
        let numbers = Numbers::of(scene, pixels, settings);
        let of = |maps: u32| Numbers { maps: numbers.maps.min(maps), ..numbers }.all();
        let in_map = size_of::<Leaf>() / LANES + Near::BYTES_PER_POINT;
        // Some as they come, while they are put into leaves; and where the first lie.
        let sorting = of(AT_ONCE) * (size_of::<Photon>() + in_map) as u64;
        let places = of(FEW_MAPS) * RadiusField::BYTES_PER_PHOTON as u64;
        sorting + places + (numbers.all() * in_map as u64).min(MAP_BYTES as u64)
    }

    /// How many leave the lights of a scene, at most.
    pub(super) fn sent(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        let can_be = settings.max_depth >= LEAST_DEPTH && Targets::of(scene).is_some();
        if can_be { Numbers::of(scene, pixels, settings).all() } else { 0 }
    }

    /// How many have come to rest.
    pub(super) fn count(&self) -> usize {
        self.maps.iter().map(|map| map.count).sum()
    }

    /// The maps that a sample gathers from: where its path is first scattered, and later.
    pub(super) fn maps_of(&self, sample: u32) -> [u32; 2] {
        let maps = self.maps.len() as u32;
        [maps, maps.min(LATER_MAPS)].map(|maps| sample % maps)
    }

    /// How far a surface gathers photons.
    pub(super) fn radius_at(&self, position: Vec3) -> f32 {
        self.radius.at(position)
    }

    /// All photons in reach of a surface, in one order on every machine.
    #[inline]
    pub(super) fn gather(&self, at: &Gathering, into: &mut impl Gather) {
        let Some(Map { leaves, near, .. }) = self.maps.get(at.map as usize) else { return };
        let square = at.radius * at.radius;
        let disc = Disc { centre: at.position, normal: at.normal, square, height: THICKNESS * at.radius };
        near.find(&disc, Leaves { leaves, at, square, into });
    }

    /// What [`Gathered::weights`] wants of a radius: photons that come within it for each sample, over their density.
    pub(super) fn expected_of(&self, radius: f32) -> f32 {
        self.per_sample * std::f32::consts::PI * radius * radius
    }

    /// Weight of a path that has found light `source` by mirrors and glass alone since it was scattered where photons were gathered.
    pub(super) fn weight_of_path(&self, world: &World, source: u32, hit: &EmitterHit, at: GatheredWithin) -> f32 {
        let density = world.lights.emitted_density(&self.targets, source, hit);
        power_heuristic(at.spread, self.expected_of(at.radius) * density)
    }
}

/// How photons were gathered at a surface.
#[derive(Clone, Copy)]
pub(super) struct GatheredWithin {
    pub(super) radius: f32,
    /// Density over projected solid angle with which the path goes on from there.
    pub(super) spread: f32,
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
            photons.extend(follow(world, settings.max_depth, emitted, &sampler, share, &mut rays));
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

/// The unit vectors of eight points of that square.
#[inline(always)]
fn unfold_lanes(folded: &[[i16; LANES]; 2]) -> [[f32; LANES]; 3] {
    let mut vectors = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        let (x, y) = (f32::from(folded[0][lane]) / 32_767.0, f32::from(folded[1][lane]) / 32_767.0);
        let z = 1.0 - x.abs() - y.abs();
        let below = (-z).max(0.0);
        let (x, y) = (x - below.copysign(x), y - below.copysign(y));
        let scale = 1.0 / (x * x + y * y + z * z).sqrt();
        (vectors[0][lane], vectors[1][lane], vectors[2][lane]) = (x * scale, y * scale, z * scale);
    }
    vectors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::BuiltIn;

    /// What is gathered: columns and irradiances, in their order.
    #[derive(Default, PartialEq, Debug)]
    struct Taken(Vec<(u32, [u32; CHANNELS])>);

    impl Gather for Taken {
        fn take(&mut self, gathered: &Gathered) {
            let lanes = (0..LANES).filter(|lane| gathered.mask >> lane & 1 == 1);
            let bits = |lane: usize| std::array::from_fn(|channel| gathered.irradiance[channel][lane].to_bits());
            self.0.extend(lanes.map(|lane| (gathered.column[lane], bits(lane))));
        }
    }

    const PIXELS: u64 = 32 * 24;

    /// A room with water, and how it is traced.
    fn room() -> (World, TraceSettings) {
        let room = BuiltIn { width: 32, height: 24, texels: 2 }.named("caustics").unwrap();
        (World::new(room.scene.into()).unwrap(), TraceSettings { samples_per_pixel: 32, seed: 3, max_depth: 8 })
    }

    #[test]
    fn photons_in_a_file_are_those_in_memory() {
        let (world, settings) = room();
        let some = MAP_BYTES / 100;
        let [held, few, none] = [MAP_BYTES, some, 0]
            .map(|most| Photons::new(&world, PIXELS, settings, Sending::default(), most).unwrap().0.unwrap());
        let in_memory = |photons: &Photons| photons.maps.iter().filter(|m| matches!(m.leaves, Items::Held(_))).count();
        assert_eq!([&held, &none].map(in_memory), [held.maps.len(), 0]);
        assert!((1..held.maps.len()).contains(&in_memory(&few)), "{} of {}", in_memory(&few), held.maps.len());
        let numbers = Numbers::of(&world.scene, PIXELS, settings);
        let mut all = 0;
        for map in 0..numbers.maps {
            for photon in send(&world, &held.targets, map, numbers, settings).0.iter().step_by(7) {
                let normal = unfold_lanes(&photon.normal.map(|t| [t; LANES])).map(|axis| axis[0]).into();
                let position = photon.position;
                let at = |photons: &Photons| {
                    let (radius, mut taken) = (photons.radius_at(position), Taken::default());
                    photons.gather(&Gathering { map, position, normal, radius, most_segments: 8 }, &mut taken);
                    taken
                };
                let [held, few, none] = [&held, &few, &none].map(at);
                all += held.0.len();
                assert!(held == few && held == none);
            }
        }
        assert!(all > 1000, "{all}");
    }

    #[test]
    fn a_job_that_should_not_go_on_sends_no_more() {
        let (world, settings) = room();
        let sending = Sending { folder: None, goes_on: &|_| false };
        let stopped = Photons::new(&world, PIXELS, settings, sending, MAP_BYTES);
        assert!(matches!(stopped, Err(Error::Interrupted(_))));
        let sending = Sending { folder: Some(Path::new("/nowhere/at/all")), goes_on: &|_| true };
        let refused = Photons::new(&world, PIXELS, settings, sending, 0).unwrap_err().to_string();
        assert!(refused.contains("/nowhere/at/all"), "{refused}");
    }

    #[test]
    fn folded_directions_are_kept_to_a_ten_thousandth() {
        for i in 0..2000 {
            let (z, turn) = (f64::from(i) / 1000.0 - 0.9995, f64::from(i) * 2.4);
            let across = (1.0 - z * z).sqrt();
            let v = Vec3::new((across * turn.cos()) as f32, (across * turn.sin()) as f32, z as f32);
            let [x, y, z] = unfold_lanes(&fold(v).map(|t| [t; LANES])).map(|lanes| lanes[3]);
            assert!(Vec3::new(x, y, z).distance(v) < 1e-4, "{v}");
        }
    }
}
