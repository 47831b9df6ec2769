//! Photon maps for light that mirrors and smooth glass throw on surfaces.
//!
//! Camera paths find such light only if a scattered ray hits a lamp through mirrors and glass: never for lamps without
//! extent, rarely for small ones. So before any block is traced, every light sends photons towards mirrors and glass. A
//! photon keeps its column, and is stored at the first surface that scatters (Jensen 1996, *Global illumination using
//! photon maps*: the caustics map). Camera paths gather the photons around their vertices. What both techniques can
//! find is weighted by the power heuristic with the densities of vertex connection and merging (Georgiev et al. 2012,
//! *Light transport simulation with vertex connection and merging*, §4.2). Nothing counts twice, and large lamps, which
//! paths find well, are left to paths.
//!
//! There are several maps, and each sample of a pixel gathers from one of them. A gathering then costs only a share of
//! the photons that the pixel sees in the end. The two halves of the samples have no photon in common, so that their
//! difference shows the noise of photons as well.
//!
//! The radius follows the density of photons: small in a sharp caustic, large in a faint reflection. The number of
//! photons within it grows as `N^⅔`, so that its square falls as `N^−⅓`, and bias and noise both go to zero (Hachisuka
//! and Jensen 2009, *Stochastic progressive photon mapping*; Knaus and Zwicker 2011, §4). Maps beyond the memory limit
//! are in a file ([`pages`]); neighbouring pixels gather from the same few pages of each.

mod follow;
mod near;
mod pages;
mod radius;
mod reach;
mod tree;

use std::f32::consts::FRAC_1_PI;
use std::path::Path;
use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

use super::TraceSettings;
use super::lights::EmitterHit;
use super::photon_targets::Targets;
use super::sampler::Sampler;
use super::vertex::power_heuristic;
use super::world::World;
use crate::error::{Error, Result};
use crate::matrix::CHANNELS;
use crate::scene::Scene;
use follow::follow;
pub(super) use near::LANES;
use near::{Disc, Near, NearInFile};
use pages::{Items, Pages, Place, WrittenPages};
use radius::RadiusField;
use reach::{MIN_WEIGHT, Reach};

/// Photons emitted for each path of the image.
const PER_PATH: f64 = 0.5;

/// Least number of photons emitted, unless there are more lights than that.
const MIN_EMITTED: u64 = 1 << 16;

/// Largest number of photons emitted for one map, unless there are more lights; further photons make more maps.
const OF_MAP: u64 = 1 << 16;

/// Number of maps while photons are few. It is even, so that each map serves one half of the samples. More maps make
/// gathering cheaper and noisier. Tuned: decision 23.
const FEW_MAPS: u32 = 16;

/// Number of maps for gathering at the second and later vertices of a path, which lie anywhere in the scene: few enough
/// for the processor's cache. Even, as above. Few maps correlate the error across pixels, so that the denoiser cannot
/// remove it. Tuned: decision 24.
const LATER_MAPS: u32 = 16;

/// Maps that are made at once. If the first of these stay empty, all others would: no light reaches the mirrors and the
/// glass, or none comes from there to a surface.
const AT_ONCE: u32 = 4;

/// Segments of the shortest path with a photon: from the light to a mirror, on to a surface, and to the camera.
const MIN_DEPTH: u32 = 3;

/// Bytes of maps that are kept in memory; the others are in a file.
pub(super) const MAP_BYTES: usize = 176 << 20;

/// Half the height of the disc in which photons are gathered, in units of its radius, for curved surfaces.
const THICKNESS: f32 = 0.3;

/// Least cosine between the normals of the photon's surface and the gathering one.
const ALIKE: f32 = 0.8;

