//! What an estimate is: so many pixels, so many samples.

use std::fmt;

/// Resolution and samples of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderStage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Paths per pixel.
    pub samples_per_pixel: u32,
}

/// As `1024 × 768 pixels, 16 samples`.
impl fmt::Display for RenderStage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, samples_per_pixel } = self;
        write!(f, "{width} × {height} pixels, {samples_per_pixel} samples")
    }
}

impl RenderStage {
    pub(super) fn pixels(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Samples of all pixels.
    pub(super) fn samples(self) -> u64 {
        self.pixels() * u64::from(self.samples_per_pixel)
    }
}
