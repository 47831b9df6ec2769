//! Path tracing of all columns at once (the paper, §3.1): one set of paths, and every light that a path finds or
//! samples goes to that light's column.
//!
//! Next-event estimation and the light that scattered rays find by themselves are joined by multiple importance
//! sampling with the power heuristic (Veach 1997, §9.2). A thin sheet that a ray passes straight through is no vertex:
//! shadow rays pass it too, and both ways of finding a light must see the same path. Light that comes by mirrors and smooth
//! glass is found by scattered rays and by photons, which are weighed likewise ([`photons`](super::photons)). Emitters that the
//! camera sees by mirrors and smooth glass are looked for both ways from every boundary, and each way shows its share: what is seen
//! is never filtered, and a choice between the ways would leave grain.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::accumulator::PixelSums;
use super::bsdf::{Bsdf, Scattered};
use super::frame::Frame;
use super::lights::{Chances, EmitterHit, Found};
use super::photons::{Gather, Gathered, GatheredWithin, Gathering, LANES, Photons};
use super::planes::{Layer, PlaneSums, SampleFeatures};
use super::sampler::{Sampler, Use};
use super::world::{MAX_PASSES, SurfacePoint, World};
use crate::scene::{Camera, PixelFilter};

/// Light samples at the first surface that scatters; later ones get one each. They cost a shadow ray, not a path, and
/// what is lit directly has the most noise.
///
/// Two or four ways on from there in place of one help an image with all lights on and hurt a lamp alone. Squared error × time of
/// two, all lamps on and the mean lamp: 1.01 and 1.03 of the Conference Room's 24 lamps, 0.95 and 1.13 of mixed materials under
/// a panel of texels, 0.71 and 1.12 of the diffuse room. Four ways on: 1.29 and 1.30 of the Conference Room. More light
/// samples, so that a surface serves several lamps, do not pay either: eight here and four at later ones are equal at equal time.
///
/// Nor does path guiding: three paths in five sent to where a first 65,536 paths found light, by places and how surfaces face there
/// (128 directions, each column's light of equal worth). Raw squared error × time at 64 samples, all lamps on and the mean lamp: 0.99 and 0.85 of the
/// Conference Room's 24 lamps, 0.80 and 0.78 one dark hall away from the lamps, 0.64 and 0.73 two away, and 1.05 and 1.19 of the diffuse
/// room. But once cleaned, three lamps of the Conference Room gain 0.2 dB of clip in the mean at 16 samples and 0.1 dB at 64, for 1.07
/// times the time, and one of them loses; and what the first paths see does not foretell where guiding loses.
const FIRST_LIGHT_SAMPLES: u32 = 4;

/// Vertices that a path has before its end is left to chance.
const CERTAIN_VERTICES: u32 = 3;
/// How likely a path goes on after those, in units of its throughput. A path that ends early is paid for by the fireflies of those that
/// go on in its place. Squared error × time of images with all lights on, against 1 (2 and 8 beside): 0.96 of the Conference Room
/// (0.95, 1.04), 0.81 of a glossy box (0.84, 0.89), 0.63 of the classroom (0.73, 0.62), 0.41 of Shirley's room (0.60, 0.35), and 0.68 two
/// dark halls away from the lamp (0.80, 0.68). The mean of twelve lightings, narrow ones with it, of the built-in room
/// and the Conference Room is even (0.9 to 1.1 in clip), and so is a lamp alone (1.03). A higher `CERTAIN_VERTICES` or the throughput's root in its place gained less.
const SURVIVAL: f32 = 4.0;

/// Added to the vertices of rays that look aside, for random numbers that no path uses.
const ASIDE: u32 = 1 << 16;

/// Rays that look aside look both ways from a boundary where the share of each is above this, and one way by chance elsewhere: a lamp that a
/// ball of glass mirrors twice inside still had grain with a hundredth.
const LEAST_SHARE: f32 = 0.001;
/// Most boundaries from which those of a sample look both ways. Three show that lamp without grain; ten panes behind one another, which fill
/// the picture, take 1.3 times the time of none, 1.7 with six, and 3.4 without a limit.
const MOST_FORKS: u32 = 3;

/// What one path cost.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PathCost {
    pub(super) rays: u64,
    /// Contributions that were not finite and were left out.
    pub(super) non_finite: u64,
}

