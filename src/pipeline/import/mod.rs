//! A matrix from images that other programs rendered, one for each light.

use std::path::Path;

use sha2::{Digest, Sha256};

mod features;
mod noise_estimate;

use self::features::ImportedFeatures;
use self::noise_estimate::{Inside, add_noise};
use super::column_scales;
use super::row_spill::{RowPlace, RowSpill};
use super::{PackOptions, pack};
use crate::block_records::files_of_pack;
use crate::compress::CompressorPlan;
use crate::error::{Error, Hint, Result, Warning, Warnings};
use crate::image::{FeaturePasses, LayerMatch, LayerRole, LightRow, LightSet};
use crate::light::{
    Clusters, DescribedSource, Job, Light, LightBasis, LightKind, LightUnit, Provenance, probe_lightings,
};
use crate::matrix::{
    Block, BlockId, BlockNoise, BlockPlanes, BlockSource, CHANNELS, Feature, MatrixShape, PixelRect, TracedBlock,
};
use crate::resources::{MemoryNeed, Progress, ResourceEstimate, Threads};

/// Version of how entries are made from images, named by matrices of images, so that blocks of two versions are never
/// mixed. Raise it with every change of the result.
const IMPORT_VERSION: u32 = 4;

/// Share of an image's light that is filtered as direct light, the rest as indirect: images of other renderers do not tell them apart, and
/// the mean of both filters is nearer to the truth than either. Tuned: decision 90.
const DIRECT_SHARE: f32 = 0.3;
/// Name of the light that holds what the image under all lights has beyond the sum of the lights.
const REST: &str = "Rest";
/// Relative L2 difference, due to 16-bit files, between the sum of lights and the image under all lights.
const SUM_TOLERANCE: f64 = 2e-3;

/// Images of lights as a matrix: each light is a column. The images are kept in a temporary file, not in memory.
#[derive(Debug)]
pub struct ImportedMatrix {
    job: Job,
    /// Lights that have images of their own.
    images: usize,
    rows: RowSpill,
    /// Sum of absolute values of each column.
    sizes: Vec<f64>,
    known: Option<KnownNoise>,
    /// The role of each layer or file.
    pub matches: Vec<LayerMatch>,
    /// What looks wrong or was added, one line each, for people.
    pub warnings: Warnings,
    /// Relative L2 difference between the sum of lights and the image under all lights, where there is one.
    pub sum_difference: Option<f64>,
}

/// A second rendering of the same lights with other random numbers, and its features. The noise follows from both, so
/// that images can be denoised.
#[derive(Clone, Copy, Debug)]
pub struct SecondImages<'a> {
    /// The images; their lights have the same names.
    pub set: &'a LightSet,
    /// The feature passes of the first and of the second rendering. A single one is taken as free of noise.
    pub features: [Option<&'a FeaturePasses>; 2],
}

/// Source of the noise of images.
#[derive(Clone, Copy, Debug)]
pub enum ImageNoise<'a> {
    /// The noise is not known.
    Unknown,
    /// Estimated from differences of neighbouring pixels in the images themselves, with the rendering's feature passes.
    Estimated(Option<&'a FeaturePasses>),
    /// Measured by a second rendering.
    Measured(SecondImages<'a>),
}

impl<'a> ImageNoise<'a> {
    fn second(&self) -> Option<&SecondImages<'a>> {
        match self {
            Self::Measured(second) => Some(second),
            Self::Unknown | Self::Estimated(_) => None,
        }
    }

    /// The passes of the first and of a second rendering.
    fn features(&self) -> [Option<&'a FeaturePasses>; 2] {
        match self {
            Self::Unknown => [None, None],
            Self::Estimated(passes) => [*passes, None],
            Self::Measured(second) => second.features,
        }
    }
}

/// The noise data of an import.
#[derive(Debug)]
struct KnownNoise {
    /// The images of the second rendering, if there is one.
    second: Option<RowSpill>,
    features: ImportedFeatures,
    /// Columns × probes, see [`probe_lightings`].
    probes: Vec<f32>,
    /// Whether images are to be denoised.
    wants_denoising: bool,
    /// Whether they can be: every column is a cluster of its own.
    denoises: bool,
}

