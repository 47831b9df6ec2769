//! Tracing of the blocks of `T`.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::TraceSettings;
use super::accumulator::{NoiseSums, PixelMeans, PixelSums, RUN, Run, interleave};
use super::bvh::Bvh;
use super::further_rays::features_of_ray;
use super::guiding::PathGuide;
use super::integrator::{Paths, trace_sample};
use super::photons::{MAP_BYTES, PhotonCost, Photons, Sending};
use super::planes::{self, PlaneSums};
use super::sampler::Sampler;
use super::scales;
use super::world::World;
use crate::error::{Error, Result};
use crate::light::{Clusters, probe_lightings};
use crate::matrix::{BlockId, BlockSource, MatrixShape, TracedBlock};
use crate::scene::{Camera, RenderSettings, Scene};

/// Samples of a pixel that the paths for the scales of columns count as: each then asks for a part of the places of the sun.
const SCALE_SAMPLES: u32 = 256;

/// Cost of tracing a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockStats {
    /// Rays traced, to surfaces and to lights; those of photons are the tracer's ([`Tracer::photon_cost`]).
    pub rays: u64,
    /// Paths traced: pixels × samples per pixel.
    pub paths: u64,
    /// Contributions left out because they were not finite.
    pub non_finite: u64,
}

/// Traces blocks of the light transport matrix of a scene.
///
/// A block depends on the scene, the shape and the settings alone: the same bytes on any thread, in any order.
#[derive(Debug)]
pub struct Tracer {
    world: World,
    /// `None` if no lamp has a surface close by, or if paths are not to be guided.
    guide: Option<PathGuide>,
    wants_guide: bool,
    /// `None` if they are disabled, or if no mirror and no glass reflects light to a surface.
    photons: Option<Photons>,
    photon_cost: PhotonCost,
    wants_photons: bool,
    /// Pixels and settings that the photons were sent for; `None` if sending them was interrupted.
    photons_for: Option<(u64, TraceSettings)>,
    shape: MatrixShape,
    settings: TraceSettings,
    /// Probe lightings for the noise, columns × probes, probe fastest.
    probes_of_column: Vec<f32>,
    probes: usize,
    clusters: Clusters,
    /// See [`Tracer::column_scales`]; then their inverses.
    column_scales: Vec<f32>,
    column_factors: Vec<f32>,
}

impl Tracer {
    /// Most samples per pixel.
    pub const MAX_SAMPLES_PER_PIXEL: u32 = RenderSettings::MAX_SAMPLES_PER_PIXEL;

    /// Prepares a scene for tracing. It builds the BVH, in about one second for each million triangles and core, and
    /// sends photons if there are mirrors or smooth glass. Photons beyond the memory limit go to a file in the system's
    /// temporary folder.
    ///
    /// # Errors
    /// A shape that does not match the camera and the basis, settings out of range, a scene whose parts do not match
    /// each other, lights without area, no room for photons in the temporary folder.
    pub fn new(scene: impl Into<Arc<Scene>>, shape: MatrixShape, settings: TraceSettings) -> Result<Self> {
        Self::sending(scene, shape, settings, Sending::default())
    }

    /// As [`new`](Self::new), with the folder for photons and a progress callback from the caller.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`Error::Interrupted`] if the callback says so.
    pub fn sending(
        scene: impl Into<Arc<Scene>>,
        shape: MatrixShape,
        settings: TraceSettings,
        sending: Sending<'_>,
    ) -> Result<Self> {
        let scene: Arc<Scene> = scene.into();
        check_shape(&scene, &scene.camera, shape)?;
        check(settings)?;
        let (probes_of_column, probes) = interleave(&probe_lightings(&scene.basis), shape.columns());
        let clusters = Clusters::of_basis(&scene.basis);
        let world = World::new(scene)?;
        let (photons, photon_cost) = Photons::new(&world, pixels(shape), settings, sending, MAP_BYTES)?;
        let guide = PathGuide::of(&world);
        Ok(Self {
            world,
            guide,
            wants_guide: true,
            photons,
            photon_cost,
            wants_photons: true,
            photons_for: Some((pixels(shape), settings)),
            shape,
            settings,
            probes_of_column,
            probes,
            clusters,
            column_scales: Vec::new(),
            column_factors: Vec::new(),
        })
    }