/// What paths are traced through, and how far.
#[derive(Clone, Copy)]
pub(super) struct Paths<'a> {
    pub(super) world: &'a World,
    pub(super) photons: Option<&'a Photons>,
    /// Longest path in segments.
    pub(super) max_depth: u32,
}

/// The last surface that scattered the path, for the weights of the light it finds.
struct Last {
    position: Vec3,
    /// Shading normal.
    normal: Vec3,
    /// Density over solid angle with which the direction was chosen; None where no light sample could have made it.
    pdf: Option<f32>,
    cosine: f32,
    light_samples: f32,
    /// How photons were gathered at the last surface with more than single directions.
    gathered: Option<GatheredWithin>,
}

/// A light sample of several.
struct LightDraw {
    /// Uniform numbers.
    pair: Vec2,
    count: u32,
}

impl Last {
    /// Where a ray begins that no light sample could have made.
    #[inline(always)]
    fn only(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, pdf: None, cosine: 0.0, light_samples: 0.0, gathered: None }
    }
}

/// A ray that leaves a boundary the way that the path itself does not take.
#[derive(Clone, Copy)]
struct Aside {
    ray: (Vec3, Vec3),
    throughput: Vec3,
    /// How likely the path would have taken it, and all that it took before.
    share: f32,
    compression: f32,
    /// Of the path up to there.
    vertex: u32,
    passes: u32,
}

impl Aside {
    /// The ray that goes on by a way from the surface that this one has come to, with this share of what it shows. None where it does not
    /// leave the surface, or the path has its `max_depth`: then it may pass straight on only.
    #[inline(always)]
    fn onward(&self, at: &Vertex, way: &Scattered, share: f32, max_depth: u32) -> Option<Self> {
        if self.vertex + 1 >= max_depth && !way.straight {
            return None;
        }
        at.onward(self.ray.1, way).map(|ray| Self {
            ray,
            throughput: self.throughput * way.weight,
            share: self.share * share,
            compression: self.compression * way.compression,
            vertex: self.vertex + u32::from(!way.straight),
            passes: self.passes + u32::from(way.straight),
        })
    }

    /// Straight on behind the surface that it has come to, as if that were not there.
    #[inline(always)]
    fn past(self, at: &Vertex) -> Self {
        Self { ray: (at.point.start(self.ray.1), self.ray.1), passes: self.passes + 1, ..self }
    }

    /// The same with the share of what the surface lets through.
    #[inline(always)]
    fn through(self, at: &Vertex) -> Self {
        Self { share: self.share * (1.0 - at.opacity), ..self.past(at) }
    }
}

/// How likely a path goes on whose end is left to chance. Radiance inside glass is larger by the square of its index, which says nothing
/// about the path's worth.
#[inline(always)]
fn survival(throughput: Vec3, compression: f32) -> f32 {
    (SURVIVAL * throughput.max_element() * compression).min(1.0)
}

/// Where the contributions of one path go.
struct Record<'a, 'b> {
    sums: &'a mut PixelSums,
    planes: Option<&'a mut PlaneSums<'b>>,
    half: usize,
    features: SampleFeatures,
    cost: PathCost,
}

/// A surface that a path has come to, seen from where it came.
pub(super) struct Vertex {
    pub(super) point: SurfacePoint,
    pub(super) bsdf: Bsdf,
    /// Geometric normal on the viewer's side.
    pub(super) normal: Vec3,
    frame: Frame,
    /// Direction to the viewer in the frame.
    pub(super) wo: Vec3,
    /// How likely a ray meets the surface; otherwise it passes straight through.
    pub(super) opacity: f32,
}

impl Record<'_, '_> {
    #[inline(always)]
    fn add(&mut self, layer: Layer, column: u32, value: Vec3) {
        if !value.is_finite() {
            self.cost.non_finite += 1;
            return;
        }
        self.sums.add(self.half, column, value);
        if let Some(planes) = &mut self.planes
            && value != Vec3::ZERO
        {
            self.features.sees_emitter |= layer == Layer::Emission;
            planes.add(self.half, layer, column, value);
        }
    }
}

