//! A container as a web page: preview, exposure, files.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::compress::{CompressSettings, Target};
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::files::{check_output, replace, write_file};
use crate::image::{LUMENS_PER_WATT, exposure_for};
use crate::light::{Job, LightUnit, Lighting};
use crate::matrix::{BlockId, BlockSource, CHANNELS, ColumnIndex, FactorSource, MatrixShape, TracedBlock};
use crate::relight::relight_streaming;
use crate::resources::{MemoryNeed, Progress, ResourceEstimate};
use crate::share::{Level, SharedBytes, SharedLook, SharedPicture, page, page_with_data, write_data};

use super::{PackOptions, pack};

/// Least reduction of the preview, across and down, and its pixels at most.
const LEAST_SHRINK: u32 = 4;
const MOST_PIXELS: u32 = 1 << 18;
/// PSNR in dB of the preview against the reduced image. It is visible for seconds only.
const PREVIEW_DB: f64 = 46.0;
/// Name of the page in its folder.
pub const PAGE_NAME: &str = "index.html";
/// Name of the data in the page's folder.
pub const DATA_NAME: &str = "picture.lts";

/// Options of a shared page.
#[derive(Clone, Debug, Default)]
pub struct ShareOptions {
    /// Title of the page.
    pub title: String,
    /// Looks that the page offers.
    pub looks: Vec<SharedLook>,
    /// Groups of lights: name, and indices into the basis. A light is in at most one.
    pub groups: Vec<(String, Vec<usize>)>,
    /// Initial exposure of the page in stops; `None` for that of the window.
    pub exposure_stops: Option<f32>,
    /// One HTML file with the data inside, instead of a folder.
    pub single: bool,
    /// Replace files that exist.
    pub overwrite: bool,
    /// Limit of anonymous memory in bytes; `None` for what the system has available.
    pub memory_bytes: Option<u64>,
}

/// Result of sharing.
#[derive(Clone, Debug)]
pub struct ShareReport {
    /// The file to open.
    pub page: PathBuf,
    /// Bytes of all files together.
    pub total_bytes: u64,
    /// Bytes of the page alone, without data.
    pub page_bytes: u64,
    /// Bytes of the data.
    pub data: SharedBytes,
}

