//! Blocks of `T` by tracing them.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::accumulator::{NoiseSums, PixelSums, RUN, Run, Tile, interleave};
use super::bvh::Bvh;
use super::integrator::{Paths, trace_sample};
use super::photons::{MAP_BYTES, PhotonCost, Photons, Sending};
use super::planes::{self, PlaneSums};
use super::sampler::Sampler;
use super::scales;
use super::world::World;
use crate::error::{Error, Result};
use crate::light::{Clusters, probe_lightings};
use crate::matrix::{BlockId, BlockSource, CHANNELS, MatrixShape, TracedBlock};
use crate::scene::{RenderSettings, Scene};

/// How well to trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceSettings {
    /// Paths for each pixel. Powers of two from 2 on cover texels most evenly; with 1 the noise is unknown.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Longest path in segments: 1 sees only lights, 2 direct light, 3 one bounce. Thin sheets passed straight do not
    /// count.
    pub max_depth: u32,
}

/// What tracing a block took.
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
/// A block is a function of the scene, the shape and the settings alone: the same bytes on any thread, in any order.
#[derive(Debug)]
pub struct Tracer {
    world: World,
    /// None where none are wanted, or no mirror and no glass sends light to anything.
    photons: Option<Photons>,
    photon_cost: PhotonCost,
    wants_photons: bool,
    shape: MatrixShape,
    settings: TraceSettings,
    /// Probe lightings for the noise, columns × probes, probe fastest.
    probes_of_column: Vec<f32>,
    probes: usize,
    clusters: Clusters,
    /// See [`Tracer::column_scales`], and their inverses.
    column_scales: Vec<f32>,
    column_factors: Vec<f32>,
}

impl Tracer {
    /// Most samples per pixel.
    pub const MAX_SAMPLES_PER_PIXEL: u32 = RenderSettings::MAX_SAMPLES_PER_PIXEL;

    /// Prepares a scene for tracing: builds its tree, which takes about a second for each million triangles and core, and sends photons
    /// where there are mirrors or smooth glass. Those for which there is no memory lie in the system's folder for temporary files.
    ///
    /// # Errors
    /// A shape that is not the camera's and the basis's, settings out of range, a scene whose parts do not fit
    /// each other, lights of no area; the folder for photons has no room.
    pub fn new(scene: impl Into<Arc<Scene>>, shape: MatrixShape, settings: TraceSettings) -> Result<Self> {
        Self::sending(scene, shape, settings, Sending::default())
    }

    /// The same where photons lie in a folder of the caller's, who hears how many have been sent.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`Error::Interrupted`] where the caller says so.
    pub fn sending(
        scene: impl Into<Arc<Scene>>,
        shape: MatrixShape,
        settings: TraceSettings,
        sending: Sending<'_>,
    ) -> Result<Self> {
        let scene: Arc<Scene> = scene.into();
        let refuse = |what: &str, problem: String, hint: &str| Err(Error::input(what, problem, hint));
        let columns = scene.basis.column_count();
        if shape.columns() != columns {
            return refuse(&scene.name, format!("has {columns} columns, the matrix {}", shape.columns()), "");
        }
        if (shape.width(), shape.height()) != (scene.camera.width, scene.camera.height) {
            let camera = format!("the camera has {}×{} pixels", scene.camera.width, scene.camera.height);
            return refuse(&scene.name, format!("{camera}, the matrix {}×{}", shape.width(), shape.height()), "");
        }
        check(settings)?;
        let (probes_of_column, probes) = interleave(&probe_lightings(&scene.basis), columns);
        let clusters = Clusters::of_basis(&scene.basis);
        let world = World::new(scene)?;
        let (photons, photon_cost) = Photons::new(&world, pixels(shape), settings, sending, MAP_BYTES)?;
        Ok(Self {
            world,
            photons,
            photon_cost,
            wants_photons: true,
            shape,
            settings,
            probes_of_column,
            probes,
            clusters,
            column_scales: Vec::new(),
            column_factors: Vec::new(),
        })
    }

    /// The scales of the columns of a scene ([`crate::light::LightBasis::column_scales`]) for paths of this length, measured by a few:
    /// those of a tracer, for who traces no blocks.
    ///
    /// # Errors
    /// A scene whose parts do not fit each other, lights of no area.
    pub fn measure_column_scales(scene: impl Into<Arc<Scene>>, max_depth: u32) -> Result<Vec<f32>> {
        let world = World::new(scene.into())?;
        Ok(scales::measure(&Paths { world: &world, photons: None, max_depth }))
    }

    /// The same with noise and light of clusters of columns divided by their scales ([`crate::light::LightBasis::column_scales`]),
    /// which are measured by a few paths.
    #[must_use]
    pub fn with_column_scales(mut self) -> Self {
        let paths = Paths { world: &self.world, photons: None, max_depth: self.settings.max_depth };
        self.column_scales = scales::measure(&paths);
        self.column_factors = self.column_scales.iter().map(|scale| scale.recip()).collect();
        self
    }

    /// What noise and light of clusters are divided by, column by column; empty where all are 1.
    pub fn column_scales(&self) -> &[f32] {
        &self.column_scales
    }

    /// The same by paths from the camera alone, which do not find what mirrors and glass throw of lamps without extent. An
    /// independent estimate of the same image for all others.
    #[must_use]
    pub fn without_photons(self) -> Self {
        Self { photons: None, photon_cost: PhotonCost::default(), wants_photons: false, ..self }
    }

