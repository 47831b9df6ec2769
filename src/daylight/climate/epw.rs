//! EnergyPlus weather files (EnergyPlus, *Auxiliary programs*, "EnergyPlus weather file (EPW) data dictionary").

use super::super::Site;
use super::{Measured, MeasuredAs, Row};
use crate::error::{Error, Result};

/// Columns of dew point, direct normal and diffuse horizontal irradiance, from 0.
const DEW_POINT: usize = 7;
const DIRECT: usize = 14;
const DIFFUSE: usize = 15;

/// What stands for a missing irradiance, and for a missing dew point.
const MISSING: f64 = 9999.0;
const MISSING_DEW_POINT: f64 = 99.9;

/// Lines before the hours.
const HEADER_LINES: usize = 8;

pub(super) fn parse(place: &str, text: &str) -> Result<(Site, Vec<Row>)> {
    let mut lines = text.lines().enumerate();
    let site = site(place, text.lines().next().unwrap_or_default())?;
    let mut per_hour = None;
    for (number, line) in lines.by_ref().take(HEADER_LINES) {
        if let Some(rest) = line.trim_start().to_ascii_uppercase().strip_prefix("DATA PERIODS,") {
            let mut fields = rest.split(',');
            let periods = fields.next().and_then(|field| field.trim().parse::<u32>().ok());
            per_hour =
                fields.next().and_then(|field| field.trim().parse::<u32>().ok()).filter(|n| (1..=60).contains(n));
            if periods != Some(1) || per_hour.is_none() {
                let hint = "give a file of one period with 1 to 60 lines an hour";
                return Err(Error::input(
                    format!("{place}, line {}", number + 1),
                    "says no data period that is read",
                    hint,
                ));
            }
        }
    }
    let Some(per_hour) = per_hour else {
        let problem = format!("has no DATA PERIODS in its first {HEADER_LINES} lines");
        return Err(Error::input(place, problem, "give the EPW file as it was downloaded"));
    };
    let rows = lines.filter(|(_, line)| !line.trim().is_empty());
    Ok((site, rows.map(|(number, line)| row(place, number + 1, line, per_hour)).collect::<Result<_>>()?))
}

fn site(place: &str, line: &str) -> Result<Site> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let place = format!("{place}, line 1");
    let number = |index: usize, name: &str| {
        fields.get(index).and_then(|field| field.parse::<f64>().ok()).filter(|v| v.is_finite()).ok_or_else(|| {
            Error::input(&place, format!("has no {name}"), "LOCATION has ten fields, the last four are numbers")
        })
    };
    let name = [1, 3].iter().filter_map(|&index| fields.get(index).copied()).collect::<Vec<_>>().join(", ");
    let site = Site {
        name,
        latitude_degrees: number(6, "latitude")?,
        longitude_degrees: number(7, "longitude")?,
        time_zone_hours: number(8, "time zone")?,
        elevation_metres: number(9, "elevation")?,
    };
    site.checked(&place)
}

fn row(place: &str, line_number: usize, line: &str, per_hour: u32) -> Result<Row> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let refuse = |problem: String, hint: &str| Error::input(format!("{place}, line {line_number}"), problem, hint);
    if fields.len() <= DIFFUSE {
        let problem = format!("has {} columns", fields.len());
        return Err(refuse(problem, "an hour has 35; direct and diffuse irradiance are the 15th and 16th"));
    }
    let number = |index: usize, name: &str| {
        let found = fields[index].parse::<f64>().ok().filter(|value| value.is_finite());
        found.ok_or_else(|| refuse(format!("'{}' is no {name}", fields[index]), "give a number"))
    };
    let whole = |index: usize, name: &str, most: f64| {
        let value = number(index, name)?;
        match value.fract() == 0.0 && (0.0..=most).contains(&value) {
            true => Ok(value as u8),
            false => Err(refuse(format!("{value} is no {name}"), "give a whole number")),
        }
    };
    let light = |index: usize, name: &str| {
        let value = number(index, name)?;
        match value < MISSING {
            true => Ok(value),
            false => Err(refuse(format!("the {name} is missing ({value})"), "fill it in from another year")),
        }
    };
    let (month, day, hour) = (whole(1, "month", 12.0)?, whole(2, "day", 31.0)?, whole(3, "hour", 24.0)?);
    // An hour of one line stands for its middle.
    let inside = if per_hour == 1 { 0.5 } else { f64::from(whole(4, "minute", 60.0)?) / 60.0 };
    let dew_point = fields[DEW_POINT].parse::<f64>().ok().filter(|value| value.abs() < MISSING_DEW_POINT);
    let (direct, diffuse) = (light(DIRECT, "direct normal irradiance")?, light(DIFFUSE, "diffuse irradiance")?);
    let measured = MeasuredAs::Whole(Measured::Irradiance { direct, diffuse });
    Ok(Row { line: line_number, month, day, hour: f64::from(hour) - 1.0 + inside, measured, dew_point })
}
