//! Demodulation: the albedo that light is divided by before filtering, and multiplied by afterwards.

use pulp::Simd;

use super::constants::{MIN_ALBEDO, MIN_MIRRORED_NOISE, MIRRORED, SLOPE};
use super::guides::weights;
use super::image_rows::{ImageRows, Pool, Region};
use super::kernel::{Means, Neighbours, Offsets, Weigh};
use super::pixel_tile::{PixelTile, TILE_PIXELS};
use super::surfaces::{SPECULAR, Surfaces, SurfacesCut};

const CHANNELS: usize = 3;
/// Radius, in pixels, of the box over which noise and squared differences are averaged.
const MEAN_REACH: usize = 1;
/// Radius, in pixels, within which features are read.
pub(super) const READ: usize = MEAN_REACH + MIRRORED;

/// Number of `f32` held for each pixel column while `step` rows are denoised: the albedo, its means, and noise and
/// squared differences in three steps of averaging.
pub(super) fn passing_rows(step: usize) -> usize {
    let compared = step + 2 * MEAN_REACH;
    CHANNELS * (compared + 2 * MIRRORED) + CHANNELS * compared + 2 * (2 * compared + step)
}

/// One channel of the albedo of row `y`, as the row's own samples measured it. Light is divided by it.
pub(super) fn of_samples(features: &ImageRows, channel: usize, y: usize) -> impl Iterator<Item = f32> {
    features.row(channel, y).iter().map(|albedo| albedo.max(MIN_ALBEDO))
}

/// The albedo that filtered light of a region is multiplied by: three planes.
///
/// Light is divided by the albedo of its own samples, so that the noise of both cancels. Behind mirrors and smooth
/// glass each sample takes one of two branches at random. The albedo of few samples is then noisy, and would bring that
/// noise back.
///
/// For such pixels the albedo `a` becomes `a + α (m − a)`, where `m` is the mean of similar neighbours. The weight is
/// `α = (v / d² − L) / (1 − L)`, clamped to 0 to 1. Here `v` is the variance of the albedo, `d²` the square of `a − m`
/// (both averaged around the pixel), and `L` is [`MIN_MIRRORED_NOISE`]. With `L = 0` this is the weight of least risk
/// (Stein 1981). All other pixels keep their albedo.
pub(super) fn of_filtered(
    features: &ImageRows,
    variance: &ImageRows,
    region: &Region,
    surfaces: &Surfaces,
    pool: &Pool,
) -> ImageRows {
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
    // Plane 0: noise. Plane 1: squared differences.
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
                (noise[x] / (difference[x] + f32::MIN_POSITIVE) - MIN_MIRRORED_NOISE) / (1.0 - MIN_MIRRORED_NOISE);
            *out += specular.clamp(0.0, 1.0) * share.clamp(0.0, 1.0) * (mean[x] - *out);
        }
    });
    [means, terms, around].into_iter().for_each(|done| pool.keep(done));
    albedo
}

/// Neighbour weights from features alone.
struct BySurfaces<'a>(&'a Surfaces);

impl Weigh for BySurfaces<'_> {
    type Ready = SurfacesCut;

    fn make_ready(&self, tile: PixelTile, reach: usize, surfaces: &mut SurfacesCut) {
        self.0.cut(tile, reach, surfaces);
    }

    #[inline(always)]
    fn weigh<S: Simd>(&self, simd: S, surfaces: &mut SurfacesCut, of: Neighbours, out: &mut [f32; TILE_PIXELS]) {
        out.fill(0.0);
        surfaces.add_distances(simd, of.offset, out);
        weights(out);
    }
}
