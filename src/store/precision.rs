//! How entries are stored: f32, f16 with a scale per column, or bf16.

use std::fmt;
use std::str::FromStr;

use half::f16;
use half::slice::HalfFloatSliceExt;

use crate::error::{Error, Result};

/// How the entries of a column are stored.
///
/// The error of a stored entry `v` in a column whose largest finite magnitude is `m`:
///
/// | precision | bytes | largest error |
/// |---|---|---|
/// | `F32` | 4 | 0, bit for bit |
/// | `F16` | 2 | 2⁻¹¹ · abs(v) + 2⁻³⁹ · m + 2⁻¹⁴⁹ |
/// | `Bf16` | 2 | 2⁻⁸ · abs(v) + 2⁻¹³³ |
///
/// `F16` has one scale per column, a power of two, so that no column overflows and scaling adds no error of its own.
/// `Bf16` keeps the sign and saturates where f32's largest values would become infinite. Infinite entries stay
/// infinite and NaN stays NaN in all three.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 32-bit floats, as traced.
    #[default]
    F32,
    /// 16-bit IEEE floats with an f32 scale per column.
    F16,
    /// The upper half of a 32-bit float, rounded to nearest.
    Bf16,
}

impl Precision {
    /// Every precision.
    pub const ALL: [Self; 3] = [Self::F32, Self::F16, Self::Bf16];

    /// The number that stands for it in the header.
    pub fn code(self) -> u32 {
        match self {
            Self::F32 => 0,
            Self::F16 => 1,
            Self::Bf16 => 2,
        }
    }

    /// The precision that a number in the header stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|precision| precision.code() == code)
    }

    /// Bytes of one entry.
    pub fn entry_bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 | Self::Bf16 => 2,
        }
    }

    /// Whether each column has a scale.
    pub fn has_scale(self) -> bool {
        self == Self::F16
    }

    /// Bound on the error relative to the entry itself, for entries not tiny beside their column's largest.
    pub fn relative_error(self) -> f64 {
        match self {
            Self::F32 => 0.0,
            Self::F16 => 1.0 / 2048.0,
            Self::Bf16 => 1.0 / 256.0,
        }
    }

    /// Encodes a column into `bytes` (as many as its entries take) and returns its scale, 1 where there is none.
    pub(super) fn encode(self, column: &[f32], bytes: &mut [u8]) -> f32 {
        pulp::Arch::new().dispatch(Encode { precision: self, column, bytes })
    }

    /// Decodes a column.
    pub(super) fn decode(self, bytes: &[u8], scale: f32, column: &mut [f32]) {
        pulp::Arch::new().dispatch(Decode { precision: self, bytes, scale, column });
    }
}

/// [`Precision::encode`], compiled for the vectors that the machine has. Not a closure: what wraps one is compiled
/// without them.
struct Encode<'a> {
    precision: Precision,
    column: &'a [f32],
    bytes: &'a mut [u8],
}

impl pulp::NullaryFnOnce for Encode<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        match self.precision {
            Precision::F32 => self.bytes.copy_from_slice(bytemuck::cast_slice(self.column)),
            Precision::F16 => return encode_f16(self.column, self.bytes),
            Precision::Bf16 => encode_bf16(self.column, self.bytes),
        }
        1.0
    }
}

/// [`Precision::decode`], as [`Encode`].
struct Decode<'a> {
    precision: Precision,
    bytes: &'a [u8],
    scale: f32,
    column: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Decode<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        match self.precision {
            Precision::F32 => bytemuck::cast_slice_mut(self.column).copy_from_slice(self.bytes),
            Precision::F16 => decode_f16(self.bytes, self.scale, self.column),
            Precision::Bf16 => decode_bf16(self.bytes, self.column),
        }
    }
}

#[inline(always)]
fn encode_f16(column: &[f32], bytes: &mut [u8]) -> f32 {
    let scale = f16_scale(column);
    let inverse = scale.recip();
    let mut scaled = [0.0f32; 256];
    let mut halves = [f16::ZERO; 256];
    for (column, bytes) in column.chunks(256).zip(bytes.chunks_mut(512)) {
        for (scaled, value) in scaled.iter_mut().zip(column) {
            *scaled = value * inverse;
        }
        if scale >= MAX_SCALE {
            // Rounded up to 2¹⁵, f32's largest values would come back infinite.
            let finite = scaled.iter_mut().filter(|value| value.is_finite());
            finite.for_each(|value| *value = value.clamp(-32_752.0, 32_752.0));
        }
        halves[..column.len()].convert_from_f32_slice(&scaled[..column.len()]);
        bytes.copy_from_slice(bytemuck::cast_slice(&halves[..column.len()]));
    }
    scale
}

#[inline(always)]
fn encode_bf16(column: &[f32], bytes: &mut [u8]) {
    let mut upper = [0u16; 256];
    for (column, bytes) in column.chunks(256).zip(bytes.chunks_mut(512)) {
        for (upper, value) in upper.iter_mut().zip(column) {
            *upper = bf16_bits(value.to_bits());
        }
        bytes.copy_from_slice(bytemuck::cast_slice(&upper[..column.len()]));
    }
}

#[inline(always)]
fn decode_f16(bytes: &[u8], scale: f32, column: &mut [f32]) {
    let mut halves = [f16::ZERO; 256];
    for (column, bytes) in column.chunks_mut(256).zip(bytes.chunks(512)) {
        let halves = &mut halves[..column.len()];
        bytemuck::cast_slice_mut(halves).copy_from_slice(bytes);
        halves.convert_to_f32_slice(column);
        column.iter_mut().for_each(|value| *value *= scale);
    }
}

