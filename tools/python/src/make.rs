//! Making, checking and joining files.

use std::path::{Path, PathBuf};

use ltm::compress::Target;
use ltm::light::DescribedSource;
use ltm::matrix::{BlockSink, BlockSource, CHANNELS, TracedBlock};
use ltm::pipeline::{self, PackOptions, PackReport, RenderOptions, RenderReport};
use ltm::resources::{Progress, parse_bytes};
use ltm::scene::{BuiltIn, LoadOptions, LoadedScene};
use ltm::store::{self, StoreOptions, StoreReader, StoreWriter};
use ltm::{Error, MemoryMatrix, Result, container};
use numpy::PyReadonlyArrayDyn;
use numpy::prelude::*;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::exception;
use crate::light::{LightTuple, basis_of};
use crate::watch::run;
use crate::words::in_arguments;

/// Options of packing as Python gives them.
#[derive(Clone, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PackChoices {
    target: Option<String>,
    rank: Option<usize>,
    keep_noise: bool,
    denoise: bool,
    basis: Option<PathBuf>,
    overwrite: bool,
    memory_bytes: Option<u64>,
}

impl PackChoices {
    pub(crate) fn options(&self) -> Result<PackOptions> {
        let mut options = PackOptions {
            denoise: self.denoise && !self.keep_noise,
            basis: self.basis.clone(),
            memory_bytes: self.memory_bytes,
            ..PackOptions::default()
        };
        if let Some(target) = &self.target {
            options.compress.target = target_of(target)?;
        }
        options.compress.rank = self.rank.unwrap_or(options.compress.rank);
        if self.keep_noise {
            options.compress.noise_factor = None;
        }
        options.container.overwrite = self.overwrite;
        options.allow_lost_lights = self.overwrite;
        Ok(options)
    }
}

/// What a target says: a PSNR (45dB), a relative error below 1, or a size (2MiB).
fn target_of(text: &str) -> Result<Target> {
    let hint = "write a PSNR as 45dB, a relative error below 1 as 0.01, or a size as 2MiB";
    let refuse = || Error::input("target", format!("'{text}' is none"), hint);
    if let Some(decibels) = text.strip_suffix("dB").or_else(|| text.strip_suffix("db")) {
        return decibels.trim().parse().map(Target::PsnrDb).map_err(|_| refuse());
    }
    match text.parse::<f64>() {
        Ok(error) if error > 0.0 && error < 1.0 => Ok(Target::RelativeL2(error)),
        Ok(_) => Err(refuse()),
        Err(_) => parse_bytes(text).map(Target::Bytes).map_err(|_| refuse()),
    }
}

/// Runs `work` with a matrix in memory and the job that describes it.
fn with_images<T: Send>(
    py: Python<'_>,
    array: &PyReadonlyArrayDyn<'_, f32>,
    (lights, source, block_side): (Vec<LightTuple>, String, u32),
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&MemoryMatrix<'_>, &dyn Progress) -> Result<T> + Send,
) -> PyResult<T> {
    let &[columns, height, width, CHANNELS] = array.shape() else {
        return Err(PyValueError::new_err("the array has not the shape lights × height × width × 3"));
    };
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err("the array is not contiguous in C order"));
    }
    let (values, _) = array.as_slice()?.as_chunks::<CHANNELS>();
    run(py, progress, |watch| {
        let side = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        let basis = basis_of(lights)?;
        if basis.column_count() != columns {
            let problem = format!("have {} columns, the array {columns}", basis.column_count());
            return Err(Error::input("lights", problem, "give one name for each image"));
        }
        let program = format!("ltm for Python {}", env!("CARGO_PKG_VERSION"));
        let matrix = MemoryMatrix::from_array(values, (side(width), side(height)), basis)?;
        work(&matrix.with_block_side(block_side)?.made_by(source, program), watch)
    })
}

/// Packs an array into a container.
#[pyfunction]
#[pyo3(signature = (array, path, lights, source, block_side, choices, progress))]
#[allow(clippy::too_many_arguments, reason = "Python's layer passes what its users chose")]
pub(crate) fn pack_array<'py>(
    py: Python<'py>,
    array: PyReadonlyArrayDyn<'py, f32>,
    path: PathBuf,
    lights: Vec<LightTuple>,
    source: String,
    block_side: u32,
    choices: PackChoices,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let options = choices.options().map_err(|error| exception(&error))?;
    let report = with_images(py, &array, (lights, source, block_side), progress.as_ref(), |matrix, watch| {
        pipeline::pack(matrix, matrix.job(), &path, &options, watch)
    })?;
    pack_report(py, &report)
}

