//! Tone mapping: from linear radiance to a display.

use std::path::Path;

use super::kelvin::kelvin_to_linear;
use super::linear::LinearImage;
use super::measure::percentile;
use crate::error::{Error, Result};
use crate::files::replace;

/// The sRGB transfer function (IEC 61966-2-1) of a linear value, clamped to [0, 1].
pub fn encode_srgb(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Luminous efficacy of white light in lm/W, as Radiance has it (Ward Larson and Shakespeare 1998, *Rendering with Radiance*, §4.1):
/// radiance in W·sr⁻¹·m⁻² times this is luminance in cd·m⁻².
pub const LUMENS_PER_WATT: f32 = 179.0;

/// Tone mapping operators and their parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneCurve {
    /// Values above 1 are cut.
    #[default]
    None,
    /// AgX, base look: T. Sobotka's, in the polynomial form of B. Wrensch.
    Agx,
    /// A film curve in the manner of ACES: K. Narkowicz's fit, one channel at a time.
    Filmic,
    /// Khronos PBR Neutral: colours below 0.8 stay as they are.
    Neutral,
}

/// From linear radiance to 8 bits: white balance, exposure, curve, sRGB.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneMapping {
    /// The curve.
    pub curve: ToneCurve,
    /// Exposure in stops: values are multiplied by 2 to this power.
    pub exposure_stops: f32,
    /// Temperature in kelvin of the light that shall look white; none leaves colours alone.
    pub white_kelvin: Option<f32>,
}

impl ToneMapping {
    /// Exposed so that the 95th luminance percentile of `image` maps to `white`, before the curve. What is black beside the rest
    /// ([`BLACK_BELOW`]) does not count.
    #[must_use]
    pub fn auto_exposed(self, image: &LinearImage, white: f32) -> Self {
        let level = percentile(not_black(image.luminances().collect()), 0.95).max(1e-12);
        Self { exposure_stops: self.exposure_stops + (white / level).log2(), ..self }
    }

    /// What each channel of a pixel is multiplied by before the curve: exposure and white balance.
    pub fn gains(self) -> [f32; 3] {
        let gain = self.exposure_stops.exp2();
        let white = self.white_kelvin.map_or([1.0; 3], |kelvin| kelvin_to_linear(kelvin).map(|v| v.max(0.05)));
        white.map(|white| gain / white)
    }

    /// 8 bits of each channel of every pixel, as they are displayed.
    pub fn bytes(self, image: &LinearImage) -> Vec<[u8; 3]> {
        image.pixels.iter().map(|&pixel| self.display(pixel).map(|v| (v * 255.0 + 0.5) as u8)).collect()
    }

    /// Displayed (sRGB-encoded) values of a linear pixel, in [0, 1]; values that are not finite count as 0. Twin of
    /// `shaders/tone.wgsl`.
    pub fn display(self, pixel: [f32; 3]) -> [f32; 3] {
        let gains = self.gains();
        self.curve.encode([0, 1, 2].map(|ch: usize| pixel[ch] * gains[ch]))
    }
}

impl ToneCurve {
    /// Displayed (sRGB-encoded) values of an exposed linear pixel, in [0, 1]; values that are not finite count as 0.
    pub fn encode(self, exposed: [f32; 3]) -> [f32; 3] {
        let linear = exposed.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        match self {
            Self::None => linear.map(encode_srgb),
            Self::Agx => agx(linear, agx_curve),
            Self::Filmic => linear.map(|v| encode_srgb(filmic(v))),
            Self::Neutral => neutral(linear).map(encode_srgb),
        }
    }
}

/// The film curve, linear to linear. Squares of values above 10¹⁸ are no numbers any more, and show as white.
pub(super) fn filmic(v: f32) -> f32 {
    let v = v.min(1e18);
    (v * (2.51 * v + 0.03)) / (v * (2.43 * v + 0.59) + 0.14)
}