/// Writes a container as a web page: `index.html` and `picture.lts` in the folder `output`, which is created if needed,
/// or a single HTML file `output`.
///
/// # Errors
/// The container holds only a range of blocks, or is damaged; files exist and may not be replaced; [`Error::Resources`]
/// if the memory is too small; the system refuses to write. A file that existed is then unchanged, or replaced
/// completely.
///
/// # Panics
/// Never: data that were written without an error are counted.
pub fn share(
    container: &ContainerReader,
    output: &Path,
    options: &ShareOptions,
    watch: &dyn Progress,
) -> Result<ShareReport> {
    let job = container.job();
    if let Some(id) = job.shape.blocks().find(|&id| !container.has_block(id)) {
        let problem = format!("holds a range of blocks only, without {id}");
        return Err(Error::input("the container", problem, "merge it with the others first"));
    }
    let (page_path, data_path) = match options.single {
        true => (output.to_owned(), None),
        false => (output.join(PAGE_NAME), Some(output.join(DATA_NAME))),
    };
    match &data_path {
        Some(data_path) => {
            if output.is_dir() {
                check_output(data_path, options.overwrite)?;
                check_output(&page_path, options.overwrite)?;
            } else {
                check_output(output, false)?;
            }
        }
        None => check_output(output, options.overwrite)?,
    }
    let need = ResourceEstimate::of(&[&Sharing { container, single: options.single }]);
    need.threads_within("sharing", options.memory_bytes)?;

    let folder = tempfile::tempdir().map_err(Error::io(output, "make a temporary folder for"))?;
    let preview = preview_of(container, &folder.path().join("preview.ltc"), options.memory_bytes, watch)?;
    let (small, whole) = (level_of(&preview)?, level_of(container)?);
    // During a stage Ctrl-C returns an error instead of ending the process, so that the temporary folder is removed.
    watch.begin("sharing", small.bytes() + whole.bytes(), "bytes");
    let exposure_stops = match options.exposure_stops {
        Some(stops) => Ok(stops),
        None => relight_streaming(container, &Lighting::of_scene(&job.basis)).map(|relit| exposure_for(&relit.0)),
    };
    let exposure_stops = exposure_stops.inspect_err(|_| watch.end())?;
    let picture = SharedPicture {
        title: &options.title,
        job,
        looks: &options.looks,
        groups: &options.groups,
        shrink: shrink_of(job.shape),
        exposure_stops,
        lumens_per_watt: lumens_per_watt(job),
    };
    let mut advance = |bytes: u64| {
        watch.advance(bytes, bytes, "B");
        match watch.interrupted() {
            true => Err(interrupted()),
            false => Ok(()),
        }
    };
    let mut write = |path: &Path, out: &mut dyn Write| {
        write_data(&picture, &small, &whole, out, &|error| Error::io(path, "write")(error), &mut advance)
    };
    let written = match &data_path {
        Some(data_path) => {
            let is_new = !output.is_dir();
            if is_new {
                let made = fs::create_dir(output).map_err(Error::io(output, "make the folder"));
                made.inspect_err(|_| watch.end())?;
            }
            let mut bytes = None;
            let written = replace(data_path, options.overwrite, |file| {
                bytes = Some(write(data_path, file)?);
                Ok(())
            });
            let html = page(&options.title, DATA_NAME);
            let page_bytes = html.len() as u64;
            written
                .and_then(|()| write_file(&page_path, options.overwrite, html.as_bytes()))
                .inspect_err(|_| {
                    if is_new {
                        // Kept if the data are in it already.
                        let _ = fs::remove_dir(output);
                    }
                })
                .map(|()| (bytes.expect("it was written"), page_bytes, page_bytes))
        }
        None => {
            let mut data = Vec::new();
            write(&page_path, &mut data).and_then(|bytes| {
                let html = page_with_data(&options.title, &data);
                let page_bytes = page_with_data(&options.title, &[]).len() as u64;
                write_file(&page_path, options.overwrite, html.as_bytes())?;
                Ok((bytes, page_bytes, html.len() as u64 - bytes.total))
            })
        }
    };
    watch.end();
    let (data, page_bytes, beside) = written?;
    Ok(ShareReport { page: page_path, total_bytes: data.total + beside, page_bytes, data })
}

fn level_of(source: &ContainerReader) -> Result<Level<'_>> {
    Level::new(source, |id| (source.rank(id), source.sparse_entries(id)))
}

/// What sharing a container takes.
struct Sharing<'a> {
    container: &'a ContainerReader,
    single: bool,
}

impl MemoryNeed for Sharing<'_> {
    /// The index, an image, a block of the preview with its inputs and its compressor, and three copies of the data if they go
    /// into the page.
    fn fixed_bytes(&self) -> u64 {
        let shape = self.container.job().shape;
        let block = (shape.max_block_rows() * (shape.columns() + 64) * 4) as u64;
        let data = if self.single { 3 * self.container.file_bytes() } else { 0 };
        self.container.fixed_bytes() + 2 * shape.rows() * 4 + 6 * block + data
    }
}

/// The factor to cd/m² luminance, if a weight of 1 on each light is a physical quantity and pixels are radiances.
fn lumens_per_watt(job: &Job) -> Option<f32> {
    let is_known = |unit| match unit {
        LightUnit::Radiance | LightUnit::Irradiance => true,
        // Intensity falls with the squared distance, whose unit must be known.
        LightUnit::Intensity => job.provenance.metres_per_unit > 0.0,
        LightUnit::Multiple => false,
    };
    job.basis.lights().iter().all(|light| is_known(light.unit)).then_some(LUMENS_PER_WATT)
}

/// Packs the reduced image.
fn preview_of(
    container: &ContainerReader,
    path: &Path,
    memory_bytes: Option<u64>,
    watch: &dyn Progress,
) -> Result<ContainerReader> {
    let job = container.job();
    let shrink = shrink_of(job.shape);
    let side = |pixels: u32| pixels.div_ceil(shrink);
    let shape = MatrixShape::new(
        side(job.shape.width()),
        side(job.shape.height()),
        job.shape.columns() as u32,
        job.shape.block_side(),
    )?;
    let small = Shrunk { container, shape, shrink };
    let compress =
        CompressSettings { target: Target::PsnrDb(PREVIEW_DB), noise_factor: None, ..CompressSettings::default() };
    let options = PackOptions { compress, allow_lost_lights: true, denoise: false, memory_bytes, ..Default::default() };
    let packed = pack(&small, &Job { shape, ..job.clone() }, path, &options, &Preview(watch));
    packed.map_err(|error| if watch.interrupted() { interrupted() } else { error })?;
    ContainerReader::open(path)
}

