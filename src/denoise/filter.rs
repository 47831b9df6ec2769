//! The filter stages of direct and of indirect light.

use pulp::Simd;

use super::constants::*;
use super::filter_radii::{FILTERED, FILTERED_PIXELS, FilterRadii, RAW, nearness};
use super::guide_statistics::Guides;
use super::guides::{Guide, GuideCut, GuideOf, GuideReach, GuideWidths, fill_mixtures, mixture_planes, weights};
use super::image_rows::{ImageRows, Pool, Region};
use super::kernel::{Means, Neighbours, Offsets, Weigh, Weighed};
use super::per_image_filter::PerImageFilter;
use super::pixel_tile::{PixelTile, TILE_PIXELS};
use super::row_stages::{Stage, Step, Track};
use super::surfaces::{Surfaces, SurfacesCut};

/// Filtered images of a stage, and how far down the image they are computed.
struct StageMeans {
    rows: ImageRows,
    track: Track,
}

impl StageMeans {
    fn new(stage: Stage, region: &Region, size: (usize, usize), step: usize) -> Self {
        let (track, rows) = Track::begin(stage, region, size, step);
        Self { rows, track }
    }

    /// The region to fill in a step.
    fn advance(&mut self, step: &Step<'_>) -> Region {
        self.track.advance(&mut self.rows, step)
    }
}

/// A guide of a stage, and how far down the image it is computed.
struct HeldGuide {
    guide: Guide,
    reach: GuideReach,
    track: Track,
}

impl HeldGuide {
    fn new(stage: Stage, reach: GuideReach, of: GuideOf, region: &Region, size: (usize, usize), step: usize) -> Self {
        let (track, rows) = Track::begin(stage, region, size, step);
        Self { guide: Guide::over(rows, reach.patch, of), reach, track }
    }

    fn advance(&mut self, halves: &ImageRows, step: &Step<'_>, pool: &Pool) {
        let region = self.track.advance(self.guide.rows_mut(), step);
        if !region.y.is_empty() {
            self.guide.fill(halves, self.reach, &region, pool);
        }
    }
}

/// The stages of direct light.
///
/// Each half of the samples is weighted by the filtered guides of the other half, which use no samples of the first
/// (cross-filtering: Rousselle, Knaus, Zwicker 2012, *Adaptive rendering with non-local means filtering*). So weights
/// are independent of the noise that they weigh. Otherwise they would favour bright samples in both halves at once,
/// such as those of a sun among the texels of a sky, and these would pass for edges of the light.
pub(super) struct Direct<'a> {
    reach: FilterRadii,
    mix: &'a [f32],
    mixtures: StageMeans,
    raw_guide: HeldGuide,
    pilot: StageMeans,
    guide: HeldGuide,
    wide: StageMeans,
    narrow: StageMeans,
}

impl<'a> Direct<'a> {
    pub(super) fn new(
        reach: FilterRadii,
        guides: &'a Guides,
        region: &Region,
        size: (usize, usize),
        step: usize,
    ) -> Self {
        let mix = &guides.direct;
        let stages = reach.direct_stages(6 * guides.clusters(), mixture_planes(mix.len() / guides.clusters()));
        let held = |stage| StageMeans::new(stage, region, size, step);
        Self {
            reach,
            mix,
            mixtures: held(stages.mixtures),
            raw_guide: HeldGuide::new(stages.raw_guide, RAW, GuideOf::EachHalf, region, size, step),
            pilot: held(stages.pilot),
            guide: HeldGuide::new(stages.guide, FILTERED, GuideOf::EachHalf, region, size, step),
            wide: held(stages.wide),
            narrow: held(stages.narrow),
        }
    }

    /// The filtered direct light.
    pub(super) fn means(&self) -> &ImageRows {
        &self.narrow.rows
    }

    /// All rows held, for tests of memory.
    #[cfg(test)]
    pub(super) fn all_rows(&self) -> Vec<&ImageRows> {
        let means = [&self.mixtures, &self.pilot, &self.wide, &self.narrow].map(|held| &held.rows);
        means.into_iter().chain([&self.raw_guide, &self.guide].map(|held| held.guide.rows())).collect()
    }

