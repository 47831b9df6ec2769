//! `--dim`: lamps that sensors dim by what daylight gives them, and the electric energy that they take.

use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

use ltm::daylight::{Climate, Dimming, LampYear, settled_light};
use ltm::files::{csv_field, write_file};
use ltm::light::Job;
use ltm::light::names::{meant, suggest};
use ltm::pipeline::{self, DaylightOptions, SensorYear};
use ltm::resources::Progress;
use ltm::{Error, Result};

use super::view::{OpenMatrix, SensorName, View, ViewBlinds};
use ltm_cli::console::Console;
use ltm_cli::say;

/// Lamps with the sensor that dims them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zone {
    /// A pattern of names of lights.
    lamps: String,
    sensor: SensorName,
    dimming: Dimming,
}

impl FromStr for Zone {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let parts = text.rsplit_once('=').and_then(|(lamps, rest)| Some((lamps.trim(), rest.split_once(',')?)));
        let Some((lamps, (sensor, dimming))) = parts.filter(|(lamps, _)| !lamps.is_empty()) else {
            let hint = "write LAMPS=SENSOR,SETPOINT,POWER, such as desk-lamps=desk:5,500lx,120W";
            return Err(Error::input(format!("'{text}'"), "says not which lamps a sensor dims", hint));
        };
        Ok(Self { lamps: lamps.to_owned(), sensor: sensor.parse()?, dimming: Dimming::parse(dimming)? })
    }
}

impl Zone {
    /// Which lights of a matrix its lamps are.
    fn lights(&self, job: &Job) -> Result<Vec<usize>> {
        let place = || format!("--dim {}", self.lamps);
        let lights = job.basis.lights();
        let names = || lights.iter().map(|light| light.name.as_str());
        let found = meant(&self.lamps, names());
        if found.is_empty() {
            return Err(Error::input(place(), "no light is called so", suggest(&self.lamps, names())));
        }
        match found.iter().map(|&light| &lights[light]).find(|light| light.kind.is_daylight()) {
            Some(sky) => Err(Error::input(place(), format!("'{}' is daylight and no lamp", sky.name), "name lamps")),
            None => Ok(found),
        }
    }
}

/// Checks zones before anything is rendered: that their sensors are of these views.
pub(super) fn check_views(zones: &[Zone], views: &[&str]) -> Result<()> {
    zones.iter().try_for_each(|zone| zone.sensor.view_among(views).map(|_| ()))
}

/// Checks zones against a view that is to be rendered or is there: lamps, each in one zone, and sensors.
pub(super) fn check_job(zones: &[Zone], views: &[&str], view: &str, job: &Job) -> Result<()> {
    let mut zone_of = vec![None; job.basis.lights().len()];
    for zone in zones {
        for light in zone.lights(job)? {
            if let Some(other) = zone_of[light].replace(&zone.lamps) {
                let problem = format!("'{}' is dimmed by --dim {other} too", job.basis.lights()[light].name);
                return Err(Error::input(format!("--dim {}", zone.lamps), problem, "give each lamp to one sensor"));
            }
        }
        if views[zone.sensor.view_among(views)?] == view {
            zone.sensor.index(job)?;
        }
    }
    Ok(())
}

/// A zone with what its sensor sees.
struct SeenZone {
    year: SensorYear,
    /// Lux at the sensor by the lamps of each zone at full light, with blinds open and closed.
    full: [Vec<f64>; 2],
    /// Whether they are closed, for each step; none without blinds.
    closed: Option<Vec<bool>>,
}

impl SeenZone {
    fn full_at(&self, step: usize) -> &[f64] {
        let is_closed = self.closed.as_ref().is_some_and(|closed| closed[step]);
        &self.full[usize::from(is_closed)]
    }
}

fn seen(
    zones: &[Zone],
    views: &[View],
    climate: &Climate,
    asked: &DaylightOptions<'_>,
    console: &Console,
) -> Result<Vec<SeenZone>> {
    let names: Vec<&str> = views.iter().map(|view| &*view.name).collect();
    let of_zone = zones.iter().map(|zone| zone.sensor.view_among(&names)).collect::<Result<Vec<_>>>()?;
    let mut all: Vec<Option<SeenZone>> = zones.iter().map(|_| None).collect();
    for (at, view) in views.iter().enumerate().filter(|(at, _)| of_zone.contains(at)) {
        let matrix = OpenMatrix::open(&view.matrix)?;
        let job = matrix.job();
        check_job(zones, &names, &view.name, job)?;
        let own: Vec<usize> = (0..zones.len()).filter(|zone| of_zone[*zone] == at).collect();
        let sensors = own.iter().map(|&zone| zones[zone].sensor.index(job)).collect::<Result<Vec<_>>>()?;
        let place = view.matrix.display().to_string();
        let asked = DaylightOptions { blinds: view.blinds.as_ref().map(ViewBlinds::blinds), ..*asked };
        let years = pipeline::sensor_years(&matrix.source(), &place, climate, &asked, &sensors, console)?;
        let lights = zones.iter().map(|zone| zone.lights(job)).collect::<Result<Vec<_>>>()?;
        for (zone, year) in own.into_iter().zip(years) {
            let full = [&year.lights, &year.closed_lights].map(|lux| {
                let sum = |lights: &Vec<usize>| lights.iter().map(|&light| f64::from(lux[light])).sum();
                lights.iter().map(sum).collect::<Vec<f64>>()
            });
            if full.iter().any(|full| full[zone] <= 0.0) {
                let problem = format!("no light of '{}' reaches the sensor", zones[zone].lamps);
                let hint = "name a sensor that these lamps light";
                return Err(Error::input(format!("sensor '{}'", zones[zone].sensor), problem, hint));
            }
            let closed = view.blinds.as_ref().map(|blinds| blinds.closed.clone());
            all[zone] = Some(SeenZone { year, full, closed });
        }
    }
    Ok(all.into_iter().flatten().collect())
}

