//! Blocks of factors as they are held for relighting: 8 or 16 bits a value.

#[cfg(feature = "gpu")]
use std::ops::Range;

use crate::error::{Error, Result};
use crate::matrix::{BlockId, CHANNELS, FactoredBlock, MatrixShape};

/// Largest magnitude that 16-bit values are scaled to. The smallest normal 16-bit float is then 2⁻²⁹ of it. Smaller
/// values are stored as 0, so that kernels never meet a subnormal number.
const WIDE_PEAK: f64 = 32_768.0;

/// Largest size of an 8-bit value. −128 is not used, so that signs are alike.
const NARROW_PEAK: f64 = 127.0;

/// Largest 8-bit scale, as a fraction of the quantiser step. Rounding then adds at most 1/16 of the step's error power,
/// and 1/8 with carried errors. (The stored error is that of transform coefficients, many of them exactly 0; rounding
/// affects every value.)
const FINEST_SHARE: f64 = 0.25;

/// A stored value that kernels turn into f32 without branches.
pub(crate) trait Quantum: Copy + Sync {
    /// The value before scaling.
    fn to_f32(self) -> f32;
}

impl Quantum for i8 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

impl Quantum for f32 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

/// The bits of a 16-bit float that is neither subnormal nor infinite nor NaN.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(crate) struct Wide(pub u16);

impl Quantum for Wide {
    /// Moves exponent and mantissa into place and mends the exponent's bias by a product with 2¹¹²: vectorises, which
    /// a conversion with cases for subnormals and infinities does not.
    #[inline(always)]
    fn to_f32(self) -> f32 {
        let bits = u32::from(self.0);
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * f32::from_bits((112 + 127) << 23);
        f32::from_bits(magnitude.to_bits() | ((bits & 0x8000) << 16))
    }
}

/// How values are rounded to 8 bits.
#[derive(Clone, Copy, Debug)]
enum Rounding {
    /// Each by itself: pixels are looked at one by one.
    Nearest,
    /// The rounding error of a value is carried to the eighth value after it. So the sum over the 1,024 texels of a
    /// panel has the error of one texel and not 32 times that. Loss for single lamps: decision 38.
    Sums,
}

/// The components of one factor that are stored in one precision.
#[derive(Clone, Debug)]
pub(crate) struct FactorPart<Q> {
    /// Index of each of these components in the block.
    pub components: Vec<u32>,
    /// Their values, component after component.
    pub values: Vec<Q>,
}

/// One factor, `L` or `R`: components of `length` values each, those in 8 bits apart from those in 16.
#[derive(Clone, Debug)]
pub(crate) struct Factor<N = i8, W = Wide> {
    pub length: usize,
    pub narrow: FactorPart<N>,
    pub wide: FactorPart<W>,
}

/// Entries outside the low-rank part, column by column.
#[derive(Clone, Debug, Default)]
pub(crate) struct SparseEntries {
    /// Columns that have entries, ascending, with the end of each one's entries; they begin where the last ended.
    pub ends: Vec<(u32, u32)>,
    /// Row of each entry inside the block.
    pub rows: Vec<u32>,
    /// Value of each entry.
    pub values: Vec<f32>,
}

/// A block `L diag(s) R + S` ready for relighting.
///
/// A component is held in 8 bits where its quantisation step allows it, else as 16-bit floats; the scales of its two
/// factors are folded into one.
#[derive(Clone, Debug)]
pub struct CompactBlock {
    pub(crate) scales: Vec<f32>,
    pub(crate) left: Factor,
    pub(crate) right: Factor,
    pub(crate) sparse: SparseEntries,
}

impl<Q: Copy> FactorPart<Q> {
    fn new() -> Self {
        Self { components: Vec::new(), values: Vec::new() }
    }

    /// Positions of some components, given in ascending order.
    #[cfg(feature = "gpu")]
    fn places(&self, components: &Range<u32>) -> Range<usize> {
        let place_of = |component| self.components.partition_point(|&k| k < component);
        place_of(components.start)..place_of(components.end)
    }

    /// Those of some components, which are counted from the first of them on.
    #[cfg(feature = "gpu")]
    fn piece(&self, length: usize, components: &Range<u32>) -> Self {
        let places = self.places(components);
        Self {
            components: self.components[places.clone()].iter().map(|k| k - components.start).collect(),
            values: self.values[places.start * length..places.end * length].to_vec(),
        }
    }

    fn bytes(&self) -> usize {
        self.components.len() * size_of::<u32>() + self.values.len() * size_of::<Q>()
    }
}

impl<Q: Quantum> FactorPart<Q> {
    #[inline(always)]
    fn widen(&self) -> FactorPart<f32> {
        let values = self.values.iter().map(|value| value.to_f32()).collect();
        FactorPart { components: self.components.clone(), values }
    }
}