    /// Takes all stages as far as a step needs them.
    pub(super) fn advance(&mut self, light: &ImageRows, step: &Step<'_>, surfaces: &Surfaces, pool: &Pool) {
        let region = self.mixtures.advance(step);
        fill_mixtures(light, self.mix, &region, &mut self.mixtures.rows);
        self.raw_guide.advance(&self.mixtures.rows, step, pool);
        let widths = GuideWidths { noise: DIRECT_PILOT_NOISE, relative: DIRECT_PILOT_RELATIVE };
        let alike = CommonWeights { surfaces, guide: &self.raw_guide.guide, crossed: false, widths, radius: None };
        let region = self.pilot.advance(step);
        alike.means(&self.mixtures.rows, &self.reach.direct_pilot(), 0.0).fill(&region, &mut self.pilot.rows);
        self.guide.advance(&self.pilot.rows, step, pool);
        let widths = GuideWidths { noise: DIRECT_NOISE, relative: DIRECT_RELATIVE };
        let alike = CommonWeights { surfaces, guide: &self.guide.guide, crossed: true, widths, radius: None };
        let filters =
            WideThenNarrow { alike, slope: SLOPE, wide: self.reach.direct(), narrow: self.reach.direct_narrow() };
        filters.advance(light, &mut self.wide, &mut self.narrow, step);
    }
}

/// The stages of indirect light.
pub(super) struct Indirect<'a> {
    reach: FilterRadii,
    mix: &'a [f32],
    mixtures: StageMeans,
    raw_guide: HeldGuide,
    pilot_wide: StageMeans,
    pilot: StageMeans,
    guide: HeldGuide,
    wide: StageMeans,
    narrow: StageMeans,
    /// One for each pass of the filter of single images.
    alone: Vec<StageMeans>,
}

impl<'a> Indirect<'a> {
    pub(super) fn new(
        reach: FilterRadii,
        guides: &'a Guides,
        region: &Region,
        size: (usize, usize),
        step: usize,
    ) -> Self {
        let mix = &guides.indirect;
        let stages = reach.indirect_stages(6 * guides.clusters(), mixture_planes(mix.len() / guides.clusters()));
        let held = |stage| StageMeans::new(stage, region, size, step);
        Self {
            reach,
            mix,
            mixtures: held(stages.mixtures),
            raw_guide: HeldGuide::new(stages.raw_guide, RAW, GuideOf::All, region, size, step),
            pilot_wide: held(stages.pilot_wide),
            pilot: held(stages.pilot),
            guide: HeldGuide::new(stages.guide, FILTERED_PIXELS, GuideOf::All, region, size, step),
            wide: held(stages.wide),
            narrow: held(stages.narrow),
            alone: stages.alone.into_iter().map(held).collect(),
        }
    }

    /// The filtered indirect light.
    pub(super) fn means(&self) -> &ImageRows {
        &self.alone.last().unwrap_or(&self.narrow).rows
    }

    /// All rows held, for tests of memory.
    #[cfg(test)]
    pub(super) fn all_rows(&self) -> Vec<&ImageRows> {
        let means = [&self.mixtures, &self.pilot_wide, &self.pilot, &self.wide, &self.narrow];
        let means = means.into_iter().chain(&self.alone).map(|held| &held.rows);
        means.chain([&self.raw_guide, &self.guide].map(|held| held.guide.rows())).collect()
    }

