//! Gives back what filtering has averaged away, as far as both halves of the samples agree on it.

use super::image_rows::{ImageRows, Pool, Region};
use crate::matrix::CHANNELS;

/// Radius, in pixels, of the square over which differences are averaged.
const SQUARE: usize = 1;
/// Radius, in pixels, of the square over which the gain is estimated.
const GAIN: usize = 3;
/// Estimated gain up to which nothing is given back.
const MIN_GAIN: f32 = 0.4;

/// Radius, in pixels, that [`with_detail`] reads.
pub(super) const DETAIL_REACH: usize = SQUARE + GAIN;
/// Planes of a cluster: the channels of the first half, then of the second.
const PLANES: usize = 2 * CHANNELS;

/// Number of `f32` held for each pixel column while `step` rows are denoised.
pub(super) fn passing_rows(step: usize) -> usize {
    let rows = step + 2 * DETAIL_REACH;
    3 * PLANES * rows + 3 * 2 * rows
}

/// The filtered images of the cluster whose first plane is `first`, both halves, in a region, with the detail that they lack.
///
/// The difference `d` of raw and filtered values is noise, and light that the filter has averaged away. Of its means over small
/// squares, `d̄`, the Wiener gain `E[d̄_a d̄_b] / E[d̄²]` is the part that is light: the product of the two halves of the samples has no
/// noise, and a sample that one half alone has counts little in it. `d̄` times the gain is added (compare twicing, Tukey
/// 1977, *Exploratory Data Analysis*, §16). Tuned: decision 53.
pub(super) fn with_detail(
    raw: &ImageRows,
    smooth: &ImageRows,
    first: usize,
    region: &Region,
    pool: &Pool,
) -> ImageRows {
    let planes = raw.planes() / 2;
    let plane_of = |at: usize| at / CHANNELS * planes + first + at % CHANNELS;
    let around = region.grown(GAIN, raw);
    let read = around.grown(SQUARE, raw);
    let mut difference = pool.rows_like(raw, PLANES, read.y.clone());
    difference.fill_rows(&read, |y, at, out| {
        let [raw, smooth] = [raw, smooth].map(|rows| &rows.row(plane_of(at), y)[read.x.clone()]);
        out.iter_mut().zip(raw.iter().zip(smooth)).for_each(|(out, (raw, smooth))| *out = raw - smooth);
    });
    let mut detail = difference.box_mean(SQUARE, &around, pool);
    // With the noise, and without.
    let mut powers = pool.rows_like(raw, 2, around.y.clone());
    powers.fill_rows(&around, |y, power, out| {
        for channel in 0..CHANNELS {
            let [a, b] = [channel, CHANNELS + channel].map(|plane| &detail.row(plane, y)[around.x.clone()]);
            let of = |a: f32, b: f32| if power == 0 { 0.25 * (a + b) * (a + b) } else { a * b };
            out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out += of(*a, *b));
        }
    });
    let means = powers.box_mean(GAIN, region, pool);
    detail.change_rows(region, |y, at, out| {
        let [all, light] = [0, 1].map(|power| &means.row(power, y)[region.x.clone()]);
        let smooth = &smooth.row(plane_of(at), y)[region.x.clone()];
        for (((out, all), light), smooth) in out.iter_mut().zip(all).zip(light).zip(smooth) {
            let gain = if *all > 0.0 { light / all } else { 0.0 };
            let lo = std::env::var("DL").ok().and_then(|t| t.parse().ok()).unwrap_or(MIN_GAIN);
            *out = smooth + *out * ((gain - lo) / (1.0 - lo)).clamp(0.0, 1.0);
        }
    });
    [difference, powers, means].into_iter().for_each(|done| pool.keep(done));
    detail
}
