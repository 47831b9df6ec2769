//! An open matrix, stored or packed.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use ltm::container::ContainerReader;
use ltm::light::{DenoiseErrors, DenoisedLight, Job, Lighting};
use ltm::matrix::{BlockId, CHANNELS, FEATURE_PLANES, FactorSource, MatrixShape, PixelRect};
use ltm::pipeline::{Features, PASSES, RelightOptions, passes_need_bytes, relight_passes};
use ltm::relight::{CpuRelighter, adjoint_raw, adjoint_streaming, relight_region_raw, relight_region_streaming};
use ltm::resources::{budget_bytes, hold_to_memory};
use ltm::scene::{Camera, Projection, in_file, stated_origin};
use ltm::store::StoreReader;
use ltm::{Error, MatrixFile, Result};
use numpy::prelude::*;
use numpy::{PyArray1, PyArrayDyn, PyReadonlyArrayDyn, PyReadwriteArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::daylight;
use crate::errors::{exception, unlocked};
use crate::gpu::{Device, OnGpu, adapter, second_run};
use crate::light::{LightTuple, lightings_of, to_tuple};
use crate::slice::{Wanted, read};
use crate::threads::on_pool;
use crate::watch::run;

/// Where the entries come from.
pub(crate) enum Source {
    Container(Arc<ContainerReader>),
    Matrix(Box<StoreReader>),
}

impl Source {
    /// Opens either kind, by its name or else by what it holds.
    fn open(path: &Path) -> Result<Self> {
        Ok(match MatrixFile::open(path)? {
            MatrixFile::Container(container) => Self::Container(Arc::from(container)),
            MatrixFile::Stored(matrix) => Self::Matrix(matrix),
        })
    }

    pub(crate) fn job(&self) -> &Job {
        match self {
            Self::Container(container) => container.job(),
            Self::Matrix(matrix) => matrix.job(),
        }
    }

    pub(crate) fn shape(&self) -> MatrixShape {
        self.job().shape
    }
}

/// A matrix and, once something was relit, its factors.
struct Opened {
    source: Source,
    /// None: not asked for yet.
    relighter: Mutex<Option<Option<Arc<CpuRelighter>>>>,
    gpu: Mutex<Gpu>,
    /// Held by the thread that relights on the GPU, one at a time.
    gpu_turn: Mutex<()>,
    memory_bytes: Option<u64>,
    gpu_memory_bytes: Option<u64>,
}

/// What is known of a matrix and the GPU.
#[derive(Default)]
struct Gpu {
    factors: Option<Arc<OnGpu>>,
    /// Whether it is what [`Device::Auto`] means; None: not tried yet.
    is_chosen: Option<bool>,
}

impl Opened {
    /// The factors, kept; none where they do not fit the memory, where some are damaged (what is strict then says so, of
    /// the blocks that are asked for), or where there are none.
    fn relighter(&self) -> Result<Option<Arc<CpuRelighter>>> {
        let Source::Container(container) = &self.source else { return Ok(None) };
        let shape = self.source.shape();
        let block = |id| {
            let values = container.rank(id) * (shape.rect(id).rows() + shape.columns());
            (values * 2 + container.sparse_entries(id) * 16 + 512) as u64
        };
        // Not from a thread of the pool: while one waits there it would take up other work, which may want this lock.
        let mut kept = self.relighter.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(decided) = &*kept {
            return Ok(decided.clone());
        }
        let fits = shape.blocks().map(block).sum::<u64>() <= budget_bytes(self.memory_bytes);
        let made = if fits { Some(on_pool(|| CpuRelighter::load(&**container))?) } else { None };
        let decided = made.filter(|made| made.damage().is_empty()).map(Arc::new);
        *kept = Some(decided.clone());
        Ok(decided)
    }

    /// The raw matrix. Errors: it is a container, which holds nothing of what is asked for.
    fn matrix(&self, asked: &str) -> Result<&StoreReader> {
        match &self.source {
            Source::Matrix(matrix) => Ok(matrix),
            Source::Container(_) => Err(Error::input(
                asked,
                "a container holds none",
                "open the .ltm that it was packed from, or one rendered without pack=True",
            )),
        }
    }

    fn relight(
        &self,
        device: Device,
        lightings: &[Lighting],
        region: PixelRect,
        pixels: &mut [[f32; CHANNELS]],
    ) -> Result<()> {
        if let Some(gpu) = self.on_gpu(device)? {
            match self.relight_on_gpu(&gpu, lightings, region, pixels) {
                // The CPU's strict way says what is damaged, or that it is not in the region.
                Ok(()) if gpu.is_damaged() => {}
                // A device that is lost is lost for good.
                Err(Error::NoGpu(_)) if device == Device::Auto => {
                    *self.lock_gpu() = Gpu { factors: None, is_chosen: Some(false) };
                }
                done => return done,
            }
        }
        self.relight_on_cpu(lightings, region, pixels)
    }

    fn relight_on_gpu(
        &self,
        gpu: &OnGpu,
        lightings: &[Lighting],
        region: PixelRect,
        pixels: &mut [[f32; CHANNELS]],
    ) -> Result<()> {
        // Not from a thread of the pool: the relighter locks itself and works on the pool, whose threads would take up another call
        // while they wait, and lock it again.
        let _turn = self.gpu_turn.lock().unwrap_or_else(PoisonError::into_inner);
        on_pool(|| gpu.relight(lightings, region, pixels))
    }

    fn relight_on_cpu(&self, lightings: &[Lighting], region: PixelRect, pixels: &mut [[f32; CHANNELS]]) -> Result<()> {
        let relighter = self.relighter()?;
        on_pool(|| match (&self.source, relighter) {
            (_, Some(relighter)) => relighter.relight_region(lightings, region, pixels),
            (Source::Container(container), None) => relight_region_streaming(&**container, lightings, region, pixels),
            (Source::Matrix(matrix), None) => relight_region_raw(&**matrix, lightings, region, pixels),
        })
    }

    fn lock_gpu(&self) -> MutexGuard<'_, Gpu> {
        self.gpu.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The factors on the GPU where they are to be used: where that is demanded, or where an adapter that is no software
    /// has relit the scene's own lighting faster than the CPU. Errors: it is demanded and cannot be.
    fn on_gpu(&self, device: Device) -> Result<Option<Arc<OnGpu>>> {
        let container = match (&self.source, device) {
            (_, Device::Cpu) | (Source::Matrix(_), Device::Auto) => return Ok(None),
            (Source::Matrix(_), Device::Gpu) => {
                let problem = "a GPU relights factors, and this is a stored matrix, which has none";
                return Err(Error::input("device", problem, "pack it, or use device='cpu'"));
            }
            (Source::Container(container), _) => container,
        };
        let open = || on_pool(|| OnGpu::open(container, self.memory_bytes, self.gpu_memory_bytes)).map(Arc::new);
        let mut held = self.lock_gpu();
        if device == Device::Gpu {
            if held.factors.is_none() {
                held.factors = Some(open()?);
            }
            return Ok(held.factors.clone());
        }
        if held.is_chosen.is_none() {
            let is_hardware = on_pool(adapter).is_ok_and(|adapter| !adapter.is_software);
            let made = match held.factors.clone() {
                _ if !is_hardware => None,
                Some(made) => Some(made),
                // Nothing is demanded: what does not work is not used.
                None => open().ok(),
            };
            let is_faster = made.as_ref().is_some_and(|made| self.is_faster(made));
            if is_faster {
                held.factors = made;
            }
            held.is_chosen = Some(is_faster);
        }
        Ok(held.factors.clone().filter(|_| held.is_chosen == Some(true)))
    }

    /// Not where one of the two fails: what is damaged is said where it is asked for.
    fn is_faster(&self, gpu: &OnGpu) -> bool {
        let shape = self.source.shape();
        let whole = PixelRect { x: 0, y: 0, width: shape.width(), height: shape.height() };
        let lighting = [Lighting::of_scene(&self.source.job().basis)];
        let mut pixels = vec![[0.0; CHANNELS]; whole.pixels()];
        let on_gpu = second_run(|| self.relight_on_gpu(gpu, &lighting, whole, &mut pixels));
        let on_cpu = second_run(|| self.relight_on_cpu(&lighting, whole, &mut pixels));
        on_gpu.ok().zip(on_cpu.ok()).is_some_and(|(on_gpu, on_cpu)| on_gpu < on_cpu)
    }

    fn adjoint(&self, images: &[[f32; CHANNELS]]) -> Result<Vec<[f64; CHANNELS]>> {
        let relighter = self.relighter()?;
        on_pool(|| match (&self.source, relighter) {
            (_, Some(relighter)) => relighter.adjoint(images),
            (Source::Container(container), None) => adjoint_streaming(&**container, images),
            (Source::Matrix(matrix), None) => adjoint_raw(&**matrix, images),
        })
    }
}

/// An open `.ltm` or `.ltc`, in exact types; `ltm.Matrix` is what users see.
#[pyclass(frozen, module = "ltm._ltm")]
pub(crate) struct Native {
    path: PathBuf,
    opened: RwLock<Option<Arc<Opened>>>,
}

impl Native {
    fn opened(&self) -> PyResult<Arc<Opened>> {
        let held = self.opened.read().unwrap_or_else(PoisonError::into_inner);
        held.clone().ok_or_else(|| PyValueError::new_err(format!("{}: the matrix is closed", self.path.display())))
    }
}

/// Errors of denoising as Python has them.
fn denoise_errors<'py>(py: Python<'py>, errors: &DenoiseErrors) -> PyResult<Bound<'py, PyDict>> {
    let DenoiseErrors { noise_before, noise_after, bias } = errors;
    let told = PyDict::new(py);
    told.set_item("noise_before", noise_before)?;
    told.set_item("noise_after", noise_after)?;
    told.set_item("bias", bias)?;
    Ok(told)
}

