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
#[cfg(feature = "scene")]
use crate::scene::{Camera, Projection};
use crate::share::{Level, SharedBytes, SharedLook, SharedPicture, page, page_with_data, write_data};

use super::{PackOptions, pack};

/// Least reduction of the preview, across and down, and its pixels at most.
const LEAST_SHRINK: u32 = 4;
const MOST_PIXELS: u32 = 1 << 18;
/// PSNR in dB of the preview against the reduced image. It is visible for seconds only.
const PREVIEW_DB: f64 = 46.0;
/// Name of the page in its folder.
pub const PAGE_NAME: &str = "index.html";
/// Name of the data in the page's folder; see [`data_name`].
pub const DATA_NAME: &str = "picture.lts";

/// Name of the data of a view in the page's folder: [`DATA_NAME`] of the first, `picture-2.lts` of the second, and so on.
pub fn data_name(view: usize) -> String {
    if view == 0 { DATA_NAME.to_owned() } else { DATA_NAME.replace('.', &format!("-{}.", view + 1)) }
}

/// A container on a shared page.
#[derive(Clone, Debug)]
pub struct ShareView<'a> {
    /// The container.
    pub container: &'a ContainerReader,
    /// Text of its tab, if there are several.
    pub name: String,
    /// Looks that the page offers. Those of the same name are one in all views.
    pub looks: Vec<SharedLook>,
    /// Groups of lights: name, and indices into the basis. A light is in at most one.
    pub groups: Vec<(String, Vec<usize>)>,
}

impl<'a> ShareView<'a> {
    /// A container by itself, without looks and groups.
    pub fn of(container: &'a ContainerReader) -> Self {
        Self { container, name: String::new(), looks: Vec::new(), groups: Vec::new() }
    }
}

/// Options of a shared page.
#[derive(Clone, Debug, Default)]
pub struct ShareOptions {
    /// Title of the page.
    pub title: String,
    /// Initial exposure of the page in stops; `None` for that of the window over the first view.
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
    /// Bytes of the first view's data.
    pub data: SharedBytes,
}

/// Writes containers as a web page: `index.html` and the data of each ([`data_name`]) in the folder `output`, which is created if needed, or
/// a single HTML file `output`. Several are views of one scene, which the page shows as tabs under one mix.
///
/// # Errors
/// No view; a container holds only a range of blocks, or is damaged; files exist and may not be replaced; [`Error::Resources`]
/// if the memory is too small; the system refuses to write. A file that existed is then unchanged, or replaced
/// completely.
pub fn share(
    views: &[ShareView<'_>],
    output: &Path,
    options: &ShareOptions,
    watch: &dyn Progress,
) -> Result<ShareReport> {
    let Some(first) = views.first() else {
        return Err(Error::input("the page", "has no view", "name a container"));
    };
    for ShareView { container, name, .. } in views {
        if let Some(id) = container.job().shape.blocks().find(|&id| !container.has_block(id)) {
            let problem = format!("holds a range of blocks only, without {id}");
            return Err(Error::input(place_of(name), problem, "merge it with the others first"));
        }
    }
    check_outputs(views.len(), output, options)?;
    let need = ResourceEstimate::of(&[&Sharing { views, single: options.single }]);
    need.threads_within("sharing", options.memory_bytes)?;

    let folder = tempfile::tempdir().map_err(Error::io(output, "make a temporary folder for"))?;
    let preview = |(index, view): (usize, &ShareView<'_>)| {
        let path = folder.path().join(format!("preview{index}.ltc"));
        preview_of(view.container, &path, options.memory_bytes, watch)
    };
    let previews = views.iter().enumerate().map(preview).collect::<Result<Vec<_>>>()?;
    let mut levels = Vec::new();
    for (view, preview) in views.iter().zip(&previews) {
        levels.push((level_of(preview)?, level_of(view.container)?));
    }
    // During a stage Ctrl-C returns an error instead of ending the process, so that the temporary folder is removed.
    watch.begin("sharing", levels.iter().map(|(small, whole)| small.bytes() + whole.bytes()).sum(), "bytes");
    let scene = Lighting::of_scene(&first.container.job().basis);
    let exposure = match options.exposure_stops {
        Some(stops) => Ok(stops),
        None => relight_streaming(first.container, &scene).map(|relit| exposure_for(&relit.0)),
    };
    let report = exposure.and_then(|exposure_stops| {
        let sharing = Page { views, levels: &levels, exposure_stops, options, watch };
        if options.single { sharing.write_file(output) } else { sharing.write_folder(output) }
    });
    watch.end();
    report
}

/// What an error calls a view.
fn place_of(name: &str) -> String {
    if name.is_empty() { "the container".into() } else { format!("the container '{name}'") }
}

/// Refuses to write over what may not be replaced.
fn check_outputs(views: usize, output: &Path, options: &ShareOptions) -> Result<()> {
    if options.single {
        return check_output(output, options.overwrite);
    }
    if !output.is_dir() {
        return check_output(output, false);
    }
    (0..views).try_for_each(|view| check_output(&output.join(data_name(view)), options.overwrite))?;
    check_output(&output.join(PAGE_NAME), options.overwrite)
}

/// A page that is being written.
struct Page<'a> {
    views: &'a [ShareView<'a>],
    /// Preview and picture of each view.
    levels: &'a [(Level<'a>, Level<'a>)],
    exposure_stops: f32,
    options: &'a ShareOptions,
    watch: &'a dyn Progress,
}

