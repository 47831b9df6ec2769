//! WEA files of Daysim and Radiance: six lines of site and unit, then month, day, hour and two columns of light.

use super::super::Site;
use super::{Measured, MeasuredAs, Row};
use crate::error::{Error, Result};

/// The first words of the header's lines.
const HEADER: [&str; 6] = ["place", "latitude", "longitude", "time_zone", "site_elevation", "weather_data_file_units"];

pub(super) fn parse(place: &str, text: &str) -> Result<(Site, Vec<Row>)> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let mut values = Vec::with_capacity(HEADER.len());
    for (index, word) in HEADER.into_iter().enumerate() {
        let line = lines.next().map_or("", |(_, line)| line.trim());
        let Some((_, rest)) =
            line.split_once(char::is_whitespace).filter(|(first, _)| first.eq_ignore_ascii_case(word))
        else {
            let problem = format!("does not begin with '{word}'");
            return Err(Error::input(
                format!("{place}, line {}", index + 1),
                problem,
                "give the six lines of the header",
            ));
        };
        values.push(rest.trim());
    }
    let number = |index: usize| {
        values[index].parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
            let problem = format!("'{}' is no number", values[index]);
            Error::input(format!("{place}, line {}", index + 1), problem, format!("give the {}", HEADER[index]))
        })
    };
    // Longitude and time zone are counted in degrees west.
    let site = Site {
        name: values[0].replace('_', ", "),
        latitude_degrees: number(1)?,
        longitude_degrees: -number(2)?,
        time_zone_hours: -number(3)? / 15.0,
        elevation_metres: number(4)?,
    };
    let unit = number(5)?;
    if ![1.0, 2.0, 3.0].contains(&unit) {
        let hint =
            "1: direct normal and diffuse irradiance; 2: both horizontal; 3: direct normal and diffuse illuminance";
        return Err(Error::input(format!("{place}, line 6"), format!("{unit} is no unit"), hint));
    }
    let rows = lines.map(|(number, line)| row(place, number + 1, line, unit)).collect::<Result<_>>()?;
    Ok((site.checked(place)?, rows))
}

fn row(place: &str, line_number: usize, line: &str, unit: f64) -> Result<Row> {
    let refuse = |problem: String| {
        Error::input(format!("{place}, line {line_number}"), problem, "give month, day, hour, direct and diffuse light")
    };
    let fields: Vec<&str> = line.split_whitespace().collect();
    if fields.len() < 5 {
        return Err(refuse(format!("has {} columns", fields.len())));
    }
    let mut values = [0.0; 5];
    for (value, field) in values.iter_mut().zip(&fields) {
        *value = field
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| refuse(format!("'{field}' is no number")))?;
    }
    let [month, day, hour, direct, diffuse] = values;
    let whole = |value: f64| if value.fract() == 0.0 && (0.0..=31.0).contains(&value) { value as u8 } else { 0 };
    let measured = match unit {
        2.0 => MeasuredAs::Horizontal { direct, diffuse },
        3.0 => MeasuredAs::Whole(Measured::Illuminance { direct, diffuse }),
        _ => MeasuredAs::Whole(Measured::Irradiance { direct, diffuse }),
    };
    Ok(Row { line: line_number, month: whole(month), day: whole(day), hour, measured, dew_point: None })
}
