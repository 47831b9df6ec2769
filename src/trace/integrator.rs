//! Path tracing of all columns at once (the paper, §3.1): one set of paths; each light that a path finds or samples
//! contributes to its own column.
//!
//! Next-event estimation and emitters hit by scattered rays are combined by multiple importance sampling with the power
//! heuristic (Veach 1997, §9.2). A thin sheet that a ray passes straight through is no vertex. Shadow rays pass it too,
//! so that both techniques see the same paths. Light that comes by mirrors and smooth glass is found by scattered rays
//! and by photons, which are weighted likewise ([`photons`](super::photons)).
//!
//! Emitters that the camera sees by mirrors and smooth glass are looked for along both branches of every boundary, each
//! weighted by its share. What is seen of emitters is never filtered, and a random choice of the branch would leave
//! noise in it.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::accumulator::PixelSums;
use super::bsdf::{Lobes, Scattered};
use super::camera_ray::ray_of_pixel;
use super::further_rays::features_through;
use super::guiding::{self, Guided, PathGuide};
use super::lights::{EmitterHit, Receiver, SeenLight, SplitSky, SunShare};
use super::photons::{GatheredWithin, Photons};
use super::planes::{LightPath, PlaneSums, SampleFeatures};
use super::sampler::{Dimension, KIND_DIMENSION, Sampler};
use super::vertex::{PathRay, PathVertex, power_heuristic};
use super::world::{MAX_PASSES, World};

/// Light samples at the first non-specular vertex; later vertices take one each. More samples and splitting of paths
/// were rejected (decision 7), learnt path guiding as well (decision 8).
const FIRST_LIGHT_SAMPLES: u32 = 4;

/// Vertices that a path has before Russian roulette begins.
const CERTAIN_VERTICES: u32 = 3;
/// Survival probability of Russian roulette, in units of the path's throughput. Tuned: decision 9.
const SURVIVAL: f32 = 4.0;

/// Added to the vertex number of delta branches, so that they use random numbers of their own.
const DELTA_BRANCH_DIMENSION: u32 = 1 << 16;

/// Number, in place of a vertex, of the pair that chooses the point of the first place of a sun; those of other places follow.
const SUN_DIMENSION: u32 = 1 << 20;

/// Share from which on a delta branch follows both branches of a boundary. Below it, one branch is drawn. Tuned:
/// decision 10.
const MIN_BRANCH_SHARE: f32 = 0.001;
/// Largest number of boundaries for each sample at which both branches are followed. Tuned: decision 10.
const MAX_FORKS: u32 = 3;

/// The cost of one path.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PathCost {
    pub(super) rays: u64,
    /// Contributions that were not finite and were left out.
    pub(super) non_finite: u64,
}

/// What paths are traced through, and their length.
#[derive(Clone, Copy)]
pub(super) struct Paths<'a> {
    pub(super) world: &'a World,
    pub(super) photons: Option<&'a Photons>,
    pub(super) guide: Option<&'a PathGuide>,
    /// Longest path in segments.
    pub(super) max_depth: u32,
    /// Samples of a pixel.
    pub(super) samples: u32,
}

/// The last non-specular vertex of a path, for the MIS weights of the light it finds.
pub(super) struct Last {
    pub(super) from: Receiver,
    /// Solid-angle density of the sampled direction. `None` if no light sample could have made it.
    pub(super) pdf: Option<f32>,
    pub(super) cosine: f32,
    pub(super) light_samples: f32,
    /// Probability that a guided ray leaves the vertex too.
    pub(super) guided: f32,
    /// How photons were gathered at the last surface with more than single directions.
    pub(super) gathered: Option<GatheredWithin>,
}

/// Where a path begins: at the camera, or at a vertex of another path, which a guided ray leaves.
struct Begin {
    ray: PathRay,
    throughput: Vec3,
    eta_scale: f32,
    layer: LightPath,
    /// The vertex that the first ray leaves; the eye.
    last: Last,
    /// The guided ray that it begins with, whose factor on the throughput follows from where it arrives.
    guided: Option<Guided>,
    vertex: u32,
    /// The vertex that the path begins at, where that is a sensor.
    sensor: Option<PathVertex>,
}

