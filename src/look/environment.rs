//! An environment map resampled to the texels of an environment light.

use std::f64::consts::{PI, TAU};

use crate::image::LinearImage;
use crate::light::{Light, LightKind};

/// Points for each texel at least, so that coarse maps reach all texels.
const POINTS: usize = 16;

/// Most points in all: a finer map is sampled, not averaged whole.
const MOST_POINTS: usize = 1 << 19;

/// Weights with which the light's columns show a lat-long map (zenith at its top, −z at its left edge, turned by
/// `rotation_radians` from −z towards +x): the mean over each texel, scaled so that the whole energy `∫ L dω` is the
/// map's own in every channel.
pub(super) fn resample(light: &Light, map: &LinearImage, rotation_radians: f64) -> Vec<[f32; 3]> {
    let texels = light.places.len();
    let (mut sums, mut total) = (vec![[0.0f64; 4]; texels], [0.0f64; 3]);
    let (width, height) = sample_grid(map, texels);
    for row in 0..height {
        let (upper, lower) = (row as f64 * PI / height as f64, (row + 1) as f64 * PI / height as f64);
        let solid_angle = TAU / width as f64 * (upper.cos() - lower.cos());
        let polar = 0.5 * (upper + lower);
        for column in 0..width {
            let pixel = pixel_at(map, (column as f64 + 0.5) / width as f64, (row as f64 + 0.5) / height as f64);
            let turn = ((column as f64 + 0.5) / width as f64 * TAU + rotation_radians).rem_euclid(TAU);
            let sum = &mut sums[texel_at(light, turn, polar)];
            for channel in 0..3 {
                let energy = f64::from(pixel[channel]) * solid_angle;
                sum[channel] += energy;
                total[channel] += energy;
            }
            sum[3] += solid_angle;
        }
    }
    let means: Vec<[f64; 3]> =
        sums.iter().map(|sum| [0, 1, 2].map(|ch: usize| if sum[3] > 0.0 { sum[ch] / sum[3] } else { 0.0 })).collect();
    let scale = [0, 1, 2].map(|ch: usize| {
        let kept: f64 = means.iter().zip(&light.extents).map(|(mean, &extent)| mean[ch] * f64::from(extent)).sum();
        if kept > 0.0 { total[ch] / kept } else { 0.0 }
    });
    means.iter().map(|mean| [0, 1, 2].map(|ch: usize| (mean[ch] * scale[ch]) as f32)).collect()
}

/// Sample points over the map: a whole number for each pixel of a coarse map, fewer than pixels for a very fine one.
fn sample_grid(map: &LinearImage, texels: usize) -> (usize, usize) {
    let (width, height) = (map.width as usize, map.height as usize);
    let pixels = (width * height).max(1);
    if pixels > MOST_POINTS {
        let shrink = (pixels as f64 / MOST_POINTS as f64).sqrt();
        return (((width as f64 / shrink) as usize).max(1), ((height as f64 / shrink) as usize).max(1));
    }
    let cuts = ((POINTS * texels) as f64 / pixels as f64).sqrt().ceil().max(1.0) as usize;
    (width * cuts, height * cuts)
}

fn pixel_at(map: &LinearImage, u: f64, v: f64) -> [f32; 3] {
    let (width, height) = (map.width as usize, map.height as usize);
    let (x, y) = ((u * width as f64) as usize, (v * height as f64) as usize);
    map.pixels[y.min(height - 1) * width + x.min(width - 1)]
}

/// The texel that a direction falls into: computed where texels are a lat-long grid, else the one whose centre is
/// nearest.
fn texel_at(light: &Light, turn: f64, polar: f64) -> usize {
    if let LightKind::LatLong { across, down } = light.kind {
        let x = ((turn / TAU * f64::from(across)) as u32).min(across - 1);
        let y = ((polar / PI * f64::from(down)) as u32).min(down - 1);
        return (y * across + x) as usize;
    }
    nearest_texel(light, [polar.sin() * turn.sin(), polar.cos(), -polar.sin() * turn.cos()].map(|v| v as f32))
}

/// The column whose direction is nearest to `direction`.
pub(super) fn nearest_texel(light: &Light, direction: [f32; 3]) -> usize {
    let dot = |place: &[f32; 3]| (0..3).map(|i| place[i] * direction[i]).sum::<f32>();
    let nearest = light.places.iter().enumerate().max_by(|(_, a), (_, b)| dot(a).total_cmp(&dot(b)));
    nearest.map_or(0, |(texel, _)| texel)
}
