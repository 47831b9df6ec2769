//! Filter radii.

use super::albedo;
use super::constants::*;
use super::guides::{GuideReach, GuideWidths};
use super::kernel::Offsets;
use super::pixel_tile::Offset;
use super::row_stages::Stage;
use super::shrinkage::RISK_REACH;
use super::surfaces;

/// Filter radii for an image size. Larger images have larger radii, since a surface covers more pixels in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilterRadii {
    /// Stride, in pixels, of the wide filter of indirect light.
    pub(super) stride: usize,
    /// Step, in pixels, of the far pass of the filter of single images. `None` in images that have no far pass.
    pub(super) far_step: Option<usize>,
}

impl FilterRadii {
    /// The radii for an image of this size in pixels.
    pub fn of_image(width: u32, height: u32) -> Self {
        let side = (f64::from(width) * f64::from(height)).sqrt();
        let far_step = ((side / SIDE_OF_FAR_STEP).round() as usize).min(MAX_FAR_STEP);
        Self {
            stride: ((side / SIDE_OF_STRIDE).round() as usize).clamp(MIN_INDIRECT_STRIDE, MAX_INDIRECT_STRIDE),
            far_step: Some(far_step).filter(|&step| step >= MIN_FAR_STEP),
        }
    }

    fn is_far(self) -> bool {
        self.stride > MIN_INDIRECT_STRIDE
    }

    /// Offsets of the filter of direct light.
    pub(super) fn direct(self) -> Offsets {
        if self.is_far() {
            Offsets::disc(DIRECT_WIDE * self.stride, self.stride)
        } else {
            Offsets::thinned(DIRECT, DIRECT_DENSE, 2)
        }
    }

    /// Offsets of the narrow filter after it. It is used where the first one passes pixels over.
    pub(super) fn direct_narrow(self) -> Offsets {
        Offsets::disc(if self.is_far() { DIRECT_NARROW } else { 0 }, 1)
    }

    /// Offsets of the filter of the guides of direct light.
    pub(super) fn direct_pilot(self) -> Offsets {
        let radius = DIRECT_PILOT * self.stride / MIN_INDIRECT_STRIDE;
        Offsets::thinned(radius, DIRECT_DENSE, if self.is_far() { 5 } else { 2 })
    }

    /// Offsets of the wide filter of indirect light.
    pub(super) fn wide(self) -> Offsets {
        Offsets::disc(INDIRECT_WIDE * self.stride, self.stride)
    }

    /// Offsets of the narrow filter after it.
    pub(super) fn narrow(self) -> Offsets {
        Offsets::disc(INDIRECT_NARROW, 1)
    }

    /// The passes of the filter of single images of indirect light, in order.
    pub(super) fn alone(self) -> Vec<Pass> {
        let pass = |steps, step, noise| Pass { offsets: Offsets::disc(steps * step, step), noise };
        match self.far_step {
            None => vec![pass(ALONE_STEPS, ALONE_STEP_PIXELS, ALONE_NOISE)],
            Some(step) => {
                let near = pass(ALONE_NEAR_STEPS, ALONE_NEAR_STEP_PIXELS, ALONE_NEAR_NOISE);
                vec![near, pass(ALONE_FAR_STEPS, step, ALONE_FAR_NOISE)]
            }
        }
    }

    /// Radius, in pixels, within which the result of a region depends on the input.
    pub fn halo(self) -> usize {
        self.light(0).reach
    }

    /// Which rows of light are read and held, for `planes` planes of direct or indirect light.
    pub(super) fn light(self, planes: usize) -> Stage {
        let (direct, indirect) = (self.direct_stages(planes, 0), self.indirect_stages(planes, 0));
        let halo = direct.mixtures.reach.max(indirect.mixtures.reach);
        let readers = [
            (halo, 0),
            (direct.wide.reach, self.direct().radius()),
            (indirect.wide.reach, self.wide().radius()),
            (0, RISK_REACH),
        ];
        Stage::new(planes, halo, &readers)
    }

    /// Which rows of features, or of their variance, are read and held: for feature distances and for the albedo.
    pub(super) fn features(self, planes: usize) -> Stage {
        let halo = self.halo();
        Stage::new(planes, halo, &[(halo, 0), (self.indirect_stages(0, 0).surfaces.reach, 1), (0, albedo::READ)])
    }

    /// The stages of direct light. `planes` and `mixtures` are numbers of planes.
    pub(super) fn direct_stages(self, planes: usize, mixtures: usize) -> DirectStages {
        let [of_wide, of_narrow, of_pilot] =
            [self.direct(), self.direct_narrow(), self.direct_pilot()].map(|offsets| offsets.radius());
        let narrow = RISK_REACH;
        let wide = narrow + of_narrow;
        let guide = wide + of_wide;
        let pilot = guide + FILTERED.read();
        let raw_guide = pilot + of_pilot;
        let all = raw_guide + RAW.read();
        // The guides of each half, their noise and their squares.
        let guides = mixtures + 2;
        DirectStages {
            mixtures: Stage::new(mixtures, all, &[(raw_guide, RAW.read()), (pilot, of_pilot)]),
            raw_guide: Stage::new(guides, raw_guide, &[(pilot, of_pilot)]).with_patches(RAW.patch),
            pilot: Stage::new(mixtures, pilot, &[(guide, FILTERED.read())]),
            guide: Stage::new(guides, guide, &[(wide, of_wide), (narrow, of_narrow)]).with_patches(FILTERED.patch),
            wide: Stage::new(planes, wide, &[(narrow, of_narrow)]),
            narrow: Stage::new(planes, narrow, &[(0, RISK_REACH)]),
        }
    }