impl Page<'_> {
    /// Writes the data of a view.
    fn write_view(&self, view: usize, path: &Path, out: &mut dyn Write) -> Result<SharedBytes> {
        let ShareView { container, looks, groups, .. } = &self.views[view];
        let picture = SharedPicture {
            title: &self.options.title,
            job: container.job(),
            looks,
            groups,
            shrink: shrink_of(container.job().shape),
            exposure_stops: self.exposure_stops,
            lumens_per_watt: lumens_per_watt(container.job()),
            is_panorama: is_panorama(container.job()),
        };
        let mut advance = |bytes: u64| {
            self.watch.advance(bytes, bytes, "B");
            if self.watch.interrupted() { Err(interrupted()) } else { Ok(()) }
        };
        let (small, whole) = &self.levels[view];
        write_data(&picture, small, whole, out, &|error| Error::io(path, "write")(error), &mut advance)
    }

    /// Writes the page and, beside it, the data.
    fn write_folder(&self, output: &Path) -> Result<ShareReport> {
        let (title, overwrite) = (&self.options.title, self.options.overwrite);
        let is_new = !output.is_dir();
        if is_new {
            fs::create_dir(output).map_err(Error::io(output, "make the folder"))?;
        }
        let names: Vec<String> = (0..self.views.len()).map(data_name).collect();
        let write = || {
            let mut bytes = Vec::new();
            for (view, name) in names.iter().enumerate() {
                let path = output.join(name);
                replace(&path, overwrite, |file| {
                    bytes.push(self.write_view(view, &path, file)?);
                    Ok(())
                })?;
            }
            let named: Vec<_> = self.views.iter().zip(&names).map(|(view, file)| (&*view.name, &**file)).collect();
            let html = page(title, &named);
            let path = output.join(PAGE_NAME);
            write_file(&path, overwrite, html.as_bytes())?;
            let (data, page_bytes) = (bytes[0], html.len() as u64);
            let total_bytes = bytes.iter().map(|own| own.total).sum::<u64>() + page_bytes;
            Ok(ShareReport { page: path, total_bytes, page_bytes, data })
        };
        write().inspect_err(|_| {
            if is_new {
                // Kept if data are in it already.
                let _ = fs::remove_dir(output);
            }
        })
    }

    /// Writes the page with the data inside.
    fn write_file(&self, output: &Path) -> Result<ShareReport> {
        let (mut all, mut bytes) = (Vec::new(), Vec::new());
        for view in 0..self.views.len() {
            let mut data = Vec::new();
            bytes.push(self.write_view(view, output, &mut data)?);
            all.push(data);
        }
        let named: Vec<_> = self.views.iter().zip(&all).map(|(view, data)| (&*view.name, &**data)).collect();
        let html = page_with_data(&self.options.title, &named);
        let bare: Vec<_> = named.iter().map(|(name, _)| (*name, &[][..])).collect();
        let page_bytes = page_with_data(&self.options.title, &bare).len() as u64;
        write_file(output, self.options.overwrite, html.as_bytes())?;
        Ok(ShareReport { page: output.to_owned(), total_bytes: html.len() as u64, page_bytes, data: bytes[0] })
    }
}

fn level_of(source: &ContainerReader) -> Result<Level<'_>> {
    Level::new(source, |id| (source.rank(id), source.sparse_entries(id)))
}

/// What sharing containers takes.
struct Sharing<'a> {
    views: &'a [ShareView<'a>],
    single: bool,
}

impl MemoryNeed for Sharing<'_> {
    /// The indices, an image, a block of the preview with its inputs and its compressor, and three copies of the data if they go
    /// into the page.
    fn fixed_bytes(&self) -> u64 {
        let of_view = |view: &ShareView<'_>| {
            let shape = view.container.job().shape;
            let block = (shape.max_block_rows() * (shape.columns() + 64) * 4) as u64;
            2 * shape.rows() * 4 + 6 * block
        };
        let kept = |view: &ShareView<'_>| {
            let data = if self.single { 3 * view.container.file_bytes() } else { 0 };
            view.container.fixed_bytes() + data
        };
        self.views.iter().map(of_view).max().unwrap_or(0) + self.views.iter().map(kept).sum::<u64>()
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

/// Whether the camera that the job states sees all directions; `None` if it states none.
#[cfg(feature = "scene")]
fn is_panorama(job: &Job) -> Option<bool> {
    Some(Camera::of_job(job)?.projection == Projection::Panorama)
}

/// Cameras are those of scenes.
#[cfg(not(feature = "scene"))]
fn is_panorama(_: &Job) -> Option<bool> {
    None
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
        assert!(page("t", &[("", DATA_NAME)]).contains("content=\"picture.lts\">"));
        let names = [data_name(0), data_name(1)];
        assert_eq!(names, ["picture.lts", "picture-2.lts"]);
        let two = page("t", &[("a", &names[0]), ("\"b\"", &names[1])]);
        assert!(two.contains("content=\"picture-2.lts\" data-view=\"&quot;b&quot;\">"));
    }
}