/// A vertex of a path that a guided ray may leave.
struct Fork<'a> {
    at: &'a PathVertex,
    throughput: Vec3,
    eta_scale: f32,
    layer: LightPath,
    light_samples: f32,
    /// Radius in which photons were gathered.
    radius: Option<f32>,
    vertex: u32,
}

/// A light sample of several.
pub(super) struct LightDraw {
    /// Uniform numbers.
    pub(super) pair: Vec2,
    pub(super) count: u32,
}

impl Last {
    /// The weight of a path's own ray beside the guided ray that may have left the vertex too.
    #[inline(always)]
    fn weight_beside_guided(&mut self, guide: Option<&PathGuide>, direction: Vec3, found: &PathVertex) -> f32 {
        let chance = std::mem::take(&mut self.guided);
        match (guide, self.pdf) {
            (Some(guide), Some(pdf)) if chance > 0.0 => {
                guide.weight((self.from.position, self.from.normal), chance, pdf, direction, found.point.position)
            }
            _ => 1.0,
        }
    }

    /// The start of a ray that no light sample could have made.
    #[inline(always)]
    fn only(ray: &PathRay) -> Self {
        let from = Receiver { position: ray.origin, normal: ray.direction, two_sided: false };
        Self { from, pdf: None, cosine: 0.0, light_samples: 0.0, guided: 0.0, gathered: None }
    }
}

/// A delta branch: the ray that leaves a boundary along the branch that the path does not take.
#[derive(Clone, Copy)]
struct DeltaBranch {
    ray: PathRay,
    throughput: Vec3,
    /// Probability that the path would have taken this branch and all branches before it.
    share: f32,
    eta_scale: f32,
    /// Number of vertices of the path up to there.
    vertex: u32,
    passes: u32,
}

impl DeltaBranch {
    /// Continues along one scattered direction of the surface that the branch has reached, with a share of its light.
    /// `None` if that direction does not leave the surface. At `max_depth` only straight transmission continues.
    #[inline(always)]
    fn onward(&self, world: &World, at: &PathVertex, way: &Scattered, share: f32, max_depth: u32) -> Option<Self> {
        if self.vertex + 1 >= max_depth && !way.pass_through {
            return None;
        }
        at.onward(world, &self.ray, way).map(|ray| Self {
            ray,
            throughput: self.throughput * way.weight,
            share: self.share * share,
            eta_scale: self.eta_scale * way.eta_scale,
            vertex: self.vertex + u32::from(!way.pass_through),
            passes: self.passes + u32::from(way.pass_through),
        })
    }

    /// Continues straight through the surface that it has reached, as if that were absent.
    #[inline(always)]
    fn past(self, at: &PathVertex) -> Self {
        Self { ray: at.past(&self.ray), passes: self.passes + 1, ..self }
    }

    /// Likewise, with the surface's transmittance.
    #[inline(always)]
    fn through(self, at: &PathVertex) -> Self {
        Self { share: self.share * (1.0 - at.opacity), ..self.past(at) }
    }
}

/// Survival probability in Russian roulette. Radiance inside glass is larger by the square of the index, which says
/// nothing about the path's contribution, so that factor is taken out.
#[inline(always)]
fn survival(throughput: Vec3, eta_scale: f32) -> f32 {
    (SURVIVAL * throughput.max_element() * eta_scale).min(1.0)
}

/// Where the contributions of one path are added.
pub(super) struct PathRecord<'a, 'b> {
    sums: &'a mut PixelSums,
    planes: Option<&'a mut PlaneSums<'b>>,
    half: usize,
    suns: SunShare,
    split: Option<SplitSky>,
    /// Whether the first surface stands for its irradiance, and emitters in view for nothing.
    irradiance: bool,
    features: SampleFeatures,
    pub(super) cost: PathCost,
}

impl PathRecord<'_, '_> {
    #[inline(always)]
    pub(super) fn add(&mut self, layer: LightPath, mut column: u32, value: Vec3) {
        if !value.is_finite() {
            self.cost.non_finite += 1;
            return;
        }
        if self.irradiance && layer == LightPath::Emission {
            return;
        }
        if let Some(sky) = self.split
            && layer == LightPath::Indirect
        {
            column = sky.reflected(column);
        }
        self.sums.add(self.half, column, value);
        if let Some(planes) = &mut self.planes
            && value != Vec3::ZERO
        {
            self.features.sees_emitter |= layer == LightPath::Emission;
            planes.add(self.half, layer, column, value);
        }
    }
}

