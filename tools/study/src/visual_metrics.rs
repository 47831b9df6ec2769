//! How far an image is from its reference for the eye.

use ltm::image::{LinearImage, compare, encode_srgb};

use super::flip::Flip;
use super::measured::exposure_of;

/// Luminance above which a pixel that ought to be black glows, and below whose negative it is a hole: a part of the
/// reference's 95th percentile.
const VISIBLE: f64 = 0.01;

/// Error of an image against its reference, as it is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Mean ꟻLIP (Andersson et al. 2020) of the displayed images at 67 pixels a degree.
    pub(super) flip: f64,
    /// PSNR in dB, exposed and clipped to [0, 1].
    pub(super) psnr_clipped: f64,
    /// PSNR in dB, peak = the reference's largest value.
    pub(super) psnr_linear: f64,
    /// `‖image − reference‖₂ / ‖reference‖₂`.
    pub(super) relative_l2: f64,
    /// Mean jump of the error across block edges over that inside blocks, after a median of three along the edge.
    pub(super) seams: f64,
    /// Part of the pixels that are exactly black in the raw matrix and visibly bright here.
    pub(super) glow: f64,
    /// Part of the pixels that are visibly negative.
    pub(super) negative: f64,
}

impl Seen {
    /// Measures an image of blocks of `block_side` pixels. `raw` is what the matrix itself shows. Panics if sizes differ.
    pub(super) fn of(image: &LinearImage, reference: &LinearImage, raw: &LinearImage, block_side: u32) -> Self {
        let error = compare(image, reference);
        let exposure = exposure_of(reference);
        let pixels = image.pixels.len() as f64;
        let part = |count: usize| count as f64 / pixels;
        let exposed =
            |image: &LinearImage| -> Vec<f64> { image.luminances().map(|v| f64::from(v) * exposure).collect() };
        let (bright, of_raw) = (exposed(image), exposed(raw));
        Self {
            flip: Flip::new(image, reference, |image| displayed(image, exposure)).mean(),
            psnr_clipped: error.psnr_clipped,
            psnr_linear: error.psnr_linear,
            relative_l2: error.relative_l2,
            seams: seams(&bright, &exposed(reference), image.width as usize, block_side as usize),
            glow: part(bright.iter().zip(&of_raw).filter(|(v, raw)| **raw == 0.0 && **v > VISIBLE).count()),
            negative: part(bright.iter().filter(|v| **v < -VISIBLE).count()),
        }
    }
}

/// 8-bit sRGB bytes of an exposed image under an extended Reinhard curve: white at 4, times 1.6, clipped.
fn displayed(image: &LinearImage, exposure: f64) -> Vec<u8> {
    let curve = |v: f32| {
        let c = (f64::from(v) * exposure).max(0.0);
        (c * (1.0 + c / 16.0) / (1.0 + c) * 1.6).min(1.0)
    };
    image.values().iter().map(|&v| (encode_srgb(curve(v) as f32) * 255.0 + 0.5) as u8).collect()
}

/// See [`Seen::seams`]. Values are luminances, exposed; a picture of one block has none: 1.
fn seams(image: &[f64], reference: &[f64], width: usize, side: usize) -> f64 {
    let height = image.len() / width;
    let clip = |v: f64| v.clamp(0.0, 1.0);
    let error: Vec<f64> = image.iter().zip(reference).map(|(a, b)| clip(*a) - clip(*b)).collect();
    let (mut across, mut edges, mut inside, mut others) = (0.0, 0usize, 0.0, 0usize);
    let mut add = |jump: f64, at_edge: bool| match at_edge {
        true => (across, edges) = (across + jump, edges + 1),
        false => (inside, others) = (inside + jump, others + 1),
    };
    for (length, lines, along, over) in [(width, height, width, 1), (height, width, 1, width)] {
        let calm = |line: usize, at: usize| {
            let mut near =
                [line.saturating_sub(1), line, (line + 1).min(lines - 1)].map(|l| error[l * along + at * over]);
            near.sort_by(f64::total_cmp);
            near[1]
        };
        for line in 0..lines {
            for at in 1..length {
                add((calm(line, at) - calm(line, at - 1)).abs(), at % side == 0);
            }
        }
    }
    match edges > 0 && inside > 0.0 {
        true => (across / edges as f64) / (inside / others as f64),
        false => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_at_block_edges_are_seams_and_steps_elsewhere_are_not() {
        let (width, height) = (64, 32);
        let flat = vec![0.5; width * height];
        let noise = |i: usize| 0.01 * ((i * 7919 % 101) as f64 / 101.0);
        let with = |step: fn(usize) -> f64| -> Vec<f64> {
            (0..width * height).map(|i| 0.5 + noise(i) + step(i % width)).collect()
        };
        let stepped = seams(&with(|x| if x >= 16 { 0.1 } else { 0.0 }), &flat, width, 16);
        let elsewhere = seams(&with(|x| if x >= 23 { 0.1 } else { 0.0 }), &flat, width, 16);
        let none = seams(&with(|_| 0.0), &flat, width, 16);
        assert!((0.7..1.3).contains(&none), "{none}");
        assert!(stepped > 2.0 * none && elsewhere < none, "{stepped} {elsewhere} {none}");
    }

    #[test]
    fn what_glows_and_what_is_negative_is_counted() {
        let reference = LinearImage { width: 16, height: 16, pixels: vec![[1.0; 3]; 256] };
        let mut raw = reference.clone();
        raw.pixels[..4].fill([0.0; 3]);
        let mut image = reference.clone();
        image.pixels[..2].fill([0.02; 3]);
        image.pixels[2..4].fill([0.005; 3]);
        image.pixels[8] = [-0.02; 3];
        let seen = Seen::of(&image, &reference, &raw, 8);
        assert_eq!((seen.glow, seen.negative), (2.0 / 256.0, 1.0 / 256.0));
        assert!(seen.flip > 0.0);
    }
}