/// A stored photon.
#[derive(Clone, Copy, Debug)]
struct Photon {
    position: Vec3,
    /// Share of the light's flux, in the units of a light of emission 1.
    power: Vec3,
    column: u32,
    /// Density of its emission, over area times projected solid angle; for lights at infinity, over directions times
    /// the area across them. 0 if no path can hit its light.
    density: f32,
    /// Octahedral encodings of its direction and of the surface normal on that side.
    direction: [i16; 2],
    normal: [i16; 2],
    /// Number of segments of its path.
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

/// The data of a leaf's photons, in four cache lines.
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

/// All photons of a job. They depend on the scene, the number of pixels and the settings alone.
#[derive(Debug)]
pub(super) struct Photons {
    maps: Vec<Map>,
    radius: RadiusField,
    reach: Reach,
    targets: Targets,
    /// Number of photons that leave each light, for each sample of a pixel.
    per_sample: f32,
}

/// Options for sending photons.
#[derive(Clone, Copy)]
pub struct Sending<'a> {
    /// Folder of the unlinked temporary file for photons beyond the memory limit; `None` for the system's temporary
    /// folder.
    pub folder: Option<&'a Path>,
    /// Called with the number of photons sent since the last call; returns whether to continue.
    pub goes_on: &'a (dyn Fn(u64) -> bool + Sync),
}

impl Default for Sending<'_> {
    fn default() -> Self {
        Self { folder: None, goes_on: &|_| true }
    }
}

/// Cost of sending the photons, before the first block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotonCost {
    /// Number of photons emitted.
    pub sent: u64,
    /// Rays traced for them.
    pub rays: u64,
    /// Wall-clock seconds, sorting included.
    pub seconds: f64,
}

/// How many photons are emitted.
#[derive(Clone, Copy, Debug)]
struct Numbers {
    maps: u32,
    /// From each light into each map.
    per_light: u32,
    lights: u64,
}

/// A gathering of photons at a vertex of a camera path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotonGather {
    /// Index of the map.
    pub(super) map: u32,
    pub(super) position: Vec3,
    /// Geometric normal on the viewer's side.
    pub(super) normal: Vec3,
    pub(super) radius: f32,
    /// Whether photons from the other side count as well.
    pub(super) two_sided: bool,
    /// Largest number of segments that a photon's path may have.
    pub(super) most_segments: u32,
}

/// Photons within reach that are stored together, in the lanes that `mask` names.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotonGroup {
    pub(super) mask: u32,
    pub(super) column: [u32; LANES],
    /// Unit directions that they came from, by axis.
    pub(super) towards: [[f32; LANES]; 3],
    /// Irradiance on the surface, by channel.
    pub(super) irradiance: [[f32; LANES]; CHANNELS],
    density: [f32; LANES],
}

/// A receiver of the photons within reach.
pub(super) trait PhotonVisitor {
    /// Receives photons that are stored together.
    fn take(&mut self, gathered: &PhotonGroup);
}

/// Filters the leaves of a map for a receiver.
struct Leaves<'a, G> {
    leaves: &'a [Leaf],
    at: &'a PhotonGather,
    square: f32,
    into: &'a mut G,
}

