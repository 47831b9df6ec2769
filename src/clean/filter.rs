//! The stages that direct and indirect light are filtered in.

use pulp::Simd;

use super::alone::Alone;
use super::constants::*;
use super::guide::{Guide, GuideCut, GuideOf, GuideReach, GuideWidths, fill_mixtures, mixture_planes, weights};
use super::kernel::{Means, Neighbours, Offset, Offsets, Weigh, Weighed};
use super::reach::{FILTERED, FILTERED_PIXELS, RAW, Reach};
use super::rows::{Pool, Region, Rows};
use super::stage::{Stage, Step, Track};
use super::surfaces::{Surfaces, SurfacesCut};
use super::tally::Guides;
use super::tile::{TILE_PIXELS, Tile};

/// Means of a stage, and how far they are.
struct Held {
    rows: Rows,
    track: Track,
}

impl Held {
    fn new(stage: Stage, region: &Region, size: (usize, usize), step: usize) -> Self {
        let (track, rows) = Track::begin(stage, region, size, step);
        Self { rows, track }
    }

    /// What is to be filled in a step.
    fn advance(&mut self, step: &Step<'_>) -> Region {
        self.track.advance(&mut self.rows, step)
    }
}

/// A guide of a stage, and how far it is.
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

    fn advance(&mut self, halves: &Rows, step: &Step<'_>, pool: &Pool) {
        let region = self.track.advance(self.guide.rows_mut(), step);
        if !region.y.is_empty() {
            self.guide.fill(halves, self.reach, &region, pool);
        }
    }
}

/// The stages of direct light.
///
/// Each half of the samples is weighed by the filtered guides of the other half, which are made of nothing else: cross-filtering (Rousselle,
/// Knaus, Zwicker 2012, *Adaptive rendering with non-local means filtering*, which keeps two buffers for it). So no weight knows the
/// noise of what it weighs. Else weights would favour bright samples of both halves at once, as those of a sun among the texels of a sky,
/// and these would pass for edges of the light.
pub(super) struct Direct<'a> {
    reach: Reach,
    mix: &'a [f32],
    mixtures: Held,
    raw_guide: HeldGuide,
    pilot: Held,
    guide: HeldGuide,
    wide: Held,
    narrow: Held,
}

impl<'a> Direct<'a> {
    pub(super) fn new(reach: Reach, guides: &'a Guides, region: &Region, size: (usize, usize), step: usize) -> Self {
        let mix = &guides.direct;
        let stages = reach.direct_stages(6 * guides.clusters(), mixture_planes(mix.len() / guides.clusters()));
        let held = |stage| Held::new(stage, region, size, step);
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

    /// What comes out.
    pub(super) fn means(&self) -> &Rows {
        &self.narrow.rows
    }

    /// All rows that are held.
    #[cfg(test)]
    pub(super) fn all_rows(&self) -> Vec<&Rows> {
        let means = [&self.mixtures, &self.pilot, &self.wide, &self.narrow].map(|held| &held.rows);
        means.into_iter().chain([&self.raw_guide, &self.guide].map(|held| held.guide.rows())).collect()
    }

    /// Takes all stages as far as a step needs them.
    pub(super) fn advance(&mut self, light: &Rows, step: &Step<'_>, surfaces: &Surfaces, pool: &Pool) {
        let region = self.mixtures.advance(step);
        fill_mixtures(light, self.mix, &region, &mut self.mixtures.rows);
        self.raw_guide.advance(&self.mixtures.rows, step, pool);
        let widths = GuideWidths { noise: DIRECT_PILOT_NOISE, relative: DIRECT_PILOT_RELATIVE };
        let alike = Alike { surfaces, guide: &self.raw_guide.guide, crossed: false, widths, radius: None };
        let region = self.pilot.advance(step);
        alike.means(&self.mixtures.rows, &self.reach.direct_pilot(), 0.0).fill(&region, &mut self.pilot.rows);
        self.guide.advance(&self.pilot.rows, step, pool);
        let widths = GuideWidths { noise: DIRECT_NOISE, relative: DIRECT_RELATIVE };
        let alike = Alike { surfaces, guide: &self.guide.guide, crossed: true, widths, radius: None };
        let filters =
            WideThenNarrow { alike, slope: SLOPE, wide: self.reach.direct(), narrow: self.reach.direct_narrow() };
        filters.advance(light, &mut self.wide, &mut self.narrow, step);
    }
}

/// The stages of indirect light.
pub(super) struct Indirect<'a> {
    reach: Reach,
    mix: &'a [f32],
    mixtures: Held,
    raw_guide: HeldGuide,
    pilot_wide: Held,
    pilot: Held,
    guide: HeldGuide,
    wide: Held,
    narrow: Held,
    /// One for each pass.
    alone: Vec<Held>,
}