    /// Estimates the scales of the columns of a scene ([`crate::light::LightBasis::column_scales`]) from a few paths of
    /// at most `max_depth` segments. They equal those of a tracer, for callers that trace no blocks.
    ///
    /// # Errors
    /// A scene whose parts do not match each other, lights without area.
    pub fn measure_column_scales(scene: impl Into<Arc<Scene>>, max_depth: u32) -> Result<Vec<f32>> {
        let world = World::new(scene.into())?;
        let guide = PathGuide::of(&world);
        Ok(scales::measure(&Paths {
            world: &world,
            photons: None,
            guide: guide.as_ref(),
            max_depth,
            samples: SCALE_SAMPLES,
        }))
    }

    /// The same tracer with noise and cluster light divided by the scales of columns
    /// ([`crate::light::LightBasis::column_scales`]), which it estimates from a few paths.
    #[must_use]
    pub fn with_column_scales(mut self) -> Self {
        self.measure_scales();
        self
    }

    /// As [`with_column_scales`](Self::with_column_scales), in place.
    pub(crate) fn measure_scales(&mut self) {
        let (guide, max_depth) = (self.guide.as_ref(), self.settings.max_depth);
        let paths = Paths { world: &self.world, photons: None, guide, max_depth, samples: SCALE_SAMPLES };
        self.column_scales = scales::measure(&paths);
        self.column_factors = self.column_scales.iter().map(|scale| scale.recip()).collect();
    }

    /// Divisors of noise and cluster light for each column; empty if all are 1.
    pub fn column_scales(&self) -> &[f32] {
        &self.column_scales
    }

    /// The same tracer without photons. Camera paths alone do not find light that mirrors and glass throw from lamps
    /// without extent; for all other light they are an independent estimate of the same image.
    #[must_use]
    pub fn without_photons(self) -> Self {
        Self { photons: None, photon_cost: PhotonCost::default(), wants_photons: false, ..self }
    }

    /// The same tracer whose paths are not guided to surfaces close to lamps: an independent estimate of the same image,
    /// with more noise where lamps stand in shades.
    #[must_use]
    pub fn without_guiding(self) -> Self {
        Self { guide: None, wants_guide: false, ..self }
    }

    /// Whether paths are guided to surfaces close to lamps.
    pub fn is_guided(&self) -> bool {
        self.guide.is_some()
    }

    /// Number of photons stored; 0 if no light reaches a surface by mirrors and smooth glass.
    pub fn photon_count(&self) -> usize {
        self.photons.as_ref().map_or(0, Photons::count)
    }

    /// Cost of sending the photons, whether or not any was stored. Blocks do not count these rays.
    pub fn photon_cost(&self) -> PhotonCost {
        self.photon_cost
    }

    /// Number of photons emitted by the lights of a scene with these settings.
    pub fn photons_sent(scene: &Scene, shape: MatrixShape, settings: TraceSettings) -> u64 {
        Photons::sent(scene, pixels(shape), settings)
    }

    /// The same scene with other settings.
    ///
    /// # Errors
    /// Settings out of range; no room for photons in the temporary folder.
    pub fn with_settings(mut self, settings: TraceSettings) -> Result<Self> {
        check(settings)?;
        drop(self.photons.take());
        self.settings = settings;
        if self.wants_photons {
            (self.photons, self.photon_cost) =
                Photons::new(&self.world, pixels(self.shape), settings, Sending::default(), MAP_BYTES)?;
        }
        self.photons_for = Some((pixels(self.shape), settings));
        Ok(self)
    }

    /// Goes on to another view of the same scene, or to another size or number of samples of it. The BVH and the lights stay, and so do
    /// the photons where the number of pixels and the settings are the same. A block is then the same bytes as that of a tracer made anew.
    /// The column scales are to be estimated again.
    ///
    /// # Errors
    /// A shape that does not match the camera and the basis, settings out of range, no room for photons; [`Error::Interrupted`] if the
    /// callback says so, after which it is to be called again.
    pub fn set_view(
        &mut self,
        camera: Camera,
        shape: MatrixShape,
        settings: TraceSettings,
        sending: Sending<'_>,
    ) -> Result<()> {
        check_shape(&self.world.scene, &camera, shape)?;
        check(settings)?;
        let scene = Arc::make_mut(&mut self.world.scene);
        let is_moved = scene.camera != camera;
        scene.camera = camera;
        (self.shape, self.settings) = (shape, settings);
        (self.column_scales, self.column_factors) = (Vec::new(), Vec::new());
        if is_moved && self.wants_guide {
            self.guide = PathGuide::of(&self.world);
        }
        let wanted = Some((pixels(shape), settings));
        if self.wants_photons && self.photons_for != wanted {
            (self.photons, self.photons_for) = (None, None);
            (self.photons, self.photon_cost) = Photons::new(&self.world, pixels(shape), settings, sending, MAP_BYTES)?;
            self.photons_for = wanted;
        }
        Ok(())
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.world.scene
    }