/// Writes an array as a stored matrix.
#[pyfunction]
#[pyo3(signature = (array, path, lights, source, block_side, overwrite, progress))]
#[allow(clippy::too_many_arguments, reason = "Python's layer passes what its users chose")]
pub(crate) fn write_array<'py>(
    py: Python<'py>,
    array: PyReadonlyArrayDyn<'py, f32>,
    path: PathBuf,
    lights: Vec<LightTuple>,
    source: String,
    block_side: u32,
    overwrite: bool,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<()> {
    with_images(py, &array, (lights, source, block_side), progress.as_ref(), |matrix, watch| {
        let job = matrix.job();
        let writer = StoreWriter::create_or_resume(&path, job, StoreOptions { overwrite, ..Default::default() })?;
        watch.begin("writing", u64::from(job.shape.block_count()), "blocks");
        let mut block = TracedBlock::default();
        for id in job.shape.blocks() {
            if watch.interrupted() {
                return Err(Error::interrupted_keeping("what is written stays"));
            }
            if writer.is_committed(id) {
                watch.advance(1, 0, "B");
                continue;
            }
            matrix.read_block(id, &mut block)?;
            writer.write_block(id, &block)?;
            watch.advance(1, 0, "B");
        }
        watch.end();
        writer.finish().map(|_| ())
    })
}

/// Packs a stored matrix into a container.
#[pyfunction]
pub(crate) fn pack_store<'py>(
    py: Python<'py>,
    matrix: PathBuf,
    path: PathBuf,
    choices: PackChoices,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let options = choices.options().map_err(|error| exception(&error))?;
    let report = run(py, progress.as_ref(), |watch| {
        let matrix = StoreReader::open(&matrix)?;
        pipeline::pack(&matrix, matrix.job(), &path, &options, watch)
    })?;
    pack_report(py, &report)
}

/// Writes the images that denoising works on, with what their pixels show, as one OpenEXR file; says how many.
#[pyfunction]
pub(crate) fn write_basis(
    py: Python<'_>,
    matrix: PathBuf,
    path: PathBuf,
    memory_bytes: Option<u64>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<usize> {
    run(py, progress.as_ref(), |watch| pipeline::write_basis(&StoreReader::open(&matrix)?, &path, memory_bytes, watch))
}

/// A scene file, or a built-in scene: name, width, height, texels.
#[derive(FromPyObject)]
pub(crate) enum SceneChoice {
    BuiltIn((String, u32, u32, u32)),
    File(PathBuf),
}

impl SceneChoice {
    fn load(self, options: LoadOptions) -> Result<LoadedScene> {
        match self {
            Self::BuiltIn((name, width, height, texels)) => BuiltIn { width, height, texels }.named(&name),
            Self::File(path) => pipeline::load_scene(&path, options),
        }
    }
}

/// How a scene is rendered, as Python gives it; none: as the scene says.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RenderChoices {
    samples: Option<u32>,
    /// Width and height.
    size: Option<(u32, u32)>,
    seed: Option<u64>,
    block_side: Option<u32>,
    camera: Option<String>,
    allow_missing: bool,
    allow_outside: bool,
    overwrite: bool,
    memory_bytes: Option<u64>,
}

/// A scene with what was chosen in place of its own settings.
pub(crate) fn load_with_choices(
    scene: SceneChoice,
    choices: RenderChoices,
    watch: &dyn Progress,
) -> Result<LoadedScene> {
    let RenderChoices { samples, size, seed, block_side, camera, allow_missing, allow_outside, memory_bytes, .. } =
        choices;
    let mut loaded = scene.load(LoadOptions { allow_missing, allow_outside, memory_bytes, camera, grid: None })?;
    loaded.warnings.iter().for_each(|warning| watch.warn(warning));
    if let Some((width, height)) = size {
        loaded = loaded.sized(width, height);
    }
    let settings = &mut loaded.settings;
    settings.samples_per_pixel = samples.unwrap_or(settings.samples_per_pixel);
    settings.seed = seed.unwrap_or(settings.seed);
    settings.block_side = block_side.unwrap_or(settings.block_side);
    Ok(loaded)
}

