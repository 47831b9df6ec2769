//! The colour of a black body.

use super::linear::luminance;

/// Lowest and highest temperature, in kelvin, that [`kelvin_to_linear`] tells apart.
pub const KELVIN_RANGE: std::ops::RangeInclusive<f32> = 1667.0..=25_000.0;

/// Linear Rec. 709 colour of a black body, scaled to luminance 1; channels that leave the gamut are 0.
///
/// Planckian locus after Kim et al., *Design of advanced color temperature control system for HDTV applications*
/// (2002), good over [`KELVIN_RANGE`], to which temperatures outside are brought.
pub fn kelvin_to_linear(kelvin: f32) -> [f32; 3] {
    let t = f64::from(kelvin.clamp(*KELVIN_RANGE.start(), *KELVIN_RANGE.end()));
    let u = 1e3 / t;
    let x = if t <= 4000.0 {
        -0.266_123_9 * u.powi(3) - 0.234_358_9 * u.powi(2) + 0.877_695_6 * u + 0.179_910
    } else {
        -3.025_846_9 * u.powi(3) + 2.107_037_9 * u.powi(2) + 0.222_634_7 * u + 0.240_390
    };
    let y = if t <= 2222.0 {
        -1.106_381_4 * x.powi(3) - 1.348_110_20 * x.powi(2) + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x.powi(3) - 1.374_185_93 * x.powi(2) + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758_0 * x.powi(3) - 5.873_386_70 * x.powi(2) + 3.751_129_97 * x - 0.370_014_83
    };
    let [cx, cy, cz] = [x / y, 1.0, (1.0 - x - y) / y];
    let rgb = [
        3.240_454_2 * cx - 1.537_138_5 * cy - 0.498_531_4 * cz,
        -0.969_266_0 * cx + 1.876_010_8 * cy + 0.041_556_0 * cz,
        0.055_643_4 * cx - 0.204_025_9 * cy + 1.057_225_2 * cz,
    ]
    .map(|v: f64| v.max(0.0));
    let rgb = rgb.map(|v| v as f32);
    let level = luminance(rgb);
    rgb.map(|v| v / level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn daylight_is_nearly_white_and_a_candle_is_red() {
        // 6,504 K lies on the black-body curve beside D65: each channel within 5 % of white.
        assert!(kelvin_to_linear(6504.0).iter().all(|v| (v - 1.0).abs() < 0.05), "{:?}", kelvin_to_linear(6504.0));
        let [r, g, b] = kelvin_to_linear(1900.0);
        assert!(r > 2.0 * g && g > 5.0 * b);
        let [r, _, b] = kelvin_to_linear(12_000.0);
        assert!(b > r);
    }
}
