//! Gives back what filtering has averaged away, as far as both halves of the samples agree on it.

use super::constants::{DETAIL_EVENNESS, DETAIL_GAIN};
use super::image_rows::{ImageRows, Pool, Region};
use super::ramp;
use crate::matrix::CHANNELS;

/// Radius, in pixels, of the square over which differences are averaged.
const SQUARE: usize = 1;
/// Radius, in pixels, of the square over which the gain is estimated.
const GAIN_SQUARE: usize = 6;

/// Radius, in pixels, that [`with_detail`] reads.
pub(super) const DETAIL_REACH: usize = SQUARE + GAIN_SQUARE;
/// Planes of the terms of the gain.
const POWERS: usize = 3;
/// Planes of a cluster: the channels of the first half, then of the second.
const PLANES: usize = 2 * CHANNELS;

/// Number of `f32` held for each pixel column while `step` rows are denoised.
pub(super) fn passing_rows(step: usize) -> usize {
    let rows = step + 2 * DETAIL_REACH;
    3 * PLANES * rows + 3 * POWERS * rows
}

/// The filtered images of the cluster whose first plane is `first`, both halves, in a region, with the detail that they lack.
///
/// The difference `d` of raw and filtered values is noise, and light that the filter has averaged away. Of its means over small
/// squares, `d̄`, the Wiener gain `E[d̄_a d̄_b] / E[d̄²]` is the part that is light, since the product of the two halves of the samples has no
/// noise. `d̄` times the gain is added (compare twicing: Tukey 1977, *Exploratory Data Analysis*, §16).
///
/// Few bright samples make that mean uncertain. So it counts as far as the product is the same all over the square: its mean over its
/// root mean square. Tuned: decision 53.
pub(super) fn with_detail(
    raw: &ImageRows,
    smooth: &ImageRows,
    first: usize,
    region: &Region,
    pool: &Pool,
) -> ImageRows {
    let planes = raw.planes() / 2;
    let plane_of = |at: usize| at / CHANNELS * planes + first + at % CHANNELS;
    let around = region.grown(GAIN_SQUARE, raw);
    let read = around.grown(SQUARE, raw);
    let mut difference = pool.rows_like(raw, PLANES, read.y.clone());
    difference.fill_rows(&read, |y, at, out| {
        let [raw, smooth] = [raw, smooth].map(|rows| &rows.row(plane_of(at), y)[read.x.clone()]);
        out.iter_mut().zip(raw.iter().zip(smooth)).for_each(|(out, (raw, smooth))| *out = raw - smooth);
    });
    let mut detail = difference.box_mean(SQUARE, &around, pool);
    // Power with the noise and without it, and the square of the latter.
    let mut powers = pool.rows_like(raw, POWERS, around.y.clone());
    powers.fill_whole_rows(&around.y, |y, row| {
        row.fill(0.0);
        let (all, rest) = row.split_at_mut(raw.width());
        let (light, squared) = rest.split_at_mut(raw.width());
        let [all, light, squared] = [all, light, squared].map(|row| &mut row[around.x.clone()]);
        for channel in 0..CHANNELS {
            let [a, b] = [channel, CHANNELS + channel].map(|plane| &detail.row(plane, y)[around.x.clone()]);
            for ((all, light), (a, b)) in all.iter_mut().zip(&mut *light).zip(a.iter().zip(b)) {
                *all += 0.25 * (a + b) * (a + b);
                *light += a * b;
            }
        }
        squared.iter_mut().zip(&*light).for_each(|(squared, light)| *squared = light * light);
    });
    let means = powers.box_mean(GAIN_SQUARE, region, pool);
    detail.change_rows(region, |y, at, out| {
        let [all, light, squared] = [0, 1, 2].map(|power| &means.row(power, y)[region.x.clone()]);
        let smooth = &smooth.row(plane_of(at), y)[region.x.clone()];
        for ((((out, all), light), squared), smooth) in out.iter_mut().zip(all).zip(light).zip(squared).zip(smooth) {
            let gain = if *all > 0.0 { light / all } else { 0.0 };
            let evenness = if *squared > 0.0 { light / squared.sqrt() } else { 0.0 };
            *out = smooth + *out * ramp(DETAIL_GAIN, gain) * ramp(DETAIL_EVENNESS, evenness);
        }
    });
    [difference, powers, means].into_iter().for_each(|done| pool.keep(done));
    detail
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const SIDE: usize = 48;

    /// A stripe of light 1 that the filter has made 0, in both halves, and noise of this standard deviation in each. Every channel alike.
    fn stripe(noise: f32) -> (ImageRows, ImageRows) {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let (mut raw, smooth) = (ImageRows::zeros(SIDE, SIDE, PLANES), ImageRows::zeros(SIDE, SIDE, PLANES));
        for half in 0..2 {
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let light = if (16..32).contains(&x) { 1.0 } else { 0.0 };
                    let value = light + noise * (random.random::<f32>() - 0.5) * 12f32.sqrt();
                    (0..CHANNELS).for_each(|channel| raw.row_mut(half * CHANNELS + channel, y)[x] = value);
                }
            }
        }
        (raw, smooth)
    }

    fn mean(image: &ImageRows, x: std::ops::Range<usize>) -> f32 {
        let values = (4..SIDE - 4).flat_map(|y| image.row(0, y)[x.clone()].to_vec());
        values.sum::<f32>() / ((SIDE - 8) * x.len()) as f32
    }

    #[test]
    fn light_that_both_halves_have_is_given_back() {
        let (raw, smooth) = stripe(0.5);
        let found = with_detail(&raw, &smooth, 0, &raw.whole(), &Pool::default());
        let inside = mean(&found, 20..28);
        assert!((0.85..1.05).contains(&inside), "{inside} of the light");
        // Grain about the stripe is that of the mean of nine pixels at most.
        let outside = mean(&found, 0..10).abs();
        assert!(outside < 0.02, "{outside}");
    }

    #[test]
    fn noise_and_single_bright_samples_are_not() {
        let (mut raw, smooth) = stripe(0.0);
        (0..PLANES).for_each(|plane| (0..SIDE).for_each(|y| raw.row_mut(plane, y).fill(0.0)));
        let mut random = Pcg64Mcg::seed_from_u64(6);
        for y in 0..SIDE {
            for x in 0..SIDE {
                for half in 0..2 {
                    let value = random.random::<f32>() - 0.5;
                    (0..CHANNELS).for_each(|channel| raw.row_mut(half * CHANNELS + channel, y)[x] = value);
                }
            }
        }
        (0..PLANES).for_each(|plane| raw.row_mut(plane, 24)[24] = 40.0);
        let found = with_detail(&raw, &smooth, 0, &raw.whole(), &Pool::default());
        let power = |image: &ImageRows| image.values().iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
        assert!(power(&found) < 0.01 * power(&raw), "{} of {}", power(&found), power(&raw));
    }
}
