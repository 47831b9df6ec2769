//! Luminance and chroma: `Y`, `RY = (R − Y) / Y` and `BY = (B − Y) / Y`, of which the last two may have every second sample only.

use crate::image::primaries::Primaries;

/// Samples on either side from which one between is made.
const REACH: isize = 7;

/// One plane of samples.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
}

impl Plane {
    /// A plane of zeros.
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, values: vec![0.0; width * height] }
    }

    /// The plane upsampled by these factors, with the first of each group at an original sample. Interpolation is by
    /// windowed sinc, and the outermost samples continue beyond the edges.
    pub(super) fn grown(&self, (across, down): (usize, usize)) -> Self {
        let wide = Self { width: self.width * across, ..Self::new(self.width * across, self.height) };
        let wide = self.filled(wide, across, |plane, x, y| (y * plane.width, 1, x));
        let tall = Self::new(wide.width, self.height * down);
        wide.filled(tall, down, |plane, x, y| (x, plane.width, y))
    }

    /// Fills `target`, each of whose samples lies on a line of this plane's: `line` says where that begins, the step along it, and
    /// the place on it, in samples of `target`.
    fn filled(&self, mut target: Self, by: usize, line: impl Fn(&Self, usize, usize) -> (usize, usize, usize)) -> Self {
        let weights: Vec<Vec<f32>> = (0..by).map(|phase| weights(phase as f32 / by as f32)).collect();
        for y in 0..target.height {
            for x in 0..target.width {
                let (start, step, at) = line(self, x, y);
                let count = if step == 1 { self.width } else { self.height };
                let sample = |i: isize| self.values[start + step * i.clamp(0, count as isize - 1) as usize];
                let (whole, phase) = ((at / by) as isize, at % by);
                target.values[y * target.width + x] = match phase {
                    0 => sample(whole),
                    _ => weights[phase].iter().zip(whole + 1 - REACH..).map(|(w, i)| w * sample(i)).sum(),
                };
            }
        }
        target
    }
}

/// Weights of the samples around a place at this share of the way between two: Lanczos' window over the sinc function.
fn weights(share: f32) -> Vec<f32> {
    let sinc = |x: f32| if x == 0.0 { 1.0 } else { (std::f32::consts::PI * x).sin() / (std::f32::consts::PI * x) };
    let weight = |i: isize| {
        let distance = share - i as f32;
        sinc(distance) * sinc(distance / REACH as f32)
    };
    let weights: Vec<f32> = (1 - REACH..=REACH).map(weight).collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}

/// Shares of the primaries in luminance.
pub(super) fn luminance_weights(primaries: &Primaries) -> Option<[f32; 3]> {
    primaries.luminance_weights().map(|weights| weights.map(|w| w as f32))
}

/// The colour of a luminance and its chroma; what interpolation would make less than nothing is nothing.
pub(super) fn colour([y, ry, by]: [f32; 3], weights: [f32; 3]) -> [f32; 3] {
    let (red, blue) = ((ry + 1.0) * y, (by + 1.0) * y);
    let green = (y - weights[0] * red - weights[2] * blue) / weights[1];
    [red, green, blue].map(|v| if y >= 0.0 && v < 0.0 { 0.0 } else { v })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::primaries::REC_709;

    #[test]
    fn a_colour_comes_back_from_luminance_and_chroma() {
        let weights = luminance_weights(&REC_709).unwrap();
        let [r, g, b] = [0.9f32, 0.25, 0.125];
        let y = weights[0] * r + weights[1] * g + weights[2] * b;
        let found = colour([y, (r - y) / y, (b - y) / y], weights);
        assert!(found.iter().zip([r, g, b]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        assert_eq!(colour([0.0; 3], weights), [0.0; 3]);
    }

    /// A slow wave is band-limited: the samples between are known.
    #[test]
    fn samples_between_are_those_of_a_slow_wave() {
        let wave = |x: f32, y: f32| (0.3 * x).sin() + (0.2 * y).cos();
        let mut plane = Plane::new(40, 30);
        for y in 0..30 {
            for x in 0..40 {
                plane.values[y * 40 + x] = wave(x as f32, y as f32);
            }
        }
        for (across, down) in [(2, 2), (2, 1), (4, 2), (1, 1)] {
            let grown = plane.grown((across, down));
            assert_eq!((grown.width, grown.height), (40 * across, 30 * down));
            // Away from the edges, which are continued evenly.
            for y in 8 * down..22 * down {
                for x in 8 * across..32 * across {
                    let wanted = wave(x as f32 / across as f32, y as f32 / down as f32);
                    let found = grown.values[y * grown.width + x];
                    assert!((found - wanted).abs() < 3e-3, "{across} × {down} at {x}, {y}: {found} for {wanted}");
                }
            }
        }
    }
}