/// Traces one sample of the pixel at image position (x, y) into its half of `sums`, and of `planes` if given.
#[inline(always)]
pub(super) fn trace_sample(
    paths: &Paths<'_>,
    pixel: (u32, u32),
    sample: u32,
    sampler: &Sampler,
    sums: &mut PixelSums,
    planes: Option<&mut PlaneSums<'_>>,
) -> PathCost {
    let (half, features) = ((sample & 1) as usize, SampleFeatures::default());
    let (suns, split) = (SunShare::of_sample(sample, paths.samples), paths.world.lights.split_sky());
    let irradiance = paths.world.scene.shows_irradiance;
    let mut record = PathRecord { sums, planes, half, suns, split, irradiance, features, cost: PathCost::default() };
    let maps = paths.photons.map_or([0; 2], |photons| photons.maps_of(sample));
    let scene = &paths.world.scene;
    let (ray, sensor) = match &scene.sensors {
        None => (ray_of_pixel(&scene.camera, pixel, sampler), None),
        Some(sensors) => {
            let sensor = sensors.at(pixel);
            let ray = PathRay::new(sensor.position + sensor.normal, -sensor.normal);
            (ray, Some(PathVertex::of_sensor(sensor)))
        }
    };
    let begin = Begin {
        ray,
        // A white surface sends 1/π of what it receives.
        throughput: if sensor.is_some() { Vec3::splat(PI) } else { Vec3::ONE },
        sensor,
        eta_scale: 1.0,
        layer: LightPath::Emission,
        last: Last::only(&ray),
        guided: None,
        vertex: 0,
    };
    paths.follow(begin, paths.guide, maps, sampler, &mut record);
    if let Some(planes) = record.planes {
        planes.add_features(&record.features);
    }
    record.cost
}

