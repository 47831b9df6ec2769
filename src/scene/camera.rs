//! Cameras: a projection, a lens and a shift.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::Lens;
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

/// How the image shows what is before the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// All rays leave the eye; the image is flat.
    Perspective {
        /// Field of view from the lower to the upper edge, as it is without a shift.
        vertical_fov_radians: f32,
    },
    /// All rays leave the plane through the eye, along the viewing direction.
    Orthographic {
        /// Height of the image, in scene units.
        height: f32,
    },
    /// All directions around the eye by latitude and longitude (equirectangular), with the viewing direction in the middle.
    Panorama,
}

/// A camera.
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
    /// Projection.
    pub projection: Projection,
    /// How far the middle of the image lies to the right of the viewing direction, and above it, in units of the image's larger side.
    pub shift: Vec2,
    /// Width of a pixel over its height.
    pub pixel_aspect: f32,
    /// The lens; without one everything is in focus.
    pub lens: Option<Lens>,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Pixel filter.
    pub filter: PixelFilter,
}

impl Projection {
    /// Its name in scene files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Perspective { .. } => "perspective",
            Self::Orthographic { .. } => "orthographic",
            Self::Panorama => "panorama",
        }
    }
}

impl Camera {
    /// A perspective camera at `eye` that looks along `direction`, with `up` as near to the top of the image as that allows. Its pixels are
    /// square; it has no shift and no lens.
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
        if width == 0 || height == 0 {
            return refuse("the image has no pixels", "give a width and a height of at least 1");
        }
        let camera = Self {
            eye,
            forward,
            right,
            up: right.cross(forward),
            projection: Projection::Panorama,
            shift: Vec2::ZERO,
            pixel_aspect: 1.0,
            lens: None,
            width,
            height,
            filter,
        };
        camera.projected(Projection::Perspective { vertical_fov_radians })
    }

    /// What stands for a camera where there are sensors: only the size counts.
    pub(super) fn of_sensors((width, height): (u32, u32)) -> Self {
        Self {
            eye: Vec3::ZERO,
            forward: Vec3::NEG_Z,
            right: Vec3::X,
            up: Vec3::Y,
            projection: Projection::Panorama,
            shift: Vec2::ZERO,
            pixel_aspect: 1.0,
            lens: None,
            width,
            height,
            filter: PixelFilter::Box,
        }
    }

    /// The camera with another projection.
    ///
    /// # Errors
    /// A field of view outside (0, π), an image whose height is not above 0, a panorama of a camera with a lens, a shift or pixels that are
    /// not square.
    pub fn projected(mut self, projection: Projection) -> Result<Self> {
        match projection {
            Projection::Perspective { vertical_fov_radians: fov } if !(fov > 0.0 && fov < PI) => {
                return refuse("the vertical field of view must lie between 0 and 180 degrees", "45 is a usual one");
            }
            Projection::Orthographic { height } if !(height > 0.0 && height.is_finite()) => {
                return refuse("the height of an orthographic view must be above 0", "give it in the geometry's unit");
            }
            _ => self.projection = projection,
        }
        self.checked()
    }

    /// The camera with a shift of its image to the right and up, in units of the image's larger side.
    ///
    /// # Errors
    /// A shift beyond ±100 or that is not finite; that of a panorama.
    pub fn shifted(mut self, shift: Vec2) -> Result<Self> {
        if !shift.abs().cmple(Vec2::splat(MAX_SHIFT)).all() {
            return refuse("the shift is not a share of the image", "give two numbers, such as [0, 0.25]");
        }
        self.shift = shift;
        self.checked()
    }

    /// The camera with pixels of this width over their height.
    ///
    /// # Errors
    /// A number outside 0.01 to 100; pixels of a panorama that are not square.
    pub fn with_pixel_aspect(mut self, pixel_aspect: f32) -> Result<Self> {
        if !(0.01..=100.0).contains(&pixel_aspect) {
            return refuse(
                "the shape of the pixels is out of range",
                "give their width over their height, 0.01 to 100",
            );
        }
        self.pixel_aspect = pixel_aspect;
        self.checked()
    }

    /// The camera with a lens.
    ///
    /// # Errors
    /// Those of [`Lens::checked`]; a panorama.
    pub fn with_lens(mut self, lens: Lens) -> Result<Self> {
        self.lens = Some(lens.checked()?);
        self.checked()
    }

    fn checked(self) -> Result<Self> {
        let is_plain = self.lens.is_none() && self.shift == Vec2::ZERO && self.pixel_aspect == 1.0;
        if self.projection == Projection::Panorama && !is_plain {
            return refuse("a panorama has no lens, no shift and square pixels", "leave them out");
        }
        Ok(self)
    }

    /// Field of view of a perspective camera from the lower to the upper edge.
    pub fn vertical_fov_radians(&self) -> Option<f32> {
        match self.projection {
            Projection::Perspective { vertical_fov_radians } => Some(vertical_fov_radians),
            Projection::Orthographic { .. } | Projection::Panorama => None,
        }
    }

    /// Whether all rays leave along one direction.
    pub fn is_orthographic(&self) -> bool {
        matches!(self.projection, Projection::Orthographic { .. })
    }

    /// The ray through an image position in pixels, counted from the top left, and the middle of the lens: its origin and unit direction
    /// in world space.
    #[inline(always)]
    pub fn ray(&self, position: Vec2) -> (Vec3, Vec3) {
        match self.projection {
            Projection::Perspective { vertical_fov_radians } => {
                let at = self.on_plane(position, 2.0 * (0.5 * vertical_fov_radians).tan());
                (self.eye, (self.forward + self.right * at.x + self.up * at.y).normalize())
            }
            Projection::Orthographic { height } => {
                let at = self.on_plane(position, height);
                (self.eye + self.right * at.x + self.up * at.y, self.forward)
            }
            Projection::Panorama => {
                let (sin, cos) = (position.x / self.width as f32 * TAU).sin_cos();
                let (ring, height) = (position.y / self.height as f32 * PI).sin_cos();
                (self.eye, (self.up * height - (self.right * sin + self.forward * cos) * ring).normalize())
            }
        }
    }

    /// Unit direction in world space of the ray through an image position in pixels.
    pub fn direction(&self, position: Vec2) -> Vec3 {
        self.ray(position).1
    }

    /// Position in pixels at which a unit direction is seen that leads infinitely far, also beside the image. None behind a perspective
    /// camera, and of an orthographic one, which sees one direction everywhere.
    pub fn position(&self, direction: Vec3) -> Option<Vec2> {
        match self.projection {
            Projection::Perspective { vertical_fov_radians } => {
                let depth = direction.dot(self.forward);
                let at = Vec2::new(direction.dot(self.right), direction.dot(self.up)) / depth;
                (depth >= 1e-6).then(|| self.in_pixels(at, 2.0 * (0.5 * vertical_fov_radians).tan()))
            }
            Projection::Orthographic { .. } => None,
            Projection::Panorama => {
                let turn = (-direction.dot(self.right)).atan2(-direction.dot(self.forward)).rem_euclid(TAU);
                let down = direction.dot(self.up).clamp(-1.0, 1.0).acos();
                Some(Vec2::new(turn / TAU * self.width as f32, down / PI * self.height as f32))
            }
        }
    }

    /// Position in pixels at which a point is seen, also beside the image and behind what hides it; none behind the camera.
    pub fn position_of(&self, point: Vec3) -> Option<Vec2> {
        let offset = point - self.eye;
        match self.projection {
            Projection::Orthographic { height } => {
                let at = Vec2::new(offset.dot(self.right), offset.dot(self.up));
                (offset.dot(self.forward) >= 0.0).then(|| self.in_pixels(at, height))
            }
            _ => self.position(offset.try_normalize()?),
        }
    }

    /// A vector from a point towards the camera, of any length.
    pub fn towards(&self, point: Vec3) -> Vec3 {
        if self.is_orthographic() { -self.forward } else { self.eye - point }
    }

    /// Where a position lies on a plane before the camera on which the image has a height.
    #[inline(always)]
    fn on_plane(&self, position: Vec2, height: f32) -> Vec2 {
        let scale = height / self.height as f32;
        let x = (position.x - 0.5 * self.width as f32) * scale * self.pixel_aspect;
        let y = (0.5 * self.height as f32 - position.y) * scale;
        Vec2::new(x, y) + self.shift * (scale * self.larger_side())
    }

    /// The inverse of [`Self::on_plane`].
    fn in_pixels(&self, at: Vec2, height: f32) -> Vec2 {
        let at = at * (self.height as f32 / height) - self.shift * self.larger_side();
        Vec2::new(0.5 * self.width as f32 + at.x / self.pixel_aspect, 0.5 * self.height as f32 - at.y)
    }

    /// The larger side of the image in heights of a pixel.
    #[inline(always)]
    fn larger_side(&self) -> f32 {
        (self.width as f32 * self.pixel_aspect).max(self.height as f32)
    }
}