impl<'a> Indirect<'a> {
    pub(super) fn new(reach: Reach, guides: &'a Guides, region: &Region, size: (usize, usize), step: usize) -> Self {
        let mix = &guides.indirect;
        let stages = reach.indirect_stages(6 * guides.clusters(), mixture_planes(mix.len() / guides.clusters()));
        let held = |stage| Held::new(stage, region, size, step);
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

    /// What comes out.
    pub(super) fn means(&self) -> &Rows {
        &self.alone.last().unwrap_or(&self.narrow).rows
    }

    /// All rows that are held.
    #[cfg(test)]
    pub(super) fn all_rows(&self) -> Vec<&Rows> {
        let means = [&self.mixtures, &self.pilot_wide, &self.pilot, &self.wide, &self.narrow];
        let means = means.into_iter().chain(&self.alone).map(|held| &held.rows);
        means.chain([&self.raw_guide, &self.guide].map(|held| held.guide.rows())).collect()
    }

    /// Takes all stages as far as a step needs them.
    pub(super) fn advance(&mut self, light: &Rows, step: &Step<'_>, surfaces: &Surfaces, pool: &Pool) {
        let region = self.mixtures.advance(step);
        fill_mixtures(light, self.mix, &region, &mut self.mixtures.rows);
        self.raw_guide.advance(&self.mixtures.rows, step, pool);
        let widths = GuideWidths { noise: INDIRECT_PILOT_NOISE, relative: INDIRECT_PILOT_RELATIVE };
        let alike = Alike { surfaces, guide: &self.raw_guide.guide, crossed: false, widths, radius: None };
        let [wide, narrow] = [self.reach.wide(), self.reach.narrow()];
        let filters = WideThenNarrow { alike, slope: PILOT_SLOPE, wide, narrow };
        filters.advance(&self.mixtures.rows, &mut self.pilot_wide, &mut self.pilot, step);
        self.guide.advance(&self.pilot.rows, step, pool);
        let widths = GuideWidths { noise: INDIRECT_NOISE, relative: INDIRECT_RELATIVE };
        let alike = Alike { surfaces, guide: &self.guide.guide, crossed: false, widths, radius: None };
        let [wide, narrow] = [self.reach.wide(), self.reach.narrow()];
        let filters = WideThenNarrow { alike, slope: SLOPE, wide, narrow };
        filters.advance(light, &mut self.wide, &mut self.narrow, step);
        let mut before = &self.narrow.rows;
        for (held, pass) in self.alone.iter_mut().zip(self.reach.alone()) {
            let region = held.advance(step);
            if !region.y.is_empty() {
                Alone { surfaces, pass }.filter(before, &region, &mut held.rows, pool);
            }
            before = &held.rows;
        }
    }
}

/// A wide filter, which may pass pixels over, then a narrow one that reads all.
struct WideThenNarrow<'a> {
    alike: Alike<'a>,
    slope: f32,
    wide: Offsets,
    narrow: Offsets,
}

impl WideThenNarrow<'_> {
    /// Takes both stages as far as a step needs them: `wide` filters light, `narrow` what comes out of that.
    fn advance(mut self, light: &Rows, wide: &mut Held, narrow: &mut Held, step: &Step<'_>) {
        self.alike.radius = Some(self.wide.radius());
        let region = wide.advance(step);
        self.alike.means(light, &self.wide, self.slope).fill(&region, &mut wide.rows);
        self.alike.radius = Some(self.narrow.radius());
        let region = narrow.advance(step);
        self.alike.means(&wide.rows, &self.narrow, self.slope).fill(&region, &mut narrow.rows);
    }
}

/// Weights by the guide, by what is seen, and by the distance within a radius.
struct Alike<'a> {
    surfaces: &'a Surfaces,
    guide: &'a Guide,
    /// Whether each half of the samples is weighed by the guides of the other half, in place of its own.
    crossed: bool,
    widths: GuideWidths,
    radius: Option<usize>,
}

impl Alike<'_> {
    fn means<'a>(&'a self, images: &'a Rows, offsets: &'a Offsets, slope: f32) -> Means<'a, Self> {
        Means { images, offsets, slope, weigher: self }
    }
}

/// What is known around a tile: by the guide of each part, and of surfaces.
#[derive(Default)]
struct Around {
    guides: [GuideCut; 2],
    surfaces: SurfacesCut,
}

impl Weigh for Alike<'_> {
    type Ready = Around;

    fn weighed(&self) -> Weighed {
        match self.guide.of() {
            GuideOf::All => Weighed::Together,
            GuideOf::EachHalf => Weighed::Halves,
        }
    }

    fn make_ready(&self, tile: Tile, reach: usize, around: &mut Around) {
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

pub(super) fn nearness((across, down): Offset, radius: usize) -> f32 {
    let width = radius.max(1) as f32 * NEARNESS;
    (across * across + down * down) as f32 / (2.0 * width * width)
}