    /// Takes all stages as far as a step needs them.
    pub(super) fn advance(&mut self, light: &ImageRows, step: &Step<'_>, surfaces: &Surfaces, pool: &Pool) {
        let region = self.mixtures.advance(step);
        fill_mixtures(light, self.mix, &region, &mut self.mixtures.rows);
        self.raw_guide.advance(&self.mixtures.rows, step, pool);
        let widths = GuideWidths { noise: INDIRECT_PILOT_NOISE, relative: INDIRECT_PILOT_RELATIVE };
        let alike = CommonWeights { surfaces, guide: &self.raw_guide.guide, crossed: false, widths, radius: None };
        let [wide, narrow] = [self.reach.wide(), self.reach.narrow()];
        let filters = WideThenNarrow { alike, slope: PILOT_SLOPE, wide, narrow };
        filters.advance(&self.mixtures.rows, &mut self.pilot_wide, &mut self.pilot, step);
        self.guide.advance(&self.pilot.rows, step, pool);
        let widths = GuideWidths { noise: INDIRECT_NOISE, relative: INDIRECT_RELATIVE };
        let alike = CommonWeights { surfaces, guide: &self.guide.guide, crossed: false, widths, radius: None };
        let [wide, narrow] = [self.reach.wide(), self.reach.narrow()];
        let filters = WideThenNarrow { alike, slope: SLOPE, wide, narrow };
        filters.advance(light, &mut self.wide, &mut self.narrow, step);
        let mut before = &self.narrow.rows;
        for (held, pass) in self.alone.iter_mut().zip(self.reach.alone()) {
            let region = held.advance(step);
            if !region.y.is_empty() {
                PerImageFilter { surfaces, pass }.filter(before, &region, &mut held.rows, pool);
            }
            before = &held.rows;
        }
    }
}

/// A wide filter, which may pass pixels over, then a narrow one that reads all.
struct WideThenNarrow<'a> {
    alike: CommonWeights<'a>,
    slope: f32,
    wide: Offsets,
    narrow: Offsets,
}

impl WideThenNarrow<'_> {
    /// Takes both stages as far as a step needs them: `wide` filters light, `narrow` what comes out of that.
    fn advance(mut self, light: &ImageRows, wide: &mut StageMeans, narrow: &mut StageMeans, step: &Step<'_>) {
        self.alike.radius = Some(self.wide.radius());
        let region = wide.advance(step);
        self.alike.means(light, &self.wide, self.slope).fill(&region, &mut wide.rows);
        self.alike.radius = Some(self.narrow.radius());
        let region = narrow.advance(step);
        self.alike.means(&wide.rows, &self.narrow, self.slope).fill(&region, &mut narrow.rows);
    }
}

/// Neighbour weights from the guide, the features and the spatial distance within a radius.
struct CommonWeights<'a> {
    surfaces: &'a Surfaces,
    guide: &'a Guide,
    /// Whether each half of the samples is weighted by the guides of the other half instead of its own.
    crossed: bool,
    widths: GuideWidths,
    radius: Option<usize>,
}

impl CommonWeights<'_> {
    fn means<'a>(&'a self, images: &'a ImageRows, offsets: &'a Offsets, slope: f32) -> Means<'a, Self> {
        Means { images, offsets, slope, weigher: self }
    }
}

/// What is known around a tile: by the guide of each part, and of surfaces.
#[derive(Default)]
struct Around {
    guides: [GuideCut; 2],
    surfaces: SurfacesCut,
}

impl Weigh for CommonWeights<'_> {
    type Ready = Around;

    fn weighed(&self) -> Weighed {
        match self.guide.of() {
            GuideOf::All => Weighed::Together,
            GuideOf::EachHalf => Weighed::Halves,
        }
    }

    fn make_ready(&self, tile: PixelTile, reach: usize, around: &mut Around) {
        for (part, cut) in around.guides.iter_mut().enumerate().take(self.guide.of().parts()) {
            let by = if self.crossed { 1 - part } else { part };
            self.guide.cut(by, tile, reach, cut);
        }
        self.surfaces.cut(tile, reach, &mut around.surfaces);
    }

    #[inline(always)]
    fn weigh<S: Simd>(
        &self,
        simd: S,
        Around { guides, surfaces }: &mut Around,
        Neighbours { part, offset, .. }: Neighbours,
        out: &mut [f32; TILE_PIXELS],
    ) {
        let Some(cut) = guides.get_mut(part) else { return };
        cut.distances(simd, offset, &self.widths, out);
        let near = self.radius.map_or(0.0, |radius| nearness(offset, radius));
        for distance in out.iter_mut() {
            *distance = distance.max(0.0) + near;
        }
        surfaces.add_distances(simd, offset, out);
        weights(out);
        surfaces.times_albedo(offset, out);
    }
}
