//! Glare in a picture of what an eye sees.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DMat3, DVec3};

use super::{LUMENS_PER_WATT, LUMINANCE_WEIGHTS};
use crate::error::{Error, Result};
use crate::image::LinearImage;

/// Pixels of a picture along a side at most.
const MAX_SIDE: usize = 4096;

/// Cells along each axis in which points may be that are within a chord of those of the middle one.
const NEIGHBOURS: i32 = 5;

/// A point of what an eye sees. Axes: x to the right, y up, z ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Unit direction from the eye.
    pub direction: DVec3,
    /// In cd/m².
    pub luminance: f64,
    /// In steradians.
    pub solid_angle: f64,
}

/// What counts as a source of glare. The defaults are those of `evalglare` of Radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlareOptions {
    /// Luminance above which a point is part of a source, in cd/m²: 2,000.
    pub threshold: f64,
    /// Luminance above which a point is part of a source of its own within another one, in cd/m²: 50,000.
    pub peak: f64,
    /// Angle in radians within which points are of the same source: 0.2.
    pub radius: f64,
}

impl Default for GlareOptions {
    fn default() -> Self {
        Self { threshold: 2000.0, peak: 50_000.0, radius: 0.2 }
    }
}

/// A source of glare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlareSource {
    /// Unit direction of its middle, by light.
    pub direction: DVec3,
    /// Mean luminance in cd/m².
    pub luminance: f64,
    /// In steradians.
    pub solid_angle: f64,
    /// See [`position_index`].
    pub position_index: f64,
}

/// Glare that an eye sees.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenGlare {
    /// The daylight glare probability DGP.
    pub probability: f64,
    /// Illuminance across the line of sight, in lux.
    pub eye_lux: f64,
    /// Sources of glare, the brightest for the eye first.
    pub sources: Vec<GlareSource>,
}

impl SeenGlare {
    /// The daylight glare probability of what an eye sees (Wienold and Christoffersen 2006, *Evaluation methods and development of a new glare
    /// prediction model for daylight environments with the use of CCD cameras*, equation 7): `DGP = 5.87·10⁻⁵ E_v + 9.18·10⁻² log₁₀(1 + Σ L² ω / (E_v^1.87
    /// P²)) + 0.16`. It was found for 0.2 to 0.8, and E_v above 380 lx. Points behind the eye are not seen.
    ///
    /// # Errors
    /// Options that are not above 0.
    pub fn of_points(points: &[SeenPoint], options: GlareOptions) -> Result<Self> {
        let GlareOptions { threshold, peak, radius } = options;
        for (name, value) in [("threshold", threshold), ("peak", peak), ("radius", radius)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::input(
                    "glare",
                    format!("the {name} {value} is not above 0"),
                    "give a number above 0",
                ));
            }
        }
        let seen = || points.iter().filter(|point| point.direction.z > 0.0);
        let eye_lux: f64 = seen().map(|point| point.luminance * point.solid_angle * point.direction.z).sum();
        let (peaks, bright): (Vec<_>, Vec<_>) =
            seen().filter(|point| point.luminance > threshold).partition(|point| point.luminance > peak);
        let mut sources: Vec<GlareSource> = [bright, peaks].iter().flat_map(|points| sources(points, radius)).collect();
        let share = |source: &GlareSource| (source.luminance / source.position_index).powi(2) * source.solid_angle;
        sources.sort_by(|a, b| share(b).total_cmp(&share(a)));
        let sum: f64 = sources.iter().map(share).sum();
        let contrast = if sum > 0.0 { (1.0 + sum / eye_lux.powf(1.87)).log10() } else { 0.0 };
        Ok(Self { probability: 5.87e-5 * eye_lux + 9.18e-2 * contrast + 0.16, eye_lux, sources })
    }
}

/// Guth's position index of a direction before the eye, 1 ahead and at most 16: above the line of sight by the equation of the IES *Lighting Handbook*
/// (as in Wienold and Christoffersen 2006, equation 8), below it that of Iwata and Tokura (1997, *Position index for a glare source located below the line
/// of vision*).
pub fn position_index(direction: DVec3) -> f64 {
    let DVec3 { x, y, z } = direction;
    let index = if y < 0.0 {
        // Distances across and down over that ahead.
        let aside = x.hypot(y) / z.max(1e-9);
        1.0 + if aside < 0.6 { 0.8 } else { 1.2 } * aside
    } else {
        let from_vertical = x.abs().atan2(y).to_degrees();
        let from_sight = z.clamp(-1.0, 1.0).acos().to_degrees();
        let linear = 35.2 - 0.31889 * from_vertical - 1.22 * (-2.0 * from_vertical / 9.0).exp();
        let square = 21.0 + 0.26667 * from_vertical - 0.002963 * from_vertical * from_vertical;
        (1e-3 * linear * from_sight + 1e-5 * square * from_sight * from_sight).exp()
    };
    index.clamp(1.0, 16.0)
}

/// The sources that points make which are within an angle of each other.
fn sources(points: &[&SeenPoint], radius: f64) -> Vec<GlareSource> {
    let of_group = |group: Vec<usize>| {
        let (mut towards, mut light, mut solid_angle) = (DVec3::ZERO, 0.0, 0.0);
        for point in group.into_iter().map(|at| points[at]) {
            towards += point.direction * point.luminance * point.solid_angle;
            light += point.luminance * point.solid_angle;
            solid_angle += point.solid_angle;
        }
        let direction = towards.normalize();
        GlareSource {
            direction,
            luminance: light / solid_angle,
            solid_angle,
            position_index: position_index(direction),
        }
    };
    groups(points, radius).into_iter().map(of_group).collect()
}