/// Traces a sample of the pixel at image position (x, y) into its half of `sums`, and of `planes` where wanted.
#[inline(always)]
pub(super) fn trace_sample(
    paths: &Paths<'_>,
    (x, y): (u32, u32),
    sample: u32,
    sampler: &Sampler,
    sums: &mut PixelSums,
    planes: Option<&mut PlaneSums<'_>>,
) -> PathCost {
    let camera = &paths.world.scene.camera;
    let position = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + filter_offset(camera, sampler.pair(Use::Pixel, 0));
    let (half, features) = ((sample & 1) as usize, SampleFeatures::default());
    let mut record = Record { sums, planes, half, features, cost: PathCost::default() };
    let maps = paths.photons.map_or([0; 2], |photons| photons.maps_of(sample));
    paths.follow((camera.eye, camera.direction(position)), maps, sampler, &mut record);
    if let Some(planes) = record.planes {
        planes.add_features(&record.features);
    }
    record.cost
}

impl Paths<'_> {
    /// Follows the path of a ray, which gathers photons of the first of `maps` where it is first scattered, and of the second
    /// later.
    #[inline(always)]
    fn follow(&self, ray: (Vec3, Vec3), maps: [u32; 2], sampler: &Sampler, record: &mut Record<'_, '_>) {
        let (world, (mut origin, mut direction)) = (self.world, ray);
        let (mut throughput, mut compression) = (Vec3::ONE, 1.0);
        let mut last = Last::only(origin, direction);
        // The layer of an emitter that the next ray finds: emission until a surface has scattered the path.
        let mut layer = Layer::Emission;
        // The share of such emission that this way shows: boundaries that it came by were looked along both ways.
        let mut seen = 1.0;
        let (mut vertex, mut passes, mut travelled, mut forks) = (0, 0, 0.0, MOST_FORKS);
        loop {
            let Some(at) = self.arrive((origin, direction), &last, layer, throughput * seen, record) else { return };
            // The longest paths may still pass sheets, as the shadow rays of their last vertex do.
            let at_end = vertex + 1 >= self.max_depth;
            let mut choice = sampler.pair(Use::Choice, vertex + passes);
            if layer == Layer::Emission {
                travelled += at.point.position.distance(origin);
            }
            let here = Aside { ray: (origin, direction), throughput, share: seen, compression, vertex, passes };
            let shown = (layer == Layer::Emission).then_some(here);
            if at.opacity < 1.0 && !self.meets(&at, (&mut choice.x, &mut seen), shown, &mut forks, sampler, record) {
                passes += 1;
                origin = at.point.start(direction);
                if passes >= MAX_PASSES {
                    return;
                }
                continue;
            }
            if layer == Layer::Emission && (at.shows_no_emitter() || at_end) {
                at.show(self.world, &mut record.features, throughput, travelled);
            }
            if at_end && !at.bsdf.lets_pass() {
                return;
            }

            let (mut light_samples, mut radius) = (0, None);
            if at.bsdf.is_spread() {
                light_samples = if layer == Layer::Emission { FIRST_LIGHT_SAMPLES } else { 1 };
                layer = if layer == Layer::Emission { Layer::Direct } else { Layer::Indirect };
                seen = 1.0;
                let chances = world.lights.chances(at.point.position, at.frame.z);
                for member in 0..light_samples {
                    let pair = sampler.member(Use::Light, vertex, member, light_samples);
                    let draw = LightDraw { pair, count: light_samples };
                    at.sample_light(world, &chances, throughput, draw, layer, record);
                }
                let map = maps[usize::from(layer == Layer::Indirect)];
                if let Some(photons) = self.photons {
                    radius = Some(at.gather(photons, map, self.max_depth - vertex - 1, throughput, record));
                }
            } else if layer == Layer::Emission
                && let Some((way, chance)) = at.bsdf.other_way(at.wo, choice.x)
            {
                if let Some(aside) = here.onward(&at, &way, chance, self.max_depth) {
                    self.look_aside(aside, &mut forks, sampler, record);
                }
                seen *= 1.0 - chance;
            }

            let Some(next) = at.bsdf.sample(at.wo, sampler.pair(Use::Scatter, vertex), choice.x) else { return };
            throughput *= next.weight;
            compression *= next.compression;
            match at.onward(direction, &next) {
                Some(ray) => (origin, direction) = ray,
                None => return,
            }
            if next.straight {
                passes += 1;
                if passes >= MAX_PASSES {
                    return;
                }
                continue;
            }
            if at_end {
                return;
            }
            if next.singular {
                // A mirror or glass: what is seen in it is emission still, what lights by it is no longer direct.
                match layer {
                    Layer::Emission => record.features.specular = true,
                    Layer::Direct | Layer::Indirect => layer = Layer::Indirect,
                }
            }
            let spread = || next.pdf / direction.dot(at.normal).abs();
            last = Last {
                position: at.point.position,
                normal: at.frame.z,
                pdf: (!next.singular).then_some(next.pdf),
                cosine: next.wi.z,
                light_samples: light_samples as f32,
                gathered: if next.singular {
                    last.gathered
                } else {
                    radius.map(|radius| GatheredWithin { radius, spread: spread() })
                },
            };
            vertex += 1;
            if vertex >= CERTAIN_VERTICES {
                let survival = survival(throughput, compression);
                if choice.y >= survival {
                    return;
                }
                throughput /= survival;
            }
        }
    }

    /// Where a ray comes to, after the emitter there, or those beyond everything, have been added to a layer with the path's
    /// throughput. None beyond everything.
    #[inline(always)]
    fn arrive(
        &self,
        (origin, direction): (Vec3, Vec3),
        last: &Last,
        layer: Layer,
        throughput: Vec3,
        record: &mut Record<'_, '_>,
    ) -> Option<Vertex> {
        let world = self.world;
        let Some(point) = world.intersect(origin, direction, &mut record.cost.rays) else {
            let hit = EmitterHit::beyond(origin, direction);
            for found in world.lights.beyond(direction, last.cosine, (last.position, last.normal)) {
                let weight = self.weight_of_found(last, &found, &hit);
                record.add(layer, found.column, throughput * found.radiance * weight);
            }
            return None;
        };
        if let Some(emitter) = world.scene.mesh.triangles[point.triangle as usize].emitter {
            let hit = EmitterHit {
                position: point.position,
                normal: point.normal,
                uv: point.uv,
                direction,
                distance: point.position.distance(last.position),
            };
            if let Some(found) = world.lights.on_surface(&world.scene, emitter, &hit, (last.position, last.normal)) {
                let weight = self.weight_of_found(last, &found, &hit);
                record.add(layer, found.column, throughput * found.radiance * weight);
            }
        }
        Some(Vertex::new(world, point, direction))
    }

    /// Whether a path meets a surface that lets some pass, by a uniform number, which is uniform again where it does. What emits
    /// behind it is seen whole, as by boundaries: with its share by `seen`, or by a ray aside.
    #[cold]
    fn meets(
        &self,
        at: &Vertex,
        (choice, seen): (&mut f32, &mut f32),
        shown: Option<Aside>,
        forks: &mut u32,
        sampler: &Sampler,
        record: &mut Record<'_, '_>,
    ) -> bool {
        let meets = *choice < at.opacity;
        if let Some(here) = shown.filter(|_| at.shows_no_emitter()) {
            if meets {
                self.look_aside(here.through(at), forks, sampler, record);
            } else {
                *seen *= 1.0 - at.opacity;
            }
        }
        *choice /= at.opacity;
        meets
    }

    /// Follows a ray aside as far as mirrors and boundaries lead, and only for the emitters that are seen there: one that is
    /// mirrored in glass, which few samples mirror, would be dotted else, and no filter touches what is seen of emitters. It looks
    /// both ways too where each is likely enough, from at most `forks` more boundaries.
    fn look_aside(&self, mut aside: Aside, forks: &mut u32, sampler: &Sampler, record: &mut Record<'_, '_>) {
        while aside.passes < MAX_PASSES {
            let (ray, throughput) = (aside.ray, aside.throughput * aside.share);
            let last = Last::only(ray.0, ray.1);
            let Some(at) = self.arrive(ray, &last, Layer::Emission, throughput, record) else { return };
            let at_end = aside.vertex + 1 >= self.max_depth;
            let mut choice = sampler.pair(Use::Choice, ASIDE + aside.vertex + aside.passes);
            if at.opacity < 1.0 {
                if at.shows_no_emitter() {
                    aside = aside.through(&at);
                    continue;
                }
                if choice.x >= at.opacity {
                    aside = aside.past(&at);
                    continue;
                }
                choice.x /= at.opacity;
            }
            if at.bsdf.is_spread() || at_end && !at.bsdf.lets_pass() {
                return;
            }
            let Some(next) = at.bsdf.sample(at.wo, Vec2::ZERO, choice.x) else { return };
            let mut kept = 1.0;
            if *forks > 0
                && let Some((way, chance)) = at.bsdf.other_way(at.wo, choice.x)
                && chance.min(1.0 - chance) * aside.share > LEAST_SHARE
            {
                *forks -= 1;
                if let Some(other) = aside.onward(&at, &way, chance, self.max_depth) {
                    self.look_aside(other, forks, sampler, record);
                }
                kept = 1.0 - chance;
            }
            match aside.onward(&at, &next, kept, self.max_depth) {
                Some(onward) => aside = onward,
                None => return,
            }
            if !next.straight && aside.vertex >= CERTAIN_VERTICES {
                let survival = survival(aside.throughput, aside.compression);
                if choice.y >= survival {
                    return;
                }
                aside.throughput /= survival;
            }
        }
    }

    /// Weight of light that a ray has found beside light samples at the last surface, or beside the photons that came from it to
    /// the last surface that scatters.
    #[inline(always)]
    fn weight_of_found(&self, last: &Last, found: &Found, hit: &EmitterHit) -> f32 {
        match (last.pdf, self.photons, last.gathered) {
            (Some(pdf), ..) => power_heuristic(pdf, last.light_samples * found.pdf),
            (None, Some(photons), Some(gathered)) => photons.weight_of_path(self.world, found.source, hit, gathered),
            _ => 1.0,
        }
    }
}

