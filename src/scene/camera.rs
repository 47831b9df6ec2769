//! A pinhole camera.

use glam::{DVec3, Vec2, Vec3};

use super::origin;
use crate::decimal;
use crate::error::{Error, Result};

/// Filter with which samples make a pixel. Samples are drawn from the filter's shape (filter importance sampling), so
/// each belongs to one pixel and blocks stay independent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelFilter {
    /// The pixel's own square.
    Box,
    /// A tent of this radius in pixels.
    Tent {
        /// Radius in pixels.
        radius: f32,
    },
    /// A Gaussian cut at three standard deviations.
    Gaussian {
        /// Standard deviation in pixels.
        deviation: f32,
    },
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye in world space.
    pub eye: Vec3,
    /// Unit viewing direction.
    pub forward: Vec3,
    /// Unit vector to the right of the image.
    pub right: Vec3,
    /// Unit vector to the top of the image.
    pub up: Vec3,
    /// Vertical field of view.
    pub vertical_fov_radians: f32,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Pixel filter.
    pub filter: PixelFilter,
}

impl Camera {
    /// A camera at `eye` that looks along `direction`, with `up` as near to the top of the image as that allows.
    ///
    /// # Errors
    /// Values that are not finite, a direction of no length or along `up`, a field of view outside (0, π), an
    /// image without pixels.
    pub fn looking(
        eye: Vec3,
        direction: Vec3,
        up: Vec3,
        vertical_fov_radians: f32,
        (width, height): (u32, u32),
        filter: PixelFilter,
    ) -> Result<Self> {
        let refuse = |problem: &str, hint: &str| Err(Error::input("camera", problem, hint));
        if !(eye.is_finite() && direction.is_finite() && up.is_finite()) {
            return refuse("has a value that is not finite", "give finite numbers");
        }
        let Some(forward) = direction.try_normalize() else {
            return refuse(
                "looks in no direction",
                "give a look_at that is not the eye, or a direction of some length",
            );
        };
        // Below a milliradian between the two, the roll of the image would hang on rounding.
        let across = forward.cross(up.normalize_or_zero());
        if across.length() < 1e-3 {
            return refuse("'up' is zero or lies along the viewing direction", "choose another up vector");
        }
        let right = across.normalize();
        if !(vertical_fov_radians > 0.0 && vertical_fov_radians < std::f32::consts::PI) {
            return refuse("the vertical field of view must lie between 0 and 180 degrees", "45 is a usual one");
        }
        if width == 0 || height == 0 {
            return refuse("the image has no pixels", "give a width and a height of at least 1");
        }
        Ok(Self { eye, forward, right, up: right.cross(forward), vertical_fov_radians, width, height, filter })
    }

    /// Unit direction in world space through an image position in pixels, origin at the top left.
    pub fn direction(&self, position: Vec2) -> Vec3 {
        let half_height = (0.5 * self.vertical_fov_radians).tan();
        let scale = 2.0 * half_height / self.height as f32;
        let x = (position.x - 0.5 * self.width as f32) * scale;
        let y = (0.5 * self.height as f32 - position.y) * scale;
        (self.forward + self.right * x + self.up * y).normalize()
    }

    /// Position in pixels at which a unit direction is seen, also beside the image; none behind the eye.
    pub fn position(&self, direction: Vec3) -> Option<Vec2> {
        let depth = direction.dot(self.forward);
        if depth < 1e-6 {
            return None;
        }
        let scale = 0.5 * self.height as f32 / (0.5 * self.vertical_fov_radians).tan() / depth;
        let (x, y) = (direction.dot(self.right) * scale, direction.dot(self.up) * scale);
        Some(Vec2::new(0.5 * self.width as f32 + x, 0.5 * self.height as f32 - y))
    }