impl ImportedMatrix {
    /// Makes a matrix of images, in blocks of `block_side` pixels: of `set`, or of the mean of that and a second
    /// rendering, from which its `noise` is known. `source` is their name, for the provenance; temporary files are made
    /// in the folder of `beside`.
    ///
    /// The sum of lights is compared with the image under all lights, if there is one. The difference becomes a light
    /// of its own, called `Rest`.
    ///
    /// Memory for reading, and disk space for packing with `options`, are checked before anything is read.
    ///
    /// # Errors
    /// Values that are not finite, naming the light; sizes beyond what a matrix can have; a second rendering of other lights
    /// or another size; a budget that does not hold one image as its decoder wants it, or in which the images could not be
    /// packed then; a disk without room; those of the readers in `image`.
    pub fn read(
        set: &LightSet,
        noise: ImageNoise<'_>,
        source: &str,
        beside: &Path,
        block_side: u32,
        options: &PackOptions,
        watch: &dyn Progress,
    ) -> Result<Self> {
        let mut need = reading_need(set);
        if let Some(second) = noise.second() {
            check_second(set, second)?;
            let also = reading_need(second.set);
            need.fixed_bytes = need.fixed_bytes.max(also.fixed_bytes);
            need.per_thread_bytes = need.per_thread_bytes.max(also.per_thread_bytes);
            need.disk_bytes += also.disk_bytes;
        }
        if !matches!(noise, ImageNoise::Unknown) {
            check_features(set, noise.features())?;
            need.disk_bytes += ImportedFeatures::disk_bytes(set.width, set.height);
            let features = noise.features().into_iter().flatten().map(FeaturePasses::thread_bytes);
            need.per_thread_bytes = features.fold(need.per_thread_bytes, u64::max);
        }
        let packing = packing_need(set, block_side, options, !matches!(noise, ImageNoise::Unknown))?;
        need.most_disk_bytes = need.disk_bytes + packing.most_disk_bytes;
        need.disk_bytes += packing.disk_bytes;
        let [spill, _, _, part] = files_of_pack(beside);
        let there = [spill.as_path(), part.as_path()];
        let threads = need.admit("reading the images, then packing", beside, &there, options.memory_bytes, watch)?;
        let shape = MatrixShape::new(set.width, set.height, set.lights.len() as u32, block_side)?;
        let mut warnings = set.warnings.clone();
        let mut read = |set: &LightSet, source: &str| -> Result<RowSpill> {
            let (rows, looks) = spill_rows(set, source, beside, threads, watch)?;
            warnings.extend(set.lights.iter().zip(&looks).flat_map(|(light, look)| look.warnings(light)));
            Ok(rows)
        };
        let rows = read(set, source)?;
        let known = match &noise {
            ImageNoise::Unknown => None,
            ImageNoise::Estimated(_) | ImageNoise::Measured(_) => Some(KnownNoise {
                second: noise.second().map(|second| read(second.set, "the second rendering")).transpose()?,
                features: ImportedFeatures::read(noise.features(), (set.width, set.height), beside, threads)?,
                probes: Vec::new(),
                wants_denoising: options.denoise,
                denoises: true,
            }),
        };
        let mut imported = Self {
            job: Job { shape, basis: LightBasis::new(), provenance: Provenance::default() },
            images: set.lights.len(),
            rows,
            sizes: Vec::new(),
            known,
            matches: set.matches.clone(),
            warnings,
            sum_difference: None,
        };
        let denoised = |m: &LayerMatch| {
            let (layer, is_light) = (m.layer.to_lowercase(), !matches!(m.role, LayerRole::Ignored));
            // Inputs of denoisers are no denoised images.
            let given = ["albedo", "normal", "depth"].iter().any(|word| layer.contains(word)) && !is_light;
            ["denois", "noisy"].iter().any(|word| layer.contains(word)) && !given
        };
        imported.add_up(set, source)?;
        let adds_up = imported.sum_difference.is_some_and(|difference| difference <= SUM_TOLERANCE);
        if !adds_up && set.matches.iter().any(denoised) {
            imported.warnings.push("the file has denoising passes: denoised light groups no longer add up");
        }
        imported.prepare_denoising();
        Ok(imported)
    }