/// AgX's curve from linear to displayed values, in its own primaries.
pub(super) fn agx_curve(v: f32) -> f32 {
    const STOPS: [f32; 2] = [-12.473_93, 4.026_069];
    const TERMS: [f32; 7] = [-0.002_32, 0.119_1, 0.429_8, -6.868, 31.96, -40.14, 15.5];
    let x = (v.max(1e-10).log2().clamp(STOPS[0], STOPS[1]) - STOPS[0]) / (STOPS[1] - STOPS[0]);
    TERMS.iter().rev().fold(0.0, |sum, term| sum * x + term)
}

/// AgX from linear to displayed values; its curve ends in display space.
pub(super) fn agx(linear: [f32; 3], curve: impl Fn(f32) -> f32) -> [f32; 3] {
    const INTO: [[f32; 3]; 3] = [
        [0.842_479_05, 0.078_433_6, 0.079_223_745],
        [0.042_328_242, 0.878_468_64, 0.079_166_13],
        [0.042_375_655, 0.078_433_6, 0.879_143],
    ];
    const OUT: [[f32; 3]; 3] = [
        [1.196_879, -0.098_020_88, -0.099_029_74],
        [-0.052_896_757, 1.151_903_1, -0.098_961_18],
        [-0.052_971_636, -0.098_043_45, 1.151_073_7],
    ];
    let product =
        |m: &[[f32; 3]; 3], v: [f32; 3]| [0, 1, 2].map(|i: usize| (0..3).map(|j| m[i][j] * v[j]).sum::<f32>());
    product(&OUT, product(&INTO, linear).map(curve)).map(|v| v.clamp(0.0, 1.0))
}

/// Khronos PBR Neutral (the specification's reference code), linear to linear.
pub(super) fn neutral(color: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let least = color.into_iter().fold(f32::INFINITY, f32::min);
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let color = color.map(|v| v - offset);
    let peak = color.into_iter().fold(0.0, f32::max);
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let mix = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    color.map(|v| v * new_peak / peak * (1.0 - mix) + new_peak * mix)
}

/// Maps the luminance of an image to colours, from black over blue, green and red to white, one step for each factor of
/// `(high / low)^⅙`. The result is linear, for [`ToneMapping::default`].
///
/// Luminance is Rec. 709's of the pixel, in its unit: where that is W·sr⁻¹·m⁻², [`LUMENS_PER_WATT`] makes it cd·m⁻².
///
/// # Errors
/// Limits that are not positive and in order.
pub fn false_colour(image: &LinearImage, low: f32, high: f32) -> Result<LinearImage> {
    const COLOURS: [[f32; 3]; 7] = [
        [0.0, 0.0, 0.0],
        [0.05, 0.0, 0.5],
        [0.0, 0.4, 0.9],
        [0.0, 0.7, 0.2],
        [0.9, 0.8, 0.0],
        [0.9, 0.1, 0.0],
        [1.0, 1.0, 1.0],
    ];
    if !(low > 0.0 && high > low && high.is_finite()) {
        return Err(Error::input(
            "false colour",
            format!("{low} to {high} is no range of luminance"),
            "give 0 < low < high",
        ));
    }
    let colour = |luminance: f32| {
        let at = ((luminance.max(low) / low).ln() / (high / low).ln()).clamp(0.0, 1.0) * (COLOURS.len() - 1) as f32;
        let step = (at as usize).min(COLOURS.len() - 2);
        let part = at - step as f32;
        [0, 1, 2].map(|ch: usize| COLOURS[step][ch] * (1.0 - part) + COLOURS[step + 1][ch] * part)
    };
    Ok(LinearImage { pixels: image.luminances().map(colour).collect(), ..*image })
}