    /// The settings.
    pub fn settings(&self) -> TraceSettings {
        self.settings
    }

    pub(super) fn world(&self) -> &World {
        &self.world
    }

    /// The BVH over the scene's triangles.
    pub fn bvh(&self) -> &Bvh {
        self.world.bvh()
    }

    /// Traces one block into `target` on the current thread; its allocations are reused. Panics if there is no such
    /// block.
    pub fn trace_block(&self, id: BlockId, target: &mut TracedBlock) -> BlockStats {
        self.trace_block_unless(id, target, || false).expect("nothing stops it")
    }

    /// As [`trace_block`](Self::trace_block), unless `stop` says so, which is asked every few pixels: `None` then, and the target holds
    /// no block.
    pub fn trace_block_unless(
        &self,
        id: BlockId,
        target: &mut TracedBlock,
        stop: impl Fn() -> bool,
    ) -> Option<BlockStats> {
        let rect = self.shape.rect(id);
        let (pixels, columns) = (rect.pixels(), self.shape.columns());
        if (target.block.rows(), target.block.columns()) != (rect.rows(), columns) {
            // Every entry is written below, so a block of the right shape need not be cleared.
            target.block.reset(rect.rows(), columns);
        }
        let spp = self.settings.samples_per_pixel;
        let samples = [spp.div_ceil(2), spp / 2];
        let no_emission = PixelSums::new(if self.world.scene.sensors.is_some() { columns } else { 0 });
        let mut noise = (spp > 1)
            .then(|| NoiseSums::new((rect.rows(), columns), &self.probes_of_column, self.probes, &self.column_factors));
        let mut planes = self.world.scene.has_planes(spp).then(|| target.planes.take().unwrap_or_default());
        let mut plane_sums = planes.as_mut().map(|planes| {
            planes::begin(planes, &self.clusters, pixels);
            PlaneSums::new(&self.clusters, &self.column_factors)
        });
        let (mut sums, mut tile) = (PixelSums::new(columns), PixelMeans::new(columns));
        let mut stats = BlockStats { paths: pixels as u64 * u64::from(spp), ..Default::default() };
        for first in (0..pixels).step_by(RUN) {
            let run = Run { first, count: RUN.min(pixels - first), pixels };
            if stop() {
                // Of another shape, so that no part of it is taken for the next block's.
                *target = TracedBlock::default();
                return None;
            }
            for pixel in 0..run.count {
                let inside = (first + pixel) as u32;
                let (x, y) = (rect.x + inside % rect.width, rect.y + inside / rect.width);
                self.trace_pixel((x, y), &mut sums, plane_sums.as_mut(), &mut stats);
                let noise = noise.as_mut().zip(Some(plane_sums.as_ref().map_or(&no_emission, PlaneSums::emission)));
                tile.take(&mut sums, noise, run, pixel, samples);
                if let (Some(planes), Some(sums)) = (&mut planes, &mut plane_sums) {
                    sums.take(planes, run, pixel, samples);
                }
            }
            tile.carry(target, run);
            if let (Some(planes), Some(sums)) = (&mut planes, &mut plane_sums) {
                sums.carry(planes, run);
            }
        }
        target.noise = noise.map(NoiseSums::finish);
        if let Some(planes) = &mut planes {
            planes::finish(planes, &self.clusters, &self.column_factors);
        }
        target.planes = planes;
        Some(stats)
    }