/// Dims the lamps of all zones over the year; says what they take and writes it to `lamps.csv` in the folder, with `hourly` also each step
/// to `lamps-hours.csv`.
pub(super) fn dim(
    zones: &[Zone],
    (views, climate): (&[View], &Climate),
    asked: &DaylightOptions<'_>,
    (folder, hourly): (&Path, bool),
    console: &Console,
) -> Result<()> {
    let seen = seen(zones, views, climate, asked, console)?;
    let dimmings: Vec<Dimming> = zones.iter().map(|zone| zone.dimming).collect();
    let mut years = vec![LampYear::default(); zones.len()];
    let (mut unsettled, mut hours) = (0, hourly.then(|| format!("month,day,hour{}\n", hour_columns(zones))));
    for (at, step) in climate.steps.iter().enumerate() {
        let is_used = asked.schedule.holds(step);
        let full: Vec<&[f64]> = seen.iter().map(|zone| zone.full_at(at)).collect();
        let daylight: Vec<f64> = seen.iter().map(|zone| f64::from(zone.year.daylight[at])).collect();
        let (light, is_settled) = match is_used {
            true => settled_light(&dimmings, &daylight, &full),
            false => (vec![0.0; zones.len()], true),
        };
        unsettled += usize::from(!is_settled);
        let mut of_zones = String::new();
        for (zone, dimming) in dimmings.iter().enumerate() {
            let by_lamps: f64 = full[zone].iter().zip(&light).map(|(full, light)| full * light).sum();
            let mut watts = 0.0;
            if is_used {
                years[zone].add(dimming, light[zone], daylight[zone] + by_lamps, climate.step_hours());
                watts = dimming.watts(light[zone]);
            }
            let _ = write!(of_zones, ",{:.1},{:.1},{:.2},{watts:.2}", daylight[zone], by_lamps, 100.0 * light[zone]);
        }
        if let Some(hours) = &mut hours {
            let _ = writeln!(hours, "{},{},{:.3}{of_zones}", step.month, step.day, step.hour);
        }
    }
    if unsettled > 0 {
        let text =
            "zones see so much of each other's lamps that they do not settle; each sensor wants to be below its own";
        console.note(&format!("warning: --dim: at {unsettled} steps {text}"));
    }
    if let Some(hours) = hours {
        write_file(&folder.join("lamps-hours.csv"), true, hours.as_bytes())?;
    }
    let table = folder.join("lamps.csv");
    write_file(&table, true, table_of(zones, &seen, &years).as_bytes())?;
    told(zones, &seen, &years, console);
    let sum = |of: fn(&LampYear) -> f64| years.iter().map(of).sum::<f64>();
    let (taken, undimmed) = (sum(|year| year.kilowatt_hours), sum(|year| year.undimmed_kilowatt_hours));
    say!(
        "{}: {} zones, {taken:.1} kWh a year of {undimmed:.1} kWh undimmed ({:.1} % saved)",
        table.display(),
        zones.len(),
        saved_percent(taken, undimmed)
    );
    Ok(())
}

fn saved_percent(taken: f64, undimmed: f64) -> f64 {
    if undimmed > 0.0 { 100.0 * (1.0 - taken / undimmed) } else { 0.0 }
}

fn told(zones: &[Zone], seen: &[SeenZone], years: &[LampYear], console: &Console) {
    for (at, (zone, year)) in zones.iter().zip(years).enumerate() {
        let Zone { lamps, sensor, dimming } = zone;
        let own = seen[at].full[0][at];
        if own < dimming.set_point {
            let text = format!("at full light they give {own:.0} lx at {sensor}, less than {} lx", dimming.set_point);
            console.note(&format!("warning: --dim {lamps}: {text}"));
        }
        say!(
            "{lamps}: {:.1} kWh a year, undimmed {:.1} kWh; of {:.0} h of use {:.0} h at full light, {:.0} h at the least, \
             {:.0} h off, {:.0} h below {} lx at {sensor}",
            year.kilowatt_hours,
            year.undimmed_kilowatt_hours,
            year.hours,
            year.full_hours,
            year.least_hours,
            year.off_hours,
            year.short_hours,
            dimming.set_point
        );
    }
}

fn hour_columns(zones: &[Zone]) -> String {
    let of = |zone: &Zone| {
        let columns = ["daylight_lx", "lamps_lx", "light_percent", "watts"];
        columns.map(|column| format!(",{}", csv_field(&format!("{} {column}", zone.lamps)))).concat()
    };
    zones.iter().map(of).collect()
}

fn table_of(zones: &[Zone], seen: &[SeenZone], years: &[LampYear]) -> String {
    let mut text =
        "lamps,sensor,set_point_lx,lamps_lx,hours,full_hours,least_hours,off_hours,short_hours,kwh,undimmed_kwh,\
        saved_percent\n"
            .to_owned();
    for (at, (zone, year)) in zones.iter().zip(years).enumerate() {
        let names = [&zone.lamps, &zone.sensor.to_string()].map(|name| csv_field(name)).join(",");
        let numbers = [
            zone.dimming.set_point,
            seen[at].full[0][at],
            year.hours,
            year.full_hours,
            year.least_hours,
            year.off_hours,
            year.short_hours,
            year.kilowatt_hours,
            year.undimmed_kilowatt_hours,
            saved_percent(year.kilowatt_hours, year.undimmed_kilowatt_hours),
        ];
        let numbers: Vec<String> = numbers.iter().map(|number| format!("{number:.3}")).collect();
        let _ = writeln!(text, "{names},{}", numbers.join(","));
    }
    text
}
