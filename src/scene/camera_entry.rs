//! `[camera]` of a scene file, and the same keys in the settings of a job.

use glam::{DVec3, Vec2, Vec3};

use super::file::{CameraEntry, FilterEntry, ProjectionEntry};
use super::{Camera, Lens, PixelFilter, Projection, origin};
use crate::decimal::{self, list, of_f32};
use crate::error::{Error, Result};
use crate::light::Job;

/// Prefix of the text of [`Camera::in_words`].
const WORDS: &str = "camera: ";

/// Most bytes of such a text.
const MAX_WORDS: usize = 4096;

/// The camera of an entry, counted from the scene's origin. Errors: keys that contradict each other, values out of range.
pub(super) fn camera(entry: &CameraEntry, origin: DVec3, place: &str) -> Result<Camera> {
    let place = format!("{place}, [camera]");
    let refuse = |problem: &str, hint: &str| Error::input(place.clone(), problem, hint);
    let eye = DVec3::from(entry.eye);
    let direction = match (entry.look_at, entry.direction) {
        (Some(at), None) => (DVec3::from(at) - eye).as_vec3(),
        (None, Some(direction)) => direction.into(),
        (None, None) => return Err(refuse("says not where it looks", "give look_at or direction")),
        (Some(_), Some(_)) => return Err(refuse("has both look_at and direction", "give one of them")),
    };
    let projection = projection(entry).map_err(|(problem, hint)| refuse(problem, hint))?;
    let lens = lens(entry).map_err(|(problem, hint)| refuse(problem, hint))?;
    let filter = filter(entry).map_err(|(problem, hint)| refuse(problem, hint))?;
    let usual = if projection == Projection::Panorama { (960, 480) } else { (640, 480) };
    let size = (entry.width.unwrap_or(usual.0), entry.height.unwrap_or(usual.1));
    let up = entry.up.map_or(Vec3::Y, Vec3::from);
    let made = || {
        let camera = Camera::looking((eye - origin).as_vec3(), direction, up, 1.0, size, filter)?;
        let camera = camera.projected(projection)?;
        let camera = camera.shifted(entry.shift.unwrap_or_default().into())?;
        let camera = camera.with_pixel_aspect(entry.pixel_aspect.unwrap_or(1.0))?;
        lens.map_or(Ok(camera), |lens| camera.with_lens(lens))
    };
    made().map_err(|error| match error {
        Error::Input { problem, hint, .. } => Error::input(place, problem, hint),
        other => other,
    })
}

/// A problem and a hint.
type Refusal = (&'static str, &'static str);

fn projection(entry: &CameraEntry) -> std::result::Result<Projection, Refusal> {
    let kind = entry.projection.unwrap_or_default();
    if entry.vertical_fov_degrees.is_some() && kind != ProjectionEntry::Perspective {
        return Err(("only a perspective camera has vertical_fov_degrees", "leave it out"));
    }
    if entry.view_height.is_some() && kind != ProjectionEntry::Orthographic {
        return Err((
            "only an orthographic camera has a view_height",
            "say projection = \"orthographic\", or leave it out",
        ));
    }
    Ok(match kind {
        ProjectionEntry::Perspective => {
            Projection::Perspective { vertical_fov_radians: entry.vertical_fov_degrees.unwrap_or(45.0).to_radians() }
        }
        ProjectionEntry::Orthographic => Projection::Orthographic {
            height: entry.view_height.ok_or((
                "is orthographic without a view_height",
                "give the height of what it sees, in the geometry's unit",
            ))?,
        },
        ProjectionEntry::Panorama => Projection::Panorama,
    })
}

fn lens(entry: &CameraEntry) -> std::result::Result<Option<Lens>, Refusal> {
    let stated = [entry.focus_distance.is_some(), entry.blades.is_some(), entry.blade_rotation_degrees.is_some()];
    match (entry.aperture_radius, entry.focus_distance) {
        (None, _) if stated.contains(&true) => {
            Err(("has a lens without an aperture_radius", "give the focal length over twice the f-number"))
        }
        (None | Some(0.0), _) => Ok(None),
        (Some(_), None) => Err(("has an aperture_radius without a focus_distance", "give the distance that is sharp")),
        (Some(radius), Some(focus_distance)) => Ok(Some(Lens {
            radius,
            focus_distance,
            blades: entry.blades.unwrap_or(0),
            rotation_radians: entry.blade_rotation_degrees.unwrap_or(0.0).to_radians(),
        })),
    }
}

fn filter(entry: &CameraEntry) -> std::result::Result<PixelFilter, Refusal> {
    let radius = entry.filter_radius;
    if radius.is_some_and(|r| !(0.0..=8.0).contains(&r)) {
        return Err(("filter_radius is out of range", "give 0 to 8 pixels"));
    }
    match (entry.filter.unwrap_or(FilterEntry::Box), radius) {
        (FilterEntry::Box, None) => Ok(PixelFilter::Box),
        (FilterEntry::Box, Some(_)) => Err(("a box filter has no filter_radius", "leave it out, or choose \"tent\"")),
        (FilterEntry::Tent, radius) => Ok(PixelFilter::Tent { radius: radius.unwrap_or(1.0) }),
        (FilterEntry::Gaussian, radius) => Ok(PixelFilter::Gaussian { deviation: radius.unwrap_or(1.5) / 3.0 }),
    }
}

