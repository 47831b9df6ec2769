//! Each image by itself: what weights that are common to all images leave of its grain.

use pulp::Simd;

use super::constants::{ALONE_RELATIVE, ALONE_SLOPE, MAX_SCALE};
use super::filter::nearness;
use super::filter_radii::{FILTERED, FilterRadii};
use super::guides::{Guide, GuideCut, GuideOf, GuideWidths, weights};
use super::image_rows::{ImageRows, Pool, Region};
use super::kernel::{IMAGE, Means, Neighbours, Offsets, Weigh, Weighed, plane_of};
use super::pixel_tile::{PixelTile, TILE_PIXELS};
use super::surfaces::{Surfaces, SurfacesCut};

/// Images that are filtered at once: they share what surfaces say.
const TOGETHER: usize = 4;
/// Planes of a guide: the image in grey, its noise and its square.
const GUIDE_PLANES: usize = 3;

/// Values that it holds for each column of pixels while so many rows are filtered.
pub(super) fn passing_rows(reach: FilterRadii, step: usize) -> usize {
    let read = step + 2 * reach.alone().iter().map(Pass::read).max().unwrap_or(0);
    // Guides, and of one what it is made of: the image in grey, means of its noise and squares; sums before and after.
    read * (TOGETHER * GUIDE_PLANES + 2 + 5) + 2 * IMAGE * step
}

/// A filter of each image, which has its own weights: from the image itself, all channels together, and from what is seen.
///
/// Images that were filtered with common weights keep grain where any of them has an edge: what is alike there under one light is not
/// under another. Alone each could be averaged farther, but then what all share, and what their sum shows free of noise, is
/// averaged with it. So the sum of all stays what it was, in each half of the samples: each image is scaled to that.
pub(super) struct PerImageFilter<'a> {
    pub(super) surfaces: &'a Surfaces,
    pub(super) pass: Pass,
}

/// One of its passes.
pub(super) struct Pass {
    pub(super) offsets: Offsets,
    /// How much the noise counts, see [`GuideWidths::noise`].
    pub(super) noise: f32,
}

impl Pass {
    /// Pixels around those that it fills of which it reads images.
    pub(super) fn read(&self) -> usize {
        self.offsets.radius() + FILTERED.read()
    }

    fn widths(&self) -> GuideWidths {
        GuideWidths { noise: self.noise, relative: ALONE_RELATIVE }
    }
}

impl PerImageFilter<'_> {
    /// Filters images in a region into `filtered`. They hold two halves, of each all images, of each three channels.
    pub(super) fn filter(&self, images: &ImageRows, region: &Region, filtered: &mut ImageRows, pool: &Pool) {
        let all = images.planes() / IMAGE;
        for first in (0..all).step_by(TOGETHER) {
            let guides =
                (first..all.min(first + TOGETHER)).map(|image| self.guide(images, image, region, pool)).collect();
            let each = PerImageWeights { alone: self, first, guides };
            let offsets = &self.pass.offsets;
            Means { images, offsets, slope: ALONE_SLOPE, weigher: &each }.fill(region, filtered);
            each.guides.into_iter().for_each(|guide| pool.keep(guide.into_rows()));
        }
        let sums = [images, &*filtered].map(|images| sums(images, region, pool));
        let half = images.planes() / 2;
        filtered.change_rows(region, |y, plane, out| {
            let sum = 3 * (plane / half) + plane % 3;
            let [before, after] = sums.each_ref().map(|sums| &sums.row(sum, y)[region.x.clone()]);
            for ((out, before), after) in out.iter_mut().zip(before).zip(after) {
                *out *= scale(*before, *after);
            }
        });
        sums.into_iter().for_each(|done| pool.keep(done));
    }

    /// What neighbours in an image are compared by.
    fn guide(&self, images: &ImageRows, image: usize, region: &Region, pool: &Pool) -> Guide {
        let compared = region.grown(self.pass.offsets.radius(), images);
        let read = compared.grown(FILTERED.read(), images);
        let mut grey = pool.rows_like(images, 2, read.y.clone());
        grey.fill_rows(&read, |y, of_half, out| {
            for channel in 0..3 {
                let plane = plane_of(image, 3 * of_half + channel, images.planes());
                let row = &images.row(plane, y)[read.x.clone()];
                out.iter_mut().zip(row).for_each(|(out, v)| *out += v);
            }
        });
        let patches = compared.grown(FILTERED.patch, images).y;
        let mut guide = Guide::over(pool.rows_like(images, GUIDE_PLANES, patches), FILTERED.patch, GuideOf::All);
        guide.fill(&grey, FILTERED, &compared, pool);
        pool.keep(grey);
        guide
    }
}

/// The sums over all images, of each half three channels.
fn sums(images: &ImageRows, region: &Region, pool: &Pool) -> ImageRows {
    let half = images.planes() / 2;
    let mut sums = pool.rows_like(images, IMAGE, region.y.clone());
    sums.fill_rows(region, |y, sum, out| {
        for plane in (sum % 3..half).step_by(3) {
            let row = &images.row(sum / 3 * half + plane, y)[region.x.clone()];
            out.iter_mut().zip(row).for_each(|(out, v)| *out += v);
        }
    });
    sums
}

/// What makes a sum what it was before, as far as that is sensible.
fn scale(before: f32, after: f32) -> f32 {
    if before > 0.0 && after > 0.0 { (before / after).clamp(1.0 / MAX_SCALE, MAX_SCALE) } else { 1.0 }
}

/// Weights of some images, each from its own guide.
struct PerImageWeights<'a> {
    alone: &'a PerImageFilter<'a>,
    /// The first of them.
    first: usize,
    guides: Vec<Guide>,
}

/// What is known around a tile: of each image, of surfaces, and, once the first image was weighed, what those and distances add for
/// each offset.
#[derive(Default)]
struct Around {
    guides: Vec<GuideCut>,
    surfaces: SurfacesCut,
    common: Vec<[f32; TILE_PIXELS]>,
}

impl Weigh for PerImageWeights<'_> {
    type Ready = Around;

    fn weighed(&self) -> Weighed {
        Weighed::Images { first: self.first, count: self.guides.len() }
    }

    fn make_ready(&self, tile: PixelTile, reach: usize, around: &mut Around) {
        around.guides.resize_with(self.guides.len(), GuideCut::default);
        self.guides.iter().zip(&mut around.guides).for_each(|(guide, cut)| guide.cut(0, tile, reach, cut));
        self.alone.surfaces.cut(tile, reach, &mut around.surfaces);
        around.common.resize(self.alone.pass.offsets.count(), [0.0; TILE_PIXELS]);
    }

    #[inline(always)]
    fn weigh<S: Simd>(&self, simd: S, around: &mut Around, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
        let (Some(common), Some(guide)) = (around.common.get_mut(of.index), around.guides.get_mut(of.part)) else {
            return;
        };
        if of.part == 0 {
            common.fill(nearness(of.offset, self.alone.pass.offsets.radius()));
            around.surfaces.add_distances(simd, of.offset, common);
        }
        guide.distances(simd, of.offset, &self.alone.pass.widths(), out);
        for (out, common) in out.iter_mut().zip(&*common) {
            *out = out.max(0.0) + common;
        }
        weights(out);
        around.surfaces.times_albedo(of.offset, out);
    }
}