impl Factor {
    fn new(length: usize) -> Self {
        Self { length, narrow: FactorPart::new(), wide: FactorPart::new() }
    }

    /// Stores component `index` and returns its scale, 0 for a component of zeros, which takes no room; none if a value
    /// is not finite.
    #[inline(always)]
    fn push(&mut self, index: u32, values: &[f32], step: Option<f32>, rounding: Rounding) -> Option<f64> {
        let peak = peak(values);
        if peak == 0.0 {
            return Some(0.0);
        }
        if !peak.is_finite() {
            return None;
        }
        let peak = f64::from(peak);
        Some(match step.and_then(|step| narrow_scale(values, peak, f64::from(step))) {
            Some(scale) => {
                self.narrow.components.push(index);
                match rounding {
                    Rounding::Nearest => self.narrow.values.extend(values.iter().map(|&v| narrow(v, scale.recip()))),
                    Rounding::Sums => narrow_sums(values, scale.recip(), &mut self.narrow.values),
                }
                scale
            }
            None => {
                self.wide.components.push(index);
                let scale = peak / WIDE_PEAK;
                self.wide.values.extend(values.iter().map(|&v| wide(v, scale.recip())));
                scale
            }
        })
    }

    /// How many of some components are held in 8 bits, and how many in 16.
    #[cfg(feature = "gpu")]
    pub(crate) fn count(&self, components: &Range<u32>) -> (usize, usize) {
        (self.narrow.places(components).len(), self.wide.places(components).len())
    }

    #[cfg(feature = "gpu")]
    fn piece(&self, components: &Range<u32>) -> Self {
        let (narrow, wide) = (self.narrow.piece(self.length, components), self.wide.piece(self.length, components));
        Self { length: self.length, narrow, wide }
    }

    fn bytes(&self) -> usize {
        self.narrow.bytes() + self.wide.bytes()
    }
}

impl<N: Quantum, W: Quantum> Factor<N, W> {
    /// Its values in f32, for several products with the same factor.
    #[inline(always)]
    pub(crate) fn widen(&self) -> Factor<f32, f32> {
        Factor { length: self.length, narrow: self.narrow.widen(), wide: self.wide.widen() }
    }
}

/// The largest size of a value; not finite if one of them is not. By their bits, which order as sizes do and of which many
/// are compared at once.
#[inline(always)]
fn peak(values: &[f32]) -> f32 {
    f32::from_bits(values.iter().fold(0, |peak, v| peak.max(v.to_bits() & 0x7fff_ffff)))
}

/// The scale with which values fit 8 bits, if there is one: `step` itself where the values are multiples of it (then
/// nothing is lost), else the finest scale that fits, where that is fine enough beside `step`.
#[inline(always)]
fn narrow_scale(values: &[f32], peak: f64, step: f64) -> Option<f64> {
    if step <= 0.0 || peak / NARROW_PEAK > step * (1.0 + 1e-6) {
        return None;
    }
    let multiple = |v: f32| {
        let count = f64::from(v) / step;
        // f32 values that were multiples before rounding are off by at most 2⁻²⁴ of themselves.
        (count - count.round()).abs() <= 1e-4
    };
    if values.iter().all(|&v| multiple(v)) {
        return Some(step);
    }
    Some(peak / NARROW_PEAK).filter(|scale| *scale <= FINEST_SHARE * step)
}

/// What a value is added to so that it stands, rounded, in the lowest bits: that takes many at once. 1.5 · 2²³.
const SHIFT: f32 = 12_582_912.0;

/// `value · inverse_scale` rounded.
#[inline(always)]
fn narrow(value: f32, inverse_scale: f64) -> i8 {
    ((f64::from(value) * inverse_scale) as f32 + SHIFT).to_bits() as i8
}

/// The same of neighbours, as [`Rounding::Sums`]. Eight side by side, since each waits for the one before it.
#[inline(always)]
fn narrow_sums(values: &[f32], inverse_scale: f64, out: &mut Vec<i8>) {
    let peak = NARROW_PEAK as f32;
    out.reserve(values.len());
    let mut lost = [0.0f32; 8];
    let one = |value: f32, lost: &mut f32| {
        let wanted = (f64::from(value) * inverse_scale) as f32 + *lost;
        let shifted = wanted.clamp(-peak, peak) + SHIFT;
        *lost = wanted - (shifted - SHIFT);
        shifted.to_bits() as i8
    };
    let (groups, rest) = values.as_chunks::<8>();
    for group in groups {
        let mut narrowed = [0; 8];
        for i in 0..8 {
            narrowed[i] = one(group[i], &mut lost[i]);
        }
        out.extend_from_slice(&narrowed);
    }
    out.extend(rest.iter().zip(&mut lost).map(|(&value, lost)| one(value, lost)));
}