impl Camera {
    /// The camera of a scene with this origin as a job's settings state it, in the keys and coordinates of its file. What
    /// is as a camera has it by default is left out, so that the text of such cameras never changes.
    pub fn in_words(&self, origin: DVec3) -> String {
        let [direction, up] = [self.forward, self.up].map(|v| list(v.to_array(), of_f32));
        let eye = list(origin::in_file(origin, self.eye).to_array(), decimal::of_f64);
        let origin = origin::in_words(origin);
        let mut text = format!("{WORDS}{origin}eye = {eye}, direction = {direction}, up = {up}, ");
        text += &match self.projection {
            Projection::Perspective { vertical_fov_radians } => {
                format!("vertical_fov_degrees = {}", of_f32(vertical_fov_radians.to_degrees()))
            }
            Projection::Orthographic { height } => {
                format!("projection = \"orthographic\", view_height = {}", of_f32(height))
            }
            Projection::Panorama => "projection = \"panorama\"".into(),
        };
        if self.shift != Vec2::ZERO {
            text += &format!(", shift = {}", list(self.shift.to_array(), of_f32));
        }
        if self.pixel_aspect != 1.0 {
            text += &format!(", pixel_aspect = {}", of_f32(self.pixel_aspect));
        }
        if let Some(Lens { radius, focus_distance, blades, rotation_radians }) = self.lens {
            let [radius, distance, turn] = [radius, focus_distance, rotation_radians.to_degrees()].map(of_f32);
            text += &format!(", aperture_radius = {radius}, focus_distance = {distance}");
            text += &format!(", blades = {blades}, blade_rotation_degrees = {turn}");
        }
        text
    }

    /// The camera that a matrix was rendered with, where its job states one ([`of_words`](Self::of_words)).
    pub fn of_job(job: &Job) -> Option<Self> {
        Self::of_words(&job.provenance.settings, (job.shape.width(), job.shape.height()))
    }

    /// The camera described in a job's settings, for an image of this size, without a pixel filter. `None` without a
    /// description, or if the matrix is a part of what was rendered. Its position is relative to the stated origin, as
    /// the lights' positions are ([`stated_origin`](super::stated_origin)).
    pub fn of_words(settings: &str, size: (u32, u32)) -> Option<Self> {
        let words = settings.split_once(WORDS)?.1;
        if words.contains(';') || words.len() > MAX_WORDS {
            return None;
        }
        let keys = &words[words.find("eye = ")?..];
        let entry: CameraEntry = toml::from_str::<Described>(&format!("camera = {{ {keys} }}")).ok()?.camera;
        let entry = CameraEntry { width: Some(size.0), height: Some(size.1), ..entry };
        camera(&entry, origin::stated_origin(words), "").ok()
    }
}

/// The keys of a camera as the text of a job has them.
#[derive(serde::Deserialize)]
struct Described {
    camera: CameraEntry,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> Camera {
        let (eye, direction) = (Vec3::new(-4.5, 1e-7, 1e6), Vec3::new(0.3, -0.2, 0.9));
        Camera::looking(eye, direction, Vec3::Y, 0.7, (640, 480), PixelFilter::Box).unwrap()
    }

    #[test]
    fn a_camera_survives_its_words_and_nothing_else_is_one() {
        let camera = plain();
        let words = format!("64 samples per pixel, depth 8, seed 1; {}", camera.in_words(DVec3::ZERO));
        assert!(words.ends_with(", vertical_fov_degrees = 40.107044"), "{words}");
        let found = Camera::of_words(&words, (640, 480)).unwrap();
        assert_eq!(found.eye, camera.eye);
        // Two normalisations and two changes of unit round.
        let near = |found: Camera, camera: Camera| {
            (found.forward - camera.forward).length() < 1e-6 && (found.up - camera.up).length() < 1e-6
        };
        assert!(near(found, camera));
        let Projection::Perspective { vertical_fov_radians } = found.projection else { panic!("{found:?}") };
        assert!((vertical_fov_radians - 0.7).abs() < 1e-6);
        let origin = DVec3::new(691_000.0, 0.0, -5_335_000.0);
        let moved = Camera::of_words(&camera.in_words(origin), (640, 480)).unwrap();
        assert_eq!((moved.eye, moved.forward), (camera.eye, found.forward));
        for other in ["", "64 samples per pixel, depth 8, seed 1", "camera: eye = [1, 2], direction = [0, 0, 1]"] {
            assert_eq!(Camera::of_words(other, (640, 480)), None, "{other}");
        }
        assert_eq!(Camera::of_words(&words.replace("40.1", "NaN"), (640, 480)), None);
        assert_eq!(Camera::of_words(&words.replace("40.1", "900"), (640, 480)), None);
        assert_eq!(Camera::of_words(&format!("{words}; pixels 0,0,9x9 and 2 lights of it"), (9, 9)), None);

        let flat = camera.projected(Projection::Orthographic { height: 2.5 }).unwrap();
        let lens = Lens { radius: 0.125, focus_distance: 3.0, blades: 5, rotation_radians: 0.0 };
        let shifted = camera.shifted(Vec2::new(0.25, -1e-5)).unwrap().with_pixel_aspect(1.5).unwrap();
        let others = [flat, camera.projected(Projection::Panorama).unwrap(), shifted.with_lens(lens).unwrap()];
        for camera in others {
            let found = Camera::of_words(&camera.in_words(origin), (640, 480)).unwrap();
            assert!(near(found, camera));
            let is_perspective = matches!(camera.projection, Projection::Perspective { .. });
            assert!(is_perspective || found.projection == camera.projection, "{found:?}");
            assert_eq!((found.shift, found.pixel_aspect), (camera.shift, camera.pixel_aspect));
            assert_eq!((found.eye, found.lens), (camera.eye, camera.lens));
        }
    }
}
