//! A pinhole camera.

use glam::{Vec2, Vec3};

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
}
