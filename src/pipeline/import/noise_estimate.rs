//! Estimates the noise of an image that was rendered once, from the image itself.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::matrix::CHANNELS;

/// A pixel is compared with the mean of its two neighbours in each of these directions.
const DIRECTIONS: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];
/// Ratio of the noise to the least of those four differences. For normal noise it lies between 1.18, if each channel
/// has its own noise, and 1.54, if all have the same. Tuned: decision 22. Pixels are taken for independent: decision 91.
const SCALE: f32 = 1.3;
/// Least albedo that light is divided by.
const MIN_ALBEDO: f32 = 0.05;

/// A rectangle of pixels inside a larger one, which extends one pixel farther where the image does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inside {
    /// Pixels across and down.
    pub(super) size: (usize, usize),
    /// Its origin in the larger rectangle.
    pub(super) at: (usize, usize),
    /// Size of the larger rectangle.
    pub(super) around: (usize, usize),
}

/// Adds noise of the estimated size and a random sign to each pixel of an image. `around` are the image's three
/// channels in the larger rectangle, one after the other; `albedo` likewise. `image` is in the inner rectangle.
///
/// The size is the least difference, in four directions, to the mean of the two pixels beside it: an edge or a line along one of the
/// directions has none, a pixel that stands alone has all. With `x + n` and `x − n` a filter's risk follows as from two renderings,
/// since what a filter does to noise, it does to random noise of that size (Ramani, Blu and Unser 2008).
pub(super) fn add_noise(image: &mut [f32], around: &[f32], albedo: &[f32], inside: Inside, seed: u64) {
    let Inside { size: (width, height), at: (left, top), around: (across, down) } = inside;
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let under = |channel: usize, pixel: usize| albedo[channel * across * down + pixel].max(MIN_ALBEDO);
    // Light of a channel at a neighbour of a pixel, clamped to the larger rectangle.
    let light = |channel: usize, (x, y): (usize, usize), (right, below): (isize, isize)| {
        let place = |v: usize, step: isize, end: usize| v.saturating_add_signed(step).min(end - 1);
        let pixel = place(y, below, down) * across + place(x, right, across);
        around[channel * across * down + pixel] / under(channel, pixel)
    };
    for y in 0..height {
        for x in 0..width {
            let own = (left + x, top + y);
            let differences = DIRECTIONS.map(|(right, below)| {
                let beside =
                    |channel| 0.5 * (light(channel, own, (right, below)) + light(channel, own, (-right, -below)));
                [0, 1, 2].map(|channel| light(channel, own, (0, 0)) - beside(channel))
            });
            let square = |d: &[f32; CHANNELS]| d.iter().map(|v| v * v).sum::<f32>();
            let least = differences.into_iter().min_by(|a, b| square(a).total_cmp(&square(b))).unwrap_or_default();
            let scale = if random.random::<bool>() { SCALE } else { -SCALE };
            for (channel, difference) in least.into_iter().enumerate() {
                image[channel * width * height + y * width + x] +=
                    scale * difference * under(channel, own.1 * across + own.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 96;
    const PIXELS: usize = SIDE * SIDE;

    fn grain_of(image: &[f32], albedo: &[f32]) -> Vec<f32> {
        let inside = Inside { size: (SIDE, SIDE), at: (0, 0), around: (SIDE, SIDE) };
        let mut grain = vec![0.0; image.len()];
        add_noise(&mut grain, image, albedo, inside, 7);
        grain
    }

    fn root_mean_square(values: &[f32]) -> f32 {
        (values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32).sqrt()
    }

    /// Sums of twelve uniform numbers, of variance 1; the same in all channels, or independent.
    fn noise(is_grey: bool) -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut draw = |_| (0..12).map(|_| random.random::<f32>()).sum::<f32>() - 6.0;
        let first: Vec<f32> = (0..PIXELS).map(&mut draw).collect();
        if is_grey { first.repeat(CHANNELS) } else { (0..CHANNELS * PIXELS).map(draw).collect() }
    }

    #[test]
    fn noise_has_its_size() {
        let white = vec![1.0; CHANNELS * PIXELS];
        for (is_grey, expected) in [(true, SCALE / 1.54), (false, SCALE / 1.18)] {
            let found = root_mean_square(&grain_of(&noise(is_grey), &white));
            assert!((found / expected - 1.0).abs() < 0.03, "{found}, not {expected}");
        }
        let dark: Vec<f32> = white.iter().map(|v| 0.25 * v).collect();
        let found = root_mean_square(&grain_of(&noise(true), &dark)) / (SCALE / 1.54);
        assert!((found - 1.0).abs() < 0.03, "one albedo everywhere changes nothing: {found}");
    }

    #[test]
    fn edges_lines_and_textures_that_are_known_have_none() {
        let of = |value: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            let plane: Vec<f32> = (0..PIXELS).map(|at| value(at % SIDE, at / SIDE)).collect();
            plane.repeat(CHANNELS)
        };
        let white = vec![1.0; CHANNELS * PIXELS];
        let edge = |is_bright: bool| if is_bright { 8.0 } else { 1.0 };
        // The image's border has no neighbours outside, so edges and lines that meet it may look like noise.
        let inner = |grain: Vec<f32>| -> Vec<f32> {
            let is_inner = |at: usize| (1..SIDE - 1).contains(&(at % SIDE)) && (1..SIDE - 1).contains(&(at / SIDE));
            grain.into_iter().enumerate().filter(|(at, _)| is_inner(at % PIXELS)).map(|(_, v)| v).collect()
        };
        for image in [
            of(&|x, _| edge(x > 40)),
            of(&|_, y| edge(y > 40)),
            of(&|x, y| edge(x > y)),
            of(&|x, y| edge(x + y > 90)),
            of(&|x, _| edge(x == 40)),
            of(&|x, y| (x + 2 * y) as f32),
        ] {
            assert!(root_mean_square(&inner(grain_of(&image, &white))) < 1e-4);
        }
        let carpet = of(&|x, y| [0.1, 0.9][(x * x + 3 * y * y + x * y) % 7 % 2]);
        let lit: Vec<f32> = carpet.iter().enumerate().map(|(at, albedo)| albedo * (at % SIDE) as f32).collect();
        assert!(root_mean_square(&inner(grain_of(&lit, &carpet))) < 1e-4);
        assert!(root_mean_square(&inner(grain_of(&lit, &white))) > 1.0, "a texture that is not known looks like noise");
    }

    /// Apart from its sign, the noise of a pixel does not depend on the rectangle that it is read in.
    #[test]
    fn rectangles_fit_together() {
        let (image, white) = (noise(false), vec![1.0; CHANNELS * PIXELS]);
        let whole = grain_of(&image, &white);
        let (left, top, width, height) = (31, 12, 20, 9);
        let cut = |x: usize, y: usize, w: usize, h: usize| -> Vec<f32> {
            let rows = (0..CHANNELS).flat_map(|channel| (y..y + h).map(move |y| channel * PIXELS + y * SIDE + x));
            rows.flat_map(|first| image[first..first + w].to_vec()).collect()
        };
        let around = cut(left - 1, top - 1, width + 2, height + 2);
        let inside = Inside { size: (width, height), at: (1, 1), around: (width + 2, height + 2) };
        let mut part = vec![0.0; CHANNELS * width * height];
        add_noise(&mut part, &around, &vec![1.0; around.len()], inside, 9);
        for (at, found) in part.iter().enumerate() {
            let (channel, pixel) = (at / (width * height), at % (width * height));
            let expected = whole[channel * PIXELS + (top + pixel / width) * SIDE + left + pixel % width];
            assert!((found.abs() - expected.abs()).abs() < 1e-5, "{found}, not {expected}");
        }
    }
}