    /// Takes up the lights as they are now where the noise is known.
    fn prepare_denoising(&mut self) {
        let Some(known) = &mut self.known else { return };
        known.probes = probe_lightings(&self.job.basis);
        let could = std::mem::replace(&mut known.denoises, can_be_denoised(&self.job));
        if known.wants_denoising && could && !known.denoises {
            let (columns, most) = (self.job.shape.columns(), Clusters::MAX);
            let most = format!("at most {most} images are, {} as texels of one light", Clusters::MAX_WITH_PLACES);
            self.warnings.push(format!("{columns} lights are too many to be denoised: {most}"));
        }
    }

    /// Treats the images as those of the texels of one light, row by row: a textured panel, or a sky. The rest of the
    /// image under all lights stays a light of its own.
    ///
    /// # Errors
    /// Another number of images than texels.
    pub fn take_for_texels(&mut self, texels: LightKind) -> Result<()> {
        let lights = self.job.basis.lights();
        let (across, down) = texels.layout();
        let count = u64::from(across) * u64::from(down);
        let rest: Vec<Light> = lights.iter().skip(self.images).cloned().collect();
        if count != self.images as u64 {
            let problem = format!("are {across} × {down}, {count} in all, and there are {} images", self.images);
            return Err(Error::input("the texels", problem, "give as many texels as images, across and down"));
        }
        let name = if texels.is_environment() { "sky" } else { "light" };
        let name = if rest.iter().any(|light| light.name == name) { "texels" } else { name };
        let light = Light { unit: LightUnit::Multiple, ..Light::of_texels(name, texels) };
        let mut basis = LightBasis::new();
        std::iter::once(light).chain(rest).try_for_each(|light| basis.push(light))?;
        self.job.basis = basis;
        self.set_column_scales()?;
        self.prepare_denoising();
        Ok(())
    }

    fn set_column_scales(&mut self) -> Result<()> {
        let scales = column_scales::of_sums(&self.sizes, self.job.shape.rows(), &self.job.basis);
        self.job.basis.set_column_scales(scales)
    }

    /// The job of the matrix.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Whether images could be denoised if their noise were known.
    pub fn wants_noise(&self) -> bool {
        self.known.is_none() && can_be_denoised(&self.job)
    }

    /// Whether its images are denoised where they are packed: their noise is known, and they are few enough.
    pub(super) fn is_denoised(&self) -> bool {
        self.known.as_ref().is_some_and(|known| known.denoises)
    }

