//! A matrix from images that other programs rendered, one for each light.

use std::path::Path;

use sha2::{Digest, Sha256};

use super::rows::RowSpill;
use super::spill::spill_path;
use super::{PackOptions, pack};
use crate::compress::Compressor;
use crate::error::{Error, Result};
use crate::host::{Need, PROGRAM_BYTES, Threads, Watch};
use crate::image::{LayerMatch, LightRow, LightSet};
use crate::light::{Job, Light, LightBasis, LightKind, LightUnit, Provenance};
use crate::matrix::{BlockId, BlockSource, CHANNELS, MatrixShape, TracedBlock};

/// Version of how entries are made of images, which a matrix of them names: to be raised with every change of what comes out,
/// so that blocks of two versions are never mixed.
const IMPORT_VERSION: u32 = 1;

/// Name of the light that holds what the image under all lights has beyond the sum of the lights.
const REST: &str = "Rest";
/// Relative L2 difference between the sum of lights and the image under all lights that 16-bit files show.
const SUM_TOLERANCE: f64 = 2e-3;

/// Images of lights as a matrix: each light is a column. The images wait in a temporary file, not in memory.
#[derive(Debug)]
pub struct ImportedMatrix {
    job: Job,
    rows: RowSpill,
    /// What each layer or file was taken for.
    pub matches: Vec<LayerMatch>,
    /// What looks wrong or was added, one line each, for people.
    pub warnings: Vec<String>,
    /// Relative L2 difference between the sum of lights and the image under all lights, where there is one.
    pub sum_difference: Option<f64>,
}

