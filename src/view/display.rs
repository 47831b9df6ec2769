//! From radiance to the colours on the screen, and the histogram.

use rayon::prelude::*;

use super::planck::{colour_of_kelvin, luminance};
use crate::image::LinearImage;
use crate::image::encode_srgb;

/// White point that changes nothing, in kelvin.
pub const NEUTRAL_KELVIN: f32 = 6500.0;

/// Stops below and above 1 that histogram and false colour cover.
pub const STOPS_SHOWN: (f32, f32) = (-10.0, 6.0);

/// Bins of the histogram.
pub const BINS: usize = 128;

/// How radiance is turned to colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// Exposure in stops.
    pub exposure_stops: f32,
    /// Colour temperature that is shown as white, in kelvin.
    pub white_kelvin: f32,
    /// Whether luminance is shown as false colour, over [`STOPS_SHOWN`] after exposure.
    pub false_colour: bool,
}

/// A picture as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Opaque sRGB, row by row, 4 bytes a pixel.
    pub rgba: Vec<u8>,
    /// For red, green, blue: the share of pixels in each of [`BINS`] steps of [`STOPS_SHOWN`], after exposure.
    pub histogram: Vec<[f32; 3]>,
}

impl Default for Display {
    fn default() -> Self {
        Self { exposure_stops: 0.0, white_kelvin: NEUTRAL_KELVIN, false_colour: false }
    }
}

impl Display {
    /// Gain of each channel: exposure and white balance, which keeps the luminance of white.
    pub fn gains(&self) -> [f32; 3] {
        let exposure = self.exposure_stops.exp2();
        if self.white_kelvin == NEUTRAL_KELVIN {
            return [exposure; 3];
        }
        let (neutral, white) = (colour_of_kelvin(NEUTRAL_KELVIN), colour_of_kelvin(self.white_kelvin));
        let gains = [0, 1, 2].map(|ch| neutral[ch] / white[ch].max(1e-3));
        let luminance = luminance(gains);
        gains.map(|gain| gain / luminance * exposure)
    }

    /// Exposure, in stops, that brings the 85th percentile of luminance to 0.7, so that lamps in view do not
    /// darken the room; 0 for a black picture.
    pub fn exposure_for(image: &LinearImage) -> f32 {
        let mut luminances: Vec<f32> = image.luminances().filter(|v| v.is_finite()).collect();
        if luminances.is_empty() {
            return 0.0;
        }
        let index = (luminances.len() - 1) * 85 / 100;
        let bright = *luminances.select_nth_unstable_by(index, f32::total_cmp).1;
        if bright > 0.0 { (0.7 / bright).log2().clamp(-24.0, 24.0) } else { 0.0 }
    }

    /// The picture as it is shown, on all threads.
    pub fn show(&self, image: &LinearImage) -> Shown {
        let gains = self.gains();
        let (width, height) = (image.width as usize, image.height as usize);
        let mut rgba = vec![255; width * height * 4];
        let curve = Curve::new();
        let counts = rgba
            .par_chunks_mut((width * 4).max(1))
            .zip(image.pixels.par_chunks(width.max(1)))
            .fold(
                || vec![[0u32; 3]; BINS],
                |mut counts, (row, pixels)| {
                    for (bytes, pixel) in row.chunks_exact_mut(4).zip(pixels) {
                        let exposed = [0, 1, 2].map(|ch| pixel[ch] * gains[ch]);
                        for (channel, value) in exposed.into_iter().enumerate() {
                            counts[bin(value)][channel] += 1;
                        }
                        let colour = if self.false_colour {
                            false_colour(luminance(exposed))
                        } else {
                            exposed.map(|value| curve.encode(value))
                        };
                        bytes[..3].copy_from_slice(&colour);
                    }
                    counts
                },
            )
            .reduce(
                || vec![[0; 3]; BINS],
                |mut sum, counts| {
                    for (sum, count) in sum.as_flattened_mut().iter_mut().zip(counts.as_flattened()) {
                        *sum += count;
                    }
                    sum
                },
            );
        let pixels = (width * height).max(1) as f32;
        let histogram = counts.into_iter().map(|bin| bin.map(|count| count as f32 / pixels)).collect();
        Shown { size: [width, height], rgba, histogram }
    }
}