    /// A second pass over all rows: compares the sum of lights with the image under all lights, replaces the latter by
    /// the difference, and makes the job.
    fn add_up(&mut self, set: &LightSet, source: &str) -> Result<()> {
        let lights = set.lights.len();
        let (mut content, mut squared_rest, mut squared_sum) = (Sha256::new(), 0.0, 0.0);
        let squares = |row: &[f32]| row.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
        let mut row = vec![0.0; set.width as usize];
        let mut rest = row.clone();
        let second = self.known.as_ref().and_then(|known| known.second.as_ref());
        let mut sizes = vec![0.0; lights + 1];
        let mut sums = SumOfLights::of(lights);
        for (rendering, rows) in std::iter::once(&self.rows).chain(second).enumerate() {
            for y in 0..set.height as usize {
                for channel in 0..CHANNELS {
                    if set.has_sum {
                        rows.read(RowPlace { image: lights, channel, y, x: 0 }, &mut rest)?;
                        squared_sum += squares(&rest);
                    }
                    for (light, size) in sizes[..lights].iter_mut().enumerate() {
                        rows.read(RowPlace { image: light, channel, y, x: 0 }, &mut row)?;
                        content.update(bytemuck::cast_slice(&row));
                        if rendering == 0 {
                            *size += column_scales::sizes(&row);
                        }
                        sums.add(light, &row);
                        rest.iter_mut().zip(&row).for_each(|(rest, v)| *rest -= v);
                    }
                    if set.has_sum {
                        content.update(bytemuck::cast_slice(&rest));
                        squared_rest += squares(&rest);
                        if rendering == 0 {
                            sizes[lights] += column_scales::sizes(&rest);
                        }
                        rows.write(RowPlace { image: lights, channel, y, x: 0 }, &rest)?;
                    }
                    rest.fill(0.0);
                    sums.end_row();
                }
            }
        }
        for light in sums.of_others() {
            let name = &set.lights[light];
            let text = format!("light '{name}' is the sum of the others, which then count twice");
            self.warnings.push(Warning::new(text, Hint::LeaveLightOut));
        }
        if let Some(known) = &self.known {
            known.features.add_to(&mut content)?;
            if known.second.is_none() {
                content.update("noise estimated");
            }
        }
        let mut names = set.lights.clone();
        if set.has_sum {
            let difference = (squared_rest / squared_sum.max(f64::MIN_POSITIVE)).sqrt();
            self.sum_difference = Some(difference);
            if difference > SUM_TOLERANCE {
                let (share, rest) = (100.0 * difference, name_of_rest(&names));
                self.warnings.push(format!(
                    "the lights lack {share:.2} % of the image under all lights; added as light '{rest}'"
                ));
                names.push(rest);
            }
        }
        self.job.basis = basis_of(&names)?;
        self.job.shape = MatrixShape::new(set.width, set.height, names.len() as u32, self.job.shape.block_side())?;
        self.job.provenance = Provenance {
            source: source.to_owned(),
            content: content.finalize().into(),
            program: format!("ltm import {IMPORT_VERSION}, from images"),
            ..Provenance::default()
        };
        sizes.truncate(names.len());
        self.sizes = sizes;
        self.set_column_scales()
    }

    /// The entries of a block of one rendering.
    fn read_entries(&self, rows: &RowSpill, rect: PixelRect, entries: &mut [f32]) -> Result<()> {
        let (width, height) = (rect.width as usize, rect.height as usize);
        for (light, column) in entries.chunks_exact_mut(rect.rows()).enumerate() {
            for (row, piece) in column.chunks_exact_mut(width).enumerate() {
                let (channel, y) = (row / height, rect.y as usize + row % height);
                rows.read(RowPlace { image: light, channel, y, x: rect.x as usize }, piece)?;
            }
        }
        Ok(())
    }

    /// Tells the noise of a block. Of two renderings it becomes the mean.
    fn add_noise(&self, known: &KnownNoise, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let rect = self.job.shape.rect(id);
        let (rows, columns) = (rect.rows(), self.job.shape.columns());
        let (first, other) = match &known.second {
            Some(second) => {
                let first = target.block.entries().to_vec();
                let mut other = vec![0.0; first.len()];
                self.read_entries(second, rect, &mut other)?;
                let entries = target.block.entries_mut().iter_mut();
                entries.zip(&other).for_each(|(entry, b)| *entry = 0.5 * (*entry + b));
                (first, other)
            }
            None => {
                let mut more = self.with_grain(known, id, target.block.entries())?;
                // Planes hold no light below 0: noise above the light itself would brighten the mean of the two.
                let bound =
                    |(more, &entry): (&mut f32, &f32)| *more = more.clamp(entry.min(0.0) * 2.0, entry.max(0.0) * 2.0);
                more.iter_mut().zip(target.block.entries()).for_each(bound);
                let less = target.block.entries().iter().zip(&more).map(|(entry, more)| 2.0 * entry - more);
                (less.collect(), more)
            }
        };
        let divided = |entries: Vec<f32>| {
            let mut block = Block::from_entries(rows, columns, entries);
            block.divide_columns(self.job.basis.column_scales());
            block.entries().to_vec()
        };
        let (first, other) = (divided(first), divided(other));
        let halves: Vec<f32> = first.iter().zip(&other).map(|(a, b)| 0.5 * (a - b)).collect();
        target.noise = Some(noise_of(&halves, rows, columns, &known.probes));
        if known.denoises {
            let (features, feature_variance) = known.features.of(rect)?;
            let part = |share: f32| [&first, &other].map(|half| half.iter().map(|light| share * light).collect());
            let mut planes = BlockPlanes {
                direct: part(DIRECT_SHARE),
                indirect: part(1.0 - DIRECT_SHARE),
                features,
                feature_variance,
                emission: Vec::new(),
            };
            planes.pixel_albedo_of_samples();
            // Rounded as in the file of an interrupted pack.
            planes.round();
            target.planes = Some(planes);
        }
        Ok(())
    }

