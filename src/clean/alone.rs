//! Each image by itself: what weights that are common to all images leave of its grain.

use pulp::Simd;

use super::constants::{FILTERED_NOISE_REACH, MOST_SCALE, PATCH};
use super::filter::nearness;
use super::guide::{Guide, GuideCut, GuideWidths, weights};
use super::kernel::{Neighbours, Offsets, Weigh, weighted_means};
use super::rows::{Pool, Region, Rows};
use super::surfaces::{Surfaces, SurfacesCut};
use super::tile::{TILE_PIXELS, Tile};

/// Images that are filtered at once: they share what surfaces say.
const TOGETHER: usize = 4;
/// Planes of an image: three channels in two halves.
const IMAGE: usize = 6;
/// Planes that are used beside the images: those at hand before and after, of each what it is compared by; sums before and after;
/// what noise is estimated with.
pub(super) const PLANES: usize = TOGETHER * (2 * IMAGE + 3) + 2 * IMAGE + 6;

/// A filter of each image, which has its own weights: from the image itself, all channels together, and from what is seen.
///
/// Images that were filtered with common weights keep grain where any of them has an edge: what is alike there under one light is not
/// under another. Alone each could be averaged farther, but then what all share, and what their sum shows free of noise, is
/// averaged with it. So the sum of all stays what it was, in each half of the samples: each image is scaled to that.
pub(super) struct Alone<'a> {
    pub(super) surfaces: &'a Surfaces,
    pub(super) widths: GuideWidths,
    pub(super) slope: f32,
    pub(super) offsets: Offsets,
}

impl Alone<'_> {
    /// Filters images in a region. They hold two halves, of each all images, of each three channels.
    pub(super) fn filter(&self, images: &mut Rows, region: &Region, pool: &Pool) {
        let half = images.planes() / 2;
        let before = sums(images, region, pool);
        for first in (0..half / 3).step_by(TOGETHER) {
            let some = first..(first + TOGETHER).min(half / 3);
            let plane_of = |plane: usize| {
                let (image, plane) = (first + plane / IMAGE, plane % IMAGE);
                (plane / 3) * half + 3 * image + plane % 3
            };
            let read = region.grown(self.offsets.radius() + PATCH + FILTERED_NOISE_REACH, images);
            let mut here = pool.rows(images.width(), images.height(), IMAGE * some.len());
            here.fill_rows(&read, |y, plane, out| out.copy_from_slice(&images.row(plane_of(plane), y)[read.x.clone()]));
            let guides = some.map(|image| self.guide(images, image, region, pool)).collect();
            let each = Each { alone: self, guides };
            let filtered = weighted_means(&here, region, &self.offsets, self.slope, &each, pool);
            images.change_rows(region, |y, plane, out| {
                let (of_half, image, channel) = (plane / half, plane % half / 3, plane % 3);
                if let Some(image) = image.checked_sub(first).filter(|image| *image < TOGETHER) {
                    out.copy_from_slice(&filtered.row(image * IMAGE + 3 * of_half + channel, y)[region.x.clone()]);
                }
            });
            each.guides.into_iter().for_each(|guide| pool.keep(guide.into_rows()));
            [here, filtered].into_iter().for_each(|done| pool.keep(done));
        }
        let after = sums(images, region, pool);
        images.change_rows(region, |y, plane, out| {
            let sum = 3 * (plane / half) + plane % 3;
            let [before, after] = [&before, &after].map(|sums| &sums.row(sum, y)[region.x.clone()]);
            for ((out, before), after) in out.iter_mut().zip(before).zip(after) {
                *out *= scale(*before, *after);
            }
        });
        [before, after].into_iter().for_each(|done| pool.keep(done));
    }

    /// What neighbours in an image are compared by.
    fn guide(&self, images: &Rows, image: usize, region: &Region, pool: &Pool) -> Guide {
        let compared = region.grown(self.offsets.radius() + PATCH, images);
        let read = compared.grown(FILTERED_NOISE_REACH, images);
        let half = images.planes() / 2;
        let mut grey = pool.rows(images.width(), images.height(), 2);
        grey.fill_rows(&read, |y, of_half, out| {
            for channel in 0..3 {
                let row = &images.row(of_half * half + 3 * image + channel, y)[read.x.clone()];
                out.iter_mut().zip(row).for_each(|(out, v)| *out += v);
            }
        });
        let guide = Guide::of_halves(&grey, FILTERED_NOISE_REACH, &compared, pool);
        pool.keep(grey);
        guide
    }
}

/// The sums over all images, of each half three channels.
fn sums(images: &Rows, region: &Region, pool: &Pool) -> Rows {
    let half = images.planes() / 2;
    let mut sums = pool.rows(images.width(), images.height(), IMAGE);
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
    if before > 0.0 && after > 0.0 { (before / after).clamp(1.0 / MOST_SCALE, MOST_SCALE) } else { 1.0 }
}

/// Weights of some images, each from its own guide.
struct Each<'a> {
    alone: &'a Alone<'a>,
    guides: Vec<Guide>,
}

/// What is known around a tile: of each image, of surfaces, and, once the first image was weighed, what those and distances add for
/// each offset.
struct Around {
    guides: Vec<GuideCut>,
    surfaces: SurfacesCut,
    common: Vec<[f32; TILE_PIXELS]>,
}

impl Weigh for Each<'_> {
    type Ready = Around;

    fn images(&self) -> usize {
        self.guides.len()
    }

    fn ready(&self, tile: Tile, reach: usize) -> Around {
        Around {
            guides: self.guides.iter().map(|guide| guide.around(tile, reach, PATCH)).collect(),
            surfaces: self.alone.surfaces.around(tile, reach),
            common: vec![[0.0; TILE_PIXELS]; self.alone.offsets.count()],
        }
    }

    #[inline(always)]
    fn weigh<S: Simd>(&self, simd: S, around: &mut Around, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
        let (Some(common), Some(guide)) = (around.common.get_mut(of.index), around.guides.get_mut(of.image)) else {
            return;
        };
        if of.image == 0 {
            common.fill(nearness(of.offset, self.alone.offsets.radius()));
            around.surfaces.add_distances(simd, of.offset, common);
        }
        guide.distances(simd, of.offset, &self.alone.widths, out);
        for (out, common) in out.iter_mut().zip(&*common) {
            *out = out.max(0.0) + common;
        }
        weights(out);
    }
}