/// Largest shift.
const MAX_SHIFT: f32 = 100.0;

fn refuse<T>(problem: &str, hint: &str) -> Result<T> {
    Err(Error::input("camera", problem, hint))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::EnvironmentMapping;

    fn camera() -> Camera {
        let (eye, direction) = (Vec3::new(-4.5, 1e-7, 1e3), Vec3::new(0.3, -0.2, 0.9));
        Camera::looking(eye, direction, Vec3::Y, 0.7, (640, 480), PixelFilter::Box).unwrap()
    }

    /// Several of each projection, with shifts and pixels of all shapes.
    fn cameras() -> Vec<Camera> {
        let shaped = |camera: Camera| camera.shifted(Vec2::new(0.25, -0.5)).unwrap().with_pixel_aspect(1.5).unwrap();
        let flat = camera().projected(Projection::Orthographic { height: 3.0 }).unwrap();
        vec![camera(), shaped(camera()), flat, shaped(flat), camera().projected(Projection::Panorama).unwrap()]
    }

    #[test]
    fn a_position_is_the_inverse_of_a_ray() {
        for camera in cameras() {
            for at in [Vec2::new(0.5, 0.5), Vec2::new(320.0, 240.0), Vec2::new(90.0, 470.0)] {
                let (origin, direction) = camera.ray(at);
                assert!((direction.length() - 1.0).abs() < 1e-6);
                // Along some hundreds of pixels f32 has five digits left where the eye is a thousand units away.
                let found = camera.position_of(origin + direction * 20.0).unwrap();
                assert!((found - at).length() < 5e-2, "{found} for {at}: {camera:?}");
                match camera.position(direction) {
                    Some(found) => assert!((found - at).length() < 1e-2, "{found} for {at}: {camera:?}"),
                    None => assert!(camera.is_orthographic()),
                }
                assert!(camera.towards(origin + direction).dot(direction) < 0.0);
            }
        }
        assert_eq!(camera().position(-camera().forward), None);
        assert_eq!(camera().position(camera().right), None);
        assert_eq!(cameras()[2].position_of(camera().eye - camera().forward), None);
    }

    #[test]
    fn a_pixel_of_an_orthographic_camera_sees_the_point_below_it() {
        // From above, +x to the right and −z to the top: a pixel is a square of 1/8.
        let camera =
            Camera::looking(Vec3::new(2.0, 10.0, 3.0), Vec3::NEG_Y, Vec3::NEG_Z, 1.0, (32, 16), PixelFilter::Box);
        let camera = camera.unwrap().projected(Projection::Orthographic { height: 2.0 }).unwrap();
        for (at, x, z) in [([16.0, 8.0], 2.0, 3.0), ([24.0, 8.0], 3.0, 3.0), ([0.0, 0.0], 0.0, 2.0)] {
            assert_eq!(camera.ray(at.into()), (Vec3::new(x, 10.0, z), Vec3::NEG_Y));
            assert_eq!(camera.position_of(Vec3::new(x, -7.0, z)), Some(at.into()));
        }
    }

    #[test]
    fn a_shift_by_half_of_the_side_moves_the_horizon_by_half_of_the_picture() {
        let level = |size| Camera::looking(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 1.2, size, PixelFilter::Box).unwrap();
        let horizon = |camera: Camera| camera.position(Vec3::NEG_Z).unwrap();
        assert_eq!(horizon(level((60, 60))), Vec2::new(30.0, 30.0));
        // Up and to the right: the middle of the image looks above the horizon, which lies at its lower edge.
        let near = |found: Vec2, wanted: [f32; 2]| assert!((found - Vec2::from(wanted)).length() < 1e-3, "{found}");
        near(horizon(level((60, 60)).shifted(Vec2::new(0.5, 0.5)).unwrap()), [0.0, 60.0]);
        near(horizon(level((40, 80)).shifted(Vec2::new(0.25, 0.5)).unwrap()), [0.0, 80.0]);
        near(horizon(level((80, 40)).shifted(Vec2::new(-0.5, 0.25)).unwrap()), [80.0, 40.0]);
        // Pixels twice as wide as high: the image of 40 × 60 is 80 × 60 of their heights.
        let wide = level((40, 60)).with_pixel_aspect(2.0).unwrap();
        near(horizon(wide.shifted(Vec2::new(0.5, 0.25)).unwrap()), [0.0, 50.0]);
        let tangent = |at: [f32; 2]| wide.direction(at.into()) / -wide.direction(at.into()).z;
        assert!((tangent([20.0, 0.0]).y - 0.6f32.tan()).abs() < 1e-6);
        assert!((tangent([40.0, 30.0]).x / 0.6f32.tan() - 80.0 / 60.0).abs() < 1e-5);
    }

    #[test]
    fn a_panorama_that_looks_along_z_lies_as_an_environment_map() {
        let (width, height) = (16, 8);
        let camera = Camera::looking(Vec3::X, Vec3::Z, Vec3::Y, 1.0, (width, height), PixelFilter::Box).unwrap();
        let camera = camera.projected(Projection::Panorama).unwrap();
        let mapping = EnvironmentMapping::LatLong { across: width, down: height };
        for texel in 0..width * height {
            let (x, y) = (texel % width, texel / width);
            let (origin, direction) = camera.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            assert_eq!((origin, mapping.texel_at(direction)), (Vec3::X, texel));
        }
        // A filter that reaches beyond the zenith sees what is behind it.
        assert!(camera.direction(Vec2::new(8.0, -1.0)).abs_diff_eq(camera.direction(Vec2::new(0.0, 1.0)), 1e-6));
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let lens = Lens { radius: 0.1, focus_distance: 2.0, blades: 0, rotation_radians: 0.0 };
        let panorama = camera().projected(Projection::Panorama).unwrap();
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(camera().projected(Projection::Orthographic { height: bad }).is_err());
            assert!(camera().projected(Projection::Perspective { vertical_fov_radians: bad }).is_err());
            assert!(camera().with_pixel_aspect(bad).is_err());
            assert!(camera().with_lens(Lens { focus_distance: bad, ..lens }).is_err());
            assert!(camera().with_lens(Lens { radius: bad, ..lens }).is_err());
        }
        assert!(camera().with_lens(Lens { blades: 2, ..lens }).is_err());
        assert!(camera().with_lens(Lens { rotation_radians: f32::NAN, ..lens }).is_err());
        assert!(camera().shifted(Vec2::new(0.0, f32::NAN)).is_err());
        assert!(panorama.with_lens(lens).is_err() && panorama.shifted(Vec2::X).is_err());
        assert!(panorama.with_pixel_aspect(2.0).is_err());
        assert!(camera().with_lens(lens).unwrap().projected(Projection::Panorama).is_err());
    }
}