    /// These entries of a block, each with what may be its noise.
    fn with_grain(&self, known: &KnownNoise, id: BlockId, entries: &[f32]) -> Result<Vec<f32>> {
        let rect = self.job.shape.rect(id);
        let (left, top) = (rect.x.min(1), rect.y.min(1));
        let grown = |at: u32, before: u32, size: u32, end: u32| (size + before + 1).min(end - (at - before));
        let around = PixelRect {
            x: rect.x - left,
            y: rect.y - top,
            width: grown(rect.x, left, rect.width, self.job.shape.width()),
            height: grown(rect.y, top, rect.height, self.job.shape.height()),
        };
        let size = |rect: PixelRect| (rect.width as usize, rect.height as usize);
        let inside = Inside { size: size(rect), at: (left as usize, top as usize), around: size(around) };
        let (features, _) = known.features.of(around)?;
        let albedo = Feature::Albedo.planes();
        let albedo = &features[albedo.start * around.pixels()..albedo.end * around.pixels()];
        let mut neighbours = vec![0.0; around.rows() * self.job.shape.columns()];
        self.read_entries(&self.rows, around, &mut neighbours)?;
        let mut entries = entries.to_vec();
        let columns = entries.chunks_exact_mut(rect.rows()).zip(neighbours.chunks_exact(around.rows()));
        for (column, (entries, neighbours)) in columns.enumerate() {
            let seed = u64::from(id.0) << 32 | column as u64;
            add_noise(entries, neighbours, albedo, inside, seed);
        }
        Ok(entries)
    }
}

/// Whether every column is a cluster of its own, as denoising of images needs it.
fn can_be_denoised(job: &Job) -> bool {
    Clusters::of_basis(&job.basis).count() == job.shape.columns()
}

/// The noise of the mean of two renderings, from half their difference: rows × columns, column-major.
fn noise_of(halves: &[f32], rows: usize, columns: usize, probes: &[f32]) -> BlockNoise {
    let mut noise = BlockNoise {
        row_variance: vec![0.0; rows],
        column_variance: Vec::with_capacity(columns),
        probes: vec![0.0; rows * (probes.len() / columns)],
    };
    for (column, halves) in halves.chunks_exact(rows).enumerate() {
        let share = 1.0 / columns as f32;
        noise.row_variance.iter_mut().zip(halves).for_each(|(sum, d)| *sum += share * d * d);
        noise.column_variance.push(halves.iter().map(|d| d * d).sum::<f32>() / rows as f32);
        for (probe, out) in noise.probes.chunks_exact_mut(rows).enumerate() {
            let weight = probes[probe * columns + column];
            out.iter_mut().zip(halves).for_each(|(o, d)| *o += weight * d);
        }
    }
    noise
}

/// Refuses a second rendering with other lights, another size, or other passes.
fn check_second(set: &LightSet, second: &SecondImages<'_>) -> Result<()> {
    let refuse = |problem: String| {
        let hint = "render the same scene twice, with another seed, and nothing else changed";
        Err(Error::input("the second rendering", problem, hint))
    };
    let other = second.set;
    if (other.width, other.height) != (set.width, set.height) {
        return refuse(format!(
            "has {} × {} pixels, the first {} × {}",
            other.width, other.height, set.width, set.height
        ));
    }
    if other.lights != set.lights || other.has_sum != set.has_sum {
        let differs = set.lights.iter().zip(&other.lights).find(|(a, b)| a != b);
        return refuse(match differs {
            Some((a, b)) => format!("has light '{b}' where the first has '{a}'"),
            None => format!("has {} images, the first {}", other.images(), set.images()),
        });
    }
    Ok(())
}

