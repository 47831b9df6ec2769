//! `--eyes`: glare at sensors that are eyes.

use std::path::Path;

use ltm::daylight::{Climate, GLARE_LIMITS};
use ltm::pipeline::{self, DaylightYear};
use ltm::resources::Progress;
use ltm::{Error, Result};

use super::view::{CAMERA, View, in_quotes};
use ltm_cli::console::Console;
use ltm_cli::say;

/// Sine of the angle to the horizon above which eyes do not look ahead: 45°.
const STEEP: f32 = 0.71;

/// Checks that the eyes are views of sensors.
pub(super) fn check_views(eyes: &[String], views: &[&str]) -> Result<()> {
    let refuse = |name: &str, problem: &str| {
        Err(Error::input(format!("--eyes {name}"), problem, format!("the views are {}", in_quotes(views))))
    };
    for name in eyes {
        match views.contains(&name.as_str()) {
            true if name == CAMERA => return refuse(name, "is a picture: its pixels are surfaces and no eyes"),
            true => {}
            false => return refuse(name, "is no view here"),
        }
    }
    Ok(())
}

/// Writes the glare of a view's eyes beside its measures, `-glare.csv`, and where there is an array of hours `-dgps.npy`; says it, and returns
/// its fields of the summary.
pub(super) fn write(
    (view, year): (&View, &DaylightYear),
    (stem, hours): (&Path, Option<&Path>),
    climate: &Climate,
    console: &Console,
) -> Result<String> {
    let name = &view.name;
    let beside = |ending: &str| stem.with_file_name(format!("{name}-{ending}"));
    let places = view.places.as_deref();
    let all = year.glare.len();
    let steep = places.unwrap_or_default().iter().filter(|(_, normal)| normal[1].abs() > STEEP).count();
    if steep > 0 {
        let text = "sensors look up or down more than ahead; glare wants the illuminance across the line of sight";
        console.note(&format!("warning: --eyes {name}: {steep} of {all} {text}"));
    }
    pipeline::write_glare(&beside("glare.csv"), year, places, true)?;
    if let Some(hours) = hours {
        pipeline::write_glare_hours(&beside("dgps.npy"), hours, climate, year.glare.len(), true)?;
    }
    let seen: Vec<_> = year.glare.iter().flatten().collect();
    let mut means = Vec::new();
    for (at, limit) in GLARE_LIMITS.iter().enumerate() {
        let percents = || seen.iter().map(|glare| glare.percent[at]);
        let mean = percents().map(f64::from).sum::<f64>() / seen.len().max(1) as f64;
        let worst = percents().fold(0.0, f32::max);
        say!(
            "{name}: DGPs {limit:.2} or above in {mean:.1} % of the time of use, {worst:.1} % at the worst of {} eyes",
            seen.len()
        );
        means.push(format!("{mean:.3}"));
    }
    let [none, minimum, medium, high] =
        [0, 1, 2, 3].map(|class| seen.iter().filter(|glare| glare.protection() == class).count());
    say!(
        "{name}: protection from glare by EN 17037 high at {high} eyes, medium at {medium}, minimum at {minimum}, none at {none}"
    );
    Ok(means.join(","))
}
