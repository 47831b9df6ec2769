//! Sensors: places at which irradiance is asked for, in a grid or from a list.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::file::{GridEntry, PointAxes};
use super::folders::Folders;
use crate::error::{Error, Result};
use crate::files::read_input_text;
use crate::matrix::MatrixShape;

/// Bytes of a file of points at most.
const MAX_POINT_BYTES: u64 = 256 << 20;

/// Sensors of a plane at most.
const MAX_SENSORS: f64 = 1e7;

/// A place with a direction in which it looks: irradiance is that on a plane across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Place, counted from the scene's origin.
    pub position: Vec3,
    /// Unit normal of the plane, on the side that light counts of.
    pub normal: Vec3,
}

/// The sensors of a view, row by row: each is a pixel of its matrix, whose entries are irradiance and not radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Name, for people and files.
    pub name: String,
    across: u32,
    points: Vec<Sensor>,
}

impl Sensors {
    /// Sensors in rows of `across`.
    ///
    /// # Errors
    /// No sensors, rows that are not full, places or normals that are not finite, normals of no length.
    pub fn new(name: impl Into<String>, across: u32, mut points: Vec<Sensor>) -> Result<Self> {
        let name = name.into();
        let refuse = |problem: String| Err(Error::input(format!("grid '{name}'"), problem, ""));
        if points.is_empty() || across == 0 || !points.len().is_multiple_of(across as usize) {
            return refuse(format!("{} points do not make full rows of {across}", points.len()));
        }
        for (number, point) in points.iter_mut().enumerate() {
            let normal = point.normal.try_normalize().filter(|_| point.position.is_finite());
            let Some(normal) = normal else {
                return refuse(format!("point {} is not finite, or its normal has no length", number + 1));
            };
            point.normal = normal;
        }
        Ok(Self { name, across, points })
    }

    /// Sensors (across, down).
    pub fn size(&self) -> (u32, u32) {
        (self.across, self.points.len() as u32 / self.across)
    }

    /// The sensors, row by row.
    pub fn points(&self) -> &[Sensor] {
        &self.points
    }

    /// The sensor of a pixel (x, y). Panics if there is none.
    pub fn at(&self, (x, y): (u32, u32)) -> &Sensor {
        &self.points[(y * self.across + x) as usize]
    }

    /// How the settings of a job say that its rows are irradiance here.
    pub fn in_words(&self) -> String {
        format!("{IRRADIANCE}{} sensors", self.points.len())
    }
}

/// What the settings of a job begin the description of its view with, where its rows are irradiance.
pub const IRRADIANCE: &str = "irradiance; ";

/// Whether the settings of a job say that its rows are irradiance, at sensors or at what a camera sees.
pub fn shows_irradiance(settings: &str) -> bool {
    settings.contains(IRRADIANCE)
}

/// The sensors of an entry, counted from the scene's origin. `place` names it in messages.
pub(super) fn sensors(entry: &GridEntry, origin: DVec3, folders: &Folders, place: &str) -> Result<Sensors> {
    let refuse = |problem: &str, hint: &str| Err(Error::input(place, problem, hint));
    let is_plane = [entry.origin.is_some(), entry.edge_u.is_some(), entry.edge_v.is_some(), entry.spacing.is_some()];
    match &entry.points {
        Some(_) if is_plane.contains(&true) || entry.faces.is_some() => {
            refuse("has both points and a plane", "give points, or origin, edge_u, edge_v and spacing")
        }
        Some(file) => of_file(entry, &folders.find(file, place)?, origin),
        None if is_plane.contains(&false) => {
            refuse("lacks a key", "give points, or origin, edge_u, edge_v and spacing")
        }
        None => of_plane(entry, origin, place),
    }
}

fn of_plane(entry: &GridEntry, origin: DVec3, place: &str) -> Result<Sensors> {
    let refuse = |problem: String, hint: &str| Err(Error::input(place, problem, hint));
    let corner = (DVec3::from(entry.origin.unwrap_or_default()) - origin).as_vec3();
    let [u, v] = [entry.edge_u, entry.edge_v].map(|edge| Vec3::from(edge.unwrap_or_default()));
    let spacing = entry.spacing.unwrap_or(0.0);
    if !(spacing > 0.0 && spacing.is_finite()) {
        return refuse(format!("spacing {spacing}"), "give a length above 0, in the unit of the geometry");
    }
    let across = u.cross(v);
    if across.length() <= 1e-6 * u.length() * v.length() || !across.is_finite() {
        return refuse("edge_u and edge_v span no plane".into(), "give two edges at an angle");
    }
    // Up, where the plane does not stand upright.
    let mut normal = if across.y < 0.0 { -across } else { across }.normalize();
    if let Some(faces) = entry.faces {
        let side = Vec3::from(faces).dot(normal);
        if side.abs() < 1e-6 || !side.is_finite() {
            return refuse("'faces' lies in the plane of the grid".into(), "let it point to the side that looks");
        }
        normal *= side.signum();
    }
    let count = |edge: Vec3| f64::from((edge.length() / spacing).round().max(1.0));
    let (columns, rows) = (count(u), count(v));
    if columns * rows > MAX_SENSORS {
        return refuse(format!("{columns} × {rows} points"), "give a larger spacing");
    }
    let at = |index: u32| {
        let (x, y) = (index % columns as u32, index / columns as u32);
        let inside = |at: u32, count: f64| ((f64::from(at) + 0.5) / count) as f32;
        Sensor { position: corner + u * inside(x, columns) + v * inside(y, rows), normal }
    };
    Sensors::new(&*entry.name, columns as u32, (0..(columns * rows) as u32).map(at).collect())
}

/// Reads Radiance's list of points: six numbers a line, a place and a direction.
fn of_file(entry: &GridEntry, path: &Path, origin: DVec3) -> Result<Sensors> {
    let text = read_input_text(path, "read the points", MAX_POINT_BYTES)?;
    let turned = |[x, y, z]: [f64; 3]| match entry.axes.unwrap_or_default() {
        PointAxes::ZUp => DVec3::new(x, z, -y),
        PointAxes::YUp => DVec3::new(x, y, z),
    };
    let mut points = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let place = || format!("{}, line {}", path.display(), number + 1);
        let numbers: Result<Vec<f64>, _> =
            line.split([' ', '\t', ',']).filter(|word| !word.is_empty()).map(str::parse).collect();
        let Ok(Ok([x, y, z, a, b, c])) = numbers.map(<[f64; 6]>::try_from) else {
            return Err(Error::input(place(), "is no point", "give six numbers: x y z and the normal's x y z"));
        };
        let point = Sensor { position: (turned([x, y, z]) - origin).as_vec3(), normal: turned([a, b, c]).as_vec3() };
        if point.normal.try_normalize().is_none() || !point.position.is_finite() {
            let hint = "give the direction that it looks in, such as 0 0 1";
            return Err(Error::input(place(), "has a normal without length, or is not finite", hint));
        }
        points.push(point);
    }
    if points.is_empty() {
        return Err(Error::input(path.display().to_string(), "has no points", "give six numbers on each line"));
    }
    if points.len() > MatrixShape::MAX_IMAGE_SIDE as usize {
        let problem = format!("has {} points, more than {} in a row", points.len(), MatrixShape::MAX_IMAGE_SIDE);
        return Err(Error::input(path.display().to_string(), problem, "make several lists of them"));
    }
    Sensors::new(&*entry.name, points.len() as u32, points)
}
