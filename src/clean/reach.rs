//! How far filtering reaches.

use super::constants::*;
use super::kernel::Offsets;
use super::shrink::RISK_REACH;

/// How far the wide filter of indirect light reaches, and with it all filtering: farther in larger images, where the same surface has
/// more pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// The wide filter reads every so many pixels across and down.
    pub(super) stride: usize,
}

impl Reach {
    /// That for an image of this size in pixels.
    pub fn of_image(width: u32, height: u32) -> Self {
        let side = (f64::from(width) * f64::from(height)).sqrt();
        Self { stride: ((side / SIDE_OF_STRIDE).round() as usize).clamp(INDIRECT_STRIDE.0, INDIRECT_STRIDE.1) }
    }

    /// Radius of the filter of direct light.
    pub(super) fn direct(self) -> usize {
        DIRECT * self.stride / INDIRECT_STRIDE.0
    }

    /// Radius of the filter of the guides of direct light.
    pub(super) fn direct_pilot(self) -> usize {
        DIRECT_PILOT * self.stride / INDIRECT_STRIDE.0
    }

    /// What those read within a radius: the wider it is, the fewer of the pixels.
    pub(super) fn direct_offsets(self, radius: usize) -> Offsets {
        Offsets::thinned(radius, DIRECT_DENSE, if self.stride == INDIRECT_STRIDE.0 { 2 } else { 5 })
    }

    /// Radius of the wide filter of indirect light.
    pub(super) fn wide(self) -> usize {
        INDIRECT_WIDE * self.stride
    }

    /// What each image of indirect light by itself reads.
    pub(super) fn alone(self) -> Offsets {
        Offsets::disc(ALONE.0 * ALONE.1, ALONE.1)
    }

    /// Both filters of indirect light.
    pub(super) fn indirect(self) -> usize {
        INDIRECT_NARROW + self.wide()
    }

    /// Pixels around a region that what comes out of it reads of the images of indirect light that common weights filtered: the risk's
    /// squares, and what each image by itself reads, its noise too.
    pub(super) fn common(self) -> usize {
        RISK_REACH + self.alone().radius() + PATCH + FILTERED_NOISE_REACH
    }

    /// Pixels whose light that reads: those of the narrow filter and the wide one.
    pub(super) fn light(self) -> usize {
        self.common() + self.indirect()
    }

    /// Pixels around a region that what comes out of it depends on: those of its light, the squares of the noise of the filtered guides
    /// that they are compared by, and what those depend on, the same filters, their patches, the squares of the noise.
    pub fn halo(self) -> usize {
        self.light() + FILTERED_NOISE_REACH + self.indirect() + PATCH + RAW_NOISE_REACH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_reach_farther_in_larger_images() {
        let wide = |width, height| Reach::of_image(width, height).wide();
        assert_eq!([wide(1, 1), wide(256, 192), wide(384, 288)], [18; 3]);
        assert_eq!([wide(480, 360), wide(1024, 768), wide(8192, 4096)], [24; 3]);
    }
}