impl Vertex {
    #[inline(always)]
    pub(super) fn new(world: &World, point: SurfacePoint, direction: Vec3) -> Self {
        let front = point.normal.dot(direction) < 0.0;
        let bsdf = world.bsdf(&point, front);
        let (normal, frame) = facing(&point, direction, front, bsdf.has_lobe());
        let opacity = world.material(&point).opacity;
        Self { point, bsdf, normal, frame, wo: frame.to_local(-direction), opacity }
    }

    /// Whether no ray that the surface itself sends on shows an emitter as it is.
    #[inline(always)]
    fn shows_no_emitter(&self) -> bool {
        self.bsdf.is_spread() || matches!(self.bsdf, Bsdf::Black)
    }

    /// What a camera path shows that has come to this surface.
    #[inline(always)]
    fn show(&self, world: &World, features: &mut SampleFeatures, throughput: Vec3, depth: f32) {
        features.albedo = throughput * self.bsdf.albedo(self.wo);
        features.normal = self.frame.z;
        features.depth = depth;
        features.on_surface = true;
        features.material = world.material_index(&self.point) + 1;
    }

    /// One light sample.
    #[inline(always)]
    fn sample_light(
        &self,
        world: &World,
        chances: &Chances,
        throughput: Vec3,
        LightDraw { pair, count }: LightDraw,
        layer: Layer,
        record: &mut Record<'_, '_>,
    ) {
        let drawn = world.lights.sample(&world.scene, self.point.position, &self.frame, chances, pair);
        let Some(light) = drawn else { return };
        if light.towards.dot(self.normal) <= 0.0 {
            return;
        }
        let (value, pdf) = self.bsdf.eval(self.wo, self.frame.to_local(light.towards));
        let value = throughput * value * light.weight / count as f32;
        if value == Vec3::ZERO {
            return;
        }
        let kept = world.transmittance(self.point.start(light.towards), light.end, &mut record.cost.rays);
        if kept != Vec3::ZERO {
            let weight = power_heuristic(count as f32 * light.pdf, pdf);
            let weight = if light.pdf > 0.0 { weight } else { 1.0 };
            record.add(layer, light.column, value * kept * weight);
        }
    }

