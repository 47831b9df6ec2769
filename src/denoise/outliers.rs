//! Outliers among the samples: light that one half of a pixel's samples has and nothing around it has.
//!
//! A path that finds a small bright surface by chance has a great weight. The filter finds no pixel that is like it, and
//! would leave it as a spot. So before anything is filtered, what a half of the samples has above a bound is taken from
//! the pixel and given to the pixels of the same surface around it, in equal parts. The bound is a multiple of the mean of
//! the neighbourhood, and of what the other half has at the pixel: light that both halves have is no outlier (compare
//! the reweighting by neighbours of Zirr, Hanika and Dachsbacher 2018, *Re-weighting firefly samples for improved
//! finite-sample Monte Carlo estimates*). The sum of the light is unchanged. Each cluster image is treated by
//! itself, before any lighting is known, so that images remain linear in the lighting.

use crate::matrix::{BlockPlanes, CHANNELS, Feature};

use super::constants::{MIN_ALBEDO, NORMAL_WIDTH};

/// Radius of the neighbourhood in pixels, within the block.
const REACH: usize = 8;
/// Bound in units of the mean of the neighbourhood, and of the other half's light at the pixel and in the mean about it. Tuned:
/// decision 48.
const BOUND: f32 = 4.0;
/// Radius of that mean of the other half.
const OTHER_REACH: usize = 1;
/// Relative difference of depth at which a neighbour counts 1/e.
const DEPTH_WIDTH: f32 = 0.1;

/// Spreads the outliers of a block of so many pixels across.
pub(super) fn spread(planes: &mut BlockPlanes, width: usize) {
    let surfaces = Surfaces::of(planes, width);
    let (pixels, clusters) = (planes.pixels(), planes.clusters());
    for light in [&mut planes.direct, &mut planes.indirect] {
        for cluster in 0..clusters {
            let own = cluster * CHANNELS * pixels..(cluster + 1) * CHANNELS * pixels;
            let [a, b] = light.each_mut().map(|half| &mut half[own.clone()]);
            surfaces.spread([a, b]);
        }
    }
    planes.round();
}

/// What is known of a block's pixels.
struct Surfaces {
    width: usize,
    height: usize,
    /// Channel by channel, what light is divided by; 0 where no surface is seen.
    albedo: Vec<f32>,
    normal: Vec<f32>,
    depth: Vec<f32>,
}

impl Surfaces {
    fn of(planes: &BlockPlanes, width: usize) -> Self {
        let pixels = planes.pixels();
        let albedo = planes.feature(Feature::Albedo).iter().map(|albedo| albedo.max(MIN_ALBEDO)).collect();
        let share = planes.feature(Feature::Surface);
        let depth = planes.feature(Feature::Depth).iter().zip(share).map(|(depth, share)| depth / share.max(1e-6));
        Self {
            width,
            height: pixels / width,
            albedo,
            normal: planes.feature(Feature::Normal).to_vec(),
            depth: depth.collect(),
        }
    }

    /// Spreads the outliers of one image: its two halves, channel by channel.
    fn spread(&self, mut halves: [&mut [f32]; 2]) {
        let pixels = self.depth.len();
        let brightness = halves.each_ref().map(|half| -> Vec<f32> {
            let of = |at: usize| half[at] / self.albedo[at];
            (0..pixels).map(|pixel| (0..CHANNELS).map(|channel| of(channel * pixels + pixel)).sum()).collect()
        });
        let both: Vec<f32> = brightness[0].iter().zip(&brightness[1]).map(|(a, b)| 0.5 * (a + b)).collect();
        let around = self.box_means(&both, REACH);
        let about = brightness.each_ref().map(|half| self.box_means(half, OTHER_REACH));
        let mut taken: Vec<(usize, usize, [f32; CHANNELS])> = Vec::new();
        for half in 0..2 {
            for pixel in 0..pixels {
                let other = about[1 - half][pixel].max(brightness[1 - half][pixel]);
                let (own, most) = (brightness[half][pixel], BOUND * around[pixel].max(other));
                if own <= most {
                    continue;
                }
                let kept = most / own;
                let light = std::array::from_fn(|channel| {
                    let at = channel * pixels + pixel;
                    let all = halves[half][at];
                    halves[half][at] = kept * all;
                    (1.0 - kept) * all / self.albedo[at]
                });
                taken.push((half, pixel, light));
            }
        }
        for (half, pixel, light) in taken {
            self.give(pixel, light, halves[half]);
        }
    }

