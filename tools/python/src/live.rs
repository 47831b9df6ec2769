//! Progressive renders: one estimate for each call.

use std::path::PathBuf;

use ltm::pipeline::{Estimate, ProgressiveRender};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::exception;
use crate::make::{PackChoices, RenderChoices, SceneChoice, load_with_choices};
use crate::watch::run;

/// A scene that is rendered progressively.
#[pyclass]
pub(crate) struct LiveRender {
    render: ProgressiveRender,
}

#[pymethods]
impl LiveRender {
    #[new]
    fn new(
        py: Python<'_>,
        scene: SceneChoice,
        path: PathBuf,
        choices: RenderChoices,
        pack: PackChoices,
        progress: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = pack.options().map_err(|error| exception(&error))?;
        let render = run(py, progress.as_ref(), |watch| {
            let loaded = load_with_choices(scene, choices, watch)?;
            ProgressiveRender::begin(loaded, &path, options, watch)
        })?;
        Ok(Self { render })
    }

    /// Renders the next estimate; None after the last.
    fn next<'py>(
        &mut self,
        py: Python<'py>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        let render = &mut self.render;
        let Some(estimate) = run(py, progress.as_ref(), |watch| render.next_estimate(watch))? else { return Ok(None) };
        let Estimate { path, stage, is_final, error, seconds, expected_seconds, reports: _ } = estimate;
        let said = PyDict::new(py);
        said.set_item("path", path)?;
        said.set_item("size", (stage.height, stage.width))?;
        said.set_item("samples_per_pixel", stage.samples_per_pixel)?;
        said.set_item("is_final", is_final)?;
        said.set_item("error", error)?;
        said.set_item("seconds", seconds)?;
        said.set_item("expected_seconds", expected_seconds)?;
        Ok(Some(said))
    }
}
