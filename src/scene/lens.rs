//! Lenses of cameras.

use crate::error::{Error, Result};

/// Most blades of an iris.
const MAX_BLADES: u32 = 64;

/// A thin lens (Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th edition, §5.2.3): rays through a pixel leave all of its
/// opening, and meet in the plane of focus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the opening, in scene units: the focal length over twice the f-number.
    pub radius: f32,
    /// Distance of the plane of focus along the viewing direction, in scene units.
    pub focus_distance: f32,
    /// Straight sides of the opening, a regular polygon with its corners on the circle; 0 for a disc.
    pub blades: u32,
    /// How far the polygon is turned, counter-clockwise in the image; at 0 the middle of a side lies at the right.
    pub rotation_radians: f32,
}

impl Lens {
    /// The lens, if it is one.
    ///
    /// # Errors
    /// A radius or a distance that is not above 0, a turn that is not finite, 1, 2 or more than 64 blades.
    pub fn checked(self) -> Result<Self> {
        let refuse = |problem: &str, hint: &str| Err(Error::input("camera", problem, hint));
        let is_length = |length: f32| length > 0.0 && length.is_finite();
        if !is_length(self.radius) || !is_length(self.focus_distance) {
            return refuse(
                "the opening and the focus distance of a lens must be above 0",
                "give lengths in the geometry's unit",
            );
        }
        if !self.rotation_radians.is_finite() || self.blades != 0 && !(3..=MAX_BLADES).contains(&self.blades) {
            return refuse("the iris is not one", "give 3 to 64 blades, or 0 for a round opening, and a finite turn");
        }
        Ok(self)
    }
}