/// `value · inverse_scale`, at most 2¹⁵, as a 16-bit float rounded to even: without cases, so that it takes many values at
/// once.
#[inline(always)]
fn wide(value: f32, inverse_scale: f64) -> Wide {
    let bits = ((f64::from(value) * inverse_scale) as f32).to_bits();
    let size = bits & 0x7fff_ffff;
    let rounded = size + 0xfff + (size >> 13 & 1);
    let half = (rounded >> 13).wrapping_sub(112 << 10) | bits >> 16 & 0x8000;
    Wide(if rounded < 113 << 23 { 0 } else { half as u16 })
}

impl CompactBlock {
    /// Takes the factors of block `id` into compact form: its columns divided by `scales`, so that none of a small unit falls below what
    /// 8 bits tell beside the others. Of no scales all are 1. A lighting is multiplied by them.
    ///
    /// # Errors
    /// Parts that do not fit each other or the shape, and values that are not finite.
    pub fn new(shape: MatrixShape, id: BlockId, block: &FactoredBlock, scales: &[f32]) -> Result<Self> {
        let rect = shape.rect(id);
        let refuse = |problem: String| Err(Error::input(id.to_string(), problem, "pack the matrix again"));
        let empty = block.left.is_empty() && block.right.is_empty() && block.sparse.is_empty();
        if !empty && (block.rows != rect.rows() || block.columns != shape.columns()) {
            let (rows, columns) = (rect.rows(), shape.columns());
            return refuse(format!("has {} × {} entries, not {rows} × {columns}", block.rows, block.columns));
        }
        if !empty && !block.is_consistent() {
            return refuse("has factors that do not fit each other".into());
        }
        let mut divided = None;
        if !scales.is_empty() {
            let block = divided.insert(block.clone());
            block.scale_columns(&scales.iter().map(|scale| scale.recip()).collect::<Vec<_>>());
        }
        let block = divided.as_ref().unwrap_or(block);
        let rank = if empty { 0 } else { block.rank() };
        let mut compact = Self {
            scales: Vec::with_capacity(rank),
            left: Factor::new(rect.rows()),
            right: Factor::new(shape.columns()),
            sparse: SparseEntries::default(),
        };
        let is_finite = pulp::Arch::new().dispatch(PushFactors { block, rank, compact: &mut compact });
        if !is_finite || !block.sparse.iter().all(|e| e.value.is_finite()) {
            return refuse("has factors that are not finite".into());
        }
        for entry in &block.sparse {
            match compact.sparse.ends.last_mut() {
                Some((column, end)) if *column == entry.column.0 => *end += 1,
                _ => compact.sparse.ends.push((entry.column.0, compact.sparse.rows.len() as u32 + 1)),
            }
            compact.sparse.rows.push(entry.row);
            compact.sparse.values.push(entry.value);
        }
        compact.shrink();
        Ok(compact)
    }

    fn shrink(&mut self) {
        for factor in [&mut self.left, &mut self.right] {
            factor.narrow.values.shrink_to_fit();
            factor.wide.values.shrink_to_fit();
        }
        self.sparse.rows.shrink_to_fit();
        self.sparse.values.shrink_to_fit();
    }

    /// Number of components.
    pub fn rank(&self) -> usize {
        self.scales.len()
    }

    /// Bytes that its factors take in memory.
    pub fn bytes(&self) -> usize {
        let sparse = &self.sparse;
        let sparse = sparse.ends.len() * 8 + (sparse.rows.len() + sparse.values.len()) * 4;
        self.left.bytes() + self.right.bytes() + self.scales.len() * size_of::<f32>() + sparse
    }

    /// Some of its components as a block of their own. The sparse entries are in the piece that begins at the first
    /// component, so that the pieces of a block add up to it.
    #[cfg(feature = "gpu")]
    pub(crate) fn piece(&self, components: Range<u32>) -> Self {
        let sparse = if components.start == 0 { self.sparse.clone() } else { SparseEntries::default() };
        let scales = self.scales[components.start as usize..components.end as usize].to_vec();
        Self { scales, left: self.left.piece(&components), right: self.right.piece(&components), sparse }
    }

    /// Whether every relit pixel is black.
    pub(crate) fn is_empty(&self) -> bool {
        self.scales.is_empty() && self.sparse.rows.is_empty()
    }

    /// Rows of one colour channel.
    pub(crate) fn pixels(&self) -> usize {
        self.left.length / CHANNELS
    }
}