impl ImportedMatrix {
    /// Makes a matrix of images, in blocks of `block_side` pixels. `source` is their name, for the provenance; the
    /// temporary file is made beside `beside`.
    ///
    /// The sum of lights is held against the image under all lights, where there is one; what is missing becomes a light of
    /// its own, called `Rest`.
    ///
    /// What reading takes and the disk for packing with `options` too is admitted before anything is read.
    ///
    /// # Errors
    /// Values that are not finite, naming the light; sizes beyond what a matrix can have; a budget that does not
    /// hold one image as its decoder wants it, or in which the images could not be packed then; a disk without room;
    /// those of the readers in `image`.
    pub fn read(
        set: &LightSet,
        source: &str,
        beside: &Path,
        block_side: u32,
        options: &PackOptions,
        watch: &dyn Watch,
    ) -> Result<Self> {
        let mut need = reading_need(set);
        let packing = packing_need(set, block_side, options)?;
        need.most_disk_bytes = need.disk_bytes + packing.most_disk_bytes;
        need.disk_bytes += packing.disk_bytes;
        let there = spill_path(beside);
        let threads = need.admit("reading the images, then packing", beside, &[&there], options.memory_bytes, watch)?;
        let (width, height) = (set.width as usize, set.height as usize);
        let shape = MatrixShape::new(set.width, set.height, set.lights.len() as u32, block_side)?;
        let rows = RowSpill::create(beside, set.images(), width, height)?;
        let mut looks = vec![Look::default(); set.images()];
        watch.begin("reading images", (set.images() * height) as u64, "rows");
        let mut take = |row: LightRow<'_>| {
            if watch.interrupted() {
                return Err(Error::Interrupted("nothing was written".into()));
            }
            if let Some(at) = row.values.iter().position(|v| !v.is_finite()) {
                let name =
                    set.lights.get(row.image).map_or("under all lights".to_owned(), |l| format!("of light '{l}'"));
                let problem = format!("the image {name} is not finite at pixel {}, {}", row.x + at, row.y);
                return Err(Error::input(source, problem, "render it again, or replace the pixel"));
            }
            looks[row.image].add(row.values);
            let done = usize::from(row.channel + 1 == CHANNELS && row.x + row.values.len() == width);
            watch.advance(done as u64, size_of_val(row.values) as u64, "B");
            rows.write((row.image, row.channel, row.y), row.x, row.values)
        };
        let result = Threads::new(threads)?.run(|| set.read(&mut take));
        watch.end();
        result?;
        let mut imported = Self {
            job: Job { shape, basis: LightBasis::new(), provenance: Provenance::default() },
            rows,
            matches: set.matches.clone(),
            warnings: set.warnings.clone(),
            sum_difference: None,
        };
        imported.warnings.extend(set.lights.iter().zip(&looks).flat_map(|(light, look)| look.warnings(light)));
        let denoised = |m: &LayerMatch| ["denois", "noisy"].iter().any(|word| m.layer.to_lowercase().contains(word));
        if set.matches.iter().any(denoised) {
            imported.warnings.push("the file has denoising passes: denoised light groups no longer add up".into());
        }
        imported.add_up(set, source)?;
        Ok(imported)
    }

    /// What the matrix is.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Goes over all rows once more: holds the sum of lights against the image under all lights, which it replaces by
    /// what is missing, and makes the job.
    fn add_up(&mut self, set: &LightSet, source: &str) -> Result<()> {
        let lights = set.lights.len();
        let (mut content, mut squared_rest, mut squared_sum) = (Sha256::new(), 0.0, 0.0);
        let squares = |row: &[f32]| row.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
        let mut row = vec![0.0; set.width as usize];
        let mut rest = row.clone();
        for y in 0..set.height as usize {
            for channel in 0..CHANNELS {
                if set.has_sum {
                    self.rows.read((lights, channel, y), 0, &mut rest)?;
                    squared_sum += squares(&rest);
                }
                for light in 0..lights {
                    self.rows.read((light, channel, y), 0, &mut row)?;
                    content.update(bytemuck::cast_slice(&row));
                    rest.iter_mut().zip(&row).for_each(|(rest, v)| *rest -= v);
                }
                if set.has_sum {
                    squared_rest += squares(&rest);
                    self.rows.write((lights, channel, y), 0, &rest)?;
                }
                rest.fill(0.0);
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
        Ok(())
    }
}

/// What reading images takes; they wait on disk.
fn reading_need(set: &LightSet) -> Need {
    let disk_bytes = RowSpill::bytes(set.images(), set.width as usize, set.height as usize);
    let fixed_bytes = PROGRAM_BYTES.saturating_add(set.needs_bytes());
    Need { fixed_bytes, per_thread_bytes: set.needs_bytes_per_thread(), disk_bytes, ..Need::default() }
}

/// What packing the images takes.
///
/// # Errors
/// The memory that `options` allow is too small; sizes beyond what a matrix can have; unusable settings.
fn packing_need(set: &LightSet, block_side: u32, options: &PackOptions) -> Result<Need> {
    let mut names = set.lights.clone();
    if set.has_sum {
        names.push(name_of_rest(&names));
    }
    let shape = MatrixShape::new(set.width, set.height, names.len() as u32, block_side)?;
    let compressor = Compressor::new(&basis_of(&names)?, shape, options.compress.clone())?;
    let need = pack::need_of(&compressor, shape, Need::default());
    need.threads_within("packing", options.memory_bytes)?;
    Ok(need)
}

/// `Rest`, or with a number where a light is called so.
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

impl BlockSource for ImportedMatrix {
    fn shape(&self) -> MatrixShape {
        self.job.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let rect = self.job.shape.rect(id);
        target.block.reset(rect.rows(), self.job.shape.columns());
        target.noise = None;
        target.planes = None;
        let (width, height) = (rect.width as usize, rect.height as usize);
        for (light, column) in target.block.entries_mut().chunks_exact_mut(rect.rows()).enumerate() {
            for (row, piece) in column.chunks_exact_mut(width).enumerate() {
                let (channel, y) = (row / height, rect.y as usize + row % height);
                self.rows.read((light, channel, y), rect.x as usize, piece)?;
            }
        }
        Ok(())
    }
}

/// What is noted of an image while it goes by.
#[derive(Clone, Debug, Default)]
struct Look {
    values: usize,
    negative: usize,
    largest: f32,
    /// Values that are exactly the largest.
    at_largest: usize,
}

impl Look {
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

    /// What looks wrong: many values at exactly the largest, values below zero.
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
            warnings.push(format!("light '{light}' has {count} values below zero, as denoising leaves them"));
        }
        warnings
    }
}