    /// The stages of indirect light. `planes` and `mixtures` are numbers of planes.
    pub(super) fn indirect_stages(self, planes: usize, mixtures: usize) -> IndirectStages {
        let (of_wide, of_narrow) = (self.wide().radius(), self.narrow().radius());
        let passes = self.alone();
        let (mut alone, mut pass, mut reader) = (Vec::new(), RISK_REACH, (0, RISK_REACH));
        for read in passes.iter().rev().map(Pass::read) {
            alone.push(Stage::new(planes, pass, &[reader]));
            reader = (pass, read);
            pass += read;
        }
        alone.reverse();
        let narrow = pass;
        let wide = narrow + of_narrow;
        let guide = wide + of_wide;
        let pilot = guide + FILTERED_PIXELS.read();
        let pilot_wide = pilot + of_narrow;
        let raw_guide = pilot_wide + of_wide;
        let all = raw_guide + RAW.read();
        let guides = mixtures / 2 + 2;
        let direct = self.direct_stages(planes, mixtures);
        IndirectStages {
            mixtures: Stage::new(mixtures, all, &[(raw_guide, RAW.read()), (pilot_wide, of_wide)]),
            raw_guide: Stage::new(guides, raw_guide, &[(pilot_wide, of_wide), (pilot, of_narrow)])
                .with_patches(RAW.patch),
            pilot_wide: Stage::new(mixtures, pilot_wide, &[(pilot, of_narrow)]),
            pilot: Stage::new(mixtures, pilot, &[(guide, FILTERED_PIXELS.read())]),
            guide: Stage::new(guides, guide, &[(wide, of_wide), (narrow, of_narrow)])
                .with_patches(FILTERED_PIXELS.patch),
            wide: Stage::new(planes, wide, &[(narrow, of_narrow)]),
            narrow: Stage::new(planes, narrow, &[reader]),
            surfaces: {
                let of_passes = alone.iter().zip(&passes).map(|(stage, pass)| (stage.reach, pass.offsets.radius()));
                let mut readers: Vec<_> = of_passes.collect();
                readers.extend([(raw_guide, 0), (direct.wide.reach, self.direct().radius()), (0, albedo::READ)]);
                // Both pixels of a comparison are read.
                Stage::new(surfaces::PLANES, raw_guide, &readers)
            },
            alone,
        }
    }
}

/// Radii of guides: of raw light, of filtered light compared by patches, and of filtered light compared by pixels.
pub(super) const RAW: GuideReach = GuideReach { noise: RAW_NOISE_REACH, patch: PATCH };
pub(super) const FILTERED: GuideReach = GuideReach { noise: FILTERED_NOISE_REACH, patch: PATCH };
pub(super) const FILTERED_PIXELS: GuideReach = GuideReach { noise: FILTERED_NOISE_REACH, patch: 0 };

/// Row ranges of the stages of direct light. The final mix holds no rows.
pub(super) struct DirectStages {
    pub(super) mixtures: Stage,
    pub(super) raw_guide: Stage,
    pub(super) pilot: Stage,
    pub(super) guide: Stage,
    pub(super) wide: Stage,
    pub(super) narrow: Stage,
}

impl DirectStages {
    pub(super) fn all(self) -> [Stage; 6] {
        let Self { mixtures, raw_guide, pilot, guide, wide, narrow } = self;
        [mixtures, raw_guide, pilot, guide, wide, narrow]
    }
}

/// Row ranges of the stages of indirect light, and of the features that all weights use.
pub(super) struct IndirectStages {
    pub(super) mixtures: Stage,
    pub(super) raw_guide: Stage,
    pub(super) pilot_wide: Stage,
    pub(super) pilot: Stage,
    pub(super) guide: Stage,
    pub(super) wide: Stage,
    pub(super) narrow: Stage,
    /// One for each pass of the filter of single images.
    pub(super) alone: Vec<Stage>,
    pub(super) surfaces: Stage,
}

impl IndirectStages {
    pub(super) fn all(self) -> Vec<Stage> {
        let Self { mixtures, raw_guide, pilot_wide, pilot, guide, wide, narrow, alone, surfaces } = self;
        [mixtures, raw_guide, pilot_wide, pilot, guide, wide, narrow, surfaces].into_iter().chain(alone).collect()
    }
}

/// One pass of that filter.
pub(super) struct Pass {
    pub(super) offsets: Offsets,
    /// Range-weight width in units of the noise's σ, see [`GuideWidths::noise`].
    pub(super) noise: f32,
}

impl Pass {
    /// Radius, in pixels, within which a pass reads images.
    pub(super) fn read(&self) -> usize {
        self.offsets.radius() + FILTERED.read()
    }

    pub(super) fn widths(&self) -> GuideWidths {
        GuideWidths { noise: self.noise, relative: ALONE_RELATIVE }
    }
}

pub(super) fn nearness((across, down): Offset, radius: usize) -> f32 {
    let width = radius.max(1) as f32 * NEARNESS;
    (across * across + down * down) as f32 / (2.0 * width * width)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_reach_farther_in_larger_images() {
        let wide = |width, height| FilterRadii::of_image(width, height).wide().radius();
        assert_eq!([wide(1, 1), wide(256, 192), wide(384, 288)], [18; 3]);
        assert_eq!([wide(480, 360), wide(1024, 768), wide(8192, 4096)], [24; 3]);
        let far = |width, height| FilterRadii::of_image(width, height).far_step;
        assert_eq!([far(256, 192), far(640, 480), far(800, 600)], [None, None, Some(12)]);
        assert_eq!([far(1024, 768), far(8192, 4096)], [Some(15); 2]);
    }
}