/// An array of `f32` whose values lie one after the other in C order.
pub(crate) fn contiguous<'a>(array: &'a PyReadonlyArrayDyn<'_, f32>) -> PyResult<&'a [f32]> {
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err("the array is not contiguous in C order"));
    }
    Ok(array.as_slice()?)
}

#[pymethods]
impl Native {
    #[new]
    #[pyo3(signature = (path, memory_bytes=None, gpu_memory_bytes=None))]
    fn new(py: Python<'_>, path: PathBuf, memory_bytes: Option<u64>, gpu_memory_bytes: Option<u64>) -> PyResult<Self> {
        let source = unlocked(py, || on_pool(|| Source::open(&path)))?;
        let (relighter, gpu) = (Mutex::new(None), Mutex::default());
        let opened = Opened { source, relighter, gpu, gpu_turn: Mutex::default(), memory_bytes, gpu_memory_bytes };
        Ok(Self { path, opened: RwLock::new(Some(Arc::new(opened))) })
    }

    /// Forgets the file; work that is under way ends first where it is.
    fn close(&self) {
        *self.opened.write().unwrap_or_else(PoisonError::into_inner) = None;
    }

    #[getter]
    fn closed(&self) -> bool {
        self.opened.read().unwrap_or_else(PoisonError::into_inner).is_none()
    }