/// Takes in all components and says whether they are finite; compiled for the vectors that the machine has. Not a closure:
/// what wraps one is compiled without them.
struct PushFactors<'a> {
    block: &'a FactoredBlock,
    rank: usize,
    compact: &'a mut CompactBlock,
}

impl pulp::NullaryFnOnce for PushFactors<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { block, rank, compact } = self;
        for k in 0..rank {
            let left = compact.left.push(
                k as u32,
                block.left_component(k),
                block.left_step.get(k).copied(),
                Rounding::Nearest,
            );
            let right = compact.right.push(
                k as u32,
                block.right_component(k),
                block.right_step.get(k).copied(),
                Rounding::Sums,
            );
            let (Some(left), Some(right)) = (left, right) else { return false };
            compact.scales.push((left * right) as f32);
        }
        true
    }
}

impl SparseEntries {
    /// The entries of the `at`-th column that has any: rows and values.
    pub(crate) fn of(&self, at: usize) -> (&[u32], &[f32]) {
        let begin = if at == 0 { 0 } else { self.ends[at - 1].1 as usize };
        let range = begin..self.ends[at].1 as usize;
        (&self.rows[range.clone()], &self.values[range])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    #[test]
    fn every_normal_16_bit_float_is_read_exactly() {
        for bits in 0..=u16::MAX {
            let value = f16::from_bits(bits);
            if value.is_normal() || bits & 0x7fff == 0 {
                assert_eq!(Wide(bits).to_f32().to_bits(), value.to_f32().to_bits());
            }
        }
    }

    #[test]
    fn values_are_rounded_to_16_bits_as_the_half_crate_does_it_and_subnormals_to_zero() {
        for bits in (0..0x7000_0000u32).step_by(997) {
            for value in [f32::from_bits(bits), -f32::from_bits(bits)] {
                if value.abs() <= WIDE_PEAK as f32 {
                    let (found, expected) = (f16::from_bits(wide(value, 1.0).0), f16::from_f32(value));
                    // Between the least normal number and zero there is nothing.
                    let flushed = found.to_bits() == 0 && value.abs() < f16::MIN_POSITIVE.to_f32();
                    assert!(found.to_bits() == expected.to_bits() && expected.is_normal() || flushed, "{value:e}");
                }
            }
        }
    }

    #[test]
    fn values_that_are_not_finite_are_refused_wherever_they_stand() {
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in 0..70 {
                let mut values = vec![1.0; 70];
                values[at] = bad;
                assert!(Factor::new(70).push(0, &values, Some(1.0), Rounding::Nearest).is_none());
            }
        }
    }

    #[test]
    fn multiples_of_their_step_lose_nothing_in_8_bits() {
        let step = 0.037f32;
        let values: Vec<f32> = (-127..=127).map(|q| q as f32 * step).collect();
        let mut factor = Factor::new(values.len());
        let scale = factor.push(0, &values, Some(step), Rounding::Sums).unwrap();
        assert!(factor.wide.components.is_empty());
        for (q, v) in factor.narrow.values.iter().zip(&values) {
            assert!((f64::from(*q) * scale - f64::from(*v)).abs() <= 1e-6 * f64::from(v.abs()));
        }
    }

    #[test]
    fn sums_over_columns_keep_what_single_ones_lose() {
        let values: Vec<f32> = (0..1021).map(|i| (0.37 * i as f32).sin() + 0.3).collect();
        let sum: f64 = values.iter().map(|&v| f64::from(v)).sum();
        let mut factor = Factor::new(values.len());
        let scale = factor.push(0, &values, Some(1.0), Rounding::Sums).unwrap();
        let stored: Vec<f64> = factor.narrow.values.iter().map(|&q| f64::from(q) * scale).collect();
        // Each of the eight sums is off by half a unit at its end, and a value by that of the one before it more.
        assert!((stored.iter().sum::<f64>() - sum).abs() <= 4.0 * scale * (1.0 + 1e-3));
        assert!(stored.iter().zip(&values).all(|(q, &v)| (q - f64::from(v)).abs() <= scale * (1.0 + 1e-3)));
    }

    #[test]
    fn a_step_too_fine_for_8_bits_takes_16() {
        let values: Vec<f32> = (0..300).map(|q| q as f32).collect();
        let mut factor = Factor::new(values.len());
        let scale = factor.push(0, &values, Some(1.0), Rounding::Nearest).unwrap();
        assert!(factor.narrow.components.is_empty());
        for (q, v) in factor.wide.values.iter().zip(&values) {
            // A 16-bit float keeps 11 bits: half a unit of the last place is 2⁻¹¹ of the value at most.
            assert!((f64::from(q.to_f32()) * scale - f64::from(*v)).abs() <= f64::from(*v) / 2048.0);
        }
    }
}
