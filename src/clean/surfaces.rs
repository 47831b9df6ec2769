//! How far two pixels see one surface: the part of the weights that no light has a say in.

use std::ops::Range;

use super::constants::{ALBEDO_WIDTH, DEPTH_WIDTH, NORMAL_WIDTH, SHARE_WIDTH};
use super::rows::Rows;

const NORMAL: usize = 3;
const DEPTH: usize = 6;
const SPECULAR: usize = 8;
const SURFACE: usize = 9;

/// Planes that are compared: normal, albedo, shares; then the inverse depth with its slope across and down.
const COMPARED: usize = 8;
const WIDTHS: [f32; COMPARED] =
    [NORMAL_WIDTH, NORMAL_WIDTH, NORMAL_WIDTH, ALBEDO_WIDTH, ALBEDO_WIDTH, ALBEDO_WIDTH, SHARE_WIDTH, SHARE_WIDTH];

/// What pixels see, made ready for comparing.
pub(super) struct Surfaces {
    /// Compared planes, each in units of its width.
    compared: Rows,
    /// Half the variance of the sum of those, capped.
    noise: Rows,
    /// Inverse depth, its slope across and its slope down: planes are planes in it, whatever their tilt. Then its variance.
    inverse_depth: Rows,
}

impl Surfaces {
    pub(super) fn new(features: &Rows, variance: &Rows) -> Self {
        let (width, height) = (features.width(), features.height());
        let order = [NORMAL, NORMAL + 1, NORMAL + 2, 0, 1, 2, SPECULAR, SURFACE];
        let mut compared = Rows::zeros(width, height, COMPARED);
        compared.fill_rows(|y, out| {
            for ((plane, out), width) in order.iter().zip(out.chunks_exact_mut(width)).zip(WIDTHS) {
                out.iter_mut().zip(features.row(*plane, y)).for_each(|(o, v)| *o = v / width);
            }
        });
        let mut noise = Rows::zeros(width, height, 1);
        noise.fill_rows(|y, out| {
            for (plane, width) in order.iter().zip(WIDTHS) {
                let scale = 1.0 / (width * width);
                out.iter_mut().zip(variance.row(*plane, y)).for_each(|(o, v)| *o += v * scale);
            }
        });
        let mut inverse = Rows::zeros(width, height, 1);
        inverse.fill_rows(|y, out| {
            let pairs = features.row(DEPTH, y).iter().zip(features.row(SURFACE, y));
            out.iter_mut()
                .zip(pairs)
                .for_each(|(o, (depth, share))| *o = if *depth > 0.0 { share / depth } else { 0.0 });
        });
        let mut inverse_depth = Rows::zeros(width, height, 4);
        inverse_depth.fill_rows(|y, out| {
            let row = inverse.row(0, y);
            let above = (y > 0).then(|| inverse.row(0, y - 1));
            let below = (y + 1 < height).then(|| inverse.row(0, y + 1));
            let depths = features.row(DEPTH, y).iter().zip(variance.row(DEPTH, y));
            for (x, (depth, variance)) in depths.enumerate() {
                let (left, right) = (x.checked_sub(1).map(|x| row[x]), row.get(x + 1).copied());
                let across = gentle(left, row[x], right);
                let down = gentle(above.map(|row| row[x]), row[x], below.map(|row| row[x]));
                let noise = if *depth > 0.0 { variance * (row[x] / depth).powi(2) } else { 0.0 };
                let values = [row[x], certain(across, noise), certain(down, noise), noise];
                values.iter().enumerate().for_each(|(plane, value)| out[plane * width + x] = *value);
            }
        });
        Self { compared, noise, inverse_depth }
    }

    /// Adds the distances of the pixels of a row from their neighbours at one offset.
    pub(super) fn add_distances(&self, y: usize, (across, down): (isize, isize), span: Range<usize>, out: &mut [f32]) {
        let row = (y as isize + down) as usize;
        let begin = (span.start as isize + across) as usize;
        let there = begin..begin + span.len();
        let noise = self.noise.row(0, y)[span.clone()].iter().zip(&self.noise.row(0, row)[there.clone()]);
        let mut sum = vec![0.0f32; span.len()];
        for plane in 0..COMPARED {
            let a = &self.compared.row(plane, y)[span.clone()];
            let b = &self.compared.row(plane, row)[there.clone()];
            sum.iter_mut().zip(a.iter().zip(b)).for_each(|(s, (a, b))| *s += (a - b) * (a - b));
        }
        for ((o, s), (a, b)) in out.iter_mut().zip(&sum).zip(noise) {
            *o += (s - a - b).max(0.0) / (1.0 + a + b);
        }
        let [here, slope_across, slope_down, noise] =
            [0, 1, 2, 3].map(|plane| &self.inverse_depth.row(plane, y)[span.clone()]);
        let [other, other_noise] = [0, 3].map(|plane| &self.inverse_depth.row(plane, row)[there.clone()]);
        let (across, down) = (across as f32, down as f32);
        for (i, out) in out.iter_mut().enumerate() {
            let expected = here[i] + slope_across[i] * across + slope_down[i] * down;
            let off = expected - other[i];
            let width = DEPTH_WIDTH * here[i].max(other[i]);
            let noise = noise[i] + other_noise[i];
            *out += (off * off - noise).max(0.0) / (width * width + noise + 1e-24);
        }
    }
}

/// A slope, shrunk where it may be noise.
fn certain(slope: f32, noise: f32) -> f32 {
    let square = slope * slope;
    if square > 0.0 { slope * square / (square + 8.0 * noise) } else { 0.0 }
}

/// The gentler of two one-sided slopes.
fn gentle(before: Option<f32>, here: f32, after: Option<f32>) -> f32 {
    match (before, after) {
        (Some(before), Some(after)) if (here - before).abs() < (after - here).abs() => here - before,
        (_, Some(after)) => after - here,
        (Some(before), None) => here - before,
        (None, None) => 0.0,
    }
}