    /// Gathers the photons around, whose paths have `most_segments` at most. Returns the radius.
    #[inline(always)]
    fn gather(
        &self,
        photons: &Photons,
        map: u32,
        most_segments: u32,
        throughput: Vec3,
        record: &mut Record<'_, '_>,
    ) -> f32 {
        let (position, normal) = (self.point.position, self.normal);
        let radius = photons.radius_at(position);
        let at = Gathering { map, position, normal, radius, most_segments };
        photons.gather(&at, &mut Lit { vertex: self, expected: photons.expected_of(radius), throughput, record });
        radius
    }

    /// The ray of what was scattered, where the path came by `direction`. None where it does not leave the surface.
    #[inline(always)]
    fn onward(&self, direction: Vec3, next: &Scattered) -> Option<(Vec3, Vec3)> {
        let direction = if next.straight { direction } else { self.leaving(next)? };
        Some((self.point.start(direction), direction))
    }

    /// The world direction of what was scattered. None where the shading normal allows it and the surface itself does
    /// not.
    #[inline(always)]
    pub(super) fn leaving(&self, next: &Scattered) -> Option<Vec3> {
        let direction = self.frame.to_world(next.wi).normalize();
        if (direction.dot(self.normal) > 0.0) == (next.wi.z > 0.0) {
            return Some(direction);
        }
        next.singular.then(|| lifted(direction, self.normal * next.wi.z.signum()))
    }
}