impl Paths<'_> {
    /// Traces a path. `maps` are the photon maps for the first non-specular vertex and for later ones. Guided rays leave
    /// it where `guide` is given.
    #[inline(always)]
    fn follow(
        &self,
        begin: Begin,
        guide: Option<&PathGuide>,
        maps: [u32; 2],
        sampler: &Sampler,
        record: &mut PathRecord<'_, '_>,
    ) {
        let world = self.world;
        // `layer`: of an emitter that the next ray finds. It is emission until a surface has scattered the path.
        let Begin { mut ray, mut throughput, mut eta_scale, mut last, mut sensor, mut layer, .. } = begin;
        // Share of such emission that this path shows; delta branches at the boundaries before show the rest.
        let mut seen = 1.0;
        let (mut vertex, mut passes, mut travelled, mut forks) = (begin.vertex, 0, 0.0, MAX_FORKS);
        let (is_branch, mut sent) = (begin.guided.is_some(), begin.guided);
        loop {
            let kind = || sampler.pair(Dimension::Choice, KIND_DIMENSION + vertex + passes).x;
            // Emission that a guided ray itself finds is left to the path that it leaves.
            let shown = if sent.is_some() { Vec3::ZERO } else { throughput * seen };
            let is_sensor = sensor.is_some();
            let arrived = sensor.take().or_else(|| self.arrive(&ray, kind, &last, layer, shown, record));
            let Some(mut at) = arrived else { return };
            throughput *= at.kept;
            if record.irradiance && layer == LightPath::Emission && at.shows_no_emitter() {
                throughput *= at.whiten();
            }
            // The longest paths may still pass sheets, as the shadow rays of their last vertex do.
            let at_end = vertex + 1 >= self.max_depth;
            let mut choice = sampler.pair(Dimension::Choice, vertex + passes);
            if layer == LightPath::Emission {
                travelled += at.point.position.distance(ray.origin);
            }
            let here = DeltaBranch { ray, throughput, share: seen, eta_scale, vertex, passes };
            let shown = (layer == LightPath::Emission).then_some((here, travelled));
            if at.opacity < 1.0 && !self.meets(&at, (&mut choice.x, &mut seen), shown, &mut forks, sampler, record) {
                passes += 1;
                ray = at.past(&ray);
                if passes >= MAX_PASSES {
                    return;
                }
                continue;
            }
            if layer == LightPath::Emission && !is_sensor && (at.shows_no_emitter() || at_end) {
                at.show(self.world, &mut record.features, throughput, travelled);
            }
            if at_end && !at.bsdf.lobes().has(Lobes::STRAIGHT) {
                return;
            }
            let may_be_passed = at.may_be_passed();
            if !may_be_passed {
                throughput *= self.weight_of_arrival(guide, (&mut last, &mut sent), &at, ray.direction);
                if throughput == Vec3::ZERO {
                    return;
                }
            }

            let (mut light_samples, mut radius) = (0, None);
            if at.bsdf.lobes().is_non_specular() {
                layer = if layer == LightPath::Emission { LightPath::Direct } else { LightPath::Indirect };
                seen = 1.0;
                (light_samples, radius) = self.light(&at, (vertex, layer, throughput), maps, sampler, record);
            } else if layer == LightPath::Emission
                && let Some((way, chance)) = at.bsdf.other_way(at.wo, choice.x)
            {
                if let Some(branch) = here.onward(world, &at, &way, chance, self.max_depth) {
                    self.trace_delta_branch(branch, &mut forks, sampler, record);
                }
                seen *= 1.0 - chance;
            }

            let light_samples = light_samples as f32;
            let here = Fork { at: &at, throughput, eta_scale, layer, light_samples, radius, vertex };
            let guided = guide.map_or(0.0, |guide| self.send_guided(guide, here, maps, sampler, record));
            let Some(next) = at.bsdf.sample(at.wo, sampler.pair(Dimension::Scatter, vertex), choice.x) else { return };
            if may_be_passed && !next.pass_through {
                throughput *= self.weight_of_arrival(guide, (&mut last, &mut sent), &at, ray.direction);
            }
            throughput *= next.weight;
            eta_scale *= next.eta_scale;
            match at.onward(world, &ray, &next) {
                Some(onward) => ray = onward,
                None => return,
            }
            if next.pass_through {
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
                // A mirror or glass: emitters seen in it are still emission, but what they light by it is no longer
                // direct.
                match layer {
                    LightPath::Emission => record.features.specular = true,
                    LightPath::Direct | LightPath::Indirect => layer = LightPath::Indirect,
                }
            }
            last = if next.singular {
                Last { from: at.receiver(), gathered: last.gathered, ..Last::only(&ray) }
            } else {
                Last { guided, ..at.left_along(ray.direction, (next.pdf, next.wi.z), light_samples, radius) }
            };
            vertex += 1;
            if vertex >= CERTAIN_VERTICES || is_branch {
                let boost = if is_branch { guiding::SURVIVAL } else { 1.0 };
                let survival = survival(boost * throughput, eta_scale);
                if choice.y >= survival {
                    return;
                }
                throughput /= survival;
            }
        }
    }

    /// Adds the light that reaches a vertex by light samples and photons. Returns the number of light samples, and the radius within
    /// which photons were gathered.
    #[inline(always)]
    fn light(
        &self,
        at: &PathVertex,
        (vertex, layer, throughput): (u32, LightPath, Vec3),
        maps: [u32; 2],
        sampler: &Sampler,
        record: &mut PathRecord<'_, '_>,
    ) -> (u32, Option<f32>) {
        let count = if layer == LightPath::Direct { FIRST_LIGHT_SAMPLES } else { 1 };
        let chances = self.world.lights.chances(&at.receiver());
        for member in 0..count {
            let draw = LightDraw { pair: sampler.member(Dimension::Light, vertex, member, count), count };
            at.sample_light(self.world, &chances, throughput, draw, layer, record);
        }
        if layer == LightPath::Direct {
            let share = record.suns;
            for (light, suns) in self.world.lights.suns().iter().enumerate() {
                let pair = |place| sampler.pair(Dimension::Light, SUN_DIMENSION * (light as u32 + 1) + place);
                for sun in suns.samples(at.receiver(), share, pair) {
                    at.add_light(self.world, throughput, (&sun, 1.0), layer, record);
                }
            }
        }
        let map = maps[usize::from(layer == LightPath::Indirect)];
        let most_segments = self.max_depth - vertex - 1;
        (count, self.photons.map(|photons| at.gather(photons, map, most_segments, throughput, record)))
    }

    /// Sends a guided ray from a diffuse vertex, perhaps, and follows a path from where it arrives. Returns the probability
    /// that it is sent.
    fn send_guided(
        &self,
        guide: &PathGuide,
        from: Fork<'_>,
        maps: [u32; 2],
        sampler: &Sampler,
        record: &mut PathRecord<'_, '_>,
    ) -> f32 {
        let Fork { at, throughput, eta_scale, layer, light_samples, radius, vertex } = from;
        if !PathGuide::serves(&at.bsdf) {
            return 0.0;
        }
        let chance = if layer == LightPath::Direct { guiding::FIRST } else { guiding::LATER };
        let sampler = sampler.branch(vertex);
        if let Some(sent) = guide.sample(at, chance, sampler) {
            let Guided { direction, pdf, .. } = sent;
            let last = at.left_along(direction, (pdf, at.frame.z.dot(direction)), light_samples, radius);
            let ray = at.ray(self.world, direction);
            let guided = Some(sent);
            let begin = Begin { ray, throughput, eta_scale, layer, last, guided, vertex: vertex + 1, sensor: None };
            self.follow(begin, None, maps, &sampler, record);
        }
        chance
    }

    /// The factor on the throughput of a path that arrives at a vertex: that of the guided ray that it begins with, or of its
    /// own ray beside the guided ray that may have left the vertex before.
    #[inline(always)]
    fn weight_of_arrival(
        &self,
        guide: Option<&PathGuide>,
        (last, sent): (&mut Last, &mut Option<Guided>),
        at: &PathVertex,
        direction: Vec3,
    ) -> Vec3 {
        match (sent.take(), self.guide) {
            (Some(sent), Some(guide)) => guide.weight_of_guided(&sent, at.point.position),
            _ => Vec3::splat(last.weight_beside_guided(guide, direction, at)),
        }
    }

    /// Finds the next vertex, and adds the emission there, or that of distant lights, to a layer with the path's
    /// throughput. `None` if the ray leaves the scene.
    #[inline(always)]
    fn arrive(
        &self,
        ray: &PathRay,
        kind: impl FnOnce() -> f32,
        last: &Last,
        layer: LightPath,
        throughput: Vec3,
        record: &mut PathRecord<'_, '_>,
    ) -> Option<PathVertex> {
        let (world, &PathRay { origin, direction, is_cameras, .. }) = (self.world, ray);
        let rays = &mut record.cost.rays;
        let point = match is_cameras {
            true => world.intersect_seen(origin, direction, rays),
            false => world.intersect(origin, direction, rays),
        };
        let Some(point) = point else {
            let hit = EmitterHit::beyond(origin, direction);
            for found in world.lights.beyond(direction, last.cosine, &last.from) {
                if is_cameras && !world.lights.is_seen(found.source) {
                    continue;
                }
                let weight = self.weight_of_found(last, &found, &hit);
                record.add(layer, found.column, throughput * found.radiance * weight);
            }
            return None;
        };
        let at = PathVertex::new(world, point, ray, kind);
        if let Some(emitter) = world.scene.mesh.triangles[point.triangle as usize].emitter {
            let hit = EmitterHit {
                position: point.position,
                normal: point.normal,
                uv: point.uv,
                direction,
                distance: point.position.distance(last.from.position),
            };
            if let Some(found) = world.lights.on_surface(&world.scene, emitter, &hit, &last.from) {
                let weight = self.weight_of_found(last, &found, &hit);
                record.add(layer, found.column, throughput * at.kept * found.radiance * weight);
            }
        }
        Some(at)
    }

    /// Whether a path hits a partly transparent surface, by a uniform number, which is rescaled to be uniform again.
    /// Emission behind the surface is seen whole, as behind boundaries: with the share `seen`, and by a delta branch. So are the features,
    /// for which `shown` also has the path's length.
    #[cold]
    fn meets(
        &self,
        at: &PathVertex,
        (choice, seen): (&mut f32, &mut f32),
        shown: Option<(DeltaBranch, f32)>,
        forks: &mut u32,
        sampler: &Sampler,
        record: &mut PathRecord<'_, '_>,
    ) -> bool {
        let meets = *choice < at.opacity;
        if let Some((DeltaBranch { ray, throughput, .. }, travelled)) = shown
            && at.opacity > 0.0
            && record.planes.is_some()
            && !record.features.is_whole
        {
            let rays = &mut record.cost.rays;
            if let Some(all) = features_through(self.world, at, ray, (throughput, travelled), sampler, rays) {
                let SampleFeatures { sees_emitter, specular, .. } = record.features;
                record.features = SampleFeatures { sees_emitter, specular, ..all };
            }
        }
        if let Some((here, _)) = shown.filter(|_| at.shows_no_emitter()) {
            if meets {
                self.trace_delta_branch(here.through(at), forks, sampler, record);
            } else {
                *seen *= 1.0 - at.opacity;
            }
        }
        *choice /= at.opacity;
        meets
    }

    /// Follows a delta branch through mirrors and boundaries for emitters only. A lamp mirrored in glass is hit by few
    /// samples, and no filter removes noise from emission that is seen. Where both branches are likely enough, both are
    /// followed, at no more than `forks` further boundaries.
    fn trace_delta_branch(
        &self,
        mut branch: DeltaBranch,
        forks: &mut u32,
        sampler: &Sampler,
        record: &mut PathRecord<'_, '_>,
    ) {
        while branch.passes < MAX_PASSES {
            let (ray, throughput) = (branch.ray, branch.throughput * branch.share);
            let dimension = DELTA_BRANCH_DIMENSION + branch.vertex + branch.passes;
            let kind = || sampler.pair(Dimension::Choice, KIND_DIMENSION + dimension).x;
            let arrived = self.arrive(&ray, kind, &Last::only(&ray), LightPath::Emission, throughput, record);
            let Some(at) = arrived else { return };
            branch.throughput *= at.kept;
            let at_end = branch.vertex + 1 >= self.max_depth;
            let mut choice = sampler.pair(Dimension::Choice, dimension);
            if at.opacity < 1.0 {
                if at.shows_no_emitter() {
                    branch = branch.through(&at);
                    continue;
                }
                if choice.x >= at.opacity {
                    branch = branch.past(&at);
                    continue;
                }
                choice.x /= at.opacity;
            }
            if at.bsdf.lobes().is_non_specular() || at_end && !at.bsdf.lobes().has(Lobes::STRAIGHT) {
                return;
            }
            let Some(next) = at.bsdf.sample(at.wo, Vec2::ZERO, choice.x) else { return };
            let mut kept = 1.0;
            if *forks > 0
                && let Some((way, chance)) = at.bsdf.other_way(at.wo, choice.x)
                && chance.min(1.0 - chance) * branch.share > MIN_BRANCH_SHARE
            {
                *forks -= 1;
                if let Some(other) = branch.onward(self.world, &at, &way, chance, self.max_depth) {
                    self.trace_delta_branch(other, forks, sampler, record);
                }
                kept = 1.0 - chance;
            }
            match branch.onward(self.world, &at, &next, kept, self.max_depth) {
                Some(onward) => branch = onward,
                None => return,
            }
            if !next.pass_through && branch.vertex >= CERTAIN_VERTICES {
                let survival = survival(branch.throughput, branch.eta_scale);
                if choice.y >= survival {
                    return;
                }
                branch.throughput /= survival;
            }
        }
    }

    /// MIS weight of light that a ray has found: against light samples at the last vertex, or against the photons that
    /// came from the light to the last non-specular vertex.
    #[inline(always)]
    fn weight_of_found(&self, last: &Last, found: &SeenLight, hit: &EmitterHit) -> f32 {
        match (last.pdf, self.photons, last.gathered) {
            (Some(pdf), ..) => power_heuristic(pdf, last.light_samples * found.pdf),
            (None, Some(photons), Some(gathered)) => photons.weight_of_path(self.world, found.source, hit, gathered),
            _ => 1.0,
        }
    }
}