    /// Photons that light what is seen by mirrors and smooth glass: none where no light does.
    pub fn photon_count(&self) -> usize {
        self.photons.as_ref().map_or(0, Photons::count)
    }

    /// What sending the photons took, whether or not any came to rest: rays that no block counts.
    pub fn photon_cost(&self) -> PhotonCost {
        self.photon_cost
    }

    /// Photons that leave the lights of a scene with these settings.
    pub fn photons_sent(scene: &Scene, shape: MatrixShape, settings: TraceSettings) -> u64 {
        Photons::sent(scene, pixels(shape), settings)
    }

    /// Bytes of memory that the photons of a scene take at most, beside the blocks.
    pub fn photons_need_bytes(scene: &Scene, shape: MatrixShape, settings: TraceSettings) -> u64 {
        Photons::needs_bytes(scene, pixels(shape), settings)
    }

    /// Bytes that tracing a block of this shape takes at most beside the block: sums and means of the pixels at hand, and
    /// the noise and the planes of so many clusters, which stay with the block.
    pub fn block_needs_bytes(shape: MatrixShape, clusters: usize) -> u64 {
        let (rows, columns) = (shape.max_block_rows() as u64, shape.columns() as u64);
        let sums = PixelSums::needs_bytes(columns) + Tile::needs_bytes(columns);
        let planes = PlaneSums::needs_bytes(rows / CHANNELS as u64, columns, clusters as u64);
        sums + NoiseSums::needs_bytes(rows, columns) + planes
    }

    /// The same scene with other settings.
    ///
    /// # Errors
    /// Settings out of range; the system's folder for temporary files has no room for photons.
    pub fn with_settings(mut self, settings: TraceSettings) -> Result<Self> {
        check(settings)?;
        drop(self.photons.take());
        self.settings = settings;
        if self.wants_photons {
            (self.photons, self.photon_cost) =
                Photons::new(&self.world, pixels(self.shape), settings, Sending::default(), MAP_BYTES)?;
        }
        Ok(self)
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.world.scene
    }

    /// The settings.
    pub fn settings(&self) -> TraceSettings {
        self.settings
    }

    /// The tree over the scene's triangles.
    pub fn bvh(&self) -> &Bvh {
        self.world.bvh()
    }

    /// Traces one block, on this thread, into `target`, whose allocations are reused. Panics if there is no such block.
    pub fn trace_block(&self, id: BlockId, target: &mut TracedBlock) -> BlockStats {
        let rect = self.shape.rect(id);
        let (pixels, columns) = (rect.pixels(), self.shape.columns());
        if (target.block.rows(), target.block.columns()) != (rect.rows(), columns) {
            // Every entry is written below, so a block of the right shape need not be emptied.
            target.block.reset(rect.rows(), columns);
        }
        let spp = self.settings.samples_per_pixel;
        let samples = [spp.div_ceil(2), spp / 2];
        let mut noise = (spp > 1)
            .then(|| NoiseSums::new((rect.rows(), columns), &self.probes_of_column, self.probes, &self.column_factors));
        let mut planes = (spp > 1).then(|| target.planes.take().unwrap_or_default());
        let mut plane_sums = planes.as_mut().map(|planes| {
            planes::begin(planes, &self.clusters, pixels);
            PlaneSums::new(&self.clusters, &self.column_factors)
        });
        let (mut sums, mut tile) = (PixelSums::new(columns), Tile::new(columns));
        let mut stats = BlockStats { paths: pixels as u64 * u64::from(spp), ..Default::default() };
        for first in (0..pixels).step_by(RUN) {
            let run = Run { first, count: RUN.min(pixels - first), pixels };
            for pixel in 0..run.count {
                let inside = (first + pixel) as u32;
                let (x, y) = (rect.x + inside % rect.width, rect.y + inside / rect.width);
                self.trace_pixel((x, y), &mut sums, plane_sums.as_mut(), &mut stats);
                let noise = noise.as_mut().zip(plane_sums.as_ref().map(PlaneSums::emission));
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
        stats
    }

    /// The image under a lighting, one weight for each column, without its matrix: pixels row by row, in linear RGB. By
    /// all threads; none where `stop` says so. Panics if there are fewer weights than columns.
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

/// All samples of a pixel, by code compiled for the vector units that the machine turns out to have: path, surfaces and lights are
/// inlined into it, and the registers and instructions of AVX2 or AVX-512 serve vectors of three, too. The diffuse room takes 0.87 of
/// the time that code for any x86-64 takes, the Conference Room 0.92, for the same bytes: nothing is fused or reordered.
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
        let (world, photons) = (&tracer.world, tracer.photons.as_ref());
        let TraceSettings { samples_per_pixel, seed, max_depth } = tracer.settings;
        let paths = Paths { world, photons, max_depth };
        for sample in 0..samples_per_pixel {
            let sampler = Sampler::new(seed, key, sample);
            let cost = trace_sample(&paths, self.at, sample, &sampler, self.sums, self.planes.as_deref_mut());
            self.stats.rays += cost.rays;
            self.stats.non_finite += cost.non_finite;
        }
    }
}

fn pixels(shape: MatrixShape) -> u64 {
    u64::from(shape.width()) * u64::from(shape.height())
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