    /// Renders the image under a lighting (one weight for each column) without a matrix. Pixels are row by row, in
    /// linear RGB, on all threads. `None` if `stop` returns true. Panics if there are fewer weights than columns.
    pub fn trace_image(&self, weights: &[[f32; 3]], stop: impl Fn() -> bool + Sync) -> Option<Vec<[f32; 3]>> {
        let (width, height) = (self.shape.width(), self.shape.height());
        let scale = 1.0 / self.settings.samples_per_pixel as f32;
        let row = |sums: &mut PixelSums, y: u32| {
            let pixel = |x: u32| {
                self.trace_pixel((x, y), sums, None, &mut BlockStats::default());
                let mut lit = Vec3::ZERO;
                sums.drain(|column, sum| lit += sum * scale * Vec3::from(weights[column]));
                lit.to_array()
            };
            (!stop()).then(|| (0..width).map(pixel).collect::<Vec<_>>())
        };
        let rows = (0..height).into_par_iter().with_min_len(8);
        let rows: Option<Vec<_>> = rows.map_init(|| PixelSums::new(self.shape.columns()), row).collect();
        rows.map(|rows| rows.concat())
    }

    fn trace_pixel(
        &self,
        at: (u32, u32),
        sums: &mut PixelSums,
        planes: Option<&mut PlaneSums<'_>>,
        stats: &mut BlockStats,
    ) {
        pulp::Arch::new().dispatch(Pixel { tracer: self, at, sums, planes, stats });
    }
}

/// All samples of one pixel, compiled for several instruction sets and chosen at run time. The code of path, surfaces
/// and lights is inlined into it. The bytes are the same for all of them: nothing is fused or reordered (decision 3).
struct Pixel<'a, 'b> {
    tracer: &'a Tracer,
    at: (u32, u32),
    sums: &'a mut PixelSums,
    planes: Option<&'a mut PlaneSums<'b>>,
    stats: &'a mut BlockStats,
}

impl pulp::NullaryFnOnce for Pixel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let (tracer, (x, y)) = (self.tracer, self.at);
        let key = u64::from(y) * u64::from(tracer.shape.width()) + u64::from(x);
        let (world, photons, guide) = (&tracer.world, tracer.photons.as_ref(), tracer.guide.as_ref());
        let TraceSettings { samples_per_pixel, seed, max_depth } = tracer.settings;
        let paths = Paths { world, photons, guide, max_depth, samples: samples_per_pixel };
        for sample in 0..samples_per_pixel {
            let sampler = Sampler::new(seed, key, sample);
            let cost = trace_sample(&paths, self.at, sample, &sampler, self.sums, self.planes.as_deref_mut());
            self.stats.rays += cost.rays;
            self.stats.non_finite += cost.non_finite;
        }
        let Some(planes) = self.planes else { return };
        for further in 0..planes.wants_further() {
            let sampler = Sampler::new(seed, key, samples_per_pixel + further);
            match features_of_ray(world, self.at, &sampler, &mut self.stats.rays) {
                Some(features) => planes.add_further(&features),
                None => return planes.drop_further(),
            }
        }
    }
}

fn pixels(shape: MatrixShape) -> u64 {
    u64::from(shape.width()) * u64::from(shape.height())
}

/// Whether a matrix of this shape is one of the scene from this camera.
fn check_shape(scene: &Scene, camera: &Camera, shape: MatrixShape) -> Result<()> {
    let refuse = |problem: String| Err(Error::input(&scene.name, problem, ""));
    let columns = scene.basis.column_count();
    if shape.columns() != columns {
        return refuse(format!("has {columns} columns, the matrix {}", shape.columns()));
    }
    if (shape.width(), shape.height()) != (camera.width, camera.height) {
        let size = format!("the camera has {}×{} pixels", camera.width, camera.height);
        return refuse(format!("{size}, the matrix {}×{}", shape.width(), shape.height()));
    }
    Ok(())
}

fn check(settings: TraceSettings) -> Result<()> {
    let most = Tracer::MAX_SAMPLES_PER_PIXEL;
    if !(1..=most).contains(&settings.samples_per_pixel) {
        let problem = format!("{} is not between 1 and {most}", settings.samples_per_pixel);
        return Err(Error::input("samples per pixel", problem, "powers of two are best, 64 is a good start"));
    }
    if settings.max_depth == 0 {
        return Err(Error::input("greatest path depth", "0 sees nothing", "give at least 1; 2 is direct light"));
    }
    Ok(())
}

impl BlockSource for Tracer {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        self.trace_block(id, target);
        Ok(())
    }
}