/// Renders a scene into a stored matrix or, with `pack`, into a container.
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    scene: SceneChoice,
    path: PathBuf,
    choices: RenderChoices,
    pack: Option<PackChoices>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let pack = pack.map(|choices| choices.options()).transpose().map_err(|error| exception(&error))?;
    let RenderChoices { overwrite, memory_bytes, .. } = choices;
    let (render, packed) = run(py, progress.as_ref(), |watch| {
        let loaded = load_with_choices(scene, choices, watch)?;
        match pack {
            Some(options) => {
                let (render, packed) = pipeline::render_packed(loaded, &path, &options, watch)?;
                Ok((render, Some(packed)))
            }
            None => {
                let store = StoreOptions { overwrite, ..Default::default() };
                let options = RenderOptions { store, memory_bytes, ..Default::default() };
                Ok((pipeline::render(loaded, &path, &options, watch)?, None))
            }
        }
    })?;
    let report = match packed {
        Some(packed) => pack_report(py, &packed)?,
        None => PyDict::new(py),
    };
    let RenderReport { seconds, rays, blocks_traced, blocks_kept, non_finite, .. } = render;
    report.set_item("seconds", seconds)?;
    report.set_item("rays", rays)?;
    report.set_item("blocks_traced", blocks_traced)?;
    report.set_item("blocks_kept", blocks_kept)?;
    report.set_item("non_finite", non_finite)?;
    Ok(report)
}

fn pack_report<'py>(py: Python<'py>, report: &PackReport) -> PyResult<Bound<'py, PyDict>> {
    let said = PyDict::new(py);
    said.set_item("seconds", report.seconds)?;
    said.set_item("raw_bytes", report.raw_bytes)?;
    said.set_item("packed_bytes", report.packed_bytes)?;
    said.set_item("mean_rank", report.mean_rank)?;
    said.set_item("sparse_entries", report.sparse_entries)?;
    said.set_item("relative_l2", report.relative_l2)?;
    said.set_item("replaced_entries", report.replaced.count())?;
    said.set_item("short_of_target", report.short_of_target.map(|shortfall| shortfall.warning().worded(in_arguments)))?;
    said.set_item("blocks_kept", report.blocks_kept)?;
    Ok(said)
}

fn is_container(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ltc"))
}

/// Checks every byte of a file: blocks looked at, faults, blocks missing, bytes, seconds.
#[pyfunction]
pub(crate) fn verify(
    py: Python<'_>,
    path: PathBuf,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(u32, Vec<String>, usize, u64, f64)> {
    let found = run(py, progress.as_ref(), |watch| match is_container(&path) {
        true => pipeline::verify_container(&path, None, watch),
        false => pipeline::verify(&path, None, watch),
    })?;
    Ok((found.blocks, found.faults, found.missing, found.verified_bytes, found.seconds))
}

/// Joins parts of one job; says how many blocks the result has and how many it lacks.
#[pyfunction]
pub(crate) fn merge(
    py: Python<'_>,
    parts: Vec<PathBuf>,
    path: PathBuf,
    overwrite: bool,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(u32, usize)> {
    run(py, progress.as_ref(), |watch| {
        pipeline::admit_merge(&parts, None)?;
        let mut told = 0;
        let mut step = |done: u32, total: u32| {
            if told == 0 {
                watch.begin("joining", u64::from(total), "steps");
            }
            watch.advance(u64::from(done - told), 0, "B");
            told = done;
            !watch.interrupted()
        };
        if is_container(&path) {
            let parts: Vec<&Path> = parts.iter().map(PathBuf::as_path).collect();
            let joined = container::merge(&parts, &path, overwrite, &mut step)?;
            let all = container::ContainerReader::open(&path)?.job().shape.block_count();
            return Ok((joined.blocks, (all - joined.blocks) as usize));
        }
        let joined = store::merge(&parts, &path, &mut step)?;
        Ok((joined.blocks - joined.missing.len() as u32, joined.missing.len()))
    })
}