/// A surface that photons light.
struct Lit<'a, 'b, 'c> {
    vertex: &'a Vertex,
    /// What a photon of density one is expected to bring.
    expected: f32,
    throughput: Vec3,
    record: &'a mut Record<'b, 'c>,
}

impl Gather for Lit<'_, '_, '_> {
    #[inline(always)]
    fn take(&mut self, gathered: &Gathered) {
        let vertex = self.vertex;
        let (mut values, mut pdfs) = ([[0.0f32; LANES]; 3], [0.0f32; LANES]);
        let along = |axis: Vec3, lane: usize| {
            let [x, y, z] = &gathered.towards;
            x[lane] * axis.x + y[lane] * axis.y + z[lane] * axis.z
        };
        if let Bsdf::Lambert { reflectance } = vertex.bsdf {
            // As `Bsdf::eval`, all lanes at once.
            for lane in 0..LANES {
                let z = along(vertex.frame.z, lane);
                let pdf = if z > 0.0 && vertex.wo.z > 0.0 { FRAC_1_PI * z } else { 0.0 };
                pdfs[lane] = pdf;
                (0..3).for_each(|channel| values[channel][lane] = reflectance[channel] * pdf);
            }
        } else {
            for lane in (0..LANES).filter(|lane| gathered.mask >> lane & 1 == 1) {
                let [x, y, z] = gathered.towards.map(|axis| axis[lane]);
                let (value, pdf) = vertex.bsdf.eval(vertex.wo, vertex.frame.to_local(Vec3::new(x, y, z)));
                pdfs[lane] = pdf;
                (0..3).for_each(|channel| values[channel][lane] = value[channel]);
            }
        }
        // Photons lie as the surface itself faces them, not as its shading normal does.
        let (mut cosines, mut spread) = ([0.0f32; LANES], [0.0f32; LANES]);
        for lane in 0..LANES {
            cosines[lane] = along(vertex.normal, lane);
            spread[lane] = pdfs[lane] / cosines[lane];
        }
        let weights = gathered.weights(self.expected, &spread);
        let mut light = [[0.0f32; LANES]; 3];
        for lane in 0..LANES {
            let weight = weights[lane] / cosines[lane];
            for channel in 0..3 {
                let value = self.throughput[channel] * values[channel][lane];
                light[channel][lane] = value * gathered.irradiance[channel][lane] * weight;
            }
        }
        let mut mask = gathered.mask;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let is_lit = values.iter().any(|channel| channel[lane] != 0.0);
            if is_lit && cosines[lane] > 0.0 {
                let value = Vec3::new(light[0][lane], light[1][lane], light[2][lane]);
                self.record.add(Layer::Indirect, gathered.column[lane], value);
            }
        }
    }
}

/// Height above the surface of a direction that would have gone below it, as a sine.
const GRAZING: f32 = 1e-3;

/// The geometric normal on the viewer's side, and the shading frame there.
///
/// At the rim of a coarse mesh an interpolated normal may turn away from the viewer, or mirror the view into the
/// surface. Surfaces with a lobe about the mirror direction then get the nearest normal that mirrors it just above the
/// surface (Keller et al. 2017, *The Iray light transport simulation and rendering system*, §A.3), so that nothing
/// they reflect is lost; others the geometric normal, where theirs turns away.
#[inline(always)]
fn facing(point: &SurfacePoint, direction: Vec3, front: bool, has_lobe: bool) -> (Vec3, Frame) {
    let side = if front { 1.0 } else { -1.0 };
    let (normal, shading) = (point.normal * side, point.shading_normal * side);
    if !has_lobe {
        return (normal, Frame::around(if shading.dot(direction) < -1e-4 { shading } else { normal }));
    }
    let mirrored = direction - 2.0 * shading.dot(direction) * shading;
    if mirrored.dot(normal) >= GRAZING && shading.dot(direction) < 0.0 {
        return (normal, Frame::around(shading));
    }
    (normal, Frame::around((lifted(mirrored, normal) - direction).try_normalize().unwrap_or(normal)))
}