#[inline(always)]
fn decode_bf16(bytes: &[u8], column: &mut [f32]) {
    let mut upper = [0u16; 256];
    for (column, bytes) in column.chunks_mut(256).zip(bytes.chunks(512)) {
        bytemuck::cast_slice_mut(&mut upper[..column.len()]).copy_from_slice(bytes);
        for (value, &upper) in column.iter_mut().zip(&upper) {
            *value = f32::from_bits(u32::from(upper) << 16);
        }
    }
}

/// Scale of columns that reach f32's last binade.
const MAX_SCALE: f32 = f32::from_bits((113 + 127) << 23);

/// The upper half of a float's bits, rounded to nearest, ties to even; saturating; NaN stays NaN. Without branches, so
/// that it becomes SIMD.
#[inline(always)]
fn bf16_bits(bits: u32) -> u16 {
    let rounded = (bits.wrapping_add(0x7fff + (bits >> 16 & 1))) >> 16;
    let magnitude = bits & 0x7fff_ffff;
    let saturated = if magnitude < 0x7f80_0000 && rounded & 0x7fff == 0x7f80 { rounded - 1 } else { rounded };
    let kept = if magnitude > 0x7f80_0000 { bits >> 16 | 0x40 } else { saturated };
    kept as u16
}

/// The power of two that brings the column's largest finite magnitude into [2¹⁴, 2¹⁵), inside what f16 can hold.
#[inline(always)]
fn f16_scale(column: &[f32]) -> f32 {
    // Sixteen running maxima, of bits as signed integers: one alone is a chain that takes as long as the disk.
    let mut largest = [0i32; 16];
    for part in column.chunks(largest.len()) {
        for (largest, value) in largest.iter_mut().zip(part) {
            let magnitude = (value.to_bits() & 0x7fff_ffff) as i32;
            let finite = if magnitude < 0x7f80_0000 { magnitude } else { 0 };
            *largest = finite.max(*largest);
        }
    }
    let largest = f32::from_bits(largest.into_iter().fold(0, i32::max) as u32);
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    // Below 2⁻¹²⁶ the scale itself would be subnormal.
    let scale_exponent = (exponent - 14).max(-126);
    if largest == 0.0 { 1.0 } else { f32::from_bits(((scale_exponent + 127) as u32) << 23) }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::Bf16 => "bf16",
        })
    }
}

impl FromStr for Precision {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|precision| precision.to_string() == text);
        found.ok_or_else(|| Error::input("precision", format!("'{text}' is unknown"), "use f32, f16 or bf16"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(precision: Precision, column: &[f32]) -> Vec<f32> {
        let mut bytes = vec![0; column.len() * precision.entry_bytes()];
        let scale = precision.encode(column, &mut bytes);
        let mut back = vec![7.0; column.len()];
        precision.decode(&bytes, scale, &mut back);
        back
    }

    #[test]
    fn the_stated_error_holds_over_the_whole_range_of_f32() {
        // Every exponent, several mantissas, in columns of very different largest entries.
        for top in [f32::MAX, 65_504.0, 1.0, 1e-20, 1e-40, f32::from_bits(1)] {
            let mut column = vec![top];
            for exponent in 0..255u32 {
                for mantissa in [0, 1, 0x0f_ffff, 0x40_0001, 0x7f_ffff] {
                    let value = f32::from_bits(exponent << 23 | mantissa);
                    if value <= top {
                        column.extend([value, -value]);
                    }
                }
            }
            for precision in Precision::ALL {
                for (&value, back) in column.iter().zip(through(precision, &column)) {
                    let (value, back, top) = (f64::from(value), f64::from(back), f64::from(top));
                    let floor = match precision {
                        Precision::F32 => 0.0,
                        Precision::F16 => top * 2f64.powi(-39) + 2f64.powi(-149),
                        Precision::Bf16 => 2f64.powi(-133),
                    };
                    let bound = precision.relative_error() * value.abs() + floor;
                    assert!((value - back).abs() <= bound, "{precision}: {value:e} became {back:e}, top {top:e}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_finite_stays_so() {
        for precision in Precision::ALL {
            let back = through(precision, &[f32::INFINITY, 1.0, f32::NEG_INFINITY, f32::NAN]);
            assert_eq!(back[..3], [f32::INFINITY, 1.0, f32::NEG_INFINITY], "{precision}");
            assert!(back[3].is_nan(), "{precision}");
        }
    }

    #[test]
    fn bf16_rounds_as_the_reference_does() {
        let mut bits = 0u32;
        for _ in 0..1_000_000 {
            bits = bits.wrapping_add(0x9e37_79b9);
            let reference = half::bf16::from_f32(f32::from_bits(bits));
            // Beyond the largest finite value ours saturates; of a NaN only that it is one counts.
            let same = half::bf16::from_bits(bf16_bits(bits));
            let agree = same == reference || same.is_nan() && reference.is_nan() || reference.is_infinite();
            assert!(agree, "{bits:#x}: {same} for {reference}");
        }
    }

    #[test]
    fn codes_and_names_lead_back() {
        for precision in Precision::ALL {
            assert_eq!(Precision::from_code(precision.code()), Some(precision));
            assert_eq!(precision.to_string().parse::<Precision>().unwrap(), precision);
        }
        assert_eq!(Precision::from_code(3), None);
        assert!("f64".parse::<Precision>().is_err());
    }
}
