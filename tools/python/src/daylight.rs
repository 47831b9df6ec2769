//! Daylight of a climate over a matrix.

use std::path::Path;

use ltm::daylight::{
    ANNUAL_MEASURES, Climate, GlareOptions, Schedule, SeenGlare, SkyOptions, Thresholds, points_of_picture,
};
use ltm::image::LinearImage;
use ltm::light::Lighting;
use ltm::pipeline::{DaylightOptions, DaylightSource, DaylightYear, daylight, lighting_at};
use ltm::resources::Progress;
use ltm::scene::shows_irradiance;
use ltm::{Error, Result};
use numpy::prelude::*;
use numpy::{PyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::errors::unlocked;
use crate::matrix::{Source, contiguous};

/// What is asked of a year.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct YearChoices {
    hours: (f64, f64),
    months: (u8, u8),
    autonomy: f32,
    north: f64,
    ground: f64,
}

/// Weights of a moment: month and day, and the hour of the site's time.
pub(crate) fn weights_at(
    source: &Source,
    place: &str,
    lamps: Vec<[f32; 3]>,
    climate: &Path,
    time: ((u8, u8), f64),
    (north_degrees, ground_reflectance): (f64, f64),
) -> Result<Vec<[f32; 3]>> {
    let climate = Climate::read(climate)?;
    let options = SkyOptions { north_degrees, ground_reflectance };
    let lighting = lighting_at(place, &Lighting::new(lamps)?, &source.job().basis, &climate, time, options)?;
    Ok(lighting.weights().to_vec())
}

/// The measures of a year.
pub(crate) fn year(
    source: &Source,
    place: &str,
    climate: &Path,
    choices: &YearChoices,
    memory_bytes: Option<u64>,
    watch: &dyn Progress,
) -> Result<DaylightYear> {
    if !shows_irradiance(&source.job().provenance.settings) {
        let hint = "render with irradiance = true in the scene's [camera], or sensors";
        return Err(Error::input(place, "shows radiance, and not the irradiance of surfaces", hint));
    }
    let climate = Climate::read(climate)?;
    climate.warnings.iter().for_each(|warning| watch.warn(warning));
    let (from, to) = choices.hours;
    let schedule = Schedule::of_hours(from, to)?.in_months(choices.months.0, choices.months.1)?;
    let options = DaylightOptions {
        blinds: None,
        sky: SkyOptions { north_degrees: choices.north, ground_reflectance: choices.ground },
        schedule,
        thresholds: Thresholds { autonomy: choices.autonomy, ..Thresholds::default() },
        memory_bytes,
        overwrite: false,
    };
    let source = match source {
        Source::Container(container) => DaylightSource::Container(container),
        Source::Matrix(matrix) => DaylightSource::Stored(matrix),
    };
    daylight(&source, place, &climate, &options, None, watch)
}

/// Glare in a picture of radiance (height × width × 3) that an eye sees, turned to the right and up: a dictionary. `what` names the picture in
/// messages.
#[pyfunction]
pub(crate) fn glare<'py>(
    py: Python<'py>,
    picture: PyReadonlyArrayDyn<'py, f32>,
    turn: [f64; 2],
    threshold: f64,
    what: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let (&[height, width, _], (pixels, _)) = (picture.shape(), contiguous(&picture)?.as_chunks()) else {
        return Err(PyValueError::new_err("the picture is not height × width × 3"));
    };
    let picture = LinearImage { width: width as u32, height: height as u32, pixels: pixels.to_vec() };
    let seen = unlocked(py, || {
        let points = points_of_picture(what, &picture, turn)?;
        SeenGlare::of_points(&points, GlareOptions { threshold, ..GlareOptions::default() })
    })?;
    let sources = seen.sources.iter().map(|source| {
        let direction = PyTuple::new(py, source.direction.to_array())?;
        (direction, source.luminance, source.solid_angle, source.position_index).into_pyobject(py)
    });
    let said = PyDict::new(py);
    said.set_item("probability", seen.probability)?;
    said.set_item("eye_lux", seen.eye_lux)?;
    said.set_item("sources", sources.collect::<PyResult<Vec<_>>>()?)?;
    Ok(said)
}

/// A year as a dictionary: the measures by name, height × width, with their units, and the measures of all places together.
pub(crate) fn to_dict<'py>(py: Python<'py>, year: &DaylightYear) -> PyResult<Bound<'py, PyDict>> {
    let (width, height) = year.size;
    let (measures, units) = (PyDict::new(py), PyDict::new(py));
    for (at, (name, unit)) in ANNUAL_MEASURES.into_iter().enumerate() {
        let values = year.measures.iter().map(|place| place.values[at]).collect();
        measures.set_item(name, PyArray1::from_vec(py, values).reshape([height as usize, width as usize])?)?;
        units.set_item(name, unit)?;
    }
    let said = PyDict::new(py);
    said.set_item("measures", measures)?;
    said.set_item("units", units)?;
    said.set_item("spatial_autonomy", year.space.spatial_autonomy())?;
    said.set_item("sunlight_exposure", year.space.sunlight_exposure())?;
    said.set_item("en_17037_class", year.space.en_17037_class())?;
    said.set_item("dark", year.dark)?;
    Ok(said)
}
