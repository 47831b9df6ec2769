//! `--blinds` and `--close`: in which hours blinds are closed.

use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

use ltm::daylight::{Climate, number_with_unit};
use ltm::files::{csv_field, write_file};
use ltm::pipeline::{self, DaylightOptions, SunLimit};
use ltm::{Error, Result};

use super::view::{CAMERA, OpenMatrix, Places, SensorName, View, ViewBlinds, in_quotes};
use ltm_cli::console::Console;
use ltm_cli::say;

/// When blinds are closed.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Rule {
    /// Where direct sun on the sensors of a view, or else of each view itself, is above a limit.
    Sun { view: Option<String>, limit: SunLimit },
    /// Where a sensor has more than so many lux with blinds open.
    Sensor { sensor: SensorName, lux: f32 },
}

impl Default for Rule {
    fn default() -> Self {
        Self::Sun { view: None, limit: SunLimit::default() }
    }
}

impl FromStr for Rule {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let refuse = || {
            let hint = "write [GRID,]LUX,SHARE of direct sun, such as 1000lx,2%, or SENSOR,LUX, such as desk:5,3000lx";
            Error::input(format!("'{text}'"), "does not say when blinds close", hint)
        };
        let number = |word: &str, units: &[&str]| {
            number_with_unit(word, units).filter(|value| *value >= 0.0 && value.is_finite())
        };
        let lux = |word: &str| number(word, &["lx", "lux"]).map(|lux| lux as f32).ok_or_else(refuse);
        let words: Vec<&str> = text.split(',').map(str::trim).collect();
        let (view, [of_lux, share]) = match words[..] {
            [first, second] if !second.ends_with('%') => {
                return Ok(Self::Sensor { sensor: first.parse()?, lux: lux(second)? });
            }
            [first, second] => (None, [first, second]),
            [view, first, second] if !view.is_empty() => (Some(view.to_owned()), [first, second]),
            _ => return Err(refuse()),
        };
        let share = number(share, &["%"]).map(|percent| percent / 100.0).filter(|share| *share < 1.0);
        Ok(Self::Sun { view, limit: SunLimit { lux: lux(of_lux)?, share: share.ok_or_else(refuse)? } })
    }
}

impl Rule {
    /// Which of the views decides for one of them, where some are eyes. Errors: it is not among them; the camera or eyes, where no grid is
    /// named and there are several.
    pub(super) fn decider(&self, name: &str, names: &[&str], eyes: &[String]) -> Result<usize> {
        let at = |wanted: &str| names.iter().position(|name| *name == wanted);
        let refuse = |problem: &str| Err(Error::input("--close", problem, format!("name one of {}", in_quotes(names))));
        let is_grid = |name: &str| name != CAMERA && !eyes.iter().any(|eyes| eyes == name);
        let grids: Vec<usize> = (0..names.len()).filter(|view| is_grid(names[*view])).collect();
        match self {
            Self::Sensor { sensor, .. } => sensor.view_among(names),
            Self::Sun { view: Some(view), .. } => {
                at(view).map_or_else(|| refuse(&format!("there is no view '{view}'")), Ok)
            }
            Self::Sun { view: None, .. } => match (at(name), &grids[..]) {
                (Some(own), _) if is_grid(name) || grids.is_empty() => Ok(own),
                (_, [only]) => Ok(*only),
                _ => refuse(&format!("does not say which grid closes the blinds of '{name}'")),
            },
        }
    }

    /// For each step, whether blinds are closed by what is seen with open ones.
    fn closed(
        &self,
        view: &View,
        climate: &Climate,
        asked: &DaylightOptions<'_>,
        console: &Console,
    ) -> Result<Vec<bool>> {
        let (matrix, place) = (OpenMatrix::open(&view.matrix)?, view.matrix.display().to_string());
        match self {
            Self::Sun { limit, .. } => {
                pipeline::steps_above_sun_limit(&matrix.source(), &place, climate, asked, *limit, console)
            }
            Self::Sensor { sensor, lux } => {
                let sensors = [sensor.index(matrix.job())?];
                let years = pipeline::sensor_years(&matrix.source(), &place, climate, asked, &sensors, console)?;
                Ok(years[0].daylight.iter().map(|daylight| daylight > lux).collect())
            }
        }
    }
}

impl std::fmt::Display for Rule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Sun { view, limit: SunLimit { lux, share } } => {
                let places = view.as_ref().map(|view| format!(" of {view}")).unwrap_or_default();
                let percent = (1e6 * share).round() / 1e4;
                write!(f, "direct sun above {lux} lx at more than {percent} % of the places{places}")
            }
            Self::Sensor { sensor, lux } => write!(f, "more than {lux} lx at {sensor}"),
        }
    }
}

/// Whether sensors stand and look alike, to a hundredth of a unit: scene files may have other origins.
fn are_alike(a: Option<&Places>, b: Option<&Places>) -> bool {
    let near = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 0.01);
    match (a, b) {
        (Some(a), Some(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| near(&a.0, &b.0) && near(&a.1, &b.1)),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// Decides for each of the views, whose matrices with closed blinds are these, when blinds are closed, and says it.
pub(super) fn close(
    (rule, eyes): (&Rule, &[String]),
    (views, closed): (&mut [View], &[View]),
    climate: &Climate,
    asked: &DaylightOptions<'_>,
    console: &Console,
) -> Result<()> {
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut decided: Vec<Option<Vec<bool>>> = vec![None; views.len()];
    for (at, blinds) in closed.iter().enumerate() {
        let decider = rule.decider(names[at], &names, eyes)?;
        if decided[decider].is_none() {
            decided[decider] = Some(rule.closed(&views[decider], climate, asked, console)?);
        }
        if !are_alike(views[at].places.as_ref(), blinds.places.as_ref()) {
            let hint = "give both scene files the same grids";
            return Err(Error::input(format!("grid '{}'", names[at]), "has other sensors with blinds", hint));
        }
        let closed = ViewBlinds {
            matrix: OpenMatrix::open(&blinds.matrix)?,
            place: blinds.matrix.display().to_string(),
            closed: decided[decider].clone().unwrap_or_default(),
        };
        let used = climate.steps.iter().filter(|step| asked.schedule.holds(step)).count() as f64 * climate.step_hours();
        say!(
            "{}: blinds closed in {:.0} of {used:.0} h of use: {rule}",
            names[at],
            closed.closed_hours(climate, asked)
        );
        views[at].blinds = Some(closed);
    }
    Ok(())
}

/// Writes at which steps blinds are closed, 1, and open, 0, with a column for each view.
pub(super) fn write_hours(path: &Path, views: &[View], climate: &Climate) -> Result<()> {
    let mut text = "month,day,hour".to_owned();
    let views: Vec<_> = views.iter().filter_map(|view| Some((&view.name, view.blinds.as_ref()?))).collect();
    views.iter().for_each(|(name, _)| text += &format!(",{}", csv_field(name)));
    text.push('\n');
    for (at, step) in climate.steps.iter().enumerate() {
        let _ = write!(text, "{},{},{:.3}", step.month, step.day, step.hour);
        views.iter().for_each(|(_, blinds)| text += if blinds.closed[at] { ",1" } else { ",0" });
        text.push('\n');
    }
    write_file(path, true, text.as_bytes())
}