/// The luminances of the colours of [`false_colour`], from `low` (and below) to `high` (and above).
pub fn false_colour_scale(low: f32, high: f32) -> [(&'static str, f32); 7] {
    let names = ["black", "dark blue", "blue", "green", "yellow", "red", "white"];
    std::array::from_fn(|i| (names[i], low * (high / low).powf(i as f32 / 6.0)))
}

/// Pixels below this part of the 99th percentile of all, ten stops, are black where the others are seen. In the picture of a lamp that lights a corner
/// they are most, and hold what noise and packing have left there.
pub const BLACK_BELOW: f32 = 1.0 / 1024.0;

/// The values that are positive and not [`BLACK_BELOW`] beside the others.
fn not_black(mut values: Vec<f32>) -> Vec<f32> {
    values.iter_mut().for_each(|value| *value = if value.is_finite() { value.max(0.0) } else { 0.0 });
    let least = BLACK_BELOW * percentile(values.clone(), 0.99);
    values.retain(|&value| value > 0.0 && value >= least);
    values
}

/// Exposure, in stops, that brings the 85th percentile of pixels' largest channels to 0.7, so that lamps in view do not
/// darken the room. It is lower by at most one stop if more than a twentieth of the pixels would exceed white. Pixels that are black beside the
/// others ([`BLACK_BELOW`]) and missing parts do not count. 0 for a black image.
pub fn exposure_for(image: &LinearImage) -> f32 {
    // Luminance would leave coloured light burnt out: of pure blue it is a fourteenth of the channel.
    let peak = |pixel: &[f32; 3]| pixel.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut peaks = not_black(image.pixels.iter().map(peak).collect());
    if peaks.is_empty() {
        return 0.0;
    }
    let last = peaks.len() - 1;
    let mut at = |percent: usize| *peaks.select_nth_unstable_by(last * percent / 100, f32::total_cmp).1;
    let (bright, white) = (at(85), at(95));
    let stops = (0.7 / bright).log2();
    stops.min((1.0 / white).log2().max(stops - 1.0)).clamp(-24.0, 24.0)
}

/// Writes an 8-bit sRGB PNG through `tone`; a file of that name is replaced, whole.
///
/// # Errors
/// The system refuses to write; then the old file stands.
pub fn write_toned_png(path: &Path, image: &LinearImage, tone: ToneMapping) -> Result<()> {
    write_rgb_png(path, image.width, image.height, tone.bytes(image).into_flattened())
}

/// Writes an 8-bit sRGB PNG, exposed so that the 95th luminance percentile maps to `white`. An existing file is
/// replaced, as a whole.
///
/// # Errors
/// The system refuses to write; then the old file stands.
pub fn write_png(path: &Path, image: &LinearImage, white: f32) -> Result<()> {
    let exposure = white / percentile(image.luminances().collect(), 0.95).max(1e-12);
    let bytes = image.values().iter().map(|v| (encode_srgb(v * exposure) * 255.0 + 0.5) as u8).collect();
    write_rgb_png(path, image.width, image.height, bytes)
}

/// Writes 8-bit sRGB pixels, 3 bytes each, row by row from the top, as a PNG. An existing file is replaced, as a whole.
///
/// # Errors
/// The bytes do not make an image of that size; the system refuses to write. Then the old file stands.
pub fn write_rgb_png(path: &Path, width: u32, height: u32, bytes: Vec<u8>) -> Result<()> {
    let image = image::RgbImage::from_raw(width, height, bytes)
        .ok_or_else(|| Error::input(path.display().to_string(), "there is no image yet", ""))?;
    replace(path, true, |file| {
        let encoder = image::codecs::png::PngEncoder::new(file);
        image.write_with_encoder(encoder).map_err(|e| match e {
            image::ImageError::IoError(io) => Error::io(path, "write the image")(io),
            other => Error::io(path, "write the image")(std::io::Error::other(other)),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURVES: [ToneCurve; 4] = [ToneCurve::None, ToneCurve::Agx, ToneCurve::Filmic, ToneCurve::Neutral];

    #[test]
    fn every_curve_keeps_black_dark_and_grows_and_stays_within_the_display() {
        for curve in CURVES {
            let tone = ToneMapping { curve, ..Default::default() };
            let mut last = 0.0;
            for i in 0..400 {
                let grey = tone.display([1e-4 * 1.05f32.powi(i); 3]);
                assert!(grey.iter().all(|v| (0.0..=1.0).contains(v)));
                // The polynomial of AgX wavers by less than a thousandth at its ends.
                assert!(grey[0] >= last - 1e-3, "{curve:?} at step {i}: {} after {last}", grey[0]);
                last = grey[0];
            }
            assert!(tone.display([0.0; 3])[0] < 0.01 && last > 0.95, "{curve:?}: {last}");
            assert!(tone.display([f32::NAN, f32::INFINITY, -1.0]).iter().all(|v| *v < 0.01), "{curve:?}");
        }
    }

    #[test]
    fn neutral_leaves_the_middle_alone() {
        // The specification: below 0.8 only the Fresnel offset of 0.04 is taken away.
        let mapped = neutral([0.5, 0.3, 0.2]);
        for (mapped, expected) in mapped.into_iter().zip([0.46, 0.26, 0.16]) {
            assert!((mapped - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn middle_grey_of_agx_and_filmic_is_where_they_put_it() {
        let at = |curve| ToneMapping { curve, ..Default::default() }.display([0.18; 3])[1];
        // 0.18 lies ten stops above AgX's black, (10 / 16.5); its curve gives a little less than half.
        assert!((0.42..0.52).contains(&at(ToneCurve::Agx)), "{}", at(ToneCurve::Agx));
        let filmic = (0.18 * (2.51 * 0.18 + 0.03)) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14);
        assert!((at(ToneCurve::Filmic) - encode_srgb(filmic)).abs() < 1e-6);
    }

    #[test]
    fn exposure_and_white_balance_do_what_they_say() {
        let stop = ToneMapping { exposure_stops: 1.0, ..Default::default() };
        assert_eq!(stop.display([0.1; 3]), ToneMapping::default().display([0.2; 3]));
        let warm = kelvin_to_linear(3000.0).map(|v| 0.3 * v);
        let balanced = ToneMapping { white_kelvin: Some(3000.0), ..Default::default() }.display(warm);
        assert!(balanced.iter().all(|v| (v - encode_srgb(0.3)).abs() < 1e-5), "{balanced:?}");
    }

    /// A lamp alone that lights a thirtieth of the picture: what is left elsewhere does not choose the exposure.
    #[test]
    fn a_lit_corner_is_exposed_for_itself() {
        let lit = |i: usize| 0.1 + 0.001 * (i % 100) as f32;
        let corner = |rest: &dyn Fn(usize) -> f32| {
            let value = |i: usize| if i < 100 { lit(i) } else { rest(i) };
            LinearImage { width: 100, height: 30, pixels: (0..3000).map(|i| [value(i); 3]).collect() }
        };
        let exposures =
            |image: &LinearImage| [exposure_for(image), ToneMapping::default().auto_exposed(image, 1.0).exposure_stops];
        let black = exposures(&corner(&|_| 0.0));
        assert!(black.iter().all(|stops| (1.5..3.0).contains(stops)), "{black:?}");
        let grain = exposures(&corner(&|i| if i % 3 == 0 { -1e-6 } else { 1e-6 + 1e-8 * i as f32 }));
        assert_eq!(grain, black);
    }

    #[test]
    fn false_colour_goes_from_black_to_white() {
        let image = LinearImage { width: 3, height: 1, pixels: vec![[0.01; 3], [1.0; 3], [200.0; 3]] };
        let shown = false_colour(&image, 0.1, 100.0).unwrap();
        assert_eq!((shown.pixels[0], shown.pixels[2]), ([0.0; 3], [1.0; 3]));
        assert!(false_colour(&image, 1.0, 1.0).is_err());
    }
}