/// Refuses feature passes of another size.
fn check_features(set: &LightSet, features: [Option<&FeaturePasses>; 2]) -> Result<()> {
    let differs = |passes: &&FeaturePasses| (passes.width, passes.height) != (set.width, set.height);
    let Some(passes) = features.into_iter().flatten().find(differs) else { return Ok(()) };
    let problem =
        format!("have {} × {} pixels, the images {} × {}", passes.width, passes.height, set.width, set.height);
    Err(Error::input("the features", problem, "take those of the same rendering"))
}

/// Reads all images of a set into a file, and collects statistics.
fn spill_rows(
    set: &LightSet,
    source: &str,
    beside: &Path,
    threads: usize,
    watch: &dyn Progress,
) -> Result<(RowSpill, Vec<ImageNotes>)> {
    let (width, height) = (set.width as usize, set.height as usize);
    let rows = RowSpill::create(beside, set.images(), width, height)?;
    let mut looks = vec![ImageNotes::default(); set.images()];
    watch.begin("reading images", (set.images() * height) as u64, "rows");
    let mut take = |row: LightRow<'_>| {
        if watch.interrupted() {
            return Err(Error::interrupted("nothing was written"));
        }
        if let Some(at) = row.values.iter().position(|v| !v.is_finite()) {
            let name = set.lights.get(row.image).map_or("under all lights".to_owned(), |l| format!("of light '{l}'"));
            let problem = format!("the image {name} is not finite at pixel {}, {}", row.x + at, row.y);
            return Err(Error::input(source, problem, "render it again, or replace the pixel"));
        }
        looks[row.image].add(row.values);
        let done = usize::from(row.channel + 1 == CHANNELS && row.x + row.values.len() == width);
        watch.advance(done as u64, size_of_val(row.values) as u64, "B");
        rows.write(RowPlace { image: row.image, channel: row.channel, y: row.y, x: row.x }, row.values)
    };
    let result = Threads::new(threads)?.run(|| set.read(&mut take));
    watch.end();
    result?;
    Ok((rows, looks))
}

/// Memory and disk space for reading images, which are kept on disk.
fn reading_need(set: &LightSet) -> ResourceEstimate {
    let disk_bytes = RowSpill::bytes(set.images(), set.width as usize, set.height as usize);
    ResourceEstimate { disk_bytes, ..ResourceEstimate::of(&[set]) }
}

/// Memory and disk space for packing the images. They are denoised if their noise is known and they are few enough.
///
/// # Errors
/// The memory that `options` allow is too small; sizes beyond what a matrix can have; unusable settings.
fn packing_need(
    set: &LightSet,
    block_side: u32,
    options: &PackOptions,
    is_noise_known: bool,
) -> Result<ResourceEstimate> {
    let mut names = set.lights.clone();
    if set.has_sum {
        names.push(name_of_rest(&names));
    }
    let shape = MatrixShape::new(set.width, set.height, names.len() as u32, block_side)?;
    let job = Job { shape, basis: basis_of(&names)?, provenance: Provenance::default() };
    let options = options.for_source(is_noise_known && can_be_denoised(&job));
    let plan = CompressorPlan::new(&job.basis, shape, options.compress.clone())?;
    let need = pack::need_of(&plan, shape, ResourceEstimate::of(&[]), options.denoised(&job));
    need.threads_within("packing", options.memory_bytes)?;
    Ok(need)
}

/// `Rest`, with a number if a light has that name.
fn name_of_rest(names: &[String]) -> String {
    let numbered = (2..).map(|n| format!("{REST} {n}"));
    let free = std::iter::once(REST.to_owned()).chain(numbered).find(|name| !names.contains(name));
    free.expect("numbers do not end")
}

