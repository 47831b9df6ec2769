//! The views of a year: their matrices, and how sensors of them are named.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use ltm::container::ContainerReader;
use ltm::daylight::Climate;
use ltm::light::Job;
use ltm::pipeline::{Blinds, DaylightOptions, DaylightSource};
use ltm::scene::shows_irradiance;
use ltm::store::StoreReader;
use ltm::{Error, Result};

use crate::input::{Kind, kind_of};

/// Places and normals of sensors, in the axes of the scene file.
pub(super) type Places = Vec<([f32; 3], [f32; 3])>;

/// A view whose matrix is there.
pub(super) struct View {
    pub(super) name: String,
    pub(super) matrix: PathBuf,
    /// Of a grid of a scene file.
    pub(super) places: Option<Places>,
    pub(super) blinds: Option<ViewBlinds>,
}

/// What the view of a scene's camera is called.
pub(super) const CAMERA: &str = "camera";

/// The closed blinds of a view.
pub(super) struct ViewBlinds {
    pub(super) matrix: OpenMatrix,
    pub(super) place: String,
    /// For each step of the climate.
    pub(super) closed: Vec<bool>,
}

impl ViewBlinds {
    pub(super) fn blinds(&self) -> Blinds<'_> {
        Blinds { source: self.matrix.source(), place: &self.place, closed: &self.closed }
    }

    /// Hours of use in which they are closed.
    pub(super) fn closed_hours(&self, climate: &Climate, asked: &DaylightOptions<'_>) -> f64 {
        let used =
            climate.steps.iter().zip(&self.closed).filter(|(step, closed)| **closed && asked.schedule.holds(step));
        used.count() as f64 * climate.step_hours()
    }
}

/// A matrix of irradiance that is open.
pub(super) enum OpenMatrix {
    Container(Box<ContainerReader>),
    Stored(Box<StoreReader>),
}

impl OpenMatrix {
    /// Errors: a file that is neither, or shows radiance.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let matrix = match kind_of(path)? {
            Kind::Container => Self::Container(Box::new(ContainerReader::open(path)?)),
            Kind::Matrix => Self::Stored(Box::new(StoreReader::open(path)?)),
        };
        if shows_irradiance(&matrix.job().provenance.settings) {
            return Ok(matrix);
        }
        let problem = "shows radiance, and not the irradiance of surfaces";
        let hint = "give the scene file, or render with irradiance = true in its [camera]";
        Err(Error::input(path.display().to_string(), problem, hint))
    }

    pub(super) fn source(&self) -> DaylightSource<'_> {
        match self {
            Self::Container(container) => DaylightSource::Container(container),
            Self::Stored(matrix) => DaylightSource::Stored(matrix),
        }
    }

    pub(super) fn job(&self) -> &Job {
        match self {
            Self::Container(container) => container.job(),
            Self::Stored(matrix) => matrix.job(),
        }
    }
}

/// A sensor of a view: `VIEW:NUMBER`, or `NUMBER` where there is one view; the first is 1, in the order of the table of measures.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SensorName {
    pub(super) view: Option<String>,
    pub(super) number: usize,
}

impl FromStr for SensorName {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (view, number) = match text.rsplit_once(':') {
            Some((view, number)) => (Some(view.trim().to_owned()), number),
            None => (None, text),
        };
        match number.trim().parse() {
            Ok(number) if number > 0 => Ok(Self { view, number }),
            _ => {
                let hint = "write GRID:NUMBER, such as desk:5; the first sensor is 1";
                Err(Error::input(format!("'{text}'"), "is no sensor", hint))
            }
        }
    }
}

impl std::fmt::Display for SensorName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.view {
            Some(view) => write!(f, "{view}:{}", self.number),
            None => write!(f, "{}", self.number),
        }
    }
}

impl SensorName {
    /// Which of the views has it. Errors: no view of that name; none is named, and there are several.
    pub(super) fn view_among(&self, names: &[&str]) -> Result<usize> {
        let refuse = |problem: &str| {
            Err(Error::input(format!("sensor '{self}'"), problem, format!("the views are {}", in_quotes(names))))
        };
        match &self.view {
            Some(view) => names.iter().position(|name| name == view).map_or_else(|| refuse("is of no view here"), Ok),
            None if names.len() == 1 => Ok(0),
            None => refuse("does not say of which view it is"),
        }
    }

    /// Its place among the sensors of its view. Errors: there are fewer.
    pub(super) fn index(&self, job: &Job) -> Result<usize> {
        let count = u64::from(job.shape.width()) * u64::from(job.shape.height());
        if self.number as u64 <= count {
            return Ok(self.number - 1);
        }
        let problem = format!("is not there: its view has {count}");
        Err(Error::input(format!("sensor '{self}'"), problem, format!("give 1 to {count}")))
    }
}

/// Names for a message.
pub(super) fn in_quotes(names: &[&str]) -> String {
    names.iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ")
}
