//! Tone curves as tables, for pictures in motion: powers and logarithms cost more than all else that is done with a
//! pixel.

use std::sync::LazyLock;

use super::tone::{ToneCurve, agx, agx_curve, encode_srgb, filmic, neutral};

/// The curves of [`ToneCurve`] to 8 bits, each within 0.11 of a step of the exact value before it is rounded.
pub struct ToneTables {
    /// sRGB over values of [0, 1], fine enough that no step of 8 bits is missed where it is steepest.
    srgb: Vec<u8>,
    /// AgX's curve over the first bits of a value's exponent and mantissa.
    agx: Vec<f32>,
}

static TABLES: LazyLock<ToneTables> = LazyLock::new(ToneTables::new);

impl ToneTables {
    const SRGB_STEPS: usize = 1 << 14;
    /// AgX is flat below 2⁻¹³ and above 2⁵; bits of the mantissa that count between them.
    const AGX_OCTAVES: (i32, i32) = (-13, 5);
    const AGX_BITS: u32 = 10;

    /// The tables, which are made once.
    pub fn shared() -> &'static Self {
        &TABLES
    }

    fn new() -> Self {
        let byte = |i: usize| (encode_srgb(i as f32 / Self::SRGB_STEPS as f32) * 255.0 + 0.5) as u8;
        let (low, high) = Self::AGX_OCTAVES;
        let middle = |i: i32| {
            let (octave, part) = (low + (i >> Self::AGX_BITS), i & ((1 << Self::AGX_BITS) - 1));
            (octave as f32).exp2() * (1.0 + (part as f32 + 0.5) / (1 << Self::AGX_BITS) as f32)
        };
        let agx = (0..(high - low) << Self::AGX_BITS).map(|i| agx_curve(middle(i)));
        Self { srgb: (0..=Self::SRGB_STEPS).map(byte).collect(), agx: agx.collect() }
    }

    /// sRGB of a linear value, as a byte.
    pub fn srgb(&self, value: f32) -> u8 {
        // Conversion to an integer saturates; NaN becomes 0.
        self.srgb[((value * Self::SRGB_STEPS as f32 + 0.5) as usize).min(Self::SRGB_STEPS)]
    }

    fn agx_curve(&self, value: f32) -> f32 {
        let first = (Self::AGX_OCTAVES.0 + 127) << Self::AGX_BITS;
        let at = (value.max(0.0).to_bits() >> (23 - Self::AGX_BITS)) as i32 - first;
        self.agx[at.clamp(0, self.agx.len() as i32 - 1) as usize]
    }

    /// What is displayed of an exposed linear pixel, as [`ToneCurve::encode`] has it.
    pub fn encode(&self, curve: ToneCurve, exposed: [f32; 3]) -> [u8; 3] {
        let linear = exposed.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        match curve {
            ToneCurve::None => linear.map(|v| self.srgb(v)),
            ToneCurve::Agx => agx(linear, |v| self.agx_curve(v)).map(|v| (v * 255.0 + 0.5) as u8),
            ToneCurve::Filmic => linear.map(|v| self.srgb(filmic(v))),
            ToneCurve::Neutral => neutral(linear).map(|v| self.srgb(v)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_is_the_exact_one_to_a_ninth_of_a_step() {
        for curve in [ToneCurve::None, ToneCurve::Agx, ToneCurve::Filmic, ToneCurve::Neutral] {
            for i in 0..4000 {
                let value = 1e-6 * 1.005f32.powi(i);
                let pixel = [value, 0.3 * value, 0.01 + 0.5 * value];
                let exact = curve.encode(pixel);
                for (byte, exact) in ToneTables::shared().encode(curve, pixel).into_iter().zip(exact) {
                    // Half a step of rounding, and half a step of the table: 12.92 · 255 / 2¹⁴ / 2 for sRGB; AgX rises
                    // by less over 2⁻¹¹ of an octave.
                    assert!((f32::from(byte) - exact * 255.0).abs() <= 0.5 + 0.11, "{curve:?} at {pixel:?}");
                }
            }
            let odd = ToneTables::shared().encode(curve, [f32::NAN, f32::INFINITY, -1.0]);
            assert!(odd.iter().all(|v| *v < 3), "{curve:?}: {odd:?}");
        }
    }
}