/// A light of one column for each image.
fn basis_of(names: &[String]) -> Result<LightBasis> {
    let mut basis = LightBasis::new();
    for name in names {
        basis.push(Light {
            name: name.clone(),
            kind: LightKind::Image,
            unit: LightUnit::Multiple,
            emission: [1.0; 3],
            first_column: 0,
            places: vec![[0.0; 3]],
            extents: vec![0.0],
        })?;
    }
    Ok(basis)
}

impl DescribedSource for ImportedMatrix {
    fn job(&self) -> &Job {
        Self::job(self)
    }
}

impl BlockSource for ImportedMatrix {
    fn shape(&self) -> MatrixShape {
        self.job.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let rect = self.job.shape.rect(id);
        target.block.reset(rect.rows(), self.job.shape.columns());
        target.noise = None;
        target.planes = None;
        self.read_entries(&self.rows, rect, target.block.entries_mut())?;
        match &self.known {
            Some(known) => self.add_noise(known, id, target),
            None => Ok(()),
        }
    }
}

/// Largest number of lights for which sums are detected.
const MAX_SUMMED: usize = 64;

/// Detects lights that are the sum of all others: such a light is half of the whole sum.
struct SumOfLights {
    row: Vec<Vec<f32>>,
    /// For each light its square and its product with the sum.
    products: Vec<[f64; 2]>,
    squared_sum: f64,
}

impl SumOfLights {
    /// For this many lights. Two equal lights may be intended; for very many nothing is detected.
    fn of(lights: usize) -> Self {
        let lights = if (3..=MAX_SUMMED).contains(&lights) { lights } else { 0 };
        Self { row: vec![Vec::new(); lights], products: vec![[0.0; 2]; lights], squared_sum: 0.0 }
    }

    fn add(&mut self, light: usize, row: &[f32]) {
        if let Some(kept) = self.row.get_mut(light) {
            kept.clear();
            kept.extend_from_slice(row);
        }
    }

    fn end_row(&mut self) {
        for x in 0..self.row.first().map_or(0, Vec::len) {
            let sum: f64 = self.row.iter().map(|row| f64::from(row[x])).sum();
            self.squared_sum += sum * sum;
            for (row, [square, product]) in self.row.iter().zip(&mut self.products) {
                let own = f64::from(row[x]);
                *square += own * own;
                *product += own * sum;
            }
        }
    }

    fn of_others(&self) -> impl Iterator<Item = usize> + '_ {
        let differs = |[square, product]: [f64; 2]| 4.0 * square - 4.0 * product + self.squared_sum;
        let most = SUM_TOLERANCE * SUM_TOLERANCE * self.squared_sum;
        let is_sum = move |light: &usize| self.squared_sum > 0.0 && differs(self.products[*light]) < most;
        // A single light that is not black is no sum.
        let lit = self.products.iter().filter(|[square, _]| *square > 0.0).count();
        (0..self.products.len()).filter(move |light| lit > 2 && is_sum(light))
    }
}

/// Statistics of an image.
#[derive(Clone, Debug, Default)]
struct ImageNotes {
    values: usize,
    negative: usize,
    largest: f32,
    /// Number of values equal to the largest.
    at_largest: usize,
}

impl ImageNotes {
    fn add(&mut self, values: &[f32]) {
        self.values += values.len();
        for &value in values {
            if value > self.largest {
                (self.largest, self.at_largest) = (value, 1);
            } else if value == self.largest {
                self.at_largest += 1;
            }
            self.negative += usize::from(value < 0.0);
        }
    }

    /// Warnings on suspicious values: many at exactly the largest, or below zero.
    fn warnings(&self, light: &str) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.largest > 0.0 && self.at_largest > self.values / 500 + 3 {
            warnings.push(format!(
                "light '{light}' looks clamped: {} values are exactly its largest, {}; render without clamping, unless it \
                 shows a light of one colour",
                self.at_largest, self.largest
            ));
        }
        if self.negative > 0 {
            let count = self.negative;
            warnings.push(format!("light '{light}' has {count} values below zero, as denoising leaves them, and colours outside of Rec. 709"));
        }
        warnings
    }
}