impl<G: PhotonVisitor> near::LeafVisitor for Leaves<'_, G> {
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

    /// Lanes of `mask` on a similar surface whose paths are not too long, with their squared distances.
    #[inline(always)]
    fn within(&self, at: &PhotonGather, square: f32, distances: &[f32; LANES], mask: u32) -> PhotonGroup {
        // Epanechnikov kernel: `2/(π r²) (1 − d²/r²)`.
        let peak = std::f32::consts::FRAC_2_PI / square;
        let (normal, direction) = (unfold_lanes(&self.normal), unfold_lanes(&self.direction));
        let mut alike = [0u32; LANES];
        let mut share = [0.0; LANES];
        for lane in 0..LANES {
            let cosine = normal[0][lane] * at.normal.x + normal[1][lane] * at.normal.y + normal[2][lane] * at.normal.z;
            let cosine = if at.two_sided { cosine.abs() } else { cosine };
            alike[lane] = u32::from(cosine > ALIKE) & u32::from(self.segments[lane] <= at.most_segments);
            share[lane] = peak * (1.0 - distances[lane] / square);
        }
        let mut gathered = PhotonGroup {
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

impl PhotonGroup {
    /// MIS weights against paths that are scattered towards the photons' origins with densities `spread` over projected
    /// solid angle. `expected` is the number of photons of density 1 within the radius ([`Photons::expected_of`]).
    #[inline(always)]
    pub(super) fn weights(&self, expected: f32, spread: &[f32; LANES]) -> [f32; LANES] {
        let mut weights = [0.0; LANES];
        for lane in 0..LANES {
            let weight = power_heuristic(expected * self.density[lane], spread[lane]);
            // No path can hit the light.
            weights[lane] = if self.density[lane] > 0.0 { weight } else { 1.0 };
        }
        weights
    }
}

impl Numbers {
    fn of(scene: &Scene, pixels: u64, settings: TraceSettings) -> Self {
        let samples = settings.samples_per_pixel;
        let lights = scene.emitters.len() as u64;
        let wanted = (pixels as f64 * f64::from(samples) * PER_PATH).max(MIN_EMITTED as f64);
        // No more maps than samples that gather from them.
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
    /// Sends the photons of a job, with a limit on the bytes kept in memory, and returns the cost as well. `None` if
    /// there is no mirror and no smooth glass, or if no light comes from there to a surface that scatters.
    ///
    /// # Errors
    /// The file cannot be written; [`Error::Interrupted`] if the callback stops it.
    pub(super) fn new(
        world: &World,
        pixels: u64,
        settings: TraceSettings,
        sending: Sending<'_>,
        most_bytes: usize,
    ) -> Result<(Option<Self>, PhotonCost)> {
        let begun = Instant::now();
        let Some(targets) = Targets::of(&world.scene).filter(|_| settings.max_depth >= MIN_DEPTH) else {
            return Ok((None, PhotonCost::default()));
        };
        let numbers = Numbers::of(&world.scene, pixels, settings);
        let (mut maps, mut first_places, mut rays, mut held) = (Vec::new(), Vec::new(), 0, 0);
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
                first_places.extend(photons.iter().flatten().map(|photon| (photon.position, photon.density)));
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
            if first_places.is_empty() {
                break;
            }
            if !(sending.goes_on)(Numbers { maps: count, ..numbers }.all()) {
                return Err(Error::interrupted_keeping("while photons were sent"));
            }
        }
        if let Some(pages) = pages {
            let pages = pages.finish()?;
            maps.extend(maps_in_file.into_iter().map(|map| map.open(&pages)));
        }
        let sent = Numbers { maps: maps.len() as u32, ..numbers };
        let per_sample = f64::from(sent.maps) * f64::from(sent.per_light) / f64::from(settings.samples_per_pixel);
        // The first maps show where photons are dense.
        let all = maps.iter().map(|map| map.count).sum();
        let mut places: Vec<Vec3> = first_places.iter().map(|&(place, _)| place).collect();
        let radius = RadiusField::of(&mut places, all, targets.scene_radius());
        let per_sample = per_sample as f32;
        let photons = radius.map(|radius| {
            let counts = |&&(place, density): &&(Vec3, f32)| {
                let expected = per_sample * std::f32::consts::PI * radius.at(place).powi(2);
                density <= 0.0 || power_heuristic(expected * density, FRAC_1_PI) >= MIN_WEIGHT
            };
            let places: Vec<Vec3> = first_places.iter().filter(counts).map(|&(place, _)| place).collect();
            let reach = Reach::around(&places, &radius);
            Self { maps, radius, reach, targets, per_sample }
        });
        Ok((photons, PhotonCost { sent: sent.all(), rays, seconds: begun.elapsed().as_secs_f64() }))
    }

    /// Upper bound of the bytes of memory that the photons of a scene take, while the last of them are sorted.
    pub(super) fn needs_bytes(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        if Self::sent(scene, pixels, settings) == 0 {
            return 0;
        }
        let numbers = Numbers::of(scene, pixels, settings);
        let of = |maps: u32| Numbers { maps: numbers.maps.min(maps), ..numbers }.all();
        let in_map = size_of::<Leaf>() / LANES + Near::BYTES_PER_POINT;
        // The photons of the maps being sorted, and the positions of the first maps.
        let sorting = of(AT_ONCE) * (size_of::<Photon>() + in_map) as u64;
        let first = RadiusField::BYTES_PER_PHOTON + 2 * size_of::<(Vec3, f32)>();
        let places = of(FEW_MAPS) * first as u64 + 2 * Reach::MOST_BYTES;
        sorting + places + (numbers.all() * in_map as u64).min(MAP_BYTES as u64)
    }

    /// Upper bound of the number of photons emitted in a scene.
    pub(super) fn sent(scene: &Scene, pixels: u64, settings: TraceSettings) -> u64 {
        let can_be = settings.max_depth >= MIN_DEPTH && Targets::of(scene).is_some();
        if can_be { Numbers::of(scene, pixels, settings).all() } else { 0 }
    }

    /// Number of photons stored.
    pub(super) fn count(&self) -> usize {
        self.maps.iter().map(|map| map.count).sum()
    }

    /// The maps that a sample gathers from: at its first non-specular vertex, and at later ones.
    pub(super) fn maps_of(&self, sample: u32) -> [u32; 2] {
        let maps = self.maps.len() as u32;
        [maps, maps.min(LATER_MAPS)].map(|maps| sample % maps)
    }

    /// The gathering radius at a position; 0 where photons are not gathered.
    #[inline(always)]
    pub(super) fn radius_at(&self, position: Vec3) -> f32 {
        if self.reach.holds(position) { self.radius.at(position) } else { 0.0 }
    }

    /// Gathers all photons within reach of a surface, in the same order on every machine.
    #[inline]
    pub(super) fn gather(&self, at: &PhotonGather, into: &mut impl PhotonVisitor) {
        let Some(Map { leaves, near, .. }) = self.maps.get(at.map as usize) else { return };
        let square = at.radius * at.radius;
        let disc = Disc { centre: at.position, normal: at.normal, square, height: THICKNESS * at.radius };
        near.find(&disc, Leaves { leaves, at, square, into });
    }

    /// Number of photons of density 1 within a radius, for [`Gathered::weights`].
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
            // The complement of the seed, so that photons share no random numbers with pixels.
            let sampler = Sampler::new(!settings.seed, key, index << 1);
            let Some(emitted) = world.lights.emit(&world.scene, targets, light, &sampler) else { continue };
            photons.extend(follow(world, settings.max_depth, emitted, &sampler, share, &mut rays));
        }
    }
    photons.shrink_to_fit();
    (photons, rays)
}

/// Octahedral encoding of a unit vector (Cigolle et al. 2014).
fn fold(v: Vec3) -> [i16; 2] {
    let v = v / (v.x.abs() + v.y.abs() + v.z.abs());
    let outside = |a: f32, b: f32| (1.0 - b.abs()) * 1.0f32.copysign(a);
    let (x, y) = if v.z >= 0.0 { (v.x, v.y) } else { (outside(v.x, v.y), outside(v.y, v.x)) };
    [x, y].map(|t| (t * 32_767.0).round() as i16)
}

/// Decodes eight such encodings.
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

    /// The gathered columns and irradiances, in order.
    #[derive(Default, PartialEq, Debug)]
    struct Taken(Vec<(u32, [u32; CHANNELS])>);

    impl PhotonVisitor for Taken {
        fn take(&mut self, gathered: &PhotonGroup) {
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
                    photons.gather(
                        &PhotonGather { map, position, normal, radius, two_sided: false, most_segments: 8 },
                        &mut taken,
                    );
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
        assert!(matches!(stopped, Err(Error::Interrupted { .. })));
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
