//! The albedo that filtered light is multiplied by.

use pulp::Simd;

use super::constants::{LEAST_ALBEDO, LEAST_MIRRORED_NOISE, MIRRORED, SLOPE};
use super::guide::weights;
use super::kernel::{Means, Neighbours, Offsets, Weigh};
use super::rows::{Pool, Region, Rows};
use super::surfaces::{SPECULAR, Surfaces, SurfacesCut};
use super::tile::{TILE_PIXELS, Tile};

const CHANNELS: usize = 3;
/// Pixels to each side over which noise and differences are means.
const MEAN_REACH: usize = 1;
/// Pixels around a region of which features are read.
pub(super) const READ: usize = MEAN_REACH + MIRRORED;

/// Values that are held for each column of pixels while so many rows are cleaned: the albedo, its means, and noise and differences in three
/// steps of averaging.
pub(super) fn passing_rows(step: usize) -> usize {
    let compared = step + 2 * MEAN_REACH;
    CHANNELS * (compared + 2 * MIRRORED) + CHANNELS * compared + 2 * (2 * compared + step)
}

/// What light is divided by: a channel of the albedo that a row's own samples saw.
pub(super) fn of_samples(features: &Rows, channel: usize, y: usize) -> impl Iterator<Item = f32> {
    features.row(channel, y).iter().map(|albedo| albedo.max(LEAST_ALBEDO))
}

/// What light is multiplied by again once it is filtered, in a region: three planes.
///
/// Light is divided by the albedo of its own samples, with whose noise its own goes. But where these go by a mirror or through smooth
/// glass, each takes one of two ways by chance, and the albedo of few samples has grain that would come back with it. There a pixel takes
/// the mean `m` of those alike, as far as what it differs by is noise: `a + α (m − a)` with `α = (v / d² − L) / (1 − L)` from 0 to 1, where
/// `v` is the variance of the albedo, `d²` the square of `a − m`, both means around the pixel, and `L` is
/// [`LEAST_MIRRORED_NOISE`]; with `L = 0` that is the share of least risk (Stein 1981). Elsewhere it stays as sharp as surfaces are.
pub(super) fn of_filtered(features: &Rows, variance: &Rows, region: &Region, surfaces: &Surfaces, pool: &Pool) -> Rows {
    let compared = region.grown(MEAN_REACH, features);
    let read = compared.grown(MIRRORED, features);
    let mut albedo = pool.rows_like(features, CHANNELS, read.y.clone());
    albedo.fill_rows(&read, |y, channel, out| {
        let row = of_samples(features, channel, y).skip(read.x.start);
        out.iter_mut().zip(row).for_each(|(out, albedo)| *out = albedo);
    });
    let specular = |y: usize| &features.row(SPECULAR, y)[region.x.clone()];
    if region.y.clone().all(|y| specular(y).iter().all(|&share| share <= 0.0)) {
        return albedo;
    }
    let mut means = pool.rows_like(features, CHANNELS, compared.y.clone());
    let (offsets, by) = (Offsets::disc(MIRRORED, 1), BySurfaces(surfaces));
    Means { images: &albedo, offsets: &offsets, slope: SLOPE, weigher: &by }.fill(&compared, &mut means);
    // Noise, then squared differences.
    let mut terms = pool.rows_like(features, 2, compared.y.clone());
    terms.fill_rows(&compared, |y, term, out| {
        for channel in 0..CHANNELS {
            let [noise, albedo, mean] = [(variance, channel), (&albedo, channel), (&means, channel)]
                .map(|(rows, plane)| &rows.row(plane, y)[compared.x.clone()]);
            for (x, out) in out.iter_mut().enumerate() {
                *out += if term == 0 { noise[x] } else { (albedo[x] - mean[x]).powi(2) };
            }
        }
    });
    let around = terms.box_mean(MEAN_REACH, region, pool);
    albedo.change_rows(region, |y, channel, out| {
        let [noise, difference, mean] =
            [(&around, 0), (&around, 1), (&means, channel)].map(|(rows, plane)| &rows.row(plane, y)[region.x.clone()]);
        for (x, (out, specular)) in out.iter_mut().zip(specular(y)).enumerate() {
            let share =
                (noise[x] / (difference[x] + f32::MIN_POSITIVE) - LEAST_MIRRORED_NOISE) / (1.0 - LEAST_MIRRORED_NOISE);
            *out += specular.clamp(0.0, 1.0) * share.clamp(0.0, 1.0) * (mean[x] - *out);
        }
    });
    [means, terms, around].into_iter().for_each(|done| pool.keep(done));
    albedo
}

/// Weights by what is seen alone.
struct BySurfaces<'a>(&'a Surfaces);

impl Weigh for BySurfaces<'_> {
    type Ready = SurfacesCut;

    fn make_ready(&self, tile: Tile, reach: usize, surfaces: &mut SurfacesCut) {
        self.0.cut(tile, reach, surfaces);
    }

    #[inline(always)]
    fn weigh<S: Simd>(&self, simd: S, surfaces: &mut SurfacesCut, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
        out.fill(0.0);
        surfaces.add_distances(simd, of.offset, out);
        weights(out);
    }
}