/// Points in groups, in which each is within an angle of another one.
fn groups(points: &[&SeenPoint], radius: f64) -> Vec<Vec<usize>> {
    let chord = 2.0 * (0.5 * radius.min(PI)).sin();
    // All points of a cell are within the chord of each other, so that cells are joined and not points.
    let edge = chord / 3f64.sqrt();
    let mut cells: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    for (at, point) in points.iter().enumerate() {
        cells.entry((point.direction / edge).floor().as_ivec3().to_array()).or_default().push(at);
    }
    let number_of: BTreeMap<[i32; 3], usize> = cells.keys().enumerate().map(|(number, cell)| (*cell, number)).collect();
    let mut parents: Vec<usize> = (0..cells.len()).collect();
    let is_near = |a: &[usize], b: &[usize]| {
        a.iter().any(|a| b.iter().any(|b| points[*a].direction.distance_squared(points[*b].direction) <= chord * chord))
    };
    for (number, (cell, own)) in cells.iter().enumerate() {
        for step in 0..NEIGHBOURS.pow(3) {
            let offset = [step / NEIGHBOURS.pow(2), step / NEIGHBOURS % NEIGHBOURS, step % NEIGHBOURS];
            let place: [i32; 3] = std::array::from_fn(|axis| cell[axis] + offset[axis] - NEIGHBOURS / 2);
            let Some(&other) = number_of.get(&place).filter(|other| **other < number) else { continue };
            let (from, to) = (root(&parents, number), root(&parents, other));
            if from != to && is_near(own, &cells[&place]) {
                parents[from.max(to)] = from.min(to);
            }
        }
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (number, points) in cells.into_values().enumerate() {
        groups.entry(root(&parents, number)).or_default().extend(points);
    }
    groups.into_values().collect()
}

/// The first cell of the group of a cell.
fn root(parents: &[usize], mut cell: usize) -> usize {
    while parents[cell] != cell {
        cell = parents[cell];
    }
    cell
}

/// What an eye sees in a picture of radiance: a square one is a fisheye of 180° whose distances from the middle are in proportion to angles (`-vta -vh 180
/// -vv 180` of Radiance), and one twice as wide as high a panorama of all directions. `turn` turns the eye from the middle of the picture to the right and up, in
/// degrees; in a fisheye it cannot turn. `place` names the picture in messages.
///
/// # Errors
/// A picture of another shape or of more than 4,096 pixels along a side, a fisheye with a turn, values that are not finite.
pub fn points_of_picture(place: &str, picture: &LinearImage, turn: [f64; 2]) -> Result<Vec<SeenPoint>> {
    let refuse = |problem: String, hint: &str| Err(Error::input(place, problem, hint));
    let (width, height) = (picture.width as usize, picture.height as usize);
    if width.max(height) > MAX_SIDE {
        return refuse(format!("has {width} × {height} pixels"), "give one of at most 4096 along a side");
    }
    if picture.pixels.iter().flatten().any(|value| !value.is_finite()) {
        return refuse("has values that are not finite".into(), "give a picture of radiance");
    }
    let luminance = |at: usize| {
        let weighed = picture.pixels[at].iter().zip(LUMINANCE_WEIGHTS).map(|(value, weight)| value * weight);
        LUMENS_PER_WATT * f64::from(weighed.sum::<f32>()).max(0.0)
    };
    // Places of a pixel's middle, −1 to 1 to the right and up.
    let middle = |at: usize, count: usize| (2 * at + 1) as f64 / count as f64 - 1.0;
    let pixels = (0..width * height).map(|at| (at, middle(at % width, width), -middle(at / width, height)));
    if width == height {
        if turn != [0.0; 2] {
            return refuse(
                "is a fisheye, in which an eye cannot turn".into(),
                "leave out the turn, or give a panorama",
            );
        }
        let area = (2.0 / width as f64).powi(2);
        let seen = pixels.filter(|(_, x, y)| x.hypot(*y) < 1.0).map(|(at, x, y)| {
            let from_middle = x.hypot(y);
            let (sine, cosine) = (from_middle * FRAC_PI_2).sin_cos();
            let per_radius = if from_middle > 0.0 { sine / from_middle } else { FRAC_PI_2 };
            let direction = DVec3::new(x * per_radius, y * per_radius, cosine);
            SeenPoint { direction, luminance: luminance(at), solid_angle: per_radius * FRAC_PI_2 * area }
        });
        return Ok(seen.collect());
    }
    if width != 2 * height {
        let problem = format!("has {width} × {height} pixels, and is neither a fisheye nor a panorama");
        return refuse(problem, "give a square fisheye of 180°, or a panorama twice as wide as high");
    }
    let [right, up] = turn.map(f64::to_radians);
    let to_eye = DMat3::from_rotation_x(up) * DMat3::from_rotation_y(-right);
    let area = TAU / width as f64 * PI / height as f64;
    let seen = pixels.map(|(at, x, y)| {
        let ((sine, cosine), (up, ring)) = ((x * PI).sin_cos(), (y * FRAC_PI_2).sin_cos());
        let direction = to_eye * DVec3::new(sine * ring, up, cosine * ring);
        SeenPoint { direction, luminance: luminance(at), solid_angle: area * ring }
    });
    Ok(seen.collect())
}
