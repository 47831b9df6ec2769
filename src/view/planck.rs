//! Colour of a black body.

/// Lowest and highest temperature that [`colour_of_kelvin`] knows.
pub const KELVIN_RANGE: std::ops::RangeInclusive<f32> = 1667.0..=25_000.0;

/// Linear Rec. 709 colour of a black body at `kelvin`, of luminance 1, without negative channels.
///
/// Chromaticity: Kim et al., *Color temperature conversion system and method using the same* (2002), cubic splines of
/// the Planckian locus, off by less than 0.001 in x and y over [`KELVIN_RANGE`], to which `kelvin` is clamped.
/// XYZ to RGB: IEC 61966-2-1. Below about 1900 K blue would be negative; it is clipped to 0.
pub fn colour_of_kelvin(kelvin: f32) -> [f32; 3] {
    let t = f64::from(kelvin.clamp(*KELVIN_RANGE.start(), *KELVIN_RANGE.end()));
    let (r, r2, r3) = (1e3 / t, 1e6 / (t * t), 1e9 / (t * t * t));
    let x = if t <= 4000.0 {
        -0.266_123_9 * r3 - 0.234_358_9 * r2 + 0.877_695_6 * r + 0.179_910
    } else {
        -3.025_846_9 * r3 + 2.107_037_9 * r2 + 0.222_634_7 * r + 0.240_390
    };
    let (x2, x3) = (x * x, x * x * x);
    let y = if t <= 2222.0 {
        -1.106_381_4 * x3 - 1.348_110_20 * x2 + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x3 - 1.374_185_93 * x2 + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758_0 * x3 - 5.873_386_70 * x2 + 3.751_129_97 * x - 0.370_014_83
    };
    let (big_x, big_z) = (x / y, (1.0 - x - y) / y);
    let rgb = [
        3.240_97 * big_x - 1.537_383 - 0.498_611 * big_z,
        -0.969_244 * big_x + 1.875_968 + 0.041_555 * big_z,
        0.055_630 * big_x - 0.203_977 + 1.056_972 * big_z,
    ];
    let rgb = rgb.map(|v| v.max(0.0) as f32);
    let luminance = luminance(rgb);
    rgb.map(|v| v / luminance)
}

/// Rec. 709 luminance of a linear colour.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_and_a_half_thousand_kelvin_is_nearly_white() {
        // D65 lies beside the Planckian locus, so that a black body of its temperature is off by some percent.
        for v in colour_of_kelvin(6504.0) {
            assert!((v - 1.0).abs() < 0.06, "{v}");
        }
    }

    #[test]
    fn warm_is_red_and_cold_is_blue_with_the_same_luminance() {
        let mut last = f32::INFINITY;
        for kelvin in [1000.0, 1667.0, 2222.0, 2700.0, 4000.0, 4001.0, 6500.0, 10_000.0, 25_000.0, 1e9] {
            let colour = colour_of_kelvin(kelvin);
            assert!((luminance(colour) - 1.0).abs() < 1e-5);
            let red_over_blue = colour[0] / colour[2].max(1e-6);
            assert!(red_over_blue <= last, "{kelvin} K: {colour:?}");
            last = red_over_blue;
        }
    }
}