    /// The camera of a scene with this origin as a job's settings state it, in the keys and coordinates of its file.
    pub fn in_words(&self, origin: DVec3) -> String {
        let [direction, up] = [self.forward, self.up].map(|v| decimal::list(v.to_array(), decimal::of_f32));
        let eye = decimal::list(origin::in_file(origin, self.eye).to_array(), decimal::of_f64);
        let degrees = decimal::of_f32(self.vertical_fov_radians.to_degrees());
        let origin = origin::in_words(origin);
        format!("{WORDS}{origin}eye = {eye}, direction = {direction}, up = {up}, vertical_fov_degrees = {degrees}")
    }

    /// The camera described in a job's settings, for an image of this size, without a pixel filter. `None` without a
    /// description, or if the matrix is a part of what was rendered. Its position is relative to the stated origin, as
    /// the lights' positions are ([`stated_origin`](super::stated_origin)).
    pub fn of_words(settings: &str, size: (u32, u32)) -> Option<Self> {
        let words = settings.split_once(WORDS)?.1;
        if words.contains(';') {
            return None;
        }
        let after = |key: &str| words.split_once(key)?.1.strip_prefix(" = ");
        let vector = |key: &str| {
            let inside = after(key)?.strip_prefix('[')?.split_once(']')?.0;
            let mut numbers = inside.split(',').map(|number| number.trim().parse::<f64>());
            let vector = DVec3::new(numbers.next()?.ok()?, numbers.next()?.ok()?, numbers.next()?.ok()?);
            numbers.next().is_none().then_some(vector)
        };
        let degrees: f32 = after("vertical_fov_degrees")?.trim().parse().ok()?;
        let (eye, direction, up) = (vector("eye")?, vector("direction")?.as_vec3(), vector("up")?.as_vec3());
        let eye = (eye - origin::stated_origin(words)).as_vec3();
        Self::looking(eye, direction, up, degrees.to_radians(), size, PixelFilter::Box).ok()
    }
}

/// Prefix of the text of [`Camera::in_words`].
const WORDS: &str = "camera: ";

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let (eye, direction) = (Vec3::new(-4.5, 1e-7, 1e6), Vec3::new(0.3, -0.2, 0.9));
        Camera::looking(eye, direction, Vec3::Y, 0.7, (640, 480), PixelFilter::Box).unwrap()
    }

    #[test]
    fn a_position_is_the_inverse_of_a_direction() {
        let camera = camera();
        for at in [Vec2::new(0.5, 0.5), Vec2::new(320.0, 240.0), Vec2::new(-90.0, 700.0)] {
            let found = camera.position(camera.direction(at)).unwrap();
            assert!((found - at).length() < 1e-2, "{found} for {at}");
        }
        assert_eq!(camera.position(-camera.forward), None);
    }

    #[test]
    fn a_camera_survives_its_words_and_nothing_else_is_one() {
        let camera = camera();
        let words = format!("64 samples per pixel, depth 8, seed 1; {}", camera.in_words(DVec3::ZERO));
        let found = Camera::of_words(&words, (640, 480)).unwrap();
        assert_eq!(found.eye, camera.eye);
        // Two normalisations and two changes of unit round.
        assert!((found.forward - camera.forward).length() < 1e-6 && (found.up - camera.up).length() < 1e-6);
        assert!((found.vertical_fov_radians - camera.vertical_fov_radians).abs() < 1e-6);
        let origin = DVec3::new(691_000.0, 0.0, -5_335_000.0);
        let moved = Camera::of_words(&camera.in_words(origin), (640, 480)).unwrap();
        assert_eq!((moved.eye, moved.forward), (camera.eye, found.forward));
        for other in ["", "64 samples per pixel, depth 8, seed 1", "camera: eye = [1, 2], direction = [0, 0, 1]"] {
            assert_eq!(Camera::of_words(other, (640, 480)), None, "{other}");
        }
        assert_eq!(Camera::of_words(&words.replace("0.7", "NaN").replace("40.1", "900"), (640, 480)), None);
        assert_eq!(Camera::of_words(&format!("{words}; pixels 0,0,9x9 and 2 lights of it"), (9, 9)), None);
    }
}
