//! Masks and images over the texels of a light.

use super::file::{LookImage, PatternShape};
use crate::image::LinearImage;

/// Sample points along each side of a texel: coverage is known to a sixty-fourth.
const POINTS: u32 = 8;

/// The mean of `value` over each texel of an `across × down` layout, row by row; coordinates run over the unit square.
fn average(layout: (u32, u32), value: impl Fn(f32, f32) -> [f32; 3]) -> Vec<[f32; 3]> {
    let (across, down) = layout;
    let texels = (0..down).flat_map(|y| (0..across).map(move |x| (x, y)));
    let mean = |(x, y): (u32, u32)| {
        let mut sum = [0.0; 3];
        for point in 0..POINTS * POINTS {
            let offset = [(point % POINTS) as f32 + 0.5, (point / POINTS) as f32 + 0.5].map(|v| v / POINTS as f32);
            let of_point = value((x as f32 + offset[0]) / across as f32, (y as f32 + offset[1]) / down as f32);
            (0..3).for_each(|ch| sum[ch] += of_point[ch]);
        }
        sum.map(|v| v / (POINTS * POINTS) as f32)
    };
    texels.map(mean).collect()
}

/// How much of each texel a shape covers; a gradient goes from 0 at `from` to 1 at `to`.
pub(super) fn shape_mask(layout: (u32, u32), shape: PatternShape) -> Vec<[f32; 3]> {
    average(layout, |u, v| {
        let value = match shape {
            PatternShape::Disc { center, radius } => {
                f32::from(u8::from((u - center[0]).hypot(v - center[1]) <= radius))
            }
            PatternShape::Rectangle { center, size } => {
                let within = |at: f32, center: f32, size: f32| (at - center).abs() <= 0.5 * size;
                f32::from(u8::from(within(u, center[0], size[0]) && within(v, center[1], size[1])))
            }
            PatternShape::Gradient { from, to } => {
                let along = [to[0] - from[0], to[1] - from[1]];
                let length = (along[0] * along[0] + along[1] * along[1]).max(1e-12);
                (((u - from[0]) * along[0] + (v - from[1]) * along[1]) / length).clamp(0.0, 1.0)
            }
        };
        [value; 3]
    })
}

/// The image over each texel, black outside its place.
pub(super) fn image_mask(layout: (u32, u32), picture: &LookImage, image: &LinearImage) -> Vec<[f32; 3]> {
    let [left, top, right, bottom] = picture.place;
    average(layout, |u, v| {
        let at = [(u - left) / (right - left), (v - top) / (bottom - top)];
        if !at.iter().all(|v| (0.0..1.0).contains(v)) {
            return [0.0; 3];
        }
        let x = (at[0] * image.width as f32) as usize;
        let y = (at[1] * image.height as f32) as usize;
        image.pixels[y.min(image.height as usize - 1) * image.width as usize + x.min(image.width as usize - 1)]
    })
}