    /// Gives light, divided by albedo, to the pixels that are like one.
    fn give(&self, pixel: usize, light: [f32; CHANNELS], half: &mut [f32]) {
        let pixels = self.depth.len();
        let mut alike: Vec<(usize, f32)> = Vec::with_capacity((2 * REACH + 1).pow(2));
        for other in self.near(pixel, REACH) {
            let normal: f32 = (0..3)
                .map(|axis| (self.normal[axis * pixels + pixel] - self.normal[axis * pixels + other]).powi(2))
                .sum();
            let depth = (self.depth[other] - self.depth[pixel]) / self.depth[pixel].max(f32::MIN_POSITIVE);
            let distance = normal / (4.0 * NORMAL_WIDTH * NORMAL_WIDTH) + (depth / DEPTH_WIDTH).powi(2);
            alike.push((other, (-distance).exp()));
        }
        let sum: f32 = alike.iter().map(|(_, weight)| weight).sum();
        for (other, weight) in alike {
            for (channel, light) in light.iter().enumerate() {
                let at = channel * pixels + other;
                half[at] += weight / sum * light * self.albedo[at];
            }
        }
    }

    /// The pixels within a radius.
    fn near(&self, pixel: usize, reach: usize) -> impl Iterator<Item = usize> {
        let (x, y, width) = (pixel % self.width, pixel / self.width, self.width);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    /// The mean of each pixel's neighbourhood.
    fn box_means(&self, values: &[f32], reach: usize) -> Vec<f32> {
        let (width, height) = (self.width, self.height);
        // Sums of all pixels above and to the left.
        let mut sums = vec![0.0f64; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += f64::from(values[y * width + x]);
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
            }
        }
        let mean = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(width));
            let (top, bottom) = (y.saturating_sub(reach), (y + reach + 1).min(height));
            let sum = |y: usize, x: usize| sums[y * (width + 1) + x];
            let inside = sum(bottom, right) - sum(top, right) - sum(bottom, left) + sum(top, left);
            (inside / ((right - left) * (bottom - top)) as f64) as f32
        };
        (0..values.len()).map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 24;

    /// A wall of light 1 in both halves, of two clusters.
    fn wall() -> BlockPlanes {
        let mut planes = BlockPlanes::default();
        planes.reset(SIDE * SIDE, 2);
        planes.features.fill(0.5);
        planes.direct.iter_mut().chain(&mut planes.indirect).for_each(|half| half.fill(1.0));
        planes
    }

    fn set(half: &mut [f32], (x, y): (usize, usize), value: f32) {
        (0..CHANNELS).for_each(|channel| half[channel * SIDE * SIDE + y * SIDE + x] = value);
    }

    fn sum(half: &[f32]) -> f64 {
        half.iter().map(|&value| f64::from(value)).sum()
    }

    #[test]
    fn light_of_one_half_is_spread_and_none_is_lost() {
        let mut planes = wall();
        set(&mut planes.indirect[0], (12, 9), 500.0);
        let before = planes.clone();
        spread(&mut planes, SIDE);
        let [found, expected] = [&planes, &before].map(|planes| sum(&planes.indirect[0]));
        // Light is stored with nine significant bits.
        assert!((found / expected - 1.0).abs() < 2e-3, "{found}, not {expected}");
        let most = planes.indirect[0].iter().fold(0.0f32, |most, &value| most.max(value));
        assert!(most < 25.0, "a spot of {most}");
        assert_eq!((&planes.direct, &planes.indirect[1]), (&before.direct, &before.indirect[1]));
        let other = CHANNELS * SIDE * SIDE;
        assert_eq!(planes.indirect[0][other..], before.indirect[0][other..], "the other cluster");
    }

    #[test]
    fn light_of_both_halves_stays() {
        let mut planes = wall();
        for half in 0..2 {
            set(&mut planes.indirect[half], (5, 20), 50.0);
        }
        let before = planes.clone();
        spread(&mut planes, SIDE);
        assert_eq!(planes, before);
    }

    #[test]
    fn light_stays_on_its_surface() {
        let mut planes = wall();
        // The right half faces another way.
        for at in (0..SIDE * SIDE).filter(|at| at % SIDE >= SIDE / 2) {
            (3..6).for_each(|plane| planes.features[plane * SIDE * SIDE + at] = if plane == 3 { 1.0 } else { 0.0 });
        }
        set(&mut planes.indirect[1], (SIDE / 2 - 2, 10), 400.0);
        spread(&mut planes, SIDE);
        let most = (0..SIDE * SIDE).filter(|at| at % SIDE >= SIDE / 2).map(|at| planes.indirect[1][at]);
        assert!(most.fold(0.0, f32::max) < 1.05);
    }
}
