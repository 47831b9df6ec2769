//! A pinhole camera.

use glam::{Vec2, Vec3};

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
    /// Unit direction in world space through an image position in pixels, origin at the top left.
    pub fn direction(&self, position: Vec2) -> Vec3 {
        let half_height = (0.5 * self.vertical_fov_radians).tan();
        let scale = 2.0 * half_height / self.height as f32;
        let x = (position.x - 0.5 * self.width as f32) * scale;
        let y = (0.5 * self.height as f32 - position.y) * scale;
        (self.forward + self.right * x + self.up * y).normalize()
    }
}