/// The direction nearest to one below the surface that is just above it.
#[inline(always)]
fn lifted(direction: Vec3, normal: Vec3) -> Vec3 {
    (direction + (GRAZING - direction.dot(normal)) * normal).try_normalize().unwrap_or(normal)
}

/// Weight of the technique with expected density `a` beside one with `b`, which are counts times densities.
#[inline(always)]
pub(super) fn power_heuristic(a: f32, b: f32) -> f32 {
    // As a ratio, so that large densities do not overflow.
    let ratio = b / a;
    if a > 0.0 { 1.0 / (1.0 + ratio * ratio) } else { 0.0 }
}

/// Where in the image a sample falls, from the middle of its pixel: drawn from the filter's shape.
#[inline(always)]
fn filter_offset(camera: &Camera, pair: Vec2) -> Vec2 {
    match camera.filter {
        PixelFilter::Box => pair - 0.5,
        PixelFilter::Tent { radius } => {
            let tent = |x: f32| if x < 0.5 { (2.0 * x).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * x).max(0.0).sqrt() };
            radius * Vec2::new(tent(pair.x), tent(pair.y))
        }
        PixelFilter::Gaussian { deviation } => {
            // Box and Muller over a disc cut at three deviations.
            let inside = 1.0 - (-4.5f32).exp();
            let radius = (-2.0 * (1.0 - pair.x * inside).ln()).sqrt();
            let (sin, cos) = (std::f32::consts::TAU * pair.y).sin_cos();
            deviation * radius * Vec2::new(cos, sin)
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::statistics::chi_square_p_value;
    use super::*;

    /// Bins of `draws` values from 0 to `end`, against the share of each below its upper edge.
    fn holds(filter: PixelFilter, end: f32, value: impl Fn(Vec2) -> f32, below: impl Fn(f64) -> f64) {
        let camera = Camera::looking(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, (1, 1), filter).unwrap();
        let (bins, draws) = (40usize, 200_000);
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let mut counts = vec![0u32; bins];
        for _ in 0..draws {
            let offset = filter_offset(&camera, Vec2::new(random.random(), random.random()));
            counts[((value(offset) / end * bins as f32) as usize).min(bins - 1)] += 1;
        }
        let edge = |bin: usize| below(f64::from(end) * bin as f64 / bins as f64);
        let expected: Vec<f64> = (0..bins).map(|b| f64::from(draws) * (edge(b + 1) - edge(b))).collect();
        let p = chi_square_p_value(&counts, &expected);
        assert!(p > 1e-4, "{filter:?}: p = {p:.2e}");
    }

    #[test]
    fn samples_fall_as_the_pixel_filter_says() {
        let radius = 1.5;
        let tent = |x: f64| 1.0 - (1.0 - x / f64::from(radius)).powi(2);
        holds(PixelFilter::Tent { radius }, radius, |o| o.x.abs(), tent);
        holds(PixelFilter::Tent { radius }, radius, |o| o.y.abs(), tent);
        let (deviation, cut) = (0.5, 1.0 - (-4.5f64).exp());
        let radial = |r: f64| (1.0 - (-0.5 * (r / f64::from(deviation)).powi(2)).exp()) / cut;
        holds(PixelFilter::Gaussian { deviation }, 3.0 * deviation, |o| o.length(), radial);
        // A quarter of the turn each.
        let turn = |o: Vec2| o.y.atan2(o.x).rem_euclid(std::f32::consts::TAU);
        let even = |angle: f64| angle / std::f64::consts::TAU;
        holds(PixelFilter::Gaussian { deviation }, std::f32::consts::TAU, turn, even);
        holds(PixelFilter::Box, 0.5, |o| o.x.abs(), |x| 2.0 * x);
    }
}
