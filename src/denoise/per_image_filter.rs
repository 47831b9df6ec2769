//! Filters each image with weights of its own, to remove the noise that weights common to all images had to leave.

use pulp::Simd;

use super::constants::{ALONE_SLOPE, MAX_SCALE};
use super::filter_radii::{FILTERED, FilterRadii, Pass, nearness};
use super::guides::{Guide, GuideCut, GuideOf, weights};
use super::image_rows::{ImageRows, Pool, Region};
use super::kernel::{IMAGE, Means, Neighbours, Weigh, Weighed, plane_of};
use super::pixel_tile::{PixelTile, TILE_PIXELS};
use super::surfaces::{Surfaces, SurfacesCut};

/// Number of images filtered at once. They share the feature distances.
const TOGETHER: usize = 4;
/// Planes of a guide: the sum of the image's channels, its noise, and its square.
const GUIDE_PLANES: usize = 3;

/// Number of `f32` held for each pixel column while `step` rows are filtered.
pub(super) fn passing_rows(reach: FilterRadii, step: usize) -> usize {
    let read = step + 2 * reach.alone().iter().map(Pass::read).max().unwrap_or(0);
    // The guides; for one guide the sum of channels and the means of noise and squares; then the sums before and after
    // filtering.
    read * (TOGETHER * GUIDE_PLANES + 2 + 5) + 2 * IMAGE * step
}

/// A filter of single images. Each has its own weights, from the sum of its channels and from the
/// features.
///
/// Common weights keep noise in every image where any image has an edge, since pixels that are alike under one light
/// are not alike under another. A filter of one image can average over more pixels there. But it would also blur what
/// all images share, which their sum shows without noise. So each filtered image is scaled such that the sum of all
/// images stays the same, in each half of the samples.
pub(super) struct PerImageFilter<'a> {
    pub(super) surfaces: &'a Surfaces,
    pub(super) pass: Pass,
}

impl PerImageFilter<'_> {
    /// Filters the images of a region into `filtered`. Planes are ordered by half of the samples, then image, then
    /// channel.
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

    /// The guide of one image: what its pixels are compared by.
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

/// The sum over all images: three channels for each half of the samples.
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

/// The factor from `after` to `before`, limited by [`MAX_SCALE`].
fn scale(before: f32, after: f32) -> f32 {
    if before > 0.0 && after > 0.0 { (before / after).clamp(1.0 / MAX_SCALE, MAX_SCALE) } else { 1.0 }
}

/// Neighbour weights of several images, each from its own guide.
struct PerImageWeights<'a> {
    alone: &'a PerImageFilter<'a>,
    /// Index of the first of these images.
    first: usize,
    guides: Vec<Guide>,
}

/// Inputs of the weights around a tile: each image's guide, the features, and the sum of feature distance and spatial
/// distance for each offset. That sum is computed for the first image and reused by the others.
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