fn interrupted() -> Error {
    Error::interrupted("nothing was written")
}

/// Reports progress of the preview, but not messages on its temporary files.
struct Preview<'a>(&'a dyn Progress);

impl Progress for Preview<'_> {
    fn begin(&self, _: &str, total: u64, unit: &str) {
        self.0.begin("preview", total, unit);
    }

    fn advance(&self, steps: u64, work: u64, work_unit: &str) {
        self.0.advance(steps, work, work_unit);
    }

    fn end(&self) {
        self.0.end();
    }

    fn note(&self, _: &str) {}

    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// The matrix of a container at reduced resolution: each pixel is the mean of a square of pixels.
struct Shrunk<'a> {
    container: &'a ContainerReader,
    shape: MatrixShape,
    shrink: u32,
}

/// Pixels of the picture for one of its preview, across and down: so many that what comes first does not grow with the picture.
fn shrink_of(shape: MatrixShape) -> u32 {
    let mut shrink = LEAST_SHRINK;
    while u64::from(shape.width().div_ceil(shrink)) * u64::from(shape.height().div_ceil(shrink))
        > u64::from(MOST_PIXELS)
    {
        shrink *= 2;
    }
    shrink
}

impl BlockSource for Shrunk<'_> {
    fn shape(&self) -> MatrixShape {
        self.shape
    }

    fn read_block(&self, id: BlockId, target: &mut TracedBlock) -> Result<()> {
        let (small, whole, shrink) = (self.shape.rect(id), self.container.shape(), self.shrink);
        (target.noise, target.planes) = (None, None);
        target.block.reset(small.rows(), whole.columns());
        // Blocks have the same side in both, so that those of the image lie within one of the preview.
        let (across, side) = (whole.blocks_across(), whole.block_side());
        let last = |begin: u32, length: u32, whole: u32| ((begin + length) * shrink).min(whole).div_ceil(side);
        for row in small.y * shrink / side..last(small.y, small.height, whole.height()) {
            for column in small.x * shrink / side..last(small.x, small.width, whole.width()) {
                let id = BlockId(row * across + column);
                let rect = whole.rect(id);
                let mut block = self.container.read_block(id)?;
                // Target and share of each of its pixels.
                let places: Vec<(usize, f32)> = (0..rect.height)
                    .flat_map(|y| (0..rect.width).map(move |x| (rect.x + x, rect.y + y)))
                    .map(|(x, y)| {
                        let (x, y) = (x / shrink, y / shrink);
                        let joined = |at: u32, whole: u32| (whole - at * shrink).min(shrink);
                        let share = 1.0 / (joined(x, whole.width()) * joined(y, whole.height())) as f32;
                        (((y - small.y) * small.width + x - small.x) as usize, share)
                    })
                    .collect();
                let (pixels, small_pixels) = (rect.pixels(), small.pixels());
                let place = |row: usize| {
                    let (at, share) = places[row % pixels];
                    (row / pixels * small_pixels + at, share)
                };
                block.rows = rect.rows();
                for k in 0..block.rank() {
                    let mut left = vec![0.0f32; CHANNELS * small_pixels];
                    for (row, value) in block.left_component(k).iter().enumerate() {
                        let (at, share) = place(row);
                        left[at] += value * share;
                    }
                    for (j, &weight) in block.right_component(k).iter().enumerate() {
                        let entries = target.block.column_mut(ColumnIndex(j as u32));
                        entries.iter_mut().zip(&left).for_each(|(entry, left)| *entry += left * weight);
                    }
                }
                for entry in &block.sparse {
                    let (at, share) = place(entry.row as usize);
                    target.block.column_mut(entry.column)[at] += entry.value * share;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_the_page_asks_for() {
        assert!(page("t", DATA_NAME).contains("content=\"picture.lts\""));
    }
}