/// Bin of a value; all that is not above the least falls into the first.
fn bin(value: f32) -> usize {
    let (low, high) = STOPS_SHOWN;
    let at = (value.max(f32::MIN_POSITIVE).log2() - low) / (high - low) * BINS as f32;
    (at as usize).min(BINS - 1)
}

/// The sRGB curve as a table over values of [0, 1], fine enough that no 8-bit step is missed where it is steepest.
struct Curve(Vec<u8>);

impl Curve {
    const STEPS: usize = 1 << 14;

    fn new() -> Self {
        let byte = |i: usize| (encode_srgb(i as f32 / Self::STEPS as f32) * 255.0 + 0.5) as u8;
        Self((0..=Self::STEPS).map(byte).collect())
    }

    fn encode(&self, value: f32) -> u8 {
        // Conversion to an integer saturates; NaN becomes 0.
        self.0[((value * Self::STEPS as f32 + 0.5) as usize).min(Self::STEPS)]
    }
}

/// Stops of an exposed luminance as a colour: from deep blue over green and yellow to red, white above all.
pub fn false_colour(value: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 7] = [
        [0.07, 0.04, 0.18],
        [0.16, 0.23, 0.60],
        [0.10, 0.56, 0.66],
        [0.24, 0.72, 0.36],
        [0.93, 0.85, 0.24],
        [0.94, 0.45, 0.14],
        [1.00, 0.93, 0.92],
    ];
    let (low, high) = STOPS_SHOWN;
    let at = ((value.max(f32::MIN_POSITIVE).log2() - low) / (high - low)).clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let (index, part) = ((at as usize).min(STOPS.len() - 2), at - (at as usize).min(STOPS.len() - 2) as f32);
    [0, 1, 2].map(|ch| ((STOPS[index][ch] * (1.0 - part) + STOPS[index + 1][ch] * part) * 255.0 + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_doubles_and_bytes_are_those_of_srgb() {
        let pixels = (0..4096).map(|i| [i as f32 / 4095.0, 0.0, f32::NAN]).collect();
        let image = LinearImage { width: 64, height: 64, pixels };
        let shown = Display { exposure_stops: 1.0, ..Default::default() }.show(&image);
        for (bytes, pixel) in shown.rgba.chunks_exact(4).zip(&image.pixels) {
            let exact = encode_srgb(pixel[0] * 2.0) * 255.0;
            // Rounding to a byte and to a step of the table, where sRGB is steepest: 12.92 · 255 / 2¹⁴ / 2.
            assert!((f32::from(bytes[0]) - exact).abs() <= 0.5 + 0.11, "{exact}");
            assert_eq!(bytes[1..], [0, 0, 255]);
        }
    }

    #[test]
    fn the_histogram_counts_every_pixel() {
        let image = LinearImage { width: 3, height: 1, pixels: vec![[0.0; 3], [1.0, 1e9, -4.0], [0.5; 3]] };
        let histogram = Display::default().show(&image).histogram;
        for channel in 0..3 {
            assert!((histogram.iter().map(|bin| bin[channel]).sum::<f32>() - 1.0).abs() < 1e-6);
        }
        assert!(histogram[bin(1.0)][0] > 0.3 && histogram[BINS - 1][1] > 0.3);
    }

    #[test]
    fn white_balance_makes_its_white_grey_and_keeps_its_brightness() {
        let display = Display { white_kelvin: 3000.0, ..Default::default() };
        let (white, neutral) = (colour_of_kelvin(3000.0), colour_of_kelvin(NEUTRAL_KELVIN));
        let seen = [0, 1, 2].map(|ch| white[ch] * display.gains()[ch] / neutral[ch]);
        assert!((seen[0] / seen[1] - 1.0).abs() < 1e-4 && (seen[2] / seen[1] - 1.0).abs() < 1e-4);
        assert!((luminance(display.gains()) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn automatic_exposure_shows_most_of_the_picture() {
        let image = LinearImage { width: 100, height: 1, pixels: (0..100).map(|i| [i as f32; 3]).collect() };
        let exposed = 84.0 * Display::exposure_for(&image).exp2();
        assert!((exposed - 0.7).abs() < 1e-3);
        assert_eq!(Display::exposure_for(&LinearImage::black(2, 2)), 0.0);
    }
}
