//! Where in its pixel a sample lies.

use glam::Vec2;

use crate::scene::{Camera, PixelFilter};

/// Offset of a sample from the centre of its pixel, drawn from the pixel filter.
#[inline(always)]
pub(super) fn filter_offset(camera: &Camera, pair: Vec2) -> Vec2 {
    match camera.filter {
        PixelFilter::Box => pair - 0.5,
        PixelFilter::Tent { radius } => {
            let tent = |x: f32| if x < 0.5 { (2.0 * x).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * x).max(0.0).sqrt() };
            radius * Vec2::new(tent(pair.x), tent(pair.y))
        }
        PixelFilter::Gaussian { deviation } => {
            // Box–Muller transform over a disc cut at three standard deviations.
            let inside = 1.0 - (-4.5f32).exp();
            let radius = (-2.0 * (1.0 - pair.x * inside).ln()).sqrt();
            let (sin, cos) = (std::f32::consts::TAU * pair.y).sin_cos();
            deviation * radius * Vec2::new(cos, sin)
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::super::statistics::chi_square_p_value;
    use super::*;

    /// Compares a histogram of `draws` values from 0 to `end` with the expected share below each bin's upper edge.
    fn holds(filter: PixelFilter, end: f32, value: impl Fn(Vec2) -> f32, below: impl Fn(f64) -> f64) {
        let camera = Camera::looking(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, (1, 1), filter).unwrap();
        let (bins, draws) = (40usize, 200_000);
        let mut random = Pcg64Mcg::seed_from_u64(6);
        let mut counts = vec![0u32; bins];
        for _ in 0..draws {
            let offset = filter_offset(&camera, Vec2::new(random.random(), random.random()));
            counts[((value(offset) / end * bins as f32) as usize).min(bins - 1)] += 1;
        }
        let edge = |bin: usize| below(f64::from(end) * bin as f64 / bins as f64);
        let expected: Vec<f64> = (0..bins).map(|b| f64::from(draws) * (edge(b + 1) - edge(b))).collect();
        let p = chi_square_p_value(&counts, &expected);
        assert!(p > 1e-4, "{filter:?}: p = {p:.2e}");
    }

    #[test]
    fn samples_fall_as_the_pixel_filter_says() {
        let radius = 1.5;
        let tent = |x: f64| 1.0 - (1.0 - x / f64::from(radius)).powi(2);
        holds(PixelFilter::Tent { radius }, radius, |o| o.x.abs(), tent);
        holds(PixelFilter::Tent { radius }, radius, |o| o.y.abs(), tent);
        let (deviation, cut) = (0.5, 1.0 - (-4.5f64).exp());
        let radial = |r: f64| (1.0 - (-0.5 * (r / f64::from(deviation)).powi(2)).exp()) / cut;
        holds(PixelFilter::Gaussian { deviation }, 3.0 * deviation, |o| o.length(), radial);
        // A quarter of the full angle each.
        let turn = |o: Vec2| o.y.atan2(o.x).rem_euclid(std::f32::consts::TAU);
        let even = |angle: f64| angle / std::f64::consts::TAU;
        holds(PixelFilter::Gaussian { deviation }, std::f32::consts::TAU, turn, even);
        holds(PixelFilter::Box, 0.5, |o| o.x.abs(), |x| 2.0 * x);
    }
}