    /// Height, width, columns, side of a block.
    fn shape(&self) -> PyResult<(u32, u32, usize, u32)> {
        let shape = self.opened()?.source.shape();
        Ok((shape.height(), shape.width(), shape.columns(), shape.block_side()))
    }

    fn lights(&self) -> PyResult<Vec<LightTuple>> {
        Ok(self.opened()?.source.job().basis.lights().iter().map(to_tuple).collect())
    }

    /// The weights of the scene's own lighting: columns × 3.
    fn scene_weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let weights = self.opened()?.source.job().basis.scene_weights();
        let shape = [weights.len(), CHANNELS];
        PyArray1::from_vec(py, weights.into_flattened()).reshape(shape.to_vec())
    }

    /// What is known beside the entries, as a dictionary.
    fn attrs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.opened()?;
        let job = opened.source.job();
        let known = PyDict::new(py);
        known.set_item("path", self.path.as_os_str())?;
        known.set_item("job", job.hash().0.map(|byte| format!("{byte:02x}")).concat())?;
        known.set_item("block_side", job.shape.block_side())?;
        let provenance = &job.provenance;
        known.set_item("source", &provenance.source)?;
        known.set_item("content", provenance.content.map(|byte| format!("{byte:02x}")).concat())?;
        known.set_item("program", &provenance.program)?;
        known.set_item("samples_per_pixel", provenance.samples_per_pixel)?;
        known.set_item("seed", provenance.seed)?;
        known.set_item("settings", &provenance.settings)?;
        known.set_item("metres_per_unit", provenance.metres_per_unit)?;
        let size = (job.shape.width(), job.shape.height());
        // From which the lights' places are counted.
        let origin = stated_origin(&provenance.settings);
        known.set_item("origin", origin.to_array())?;
        let camera = Camera::of_words(&provenance.settings, size).map(|camera| {
            let stated = PyDict::new(py);
            stated.set_item("eye", in_file(origin, camera.eye).to_array())?;
            stated.set_item("direction", camera.forward.to_array())?;
            stated.set_item("up", camera.up.to_array())?;
            stated.set_item("projection", camera.projection.name())?;
            match camera.projection {
                Projection::Perspective { vertical_fov_radians } => {
                    stated.set_item("vertical_fov_degrees", vertical_fov_radians.to_degrees())?;
                }
                Projection::Orthographic { height } => stated.set_item("view_height", height)?,
                Projection::Panorama => {}
            }
            stated.set_item("shift", camera.shift.to_array())?;
            stated.set_item("pixel_aspect", camera.pixel_aspect)?;
            if let Some(lens) = camera.lens {
                stated.set_item("aperture_radius", lens.radius)?;
                stated.set_item("focus_distance", lens.focus_distance)?;
                stated.set_item("blades", lens.blades)?;
                stated.set_item("blade_rotation_degrees", lens.rotation_radians.to_degrees())?;
            }
            Ok::<_, PyErr>(stated)
        });
        known.set_item("camera", camera.transpose()?)?;
        known.set_item("raw_bytes", job.shape.raw_bytes())?;
        match &opened.source {
            Source::Container(container) => {
                known.set_item("kind", "ltc")?;
                known.set_item("bytes", container.file_bytes())?;
                let report = container.report();
                known.set_item("packed_by", &report.program)?;
                known.set_item("method", &report.method)?;
                known.set_item("target", &report.target)?;
                known.set_item("prior", &report.prior)?;
                known.set_item("pack_settings", &report.settings)?;
                let figures = PyDict::new(py);
                report.provenance.iter().try_for_each(|(figure, origin)| figures.set_item(figure, origin))?;
                known.set_item("provenance_of_errors", figures)?;
                if let Some(errors) = &container.errors().denoising {
                    known.set_item("cleaning_errors", denoise_errors(py, errors)?)?;
                }
                let lights = container.job().basis.lights().iter().zip(&container.errors().denoised_lights);
                let of_lights = PyDict::new(py);
                for (light, DenoisedLight { errors, light_kept }) in lights {
                    let of_light = denoise_errors(py, errors)?;
                    of_light.set_item("light_kept", light_kept)?;
                    of_lights.set_item(&light.name, of_light)?;
                }
                known.set_item("cleaning_errors_of_lights", of_lights)?;
                if let Some(error) = container.errors().exposed {
                    let of_exposed = PyDict::new(py);
                    of_exposed.set_item("asked", error.asked)?;
                    of_exposed.set_item("reached", error.reached)?;
                    known.set_item("exposed_error", of_exposed)?;
                }
            }
            Source::Matrix(matrix) => {
                known.set_item("kind", "ltm")?;
                known.set_item("precision", matrix.precision().to_string())?;
                let tally = unlocked(py, || matrix.tally())?;
                known.set_item("bytes", tally.stored_bytes)?;
                known.set_item("blocks_committed", tally.committed)?;
                known.set_item("blocks_damaged", tally.damaged)?;
            }
        }
        Ok(known)
    }

    /// One block: x, y, width, height, whether it is there; of a container also rank, sparse entries, bytes, relative error
    /// and noise variance.
    #[allow(clippy::type_complexity, reason = "a tuple for Python, named there")]
    fn block(&self, index: u32) -> PyResult<((u32, u32, u32, u32), bool, Option<(usize, usize, u64, f64, f64)>)> {
        let opened = self.opened()?;
        let shape = opened.source.shape();
        if index >= shape.block_count() {
            return Err(pyo3::exceptions::PyIndexError::new_err(format!("there are {} blocks", shape.block_count())));
        }
        let id = BlockId(index);
        let PixelRect { x, y, width, height } = shape.rect(id);
        let (there, known) = match &opened.source {
            Source::Matrix(matrix) => (matrix.is_committed(id), None),
            Source::Container(container) => {
                let report = container.block_report(id);
                let bytes = container.encoded_bytes(id, 0..container.layer_count(id));
                let (rank, sparse) = (container.rank(id), container.sparse_entries(id));
                (container.has_block(id), Some((rank, sparse, bytes, report.relative_error(), report.noise_variance)))
            }
        };
        Ok(((x, y, width, height), there, known))
    }

    /// What pixels show beside light, or its variance: planes × height × width.
    fn features<'py>(&self, py: Python<'py>, variance: bool) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let opened = self.opened()?;
        let matrix = opened.matrix("the features").map_err(|error| exception(&error))?;
        let shape = opened.source.shape();
        let hold = hold_to_memory("the features", 2 * Features::needs_bytes(shape), opened.memory_bytes);
        hold.map_err(|error| exception(&error))?;
        let features =
            unlocked(py, || if variance { Features::read_variances(matrix) } else { Features::read(matrix) })?;
        let shape = vec![FEATURE_PLANES, shape.height() as usize, shape.width() as usize];
        PyArray1::from_slice(py, features.planes()).reshape(shape)
    }

    /// How the light of an image came, under one lighting: each pass by name, height × width × 3.
    fn passes<'py>(
        &self,
        py: Python<'py>,
        weights: PyReadonlyArrayDyn<'_, f32>,
    ) -> PyResult<Vec<(String, Bound<'py, PyArrayDyn<f32>>)>> {
        let opened = self.opened()?;
        let matrix = opened.matrix("the passes").map_err(|error| exception(&error))?;
        let shape = opened.source.shape();
        let lightings = lightings_of(contiguous(&weights)?, shape.columns()).map_err(|error| exception(&error))?;
        let [lighting] = &lightings[..] else { return Err(PyValueError::new_err("weights: not one lighting")) };
        // The arrays that are returned.
        let beside_bytes = passes_need_bytes(shape);
        let options = RelightOptions { memory_bytes: opened.memory_bytes, beside_bytes, ..RelightOptions::default() };
        let images = unlocked(py, || relight_passes(matrix, lighting, options))?;
        let named = PASSES.into_iter().zip(images).map(|(name, image)| {
            let shape = vec![image.height as usize, image.width as usize, CHANNELS];
            Ok((name.to_lowercase(), PyArray1::from_slice(py, image.values()).reshape(shape)?))
        });
        named.collect()
    }

    /// The entries at ascending indices: rows × across × channels × columns.
    fn read<'py>(
        &self,
        py: Python<'py>,
        rows: Vec<u32>,
        across: Vec<u32>,
        channels: Vec<u32>,
        columns: Vec<u32>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let opened = self.opened()?;
        let shape = vec![rows.len(), across.len(), channels.len(), columns.len()];
        let wanted = Wanted { rows, across, channels, columns };
        let entries = wanted.check(opened.source.shape()).map_err(|error| exception(&error))?;
        let bytes = entries as u64 * 4;
        let hold = hold_to_memory("the slice", bytes, opened.memory_bytes);
        hold.map_err(|error| exception(&error))?;
        let entries = unlocked(py, || on_pool(|| read(&opened.source, &wanted)))?;
        PyArray1::from_vec(py, entries).reshape(shape)
    }

    /// Sets `out` (lightings × height × width × 3 of the region) from `weights` (lightings × columns × 3). The region is
    /// x, y, width, height; the device "auto", "cpu" or "gpu".
    fn relight(
        &self,
        py: Python<'_>,
        weights: PyReadonlyArrayDyn<'_, f32>,
        region: (u32, u32, u32, u32),
        mut out: PyReadwriteArrayDyn<'_, f32>,
        device: &str,
    ) -> PyResult<()> {
        let device = Device::parse(device)?;
        let opened = self.opened()?;
        let weights = contiguous(&weights)?;
        let lightings = lightings_of(weights, opened.source.shape().columns()).map_err(|error| exception(&error))?;
        if !out.is_c_contiguous() {
            return Err(PyValueError::new_err("the array is not contiguous in C order"));
        }
        let (pixels, _) = out.as_slice_mut()?.as_chunks_mut::<CHANNELS>();
        let (x, y, width, height) = region;
        let region = PixelRect { x, y, width, height };
        let shape = opened.source.shape();
        let ends = |at: u32, size: u32, limit: u32| size > 0 && at.checked_add(size).is_some_and(|end| end <= limit);
        if !ends(x, width, shape.width()) || !ends(y, height, shape.height()) {
            return Err(PyValueError::new_err("the region is empty or not inside the image"));
        }
        if pixels.len() != lightings.len() * region.pixels() {
            return Err(PyValueError::new_err("the target has another number of pixels than lightings × region"));
        }
        unlocked(py, || opened.relight(device, &lightings, region, pixels))
    }

    /// `Tᵀ x` of images (height × width × 3 each, one after the other): images × columns × 3.
    fn adjoint<'py>(
        &self,
        py: Python<'py>,
        images: PyReadonlyArrayDyn<'py, f32>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let opened = self.opened()?;
        let (pixels, _) = contiguous(&images)?.as_chunks::<CHANNELS>();
        let sums = unlocked(py, || opened.adjoint(pixels))?;
        let columns = opened.source.shape().columns();
        let shape = vec![sums.len() / columns, columns, CHANNELS];
        PyArray1::from_vec(py, sums.as_flattened().iter().map(|&sum| sum as f32).collect()).reshape(shape)
    }

    /// `weights` (columns × 3) with sky and sun as at a time of a climate: month, day, hour; north and the ground's reflectance.
    fn weights_at<'py>(
        &self,
        py: Python<'py>,
        weights: PyReadonlyArrayDyn<'_, f32>,
        climate: PathBuf,
        time: ((u8, u8), f64),
        site: (f64, f64),
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let opened = self.opened()?;
        let (lamps, _) = contiguous(&weights)?.as_chunks::<CHANNELS>();
        let (lamps, place) = (lamps.to_vec(), self.path.display().to_string());
        let lit = unlocked(py, || daylight::weights_at(&opened.source, &place, lamps, &climate, time, site))?;
        let shape = vec![lit.len(), CHANNELS];
        PyArray1::from_vec(py, lit.into_flattened()).reshape(shape)
    }

    /// The measures of a year of a climate, as a dictionary.
    fn daylight<'py>(
        &self,
        py: Python<'py>,
        climate: PathBuf,
        choices: daylight::YearChoices,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let opened = self.opened()?;
        let (place, memory) = (self.path.display().to_string(), opened.memory_bytes);
        let year = run(py, progress.as_ref(), |watch| {
            daylight::year(&opened.source, &place, &climate, &choices, memory, watch)
        })?;
        daylight::to_dict(py, &year)
    }

    /// The lightings of a look file, its own first: names and columns × 3 weights.
    fn look<'py>(&self, py: Python<'py>, path: PathBuf, name: Option<String>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let opened = self.opened()?;
        let weights = unlocked(py, || {
            on_pool(|| {
                let look = ltm::look::load(&path, &opened.source.job().basis)?;
                let lighting = name.map_or(Ok(look.lighting()), |name| look.named(&name))?;
                Ok(lighting.weights().to_vec())
            })
        })?;
        let shape = vec![weights.len(), CHANNELS];
        PyArray1::from_vec(py, weights.into_flattened()).reshape(shape)
    }
}
